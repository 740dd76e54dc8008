"""Write AP242 STEP files with named and coloured faces, and read named faces of STEP files as B-splines."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
from OCP.IFSelect import IFSelect_RetDone
from OCP.Interface import Interface_HArray1OfHAsciiString, Interface_Static
from OCP.Message import Message, Message_Gravity
from OCP.Quantity import Quantity_Color, Quantity_TOC_sRGB
from OCP.STEPCAFControl import STEPCAFControl_Controller, STEPCAFControl_Writer
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Reader
from OCP.StepShape import StepShape_AdvancedFace
from OCP.TCollection import TCollection_ExtendedString, TCollection_HAsciiString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopoDS import TopoDS_Face, TopoDS_Shape
from OCP.XCAFDoc import XCAFDoc_ColorGen, XCAFDoc_ColorSurf, XCAFDoc_DocumentTool

from mirror_cad.errors import FileError, WriteError
from mirror_cad.occt.convert import face_as_bspline, face_as_quadric
from mirror_cad.occt.shapes import faces_of
from mirror_cad.own_files import Hand, hand_in_words, transition_in_words
from mirror_cad.surfaces.quadric import Quadric

if TYPE_CHECKING:  # it brings numba along, which the child process does without
    from mirror_cad.surfaces.bspline import BSplineSurface

STEP_SUFFIXES = (".step", ".stp")
OPTICAL_FACE = "optical face"
FRONT_FACE = "front face"  # of glass that reflects from its back: light goes in and out there
TRIM_CURVE = "trim curve"
OPTICAL_COLOUR = (0.55, 0.75, 0.95)
GLASS_COLOUR = (0.35, 0.38, 0.42)


@dataclass(frozen=True, slots=True)
class Part:
    """One product of a STEP file: a shape, its name, its colour, and faces of it with names of their own.

    The face named OPTICAL_FACE has a colour of its own too. Only one part of a file should have a colour: the kernel writes
    the colours of several in an order that differs from process to process.
    """

    shape: TopoDS_Shape
    name: str
    colour: tuple[float, float, float] | None = None
    named_faces: Mapping[str, TopoDS_Face] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class StepFace:
    """A face read from a STEP file, in mm and placed as the file places it: its name ("" without one), and as it came."""

    name: str
    raw: TopoDS_Face

    @cached_property
    def _converted(self) -> tuple[BSplineSurface, TopoDS_Face]:
        return face_as_bspline(self.raw)

    @property
    def quadric(self) -> Quadric | None:
        """The plane, sphere or cylinder under it; None for other surfaces."""
        return face_as_quadric(self.raw)

    @property
    def surface(self) -> BSplineSurface:
        """The surface under it as a B-spline. Raises: SurfaceError where no B-spline can take it."""
        return self._converted[0]

    @property
    def face(self) -> TopoDS_Face:
        """The face lying on exactly that B-spline."""
        return self._converted[1]


@dataclass(frozen=True, eq=False)
class StepFile:
    """What a STEP file holds: everything as one shape, for checks of solids, and its faces."""

    shape: TopoDS_Shape
    faces: tuple[StepFace, ...]

    def optical_surface(self) -> BSplineSurface:
        """The surface of the one face that is named OPTICAL_FACE. Raises: FileError where there are none or several."""
        return self.named_surface(OPTICAL_FACE)

    def named_surface(self, name: str) -> BSplineSurface:
        """The surface of the one face of this name. Raises: FileError where there are none or several."""
        found = [face.surface for face in self.faces if face.name == name]
        if len(found) != 1:
            raise FileError(f"the file has {len(found)} faces named {name!r}, not 1")
        return found[0]


def write_step(path: Path, parts: list[Part], title: str, hand: Hand | None = None, transition_mm: float | None = None) -> None:
    """Write parts as one AP242 file in mm.

    The header's time follows SOURCE_DATE_EPOCH; it says which hand a mirror is, and where its aspheric part begins.

    Raises: WriteError where its name or folder is none for it, and where the kernel cannot write it.
    """
    if path.suffix.lower() not in STEP_SUFFIXES:
        raise WriteError(f"{path}: a STEP file's name ends in {' or '.join(STEP_SUFFIXES)}; no other is read again")
    if not path.parent.is_dir():
        raise WriteError(f"{path}: there is no folder {path.parent}: make it first")
    _silence()
    document = TDocStd_Document(TCollection_ExtendedString("BinXCAF"))
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colours = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    for part in parts:
        label = shapes.AddShape(part.shape, False)
        TDataStd_Name.Set_s(label, TCollection_ExtendedString(part.name))
        if part.colour is not None:
            colours.SetColor(label, Quantity_Color(*part.colour, Quantity_TOC_sRGB), XCAFDoc_ColorGen)
        for name, shape in part.named_faces.items():
            face = shapes.AddSubShape(label, shape)
            TDataStd_Name.Set_s(face, TCollection_ExtendedString(name))
            if name == OPTICAL_FACE:
                colours.SetColor(face, Quantity_Color(*OPTICAL_COLOUR, Quantity_TOC_sRGB), XCAFDoc_ColorSurf)
    # The settings exist only once the controller does, and a writer takes the schema when it is made. The kernel's name
    # for AP242 is "AP242DIS"; "AP242" it would refuse without a word.
    STEPCAFControl_Controller.Init_s()
    for key, value in (("write.step.schema", "AP242DIS"), ("write.step.unit", "MM")):
        if not Interface_Static.SetCVal_s(key, value):
            raise WriteError(f"the kernel does not take {key} = {value}")
    if not Interface_Static.SetIVal_s("write.stepcaf.subshapes.name", 1):
        raise WriteError("the kernel does not take write.stepcaf.subshapes.name")
    writer = STEPCAFControl_Writer()
    writer.SetColorMode(True)
    writer.SetNameMode(True)
    if not writer.Transfer(document, STEPControl_AsIs):
        raise WriteError(f"{path}: the kernel cannot turn the shapes into STEP")
    _write_header(writer, title, hand, transition_mm)
    if writer.Write(str(path)) != IFSelect_RetDone:
        raise WriteError(f"{path}: the kernel could not write the file: is there space, and may you write there?")


def read_step(path: Path) -> StepFile:
    """Read a STEP file. Raises: FileError for a file that is no STEP or holds no face."""
    _silence()
    if not path.is_file():
        raise FileError(f"{path}: no such file")
    reader = STEPControl_Reader()
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
    if reader.ReadFile(str(path)) != IFSelect_RetDone:
        raise FileError(f"{path}: not a STEP file that the kernel can read")
    reader.TransferRoots()
    shape = reader.OneShape()
    raw = faces_of(shape) if shape is not None and not shape.IsNull() else []
    if not raw:
        raise FileError(f"{path}: the file holds no face (curves and points alone are no mirror)")
    return StepFile(shape, tuple(StepFace(_face_name(reader, face), face) for face in raw))


def _face_name(reader: STEPControl_Reader, face: TopoDS_Face) -> str:
    """The name of the ADVANCED_FACE entity that became this face."""
    entity = reader.WS().TransferReader().EntityFromShapeResult(face, 1)
    name = entity.Name() if isinstance(entity, StepShape_AdvancedFace) else None
    return str(name.ToCString()) if name is not None else ""


def _write_header(writer: STEPCAFControl_Writer, title: str, hand: Hand | None, transition_mm: float | None) -> None:
    header = APIHeaderSection_MakeHeader(writer.ChangeWriter().Model())
    stamp = time.gmtime(int(os.environ.get("SOURCE_DATE_EPOCH", str(int(time.time())))))
    header.SetName(TCollection_HAsciiString(title))
    header.SetTimeStamp(TCollection_HAsciiString(time.strftime("%Y-%m-%dT%H:%M:%S", stamp)))
    texts = [(header.SetAuthor, "mirror-cad user"), (header.SetOrganization, "unspecified")]
    if hand is not None:
        line = "" if transition_mm is None else f", {transition_in_words(transition_mm)}"
        texts.append((header.SetDescription, hand_in_words(hand) + line))
    for setter, text in texts:
        array = Interface_HArray1OfHAsciiString(1, 1)
        array.SetValue(1, TCollection_HAsciiString(text))
        setter(array)
    header.SetOriginatingSystem(TCollection_HAsciiString("mirror-cad"))
    header.SetAuthorisation(TCollection_HAsciiString(""))


def _silence() -> None:
    """Keep the kernel's transfer statistics off the standard output, which belongs to results."""
    for printer in list(Message.DefaultMessenger_s().Printers()):
        printer.SetTraceLevel(Message_Gravity.Message_Fail)
