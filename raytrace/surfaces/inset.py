"""A closed outline moved inwards: its points along their normals, less those that come nearer to another part of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from raytrace.errors import TraceError

Array = NDArray[np.float64]

AROUND = 256  # points around an outline at least
SPACING_MM = 0.05  # of the outline's points while it is moved inwards: the corners of what is left are right to this
ON_TIME = 1e-6  # mm: a point that was moved by the margin is that far from the outline, up to rounding


def moved_inwards(loop: Array, margin_mm: float) -> Array:
    """The outline (n, 2) without a margin along it, (m, 2), mm.

    Raises
    ------
    TraceError
        Where nothing is left.
    """
    dense = resampled(loop, SPACING_MM)
    inner = _moved_inwards(dense, margin_mm)
    if len(inner) < 3:
        raise TraceError(f"a bezel over {margin_mm:g} mm of the edge leaves nothing of the mirror to see")
    return inner


def resampled(loop: Array, spacing: float | None) -> Array:
    """Points on a closed polygon (n, d), evenly along it: every `spacing`, or AROUND of them."""
    closed = np.concatenate([loop, loop[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    count = AROUND if spacing is None else max(AROUND, int(np.ceil(along[-1] / spacing)))
    at = np.linspace(0.0, along[-1], count, endpoint=False)
    return np.stack([np.interp(at, along, closed[:, c]) for c in range(loop.shape[1])], axis=1)


def outward_normals(loop: Array) -> Array:
    """Unit normals (n, 2) of a closed, counter-clockwise polygon at its points."""
    along = np.roll(loop, -1, axis=0) - np.roll(loop, 1, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([along[:, 1], -along[:, 0]], axis=1)


def _moved_inwards(loop: Array, by: float) -> Array:
    """The points of a closed polygon, moved inwards, that are no nearer to it than that; (m, 2)."""
    x, y = loop[:, 0], loop[:, 1]
    counter = np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) > 0.0
    moved = loop - (by if counter else -by) * outward_normals(loop)
    # The distance to the nearest points: that to the polygon is less by up to spacing²/(8·by).
    nearest, _ = cKDTree(loop).query(moved)
    step = float(np.linalg.norm(np.diff(loop, axis=0), axis=1).max())
    kept: Array = moved[nearest >= by - 0.5 * step * step / by - ON_TIME]
    return kept
