"""Faces of solids in, triangles with the surfaces' own normals out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import build123d as bd
import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.BRepTools import BRepTools
from OCP.Geom import Geom_BSplineSurface
from OCP.GeomLProp import GeomLProp_SLProps
from OCP.IMeshTools import IMeshTools_Parameters
from OCP.TopAbs import TopAbs_REVERSED
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Compound, TopoDS_Edge

from .remesh import relaid

Array = NDArray[np.float64]
Index = NDArray[np.int64]

DARK = ("trim", "gloss")  # materials on which a changing share of sky does not show: long edges stay
SLIVER = 20.0  # mm²: a face that the mesher may find nothing in
FLAT = 1e-9  # a surface's derivatives shorter than this have no normal


@dataclass(frozen=True, slots=True)
class Fineness:
    """How closely triangles follow a surface: distance [mm] and angle [rad] along edges, and the longest edge [mm].

    size, turn : greatest distance [mm] and angle [rad] between neighbouring nodes inside a B-spline face.
    """

    deflection: float
    angle: float
    longest: float
    size: float = 120.0
    turn: float = 0.3


COARSE = Fineness(4.0, 0.4, 1000.0)  # enough to find a point inside a face


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """Triangles of one material: places (n, 3) mm, unit normals (n, 3), faces (m, 3), texture coordinates (n, 2) or None."""

    material: str
    points: Array
    normals: Array
    faces: Index
    uv: Array | None = None

    def mirrored(self) -> Patch:
        """The patch on the other side of the median plane."""
        flip = np.array([1.0, -1.0, 1.0])
        return Patch(self.material, self.points * flip, self.normals * flip, self.faces[:, ::-1], self.uv)

    def wound(self) -> Patch:
        """The patch with every triangle anticlockwise as seen from where its normals point."""
        corners = self.points[self.faces]
        area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        away = (area * self.normals[self.faces].sum(axis=1)).sum(axis=1) < 0.0
        faces = np.where(away[:, None], self.faces[:, ::-1], self.faces)
        return Patch(self.material, self.points, self.normals, faces, self.uv)

    def moved(self, by: Sequence[float]) -> Patch:
        """The patch shifted [mm]."""
        return Patch(self.material, self.points + np.asarray(by), self.normals, self.faces, self.uv)


@dataclass(frozen=True, slots=True, eq=False)
class Seam:
    """An edge between two pieces at different depths, the deeper of them before it was moved, and the two shifts [mm]."""

    edge: TopoDS_Edge
    piece: bd.Face
    near: Array
    far: Array
    material: str


def tessellated(faces: Sequence[tuple[bd.Face, str]], fine: Fineness) -> list[Patch]:
    """A patch a face; faces that share an edge share its points."""
    _mesh([face for face, _ in faces], fine)
    return [patch for face, material in faces if (patch := _patch(face, material, fine)) is not None]


def walls(seams: Sequence[Seam]) -> list[Patch]:
    """A patch a seam: the seam's edge as the mesher divided it, swept from near to far, facing the deeper piece."""
    return [_wall(seam) for seam in seams]


def _wall(seam: Seam) -> Patch:
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(seam.piece.wrapped, location)
    nodes = np.array(list(BRep_Tool.PolygonOnTriangulation_s(seam.edge, mesh, location).Nodes()), dtype=np.int64)
    line = np.array([(node.X(), node.Y(), node.Z()) for node in (mesh.Node(int(i)) for i in nodes)])
    segment = seam.far - seam.near
    tangents = np.gradient(line, axis=0)
    normals = np.cross(tangents, segment)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    # The third corner of the piece's triangle at the first segment tells which side the piece lies on.
    first = {int(nodes[0]), int(nodes[1])}
    third = next(corner for number in range(1, mesh.NbTriangles() + 1) if first <= set(mesh.Triangle(number).Get())
                 for corner in mesh.Triangle(number).Get() if corner not in first)
    node = mesh.Node(third)
    if normals[0] @ (np.array((node.X(), node.Y(), node.Z())) - line[0]) < 0.0:
        normals = -normals
    n = len(line)
    k = np.arange(n - 1)
    faces = np.vstack([np.column_stack([k, k + 1, k + n]), np.column_stack([k + 1, k + 1 + n, k + n])])
    points = np.vstack([line + seam.near, line + seam.far])
    return Patch(seam.material, points, np.vstack([normals, normals]), faces).wound()


