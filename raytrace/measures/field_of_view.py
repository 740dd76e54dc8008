"""Field of view: the angle between two rays as they leave the mirror."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.surfaces.base import OpticalSurface

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]


def angle_between(a: Array, b: Array) -> float:
    """Angle between two unit vectors, radians, exact for small and large ones: 2·atan2(|a − b|, |a + b|)."""
    return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))


def traced_fields_of_view(surface: OpticalSurface, eye: Array, box: Box, left_height_mm: float) -> tuple[float, float]:
    """H-FOV and V-FOV at the left edge, radians, with the eye where it really sits.

    H: between the rays reflected at the mirror's left and right edge, y = 0. V: between those at the left edge's two
    corners before rounding, (x_left, ±left height/2), which lie on the surface but outside the outline. Through glass,
    both are those of the same places of the reflecting back, as if front and glass went on beyond the outline; NaN where
    its sheet ends before the ray leaves.
    """
    x_min, x_max = box[0], box[1]
    half = 0.5 * left_height_mm
    _, out = surface.reflected_at(eye, np.array([x_min, x_max, x_min, x_min]), np.array([0.0, 0.0, -half, half]))
    return angle_between(out[0], out[1]), angle_between(out[2], out[3])
