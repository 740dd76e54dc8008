"""The compiled part of `raytrace.visibility.sign_changes`: where sampled functions change their sign, or may do so twice."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@njit(cache=True, error_model="numpy", _nrt=False)
def _twice(x0, x1, x2, y0, y1, y2, near_zero, beside_cell):  # type: ignore[no-untyped-def]
    """1 where a function may cross 0 twice between its first two samples, 2 between the last two, 3 for both, 0 for neither."""
    left, right = (y1 - y0) / (x1 - x0), (y2 - y1) / (x2 - x1)
    bend = (right - left) / (x2 - x0)
    top = 0.5 * (x0 + x1) - left / (2.0 * bend)
    least = y1 + (top - x1) * (left + bend * (top - x0))
    room = near_zero * (max(y0, max(y1, y2)) - min(y0, min(y1, y2)))
    found = 0
    for k in range(2):
        a, b, before, after = (x0, x1, y0, y1) if k == 0 else (x1, x2, y1, y2)
        wide, sign = beside_cell * (b - a), np.sign(before)
        if (before > 0.0) == (after > 0.0) and sign * bend > 0.0 and top > a - wide and top < b + wide and sign * least <= room:
            found += k + 1
    return found


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def may_cross(at, values, near_zero, beside_cell, found):  # type: ignore[no-untyped-def]
    """`sign_changes.may_cross` of values (3, m, n) at (3, n): found (2, m, n)."""
    for m in range(values.shape[1]):
        for n in range(values.shape[2]):
            which = _twice(at[0, n], at[1, n], at[2, n], values[0, m, n], values[1, m, n], values[2, m, n], near_zero,
                           beside_cell)
            found[0, m, n], found[1, m, n] = which & 1 != 0, which & 2 != 0


@njit(cache=True, nogil=True, error_model="numpy")
def _along(values, vertices, following, near_zero, beside_cell, before, length, crossed, turned):  # type: ignore[no-untyped-def]
    for n in range(values.size):
        k = following[n]
        before[k] = n
        length[n] = np.hypot(vertices[k, 0] - vertices[n, 0], vertices[k, 1] - vertices[n, 1])
        crossed[n], turned[n] = (values[n] > 0.0) != (values[k] > 0.0), False
    for n in range(values.size):
        p, k = before[n], following[n]
        which = _twice(-length[p], 0.0, length[n], values[p], values[n], values[k], near_zero, beside_cell)
        turned[p] |= which & 1 != 0
        turned[n] |= which & 2 != 0


def along_loops(values: Array, vertices: Array, following: Index, near_zero: float, beside_cell: float) -> tuple[Index, Index]:
    """Find where a function changes its sign along closed loops, and where it may do so twice.

    Parameters
    ----------
    values : (n,), at the loops' vertices.   vertices : (n, 2), of these.   following : (n,), the next vertex of each.
    near_zero, beside_cell : see `raytrace.visibility.sign_changes`.

    Returns
    -------
    After which vertices it changes its sign, and after which it may do so twice, rising.
    """
    n = len(values)
    crossed, turned = np.empty(n, dtype=np.bool_), np.empty(n, dtype=np.bool_)
    _along(values, vertices, following, near_zero, beside_cell, np.empty(n, dtype=np.intp), np.empty(n), crossed, turned)
    return np.flatnonzero(crossed), np.flatnonzero(turned)
