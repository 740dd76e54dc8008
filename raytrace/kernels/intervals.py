"""The compiled sweep over the ends of several sets of intervals."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def _swept(row, at, of, order, wanted, depth, rows, lows, highs):  # type: ignore[no-untyped-def]
    count = flags = 0
    for k in range(order.size - 1):
        here, after = order[k], order[k + 1]
        which = of[here] // 2
        depth[which] += 1 if of[here] % 2 == 0 else -1
        flags = flags | (1 << which) if depth[which] > 0 else flags & ~(1 << which)
        if wanted[flags] and row[after] == row[here] and at[after] > at[here]:
            if count > 0 and rows[count - 1] == row[here] and highs[count - 1] == at[here]:
                highs[count - 1] = at[after]
            else:
                rows[count], lows[count], highs[count] = row[here], at[here], at[after]
                count += 1
    return count


def swept(row: Index, at: Array, of: Index, order: Index, wanted: Mask) -> tuple[Index, Array, Array]:
    """Find the intervals on numbered rows over which a combination of sets is wanted; those that touch become one.

    Parameters
    ----------
    row, at : (m,), the ends of all intervals.   of : (m,), 2k for the low and 2k + 1 for the high ends of set k.
    order : (m,), by row and place.   wanted : (2^sets,), of each combination, bit k for set k.

    Returns
    -------
    Their rows, and their low and high ends.
    """
    m = len(row)
    rows, lows, highs = np.empty(m, dtype=np.intp), np.empty(m), np.empty(m)
    count = _swept(row, at, of, order, wanted, np.zeros(64, dtype=np.intp), rows, lows, highs)
    return rows[:count], lows[:count], highs[:count]
