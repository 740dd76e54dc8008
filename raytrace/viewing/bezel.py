"""The part of a mirror's outline that its bezel leaves to see, and the housing around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from mirror_cad.mesh import SurfaceMesh
from raytrace.reflector import Reflector
from raytrace.surfaces.inset import outward_normals, resampled

Array = NDArray[np.float64]

RIM_MM, PROUD_MM = 13.0, 4.0  # the housing's rim: how wide, and how far before the glass
DEPTH_MM, NARROWER = 75.0, 0.72  # the housing behind it: how deep, and how wide its back is beside its front
RIM_STEPS, SHELL_STEPS = 6, 8
NEAR = 5e-3  # of the mirror's size: what is one edge in plan
OFF_GRID = 0.2718  # of a cell: a mirror's ends, and what divides it evenly, would lie on the border of two
CORNER = 0.93  # of y beside x in the direction of the corner that a hull begins at: no direction of a likely edge


def visible_aperture(reflector: Reflector, over_mm: float) -> Reflector:
    """Cut a reflector to what a bezel leaves of it to see.

    Parameters
    ----------
    reflector : the mirror, in its own coordinates.
    over_mm : how far the bezel reaches over its edge, mm, all around, in (x, y).

    Returns
    -------
    Reflector
        The same one for 0.

    Raises
    ------
    TraceError
        Where the bezel covers all, and for a reflector whose outline is not in (x, y).
    """
    return reflector if over_mm == 0.0 else replace(reflector, surface=reflector.surface.inset(over_mm))


def housing(reflector: Reflector, every: int = 1) -> SurfaceMesh:
    """Make a closed shell around a mirror: a rounded rim before its edge, and a back behind it.

    Only how it looks matters: it begins at the reflector's own edge (`edge_loop`).

    Parameters
    ----------
    reflector : the mirror, in its own coordinates.
    every : 1, or 2 for a quarter of the triangles, with every other point along the edge and across it.

    Returns
    -------
    SurfaceMesh
        In mirror coordinates, mm.
    """
    edge = _edge(reflector)[::every]
    centre = edge.mean(axis=0)
    outward = outward_normals(edge[:, :2])
    rings = []
    for step in np.linspace(0.0, 1.0, RIM_STEPS + 1):  # over the rim: a half ellipse from the glass to the outer side
        angle = np.pi * step
        ring = edge.copy()
        ring[:, :2] += 0.5 * RIM_MM * (1.0 - np.cos(angle)) * outward
        ring[:, 2] += PROUD_MM * np.sin(angle) + 0.3 * (1.0 - step)
        rings.append(ring)
    outer = rings[-1]
    for step in np.linspace(0.0, 1.0, SHELL_STEPS + 1)[1:]:  # and back along a quarter ellipse
        ring = outer.copy()
        ring[:, :2] = centre[:2] + (outer[:, :2] - centre[:2]) * (NARROWER + (1.0 - NARROWER) * np.cos(0.5 * np.pi * step))
        ring[:, 2] -= DEPTH_MM * np.sin(0.5 * np.pi * step)
        rings.append(ring)
    rings = rings[::every]
    back = rings[-1].mean(axis=0)
    n = len(edge)
    k = np.arange(n)
    after = (k + 1) % n
    faces = [np.concatenate([np.stack([i * n + k, (i + 1) * n + k, (i + 1) * n + after], axis=1),
                             np.stack([i * n + k, (i + 1) * n + after, i * n + after], axis=1)]) for i in range(len(rings) - 1)]
    last = (len(rings) - 1) * n
    faces.append(np.stack([last + k, np.full(n, len(rings) * n), last + after], axis=1))
    return SurfaceMesh(np.concatenate([*rings, back[None]]), np.concatenate(faces).astype(np.int32))


def edge_loop(reflector: Reflector) -> Array:
    """Find a closed line around what reflects.

    It is the rim of a single face where that is one curve around all of it. Else it is the hull in (x, y), as high as what
    reflects is beside it: of a solid, its front.

    Parameters
    ----------
    reflector : the mirror, in its own coordinates.

    Returns
    -------
    (n, 3), mm.
    """
    points = reflector.outline()
    if len(reflector.surface.rim) == 1:
        rim = reflector.surface.rim[0].points
        if np.array_equal(np.ptp(rim[:, :2], axis=0), np.ptp(points[:, :2], axis=0)):
            return rim
    hull: Array = points[ConvexHull(points[:, :2]).vertices]
    # Where the hull begins, and which of the points on a straight side it has, hangs on rounding: from a corner on, evenly.
    hull = np.roll(hull, -int(np.argmax(hull[:, 0] - CORNER * hull[:, 1])), axis=0)
    hull = resampled(hull, None)
    low = points[:, :2].min(axis=0)
    size = NEAR * float(np.ptp(points[:, :2], axis=0).max())
    cells = np.floor((points[:, :2] - low) / size + OFF_GRID).astype(np.intp) + 1
    highest = np.full(cells.max(axis=0) + 2, -np.inf)
    np.maximum.at(highest, tuple(cells.T), points[:, 2])
    i, j = (np.floor((hull[:, :2] - low) / size + OFF_GRID).astype(np.intp) + 1).T
    height = np.max([highest[i + di, j + dj] for di in (-1, 0, 1) for dj in (-1, 0, 1)], axis=0)
    near = np.flatnonzero(np.isfinite(height))  # a coarse mesh has vertices here and there: straight from one to the next
    hull[:, 2] = np.interp(np.arange(len(hull)), np.append(near, len(hull)), np.append(height[near], height[near[0]]))
    return hull


def _edge(reflector: Reflector) -> Array:
    """AROUND points (n, 3) of the edge, counter-clockwise as the driver sees it."""
    points = edge_loop(reflector)
    x, y = points[:, 0], points[:, 1]
    if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0.0:
        points = points[::-1]
    return resampled(points, None)
