"""A rule's name or a TOML file in, its lines for every class of mirror out; every fault of the file at once."""

from __future__ import annotations

import math
from importlib import resources
from importlib.resources.abc import Traversable
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator
from pydantic.functional_validators import BeforeValidator

from mirror_cad.errors import SpecError
from mirror_cad.eyes import EYE_SEPARATION_MM
from mirror_cad.keys import AsTuple, Number, Section, is_number
from mirror_cad.spec.file import names_in, read_toml, validated

Checked = Literal["read", "said", "memory"]
Unit = Literal["mm", "m", "m²", "mm²", "%", "°", "1"]
Origin = Literal["median", "flank", "other flank"]

RULES = {"R46": "r46-03", "GB15084": "gb15084-2022", "FMVSS111": "fmvss111"}  # the edition that a rule's name alone means

# What can be measured of a mirror, with its unit; `mirror_studio.rules.measuring` measures each.
QUANTITIES: dict[str, Unit] = {
    "radius_r_mm": "mm", "radius_ri_spread_percent": "%", "radius_rp_spread_percent": "%", "radius_centre_mm": "mm",
    "radius_least_mm": "mm", "sphere_departure_mm": "mm", "whole_departure_mm": "mm", "aspheric_width_mm": "mm",
    "rectangle_mm": "mm", "segment_b_mm": "mm", "area_mm2": "mm²", "inscribed_circle_mm": "mm", "box_short_mm": "mm",
    "box_long_mm": "mm", "round_share": "1",
    "reflectance_percent": "%", "reflectance_night_percent": "%", "mirror_angle_deg": "°", "mirror_height_m": "m",
    "field_missing_m2": "m²", "field_obstructed_percent": "%", "field_angle_deg": "°"}


def _end(value: object) -> object:
    if not is_number(value) or math.isnan(value):
        raise ValueError("must be a number, inf or -inf")
    return float(value)


def _of_quantities(name: str) -> str:
    if name not in QUANTITIES:
        raise ValueError(f"must be one of {', '.join(QUANTITIES)}")
    return name


End = Annotated[float, BeforeValidator(_end)]
Quantity = Annotated[str, AfterValidator(_of_quantities)]
Range = Annotated[tuple[End, End], AsTuple]
Words = Annotated[str, Field(min_length=1)]


class InscribedSection(Section):
    """A length that depends on the radius: a = numerator/(1 + over/r); 1/r = 0 for a flat mirror."""

    numerator_mm: Annotated[Number, Field(gt=0)]
    over_mm: Annotated[Number, Field(gt=0)]

    def at(self, radius_mm: float) -> float:
        """The length for a mean radius; of a concave mirror, to which the rule gives none, NaN."""
        return self.numerator_mm / (1.0 + self.over_mm / radius_mm) if radius_mm > 0.0 else math.nan


class FieldSection(Section):
    """A piece of ground: rows [x, inner, outer] in metres, straight between them.

    x rises, and runs rearward from the ocular points, or from the vehicle's front; inf ends a field that goes on to the
    horizon as it was. inner and outer are counted outward, to the mirror's side, from the median plane, from the flank on the
    mirror's side, or from the other flank. corner_radius_m : of the outer corner at the first row, about (x + radius, outer −
    radius).
    """

    rows_m: Annotated[tuple[Annotated[tuple[End, End, End], AsTuple], ...], AsTuple]
    x_from: Literal["eyes", "front"] = "eyes"
    inner_from: Origin = "flank"
    outer_from: Origin = "flank"
    corner_radius_m: Annotated[Number, Field(ge=0)] = 0.0

    @model_validator(mode="after")
    def _in_order(self) -> FieldSection:
        x = [row[0] for row in self.rows_m]
        if len(x) < 2 or any(b <= a for a, b in pairwise(x)) or not all(map(math.isfinite, x[:-1])):
            raise ValueError("must have two rows or more, with rising x, of which the last alone may be inf")
        if not all(math.isfinite(end) for row in self.rows_m for end in row[1:]):
            raise ValueError("must have finite inner and outer ends")
        if x[-1] == math.inf and self.rows_m[-1][1:] != self.rows_m[-2][1:]:
            raise ValueError("must be as wide at inf as at the row before")
        return self

    @property
    def endless(self) -> bool:
        """Whether it goes on to the horizon."""
        return self.rows_m[-1][0] == math.inf


class WhenSection(Section):
    """A line that counts only where another quantity lies in [from, below)."""

    quantity: Quantity
    least: End = -math.inf
    below: End = math.inf


class LineSection(Section):
    """One requirement. `checked` is how sure its numbers are, `paragraph_checked` how sure where they stand is.

    beyond : what a value outside the limit is: missed, or open, where the wording does not say what then.
    side : whether it is asked on the driver's side alone, or on the other.
    projected : whether shares of a field are those of its projection on an upright plane across the road.
    """

    paragraph: Words
    paragraph_checked: Checked = "memory"
    text: Words
    classes: Annotated[tuple[str, ...], AsTuple] = ()  # all of them, where it names none
    quantity: Quantity
    unit: Unit
    limit: Range | None = None
    least_of_radius: InscribedSection | None = None
    field: FieldSection | None = None
    when: WhenSection | None = None
    side: Literal["driver", "passenger"] | None = None
    beyond: Literal["missed", "open"] = "missed"
    projected: bool = False
    measured: Words
    checked: Checked

    @model_validator(mode="after")
    def _consistent(self) -> LineSection:
        if QUANTITIES[self.quantity] != self.unit:
            raise ValueError(f"{self.quantity} has the unit {QUANTITIES[self.quantity]!r}, not {self.unit!r}")
        if self.limit is not None and self.limit[0] > self.limit[1]:
            raise ValueError(f"limit = [{self.limit[0]:g}, {self.limit[1]:g}] must rise")
        if self.quantity.startswith("field_") and self.quantity != "field_angle_deg" and self.field is None:
            raise ValueError(f"{self.quantity} needs a field: which piece of ground it is of")
        return self


