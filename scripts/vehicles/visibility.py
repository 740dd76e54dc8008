"""Triangles in; how much of the sky each vertex sees past them, and each place of the ground around, out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.embree import TriangleScene

Array = NDArray[np.float64]
Index = NDArray[np.int64]

STRATA = 16  # by STRATA directions a place
START = 1.0  # mm above the surface, so that a ray does not meet its own triangle
INSET, MOST_INSET = 0.1, 20.0  # of the way to the middle of a vertex's triangles, mm: an edge between walls lies in both
BATCH = 4_096  # places at once: some million rays
SEED = 2014
STEP = 150.0  # mm, of the ground's grid
LEAST_MARGIN, MOST_MARGIN = 1_200.0, 4_000.0  # mm that it reaches beyond the footprint: the least and the body's height
FULL = 0.5  # of the margin: from there on the shadow is faded out


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Share of the sky (nx, ny) that the ground sees x0 + i·step behind the front end and y0 + j·step to the right [mm]."""

    x0: float
    y0: float
    step: float
    sky: Array


def vertex_shares(scene: TriangleScene, points: Array, normals: Array, faces: Index) -> Array:
    """`sky_shares` (n,) of vertices, taken a little way into their triangles."""
    count = np.bincount(faces.ravel(), minlength=len(points))
    middles = np.repeat(points[faces].mean(axis=1), 3, axis=0)
    towards = np.column_stack([np.bincount(faces.ravel(), middles[:, k], len(points)) for k in range(3)])
    inward = towards / np.maximum(count, 1)[:, None] - points
    inward *= np.minimum(INSET, MOST_INSET / np.maximum(np.linalg.norm(inward, axis=1), 1e-9))[:, None]
    # Not below the tangent plane, or a convex body would be entered.
    inward -= np.minimum((inward * normals).sum(axis=1), 0.0)[:, None] * normals
    return sky_shares(scene, points + inward, normals)


def sky_shares(scene: TriangleScene, points: Array, normals: Array) -> Array:
    """V (n,): the share of the hemisphere about each normal, weighted with the cosine, that leaves past the scene's triangles.

    STRATA² stratified directions, turned about the normal by a random angle a place (fixed seed). The ground is no
    triangle: a direction that goes down counts as free. Places and normals in mm and unit length, (n, 3).
    """
    cells = (np.arange(STRATA) + 0.5) / STRATA
    radius, angle = (grid.ravel() for grid in np.meshgrid(np.sqrt(cells), 2.0 * np.pi * cells, indexing="ij"))
    height = np.sqrt(1.0 - radius**2)
    turns = np.random.default_rng(SEED).uniform(0.0, 2.0 * np.pi, len(points))
    shares = np.empty(len(points))
    for start in range(0, len(points), BATCH):
        part = slice(start, start + BATCH)
        n = normals[part]
        t, b = _frames(n)
        phi = angle[None, :] + turns[part, None]
        rays = ((radius * np.cos(phi))[..., None] * t[:, None] + (radius * np.sin(phi))[..., None] * b[:, None]
                + height[None, :, None] * n[:, None])
        rays /= np.linalg.norm(rays, axis=2)[..., None]
        origins = np.repeat(points[part] + START * n, STRATA**2, axis=0)
        shares[part] = 1.0 - scene.occluded(origins, rays.reshape(-1, 3)).reshape(-1, STRATA**2).mean(axis=1)
    return shares


def _frames(n: Array) -> tuple[Array, Array]:
    """Two unit vectors square to each unit vector and to one another.

    Source: Duff et al., Building an orthonormal basis, revisited, JCGT 6(1), 2017.
    """
    x, y, z = n.T
    sign = np.where(z < 0.0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    return (np.column_stack([1.0 + sign * x * x * a, sign * b, -sign * x]),
            np.column_stack([b, sign + y * y * a, -y]))


def ground_map(scene: TriangleScene, low: Array, high: Array) -> Ground:
    """The ground's share of the sky about a body whose bounding box is low … high (3,) [mm].

    Under the body and about it it is what `sky_shares` gives for the ground; in the outer half of the margin what is missing
    to 1 is faded out, since a scene takes 1 beyond the grid. A place that something stands on is as dark as those beside it.
    """
    margin = min(LEAST_MARGIN + float(high[2]), MOST_MARGIN)
    counts = [int(np.ceil((high[k] - low[k] + 2.0 * margin) / STEP)) + 1 for k in (0, 1)]
    origin = [0.5 * (low[k] + high[k] - STEP * (counts[k] - 1)) for k in (0, 1)]
    x, y = np.meshgrid(*(origin[k] + STEP * np.arange(counts[k]) for k in (0, 1)), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    shares = sky_shares(scene, points, np.tile([0.0, 0.0, 1.0], (len(points), 1))).reshape(x.shape)
    beyond = np.maximum(np.maximum(np.maximum(low[0] - x, x - high[0]), np.maximum(low[1] - y, y - high[1])), 0.0)
    t = np.clip((beyond / (margin - STEP) - FULL) / (1.0 - FULL), 0.0, 1.0)
    return Ground(origin[0], origin[1], STEP, 1.0 - (1.0 - _uncovered(shares)) * (1.0 - t * t * (3.0 - 2.0 * t)))


def _uncovered(shares: Array) -> Array:
    """The shares with the places under a foot, which see nothing, replaced by the mean of their neighbours that see some."""
    wide = np.pad(shares, 1)
    beside = np.stack([wide[1 + i:1 + i + shares.shape[0], 1 + j:1 + j + shares.shape[1]]
                       for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)])
    seeing = np.count_nonzero(beside, axis=0)
    return np.where((shares == 0.0) & (seeing > 0), beside.sum(axis=0) / np.maximum(seeing, 1), shares)
