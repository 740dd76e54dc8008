"""The lines of a rule as figures by name, for studies: what is measured, its margin, and how many lines are missed."""

from __future__ import annotations

import math
from collections.abc import Iterable

from mirror_cad.spec import MirrorSpec
from mirror_studio.rules.mounted import Mounted
from mirror_studio.rules.of_spec import measured_of, rule_of_spec
from mirror_studio.rules.schema import QUANTITIES
from mirror_studio.rules.verdicts import ON_VEHICLE, RuleLine, judged
from raytrace.measures.in_use import OnVehicle
from raytrace.reflector import Reflector

MARGIN = "_margin"  # after a quantity's name: how far inside the rule's limit it is, negative where it is outside
MISSED = "rule_lines_missed"


def rule_figures_known() -> dict[str, tuple[str, str]]:
    """The figures' names with unit and definition."""
    found: dict[str, tuple[str, str]] = {}
    for name, unit in QUANTITIES.items():
        shown = "" if unit == "1" else unit
        found[name] = shown, "asked by the rule of the specification's [rules], as `mirror-cad rules` measures it"
        found[name + MARGIN] = shown, f"how far {name} is inside the rule's limit, negative outside; of several lines the least"
    found[MISSED] = "", "how many lines of the rule and class of the specification's [rules] are missed"
    return found


def needs_vehicle(name: str) -> bool:
    """Whether a figure is one of a mirror on its vehicle."""
    return name.removesuffix(MARGIN) in ON_VEHICLE


def rule_figures(spec: MirrorSpec, reflector: Reflector, vehicle: OnVehicle | None, names: Iterable[str],
                 ) -> dict[str, float | None]:
    """Take figures of the rule that a specification names.

    Parameters
    ----------
    spec : MirrorSpec
        With [rules].
    reflector : Reflector
        In mirror coordinates.
    vehicle : OnVehicle or None
        The mirror on its vehicle; without it, what is asked of fields of vision is left out.
    names : iterable of str
        Of `rule_figures_known`.

    Returns
    -------
    dict
        By name; None for what the rule does not ask of this mirror, what is left open, and a flat mirror's radius.

    Raises
    ------
    MirrorError
        For a rule or class that there is not, and a mirror that cannot be measured.
    """
    wanted = list(names)
    named = rule_of_spec(spec)
    if named is None:
        return dict.fromkeys(wanted)
    if vehicle is None:
        measured = measured_of(spec, named, reflector)
    else:
        measured = measured_of(spec, named, vehicle.reflector, Mounted(vehicle.pose, vehicle.eyes, vehicle.host))
    only = None if MISSED in wanted else {name.removesuffix(MARGIN) for name in wanted}
    lines = judged(measured, named.class_name, only)
    found: dict[str, float | None] = {}
    for name in wanted:
        if name == MISSED:
            found[name] = float(sum(line.verdict == "missed" for line in lines))
            continue
        line = _worst(lines, name.removesuffix(MARGIN))
        found[name] = None if line is None else line.margin if name.endswith(MARGIN) else line.value
    return found


def _worst(lines: Iterable[RuleLine], quantity: str) -> RuleLine | None:
    """Of the lines that ask for a quantity, the one with the least margin."""
    own = [line for line in lines if line.asked.quantity == quantity]
    return min(own, key=lambda line: math.inf if line.margin is None else line.margin, default=None)
