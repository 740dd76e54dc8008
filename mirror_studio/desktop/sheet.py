"""Triangulate a surface inside its trimming loops, with exact normals and curvatures at the corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from mirror_cad.curvature_fields import differences, in_percent
from mirror_cad.designed import DesignedCurvature
from mirror_cad.errors import SurfaceError
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import ShapeOperator, normals, principal_curvatures_of, shape_operator
from mirror_cad.surfaces.quadric import Quadric

Array = NDArray[np.float64]

CELLS = 120  # across the longer side: some 2 mm on a truck's mirror, finer than a screen shows of a map
CORNER_DEG = 5.0  # a loop that turns by more at one point keeps that point
NEAR_RIM = 0.6  # of a cell: nodes of the inner lattice keep this far from the rim, which has its own
FLAT_PER_MM = 1e-9  # a radius of 1000 km: drawn as none
UNITS = {"Rx": "mm", "Ry": "mm", "k1": "1/m", "k2": "1/m", "Ka": "1/m", "Km": "1/m", "deviation": "%", "deviation_k1": "%",
         "deviation_k2": "%"}


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """vertices, normals (n, 3); faces (m, 3), counter-clockwise as the driver looks; fields (n,) each, in UNITS.

    Rx, Ry : radii of the normal sections along x and y, NaN where flat.   k1 ≥ k2 : principal curvatures.   Ka, Km : of
    eq. 1.   deviation : of the whole shape operator from the design, of k1 and of k2, where there is a design.
    """

    vertices: Array
    normals: Array
    faces: NDArray[np.int64]
    fields: dict[str, Array]


def sheet(surface: BSplineSurface, loops: tuple[Array, ...], curvature: DesignedCurvature | None = None,
          rms: float = 0.0, quadric: Quadric | None = None) -> Sheet:
    """The part of a surface inside loops (closed polygons in (u, v), even-odd).

    Normals look towards the driver (their mean z is positive), whichever way the surface runs. curvature, rms : the design
    and its RMS, 1/mm, for a surface with u = x, v = y.   quadric : what the surface is, where it is one: normals and
    curvatures are then closed forms, which hold at a sphere's pole too. Raises: SurfaceError where nothing lies inside.
    """
    uv, faces = _triangles(surface, loops)
    domain = surface.domain
    u, v = np.clip(uv[:, 0], *domain[:2]), np.clip(uv[:, 1], *domain[2:])
    if quadric is not None:
        points = surface.evaluate(u, v)
        normal, w = _of_quadric(quadric, points)
        corners = points[faces]
        turned = np.einsum("ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
                           normal[faces[:, 0]]).sum() < 0.0
        return Sheet(points, normal, faces[:, ::-1] if turned else faces, _fields(w, points[:, 0], None, 0.0))
    d = surface.derivatives(u, v)
    if normals(d["u"], d["v"])[:, 2].mean() < 0.0:
        d |= {"u": d["v"], "v": d["u"], "uu": d["vv"], "vv": d["uu"]}
        faces = faces[:, ::-1]
    realised = shape_operator(d)
    return Sheet(d["s"], normals(d["u"], d["v"]), faces, _fields(realised, d["s"][:, 0], curvature, rms))


def _of_quadric(quadric: Quadric, points: Array) -> tuple[Array, ShapeOperator]:
    """Unit normals (n, 3) whose mean looks along +z, and W in the frame of `ShapeOperator`: (1/R)·t⊗t over the bent t."""
    from_centre, axis = points - quadric.centre, quadric.axes[2]
    if quadric.kind == "plane":
        normal = np.broadcast_to(axis, points.shape).copy()
    else:
        outward = from_centre if quadric.kind == "sphere" else from_centre - np.outer(from_centre @ axis, axis)
        normal = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    side = 1.0 if normal[:, 2].mean() >= 0.0 else -1.0
    kappa = 0.0 if quadric.kind == "plane" else side / quadric.radius_mm
    normal *= side
    e2 = np.stack([np.zeros(len(points)), normal[:, 2], -normal[:, 1]], axis=1)
    e2 /= np.linalg.norm(e2, axis=1, keepdims=True)
    bent = np.ones((2, len(points))), np.zeros(len(points))
    if quadric.kind == "cylinder":
        around = np.cross(axis, normal)
        first, second = (np.einsum("ij,ij->i", around, e) for e in (np.cross(e2, normal), e2))
        bent = np.stack([first**2, second**2]), first * second
    return normal, ShapeOperator(kappa * bent[0][0], kappa * bent[0][1], kappa * bent[1])


def _fields(w: ShapeOperator, x: Array, curvature: DesignedCurvature | None, rms: float) -> dict[str, Array]:
    k1, k2 = principal_curvatures_of(w)
    fields = {"Rx": _radius(w.w11), "Ry": _radius(w.w22), "k1": 1e3 * k1, "k2": 1e3 * k2, "Ka": 0.5e3 * (w.w11 - w.w22),
              "Km": 0.5e3 * (w.w11 + w.w22)}
    if curvature is not None and rms > 0.0:
        designed = curvature.shape(x)
        off = differences(w, designed)
        fields["deviation"] = 100.0 * np.sqrt(off.kx**2 + off.ky**2 + 2.0 * off.twist**2) / rms
        percent = in_percent(off, designed, rms)
        fields |= {"deviation_k1": percent.k1, "deviation_k2": percent.k2}
    return fields


def _radius(kappa: Array) -> Array:
    flat = np.abs(kappa) < FLAT_PER_MM
    return np.where(flat, np.nan, 1.0 / np.where(flat, 1.0, kappa))


def _triangles(surface: BSplineSurface, loops: tuple[Array, ...]) -> tuple[Array, NDArray[np.int64]]:
    """Nodes (n, 2) in (u, v) and triangles of them, counter-clockwise there: Delaunay's over the rim and a lattice."""
    around = np.concatenate(loops)
    low, high = around.min(axis=0), around.max(axis=0)
    domain = np.array(surface.domain).reshape(2, 2)
    middle = surface.derivatives(*np.clip(0.5 * (low + high), domain[:, 0], domain[:, 1]))
    scale = np.array([np.linalg.norm(middle["u"]), np.linalg.norm(middle["v"])])  # parameters may be radians
    if not (scale > 0.0).all():
        raise SurfaceError("the surface has no tangent plane in its middle, and cannot be shown")
    cell = float(((high - low) * scale).max()) / CELLS
    rim = [_even(loop * scale, cell) for loop in loops]
    along = (np.arange(a + 0.5 * cell, b, cell) for a, b in zip(low * scale, high * scale, strict=True))
    lattice = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, 2)
    edges = np.concatenate([np.hstack([loop, np.roll(loop, -1, axis=0)]) for loop in rim])
    keep = _inside(edges, lattice)
    keep[keep] = _distance(edges, lattice[keep]) > NEAR_RIM * cell
    nodes = np.concatenate([*rim, lattice[keep]])
    faces = Delaunay(nodes).simplices.astype(np.int64)
    corners = nodes[faces]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    turn = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    faces[turn < 0.0] = faces[turn < 0.0][:, ::-1]
    faces = faces[_inside(edges, corners.mean(axis=1)) & (np.abs(turn) > 1e-9 * cell**2)]
    if len(faces) == 0:
        raise SurfaceError("nothing lies inside the face's edges")
    return nodes / scale, faces


