"""Lane straightness by exact rays: how far the image of a straight lane bends between the mirror's edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from mirror_cad.bspline import BSplineSurface
from raytrace.measures.field_of_view import GlassSheets, reflected_at

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]


# An image whose tangent rises less than this share of the width is level: what is left of it is the roots' rounding.
LEVEL = 1e-6


@dataclass(frozen=True, slots=True)
class StraightLane:
    """Y = y0 + slope·(X − x0) in the reference plane z = plane_z_mm, mm, as seen in the mirror: X right, Y up."""

    x0_mm: float
    y0_mm: float
    slope: float
    plane_z_mm: float

    def above(self, points: Array, directions: Array) -> Array:
        """How far above the lane rays land on the plane, mm, (n,); NaN for rays that do not go towards it."""
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (self.plane_z_mm - points[:, 2]) / directions[:, 2]
        landed = points + np.where(t > 0, t, np.nan)[:, None] * directions
        result: Array = landed[:, 1] - self.y0_mm - self.slope * (landed[:, 0] - self.x0_mm)
        return result


def lane_height(surface: BSplineSurface | GlassSheets, eye: Array, lane: StraightLane, x: float, y_min: float, y_max: float,
                ) -> float | None:
    """The height y on the mirror at which the lane appears at x, in mm; None where it does not within [y_min, y_max]."""

    def above(y: float) -> float:
        return float(lane.above(*reflected_at(surface, eye, np.array([x]), np.array([y])))[0])

    y = np.linspace(y_min, y_max, 65)
    heights = lane.above(*reflected_at(surface, eye, np.full_like(y, x), y))
    crossing = np.flatnonzero(heights[:-1] * heights[1:] <= 0)
    if crossing.size == 0:
        return None
    i = int(crossing[-1])  # the upper one, should a lane appear twice
    return float(brentq(above, y[i], y[i + 1], xtol=1e-11))


def lane_straightness(surface: BSplineSurface | GlassSheets, eye: Array, lane: StraightLane, box: Box) -> float | None:
    """(|Δy_curve| − |Δy_line|)/|Δy_line| in percent at the mirror's left edge, in mirror coordinates (x, y).

    Δy_curve: from where the lane's image crosses the right edge to where it crosses the left edge. Δy_line: the same
    traverse along the tangent of the image at the right edge, a straight line. The more the lane bends, the larger.
    None where the lane's image does not cross both edges of the surface, or is level at the right one.
    Source: table 1 and section 3.3 of Lee et al. (2014), read literally.
    """
    x_min, x_max = box[0], box[1]
    domain = surface.domain
    width = x_max - x_min
    # One-sided differences from inside the mirror, since the law may break at its edge; the step balances their error
    # of the fourth order against the root's 1e-11 mm.
    h = 1e-3 * width
    at_right = [lane_height(surface, eye, lane, x_max - k * h, domain[2], domain[3]) for k in range(5)]
    left = lane_height(surface, eye, lane, x_min, domain[2], domain[3])
    if left is None or any(y is None for y in at_right):
        return None
    right = np.array(at_right, dtype=np.float64)
    tangent = float(np.array([25.0, -48.0, 36.0, -16.0, 3.0]) @ right) / (12.0 * h)
    line = -tangent * width
    if abs(line) < LEVEL * width:
        return None
    return 100.0 * (abs(left - right[0]) - abs(line)) / abs(line)
