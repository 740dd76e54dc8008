"""Small mathematics: arrays of numbers and vectors go in, arrays of the same samples come out."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def normalised(vectors: Array) -> Array:
    """Unit vectors along the last axis."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def dot(first: Array, second: Array) -> Array:
    """Scalar product along the last axis."""
    return np.einsum("...i,...i->...", first, second)


def smoothstep(low: float, high: float, value: Array) -> Array:
    """0 below ``low``, 1 above ``high``, smooth in between."""
    t = np.clip((value - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def blend(first: Array, second: Array, weight: Array) -> Array:
    """Colours ``first`` to ``second`` by a weight per sample."""
    return first + (second - first) * weight[..., None]


def smooth_max(*values: Array, radius: float) -> Array:
    """Maximum of implicit functions with edges rounded over about ``radius``."""
    result = values[0]
    for value in values[1:]:
        overlap = np.maximum(radius - np.abs(result - value), 0.0)
        result = np.maximum(result, value) + overlap * overlap / (4.0 * radius)
    return result


def smooth_min(*values: Array, radius: float) -> Array:
    """Minimum of implicit functions with hollows filled over about ``radius``."""
    return -smooth_max(*(-value for value in values), radius=radius)


def box_distance(u: Array, v: Array, half_u: float, half_v: float, corner: float = 0.0) -> Array:
    """Signed distance to a rectangle with rounded corners about the origin."""
    du, dv = np.abs(u) - (half_u - corner), np.abs(v) - (half_v - corner)
    outside = np.hypot(np.maximum(du, 0.0), np.maximum(dv, 0.0))
    return outside + np.minimum(np.maximum(du, dv), 0.0) - corner


def polygon_distance(u: Array, v: Array, corners: list[tuple[float, float]]) -> Array:
    """Signed distance (exact inside) to a convex polygon given counter-clockwise."""
    distance = np.full(np.shape(u), -np.inf)
    for (u0, v0), (u1, v1) in zip(corners, corners[1:] + corners[:1], strict=True):
        length = np.hypot(u1 - u0, v1 - v0)
        distance = np.maximum(distance, ((u - u0) * (v1 - v0) - (v - v0) * (u1 - u0)) / length)
    return distance


def cosine_directions(count: int) -> Array:
    """Evenly spread directions about the third axis, denser towards it (Vogel's spiral on the disc)."""
    radius = np.sqrt((np.arange(count) + 0.5) / count)
    angle = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], axis=1)
