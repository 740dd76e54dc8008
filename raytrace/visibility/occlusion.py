"""Where rays that move graze the host vehicle: the intervals of a parameter over which it does not hide what they reach."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from raytrace.roots import roots
from raytrace.viewing.vehicle import HostVehicle
from raytrace.visibility.intervals import IntervalSet
from raytrace.visibility.sign_changes import lowest, may_cross

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Segments = tuple[Array, Array]  # starts and ends (n, 3), mm
Rays = Callable[[Index, Array], Segments]

# The box's twelve edges: the two axes that an edge lies across, and on which side of each (0 low, 1 high).
EDGES = tuple((i, j, a, b) for i, j in ((0, 1), (0, 2), (1, 2)) for a in (0, 1) for b in (0, 1))
FUNCTIONS = len(EDGES) + 12
REACH = 0.5  # of a segment beyond its ends, and of a cell's change: how far off an edge may be missed and yet be looked at
GRAZING = 1e-3  # of a cell: nearer to a root, a sample's own ray may graze within rounding
SAME = 1e-13  # of the parameter's size: roots this near are one


def grazing_functions(host: HostVehicle, starts: Array, ends: Array) -> Array:
    """Smooth functions of a segment whose signs say whether a box hides its end.

    With the segment q + s·w, w = T − q, 0 ≤ s ≤ 1, and the box's planes c on each axis:

        E = ((c_i − q_i)·w_j − (c_j − q_j)·w_i)/|w|     on which side of an edge of the box the line passes (twelve edges)
        q_k − c_k and (T_k − c_k)/|w|                   on which side of a face the segment begins and ends (six faces)

    The segment enters the planes' slab on axis k at e_k and leaves it at l_k; it passes the inside where
    min(1, l_k) > max(0, e_k). That can change only where l_i = e_j with i ≠ j, so that E = 0, or where l_k = 0 or e_k = 1.
    All are smooth where segments change smoothly, also where a component of w changes its sign.

    Parameters
    ----------
    host : the box.
    starts, ends : (n, 3), mm.

    Returns
    -------
    (24, n) : the edges' in the order of EDGES, mm, the starts', mm, and the ends'.
    """
    low, high = host.corners
    segment = (ends - starts).T
    length = np.sqrt(np.einsum("in,in->n", segment, segment))
    to_planes = np.stack([low[:, None] - starts.T, high[:, None] - starts.T])  # (2, 3, n)
    found = np.empty((FUNCTIONS, len(starts)))
    for k, (i, j, a, b) in enumerate(EDGES):
        found[k] = (to_planes[a, i] * segment[j] - to_planes[b, j] * segment[i]) / length
    found[12:18] = -to_planes.reshape(6, -1)
    found[18:24] = (segment - to_planes).reshape(6, -1) / length
    return found


def unhidden(host: HostVehicle, row: Index, at: Array, samples: Segments, rays: Rays) -> IntervalSet:
    """Find the intervals of a parameter, on numbered rows, in which a box does not hide the ends of segments that move with it.

    Every end of an interval is the end of a row's samples or a root of one of the `grazing_functions`, on segments that `rays`
    gives; roots are bracketed by the samples' signs and, where a function turns between two samples, by its turn. What is
    between two neighbouring roots is hidden or not as a segment half way between is. So nothing is missed because it
    is narrow, and the very ends of a row count as its inside does.

    Parameters
    ----------
    host : the box.
    row, at : (n,), each row's samples in rising order of the parameter; a row's first and last are its ends.
    samples : the segments at the samples, mm; finite.
    rays : segments (m, 3) at shares (m,) of the way from samples (m,) to the next of the same row; NaN where there are none.

    Returns
    -------
    IntervalSet
        Of the parameter, each row's number being its own.
    """
    n = len(at)
    if n == 0:
        return IntervalSet(np.zeros(0, dtype=np.intp), np.zeros(0), np.zeros(0))
    starts, ends = samples
    values = grazing_functions(host, starts, ends)
    which, cell, low, high, at_low, at_high = _brackets(host, row, at, starts, ends, values, rays)

    def function(share: Array) -> Array:
        found: Array = _one_each(host, which, *rays(cell, low + share * (high - low)))
        return np.where(np.isfinite(found), found, at_low)

    share = low + roots(function, at_low, at_high) * (high - low) if len(cell) else np.zeros(0)
    return _classified(host, row, at, starts, ends, rays, cell, share)


def _one_each(host: HostVehicle, which: Index, starts: Array, ends: Array) -> Array:
    """One of the grazing functions for each segment, (n,)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        found: Array = grazing_functions(host, starts, ends)[which, np.arange(len(which))]
    return found


def _brackets(host: HostVehicle, row: Index, at: Array, starts: Array, ends: Array, values: Array, rays: Rays,
              ) -> tuple[Index, Index, Array, Array, Array, Array]:
    """Which function changes its sign in which cell, between which shares of it, and its values there; (m,) each."""
    inner = row[1:] == row[:-1]
    positive = values > 0.0
    which, cell = np.nonzero((positive[:, 1:] != positive[:, :-1]) & inner)
    kept = _may_count(host, which, cell, starts, ends, values)
    which, cell = which[kept], cell[kept]
    turns = _turns(host, row, at, starts, ends, values, rays)
    low, high = np.zeros(len(cell)), np.ones(len(cell))
    at_low, at_high = values[which, cell], values[which, cell + 1]
    if turns is not None:
        of, where, share, there = turns
        which, cell = np.concatenate([which, of, of]), np.concatenate([cell, where, where])
        low = np.concatenate([low, np.zeros(len(of)), share])
        high = np.concatenate([high, share, np.ones(len(of))])
        at_low = np.concatenate([at_low, values[of, where], there])
        at_high = np.concatenate([at_high, there, values[of, where + 1]])
    return which, cell, low, high, at_low, at_high


