"""Field of view: the angle between two rays as they leave the mirror."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.registry import Measure, register
from raytrace.surfaces.base import OpticalSurface

if TYPE_CHECKING:
    from raytrace.measures.in_use import MirrorInUse

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]


def angle_between(a: Array, b: Array) -> float:
    """Angle between two unit vectors (3,), radians, exact for small and large ones: 2·atan2(|a − b|, |a + b|)."""
    return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))


def traced_fields_of_view(surface: OpticalSurface, eye: Array, box: Box, left_height_mm: float) -> tuple[float, float]:
    """Trace H-FOV, and V-FOV at the left edge, with the eye where it really sits.

    H: between the rays reflected at the mirror's left and right edge, y = 0. V: between those at the left edge's two
    corners before rounding, (x_left, ±left height/2), which lie on the surface but outside the outline. Through glass,
    both are those of the same points of the reflecting back, as if front and glass went on beyond the outline.

    Parameters
    ----------
    surface : what reflects, in mirror coordinates.
    eye : (3,), mm.
    box : (x_min, x_max, y_min, y_max) of the mirror, mm.
    left_height_mm : of its left edge before rounding, mm.

    Returns
    -------
    horizontal, vertical : radians; NaN where the surface's sheet ends before a ray leaves.
    """
    x_min, x_max = box[0], box[1]
    half = 0.5 * left_height_mm
    _, out = surface.reflected_at(eye, np.array([x_min, x_max, x_min, x_min]), np.array([0.0, 0.0, -half, half]))
    return angle_between(out[0], out[1]), angle_between(out[2], out[3])


def fields_of_setup(use: MirrorInUse) -> tuple[float, float]:
    """`traced_fields_of_view` of a mirror in use, degrees; without a left height, of its box."""
    view = use.setup
    height = use.box[3] - use.box[2] if use.left_height_mm is None else use.left_height_mm
    horizontal, vertical = np.degrees(traced_fields_of_view(view.reflector.surface, view.eye_in_mirror, use.box, height))
    return float(horizontal), float(vertical)


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None


register(Measure(
    "h_fov_section_deg", "horizontal field of view, section", "°", 2,
    "of the horizontal section alone, the eye on the axis through its centre at the eye's distance: between the rays reflected "
    "at its two edges", lambda use: use.sections_deg and use.sections_deg[0], "setup", "Field of view", "more", local=True))
register(Measure(
    "h_fov_traced_deg", "horizontal field of view, traced", "°", 2,
    "with the eye where it sits: between the rays reflected at (±width/2, 0)",
    lambda use: _number(use.record(fields_of_setup)[0]), "setup", "Field of view", "more", local=True))
register(Measure(
    "v_fov_left_section_deg", "vertical field of view at the left edge, section", "°", 2,
    "of the circle of radius Ry at the left edge over the left height alone, the eye on its axis",
    lambda use: use.sections_deg and use.sections_deg[1], "setup", "Field of view", "more", local=True))
register(Measure(
    "v_fov_left_traced_deg", "vertical field of view at the left edge, traced", "°", 2,
    "with the eye where it sits: between the rays reflected at the left edge's two corners before rounding",
    lambda use: _number(use.record(fields_of_setup)[1]), "setup", "Field of view", "more", local=True))
