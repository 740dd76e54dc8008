"""A measured mirror and one class of a rule in, each of its lines with value, limit, margin and verdict out."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Literal

from mirror_studio.json_types import Json
from mirror_studio.rules.ground import MissingGround
from mirror_studio.rules.measuring import RuleQuantities
from mirror_studio.rules.schema import LineSection, Range
from mirror_studio.rules.shape import REFLECTANCE_DEG
from mirror_studio.rules.sizes import area_of

Verdict = Literal["met", "missed", "open"]

NO_VEHICLE = "no vehicle was given: --vehicle SCENE puts the mirror on one"
NOT_ENTERED = {"reflectance_percent": "not entered: --reflectance-percent, or [rules] reflectance_percent, as it was measured",
               "reflectance_night_percent": "not entered: --reflectance-night-percent, or [rules] reflectance_night_percent",
               "aspheric_width_mm": "no transition line is known: --transition-mm, or [part] transition_mm, says where it is"}
OF_FACE = "of the main part, the spherical one of its faces"
OF_PART = "of the main part, inboard of the transition line at x = {:g} mm"
TWICE = "the mirror shows some things twice, so no field is bounded by its edge"
ON_VEHICLE = ("mirror_angle_deg", "mirror_height_m", "field_missing_m2", "field_obstructed_percent", "field_angle_deg")
# What is asked of the main part alone, where a transition line parts it from an aspheric one.
OF_MAIN_PART = ("radius_r_mm", "radius_ri_spread_percent", "radius_rp_spread_percent", "radius_centre_mm",
                "sphere_departure_mm")
ROUNDING = 1e-7  # of a limit: coordinates of 1 m are known to 1e-13, a radius read over 38 mm thereby to 1e-8 of it
SEEN_M2 = 1e-6  # of a field: less is the rounding of its integral, and no eye's


@dataclass(frozen=True, slots=True)
class RuleLine:
    """One requirement beside what was measured.

    value : None where nothing was, or where it has no end (a flat mirror's radius).   margin : how far inside the limit it is,
    negative where it is outside; None where that is no number.   notes : what else is to be known.   ground : what of a field
    is not seen, where it is one that was measured.
    """

    asked: LineSection
    value: float | None
    limit: Range
    margin: float | None
    verdict: Verdict
    notes: tuple[str, ...] = ()
    ground: MissingGround | None = None

    def as_json(self) -> dict[str, Json]:
        """As rules.json holds it; a limit that is none is null."""
        ends = [end if math.isfinite(end) else None for end in self.limit]
        return {"paragraph": self.asked.paragraph, "paragraph_checked": self.asked.paragraph_checked, "text": self.asked.text,
                "quantity": self.asked.quantity, "value": self.value, "unit": self.asked.unit, "limit": ends,
                "margin": self.margin, "verdict": self.verdict, "checked": self.asked.checked, "measured": self.asked.measured,
                "notes": list(self.notes)}


Take = Callable[[RuleQuantities, LineSection], "float | None"]


def _radius(m: RuleQuantities, _: LineSection) -> float:
    return m.radii.mean


def _readings_spread(m: RuleQuantities, _: LineSection) -> float:
    return m.radii.readings_spread_percent if m.rule.readings == "annex 7" else m.radii.off_mean_percent


def _missing(m: RuleQuantities, line: LineSection) -> float | None:
    if line.field is None:
        return None
    found = m.on_vehicle.missing(line.field)
    return found.missing_m2 if found.missing_m2 > SEEN_M2 else 0.0


TAKE: Mapping[str, Take] = {
    "radius_r_mm": _radius,
    "radius_ri_spread_percent": _readings_spread,
    "radius_rp_spread_percent": lambda m, _: m.radii.means_spread_percent,
    "radius_centre_mm": lambda m, _: m.readings.at_centre.mean,
    "radius_least_mm": lambda m, _: m.readings.least_radius,
    "sphere_departure_mm": lambda m, _: m.shape.sphere_departure,
    "whole_departure_mm": lambda m, _: m.shape.sphere_departure,
    "aspheric_width_mm": lambda m, _: m.shape.aspheric_width,
    "rectangle_mm": lambda m, _: 0.0 if m.shape.rectangle is None else m.shape.rectangle.width,
    "segment_b_mm": lambda m, _: m.shape.segment.height,
    "area_mm2": lambda m, _: abs(area_of(m.shape.outline)),
    "inscribed_circle_mm": lambda m, _: m.shape.circle,
    "box_short_mm": lambda m, _: m.shape.box_sides[0],
    "box_long_mm": lambda m, _: m.shape.box_sides[1],
    "round_share": lambda m, _: m.shape.circle / m.shape.box_sides[1],
    "reflectance_percent": lambda m, _: m.stated.reflectance_percent,
    "reflectance_night_percent": lambda m, _: m.stated.reflectance_night_percent,
    "mirror_angle_deg": lambda m, _: m.on_vehicle.angle_deg,
    "mirror_height_m": lambda m, _: m.on_vehicle.height_m,
    "field_missing_m2": _missing,
    "field_obstructed_percent": lambda m, line: None if line.field is None else m.on_vehicle.obstructed_percent(
        line.field, line.projected),
    "field_angle_deg": lambda m, _: m.on_vehicle.horizon_deg,
}


def judged(m: RuleQuantities, class_name: str, only: Collection[str] | None = None) -> list[RuleLine]:
    """Every line of a class, those left out that ask something of other mirrors: of other radii, or of the other side.

    only : the quantities whose lines are wanted; all of them without it.
    """
    return [_judged(m, line) for line in applying(m, class_name, only)]


def applying(m: RuleQuantities, class_name: str, only: Collection[str] | None = None) -> list[LineSection]:
    """The lines of a class that ask something of this mirror."""
    return [line for line in m.rule.lines_of(class_name) if (only is None or line.quantity in only) and _applies(m, line)]


def _applies(m: RuleQuantities, line: LineSection) -> bool:
    if line.side is not None and m.seen is not None and (line.side == "driver") != m.seen.mounted.on_drivers_side:
        return False
    if line.when is None or (line.when.quantity in ON_VEHICLE and m.seen is None):
        return True
    value = TAKE[line.when.quantity](part_of(m, line.when.quantity), line)
    return value is not None and (line.when.least <= value < line.when.below or value == math.inf == line.when.below)


def part_of(m: RuleQuantities, quantity: str) -> RuleQuantities:
    """What of the mirror a quantity is taken of."""
    alone = quantity in OF_MAIN_PART or (quantity.startswith("field_") and m.rule.main_part_alone)
    return m.main if alone else m


def _judged(whole: RuleQuantities, line: LineSection) -> RuleLine:
    m = part_of(whole, line.quantity)
    limit = _limit(whole, line)
    if line.quantity in ON_VEHICLE and m.seen is None:
        return RuleLine(line, None, limit, None, "open", (NO_VEHICLE,))
    if line.quantity.startswith("field_") and m.on_vehicle.shows_twice:
        return RuleLine(line, None, limit, None, "open", (TWICE,))
    value = TAKE[line.quantity](m, line)
    of_part = () if m is whole else (OF_FACE if (x := whole.stated.transition_mm) is None else OF_PART.format(x),)
    if value is None:
        return RuleLine(line, None, limit, None, "open", (NOT_ENTERED[line.quantity], *glass_notes(m, line)))
    notes = [*of_part, *_notes(m, line, value)]
    if math.isnan(limit[0]):
        return RuleLine(line, value, limit, None, "open", (*notes, "the rule gives no length for a hollow mirror"))
    inside = _eased(limit[0], -1.0) <= value <= _eased(limit[1], 1.0)
    ground = m.on_vehicle.missing(line.field) if line.quantity == "field_missing_m2" and line.field is not None else None
    if ground is not None and ground.horizon is False:
        inside = False
    # A least value of 0 is none: sizes, shares and spreads have no other.
    margin = min([value - limit[0]] * (math.isfinite(limit[0]) and limit[0] != 0.0)
                 + [limit[1] - value] * math.isfinite(limit[1]), default=math.inf)
    verdict: Verdict = "met" if inside else line.beyond
    if inside and ground is not None and m.rule.field_of_spheres_mm is not None:
        # What an aspheric part shows does not count, and where all of it is aspheric no part is left that does.
        verdict = "met" if m.shape.sphere_departure <= m.rule.field_of_spheres_mm else "open"
    if verdict == "open":
        notes.append(m.rule.wording)
    if line.quantity.startswith("radius_") and _facets_decide(m, line, value, margin):
        verdict = "open"
    return RuleLine(line, _number(value), limit, _number(margin), verdict, tuple(notes), ground)


def _limit(m: RuleQuantities, line: LineSection) -> Range:
    if line.least_of_radius is not None:
        return line.least_of_radius.at(m.main.radii.mean), math.inf
    return line.limit or (-math.inf, math.inf)


def _eased(end: float, way: float) -> float:
    """An end of a limit, moved outwards by what rounding leaves of a value that is meant to lie on it."""
    return end + way * ROUNDING * abs(end) if math.isfinite(end) else end


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _error(m: RuleQuantities, line: LineSection, value: float) -> float:
    """What facets may change a radius, mm, or a spread, %, by."""
    return m.readings.facets_percent * (abs(value) / 100.0 if line.unit == "mm" else 1.0)


def _facets_decide(m: RuleQuantities, line: LineSection, value: float, margin: float) -> bool:
    return math.isfinite(value) and abs(margin) < _error(m, line, value)


def _notes(m: RuleQuantities, line: LineSection, value: float) -> list[str]:
    """What is to be known beside a value."""
    notes, readings = glass_notes(m, line), m.readings
    if line.quantity in ("radius_r_mm", "radius_centre_mm"):
        if math.isinf(value):
            notes.append("flat" if m.radii.flat else "flat in one direction")
        elif value < 0.0:
            notes.append("hollow")
        else:
            error = readings.dial_error(value)
            notes.append(f"feet {readings.leg_mm:g} mm apart; a dial of 2 µm leaves {error:.1f} mm open at a reading")
    if line.quantity.startswith("radius_") and readings.facets_percent > 0.0:
        notes.append(f"read on facets, which leave about {readings.facets_percent:.2g} % open: what lies nearer to the limit "
                     "is open")
    if line.quantity == "field_missing_m2" and line.field is not None:
        found = m.on_vehicle.missing(line.field)
        if found.horizon is not None:
            notes.append("seen to the horizon" if found.horizon else
                         "what is missing has no end: its end on the horizon is not seen; the value is that up to 1 km")
        notes.append((f"least margin {found.margin_m:+.3f} m at X = {found.at_m[0]:.2f}, Y = {found.at_m[1]:.2f} m; not seen "
                      f"by both eyes at once: {found.missing_to_both_m2:.2f} of {found.required_m2:.1f} m²").replace("-", "−"))
    return notes


def glass_notes(m: RuleQuantities, line: LineSection) -> list[str]:
    """What the front of the glass adds to a reflectance, of a mirror that reflects from its back."""
    if line.quantity != "reflectance_percent" or not m.shape.reflector.surface.refracts:
        return []
    ghost, front = None if m.seen is None else m.seen.ghost, m.shape.front_percent
    told = f"the front of the glass alone reflects {front:.1f} % at {REFLECTANCE_DEG:g}°, a ghost beside the image"
    if ghost is None or ghost.max_arcmin is None:
        return [told]
    return [f"{told}: up to {ghost.max_arcmin:.1f}′ from it for an eye between the driver's, {ghost.mean_arcmin:.1f}′ on "
            "average"]
