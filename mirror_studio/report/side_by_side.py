"""The decoupled and the faithful surface of one mirror, as metrics.json has them, in; their table and its meaning out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mirror_cad.laws.words import plain
from mirror_studio.report.stages import Floor
from mirror_studio.report.text import NARROW_SPACE, fixed, fixed_with_unit, number, place, with_unit

METHODS = ("decoupled", "faithful")
CURVATURES = ("shape", "k1", "k2", "kx", "ky", "twist")
# Changes smaller than what the table shows are none.
SAME_PERCENT = 0.01  # points of an RMS deviation: what the fit is allowed of curvature by default
SAME_DEG, SAME_LANE_PERCENT = 0.005, 0.05


def side_by_side(methods: Mapping[str, Any] | None, built: str, distance_mm: float) -> dict[str, Any] | None:
    """What the section “Decoupled and faithful” shows; None without measurements.

    methods : as `mirror_studio.build.methods.compare_methods` returns it.   distance_mm : from the eye to the lane's plane.
    """
    if not methods:
        return None
    both = [methods[method] for method in METHODS]
    flat = both[0]["shape_rms_percent"] is None
    return {
        "columns": [(method, method == built) for method in METHODS], "flat": flat,
        "curvatures": [(key, [(with_unit(one[f"{key}_rms_percent"], "%"),
                               with_unit(one[f"{key}_max_percent"], "%", sign=key != "shape")) for one in both])
                       for key in CURVATURES],
        "views": [(name, [fixed_with_unit(one[key], unit, decimals) for one in both]) for name, key, unit, decimals in (
            ("horizontal field of view, traced", "h_fov_deg", "°", 2),
            ("vertical field of view at the left edge, traced", "v_fov_left_deg", "°", 2),
            ("lane straightness, traced", "lane_straightness_percent", "%", 1))],
        "change": _change_rows(methods["change"], distance_mm),
        "exchange": [] if flat else exchange_sentences(*both),
        "floor": _floor_sentence(Floor.measured(methods["floor"])),
        "built": built, "others": [method for method in METHODS if method != built],
    }


def exchange_sentences(decoupled: Mapping[str, Any], faithful: Mapping[str, Any]) -> list[str]:
    """What a designer gains and loses by the faithful surface: in curvature, and for the driver."""
    shapes = [one["shape_rms_percent"] for one in (decoupled, faithful)]
    if max(shapes) < SAME_PERCENT:
        return [f"These laws both surfaces hold: their shape deviates by {with_unit(shapes[0], '%')} and "
                f"{with_unit(shapes[1], '%')} RMS."]
    sentences = []
    if shapes[0] - shapes[1] >= SAME_PERCENT:
        times = f"{number(shapes[0] / shapes[1], 2)} times closer" if shapes[1] >= SAME_PERCENT else "all the way"
        sentences.append(f"As a whole the faithful surface comes {times} to the two laws: shape RMS "
                         f"{_from_to(shapes[0], shapes[1])}.")
    moved = sorted(((key, decoupled[f"{key}_rms_percent"], faithful[f"{key}_rms_percent"]) for key in CURVATURES[1:]),
                   key=lambda row: -abs(row[1] - row[2]))
    for word, sign in (("Gained", 1.0), ("Lost", -1.0)):
        parts = [f"{key} {_from_to(before, after)}" for key, before, after in moved if sign * (before - after) >= SAME_PERCENT]
        if parts:
            sentences.append(f"{word} (RMS): {', '.join(parts)}.")
    worst = [max(abs(one[f"{key}_max_percent"]) for key in ("k1", "k2")) for one in (decoupled, faithful)]
    sentences.append(f"What a limit is held to, the largest of k1 and k2, goes from {with_unit(worst[0], '%')} to "
                     f"{with_unit(worst[1], '%')}.")
    driver = [text for text in (_lane(decoupled, faithful), _view(decoupled, faithful)) if text]
    if driver:
        sentences.append(f"For the driver, {'; '.join(driver)}.")
    return sentences


def _lane(decoupled: Mapping[str, Any], faithful: Mapping[str, Any]) -> str | None:
    before, after = (one["lane_straightness_percent"] for one in (decoupled, faithful))
    if before is None or after is None:
        if before is None and after is None:
            return None
        return f"the lane's straightness can be measured in the {'faithful' if before is None else 'decoupled'} one only"
    if abs(abs(after) - abs(before)) < SAME_LANE_PERCENT:
        return "the lane bends as much in both"
    more = "more" if abs(after) > abs(before) else "less"
    return f"the lane bends {more}: {fixed(before, 1)}\u00a0→\u00a0{fixed_with_unit(after, '%', 1)}"


def _view(decoupled: Mapping[str, Any], faithful: Mapping[str, Any]) -> str | None:
    parts = []
    for key, where in (("h_fov_deg", "across"), ("v_fov_left_deg", "upright at the left edge")):
        before, after = decoupled[key], faithful[key]
        if before is not None and after is not None and abs(after - before) >= SAME_DEG:
            parts.append(f"{fixed_with_unit(abs(after - before), '°', 2)} {'wider' if after > before else 'narrower'} {where}")
    return f"the view is {' and '.join(parts)}" if parts else None


def _from_to(before: float, after: float) -> str:
    return f"{number(before)}\u00a0→\u00a0{with_unit(after, '%')}"


def _change_rows(change: Mapping[str, Any], distance_mm: float) -> list[tuple[str, str]]:
    at = f" at {place(change['sag_max_at_mm'])}{NARROW_SPACE}mm" if change["sag_max_mm"] else ""
    return [
        ("height moved, point and normal at the origin held",
         f"{with_unit(change['sag_max_mm'], 'mm', sign=True)}{at}; RMS\u00a0{with_unit(change['sag_rms_mm'], 'mm')}"),
        ("height moved, after the best fit of a rigid motion", f"at most {with_unit(change['sag_best_fit_max_mm'], 'mm')}"),
        ("slope", f"at most {with_unit(change['slope_max_arcmin'], '′')}"),
        ("reflected ray",
         f"at most {with_unit(change['ray_max_arcmin'], '′')}; RMS\u00a0{with_unit(change['ray_rms_arcmin'], '′')}"),
        (f"on the plane {plain(distance_mm)} mm behind the eye",
         f"at most {with_unit(change['on_plane_max_mm'], 'mm')}; RMS\u00a0{with_unit(change['on_plane_rms_mm'], 'mm')}"),
    ]


def _floor_sentence(floor: Floor | None) -> str | None:
    words = floor.in_words() if floor is not None else None
    if floor is None or words is None:
        return None
    if (floor.levels[-1][1] or 0.0) < SAME_PERCENT:
        return f"One surface can hold both of these laws: {words}."
    return f"The faithful surface's shape RMS is the floor of these laws: {words}."
