"""The table of the decoupled and the faithful surface of one mirror, and what it means in words."""

from __future__ import annotations

from dataclasses import dataclass

from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.laws.words import plain
from mirror_studio.build.results import MethodChange, MethodComparison, MethodFigures
from mirror_studio.report.stages import Floor
from mirror_studio.report.text import NARROW_SPACE, fixed, fixed_with_unit, number, point_in_words, with_unit

METHODS = ("decoupled", "faithful")
# Changes smaller than what the table shows are none.
SAME_PERCENT = 0.01  # points of an RMS deviation: what the fit is allowed of curvature by default
SAME_DEG, SAME_LANE_PERCENT = 0.005, 0.05


@dataclass(frozen=True, slots=True)
class SideBySide:
    """What the section “Decoupled and faithful” shows, in words.

    Attributes
    ----------
    columns
        Each method, and whether the mirror is built by it.
    flat
        Whether the design is a plane.
    curvatures
        Each curvature with RMS and largest deviation by both methods.
    views, change
        What the driver sees by both, and how far the surfaces are apart.
    exchange, floor
        Sentences on what is gained and lost, and on what no surface can do.
    built, others
        The method, and what else there is.
    """

    columns: list[tuple[str, bool]]
    flat: bool
    curvatures: list[tuple[str, list[tuple[str, str]]]]
    views: list[tuple[str, list[str]]]
    change: list[tuple[str, str]]
    exchange: list[str]
    floor: str | None
    built: str
    others: list[str]


def side_by_side(methods: MethodComparison | None, built: str, distance_mm: float) -> SideBySide | None:
    """The section “Decoupled and faithful”; None without measurements.

    Parameters
    ----------
    methods
        Both surfaces as measured.
    built
        The method that the mirror is built by.
    distance_mm
        From the eye to the lane's plane, mm.
    """
    if methods is None:
        return None
    both = methods.both()
    flat = both[0].deviation.shape.rms_percent is None
    shape = [(with_unit(one.deviation.shape.rms_percent, "%"), with_unit(one.deviation.shape.max_percent, "%"))
             for one in both]
    curvatures = [(quantity, [(with_unit(one.deviation.of(quantity).rms_percent, "%"),
                               with_unit(one.deviation.of(quantity).max_percent, "%", sign=True)) for one in both])
                  for quantity in QUANTITIES]
    return SideBySide(
        [(method, method == built) for method in METHODS], flat, [("shape", shape), *curvatures],
        [("horizontal field of view, traced", [fixed_with_unit(one.h_fov_deg, "°", 2) for one in both]),
         ("vertical field of view at the left edge, traced", [fixed_with_unit(one.v_fov_left_deg, "°", 2) for one in both]),
         ("lane straightness, traced", [fixed_with_unit(one.lane_straightness_percent, "%", 1) for one in both])],
        _change_rows(methods.change, distance_mm), [] if flat else exchange_sentences(*both),
        _floor_sentence(Floor.found(methods.floor)), built, [method for method in METHODS if method != built])


