"""The parts of parallel lines of a level plane that a mirror shows: a plan, line by line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels import outlines as outlines_kernel
from raytrace.kernels import plan as kernel
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import Mask
from raytrace.visibility.edge import Edge
from raytrace.visibility.edges import Edges
from raytrace.visibility.intervals import IntervalSet, combined, union
from raytrace.visibility.occlusion import unhidden
from raytrace.visibility.ray_function import RayFunction

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Axis = Literal[0, 1]  # of the coordinate that a line keeps: 0 for X, 1 for Y
Polygon = NDArray[np.float64]

GRID_SHAPE = 7  # samples of a part of a line, ends included, between which the vehicle's edges are looked for
INSIDE = 1e-3  # of a part of a line: how far inside its ends, where rays may miss the mirror, Newton starts
ENDLESS_MM = 1e6  # as far as a part of a line is followed that the mirror shows without an end
MIN_HEIGHT_MM = 1.0  # of a mirror above a plane, for what scales angles: any length serves
WRAP = 0.5 * np.pi  # between neighbours on the edge no ray turns by so much


def visible_intervals(edge: Edge, axis: Axis, values: Array, height_mm: float = 0.0, host: HostVehicle | None = None,
          low: float = -ENDLESS_MM, high: float = ENDLESS_MM) -> IntervalSet:
    """Find the parts of parallel lines of a level plane that an eye sees in a mirror and the host vehicle does not hide.

    Exact at both ends: a ray through the mirror's edge, or one that touches the vehicle, meets the line there. It does not hold
    for a mirror that shows one point twice (`raytrace.visibility.orientation`).

    Parameters
    ----------
    edge : of what the eye sees reflecting.
    axis : 0 for lines X = value, 1 for lines Y = value.
    values : (n,), mm, rising.
    height_mm : of the plane over the ground, mm.
    host : what hides; None for nothing.
    low, high : mm, between which the lines are looked at.

    Returns
    -------
    IntervalSet
        On rows numbered as the values, mm of the other coordinate.
    """
    return _visible(Edges.of_one(edge), np.zeros(len(values), dtype=np.intp), axis, values, height_mm, host, low, high)


def visible_on_each(edges: Edges, axis: Axis, value_mm: float, height_mm: float = 0.0, host: HostVehicle | None = None,
                    low: float = -ENDLESS_MM, high: float = ENDLESS_MM) -> IntervalSet:
    """Find the parts of one line of a level plane that are seen with each of several edges.

    Parameters
    ----------
    edges : of what several eyes see reflecting.
    axis, height_mm, host, low, high : as for `visible_intervals`.
    value_mm : where the line is.

    Returns
    -------
    IntervalSet
        On rows numbered as the edges, mm of the other coordinate.
    """
    return _visible(edges, np.arange(len(edges)), axis, np.full(len(edges), value_mm), height_mm, host, low, high)


def _visible(edges: Edges, of: Index, axis: Axis, values: Array, height_mm: float, host: HostVehicle | None, low: float,
             high: float) -> IntervalSet:
    """The visible parts of lines, values (n,), each with the edge of (n,) that it is seen with; those of one edge rise."""
    cuts = _cuts(edges, of, axis, values, height_mm)
    first, last = np.maximum(cuts.low, low), np.minimum(cuts.high, high)
    kept = first < last
    cuts, first, last = cuts.subset(kept), first[kept], last[kept]
    if host is None or len(cuts.row) == 0:
        return IntervalSet(cuts.row, first, last)
    ends = np.empty((2, len(first), 2))
    ends[:, :, axis], ends[:, :, 1 - axis] = values[cuts.row], (first, last)
    owner = of[cuts.row]
    open_to_all = beside(edges.reach[0][owner], edges.reach[1][owner], host, ends)
    hidden = np.flatnonzero(~open_to_all)
    parts = _unhidden(edges, of, axis, values, height_mm, host, cuts.subset(hidden), first[hidden], last[hidden])
    return union(IntervalSet(cuts.row[open_to_all], first[open_to_all], last[open_to_all]), parts)


@dataclass(frozen=True, slots=True, eq=False)
class _Cuts:
    """Parts of lines between two crossings of the edge: their line, ends, and the places (m, 2) that show these."""

    row: Index
    low: Array
    high: Array
    at_low: Array
    at_high: Array

    def subset(self, which: Mask | Index) -> _Cuts:
        return _Cuts(self.row[which], self.low[which], self.high[which], self.at_low[which], self.at_high[which])


def _cuts(edges: Edges, of: Index, axis: Axis, values: Array, height_mm: float) -> _Cuts:
    """Where rays through the edge meet the lines, two by two.

    A ray from q along d meets the plane at q + d·(q_z − h)/D with D = −d_z, so at N/D on the axis with
    N = D·q_axis + (q_z − h)·d_axis. The angle of (N − r·D, l·D) runs on through the horizon, where D is 0, and equals that of
    (value − r, l) where the ray meets the line; r and l > 0 are any numbers. With the mirror's place for r and its height
    above the plane for l it is the angle that the mirror sees the line at, which changes little between neighbours also below
    the mirror.
    """
    swept = []
    for j in range(len(edges)):
        points, directions, following = edges.rays(j)
        rows = np.flatnonzero(of == j) if len(edges) > 1 else np.arange(len(of))
        if len(points) and rows.size:
            after, line = kernel.swept_lines(points, directions, following, axis, height_mm, values[rows], MIN_HEIGHT_MM, WRAP)
            swept.append((after, rows[line]))
    none = np.zeros(0, dtype=np.intp)
    k, row = (np.concatenate([none, *(part[c] for part in swept)]) for c in (0, 1))
    # On which side a ray passes the line: (value − q_axis)·d_z − (height − q_z)·d_axis.
    coefficients = np.zeros((len(row), 10))
    coefficients[:, 6], coefficients[:, 4 + axis] = values[row], -height_mm
    coefficients[:, 8 if axis == 0 else 7] = 1.0 if axis == 0 else -1.0
    on_plane, points, directions = edges.settle(of[row], k, RayFunction(coefficients))
    across = 1 - axis
    reach = (height_mm - points[:, 2]) / directions[:, 2]
    other = points[:, across] + reach * directions[:, across]
    row, other, on_plane = _ended(edges, of, axis, values, height_mm, row, other, on_plane)
    order = np.lexsort((other, row))
    low, high = order[::2], order[1::2]
    return _Cuts(row[low], other[low], other[high], on_plane[low], on_plane[high])


def _ended(edges: Edges, of: Index, axis: Axis, values: Array, height_mm: float, row: Index, other: Array, on_plane: Array,
           ) -> tuple[Index, Array, Array]:
    """The crossings, with an end at ENDLESS_MM for lines that the mirror shows without one."""
    odd = np.bincount(row, minlength=len(values)) % 2 == 1
    # Both ends of a line are shown only by what shows more than half of the world.
    asked = np.flatnonzero(odd | edges.show_more_than_half[of])
    if asked.size == 0:
        return row, other, on_plane
    ends = np.empty((2, len(asked), 3))
    ends[:, :, axis], ends[:, :, 2] = values[asked], height_mm
    ends[:, :, 1 - axis] = np.array([[-ENDLESS_MM], [ENDLESS_MM]])
    found, seen = edges.image_points(np.tile(of[asked], 2), ends.reshape(-1, 3))
    # Of a line with one crossing one end is shown, else none or both; where that is not to be told, the line is left out.
    seen_at = seen.reshape(2, -1)
    told = (seen_at[0] != seen_at[1]) == odd[asked]
    kept = ~np.isin(row, asked[~told])
    end = np.flatnonzero(seen & np.tile(told, 2))
    return (np.concatenate([row[kept], np.tile(asked, 2)[end]]),
            np.concatenate([other[kept], ends[:, :, 1 - axis].ravel()[end]]), np.concatenate([on_plane[kept], found[end]]))


def beside(low: Array, high: Array, host: HostVehicle, ends: Array) -> Mask:
    """Find which straight lines lie, with all of the mirror, on the outer side of a plane that bounds the vehicle.

    It hides nothing of them.

    Parameters
    ----------
    low, high : (2,) or (m, 2), mm, from where to where the mirror's edge reaches in plan.
    host : the box.
    ends : (2, m, 2), mm, the two ends of each line in plan.

    Returns
    -------
    (m,).
    """
    found = np.zeros(ends.shape[1], dtype=np.bool_)
    for c, (least, most) in enumerate(((host.front_mm, host.rear_mm), (-host.half_width_mm, host.half_width_mm))):
        found |= (ends[:, :, c] <= least).all(axis=0) & (high[..., c] <= least)
        found |= (ends[:, :, c] >= most).all(axis=0) & (low[..., c] >= most)
    return found


def _unhidden(edges: Edges, of: Index, axis: Axis, values: Array, height_mm: float, host: HostVehicle, cuts: _Cuts,
              first: Array, last: Array) -> IntervalSet:
    """The parts of `cuts` between first and last (m,) that the vehicle does not hide."""
    m = len(cuts.row)
    value, owner = values[cuts.row], of[cuts.row]
    # Places on a line are reckoned by the angle at which the mirror sees them: so are they spread over the picture.
    middle = edges.posed.offsets[owner]  # where the mirror's origin is
    away = np.hypot(value - middle[:, axis], height_mm - middle[:, 2])
    low, high, begin, end = (np.arctan2(at - middle[:, 1 - axis], away) for at in (cuts.low, cuts.high, first, last))

    def segments(angle: Array, which: Index, starts: Array) -> tuple[Array, Array, Array]:
        """Where lines are at such an angle, the places that show it, and where their rays leave the mirror."""
        target = np.empty((len(which), 3))
        target[:, axis], target[:, 2] = value[which], height_mm
        target[:, 1 - axis] = middle[which, 1 - axis] + away[which] * np.tan(angle)
        on_plane, points = edges.follow_image_points(owner[which], starts, target)
        return target, on_plane, points

    share = np.linspace(0.0, 1.0, GRID_SHAPE)
    angles = begin[:, None] + (end - begin)[:, None] * share
    fraction = np.clip((angles - low[:, None]) / (high - low)[:, None], INSIDE, 1.0 - INSIDE)[:, :, None]
    starts = cuts.at_low[:, None] + fraction * (cuts.at_high - cuts.at_low)[:, None]
    which = np.repeat(np.arange(m), GRID_SHAPE)
    target, on_plane, points = segments(angles.ravel(), which, starts.reshape(-1, 2))
    known = np.isfinite(points).all(axis=1)  # not where a mesh ends beside a place
    part, at, target, on_plane, points = which[known], angles.ravel()[known], target[known], on_plane[known], points[known]

    def rays(cell: Index, share: Array) -> tuple[Array, Array]:
        target, _, points_there = segments(at[cell] + share * (at[cell + 1] - at[cell]), part[cell],
                                           on_plane[cell] + share[:, None] * (on_plane[cell + 1] - on_plane[cell]))
        return points_there, target

    found = unhidden(host, part, at, (points, target), rays)
    # The ends that are not the vehicle's are known better than by their angle.
    at_begin, at_end = found.low == begin[found.row], found.high == end[found.row]
    low, high = (middle[found.row, 1 - axis] + away[found.row] * np.tan(one) for one in (found.low, found.high))
    found_low, found_high = np.where(at_begin, first[found.row], low), np.where(at_end, last[found.row], high)
    kept = found_low < found_high
    return combined(lambda seen: seen, IntervalSet(cuts.row[found.row[kept]], found_low[kept], found_high[kept]))


def outlines(spans: IntervalSet, values: Array) -> tuple[Polygon, ...]:
    """Join intervals on neighbouring lines to closed polygons.

    Every vertex is an interval's end; where one interval becomes two or two become one, so does the polygon.

    Parameters
    ----------
    spans : the intervals, on rows numbered as the lines.
    values : (l,), of the lines, rising, mm.

    Returns
    -------
    Polygons (n, 2) of (value, point on the line), mm.
    """
    return tuple(outlines_kernel.outlines(spans.row, spans.low, spans.high, values))
