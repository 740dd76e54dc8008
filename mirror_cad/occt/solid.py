"""The trimmed optical face, and the plate behind or before it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeWire, BRepBuilderAPI_Sewing
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepFill import BRepFill
from OCP.BRepGProp import BRepGProp
from OCP.BRepLib import BRepLib
from OCP.BRepTools import BRepTools, BRepTools_WireExplorer
from OCP.Geom import Geom_BSplineSurface
from OCP.Geom2d import Geom2d_Curve, Geom2d_TrimmedCurve
from OCP.GeomAbs import GeomAbs_C1
from OCP.GProp import GProp_GProps
from OCP.TopAbs import TopAbs_EDGE, TopAbs_REVERSED, TopAbs_SHELL
from OCP.TopExp import TopExp, TopExp_Explorer
from OCP.TopoDS import TopoDS_Edge, TopoDS_Face, TopoDS_Shape, TopoDS_Shell, TopoDS_Solid, TopoDS_Wire
from OCP.TopTools import TopTools_IndexedMapOfShape

from mirror_cad.errors import SolidError
from mirror_cad.occt.convert import to_geom_surface, to_pcurve
from mirror_cad.occt.shapes import faces_of
from mirror_cad.outline import Outline

if TYPE_CHECKING:  # they bring numba along, which the child process does without
    from mirror_cad.occt.convert import BSplineRecord
    from mirror_cad.surfaces.bspline import BSplineSurface
    from mirror_cad.surfaces.offset import Side

Array = NDArray[np.float64]

# The 3D edges follow surface(pcurve) this closely: a hundredth of the position tolerance of a fit.
EDGE_TOLERANCE_MM = 1e-7
# Faces closer than this are sewn: the edges' own error, with room for the ends of two of them.
SEWING_TOLERANCE_MM = 1e-6
# The kernel's adaptive integration of area and volume, relative, starts anew on every edge: at the fine setting a thousand
# edges take a minute. Short pieces need only the coarse one: 1e-11 on 17 even pieces, 1e-14 on 60. A few long edges among
# many short ones cost it 1e-7.
INTEGRAL_ACCURACY, INTEGRAL_ACCURACY_MANY = 1e-9, 1e-3
MANY_EDGES = 50
# And on every patch: a law with a step 0.1 mm wide took 5 s at the fine setting, 0.3 s at the coarse one, 1e-7 apart.
MANY_PATCHES = 500


@dataclass(frozen=True, eq=False)
class PlateShapes:
    """A mirror as a solid of the kernel: the whole, and the optical face.

    front_face : the face towards the driver, which is the optical one where the front reflects.
    """

    solid: TopoDS_Solid
    optical: TopoDS_Face
    front_face: TopoDS_Face


@dataclass(frozen=True, eq=False)
class Plate(PlateShapes):
    """The same with its surfaces, and what the kernel says of it.

    front, back : the surfaces of both faces, on the same parameters.   offset : that of the two which is not the optical one.
    back_error_mm : `offset`, be it back or front, against the true one.
    """

    front: BSplineSurface
    back: BSplineSurface
    offset: BSplineSurface
    back_error_mm: float

    @cached_property
    def area_mm2(self) -> float:
        """Of the optical face, mm²."""
        return area(self.optical)

    @cached_property
    def volume_mm3(self) -> float:
        """Of the plate, mm³: a tenth of a second, which who only writes or traces it does not wait for."""
        return volume(self.solid)


def plate(surface: BSplineSurface, outline: Outline, thickness_mm: float, reflecting: Side = "front",
          other: tuple[BSplineSurface, float] | None = None) -> Plate:
    """The solid between the optical face and its offset along the normals, with ruled sides along them.

    reflecting : which face of the plate the optical one is. The other is S − t·N behind a reflecting front and S + t·N
    before a reflecting back, on the same parameters, so the same trimming curves serve for both; both and the sides are
    plain B-splines.   other : what `offset_surface` gave for these, where it is there already.

    Raises
    ------
    SolidError
        As `offset_surface`, and as `plate_shapes`.
    """
    from mirror_cad.surfaces.offset import offset_surface

    offset, error = other or offset_surface(surface, outline, thickness_mm, reflecting)
    made = plate_shapes(surface, offset, outline, thickness_mm, reflecting)
    front, back = (surface, offset) if reflecting == "front" else (offset, surface)
    return Plate(made.solid, made.optical, made.front_face, front, back, offset, error)


def plate_shapes(surface: BSplineRecord, offset: BSplineRecord, outline: Outline, thickness_mm: float,
                 reflecting: Side) -> PlateShapes:
    """The solid between two surfaces on the same parameters, the optical one first.

    Raises
    ------
    SolidError
        Where the kernel finds no single valid solid.
    """
    front_surface, back_surface = (surface, offset) if reflecting == "front" else (offset, surface)
    pcurves = _pcurves(outline)
    front, back = (_face(to_geom_surface(each), pcurves) for each in (front_surface, back_surface))
    sewing = BRepBuilderAPI_Sewing(SEWING_TOLERANCE_MM)
    sewing.Add(front)
    sewing.Add(back.Reversed())
    for edge, other in zip(_edges(front), _edges(back), strict=True):
        sewing.Add(BRepFill.Face_s(edge, other))
    sewing.Perform()
    shell = _only(sewing.SewedShape(), TopAbs_SHELL, "shell")
    front, back = (sewing.Modified(face) if sewing.IsModified(face) else face for face in (front, back))
    if face_on(shell, to_geom_surface(front_surface), front).Orientation() == TopAbs_REVERSED:
        shell.Reverse()  # outside is where the front's normal points
    builder = BRep_Builder()
    solid = TopoDS_Solid()
    builder.MakeSolid(solid)
    builder.Add(solid, shell)
    front_face = face_on(solid, to_geom_surface(front_surface), front)
    optical = front_face if reflecting == "front" else face_on(solid, to_geom_surface(back_surface), back)
    if sewing.NbFreeEdges() or not BRepCheck_Analyzer(solid).IsValid():
        raise SolidError(f"the plate of {thickness_mm:g} mm is no valid solid ({sewing.NbFreeEdges()} open edges): look "
                         "for an outline with pieces shorter than a micrometre or corners sharper than the glass is thick")
    return PlateShapes(solid, optical, front_face)


def sheet(surface: BSplineRecord, box: tuple[float, float, float, float]) -> tuple[TopoDS_Shell, TopoDS_Face]:
    """The untrimmed surface between (u_min, u_max, v_min, v_max), on one B-spline cut exactly there.

    Returns: an open shell and the face in it: a face alone could not carry a name into a STEP file.
    """
    geom = to_geom_surface(surface)
    u_min, u_max, v_min, v_max = box
    if box != surface.domain:
        geom.Segment(u_min, u_max, v_min, v_max, 0.0, 0.0)
    face = BRepBuilderAPI_MakeFace(geom, EDGE_TOLERANCE_MM).Face()
    shell, builder = TopoDS_Shell(), BRep_Builder()
    builder.MakeShell(shell)
    builder.Add(shell, face)
    return shell, face


def trimmed_sheet(surface: BSplineSurface, outline: Outline) -> tuple[TopoDS_Shell, TopoDS_Face]:
    """The surface inside an outline in (u, v), as an open shell and the face in it.

    Raises
    ------
    SolidError
        Where the kernel cannot cut it.
    """
    face = _face(to_geom_surface(surface), _pcurves(outline))
    shell, builder = TopoDS_Shell(), BRep_Builder()
    builder.MakeShell(shell)
    builder.Add(shell, face)
    return shell, face


# --- topology --------------------------------------------------------------------------------------------------------


def _pcurves(outline: Outline) -> list[Geom2d_Curve]:
    curves = [to_pcurve(segment) for segment in outline.segments]
    if len(curves) > 1:
        return curves
    # A loop of one curve: two halves, so that the sides of the plate need no seam.
    whole = curves[0]
    first, last = whole.FirstParameter(), whole.LastParameter()
    middle = 0.5 * (first + last)
    basis = whole.BasisCurve() if isinstance(whole, Geom2d_TrimmedCurve) else whole
    return [Geom2d_TrimmedCurve(basis, first, middle), Geom2d_TrimmedCurve(basis, middle, last)]


def _face(surface: Geom_BSplineSurface, pcurves: list[Geom2d_Curve]) -> TopoDS_Face:
    """The part of a surface inside trimming curves in (u, v).

    These are met exactly; the edges in space follow to EDGE_TOLERANCE_MM.
    """
    wire = BRepBuilderAPI_MakeWire()
    for curve in pcurves:
        edge = BRepBuilderAPI_MakeEdge(curve, surface, curve.FirstParameter(), curve.LastParameter()).Edge()
        BRepLib.BuildCurves3d_s(edge, EDGE_TOLERANCE_MM, GeomAbs_C1, 14, 400)
        wire.Add(edge)
    if not wire.IsDone():
        raise SolidError(f"the outline's {len(pcurves)} pieces do not join into one loop on the surface "
                         f"(the kernel's reason: {wire.Error()})")
    made = BRepBuilderAPI_MakeFace(surface, wire.Wire(), True)
    if not made.IsDone():
        raise SolidError(f"the kernel cannot cut the surface to the outline ({made.Error()})")
    face = made.Face()
    BRepLib.BuildCurves3d_s(face, EDGE_TOLERANCE_MM, GeomAbs_C1, 14, 400)
    BRepLib.SameParameter_s(face, EDGE_TOLERANCE_MM, False)
    if not BRepCheck_Analyzer(face).IsValid():
        raise SolidError("the kernel finds the surface cut to the outline invalid: does the outline touch itself?")
    return face


def outer_wire(face: TopoDS_Face) -> TopoDS_Wire:
    """The wire that bounds a face."""
    return BRepTools.OuterWire_s(face)


def upright_curve(surface: BSplineRecord, u: float, v_low: float, v_high: float) -> TopoDS_Wire:
    """The curve u = const of a surface between two v, exactly: its isoparametric B-spline, as a wire of one edge."""
    edge = BRepBuilderAPI_MakeEdge(to_geom_surface(surface).UIso(u), v_low, v_high).Edge()
    return BRepBuilderAPI_MakeWire(edge).Wire()


def _edges(face: TopoDS_Face) -> list[TopoDS_Edge]:
    explorer = BRepTools_WireExplorer(outer_wire(face), face)
    edges = []
    while explorer.More():
        edges.append(explorer.Current())
        explorer.Next()
    return edges


def face_on(solid: TopoDS_Shape, surface: Geom_BSplineSurface, hint: TopoDS_Shape) -> TopoDS_Face:
    """The face of the sewn solid that is the given one."""
    for face in faces_of(solid):
        if face.IsSame(hint):
            return face
    first = surface.Pole(1, 1)
    for face in faces_of(solid):
        other = BRep_Tool.Surface_s(face)
        if isinstance(other, Geom_BSplineSurface) and other.Pole(1, 1).IsEqual(first, 0.0):
            return face
    raise SolidError("the optical face was lost while the plate was sewn")


def _only(shape: TopoDS_Shape, kind: object, name: str) -> TopoDS_Shape:
    explorer = TopExp_Explorer(shape, kind)
    found = []
    while explorer.More():
        found.append(explorer.Current())
        explorer.Next()
    if len(found) != 1:
        raise SolidError(f"the plate's faces sew into {len(found)} {name}s, not 1: the outline has pieces shorter than "
                         f"{SEWING_TOLERANCE_MM:g} mm, or touches itself")
    return found[0]


def is_valid(shape: TopoDS_Shape) -> bool:
    """The kernel's own check of a shape."""
    return bool(BRepCheck_Analyzer(shape).IsValid())


def area(shape: TopoDS_Shape) -> float:
    """Surface area by the kernel, mm²."""
    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(shape, properties, _accuracy(shape))
    return float(properties.Mass())


def volume(shape: TopoDS_Shape) -> float:
    """Volume by the kernel, mm³."""
    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, properties, _accuracy(shape), True)
    return float(properties.Mass())


def _accuracy(shape: TopoDS_Shape) -> float:
    edges = TopTools_IndexedMapOfShape()
    TopExp.MapShapes_s(shape, TopAbs_EDGE, edges)
    surfaces = [BRep_Tool.Surface_s(face) for face in faces_of(shape)]
    patches = sum((each.NbUKnots() - 1) * (each.NbVKnots() - 1) for each in surfaces if isinstance(each, Geom_BSplineSurface))
    return INTEGRAL_ACCURACY if edges.Extent() <= MANY_EDGES and patches <= MANY_PATCHES else INTEGRAL_ACCURACY_MANY
