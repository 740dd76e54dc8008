"""The border of what is visible in a mirror, looked for: by rays over a grid, then between those that differ."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.plate_edge import ASK, FOUND, SEEN, UNKNOWN, Plate
from raytrace.viewing.view import Mask, View
from raytrace.visibility.edge import Edge
from raytrace.visibility.plate_edge import last_seen, seen_on_grid
from raytrace.visibility.shows import RIM, shows

Array = NDArray[np.float64]
Index = NDArray[np.intp]

GRID_SHAPE = (113, 149)  # points across and up, where the edge is not known and has to be looked for: some 2.5 mm apart
BESIDE = 0.1  # of the width and height of what is known of the outline: where it bulges
REFINED = 1  # times: each halves the distance
SPLIT, ROUNDS = 4, 14  # parts of their distance, one of which is left each time: 2e-8 mm in the end
SETTLED = float(SPLIT) ** -ROUNDS  # of their distance


def grid_over(view: View) -> Array:
    """Spread a grid over all that a view may show.

    Parameters
    ----------
    view : the mirror as the eye sees it.

    Returns
    -------
    Points (*GRID_SHAPE, 2) of the picture plane, mm.
    """
    seen_at = view.on_plane_of(view.reflector.outline())
    low, high = seen_at.min(axis=0), seen_at.max(axis=0)
    margin = BESIDE * (high - low)
    x, y = (np.linspace(low[c] - margin[c], high[c] + margin[c], GRID_SHAPE[c]) for c in (0, 1))
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=2)


def visibility_contour(view: View) -> Edge:
    """Find the edge as the border of those points of a grid whose rays are reflected, moved to where they cease to be.

    Parameters
    ----------
    view : the mirror as the eye sees it.

    Returns
    -------
    Edge
        Joined by parabolas through points half way between its vertices.
    """
    grid = grid_over(view)
    seen = _seen_on(view, grid)
    seen[[0, -1]] = seen[:, [0, -1]] = False  # a loop closes
    sides, following = _border(seen)
    nodes = grid.reshape(-1, 2)
    inside, outside = nodes[sides[:, 0]], nodes[sides[:, 1]]
    on_plane, found = ends_of_sight(view, inside, outside)
    on_plane[~found] = bisect_visibility(view, inside[~found], outside[~found])  # on the grid's border what is seen goes on
    for _ in range(REFINED):
        middles = _middles(view, on_plane, following)
        on_plane, following = (np.concatenate([on_plane, middles]),
                             np.concatenate([len(on_plane) + np.arange(len(on_plane)), following]))
    middles = _middles(view, on_plane, following)

    def at_share(k: Index, t: Array) -> Array:
        after, share = following[k], t[:, None]
        found: Array = ((1.0 - share) * (1.0 - 2.0 * share) * on_plane[k] + 4.0 * share * (1.0 - share) * middles[k]
                        + share * (2.0 * share - 1.0) * on_plane[after])
        return found

    traced = view.trace_points(on_plane)
    beyond = view.reflector.surface.extends
    asked = view.untrimmed if beyond else view
    return Edge(view, asked, beyond, False, on_plane, traced.points, traced.directions, following, at_share)


def _seen_on(view: View, grid: Array) -> Mask:
    """Which points of a grid (m, n, 2) show a reflection."""
    plate = _plate(view)
    if plate is None:
        return shows(view, grid.reshape(-1, 2)).reshape(grid.shape[:2])
    found = seen_on_grid(plate, view.eye_in_mirror, grid, RIM)
    seen: Mask = found == SEEN
    lost = found == ASK
    if lost.any():
        seen[lost] = shows(view, grid[lost])
    return seen


def _plate(view: View) -> Plate | None:
    """A plate that nothing stands before, as kernels follow rays through it; None for what is none."""
    reflector = view.reflector
    return reflector.surface.plate if reflector.obstacles is None or reflector.obstacles_behind else None


def _middles(view: View, on_plane: Array, following: Index) -> Array:
    """Points of the edge half way from each to the next, inside lying to the left; on the chord where they are not found."""
    along = on_plane[following] - on_plane
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    middles = on_plane + 0.5 * along
    found, known = ends_of_sight(view, middles + left, middles - left)
    return np.where(known[:, None], found, middles)


def _border(seen: Mask) -> tuple[Index, Index]:
    """Where a mask on a grid changes: the nodes inside and outside (m, 2) of each side of a cell on which it does.

    And the index (m,) of the next such side round what is inside, which lies to the left. Where two corners of a cell that lie
    across are inside, they are taken to be apart.
    """
    node = np.arange(seen.size).reshape(seen.shape)
    corners = np.stack([node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]], axis=2).reshape(-1, 4)
    inside = seen.ravel()[corners]
    starts, ends = [], []
    for side in range(4):  # a run of corners that are inside begins after this side of the cell, counter-clockwise
        cell = np.flatnonzero(~inside[:, side] & inside[:, (side + 1) % 4])
        last = np.full(len(cell), (side + 1) % 4)
        while (more := inside[cell, (last + 1) % 4]).any():
            last = np.where(more, (last + 1) % 4, last)
        # The border cuts the run off, from behind its last corner to before its first.
        starts.append(np.stack([corners[cell, last], corners[cell, (last + 1) % 4]], axis=1))
        ends.append(np.stack([corners[cell, (side + 1) % 4], corners[cell, side]], axis=1))
    start, end = np.concatenate(starts), np.concatenate(ends)
    name, wanted = start @ [seen.size, 1], end @ [seen.size, 1]
    order = np.argsort(name)
    return start, order[np.searchsorted(name[order], wanted)]


def ends_of_sight(view: View, starts: Array, ends: Array) -> tuple[Array, Mask]:
    """Find the last points that are seen on straight ways over the picture plane.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    starts, ends : (m, 2), mm.

    Returns
    -------
    points : (m, 2), mm, to SETTLED of the way.
    found : (m,), which of them: not where the start of the way is not seen, or its end is.
    """
    found, points = np.zeros(len(starts), dtype=np.bool_), starts.copy()
    left, plate = np.arange(len(starts)), _plate(view)
    if plate is not None:
        points, outcome = last_seen(plate, view.eye_in_mirror, starts, ends, RIM, SETTLED)
        found, left = outcome == FOUND, np.flatnonzero(outcome == UNKNOWN)
    if left.size:
        left = left[shows(view, starts[left]) & ~shows(view, ends[left])]
        points[left], found[left] = bisect_visibility(view, starts[left], ends[left]), True
    return points, found


def bisect_visibility(view: View, inside: Array, outside: Array) -> Array:
    """Find the last points that are seen on the way from points that are to others that are not.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    inside, outside : (m, 2), mm, of the picture plane.

    Returns
    -------
    (m, 2), mm, to SETTLED of the way.
    """
    share = (np.arange(SPLIT + 1) / SPLIT)[:, None]
    row = np.arange(len(inside))
    for _ in range(ROUNDS):
        at = inside[:, None] + share * (outside - inside)[:, None]
        seen = shows(view, at[:, 1:-1].reshape(-1, 2)).reshape(-1, SPLIT - 1)
        last = np.argmin(np.concatenate([seen, np.zeros((len(seen), 1), dtype=np.bool_)], axis=1), axis=1)
        inside, outside = at[row, last], at[row, last + 1]
    return inside
