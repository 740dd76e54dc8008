"""Delaunay triangulation of nodes inside a closed loop, which keeps the edges of the loop."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
Point = tuple[float, float]
Triangle = tuple[int, int, int]

FLAT = 1e-9  # height of a triangle over its longest side: nodes of a straight loop, in line to rounding


def triangles_within(nodes: Array, loop: int) -> tuple[Indices, Indices]:
    """Constrained Delaunay triangles of nodes (n, 2) inside the counter-clockwise loop that the first `loop` of them form.

    Returns: triangles (m, 3), counter-clockwise, and the loop's edges, by their first nodes, that could not be put in
    because the loop crosses or touches itself there; with any of these the triangles are not cut to the loop.
    Delaunay's triangles are Qhull's.
    """
    triangles = Delaunay(nodes).simplices.astype(np.int64)
    turn = doubled_area(nodes, triangles)
    corners = nodes[triangles]
    real = np.abs(turn) > FLAT * ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2).max(axis=1)
    triangles[turn < 0.0] = triangles[turn < 0.0][:, ::-1]
    triangles = _with_loop(nodes, _with_nodes_in_line(nodes, triangles[real], loop), loop)
    lacking = _lacking(triangles, loop)
    if len(lacking):
        return triangles, lacking
    # What hangs together without crossing the loop is inside or outside as a whole.
    start, end = sides_of(triangles)
    twin = _twins(start, end, len(nodes))
    open_side = (twin >= 0) & ~_on_loop(start, end, loop) & ~_on_loop(end, start, loop)
    graph = coo_array((np.ones(int(open_side.sum()), dtype=np.int8), (np.flatnonzero(open_side) // 3, twin[open_side] // 3)),
                      shape=(len(triangles), len(triangles)))
    parts, part = connected_components(graph, directed=False)
    inside = np.zeros(parts, dtype=bool)
    inside[part[np.flatnonzero(_on_loop(start, end, loop)) // 3]] = True
    return triangles[inside[part]], lacking


def sides_of(triangles: Indices) -> tuple[Indices, Indices]:
    """First and second node of each side, three a triangle."""
    return triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()


def _on_loop(start: Indices, end: Indices, loop: int) -> Flags:
    """Whether a directed edge is one of the loop's."""
    result: Flags = (start < loop) & (end == (start + 1) % loop)
    return result


def _lacking(triangles: Indices, loop: int) -> Indices:
    """The loop's edges, by their first nodes, that are no triangle's side."""
    start, end = sides_of(triangles)
    lacks = np.ones(loop, dtype=bool)
    lacks[start[_on_loop(start, end, loop)]] = False
    return np.flatnonzero(lacks)


def _twins(start: Indices, end: Indices, count: int) -> Indices:
    """For each side the number of the same side seen from its neighbour, −1 where there is none."""
    codes, turned = start * count + end, end * count + start
    order = np.argsort(codes)
    at = order[np.minimum(np.searchsorted(codes, turned, sorter=order), len(codes) - 1)]
    return np.where(codes[at] == turned, at, -1)


