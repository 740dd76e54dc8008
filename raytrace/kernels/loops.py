"""The closed loops that a list of followers is made of."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

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
