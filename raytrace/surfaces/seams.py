"""Faces that a file divides joined to those that they were drawn as: what reflects is the mirror, however it was divided."""

from __future__ import annotations

from dataclasses import fields, replace
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.quadric import Quadric
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.quadric import QuadricFace

Array = NDArray[np.float64]

SAME = 1e-9  # of the loops' size in (u, v): a seam's two sides are one curve but for the rounding of the file


def without_seams(faces: list[BSplineFace | QuadricFace]) -> tuple[BSplineFace | QuadricFace, ...]:
    """The faces, with those that lie on one surface and meet along a curve as one, bounded by what is left of their loops.

    Two faces are joined where they have the same surface and the same side of it, and chords of the one's loops are those of
    the other's, the other way round. Faces that only touch, overlap, or lie apart stay as they are.
    """
    sheets: dict[tuple[object, ...], list[tuple[int, BSplineFace | QuadricFace]]] = {}
    for number, face in enumerate(faces):
        done = sheets.setdefault(_sheet(face), [])
        joined = face
        k = 0
        while k < len(done):
            loops = _joined_loops(done[k][1].loops, joined.loops)
            if loops is None:
                k += 1
            else:
                done.pop(k)
                joined = replace(joined, loops=loops)
                k = 0
        done.append((number, joined))
    return tuple(face for _, face in sorted((one for done in sheets.values() for one in done), key=itemgetter(0)))


def _sheet(face: BSplineFace | QuadricFace) -> tuple[object, ...]:
    """What is equal for two faces that are parts of one surface and reflect on the same side of it: its numbers, and which."""
    surface: BSplineSurface | Quadric = face.surface if isinstance(face, BSplineFace) else face.quadric
    numbers = (getattr(surface, field.name) for field in fields(surface))
    return (type(surface), face.sign, face.one_sided,
            *((one.shape, (one + 0.0).tobytes()) if isinstance(one, np.ndarray) else one for one in numbers))  # −0 is 0


def _joined_loops(one: tuple[Array, ...], other: tuple[Array, ...]) -> tuple[Array, ...] | None:
    """The loops round two faces without the chords that both have; None where they have none, or the rest does not close."""
    points = np.concatenate([*one, *other])
    size = float(np.ptp(points, axis=0).max())
    (low, high), (low_, high_) = ((np.min(part, axis=0), np.max(part, axis=0)) for part in map(np.concatenate, (one, other)))
    if (low > high_ + SAME * size).any() or (low_ > high + SAME * size).any():
        return None
    names: dict[tuple[int, int], int] = {}
    number = np.array([_name(names, point) for point in np.rint(points / (SAME * size)).astype(np.int64).tolist()])
    place = {int(n): points[k] for k, n in reversed(list(enumerate(number)))}
    ends: dict[int, list[int]] = {}
    sides, first = [], 0
    for loops in (one, other):
        chords = set()
        for loop in loops:
            these = number[first:first + len(loop)]
            chords |= {(int(a), int(b)) for a, b in zip(these, np.roll(these, -1), strict=True) if a != b}
            first += len(loop)
        sides.append(chords)
    shared = {(a, b) for a, b in sides[0] if (b, a) in sides[1]}
    if not shared:
        return None
    left = (sides[0] - shared) | (sides[1] - {(b, a) for a, b in shared})
    for a, b in left:
        ends.setdefault(a, []).append(b)
    if any(len(after) != 1 for after in ends.values()):
        return None
    found = []
    while ends:
        start = min(ends)
        ring, here = [start], ends.pop(start)[0]
        while here != start:
            if here not in ends:
                return None
            ring.append(here)
            here = ends.pop(here)[0]
        found.append(np.array([place[n] for n in ring]))
    return tuple(found) if found else None


def _name(names: dict[tuple[int, int], int], cell: list[int]) -> int:
    """One number for points in the same cell of a grid, or in neighbouring ones."""
    u, v = cell
    for beside in ((u + i, v + j) for i in (0, -1, 1) for j in (0, -1, 1)):
        if beside in names:
            return names[beside]
    return names.setdefault((u, v), len(names))
