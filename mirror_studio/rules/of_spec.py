"""What a specification's [rules] names, and the rule's lines that the surface alone is held against."""

from __future__ import annotations

from dataclasses import dataclass

from mirror_cad.errors import SpecError
from mirror_cad.spec import MirrorSpec
from mirror_studio.rules.measuring import RuleQuantities, StatedProperties
from mirror_studio.rules.mounted import Mounted
from mirror_studio.rules.schema import RuleFile, load_rule
from mirror_studio.rules.verdicts import ON_VEHICLE, RuleLine, judged
from raytrace.reflector import Reflector


@dataclass(frozen=True, slots=True, eq=False)
class SpecRules:
    """A rule, the class of it that a mirror is taken for, and the lines that were measured of it."""

    rule: RuleFile
    class_name: str
    lines: tuple[RuleLine, ...] = ()


def rule_of_spec(spec: MirrorSpec) -> SpecRules | None:
    """The rule and class that a specification names, without lines; None where it names none.

    Raises
    ------
    SpecError
        For a rule that there is not, a file of one that is at fault, and a class that the rule has not.
    """
    asked = spec.rules
    if asked is None:
        return None
    try:
        rule = load_rule(asked.rule)
        return SpecRules(rule, rule.class_named(asked.class_name))
    except SpecError as error:
        raise SpecError([fault.replace("--rule ", "rules.rule = ").replace("--class ", "rules.class = ")
                         for fault in error.faults]) from None


def stated_by(spec: MirrorSpec) -> StatedProperties:
    """What a specification says of its mirror that the shape does not tell."""
    rules = spec.rules
    if rules is None:
        return StatedProperties(transition_mm=spec.part.transition_mm)
    return StatedProperties(rules.reflectance_percent, rules.reflectance_night_percent, spec.part.transition_mm)


def measured_of(spec: MirrorSpec, named: SpecRules, reflector: Reflector, mounted: Mounted | None = None) -> RuleQuantities:
    """The mirror of a specification, in mirror coordinates, as the rule that it names measures it."""
    leg = named.rule.leg_mm if spec.rules is None or spec.rules.leg_mm is None else spec.rules.leg_mm
    return RuleQuantities.of(reflector, named.rule, leg, mounted, stated_by(spec))


def surface_lines(spec: MirrorSpec, reflector: Reflector) -> SpecRules | None:
    """The lines of the rule that a specification names, but for those of a mirror on its vehicle; None where it names none.

    Raises
    ------
    MirrorError
        As `rule_of_spec`, and for a face that radii and sizes cannot be taken of.
    """
    named = rule_of_spec(spec)
    if named is None:
        return None
    of = judged(measured_of(spec, named, reflector), named.class_name)
    return SpecRules(named.rule, named.class_name, tuple(line for line in of if line.asked.quantity not in ON_VEHICLE))