def solid(shape: bd.Shape, material: str, fine: Fineness) -> list[Patch]:
    """The patches of a whole shape of one material."""
    return tessellated([(face, material) for face in shape.faces()], fine)


def together(faces: Iterable[bd.Face]) -> TopoDS_Compound:
    """The faces as one shape of the kernel."""
    compound = TopoDS_Compound()
    builder = BRep_Builder()
    builder.MakeCompound(compound)
    for face in faces:
        builder.Add(compound, face.wrapped)
    return compound


def _mesh(faces: Sequence[bd.Face], fine: Fineness) -> None:
    compound = together(faces)
    BRepTools.Clean_s(compound)
    parameters = IMeshTools_Parameters()
    parameters.Deflection = parameters.DeflectionInterior = fine.deflection
    parameters.Angle = parameters.AngleInterior = fine.angle
    parameters.Relative = False
    parameters.InParallel = False
    BRepMesh_IncrementalMesh(compound, parameters)


def _raw(face: bd.Face) -> tuple[Array, Array, Index] | None:
    """Places, surface parameters and triangles (in the sense of the surface's own normal) of a meshed face."""
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face.wrapped, location)
    if mesh is None:
        return None
    move = location.Transformation()
    nodes = [mesh.Node(i).Transformed(move) for i in range(1, mesh.NbNodes() + 1)]
    flat = [mesh.UVNode(i) for i in range(1, mesh.NbNodes() + 1)]
    triangles = [mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)]
    return (np.array([(node.X(), node.Y(), node.Z()) for node in nodes]), np.array([(uv.X(), uv.Y()) for uv in flat]),
            np.array(triangles, dtype=np.int64) - 1)


def _patch(face: bd.Face, material: str, fine: Fineness) -> Patch | None:
    raw = _raw(face)
    if raw is None:
        if face.area > SLIVER:
            raise RuntimeError(f"the mesher failed on a face of {face.area:.0f} mm² ({material}) about {face.center()}")
        return None
    points, uv, triangles = raw
    sizes = np.linalg.norm(np.cross(points[triangles[:, 1]] - points[triangles[:, 0]],
                                    points[triangles[:, 2]] - points[triangles[:, 0]]), axis=1)
    triangles = triangles[sizes > 1e-9]
    surface = BRep_Tool.Surface_s(face.wrapped)
    if isinstance(surface, Geom_BSplineSurface):
        points, uv, triangles = relaid(surface, points, uv, triangles, fine.size, fine.turn) or (points, uv, triangles)
    if material not in DARK:
        points, uv, triangles = _refined(points, uv, triangles, fine.longest)
    reverse = face.wrapped.Orientation() == TopAbs_REVERSED
    normals = _normals(surface, uv, -1.0 if reverse else 1.0)
    if reverse:
        triangles = triangles[:, ::-1]
    bare = np.isnan(normals[:, 0])
    if bare.any():  # a pole: the mean of what lies around it
        normals[bare] = _averages(points, triangles)[bare]
    # Slivers along an outline whose curves in space and in the parameters differ by the kernel's tolerance may be turned.
    return Patch(material, points, normals, triangles).wound()


def _normals(surface: object, uv: Array, sign: float) -> Array:
    out = np.full((len(uv), 3), np.nan)
    local = GeomLProp_SLProps(surface, 1, FLAT)
    for row, (u, v) in enumerate(uv):
        local.SetParameters(float(u), float(v))
        if local.IsNormalDefined():
            normal = local.Normal()
            out[row] = sign * normal.X(), sign * normal.Y(), sign * normal.Z()
    return out