class EyesSection(Section):
    """The ocular points that the rule looks from."""

    separation_mm: Annotated[Number, Field(ge=0, le=200)] = EYE_SEPARATION_MM
    above_r_mm: Annotated[Number, Field(ge=0, le=2000)] = 635.0
    checked: Checked = "memory"


class RuleFile(Section):
    """One rule in one edition.

    based_on : another rule file, whose lines it takes over where it does not say otherwise; based_on_checked says how sure
    that is.
    readings : where the spherometer is set: "annex 7", at three points of an arc; "ten", twice at five places.
    leg_mm : between its outer feet, where none is asked for.   field_of_spheres_mm : where only spherical surfaces count
    towards a field, how far one may depart from its sphere and be one.
    main_part_alone : whether the main part has to show the field without the aspheric one that a transition line parts off.
    """

    rule: Words
    title: Words
    edition: Words
    classes: Annotated[tuple[str, ...], AsTuple] = ()
    default_class: str = ""
    based_on: str = ""
    based_on_checked: Checked | None = None
    based_on_prefix: str = ""
    wording: Words
    readings: Literal["annex 7", "ten"] = "annex 7"
    leg_mm: Annotated[Number, Field(gt=0, le=500)] = 38.1
    leg_checked: Checked = "memory"
    field_of_spheres_mm: Annotated[Number, Field(ge=0)] | None = None
    main_part_alone: bool = False
    eyes: EyesSection = EyesSection()
    line: Annotated[tuple[LineSection, ...], AsTuple] = ()

    @model_validator(mode="after")
    def _classes(self) -> RuleFile:
        if self.based_on:
            return self
        unknown = sorted({name for line in self.line for name in line.classes} - set(self.classes))
        if unknown:
            raise ValueError(f"a line is of class {unknown[0]!r}: the file's classes are {', '.join(self.classes)}")
        if self.default_class not in self.classes:
            raise ValueError(f"default_class = {self.default_class!r} must be one of {', '.join(self.classes)}")
        return self

    def lines_of(self, name: str) -> tuple[LineSection, ...]:
        """The lines of one class, in the file's order."""
        return tuple(line for line in self.line if not line.classes or name in line.classes)

    def class_named(self, name: str | None) -> str:
        """The class of that name, or the one that is meant without one.

        Raises
        ------
        SpecError
            For a class that the rule has not.
        """
        if name is None:
            return self.default_class
        if name not in self.classes:
            raise SpecError(f"--class {name}: {self.rule} has no such class; it has {', '.join(self.classes)}")
        return name


def rule_names() -> list[str]:
    """The names of the rule files that come with the package."""
    return names_in(_folder())


def load_rule(name_or_path: str) -> RuleFile:
    """Read a rule: R46, GB15084 or FMVSS111, the name of one of the package's files (r46-04), or a TOML file.

    Raises
    ------
    SpecError
        With one fault for each unknown, missing, ill-typed or impossible key.
    """
    name = RULES.get(name_or_path.upper(), name_or_path)
    try:
        raw, source, folder = read_toml(name, _folder(), "rule")
    except SpecError as error:
        if Path(name_or_path).exists() or name_or_path.endswith(".toml"):
            raise
        raise SpecError(f"--rule {name_or_path}: {error}; also {', '.join(RULES)}") from None
    given = validated(RuleFile, raw, source, folder)
    return _with_base(given) if given.based_on else given


def _with_base(given: RuleFile) -> RuleFile:
    """The rule with the lines that it takes over: those of a quantity and class for which it has none of its own."""
    if given.based_on not in rule_names():
        raise SpecError(f"based_on = {given.based_on!r}: the rule files are {', '.join(rule_names())}")
    base = load_rule(given.based_on)
    own = {(line.quantity, name) for line in given.line for name in line.classes if line.when is None}
    taken, sure = [], given.based_on_checked or "memory"
    for line in base.line:
        names = tuple(name for name in line.classes or base.classes if (line.quantity, name) not in own)
        if names:
            taken.append(line.model_copy(update={"classes": names, "paragraph": given.based_on_prefix + line.paragraph,
                                                 "checked": _less_sure(line.checked, sure),
                                                 "paragraph_checked": _less_sure(line.paragraph_checked, sure)}))
    return given.model_copy(update={"line": (*taken, *given.line), "classes": given.classes or base.classes,
                                    "default_class": given.default_class or base.default_class, "based_on": "",
                                    "main_part_alone": given.main_part_alone or base.main_part_alone,
                                    "eyes": base.eyes.model_copy(update={"checked": _less_sure(base.eyes.checked, sure)})})


def _less_sure(a: Checked, b: Checked) -> Checked:
    order: tuple[Checked, ...] = ("read", "said", "memory")
    return order[max(order.index(a), order.index(b))]


def _folder() -> Traversable:
    return resources.files("mirror_studio.rules") / "data"