def exchange_sentences(decoupled: MethodFigures, faithful: MethodFigures) -> list[str]:
    """What a designer gains and loses by the faithful surface: in curvature, and for the driver.

    Of a design that is no plane, whose deviation has percent.
    """
    shapes = [one.deviation.shape.rms_percent or 0.0 for one in (decoupled, faithful)]
    if max(shapes) < SAME_PERCENT:
        return [f"These laws both surfaces hold: their shape deviates by {with_unit(shapes[0], '%')} and "
                f"{with_unit(shapes[1], '%')} RMS."]
    sentences = []
    if shapes[0] - shapes[1] >= SAME_PERCENT:
        times = f"{number(shapes[0] / shapes[1], 2)} times closer" if shapes[1] >= SAME_PERCENT else "all the way"
        sentences.append(f"As a whole the faithful surface comes {times} to the two laws: shape RMS "
                         f"{_from_to(shapes[0], shapes[1])}.")
    moved = sorted(((key, decoupled.deviation.of(key).rms_percent or 0.0, faithful.deviation.of(key).rms_percent or 0.0)
                    for key in QUANTITIES), key=lambda row: -abs(row[1] - row[2]))
    for word, sign in (("Gained", 1.0), ("Lost", -1.0)):
        parts = [f"{key} {_from_to(before, after)}" for key, before, after in moved if sign * (before - after) >= SAME_PERCENT]
        if parts:
            sentences.append(f"{word} (RMS): {', '.join(parts)}.")
    worst = [one.deviation.largest_principal_percent for one in (decoupled, faithful)]
    sentences.append(f"What a limit is held to, the largest of k1 and k2, goes from {with_unit(worst[0], '%')} to "
                     f"{with_unit(worst[1], '%')}.")
    driver = [text for text in (_lane(decoupled, faithful), _view(decoupled, faithful)) if text]
    if driver:
        sentences.append(f"For the driver, {'; '.join(driver)}.")
    return sentences


def _lane(decoupled: MethodFigures, faithful: MethodFigures) -> str | None:
    before, after = (one.lane_straightness_percent for one in (decoupled, faithful))
    if before is None or after is None:
        if before is None and after is None:
            return None
        return f"the lane's straightness can be measured in the {'faithful' if before is None else 'decoupled'} one only"
    if abs(abs(after) - abs(before)) < SAME_LANE_PERCENT:
        return "the lane bends as much in both"
    more = "more" if abs(after) > abs(before) else "less"
    return f"the lane bends {more}: {fixed(before, 1)}\u00a0→\u00a0{fixed_with_unit(after, '%', 1)}"


def _view(decoupled: MethodFigures, faithful: MethodFigures) -> str | None:
    parts = []
    for before, after, where in ((decoupled.h_fov_deg, faithful.h_fov_deg, "across"),
                                 (decoupled.v_fov_left_deg, faithful.v_fov_left_deg, "upright at the left edge")):
        if abs(after - before) >= SAME_DEG:
            parts.append(f"{fixed_with_unit(abs(after - before), '°', 2)} {'wider' if after > before else 'narrower'} {where}")
    return f"the view is {' and '.join(parts)}" if parts else None


def _from_to(before: float, after: float) -> str:
    return f"{number(before)}\u00a0→\u00a0{with_unit(after, '%')}"


def _change_rows(change: MethodChange, distance_mm: float) -> list[tuple[str, str]]:
    at = f" at {point_in_words(change.sag_max_at_mm)}{NARROW_SPACE}mm" if change.sag_max_mm else ""
    return [
        ("height moved, point and normal at the origin held",
         f"{with_unit(change.sag_max_mm, 'mm', sign=True)}{at}; RMS\u00a0{with_unit(change.sag_rms_mm, 'mm')}"),
        ("height moved, after the best fit of a rigid motion", f"at most {with_unit(change.sag_best_fit_max_mm, 'mm')}"),
        ("slope", f"at most {with_unit(change.slope_max_arcmin, '′')}"),
        ("reflected ray",
         f"at most {with_unit(change.ray_max_arcmin, '′')}; RMS\u00a0{with_unit(change.ray_rms_arcmin, '′')}"),
        (f"on the plane {plain(distance_mm)} mm behind the eye",
         f"at most {with_unit(change.on_plane_max_mm, 'mm')}; RMS\u00a0{with_unit(change.on_plane_rms_mm, 'mm')}"),
    ]


def _floor_sentence(floor: Floor | None) -> str | None:
    words = floor.in_words() if floor is not None else None
    if floor is None or words is None:
        return None
    if (floor.levels[-1][1] or 0.0) < SAME_PERCENT:
        return f"One surface can hold both of these laws: {words}."
    return f"The faithful surface's shape RMS is the floor of these laws: {words}."