def _may_count(host: HostVehicle, which: Index, cell: Index, starts: Array, ends: Array, values: Array) -> Mask:
    """Whether a function's root in a cell may lie on the box.

    An edge is a segment, as the ray is, and both are crossed or passed by far. Only what is clearly passed by is left out.
    """
    here, after = values[which, cell], values[which, cell + 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(here == after, 0.5, here / (here - after))
    share = np.clip(share, 0.0, 1.0)[:, None]
    start = starts[cell] + share * (starts[cell + 1] - starts[cell])
    segment = ends[cell] - starts[cell] + share * (ends[cell + 1] - starts[cell + 1] - ends[cell] + starts[cell])
    low, high = host.corners
    edge = which < len(EDGES)
    table = np.array(EDGES)[np.where(edge, which, 0)]
    pick = np.arange(len(which))
    # The plane that the ray meets more steeply tells best where it passes the edge.
    first = np.abs(segment[pick, table[:, 0]]) >= np.abs(segment[pick, table[:, 1]])
    axis, side = np.where(first, table[:, 0], table[:, 1]), np.where(first, table[:, 2], table[:, 3])
    plane = np.where(side == 0, low[axis], high[axis])
    third = 3 - table[:, 0] - table[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (plane - start[pick, axis]) / segment[pick, axis]
        # Of a face: the segment's own start or end, as it may lie on it.
        along = np.where(edge, along, np.where(which < len(EDGES) + 6, 0.0, 1.0))
        at, before, after = (one + along[:, None] * two for one, two in (
            (start, segment), (starts[cell], ends[cell] - starts[cell]), (starts[cell + 1], ends[cell + 1] - starts[cell + 1])))
        room = REACH * np.abs(after - before) + REACH * (high - low)
        beside = (at < low - room) | (at > high + room)
    beside[edge] &= np.arange(3) == third[edge, None]
    passed: Mask = beside.any(axis=1) | (along < -REACH) | (along > 1.0 + REACH)
    return ~passed


def _turns(host: HostVehicle, row: Index, at: Array, starts: Array, ends: Array, values: Array, rays: Rays,
           ) -> tuple[Index, Index, Array, Array] | None:
    """Where functions that have one sign at both ends of a cell have the other between.

    The function, the cell, the share and the value there, (m,) each; None where none does.
    """
    if len(at) < 3:
        return None
    three = np.flatnonzero(row[2:] == row[:-2])
    if three.size == 0:
        return None
    found = may_cross(np.stack([at[three + k] for k in range(3)]), np.stack([values[:, three + k] for k in range(3)]))
    pairs = np.concatenate([np.stack([(index := np.nonzero(near))[0], three[index[1]] + k], axis=1)
                            for k, near in enumerate(found)])
    if len(pairs) == 0:
        return None
    which, cell = np.unique(pairs, axis=0).T
    kept = _may_count(host, which, cell, starts, ends, values)
    which, cell = which[kept], cell[kept]
    if len(cell) == 0:
        return None
    sign = np.where(values[which, cell] > 0.0, 1.0, -1.0)
    share, best = lowest(lambda share: sign * _one_each(host, which, *rays(cell, share)), len(cell))
    crossed = best <= 0.0
    return which[crossed], cell[crossed], share[crossed], (sign * best)[crossed]


def _classified(host: HostVehicle, row: Index, at: Array, starts: Array, ends: Array, rays: Rays, cell: Index, share: Array,
                ) -> IntervalSet:
    """The intervals between stops, the rows' ends and roots, in which the box hides nothing."""
    first = np.flatnonzero(np.append(True, row[1:] != row[:-1]))
    last = np.append(first[1:], len(row)) - 1
    # Every stop as a place on the samples: the number of the sample before it and the share of the way to the next.
    on = np.concatenate([first.astype(np.float64), cell + share, last])
    base = np.concatenate([first, cell, np.maximum(last - 1, first)])
    part = np.concatenate([np.zeros(len(first)), share, (last > first).astype(np.float64)])
    order = np.argsort(on, kind="stable")
    base, part = base[order], part[order]
    after = np.minimum(base + 1, len(at) - 1)
    value = at[base] + part * (at[after] - at[base])
    value = np.where(part >= 1.0, at[after], value)
    same = SAME * np.maximum(1.0, np.abs(value))
    gap = np.flatnonzero((row[base[1:]] == row[base[:-1]]) & (value[1:] - value[:-1] > same[1:]))
    if gap.size == 0:
        return IntervalSet(np.zeros(0, dtype=np.intp), np.zeros(0), np.zeros(0))
    begin, stop = base[gap] + part[gap], base[gap + 1] + part[gap + 1]
    # A sample inside tells of the gap, the nearest to its middle; where there is none, a segment half way does.
    middle = 0.5 * (begin + stop)
    sample = np.rint(middle).astype(np.intp)
    told = (sample - begin > GRAZING) & (stop - sample > GRAZING)
    hidden = np.zeros(len(gap), dtype=np.bool_)
    hidden[told] = host.hides(starts[sample[told]], ends[sample[told]])
    untold = np.flatnonzero(~told)
    if untold.size:
        where = np.minimum(middle[untold].astype(np.intp), len(at) - 2)
        hidden[untold] = host.hides(*rays(where, middle[untold] - where))
    kept = gap[~hidden]
    return IntervalSet.joined(row[base[kept]], value[kept], value[kept + 1], same[kept[1:]])
