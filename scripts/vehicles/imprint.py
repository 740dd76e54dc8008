"""Faces of a body and outlines seen from a side in, the faces cut along them, some pieces sunk or raised, out.

What a car's front shows is relief in one direction: lamps, grille and number plate lie somewhat behind or before the body's
own surface and repeat its shape. So a piece within an outline is shifted along the line of sight, and every edge between
pieces of different depth is extruded to the wall between them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import build123d as bd
import numpy as np
from numpy.typing import ArrayLike, NDArray
from OCP.BRep import BRep_Builder
from OCP.BRepAlgoAPI import BRepAlgoAPI_Splitter
from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
from OCP.gp import gp_Vec
from OCP.TopAbs import TopAbs_EDGE, TopAbs_EXTERNAL, TopAbs_INTERNAL
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS, TopoDS_Iterator
from OCP.TopTools import TopTools_IndexedMapOfShape, TopTools_ListOfShape

from .tessellate import Seam, inner_point, together

Array = NDArray[np.float64]

# View -> the two axes that an outline is drawn in, the axis of sight and the direction from the viewer to the body.
VIEWS = {"front": (1, 2, 0, 1.0), "rear": (1, 2, 0, -1.0), "side": (0, 2, 1, -1.0), "top": (0, 1, 2, -1.0)}
LEVEL = 0.5  # mm: pieces whose depths differ less have no wall between them
HOLE = 100.0  # mm: a wall this deep is the hole's, a lower one belongs to what stands out
ON_MEDIAN = 0.01  # mm: an edge this close to the median plane has its other half beyond it


@dataclass(frozen=True, slots=True, eq=False)
class Inlay:
    """A region of a body's surface with a material of its own, depth mm behind the surface (negative: before it).

    region : face in the plane Z = 0 of the view's two coordinates (front, rear: Y, Z; side: X, Z; top: X, Y).
    low, high : along the axis of sight, where the region holds.
    """

    material: str
    view: str
    region: bd.Face
    low: float
    high: float
    depth: float = 0.0

    def sides(self) -> list[bd.Face]:
        """The faces that the region's outline sweeps from low to high."""
        first, second, sight, _ = VIEWS[self.view]
        x_dir, y_dir, axis = np.eye(3)[first], np.eye(3)[second], np.eye(3)[sight]
        plane = bd.Plane(origin=tuple(axis * self.low), x_dir=tuple(x_dir), z_dir=tuple(np.cross(x_dir, y_dir)))
        placed = plane * self.region
        return [swept(edge, axis * (self.high - self.low)) for edge in placed.edges()]

    def holds(self, point: Array) -> bool:
        """Whether a point lies in the region."""
        first, second, sight, _ = VIEWS[self.view]
        inside = self.low <= point[sight] <= self.high
        return inside and self.region.is_inside(bd.Vector(float(point[first]), float(point[second]), 0.0))

    def shift(self) -> Array:
        """The way from the surface to the inlay."""
        _, _, sight, towards = VIEWS[self.view]
        return np.asarray(np.eye(3)[sight] * towards * self.depth)


@dataclass(frozen=True, slots=True, eq=False)
class Relief:
    """Faces with their materials, and the seams between those of different depth."""

    faces: list[tuple[bd.Face, str]]
    seams: list[Seam]


def polygon(points: ArrayLike, radius: float = 0.0) -> bd.Face:
    """The region within a closed polygon (n, 2), its corners rounded."""
    corners = [tuple(float(value) for value in point) for point in np.asarray(points)]
    face = bd.Face(bd.Wire.make_polygon([(*corner, 0.0) for corner in corners], close=True))
    if face.normal_at().Z < 0.0:
        return polygon(corners[::-1], radius)
    return face.fillet_2d(radius, face.vertices()) if radius else face


def rectangle(a: tuple[float, float], b: tuple[float, float]) -> bd.Face:
    """The region between two values of either coordinate."""
    return polygon([(a[0], b[0]), (a[1], b[0]), (a[1], b[1]), (a[0], b[1])])


def disc(centre: tuple[float, float], radius: float) -> bd.Face:
    """The region within a circle."""
    return bd.Pos(*centre, 0.0) * bd.Circle(radius).faces()[0]


def grown(region: bd.Face, by: float) -> bd.Face:
    """The region with its outline offset outward."""
    return bd.offset(region, amount=by, kind=bd.Kind.ARC).faces()[0]


