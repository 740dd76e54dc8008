"""A meshed B-spline face in, the same face with nodes on a lattice that follows its curvature out.

The kernel's mesher strews nodes over a curved face, and normals interpolated over its slender triangles make ragged
reflections. Here the face's outline is kept (its neighbours share it), and the nodes inside are laid anew where lines of
constant u and v cross. The lines are so far apart that an edge between them is at most so long and turns at most so far;
in the lattice's own coordinates the nodes are a square grid, and a constrained Delaunay triangulation is made there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from OCP.Geom import Geom_Surface
from OCP.GeomLProp import GeomLProp_SLProps
from scipy.spatial import Delaunay

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SAMPLES = 160, 13  # along the direction whose lines are spaced, and across it
CLEAR = 0.42  # cells: a node is no nearer to the outline


def relaid(surface: Geom_Surface, points: Array, uv: Array, triangles: Index, size: float, turn: float,
           ) -> tuple[Array, Array, Index] | None:
    """Places (n, 3), parameters (n, 2) and triangles (m, 3) with new inner nodes; None where the outline is not simple.

    size : longest distance of neighbouring lines [mm]; turn : largest angle between their normals [rad].
    """
    loops = _loops(triangles)
    if loops is None:
        return None
    low, high = uv.min(axis=0), uv.max(axis=0)
    scales = [_scale(surface, low, high, axis, size, turn) for axis in (0, 1)]
    flat = np.column_stack([np.interp(uv[:, axis], *scales[axis]) for axis in (0, 1)])
    rim = np.concatenate(loops)
    ends = np.concatenate([np.column_stack([loop, np.roll(loop, -1)]) for loop in loops])
    inner = _lattice(flat, ends, [float(scale[1][-1]) for scale in scales])
    number = np.full(len(flat), -1)
    number[rim] = np.arange(len(rim))
    faces = constrained(np.vstack([flat[rim], inner]), number[ends])
    if faces is None:
        return None
    inner_uv = np.column_stack([np.interp(inner[:, axis], scales[axis][1], scales[axis][0]) for axis in (0, 1)])
    found = [surface.Value(float(u), float(v)) for u, v in inner_uv]
    places = np.array([(point.X(), point.Y(), point.Z()) for point in found]).reshape(-1, 3)
    return np.vstack([points[rim], places]), np.vstack([uv[rim], inner_uv]), faces


def _loops(triangles: Index) -> list[Index] | None:
    """The closed chains of edges that only one triangle has, each in that triangle's sense; None where chains touch."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    pairs = {(a, b) for a, b in edges.tolist()}
    follow = {}
    for a, b in edges.tolist():
        if (b, a) not in pairs:
            if a in follow:
                return None
            follow[a] = b
    loops = []
    while follow:
        start, at = follow.popitem()
        loop = [start]
        while at != start:
            loop.append(at)
            at = follow.pop(at)
        loops.append(np.array(loop))
    return loops


def _scale(surface: Geom_Surface, low: Array, high: Array, axis: int, size: float, turn: float) -> tuple[Array, Array]:
    """A parameter's values and how many lines lie before each: ∫ max over the other parameter of |P′|/size + |N′|/turn."""
    along = np.linspace(low[axis], high[axis], SAMPLES[0])
    across = np.linspace(low[1 - axis], high[1 - axis], SAMPLES[1] + 2)[1:-1]
    local = GeomLProp_SLProps(surface, 1, 1e-9)
    places, normals = np.zeros((2, SAMPLES[1], SAMPLES[0], 3))
    for i, other in enumerate(across):
        for j, value in enumerate(along):
            u, v = (value, other) if axis == 0 else (other, value)
            local.SetParameters(float(u), float(v))
            point = local.Value()
            places[i, j] = point.X(), point.Y(), point.Z()
            if local.IsNormalDefined():
                normal = local.Normal()
                normals[i, j] = normal.X(), normal.Y(), normal.Z()
    steps = np.linalg.norm(np.diff(places, axis=1), axis=2) / size + np.linalg.norm(np.diff(normals, axis=1), axis=2) / turn
    count = np.concatenate([[0.0], np.cumsum(np.maximum(steps.max(axis=0), 1e-6))])
    whole = max(1.0, float(np.ceil(count[-1])))
    return along, count * (whole / count[-1])


