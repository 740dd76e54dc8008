"""The closed loops that a list of followers is made of, and what rays from all round them do together."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def _loops(following, done, order, ends):  # type: ignore[no-untyped-def]
    at = count = 0
    for start in range(following.size):
        if done[start]:
            continue
        k = start
        while not done[k]:
            done[k], order[at] = True, k
            k = following[k]
            at += 1
        ends[count] = at
        count += 1
    return count


def loops(following: Index) -> tuple[Index, Index]:
    """Order vertices loop by loop, each from its lowest number, the loops by theirs.

    Parameters
    ----------
    following : (n,), a permutation: which vertex comes after each.

    Returns
    -------
    The vertices (n,), and where all loops but the last one end in them.
    """
    n = len(following)
    order, ends = np.empty(n, dtype=np.intp), np.empty(n, dtype=np.intp)
    count = _loops(following, np.zeros(n, dtype=np.bool_), order, ends)
    return order, ends[:max(count - 1, 0)]


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def _extent(on_plane, points, centre, low, high):  # type: ignore[no-untyped-def]
    for c in range(2):
        centre[c], low[c], high[c] = 0.0, np.inf, -np.inf
    for n in range(points.shape[0]):
        for c in range(2):
            centre[c] += on_plane[n, c]
            low[c], high[c] = min(low[c], points[n, c]), max(high[c], points[n, c])
    for c in range(2):
        centre[c] /= points.shape[0]


def extent(on_plane: Array, points: Array) -> tuple[Array, Array, Array]:
    """The mean (2,) of places (n, 2), and from where to where points (n, 3) reach in x and y, (2,) each."""
    found = np.empty((3, 2))
    _extent(on_plane, points, *found)
    return found[0], found[1], found[2]


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def least_along(directions: Array, direction: Array) -> float:
    """The least of the products of directions (n, 3) with another, (3,)."""
    least = np.inf
    for n in range(directions.shape[0]):
        least = min(least, directions[n, 0] * direction[0] + directions[n, 1] * direction[1] + directions[n, 2] * direction[2])
    return least