def _even(loop: Array, cell: float) -> Array:
    """A closed polygon with its corners kept, its short edges joined and its long ones divided to about a cell."""
    before, after = loop - np.roll(loop, 1, axis=0), np.roll(loop, -1, axis=0) - loop
    turn = np.abs(np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1)))
    length = np.linalg.norm(after, axis=1)
    along = np.concatenate([[0.0], np.cumsum(length)])
    corner = turn > np.radians(CORNER_DEG)
    # Both ends of a straight side: a chord from a point before it would run beside all of it.
    side = length >= cell
    step = np.floor(along[:-1] / cell)
    kept = loop[corner | side | np.roll(side, 1) | (step != np.concatenate([[-1.0], step[:-1]]))]
    parts = []
    for start, end in zip(kept, np.roll(kept, -1, axis=0), strict=True):
        pieces = max(1, round(float(np.linalg.norm(end - start)) / cell))
        parts.append(start + (end - start) * (np.arange(pieces) / pieces)[:, None])
    return np.concatenate(parts)


def _inside(edges: Array, points: Array) -> NDArray[np.bool_]:
    """Whether an odd number of edges (m, 4) lies to the right of each place (n, 2)."""
    result = np.zeros(len(points), dtype=bool)
    order = np.argsort(points[:, 1])
    x, y = points[order].T
    inside = np.zeros(len(points), dtype=bool)
    for x0, y0, x1, y1 in edges:
        here = slice(*np.searchsorted(y, sorted((y0, y1))))
        if here.stop > here.start:
            inside[here] ^= x[here] < x0 + (y[here] - y0) * ((x1 - x0) / (y1 - y0))
    result[order] = inside
    return result


def _distance(edges: Array, points: Array) -> Array:
    """From each place to the nearest edge's nearest end or middle: edges are about a cell long."""
    from scipy.spatial import cKDTree

    ends = np.concatenate([edges[:, :2], 0.5 * (edges[:, :2] + edges[:, 2:])])
    distance: Array = cKDTree(ends).query(points)[0]
    return distance