def _lattice(flat: Array, ends: Index, extent: list[float]) -> Array:
    """Integer nodes inside the outline, whose edges are ends (m, 2), and clear of it."""
    grid = np.stack(np.meshgrid(*(np.arange(0.0, end + 0.5) for end in extent), indexing="ij"), axis=-1).reshape(-1, 2)
    keep = inside(grid, flat[ends])
    for p, q in flat[ends]:
        segment = q - p
        t = np.clip((grid - p) @ segment / max(float(segment @ segment), 1e-30), 0.0, 1.0)
        keep &= np.linalg.norm(grid - p - t[:, None] * segment, axis=1) > CLEAR
    return np.asarray(grid[keep])


def inside(points: Array, edges: Array) -> NDArray[np.bool_]:
    """Which points (n, 2) lie inside the loops that edges (m, 2, 2) form together: an odd number of them lies to one side."""
    odd = np.zeros(len(points), dtype=bool)
    for p, q in edges:
        if p[1] != q[1]:
            crosses = (p[1] > points[:, 1]) != (q[1] > points[:, 1])
            odd ^= crosses & (points[:, 0] < p[0] + (points[:, 1] - p[1]) / (q[1] - p[1]) * (q[0] - p[0]))
    return odd


def constrained(nodes: Array, ends: Index) -> Index | None:
    """The triangles (m, 3), anticlockwise, of the region whose outline's edges are ends (k, 2); None where one is lost.

    A Delaunay triangulation of the nodes, in which each edge that is missing is won back by flipping those that cross it
    (Sloan, A fast algorithm for generating constrained Delaunay triangulations, Computers & Structures 47, 441 (1993)).
    """
    mesh = Delaunay(nodes)
    if len(np.unique(mesh.simplices)) < len(nodes):
        return None
    triangles = [_turned(nodes, triangle) for triangle in mesh.simplices.tolist()]
    beside = {(t[k], t[(k + 1) % 3]): number for number, t in enumerate(triangles) for k in range(3)}
    for a, b in ends.tolist():
        if (a, b) not in beside and (b, a) not in beside and not _recover(nodes, triangles, beside, a, b):
            return None
    faces = np.array(triangles)
    return faces[inside(nodes[faces].mean(axis=1), nodes[ends])]


def _turned(nodes: Array, triangle: list[int]) -> list[int]:
    a, b, c = triangle
    return triangle if _side(nodes, a, b, c) > 0.0 else [a, c, b]


def _side(nodes: Array, a: int, b: int, c: int) -> float:
    """Twice the signed area of a triangle: positive where c lies to the left of a → b."""
    (ax, ay), (bx, by), (cx, cy) = nodes[a], nodes[b], nodes[c]
    return float((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))


def _recover(nodes: Array, triangles: list[list[int]], beside: dict[tuple[int, int], int], a: int, b: int) -> bool:
    """Flip edges until a–b is one; False where that does not end."""

    def across(p: int, q: int) -> bool:
        return (len({a, b, p, q}) == 4 and _side(nodes, a, b, p) * _side(nodes, a, b, q) < 0.0
                and _side(nodes, p, q, a) * _side(nodes, p, q, b) < 0.0)

    crossing = [(p, q) for p, q in beside if p < q and across(p, q)]
    for _ in range(50 * len(crossing) + 50):
        if not crossing:
            break
        p, q = crossing.pop(0)
        if (p, q) not in beside or (q, p) not in beside:
            continue
        left, right = beside[p, q], beside[q, p]
        r = next(node for node in triangles[left] if node not in (p, q))
        s = next(node for node in triangles[right] if node not in (p, q))
        if _side(nodes, s, r, p) * _side(nodes, s, r, q) >= 0.0:  # not convex: later
            crossing.append((p, q))
            continue
        for key in ((p, q), (q, r), (r, p), (q, p), (p, s), (s, q)):
            del beside[key]
        triangles[left], triangles[right] = [r, p, s], [s, q, r]
        for number in (left, right):
            t = triangles[number]
            beside.update({(t[k], t[(k + 1) % 3]): number for k in range(3)})
        if across(r, s):
            crossing.append((r, s))
    return (a, b) in beside or (b, a) in beside
