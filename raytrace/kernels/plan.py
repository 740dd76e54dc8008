"""The compiled part of `raytrace.visibility.plan`: between which vertices of an edge the rays sweep over which lines."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@njit(cache=True, error_model="numpy", _nrt=False)
def _not_below(rising, value):  # type: ignore[no-untyped-def]
    """How many of rising numbers are below a value."""
    low, high = 0, rising.size
    while low < high:
        middle = (low + high) // 2
        if rising[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True, error_model="numpy")
def _swept(points, directions, following, axis, height, values, least_height, wrap, angle, wanted, first, count):  # type: ignore[no-untyped-def]
    n, m = angle.size, values.size
    near = above = 0.0
    for k in range(n):
        near += points[k, axis] / n
        above += abs(points[k, 2] - height) / n
    above = max(above, least_height)
    for j in range(m):
        wanted[j] = np.arctan2(above, values[m - 1 - j] - near)
    total = 0
    if m == 1:  # on which side of the line each ray passes says as much, and takes no arctangent
        along, across = values[0] - near, above
        for k in range(n):
            over = (near - points[k, axis]) * directions[k, 2] - (height - points[k, 2]) * directions[k, axis]
            angle[k] = -above * directions[k, 2] * along - over * across
        for k in range(n):
            p = following[k]
            first[k], count[k] = 0, 0
            if (angle[k] > 0.0) != (angle[p] > 0.0):
                turns = 0.0
                for v, sign in ((k, -1.0), (p, 1.0)):
                    over = (near - points[v, axis]) * directions[v, 2] - (height - points[v, 2]) * directions[v, axis]
                    turns += sign * np.arctan2(angle[v], over * along - above * directions[v, 2] * across)
                if abs(turns) < wrap:
                    count[k] = 1
                    total += 1
        return total
    for k in range(n):
        over = (near - points[k, axis]) * directions[k, 2] - (height - points[k, 2]) * directions[k, axis]
        angle[k] = np.arctan2(-above * directions[k, 2], over)
    for k in range(n):
        here, after = angle[k], angle[following[k]]
        first[k], count[k] = 0, 0
        if abs(after - here) < wrap and max(here, after) > wanted[0] and min(here, after) <= wanted[m - 1]:
            first[k] = _not_below(wanted, min(here, after))
            count[k] = _not_below(wanted, max(here, after)) - first[k]
            total += count[k]
    return total


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def _listed(first, count, lines, k, row):  # type: ignore[no-untyped-def]
    at = 0
    for n in range(first.size):
        for j in range(count[n]):
            k[at], row[at] = n, lines - 1 - (first[n] + j)
            at += 1


def swept_lines(points: Array, directions: Array, following: Index, axis: int, height_mm: float, values: Array,
                least_height_mm: float, wrap: float) -> tuple[Index, Index]:
    """After which vertices (m,) of an edge, and which of the lines, rays meet between that vertex and the next.

    By the angle of (N − r·D, l·D) of `raytrace.visibility.plan`, with the mean of the mirror's points for r, and that of their
    heights above the plane for l.

    Parameters
    ----------
    points, directions : (n, 3), mm, rays that leave the edge.   following : (n,), the next vertex of each.
    axis, height_mm, values : lines X or Y = value in the plane Z = height_mm, mm; values rise.
    least_height_mm : for l.   wrap : radians, by which no ray turns between neighbours.
    """
    n = len(points)
    first, count = np.empty(n, dtype=np.intp), np.empty(n, dtype=np.intp)
    total = 0 if len(values) == 0 else _swept(points, directions, following, axis, height_mm, values, least_height_mm, wrap,
                                              np.empty(n), np.empty(len(values)), first, count)
    k, row = np.empty(total, dtype=np.intp), np.empty(total, dtype=np.intp)
    if total:
        _listed(first, count, len(values), k, row)
    return k, row
