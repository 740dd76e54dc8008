"""A straight lane on the reference plane behind the eye, which the paper measures straightness by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.scene.reference import landed

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Lane:
    """A straight lane on the reference plane behind the eye, as seen in the mirror: Y = y0 + slope·(X − x0), mm.

    Parameters
    ----------
    x0_mm, y0_mm : a point of it; X to the right, Y up, from the mirror's axis.
    slope : of the line.
    distance_mm : of the plane behind the eye.
    """

    x0_mm: float
    y0_mm: float
    slope: float
    distance_mm: float = 8200.0

    def before(self, eye: Array) -> StraightLane:
        """The lane on the plane behind an eye (3,), mm, in mirror coordinates."""
        return StraightLane(self.x0_mm, self.y0_mm, self.slope, float(eye[2]) + self.distance_mm)


@dataclass(frozen=True, slots=True)
class StraightLane:
    """A lane on a plane of the mirror's coordinates: Y = y0 + slope·(X − x0) in z = plane_z_mm, as seen in the mirror.

    Parameters
    ----------
    x0_mm, y0_mm : a point of it, mm; X to the right, Y up.
    slope : of the line.
    plane_z_mm : of the plane, mm.
    """

    x0_mm: float
    y0_mm: float
    slope: float
    plane_z_mm: float

    def above(self, points: Array, directions: Array) -> Array:
        """How far above the lane rays land on the plane.

        Parameters
        ----------
        points, directions : (n, 3), mm, where the rays leave the mirror and along what.

        Returns
        -------
        (n,), mm; NaN for rays that do not go towards the plane.
        """
        at = landed(points, directions, self.plane_z_mm)
        result: Array = at[:, 1] - self.y0_mm - self.slope * (at[:, 0] - self.x0_mm)
        return result