def _averages(points: Array, triangles: Index) -> Array:
    total = np.zeros_like(points)
    corners = points[triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for corner in range(3):
        np.add.at(total, triangles[:, corner], area)
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]


def _refined(points: Array, uv: Array, triangles: Index, longest: float) -> tuple[Array, Array, Index]:
    """Halve edges until none is longer; both faces beside an edge halve it at the same place, so no gap opens.

    The halves keep the triangle's plane (it is within the deflection of the surface) and get the surface's normals.
    """
    while True:
        edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1).reshape(-1, 3)
        split = lengths.max(axis=1) > longest
        if not split.any():
            return points, uv, triangles
        # Every edge that is too long is halved at once; a triangle with one, two or three such edges makes 2, 3 or 4.
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        index = index.reshape(-1, 3)
        too_long = np.linalg.norm(points[unique[:, 0]] - points[unique[:, 1]], axis=1) > longest
        number = np.full(len(unique), -1)
        number[too_long] = len(points) + np.arange(too_long.sum())
        points = np.vstack([points, 0.5 * (points[unique[too_long, 0]] + points[unique[too_long, 1]])])
        uv = np.vstack([uv, 0.5 * (uv[unique[too_long, 0]] + uv[unique[too_long, 1]])])
        triangles = np.array([new for triangle, middle in zip(triangles.tolist(), number[index].tolist(), strict=True)
                              for new in _cut(triangle, middle)], dtype=np.int64)


def _cut(triangle: list[int], middle: list[int]) -> list[tuple[int, int, int]]:
    """The pieces of a triangle whose edges (01, 12, 20) have the middle points given, −1 for none."""
    for turn in range(3):  # so that the case below begins with its odd edge
        a, b, c = (triangle[(turn + k) % 3] for k in range(3))
        ab, bc, ca = (middle[(turn + k) % 3] for k in range(3))
        given = (ab >= 0, bc >= 0, ca >= 0)
        if given == (True, True, True):
            return [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        if given == (True, False, False):
            return [(a, ab, c), (ab, b, c)]
        if given == (True, True, False):
            return [(ab, b, bc), (a, ab, bc), (a, bc, c)]
    return [(triangle[0], triangle[1], triangle[2])]


def inner_point(face: bd.Face) -> Array:
    """A point of a face, well inside: that at the middle of its largest triangle."""
    _mesh([face], COARSE)
    raw = _raw(face)
    if raw is None:
        return np.array(tuple(face.center()))
    points, uv, triangles = raw
    corners = points[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    u, v = uv[triangles[int(np.argmax(area))]].mean(axis=0)
    point = BRep_Tool.Surface_s(face.wrapped).Value(float(u), float(v))
    return np.array([point.X(), point.Y(), point.Z()])


def merged(patches: Iterable[Patch]) -> list[Patch]:
    """One patch a material, in the order of their first appearance, equal vertices as one."""
    together: dict[str, list[Patch]] = {}
    for patch in patches:
        together.setdefault(patch.material, []).append(patch)
    return [_joined(material, parts) for material, parts in together.items()]


def _joined(material: str, parts: list[Patch]) -> Patch:
    offsets = np.cumsum([0, *(len(part.points) for part in parts)])
    points = np.concatenate([part.points for part in parts])
    normals = np.concatenate([part.normals for part in parts])
    faces = np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=False)])
    uv = None if parts[0].uv is None else np.concatenate([part.uv for part in parts if part.uv is not None])
    columns = [np.round(points * 1e3), np.round(normals * 1e3)] + ([] if uv is None else [np.round(uv * 1e6)])
    _, first, index = np.unique(np.hstack(columns) + 0.0, axis=0, return_index=True, return_inverse=True)
    # Keep the order of appearance: neighbours in the file stay neighbours.
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    kept = first[order]
    faces = rank[index.reshape(-1)][faces]
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    used, faces = np.unique(faces[whole], return_inverse=True)
    kept = kept[used]
    return Patch(material, points[kept], normals[kept], faces.reshape(-1, 3), None if uv is None else uv[kept])
