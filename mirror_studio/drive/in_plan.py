"""Lines in plan of bodies and of the ground that is seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]

FLAT_MM = 1.0  # in plan: a line
CUT_MM = 300.0  # longer pieces across the road are no edge of what is seen
ACROSS_MM = 1e-3  # along the road, of a piece that runs across it


def footprint(vertices: Array) -> Array:
    """Corners (n, 2) of the hull, in plan, of a body's vertices (m, 3); mm."""
    flat = vertices[:, :2]
    (x0, y0), (x1, y1) = flat.min(axis=0), flat.max(axis=0)
    if min(x1 - x0, y1 - y0) < FLAT_MM:  # it has no hull
        return np.array([[x0, y0], [x1, y1]])
    corners: Array = flat[ConvexHull(flat).vertices]
    return corners


def without_cuts(outline: Array) -> Array:
    """A closed outline (n, 2), mm, broken by rows of NaN where it runs across the road.

    There it only touches the next of its eye's outlines, or the plan ends.
    """
    closed = np.concatenate([outline, outline[:1]])
    step = np.abs(np.diff(closed, axis=0))
    cut = np.flatnonzero((step[:, 0] < ACROSS_MM) & (step[:, 1] > CUT_MM))
    broken: Array = np.insert(closed, cut + 1, np.nan, axis=0)
    return broken
