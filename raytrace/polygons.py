"""Polygons in space in, triangles between their own corners out: fans where they are convex, ears cut off where they are not.

Cut here and not by an earcut library, which leaves out corners on straight sides: the neighbour's facets would then meet a
side where this one has no corner, and normals could not be interpolated across it.
Source: G. H. Meisters, Polygons have ears, 1975: every simple polygon of more than three corners has two ears.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Twice a triangle's area, of the square of the polygon's size, below which its corners lie on one line: what projecting a
# plane polygon onto its plane in float64 leaves of a straight side, a hundred times over.
STRAIGHT = 1e-13
# By how much of it the triangles' areas may sum to more than the polygon's: beyond this its outline crosses itself.
CROSSED = 1e-9
# Cosine between a polygon's vector area and the normal of its least-squares plane below which the plane says nothing.
MIN_ALIKE = 0.5


class Triangles(NamedTuple):
    """What polygons were cut into.

    Attributes
    ----------
    corners : (m, 3), rows of the polygons' corner list.
    polygon : (m,), which polygon each triangle is cut from.
    crossed : (c,), the polygons whose outline crosses itself, for which no cut is right.
    """

    corners: Integers
    polygon: Integers
    crossed: Integers


def triangulated(points: Array, starts: Integers) -> Triangles:
    """Cut polygons into triangles that cover them and nothing else.

    Corners on straight sides stay corners. A polygon that is not plane is cut in its projection onto its least-squares plane;
    a hole is an outline that goes in and comes back along a seam. What has fewer than three corners gives no triangle.

    Parameters
    ----------
    points : (k, 3), the corners of all polygons, one after the other.
    starts : (p + 1,), where each polygon's begin, and their end.

    Returns
    -------
    Triangles

    References
    ----------
    G. H. Meisters, Polygons have ears, 1975: every simple polygon of more than three corners has two ears.
    """
    counts = np.diff(starts)
    if (counts == 3).all():
        return Triangles(np.arange(len(points)).reshape(-1, 3), np.arange(len(counts)), np.zeros(0, dtype=np.int64))
    convex, normals = _convex(points, starts)
    fan = np.flatnonzero(convex & (counts >= 3))
    cut = np.flatnonzero(~convex & (counts > 3))
    fans = counts[fan] - 2
    first = np.repeat(starts[fan], fans)
    inner = np.arange(int(fans.sum())) - np.repeat(np.cumsum(fans) - fans, fans) + 1
    corners, polygon = np.stack([first, first + inner, first + inner + 1], axis=1), np.repeat(fan, fans)
    if len(cut) == 0:
        return Triangles(corners, polygon, np.zeros(0, dtype=np.int64))
    ears = np.empty((int((counts[cut] - 2).sum()), 3), dtype=np.int64)
    crossed = np.zeros(len(cut), dtype=np.bool_)
    at = np.concatenate([[0], np.cumsum(counts[cut] - 2)])
    for k, p in enumerate(cut):
        flat = _flattened(points[starts[p]:starts[p + 1]], normals[p])
        crossed[k] = not _cut_ears(flat, ears[at[k]:at[k + 1]])
        ears[at[k]:at[k + 1]] += starts[p]
    polygon = np.concatenate([polygon, np.repeat(cut, counts[cut] - 2)])
    order = np.argsort(polygon, kind="stable")
    return Triangles(np.concatenate([corners, ears])[order], polygon[order], cut[crossed])


def _convex(points: Array, starts: Integers) -> tuple[NDArray[np.bool_], Array]:
    """Which polygons a fan from the first corner covers, and twice the vector area of each, (p, 3).

    Triangles, and those that turn one way, with no straight angle beside that corner.
    """
    counts = np.diff(starts)
    of = np.repeat(np.arange(len(counts)), counts)
    if len(points) == 0:
        return counts == 3, np.zeros((len(counts), 3))
    first, last = starts[:-1][of], starts[1:][of] - 1
    here = np.arange(len(points))
    after, before = np.where(here == last, first, here + 1), np.where(here == first, last, here - 1)
    from_first = points - points[first]
    fan = np.cross(from_first, points[after] - points[first])  # 0 at the first and the last corner
    area = np.zeros((len(counts), 3))
    np.add.at(area, of, fan)
    size = np.zeros(len(counts))
    np.maximum.at(size, of, np.einsum("ij,ij->i", from_first, from_first))
    limit = (STRAIGHT * size * np.linalg.norm(area, axis=1))[of]
    turn = np.einsum("ij,ij->i", np.cross(points - points[before], points[after] - points), area[of])
    spread = np.einsum("ij,ij->i", fan, area[of])
    middle = (here != first) & (here != last)
    bad = (turn < -limit) | (middle & ~(spread > limit)) | ~np.isfinite(turn)
    return (np.bincount(of[bad], minlength=len(counts)) == 0) | (counts == 3), area


def _flattened(points: Array, area: Array) -> Array:
    """The corners (n, 2) in the polygon's plane, counter-clockwise, of size 1 about 0; `area` along its vector area."""
    centred = points - points.mean(axis=0)
    largest = np.abs(centred).max()
    size, length = (largest if np.isfinite(largest) and largest > 0.0 else 1.0), np.linalg.norm(area)
    centred = np.nan_to_num(centred / size)
    directions = np.linalg.eigh(centred.T @ centred)[1]
    normal = directions[:, 0]
    if length > 0.0 and np.isfinite(length):
        alike = float(normal @ area) / length
        normal = area / length if abs(alike) < MIN_ALIKE else normal * np.sign(alike)
    axis = int(np.argmax(np.abs(normal)))
    if abs(normal[axis]) > 1.0 - 1e-12:  # in a plane of the axes nothing is rounded
        others = ((axis + 1) % 3, (axis + 2) % 3)
        flat = centred[:, others]
        return np.ascontiguousarray(flat if normal[axis] > 0.0 else flat[:, ::-1])
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    return np.ascontiguousarray(np.stack([centred @ across, centred @ np.cross(normal, across)], axis=1))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]  # numba's are
def _turn(points: Array, a: int, b: int, c: int) -> float:
    """Twice the signed area of a triangle."""
    return float((points[b, 0] - points[a, 0]) * (points[c, 1] - points[a, 1])
                 - (points[b, 1] - points[a, 1]) * (points[c, 0] - points[a, 0]))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _same(points: Array, a: int, b: int) -> bool:
    return bool(points[a, 0] == points[b, 0] and points[a, 1] == points[b, 1])


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _empty(points: Array, after: Integers, a: int, b: int, c: int, straight: float) -> bool:
    """Whether no other corner that is left lies in the triangle or on its sides.

    Those at the places of its own corners do not count: there a seam comes back.
    """
    k = after[c]
    while k != a:
        inside = _turn(points, a, b, k) >= -straight and _turn(points, b, c, k) >= -straight \
            and _turn(points, c, a, k) >= -straight
        if inside and not (_same(points, k, a) or _same(points, k, b) or _same(points, k, c)):
            return False
        k = after[k]
    return True


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _cut_ears(points: Array, out: Integers) -> bool:
    """Cut a polygon (n, 2) into n − 2 triangles; whether they cover it: their areas sum to its own."""
    n = points.shape[0]
    after, before = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    area = 0.0
    for k in range(n):
        after[k], before[k] = (k + 1) % n, (k - 1) % n
        area += _turn(points, 0, k, (k + 1) % n)
    left, at, covered, tried, b = n, 0, 0.0, 0, 0
    straight = STRAIGHT
    while left > 3:
        a, c = before[b], after[b]
        size = _turn(points, a, b, c)
        if tried > left:  # no ear left: corners on one line, or an outline that crosses itself
            ear = size >= -straight or tried > 2 * left
        else:
            repeated = _same(points, b, c) or _same(points, a, b)
            ear = repeated or (size > straight and _empty(points, after, a, b, c, straight))
        if not ear:
            b, tried = c, tried + 1
            continue
        out[at, 0], out[at, 1], out[at, 2] = a, b, c
        covered += abs(size)
        at, left, tried = at + 1, left - 1, 0
        after[a], before[c] = c, a
        b = c  # not the same corner again: long fans of slivers would come of it
    out[at, 0], out[at, 1], out[at, 2] = before[b], b, after[b]
    covered += abs(_turn(points, before[b], b, after[b]))
    return bool(abs(covered - area) <= CROSSED * max(abs(area), straight))
