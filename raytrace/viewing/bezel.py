"""A mirror's outline in, the part that its bezel leaves to see, and the housing around it, out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from mirror_cad.mesh import SurfaceMesh
from raytrace.errors import TraceError
from raytrace.reflector import Reflector, TrimmedSurface

Array = NDArray[np.float64]

RIM_MM, PROUD_MM = 13.0, 4.0  # the housing's rim: how wide, and how far before the glass
DEPTH_MM, NARROWER = 75.0, 0.72  # the housing behind it: how deep, and how wide its back is beside its front
RIM_STEPS, SHELL_STEPS = 6, 8
AROUND = 256  # vertices around the housing
SPACING_MM = 0.05  # of the outline's points while it is moved inwards: the corners of what is left are right to this
NEAR = 5e-3  # of the mirror's size: what is one edge in plan
OFF_GRID = 0.2718  # of a cell: a mirror's ends, and what divides it evenly, would lie on the border of two
CORNER = 0.93  # of y beside x in the direction of the corner that a hull begins at: no direction of a likely edge
ON_TIME = 1e-6  # mm: a point that was moved by the margin is that far from the outline, up to rounding


def visible_aperture(reflector: Reflector, over_mm: float) -> Reflector:
    """The reflector as far as a bezel leaves it to see that reaches `over_mm` over its edge, all around, in (x, y).

    The outline is moved inwards: its points along their normals, less those that come nearer to another part of it.
    Raises: TraceError where the bezel covers all, or for a reflector whose outline is not in (x, y).
    """
    if over_mm == 0.0:
        return reflector
    only = reflector.only
    if only is None or only.height_field is None or len(only.loops) != 1:
        raise TraceError(f"a bezel over {over_mm:g} mm of the edge needs a mirror that is one B-spline with u = x, v = y and "
                         "one outline, as this program makes them: leave bezel_over_m at 0 for this file")
    dense = _resampled(only.loops[0], SPACING_MM)
    inner = _moved_inwards(dense, over_mm)
    if len(inner) < 3:
        raise TraceError(f"a bezel over {over_mm:g} mm of the edge leaves nothing of the mirror to see")
    cut = replace(only, loops=(inner,))
    glass = reflector.glass
    if glass is not None and isinstance(glass.front, TrimmedSurface):
        glass = replace(glass, front=replace(glass.front, loops=(inner,)))
    return replace(reflector, surfaces=(cut,), glass=glass)


def housing(reflector: Reflector) -> SurfaceMesh:
    """A closed shell around a mirror, in mirror coordinates: a rounded rim before its edge, and a back behind it.

    Only how it looks matters: it begins at the reflector's own edge (`edge_loop`).
    """
    edge = _edge(reflector)
    centre = edge.mean(axis=0)
    outward = _outward(edge[:, :2])
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
    """Points (n, 3) around what reflects: the rim of a single face where that is one curve around all of it, and else the hull
    in (x, y), as high as what reflects is beside it: of a solid, its front."""
    points = reflector.outline()
    if len(reflector.surfaces) == 1 and len(reflector.surfaces[0].rim) == 1:
        rim = reflector.surfaces[0].rim[0].points
        if np.array_equal(np.ptp(rim[:, :2], axis=0), np.ptp(points[:, :2], axis=0)):
            return rim
    hull: Array = points[ConvexHull(points[:, :2]).vertices]
    # Where the hull begins, and which of the points on a straight side it has, hangs on rounding: from a corner on, evenly.
    hull = np.roll(hull, -int(np.argmax(hull[:, 0] - CORNER * hull[:, 1])), axis=0)
    hull = _resampled(hull, None)
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
    return _resampled(points, None)


def _resampled(loop: Array, spacing: float | None) -> Array:
    """Points on a closed polygon (n, d), evenly along it: every `spacing`, or AROUND of them."""
    closed = np.concatenate([loop, loop[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    count = AROUND if spacing is None else max(AROUND, int(np.ceil(along[-1] / spacing)))
    at = np.linspace(0.0, along[-1], count, endpoint=False)
    return np.stack([np.interp(at, along, closed[:, c]) for c in range(loop.shape[1])], axis=1)


def _outward(loop: Array) -> Array:
    """Unit normals (n, 2) of a closed, counter-clockwise polygon at its points."""
    along = np.roll(loop, -1, axis=0) - np.roll(loop, 1, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([along[:, 1], -along[:, 0]], axis=1)


def _moved_inwards(loop: Array, by: float) -> Array:
    """The points of a closed polygon, moved inwards, that are no nearer to it than that; (m, 2)."""
    x, y = loop[:, 0], loop[:, 1]
    counter = np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) > 0.0
    moved = loop - (by if counter else -by) * _outward(loop)
    # The distance to the nearest points: that to the polygon is less by up to spacing²/(8·by).
    nearest, _ = cKDTree(loop).query(moved)
    step = float(np.linalg.norm(np.diff(loop, axis=0), axis=1).max())
    kept: Array = moved[nearest >= by - 0.5 * step * step / by - ON_TIME]
    return kept
