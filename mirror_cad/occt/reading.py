"""Read the faces of a CAD file as plain arrays, with what they are called: what the child process runs.

Nothing here returns more than numbers, texts and arrays (`mirror_cad.cad_file` makes records of them), and nothing imports
numba, so that the child is ready in half of the time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepGProp import BRepGProp
from OCP.BRepTools import BRepTools
from OCP.GeomAbs import GeomAbs_OffsetSurface, GeomAbs_SurfaceType
from OCP.GProp import GProp_GProps
from OCP.IFSelect import IFSelect_RetDone, IFSelect_SelectModelEntities, IFSelect_SelectType
from OCP.IGESCAFControl import IGESCAFControl_Reader
from OCP.Interface import Interface_Static
from OCP.Standard import Standard_Failure
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.STEPControl import STEPControl_Reader
from OCP.StepShape import StepShape_AdvancedFace
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDF import TDF_Label, TDF_LabelSequence
from OCP.TDocStd import TDocStd_Document
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Face, TopoDS_Shape
from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

from mirror_cad.errors import FileError
from mirror_cad.guarded_child import report
from mirror_cad.occt.appearance import Appearance, Colour
from mirror_cad.occt.convert import (
    Array,
    BSplineArrays,
    as_geom_bspline,
    bspline_arrays,
    face_as_quadric,
    face_loops,
    is_reversed,
)
from mirror_cad.occt.offsets import fitted_bspline, offset_as_quadric, refuse_stray_edges
from mirror_cad.occt.shapes import anywhere, faces_of, solids_of
from mirror_cad.occt.tessellate import face_mesh, triangulate
from mirror_cad.surfaces.quadric import Quadric

# Of a face as `listed` tells it: name, names of the parts it belongs to, layers, colour, surface, area in mm² or None.
Listed = tuple[str, tuple[str, ...], tuple[str, ...], Colour | None, str, float | None]

LARGEST_MM = 1e8  # of a coordinate: a hundred kilometres
# By which share of a surface's domain a face's edges may leave it: other programs' pcurves are drawn to about this.
DOMAIN_ROOM = 1e-6
TRIANGLES = "triangles"  # what a tessellated face is said to be
_KINDS = {"BezierSurface": "Bézier", "BSplineSurface": "B-spline", "SurfaceOfRevolution": "revolution",
          "SurfaceOfExtrusion": "extrusion", "OffsetSurface": "offset", "OtherSurface": "other"}


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """A face where the file places it, and what it is called."""

    raw: TopoDS_Face
    name: str = ""
    parts: tuple[str, ...] = ()
    layers: tuple[str, ...] = ()
    colour: Colour | None = None

    @property
    def surface_kind(self) -> str:
        """What its surface is, in a word."""
        if _is_bare(self.raw):
            return TRIANGLES
        kind: GeomAbs_SurfaceType = BRepAdaptor_Surface(self.raw, False).GetType()
        name = str(kind.name).removeprefix("GeomAbs_")
        return _KINDS.get(name, name.lower())


Read = tuple[list[Found], list[str]]  # the faces, and the names of those that the kernel could not make
# The file read last, so that its faces can be asked for after they were listed: path, time and size of it.
_last: tuple[tuple[str, int, int], list[Found], list[str]] | None = None


def listed(path: str, with_areas: bool) -> tuple[list[Listed], list[str]]:
    """What is known of each face of a file, in the file's order; and the names of the faces that the kernel left out.

    Raises
    ------
    FileError
        For a file that the kernel cannot read or that holds no face.
    """
    faces = _faces(path)
    told: list[Listed] = []
    for k, face in enumerate(faces):
        told.append((face.name, face.parts, face.layers, face.colour, face.surface_kind,
                     _area(face.raw) if with_areas else None))
        if with_areas:
            report((k + 1) / len(faces))
    assert _last is not None  # read just now
    return told, _last[2]


def shapes(path: str, wanted: list[int], splines: bool) -> list[object]:
    """The wanted faces (their indices in `listed`) in arrays.

    Each is (sort, its data, loops, sign): "quadric" with kind, centre, axes and radius; "bspline" with what `bspline_arrays`
    gives; "mesh" with vertices and triangles, no loops and sign 1. splines : whether quadrics are wanted as B-splines.

    Raises
    ------
    FileError
        Where a face cannot be had so.
    """
    faces = _faces(path)
    made: list[object] = []
    for k, index in enumerate(wanted):
        try:
            _refuse_endless(path, index, faces[index].raw)
            made.append(_arrays(faces[index].raw, splines))
        except Standard_Failure as error:
            raise FileError(f"{path}: face {index + 1} cannot be read: {_words(error)}") from None
        report((k + 1) / len(wanted))
    return made


def meshes(path: str, wanted: list[int], deflection_mm: float) -> list[object]:
    """The wanted faces as (vertices, triangles), each within about that deflection; one that the kernel cannot mesh as None."""
    faces = _faces(path)
    made: list[object] = []
    for k, index in enumerate(wanted):
        try:
            if not _is_bare(faces[index].raw):
                _refuse_endless(path, index, faces[index].raw)
                triangulate(faces[index].raw, deflection_mm, straight=True)
            mesh = face_mesh(faces[index].raw)
            made.append((mesh.vertices, mesh.faces))
        except Standard_Failure as error:
            raise FileError(f"{path}: face {index + 1} cannot be meshed: {_words(error)}") from None
        report((k + 1) / len(wanted))
    return made


def _refuse_endless(path: str, index: int, face: TopoDS_Face) -> None:
    """Refuse a face on which the kernel would work for ever."""
    box = Bnd_Box()
    BRepBndLib.Add_s(face, box, False)
    reach = float("inf") if box.IsVoid() or box.IsOpen() else max(abs(value) for value in box.Get())
    if not reach <= LARGEST_MM:
        raise FileError(f"{path}: face {index + 1} reaches {reach:.3g} mm far: is a number in the file damaged?")


def _arrays(face: TopoDS_Face, splines: bool) -> tuple[str, tuple[object, ...], tuple[object, ...], float]:
    if _is_bare(face):
        mesh = face_mesh(face)
        return "mesh", (mesh.vertices, mesh.faces), (), 1.0
    sign = -1.0 if is_reversed(face) else 1.0
    if BRepAdaptor_Surface(face, False).GetType() == GeomAbs_OffsetSurface:
        refuse_stray_edges(face)
        simple = offset_as_quadric(face)
        if simple is None or splines:
            return "bspline", fitted_bspline(face), face_loops(face), sign
        return "quadric", _quadric_arrays(simple), face_loops(face), sign
    plain = None if splines else face_as_quadric(face)
    if plain is not None:
        return "quadric", _quadric_arrays(plain), face_loops(face), sign
    geom, converted = as_geom_bspline(face)
    arrays, loops = bspline_arrays(geom), face_loops(converted)
    if not _covers(arrays, loops):
        return "bspline", fitted_bspline(face), face_loops(face), sign
    return "bspline", arrays, loops, -1.0 if is_reversed(converted) else 1.0


def _quadric_arrays(quadric: Quadric) -> tuple[object, ...]:
    return quadric.kind, quadric.centre, quadric.axes, quadric.radius_mm


def _covers(arrays: BSplineArrays, loops: tuple[Array, ...]) -> bool:
    """Whether a B-spline's domain holds all of a face: the kernel's conversion may end before."""
    degree_u, degree_v, knots_u, knots_v = arrays[:4]
    for column, knots, degree in ((0, knots_u, degree_u), (1, knots_v, degree_v)):
        low, high = knots[degree], knots[-degree - 1]
        room = DOMAIN_ROOM * (high - low)
        if any(loop[:, column].min() < low - room or loop[:, column].max() > high + room for loop in loops):
            return False
    return True


def _is_bare(face: TopoDS_Face) -> bool:
    """Whether a face has triangles alone and no surface."""
    return BRep_Tool.Surface_s(face, TopLoc_Location()) is None


def _area(face: TopoDS_Face) -> float:
    if _is_bare(face):
        mesh = face_mesh(face)
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    properties = GProp_GProps()
    BRepGProp.SurfaceProperties_s(face, properties)
    return float(properties.Mass())


def _faces(path: str) -> list[Found]:
    global _last
    status = Path(path).stat()
    key = (path, status.st_mtime_ns, status.st_size)
    if _last is None or _last[0] != key:
        _last = None
        ending = Path(path).suffix.lower()
        read = _of_step if ending in (".step", ".stp") else _of_iges if ending in (".igs", ".iges") else _of_brep
        try:
            found, lost = read(path)
        except Standard_Failure as error:
            raise FileError(f"{path}: the kernel cannot read it: {_words(error)}") from None
        if not found and not lost:
            raise FileError(f"{path}: the file holds no face (curves and points alone are no mirror)")
        _last = key, found, lost
    return _last[1]


def _words(error: Exception) -> str:
    return str(error) or type(error).__name__


def _of_step(path: str) -> Read:
    document = TDocStd_Document(TCollection_ExtendedString("BinXCAF"))
    reader = STEPCAFControl_Reader()
    reader.SetColorMode(True)
    reader.SetNameMode(True)
    reader.SetLayerMode(True)
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
    Interface_Static.SetCVal_s("read.step.tessellated", "OnNoBRep")  # triangles beside true faces are those again
    if reader.ReadFile(path) != IFSelect_RetDone:
        raise FileError(f"{path}: not a STEP file that the kernel can read")
    if not reader.Transfer(document):
        raise FileError(f"{path}: the file holds no shape that the kernel can read")
    statements = _Statements(reader.Reader())
    found = list(_of_document(document, statements))
    return found, statements.lost([each.raw for each in found])


class _Statements:
    """The ADVANCED_FACE statements of a STEP file, and which of them became which face.

    The kernel looks for a face's statement through all of them, so it is asked only where something depends on it: where one
    has a name, or where there are more statements than faces.
    """

    def __init__(self, reader: STEPControl_Reader) -> None:
        self._transfer = reader.WS().TransferReader()
        faces = IFSelect_SelectType(StepShape_AdvancedFace.get_type_descriptor_s())
        faces.SetInput(IFSelect_SelectModelEntities())
        statements = reader.WS().SelectionResult(faces)
        self._names = {statements.Value(k): _entity_name(statements.Value(k)) for k in range(1, statements.Length() + 1)}

    def name(self, face: TopoDS_Face) -> str:
        return self._names.get(self._of(face), "") if any(self._names.values()) else ""

    def lost(self, faces: list[TopoDS_Face]) -> list[str]:
        """The names of the faces that the kernel has left out without a word."""
        if len({anywhere(face) for face in faces}) >= len(self._names):
            return []
        kept = {self._of(face) for face in faces}
        return [name for entity, name in self._names.items() if entity not in kept]

    def _of(self, face: TopoDS_Face) -> object:
        for each in (face, face.Located(TopLoc_Location())):
            entity = self._transfer.EntityFromShapeResult(each, 1)
            if isinstance(entity, StepShape_AdvancedFace):
                return entity
        return None


def _entity_name(entity: StepShape_AdvancedFace) -> str:
    name = entity.Name()
    return str(name.ToCString()) if name is not None else ""


def _of_iges(path: str) -> Read:
    document = TDocStd_Document(TCollection_ExtendedString("BinXCAF"))
    reader = IGESCAFControl_Reader()
    reader.SetColorMode(True)
    reader.SetNameMode(True)
    reader.SetLayerMode(True)
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
    if reader.ReadFile(path) != IFSelect_RetDone or not reader.Transfer(document):
        raise FileError(f"{path}: not an IGES file that the kernel can read")
    return list(_of_document(document, None)), []


def _of_brep(path: str) -> Read:
    shape = TopoDS_Shape()
    if not BRepTools.Read_s(shape, path, BRep_Builder()) or shape.IsNull():
        raise FileError(f"{path}: not a BREP file that the kernel can read")
    return [Found(face) for face in faces_of(shape)], []


def _of_document(document: TDocStd_Document, statements: _Statements | None) -> Iterator[Found]:
    appearance = Appearance(document)
    roots = TDF_LabelSequence()
    XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).GetFreeShapes(roots)
    for k in range(1, roots.Length() + 1):
        root = roots.Value(k)
        for label, location, parts, above in _leaves(root, TopLoc_Location(), (), ()):
            shape = XCAFDoc_ShapeTool.GetShape_s(label).Moved(location)
            owners = _solid_of_each(shape)
            bare = XCAFDoc_ShapeTool.GetShape_s(label)
            for face, solid in zip(faces_of(shape), owners, strict=True):
                asked = [each for each in (face, solid, shape, bare) if each is not None]
                name = statements.name(face) if statements is not None else ""
                yield Found(face, name, parts, appearance.layers(asked, above), appearance.colour(asked, above))


Leaf = tuple[TDF_Label, TopLoc_Location, tuple[str, ...], tuple[TDF_Label, ...]]


def _leaves(label: TDF_Label, location: TopLoc_Location, parts: tuple[str, ...],
            above: tuple[TDF_Label, ...]) -> Iterator[Leaf]:
    """The parts of an assembly that are no assemblies: label, location, the names from the top down, the labels above."""
    here = label
    if XCAFDoc_ShapeTool.IsReference_s(label):
        here = TDF_Label()
        XCAFDoc_ShapeTool.GetReferredShape_s(label, here)
        location = location.Multiplied(XCAFDoc_ShapeTool.GetLocation_s(label))
        above = (*above, label)
    above = (*above, here)
    for each in dict.fromkeys((_label_name(label), _label_name(here))):
        if each and each not in parts:
            parts = (*parts, each)
    if not XCAFDoc_ShapeTool.IsAssembly_s(here):
        yield here, location, parts, above
        return
    components = TDF_LabelSequence()
    XCAFDoc_ShapeTool.GetComponents_s(here, components)
    for k in range(1, components.Length() + 1):
        yield from _leaves(components.Value(k), location, parts, above)


def _solid_of_each(shape: TopoDS_Shape) -> list[TopoDS_Shape | None]:
    """For every face of a shape, the solid that it bounds, in the order of `faces_of`."""
    owners: dict[int, TopoDS_Shape] = {}
    for solid in solids_of(shape):
        for face in faces_of(solid):
            owners.setdefault(hash(face), solid)  # by place too: faces themselves are equal to none
    return [owners.get(hash(face)) for face in faces_of(shape)]


def _label_name(label: TDF_Label) -> str:
    name = TDataStd_Name()
    said = str(name.Get().ToExtString()) if label.FindAttribute(TDataStd_Name.GetID_s(), name) else ""
    return "" if said.startswith("=>[") else said  # the kernel's own, for an instance without one
