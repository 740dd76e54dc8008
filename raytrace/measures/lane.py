"""Lane straightness by exact rays: how far the image of a straight lane bends between the mirror's edges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.in_use import MirrorInUse
from raytrace.measures.registry import Measure, register
from raytrace.measures.straight_lane import Lane, StraightLane
from raytrace.surfaces.base import OpticalSurface
from raytrace.viewing.view import View

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]


PLACES = 65  # at which a height is looked for between the edges of the surface
ROOT_MM = 1e-11  # of a height: rounding of coordinates of some 100 mm
MAX_STEPS = 100  # halving alone takes 50
# An image whose tangent rises less than this share of the width is level: what is left of it is the roots' rounding.
LEVEL_SHARE = 1e-6
# Of five samples: twelve times their step times the first derivative at the first one, to the fourth order.
END_DERIVATIVE = np.array([25.0, -48.0, 36.0, -16.0, 3.0])


@dataclass(frozen=True, slots=True)
class LaneStraightness:
    """How far the image of a straight lane bends between the mirror's edges, percent; None where it does not cross both."""

    percent: float | None


def lane_height(surface: OpticalSurface, eye: Array, lane: StraightLane, x: float, y_min: float, y_max: float,
                ) -> float | None:
    """Find the height y on the mirror at which the lane appears at x.

    Parameters
    ----------
    surface, eye, lane, y_min, y_max : as in `lane_heights`.
    x : mm.

    Returns
    -------
    y in mm; None where the lane does not appear between y_min and y_max.
    """
    found = float(lane_heights(surface, eye, lane, np.array([x]), y_min, y_max)[0])
    return found if np.isfinite(found) else None


def lane_heights(surface: OpticalSurface, eye: Array, lane: StraightLane, x: Array, y_min: float, y_max: float,
                 ) -> Array:
    """Find the heights y on the mirror at which the lane appears at several x; should it appear twice, the upper one.

    Roots of `StraightLane.above` over y, between neighbours of 65 heights, to 1e-11 mm.

    Parameters
    ----------
    surface : what reflects, in mirror coordinates.
    eye : (3,), mm.
    lane : on a plane behind it.
    x : (n,), mm.
    y_min, y_max : mm, between which it is looked for.

    Returns
    -------
    (n,), mm; NaN where the lane does not appear.
    """

    def above(at: Array, y: Array) -> Array:
        result: Array = lane.above(*surface.reflected_at(eye, at, y))
        return result

    y = np.linspace(y_min, y_max, PLACES)
    heights = lane.above(*surface.reflected_on_grid(eye, x, y)).reshape(len(x), PLACES)
    crossing = heights[:, :-1] * heights[:, 1:] <= 0.0
    # The upper one, should a lane appear twice.
    i = PLACES - 2 - np.argmax(crossing[:, ::-1], axis=1)
    found = np.full(len(x), np.nan)
    rows = np.flatnonzero(crossing.any(axis=1))
    if rows.size:
        found[rows] = _roots(lambda at: above(x[rows], at), y[i[rows]], y[i[rows] + 1], heights[rows, i[rows]],
                             heights[rows, i[rows] + 1])
    return found


def _roots(function: Callable[[Array], Array], low: Array, high: Array, at_low: Array, at_high: Array) -> Array:
    """Roots between low and high (n,), where the function changes its sign: secants, halving where one leaves the bracket."""
    before, here, at_before, at_here = low, high, at_low, at_high
    for _ in range(MAX_STEPS):
        with np.errstate(divide="ignore", invalid="ignore"):
            secant = here - at_here * (here - before) / (at_here - at_before)
        settled = at_here == 0.0
        then = np.where(settled, here, np.where((secant > low) & (secant < high), secant, 0.5 * (low + high)))
        at_then = function(then)
        same = at_then * at_low > 0.0
        low, at_low, high = np.where(same, then, low), np.where(same, at_then, at_low), np.where(same, high, then)
        before, here, at_before, at_here = here, then, at_here, at_then
        if np.all((np.abs(here - before) <= ROOT_MM) | (at_here == 0.0)):
            break
    return here


def lane_straightness(view: View, lane: Lane) -> LaneStraightness:
    """Measure how far a straight lane's image bends between the edges of the mirror's box, in mirror coordinates (x, y).

    `lane_straightness_percent` of a view. The lane lies on a plane z = const of the mirror's own coordinates, however it is
    posed.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    lane : on the reference plane behind the eye.

    Returns
    -------
    LaneStraightness
    """
    eye = view.eye_in_mirror
    return LaneStraightness(lane_straightness_percent(view.reflector.surface, eye, lane.before(eye), view.box))


def lane_straightness_percent(surface: OpticalSurface, eye: Array, lane: StraightLane, box: Box) -> float | None:
    """(|Δy_curve| − |Δy_line|)/|Δy_line| in percent at the mirror's left edge, in mirror coordinates (x, y).

    Δy_curve: from where the lane's image crosses the right edge to where it crosses the left edge. Δy_line: the same
    traverse along the tangent of the image at the right edge, a straight line. The more the lane bends, the larger.

    Parameters
    ----------
    surface : what reflects, in mirror coordinates.
    eye : (3,), mm.
    lane : on a plane behind it.
    box : (x_min, x_max, y_min, y_max) of the mirror, mm.

    Returns
    -------
    Percent; None where the lane's image does not cross both edges of the surface, or is level at the right one.

    References
    ----------
    Lee et al. (2014), table 1 and section 3.3, read literally.
    """
    x_min, x_max = box[0], box[1]
    domain = surface.domain
    width = x_max - x_min
    # One-sided differences from inside the mirror, since the law may break at its edge; the step balances their error
    # of the fourth order against the root's 1e-11 mm.
    h = 1e-3 * width
    x = np.append(x_max - h * np.arange(5), x_min)
    *right, left = lane_heights(surface, eye, lane, x, domain[2], domain[3])
    if not np.isfinite([*right, left]).all():
        return None
    tangent = float(END_DERIVATIVE @ np.array(right)) / (12.0 * h)
    line = -tangent * width
    if abs(line) < LEVEL_SHARE * width:
        return None
    return 100.0 * (abs(float(left - right[0])) - abs(line)) / abs(line)


def lane_in_use(use: MirrorInUse) -> LaneStraightness:
    """`lane_straightness` of a mirror in use, over its outline's own box."""
    eye = use.setup.eye_in_mirror
    return LaneStraightness(lane_straightness_percent(use.setup.reflector.surface, eye, use.lane.before(eye), use.box))


register(Measure(
    "lane_straightness_percent", "lane straightness on the reference plane", "%", 1,
    "the paper's: (|Δy_curve| − |Δy_line|)/|Δy_line| of a straight lane's image between the mirror's edges, the line being its "
    "tangent at the right one; the mirror not turned", lambda use: use.record(lane_in_use).percent, "setup", "Straightness",
    "less", local=True))
