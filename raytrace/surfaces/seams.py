"""Faces that a file divides joined to those that they were drawn as: what reflects is the mirror, however it was divided."""

from __future__ import annotations

from dataclasses import fields, replace

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
    done: list[BSplineFace | QuadricFace] = []
    for face in faces:
        joined = face
        k = 0
        while k < len(done):
            loops = _joined_loops(done[k].loops, joined.loops) if _same_sheet(done[k], joined) else None
            if loops is None:
                k += 1
            else:
                done.pop(k)
                joined = replace(joined, loops=loops)
                k = 0
        done.append(joined)
    return tuple(done)


def _same_sheet(one: BSplineFace | QuadricFace, other: BSplineFace | QuadricFace) -> bool:
    """Whether two faces are parts of one surface and reflect on the same side of it."""
    if one.sign != other.sign or one.one_sided != other.one_sided:
        return False
    if isinstance(one, BSplineFace) and isinstance(other, BSplineFace):
        return _same_record(one.surface, other.surface)
    if isinstance(one, QuadricFace) and isinstance(other, QuadricFace):
        return _same_record(one.quadric, other.quadric)
    return False


def _same_record(one: BSplineSurface | Quadric, other: BSplineSurface | Quadric) -> bool:
    """Whether two surfaces are equal in all their numbers."""
    if type(one) is not type(other):
        return False
    return all(_same_value(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))


def _same_value(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return bool(one is other or one == other)


def _joined_loops(one: tuple[Array, ...], other: tuple[Array, ...]) -> tuple[Array, ...] | None:
    """The loops round two faces without the chords that both have; None where they have none, or the rest does not close."""
    points = np.concatenate([*one, *other])
    size = float(np.ptp(points, axis=0).max())
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