def _with_nodes_in_line(nodes: Array, triangles: Indices, loop: int) -> Indices:
    """The triangles, none flat, with those cut up of whose sides a part of the loop was taken for one edge.

    Nodes of a straight edge of the outline are in line only to rounding: Qhull may leave one out or join three of them,
    and which way such a triangle turns is then chance.
    """
    lacks = np.isin(np.arange(loop), _lacking(triangles, loop))
    if not lacks.any():
        return triangles
    start, end = sides_of(triangles)
    alone = np.flatnonzero((_twins(start, end, len(nodes)) < 0) & (np.maximum(start, end) < loop))
    cut: dict[int, list[tuple[int, ...]]] = {}
    for side in alone.tolist():
        a, b = int(start[side]), int(end[side])
        chain = (a + np.arange((b - a) % loop + 1)) % loop
        along, to = nodes[b] - nodes[a], nodes[chain] - nodes[a]
        off = np.abs(along[0] * to[:, 1] - along[1] * to[:, 0]).max()
        if not lacks[chain[:-1]].all() or off > FLAT * float(along @ along):
            continue
        pieces = cut.setdefault(side // 3, [tuple(triangles[side // 3].tolist())])
        whole = next(piece for piece in pieces if {a, b} <= set(piece))
        apex = next(node for node in whole if node not in (a, b))
        pieces.remove(whole)
        pieces += [(int(i), int(j), apex) for i, j in pairwise(chain)]
    return np.concatenate([np.delete(triangles, list(cut), axis=0),
                           np.array([piece for pieces in cut.values() for piece in pieces], dtype=np.int64).reshape(-1, 3)])


def _with_loop(nodes: Array, triangles: Indices, loop: int) -> Indices:
    """The triangles with the loop's edges that they cross put in, where nothing else of the loop is in the way.

    What an edge crosses is taken out, and the polygons to its left and right are filled with Delaunay triangles.
    Source: M. V. Anglada, An improved incremental algorithm for constructing restricted Delaunay triangulations,
    Computers & Graphics 21 (1997).
    """
    lacking = _lacking(triangles, loop).tolist()
    if not lacking:
        return triangles
    at: list[Point] = [(x, y) for x, y in nodes.tolist()]
    start, end = sides_of(triangles)
    apexes = np.roll(triangles, 1, axis=1).ravel()
    apex = dict(zip(zip(start.tolist(), end.tolist(), strict=True), apexes.tolist(), strict=True))
    around: dict[int, set[int]] = {node: set() for node in lacking}
    for side in np.flatnonzero(np.isin(start, lacking)):
        around[int(start[side])].add(int(end[side]))
    for a in lacking:
        b = (a + 1) % loop
        crossed = _crossed(at, apex, around[a], a, b, loop)
        if crossed is None:
            continue
        gone, left, right = crossed
        made = _filled(at, a, b, left) + _filled(at, b, a, right[::-1])
        for triangle in gone:
            for i, j in pairwise((*triangle, triangle[0])):
                del apex[i, j]
                around.get(i, set()).discard(j)
        for triangle in made:
            for (i, j), k in zip(pairwise((*triangle, triangle[0])), (triangle[2], *triangle[:2]), strict=True):
                apex[i, j] = k
                around.get(i, set()).add(j)
    return np.array([(i, j, k) for (i, j), k in apex.items() if i < j and i < k], dtype=np.int64)


def _crossed(at: list[Point], apex: dict[tuple[int, int], int], around: set[int], a: int, b: int, loop: int,
             ) -> tuple[list[Triangle], list[int], list[int]] | None:
    """The triangles that the segment from a to b runs through, and the nodes to its left and right; None where it is barred."""
    gates = ((p, apex[a, p]) for p in around)
    p, q = next((gate for gate in gates if _turn(at[a], at[b], at[gate[0]]) < 0.0 < _turn(at[a], at[b], at[gate[1]])), (a, a))
    if p == a:
        return None
    gone, left, right = [(a, p, q)], [q], [p]
    while True:
        barred = p < loop and q < loop and (p - q) % loop in (1, loop - 1)
        beyond = apex.get((q, p))
        if barred or beyond is None:
            return None
        gone.append((q, p, beyond))
        if beyond == b:
            return gone, left, right
        turn = _turn(at[a], at[b], at[beyond])
        if turn == 0.0:
            return None
        if turn > 0.0:
            q = beyond
            left.append(q)
        else:
            p = beyond
            right.append(p)


def _filled(at: list[Point], a: int, b: int, chain: list[int]) -> list[Triangle]:
    """Delaunay triangles between the edge a, b and the chain of nodes to its left, from a to b."""
    made: list[Triangle] = []
    pending = [(a, b, chain)]
    while pending:
        a, b, chain = pending.pop()
        if not chain:
            continue
        best = 0
        for k in range(1, len(chain)):
            if _in_circle(at[a], at[b], at[chain[best]], at[chain[k]]):
                best = k
        c = chain[best]
        made.append((a, b, c))
        pending += [(a, c, chain[:best]), (c, b, chain[best + 1:])]
    return made


def _turn(a: Point, b: Point, c: Point) -> float:
    """Twice the area of a, b, c: positive where c lies to the left of the segment from a to b."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _in_circle(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether d lies inside the circle through a, b and c, which run counter-clockwise."""
    ax, ay, bx, by, cx, cy = a[0] - d[0], a[1] - d[1], b[0] - d[0], b[1] - d[1], c[0] - d[0], c[1] - d[1]
    aa, bb, cc = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    return ax * (by * cc - bb * cy) - ay * (bx * cc - bb * cx) + aa * (bx * cy - by * cx) > 0.0


def doubled_area(points: Array, triangles: Indices) -> Array:
    """Twice the area of triangles in the plane, positive where they run counter-clockwise."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    result: Array = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    return result
