"""Mesh a plate by closed triangles within a deflection of its front, back and rim.

The kernel's mesher takes a deflection as advice: on faces that are straight one way, or whose curvature changes sign, it
leaves facets several times off however fine a mesh is asked for, and at times does not end. So both faces are triangulated
here, together, in the plane of their parameters: nodes on a hexagonal lattice in a metric in which every facet that fits a
small circle holds the deflection, nodes on the outline, and more nodes where a facet still misses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mirror_cad.errors import WriteError
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.outline import Arc, Outline, Segment, Spline
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import normals
from mirror_cad.triangulation import doubled_area, sides_of, triangles_within

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

MAX_FACETS = 1_000_000  # of the optical face: an STL of 100 MB, and a minute
# A facet in a circle of radius ρ of the metric misses by 4·ρ²·LATTICE_SHARE of the deflection at most, to second order:
# on the lattice ρ = 0.58, beside the rim up to 0.7. Up to 0.5 would do; light, which sees the facets' slopes, is given more.
LATTICE_SHARE = 0.4
RIM_SHARE = 0.7  # of the deflection, for a chord of the rim and the sides' twist
LONGEST_RIM = 0.8  # edge of the rim, in the metric
CLEARANCE = 0.55  # lattice to rim, in the metric: outside the circles over the rim's edges
LARGEST_STEP = 1 / 6  # of the mirror's larger side: where it is flat
LONGEST_FACET = 4.0  # length of a facet against its width where the surface is straight one way: no needles
GRADING = 0.3  # change of the lattice's step per mm: neighbouring facets are of like size
HELD = 0.98  # of the deflection: a facet is measured at four points only
SAMPLES = 241  # points a direction at which the curvature is looked at
ROUNDS = 40  # of more nodes: a few serve, a neck thinner than the deflection takes one a halving


def plate_mesh(front: BSplineSurface, back: BSplineSurface, outline: Outline, deflection_mm: float) -> SurfaceMesh:
    """Triangles of front, back and sides of a plate, closed and outward, none farther from its face than the deflection.

    front, back : surfaces on the same parameters; front looks along S_u × S_v. Both get the same nodes in (u, v), and a
    side runs straight from a node of the rim in front to its like behind. Facets: front, back, sides.

    Raises
    ------
    WriteError
        Where the deflection asks for more than MAX_FACETS, or does not come to hold.
    """
    faces = (front, back)
    metric = _Metric.of(faces, outline, deflection_mm)
    if not metric.facets <= MAX_FACETS:
        raise WriteError(f"a deflection of {deflection_mm:.2g} mm takes some {metric.facets:,.0f} facets on this mirror, more "
                         f"than {MAX_FACETS:,}: ask for {deflection_mm * metric.facets / MAX_FACETS:.2g} mm")
    rim = _Rim.of(faces, outline, metric, deflection_mm)
    inside = metric.lattice(outline, rim)
    for _ in range(ROUNDS):
        uv = np.concatenate([rim.uv, inside])
        triangles, lacking = triangles_within(metric(uv), len(rim.uv))
        if len(lacking):
            rim = rim.halved(lacking)
            continue
        long = _edges_to_halve(faces, uv, triangles, metric, deflection_mm)
        if len(long) == 0:
            return _closed(faces, uv, triangles, len(rim.uv))
        on_rim, edge = _rim_edges(long, len(rim.uv))
        inside = np.concatenate([inside, uv[long[~on_rim]].mean(axis=1)])
        rim = rim.halved(edge)
    raise WriteError(f"no mesh within {deflection_mm:.2g} mm is found in {ROUNDS} rounds ({len(uv):,} nodes): ask for more, or "
                     "look for an outline with pieces shorter than a micrometre")


@dataclass(frozen=True, slots=True, eq=False)
class _Metric:
    """(u, v) -> (U, V) = (∫du/h_u, ∫dv/h_v), where one unit each way is a step that holds the deflection.

    A triangle misses a surface by ½·Σ λ_i·(p − p_i)ᵀ·B·(p − p_i) at p = Σ λ_i·p_i, with B = S_ij·N. With the steps
    h_u² = 8·share·deflection/max(|B_uu| + |B_uv|), h_v likewise, B is below 8·share·deflection in (U, V), so that a
    triangle in a circle of radius ρ misses by at most 4·ρ²·share·deflection.
    """

    u: Array
    v: Array
    big_u: Array
    big_v: Array
    facets: float

    @staticmethod
    def of(faces: tuple[BSplineSurface, ...], outline: Outline, deflection_mm: float) -> _Metric:
        x_min, x_max, y_min, y_max = outline.bounding_box()
        u, v = np.linspace(x_min, x_max, SAMPLES), np.linspace(y_min, y_max, SAMPLES)
        bend_u, bend_v = np.zeros(SAMPLES), np.zeros(SAMPLES)
        for face in faces:
            d = face.on_grid(u, v)
            normal = normals(d["u"], d["v"])
            uu, uv, vv = (np.abs(np.einsum("mni,mni->mn", d[key], normal)) for key in ("uu", "uv", "vv"))
            bend_u = np.maximum(bend_u, (uu + uv).max(axis=1))
            bend_v = np.maximum(bend_v, (vv + uv).max(axis=0))
        largest = LARGEST_STEP * max(x_max - x_min, y_max - y_min)
        tiny = 8.0 * LATTICE_SHARE * deflection_mm / largest**2
        step_u, step_v = (np.sqrt(8.0 * LATTICE_SHARE * deflection_mm / np.maximum(bend, tiny)) for bend in (bend_u, bend_v))
        step_u, step_v = (np.minimum(step_u, LONGEST_FACET * step_v.min()), np.minimum(step_v, LONGEST_FACET * step_u.min()))
        big_u, big_v = (_integral(at, 1.0 / _graded(at, step)) for at, step in ((u, step_u), (v, step_v)))
        share = outline.area_mm2() / ((x_max - x_min) * (y_max - y_min))
        return _Metric(u, v, big_u, big_v, 4.0 / np.sqrt(3.0) * share * float(big_u[-1] * big_v[-1]))

    def __call__(self, uv: Array) -> Array:
        return np.stack([np.interp(uv[:, 0], self.u, self.big_u), np.interp(uv[:, 1], self.v, self.big_v)], axis=1)

    def lattice(self, outline: Outline, rim: _Rim) -> Array:
        """Nodes (u, v) of a hexagonal lattice of unit edges in the metric, inside the outline and clear of the rim."""
        rows = np.arange(0.0, self.big_v[-1], np.sqrt(0.75))
        columns = np.arange(0.0, self.big_u[-1], 1.0)
        big_u, big_v = np.broadcast_arrays(columns + 0.5 * (np.arange(len(rows))[:, None] % 2), rows[:, None])
        nodes = np.stack([big_u.ravel(), big_v.ravel()], axis=1)
        uv = np.stack([np.interp(nodes[:, 0], self.big_u, self.u), np.interp(nodes[:, 1], self.big_v, self.v)], axis=1)
        within = outline.contains(uv[:, 0], uv[:, 1])
        nodes, uv = nodes[within], uv[within]
        ends = self(rim.uv)
        points = np.concatenate([ends, 0.5 * (ends + np.roll(ends, -1, axis=0))])
        clear: Array = uv[cKDTree(points).query(nodes)[0] >= CLEARANCE] if len(nodes) else uv
        return clear


def _graded(at: Array, step: Array) -> Array:
    """The largest steps that are nowhere above the given ones and change by GRADING per mm at most."""
    result: Array = (step + GRADING * np.abs(at[:, None] - at)).min(axis=1)
    return result


def _integral(at: Array, values: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(0.5 * np.diff(at) * (values[1:] + values[:-1]))])


@dataclass(frozen=True, slots=True, eq=False)
class _Rim:
    """The nodes on the outline, counter-clockwise: keys (n,) segment + s with s in [0, 1), rising, and their (u, v)."""

    segments: tuple[Segment, ...]
    keys: Array
    uv: Array

    @staticmethod
    def of(faces: tuple[BSplineSurface, ...], outline: Outline, metric: _Metric, deflection_mm: float) -> _Rim:
        """Edges halved until each is at most LONGEST_RIM in the metric and its sides hold RIM_SHARE of the deflection."""
        segments = outline.segments
        keys = np.concatenate([i + _first_parameters(segment) for i, segment in enumerate(segments)])
        rim = _Rim(segments, keys, _points(segments, keys))
        fresh = np.arange(len(keys))
        while len(fresh):
            wide = fresh[rim._strays(faces, fresh, metric, RIM_SHARE * deflection_mm)]
            halved = rim.halved(wide)
            middles = 0.5 * (rim.keys[wide] + rim._ends()[wide])
            fresh = np.searchsorted(halved.keys, np.sort(np.concatenate([rim.keys[wide], middles])))
            rim = halved
            if len(rim.keys) > MAX_FACETS:
                raise WriteError(f"a deflection of {deflection_mm:.2g} mm takes more than {MAX_FACETS:,} edges around this "
                                 "outline: ask for more, or for a simpler outline")
        return rim

    def halved(self, edges: Indices) -> _Rim:
        """With a node in the middle of each of these edges, which are numbered by their first node."""
        middles = np.sort(0.5 * (self.keys[edges] + self._ends()[edges]))
        at = np.searchsorted(self.keys, middles)
        return _Rim(self.segments, np.insert(self.keys, at, middles),
                    np.insert(self.uv, at, _points(self.segments, middles), axis=0))

    def _ends(self) -> Array:
        return np.append(self.keys[1:], float(len(self.segments)))

    def _strays(self, faces: tuple[BSplineSurface, ...], edges: Indices, metric: _Metric, allowed_mm: float) -> Flags:
        start, end = self.uv[edges], np.roll(self.uv, -1, axis=0)[edges]
        strays: Flags = np.linalg.norm(metric(end) - metric(start), axis=1) > LONGEST_RIM
        first, last = self.keys[edges], self._ends()[edges]
        inner = [_points(self.segments, first + share * (last - first)) for share in (0.25, 0.5, 0.75)]
        corners = []
        for face in faces:
            a, b = face.evaluate(*start.T), face.evaluate(*end.T)
            along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
            for point in inner:
                strays |= np.linalg.norm(np.cross(face.evaluate(*point.T) - a, along), axis=1) > allowed_mm
            corners += [a, b]
        # The two triangles of a side meet in its diagonal, whose middle lies off the ruled side that is twisted.
        a, b, behind_a, behind_b = corners
        outward = np.cross(b - a, a - behind_a)
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        twist = 0.25 * np.abs(np.einsum("ni,ni->n", (a - b) - (behind_a - behind_b), outward))
        return strays | (twist > allowed_mm)


def _first_parameters(segment: Segment) -> Array:
    """Where a segment is cut before anything is measured: an arc every 60° at least, a spline several times a span."""
    if isinstance(segment, Arc):
        return np.linspace(0.0, 1.0, int(np.ceil(abs(segment.sweep) / (np.pi / 3.0))) + 1)[:-1]
    if isinstance(segment, Spline):
        ends = np.unique(segment.knots)
        inner = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(segment.degree + 1) / (segment.degree + 1)
        result: Array = (inner.ravel() - ends[0]) / (ends[-1] - ends[0])
        return result
    return np.zeros(1)


def _points(segments: tuple[Segment, ...], keys: Array) -> Array:
    """The points (n, 2) of the outline at keys, which may come in any order."""
    points = np.empty((len(keys), 2))
    # A key that rounding puts on the next integer is the segment's end.
    owner = np.minimum(keys.astype(np.int64), len(segments) - 1)
    order = np.argsort(owner, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(owner[order])) + 1) if len(order) else ():
        i = int(owner[group[0]])
        points[group] = segments[i].point(np.clip(keys[group] - i, 0.0, 1.0))
    return points


def _edges_to_halve(faces: tuple[BSplineSurface, ...], uv: Array, triangles: Indices, metric: _Metric,
                    deflection_mm: float) -> Indices:
    """Of each triangle that misses a face in the middle of an edge or its own, the longest edge: (n, 2) nodes, rising.

    The miss in a triangle's middle is 4/9 of the sum of those at its edges, to second order.
    """
    start, end = sides_of(triangles)
    codes, where = np.unique(np.minimum(start, end) * len(uv) + np.maximum(start, end), return_inverse=True)
    edges = np.stack(np.divmod(codes, len(uv)), axis=1)
    of_triangle = where.reshape(-1, 3)
    middles = uv[edges].mean(axis=1)
    missed = np.zeros(len(triangles))
    for face in faces:
        nodes = face.evaluate(uv[:, 0], uv[:, 1])
        gap = nodes[edges].mean(axis=1) - face.evaluate(middles[:, 0], middles[:, 1])
        a, b, c = (nodes[triangles[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        at_edges = np.einsum("nki,ni->nk", gap[of_triangle], normal)
        missed = np.maximum(missed, np.maximum(np.abs(at_edges).max(axis=1), 4.0 / 9.0 * np.abs(at_edges.sum(axis=1))))
    bad = (missed > HELD * deflection_mm) | (doubled_area(uv, triangles) <= 0.0)
    big = metric(uv)
    length = np.linalg.norm(big[edges[:, 0]] - big[edges[:, 1]], axis=1)
    longest = np.argmax(length[of_triangle[bad]], axis=1)
    return edges[np.unique(of_triangle[bad][np.arange(len(longest)), longest])]


def _rim_edges(edges: Indices, rim: int) -> tuple[Flags, Indices]:
    """Which of the edges (n, 2), nodes rising, are the rim's, and the first nodes of those."""
    closing = (edges[:, 0] == 0) & (edges[:, 1] == rim - 1)
    on_rim = ((edges[:, 1] - edges[:, 0] == 1) & (edges[:, 1] < rim)) | closing
    return on_rim, np.where(closing, rim - 1, edges[:, 0])[on_rim]


def _closed(faces: tuple[BSplineSurface, ...], uv: Array, triangles: Indices, rim: int) -> SurfaceMesh:
    """Front, back and sides as one mesh. Raises: WriteError where the triangles do not fill the rim."""
    x, y = uv[:rim].T
    wanted = 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    filled = 0.5 * float(doubled_area(uv, triangles).sum())
    if not abs(filled - wanted) <= 1e-9 * wanted:
        raise WriteError(f"the mesh fills {filled:.9g} mm² of the {wanted:.9g} mm² inside the outline's {rim} nodes: "
                         "look for pieces shorter than a micrometre")
    vertices = np.concatenate([face.evaluate(uv[:, 0], uv[:, 1]) for face in faces])
    behind = len(uv)
    a = np.arange(rim)
    b = (a + 1) % rim
    sides = np.concatenate([np.stack([a, a + behind, b + behind], axis=1), np.stack([a, b + behind, b], axis=1)])
    return SurfaceMesh(vertices, np.concatenate([triangles, triangles[:, ::-1] + behind, sides]).astype(np.int32))
