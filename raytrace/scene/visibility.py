"""A body's triangles in, how much of its surroundings each of its places sees past itself out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from raytrace.embree import TriangleScene
from raytrace.parallel import RUN, parallel_for

Array = NDArray[np.float64]

SIDE = 8  # directions are stratified on so many cells a side: 64 a place, ±0.03 of the share
# Rays start this far off the surface, of the body's size: 1 mm of a car, whose panels overlap by less along their seams.
LIFT = 2e-4
INSET = 0.1  # of the way to the middle of a vertex's triangles: an edge between two walls lies in both
MAX_INSET_MM = 20.0
GRID_MM, COARSEST_MM, MAX_NODES = 150.0, 600.0, 40_000  # of contact shadows
MIN_MARGIN_MM, MAX_MARGIN_MM = 1200.0, 4000.0  # beyond the footprint


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """The share of the sky that level ground sees past a body standing on it: 1 beyond the grid.

    sky (nx, ny), at origin + i·along + j·across (X, Y), mm; along and across are orthogonal.
    """

    sky: Array
    origin: Array
    along: Array
    across: Array


def openness(scene: TriangleScene, points: Array, normals: Array, side: int = SIDE) -> Array:
    """Cosine-weighted share (n,) of the directions about each normal that leave without meeting a triangle.

    V = (1/π)·∫ visible(ω)·cos θ dω over the half space of the normal, side² stratified directions.
    """
    result = np.empty(len(points))

    def work(start: int, stop: int) -> None:
        origins, directions = np.empty((2, (stop - start) * side * side, 3))
        _cosine_rays(points[start:stop], normals[start:stop], start, side, origins, directions)
        result[start:stop] = 1.0 - scene.occluded(origins, directions).reshape(-1, side * side).mean(axis=1)

    parallel_for(work, len(points), RUN // (side * side))
    return result


def vertex_openness(scene: TriangleScene, vertices: Array, normals: Array, faces: NDArray[np.integer[Any]],
                    side: int = SIDE) -> Array:
    """`openness` of a body's vertices; vertices that no triangle names, and without a normal, have 1."""
    middles = vertices[faces].mean(axis=1)
    count = np.bincount(faces.ravel(), minlength=len(vertices))
    towards = np.stack([np.bincount(faces.ravel(), np.repeat(middles[:, c], 3), len(vertices)) for c in range(3)], axis=1)
    inward = towards / np.maximum(count, 1)[:, None] - vertices
    length = np.linalg.norm(inward, axis=1, keepdims=True)
    inward *= np.minimum(INSET, MAX_INSET_MM / np.maximum(length, 1e-9))
    # Not below the vertex's tangent plane, or a convex body would be entered.
    inward -= np.minimum(np.einsum("ij,ij->i", inward, normals), 0.0)[:, None] * normals
    lift = LIFT * float(np.ptp(vertices, axis=0).max())
    good = (count > 0) & (np.linalg.norm(normals, axis=1) > 0.5)
    result = np.ones(len(vertices))
    result[good] = openness(scene, (vertices + inward + lift * normals)[good], normals[good], side)
    return result


def contact(scene: TriangleScene, vertices: Array, side: int = SIDE) -> Contact | None:
    """The contact shadow of a body on the ground Z = 0, fading to nothing at the grid's border; None for a large body."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    margin = min(MIN_MARGIN_MM + max(float(high[2]), 0.0), MAX_MARGIN_MM)
    size = high[:2] - low[:2] + 2.0 * margin
    step = max(GRID_MM, float(np.sqrt(size[0] * size[1] / MAX_NODES)))
    if step > COARSEST_MM:
        return None
    nodes = np.ceil(size / step).astype(int) + 1
    start = 0.5 * (low + high)[:2] - 0.5 * step * (nodes - 1)
    x, y = (g.ravel() for g in np.meshgrid(*(start[k] + step * np.arange(nodes[k]) for k in range(2)), indexing="ij"))
    ground = np.stack([x, y, np.full_like(x, LIFT * float(np.ptp(vertices, axis=0).max()))], axis=1)
    share = openness(scene, ground, np.broadcast_to([0.0, 0.0, 1.0], ground.shape), side)
    share = _without_covered(share.reshape(nodes)).ravel()
    outside = np.maximum(np.maximum(low[:2] - ground[:, :2], ground[:, :2] - high[:2]), 0.0).max(axis=1) / margin
    fade = np.clip(2.0 - 2.0 * outside, 0.0, 1.0)
    share = 1.0 - (1.0 - share) * fade * fade * (3.0 - 2.0 * fade)
    return Contact(share.reshape(nodes), start, np.array([step, 0.0]), np.array([0.0, step]))


def _without_covered(share: Array) -> Array:
    """The grid with the places that the body stands on as dark as those beside them: between the two, its foot is the edge."""
    wide = np.pad(share, 1, constant_values=0.0)
    beside = np.stack([wide[1 + i:1 + i + share.shape[0], 1 + j:1 + j + share.shape[1]]
                       for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)])
    count = np.count_nonzero(beside, axis=0)
    mean = beside.sum(axis=0) / np.maximum(count, 1)
    result: Array = np.where((share == 0.0) & (count > 0), mean, share)
    return result


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba's are
def _cosine_rays(points: Array, normals: Array, number: int, side: int, origins: Array, directions: Array) -> None:
    """side² rays a point, uniform over the disc below the half sphere, each point's turned by the golden angle."""
    k = 0
    for n in range(points.shape[0]):
        nx, ny, nz = normals[n, 0], normals[n, 1], normals[n, 2]
        # Duff et al., Building an orthonormal basis, revisited (2017).
        sign = 1.0 if nz >= 0.0 else -1.0
        a = -1.0 / (sign + nz)
        b = nx * ny * a
        turn = 2.399963 * ((number + n) % 65_536)
        for i in range(side):
            for j in range(side):
                square = (i + (0.5 + 0.618034 * j) % 1.0) / side
                angle = turn + 2.0 * np.pi * (j + (0.5 + 0.618034 * i) % 1.0) / side
                radius, up = np.sqrt(square), np.sqrt(1.0 - square)
                p, q = radius * np.cos(angle), radius * np.sin(angle)
                x = p * (1.0 + sign * nx * nx * a) + q * b + up * nx
                y = p * sign * b + q * (sign + ny * ny * a) + up * ny
                z = -p * sign * nx - q * ny + up * nz
                length = np.sqrt(x * x + y * y + z * z)
                directions[k, 0], directions[k, 1], directions[k, 2] = x / length, y / length, z / length
                origins[k, 0], origins[k, 1], origins[k, 2] = points[n, 0], points[n, 1], points[n, 2]
                k += 1
