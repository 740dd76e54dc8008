"""A vehicle's body and the place where another mirror is mounted in, the body without its own mirror there out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from raytrace.scene.bodies import Body

Array = NDArray[np.float64]

JOINED_MM = 0.01  # corners that are nearer are one: a file gives a corner once for every normal
LARGEST_MM = 450.0  # a part of a door mirror's size; a door, a wing, a window are longer
NEAR_MM = 200.0  # from the place of the mirror under test: a door mirror within half a mirror's width of it is in its way


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """What of a body is left out: the names of its materials, how many parts and triangles, and its box, mm."""

    materials: tuple[str, ...]
    parts: int
    triangles: int
    low: Array
    high: Array

    def __str__(self) -> str:
        low, high = (", ".join(f"{1e-3 * v:.2f}" for v in end) for end in (self.low, self.high))
        return (f"the vehicle's own mirror ({', '.join(self.materials)}; {self.parts} parts, {self.triangles} triangles, from "
                f"({low}) to ({high}) m), for the mirror under test is mounted there")


def without_door_mirror(body: Body, place_mm: Array) -> tuple[Body, LeftOut | None]:
    """The body without the parts that stand where a mirror is mounted, and what these were; None where there are none.

    A part is what hangs together by its triangles. Those of a door mirror's size come off whose box is within NEAR_MM of the
    place (3,), and then those of that size whose boxes touch one that has: housing, glass and stalk. A mirror that is of one
    piece with its door stays.
    """
    if len(body.faces) == 0:
        return body, None
    part = _parts(body)
    count = int(part.max()) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, part, body.vertices)
    np.maximum.at(high, part, body.vertices)
    small = (high - low).max(axis=1) <= LARGEST_MM
    apart = np.linalg.norm(np.maximum(np.maximum(low - place_mm, place_mm - high), 0.0), axis=1)
    off = small & (apart <= NEAR_MM)
    while True:
        touching = small & ~off & np.array([bool(((low[off] <= high[k]) & (low[k] <= high[off])).all(axis=1).any())
                                            for k in range(count)])
        if not touching.any():
            break
        off |= touching
    if not off.any():
        return body, None
    gone = off[part[body.faces[:, 0]]]
    if gone.all():
        return body, None  # a body of that size is no vehicle with a mirror
    names = tuple(dict.fromkeys(body.materials[k].name or "unnamed" for k in body.material[gone]))
    left = LeftOut(names, int(off.sum()), int(gone.sum()), low[off].min(axis=0), high[off].max(axis=0))
    kept = ~off[part]
    number = np.cumsum(kept) - 1
    return replace(body, vertices=body.vertices[kept], normals=body.normals[kept], uv=body.uv[kept], sky=body.sky[kept],
                   faces=number[body.faces[~gone]].astype(np.int32), material=body.material[~gone]), left


def _parts(body: Body) -> NDArray[np.intp]:
    """The number of the part that each vertex belongs to, (n,)."""
    _, corner = np.unique(np.round(body.vertices / JOINED_MM).astype(np.int64), axis=0, return_inverse=True)
    corner = corner.ravel()
    a, b, c = corner[body.faces].T
    count = int(corner.max()) + 1
    graph = coo_array((np.ones(2 * len(a), dtype=np.int8), (np.concatenate([a, b]), np.concatenate([b, c]))),
                      shape=(count, count))
    parts: NDArray[np.intp] = connected_components(graph, directed=False)[1][corner].astype(np.intp)
    return parts