def stroke(points: ArrayLike, width: float) -> bd.Face:
    """The band of a width along an open polyline (n, 2)."""
    line = np.asarray(points, dtype=np.float64)
    steps = np.diff(line, axis=0)
    normals = np.column_stack([-steps[:, 1], steps[:, 0]]) / np.linalg.norm(steps, axis=1)[:, None]
    joints = np.vstack([normals[:1], normals[:-1] + normals[1:], normals[-1:]])
    length = np.concatenate([[1.0], 1.0 + (normals[:-1] * normals[1:]).sum(axis=1), [1.0]])
    shift = 0.5 * width * joints / length[:, None]
    return polygon(np.vstack([line + shift, (line - shift)[::-1]]))


def swept(edge: bd.Edge, direction: Array) -> bd.Face:
    """The face that an edge sweeps."""
    return bd.Face(TopoDS.Face_s(BRepPrimAPI_MakePrism(edge.wrapped, gp_Vec(*direction)).Shape()))


def cut(faces: Iterable[bd.Face], tools: Iterable[bd.Face]) -> list[bd.Face]:
    """The pieces of faces between the curves along which tools meet them."""
    arguments, knives = TopTools_ListOfShape(), TopTools_ListOfShape()
    arguments.Append(together(faces))
    for tool in tools:
        knives.Append(tool.wrapped)
    splitter = BRepAlgoAPI_Splitter()
    splitter.SetArguments(arguments)
    splitter.SetTools(knives)
    splitter.Build()
    if not splitter.IsDone():
        raise RuntimeError("the body's faces could not be cut along the outlines")
    return [_without_loose_ends(face) for face in bd.Compound(splitter.Shape()).faces()]


def _without_loose_ends(face: bd.Face) -> bd.Face:
    """The face without cuts that end inside it: the mesher fails on them."""
    wires = TopoDS_Iterator(face.wrapped)
    kept, loose = [], False
    while wires.More():
        edges = TopExp_Explorer(wires.Value(), TopAbs_EDGE)
        if edges.More() and edges.Current().Orientation() in (TopAbs_INTERNAL, TopAbs_EXTERNAL):
            loose = True
        else:
            kept.append(wires.Value())
        wires.Next()
    if not loose:
        return face
    bare = face.wrapped.EmptyCopied()
    builder = BRep_Builder()
    for wire in kept:
        builder.Add(bare, wire)
    return bd.Face(TopoDS.Face_s(bare))


def imprinted(pieces: Sequence[tuple[bd.Face, str]], inlays: Sequence[Inlay]) -> Relief:
    """Pieces cut along the inlays before, each moved to its depth, with its material, and the walls between the depths.

    A piece comes with the material that it has outside all inlays; the last inlay that holds it counts.
    """
    owners: list[Inlay | None] = []
    faces = []
    for piece, base in pieces:
        point = inner_point(piece)
        owner = next((inlay for inlay in reversed(inlays) if inlay.holds(point)), None)
        owners.append(owner)
        moved = piece if owner is None or owner.depth == 0.0 else piece.moved(bd.Location(tuple(owner.shift())))
        faces.append((moved, base if owner is None else owner.material))
    return Relief(faces, _seams([piece for piece, _ in pieces], owners))


def _seams(pieces: Sequence[bd.Face], owners: Sequence[Inlay | None]) -> list[Seam]:
    edges = TopTools_IndexedMapOfShape()
    users: dict[int, list[int]] = defaultdict(list)
    for number, piece in enumerate(pieces):
        explorer = TopExp_Explorer(piece.wrapped, TopAbs_EDGE)
        while explorer.More():
            users[edges.Add(explorer.Current())].append(number)
            explorer.Next()
    seams = []
    for key, beside in users.items():
        if len(beside) != 2:
            continue
        (near, upper), (far, lower) = sorted(((_depth(owners[number]), number) for number in beside), key=lambda pair: pair[0])
        edge = TopoDS.Edge_s(edges.FindKey(key))
        if far - near < LEVEL or max(abs(vertex.Y) for vertex in bd.Edge(edge).vertices()) < ON_MEDIAN:
            continue
        above, below = owners[upper], owners[lower]
        owner = above if above is not None and near != 0.0 and far - near < HOLE else below or above
        if owner is not None:
            _, _, sight, towards = VIEWS[owner.view]
            direction = np.eye(3)[sight] * towards
            seams.append(Seam(edge, pieces[lower], direction * near, direction * far, owner.material))
    return seams


def _depth(owner: Inlay | None) -> float:
    return 0.0 if owner is None else owner.depth
