"""What is compiled of plans of intervals on parallel lines: their outlines, and the longest rectangle that lies in them."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@njit(cache=True, error_model="numpy", _nrt=False)
def _share(low, high, first, last, part, whole):  # type: ignore[no-untyped-def]
    """What one of the intervals first … last gets of another that they fill: to the middles between it and its neighbours."""
    a = low[whole] if part == first else 0.5 * (high[part - 1] + low[part])
    b = high[whole] if part == last else 0.5 * (high[part] + low[part + 1])
    return a, b


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def _outlines(row, low, high, values, first, last, follower, followers, polygon, of, at, ends):  # type: ignore[no-untyped-def]
    count = polygons = 0
    before, begin = row[0] - 2, 0  # the row before, and where its intervals begin
    here = 0
    while here < row.size:
        line, stop = row[here], here
        while stop < row.size and row[stop] == line:
            stop += 1
        beside = begin if before == line - 1 else here
        for j in range(beside, here):
            follower[j], followers[j] = -1, 0
        for k in range(here, stop):
            first[k], last[k] = 0, -1
            for j in range(beside, here):
                if low[j] < high[k] and high[j] > low[k]:
                    if last[k] < first[k]:
                        first[k] = j
                    if followers[j] == 0:
                        follower[j] = k
                    last[k] = j
                    followers[j] += 1
        for k in range(here, stop):
            j = first[k]
            if last[k] == j and followers[j] == 1:
                polygon[k] = polygon[j]
            else:
                polygon[k] = polygons
                polygons += 1
                if last[k] == j:  # one of several that one becomes: from its share of that one's end
                    of[count], at[count] = polygon[k], values[line - 1]
                    ends[count, 0], ends[count, 1] = _share(low, high, follower[j], follower[j] + followers[j] - 1, k, j)
                    count += 1
            if last[k] > j:  # several that become one: each to its share of that one's start
                for one in range(j, last[k] + 1):
                    of[count], at[count] = polygon[one], values[line]
                    ends[count, 0], ends[count, 1] = _share(low, high, j, last[k], one, k)
                    count += 1
            of[count], at[count], ends[count, 0], ends[count, 1] = polygon[k], values[line], low[k], high[k]
            count += 1
        before, begin, here = line, here, stop
    return count


def outlines(row: Index, low: Array, high: Array, values: Array) -> list[Array]:
    """`raytrace.visibility.plan.outlines` of intervals (m,) in rising order on rising rows, on lines (l,)."""
    m = len(row)
    if m == 0:
        return []
    of, at, ends = np.empty(3 * m, dtype=np.intp), np.empty(3 * m), np.empty((3 * m, 2))
    count = _outlines(row, low, high, values, *(np.empty(m, dtype=np.intp) for _ in range(5)), of, at, ends)
    order = np.argsort(of[:count], kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(of[order])) + 1)
    return [np.stack([np.concatenate([at[part], at[part[::-1]]]),
                      np.concatenate([ends[part, 0], ends[part[::-1], 1]])], axis=1) for part in parts if len(part) > 1]


@njit(cache=True, error_model="numpy", _nrt=False)
def _reach(spare, x, line, step):  # type: ignore[no-untyped-def]
    """Where beyond a line the spare width becomes 0, between it and the next; at it where that is not to be told."""
    beyond = min(max(line + step, 0), x.size - 1)
    if not (spare[line] < np.inf and -np.inf < spare[beyond] < 0.0):
        return x[line]
    return x[line] + spare[line] / (spare[line] - spare[beyond]) * (x[beyond] - x[line])


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def _longest(row, low, high, x, from_, to, starts, width, spare):  # type: ignore[no-untyped-def]
    longest = 0.0
    for start in starts:
        # By how much the best interval of each line is wider than the rectangle at its tighter end; the lane's edge is none.
        spare[:] = -np.inf
        for n in range(row.size):
            below = start - low[n] if low[n] > from_ else np.inf
            above = high[n] - (start + width) if high[n] < to else np.inf
            spare[row[n]] = max(spare[row[n]], min(below, above))
        k = 0
        while k < x.size:
            if spare[k] >= 0.0:
                begin = k
                while k + 1 < x.size and spare[k + 1] >= 0.0:
                    k += 1
                longest = max(longest, _reach(spare, x, k, 1) - _reach(spare, x, begin, -1))
            k += 1
    return longest


def longest_rectangle(row: Index, low: Array, high: Array, x: Array, from_: float, to: float, starts: Array,
                      width: float) -> float:
    """How long the longest rectangle of a width is that lies in intervals (m,) on lines X = x (l,), at any of some starts.

    Where the intervals' ends between two lines move past it, they are interpolated straight.

    Parameters
    ----------
    row, low, high : the intervals.   x : rising.   from_, to : which ends bound nothing: those of the lane.
    starts : (q,), where across the lines the rectangle begins.   width : its.
    """
    return float(_longest(row, low, high, x, from_, to, starts, width, np.empty(len(x))))
