"""Field of view: the angle between two reflected rays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirror_cad.bspline import BSplineSurface
from mirror_cad.differential import normals

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]


def reflected_at(surface: BSplineSurface, eye: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Points (n, 3) of a sheet with u = x, v = y, and the unit directions (n, 3) in which rays from the eye leave them."""
    d = surface.derivatives(x, y)
    normal = normals(d["u"], d["v"])
    ray = d["s"] - eye
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    return d["s"], ray - 2.0 * np.einsum("ij,ij->i", ray, normal)[:, None] * normal


def angle_between(a: Array, b: Array) -> float:
    """Angle between two unit vectors, radians, exact for small and large ones: 2·atan2(|a − b|, |a + b|)."""
    return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))


def traced_fields_of_view(surface: BSplineSurface, eye: Array, box: Box, left_height_mm: float) -> tuple[float, float]:
    """H-FOV and V-FOV at the left edge, radians, with the eye where it really sits.

    H: between the rays reflected at the mirror's left and right edge, y = 0. V: between those at the left edge's two
    corners before rounding, (x_left, ±left height/2), which lie on the surface but outside the outline.
    """
    x_min, x_max = box[0], box[1]
    half = 0.5 * left_height_mm
    _, out = reflected_at(surface, eye, np.array([x_min, x_max, x_min, x_min]), np.array([0.0, 0.0, -half, half]))
    return angle_between(out[0], out[1]), angle_between(out[2], out[3])
