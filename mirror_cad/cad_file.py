"""The faces of a CAD file as plain records, with what they are called and their shapes.

STEP (.step, .stp), IGES (.iges, .igs) and BREP (.brep, .brp) files are read by the kernel in a child process: a damaged file
ends that alone. What our own reader of STEP's text finds wrong is said in its words, before the kernel's fall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from mirror_cad.guarded import Progress
from mirror_cad.kernel import asked, start_reader
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.part21_check import MAX_NAMED, external_files, faults_of
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.quadric import Quadric

Array = NDArray[np.float64]
Colour = tuple[int, int, int]

STEP_KINDS = (".step", ".stp")


@dataclass(frozen=True, slots=True)
class CadFace:
    """What is known of a face before its shape is asked for.

    Attributes
    ----------
    number : int
        From 1 on, in the file's order.
    name : str
        Its own, "" without one.
    parts : tuple of str
        The products and instances it belongs to, outermost first.
    layers : tuple of str
        Those that it or its part lies on.
    colour : tuple or None
        8 bits of sRGB a channel; its solid's or part's where it has none of its own.
    surface : str
        What it is, in a word; "triangles" where it has no surface.
    area_mm2 : float or None
        None where it was not asked for.
    """

    number: int
    name: str
    parts: tuple[str, ...]
    layers: tuple[str, ...]
    colour: Colour | None
    surface: str
    area_mm2: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FaceShape:
    """A face in mm where the file places it: its surface inside loops, closed polygons (n, 2) in its (u, v), even-odd.

    Attributes
    ----------
    surface : BSplineSurface, Quadric or SurfaceMesh
        mm.
    loops : tuple of ndarray
        None of a face of triangles alone.
    sign : float
        1 where S_u × S_v looks out of the material, else −1.
    """

    surface: BSplineSurface | Quadric | SurfaceMesh
    loops: tuple[Array, ...]
    sign: float


@dataclass(frozen=True, slots=True, eq=False)
class CadFile:
    """The faces of a CAD file.

    Attributes
    ----------
    path : Path
        Of the file.
    faces : tuple of CadFace
        In the file's order.
    missing : tuple of str
        The files of its parts that it names but that are not beside it.
    lost : tuple of str
        The names of the faces, "" without one, that it holds but that the kernel could not make.
    """

    path: Path
    faces: tuple[CadFace, ...]
    missing: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()

    def shapes(self, faces: Sequence[CadFace], splines: bool = False, progress: Progress | None = None) -> list[FaceShape]:
        """The shapes of faces of this file; with `splines`, planes, cylinders and spheres as B-splines too.

        Raises
        ------
        FileError, SurfaceError
            Where one cannot be had.
        """
        wanted = [face.number - 1 for face in faces]
        answer = asked(self.path, "shapes", wanted, splines, progress=progress)
        return [_shape(*each) for each in cast("list[tuple[str, tuple[object, ...], tuple[Array, ...], float]]", answer)]

    def meshes(self, faces: Sequence[CadFace], deflection_mm: float, progress: Progress | None = None) -> list[SurfaceMesh]:
        """Triangles of faces of this file, within about that deflection.

        Raises
        ------
        FileError
            Where the kernel has none.
        """
        answer = asked(self.path, "meshes", [face.number - 1 for face in faces], deflection_mm, progress=progress)
        return [SurfaceMesh(*each) for each in cast("list[tuple[Array, NDArray[np.int32]]]", answer)]


def read_cad(path: Path, areas: bool = False, progress: Progress | None = None) -> CadFile:
    """The faces of a STEP, IGES or BREP file; `areas` says whether to measure them.

    Raises
    ------
    FileError
        For a file that is missing, damaged or holds no face, with the statement at fault where that can be told.
    """
    if not path.is_file():
        raise FileError(f"{path}: no such file")
    text = None
    if path.suffix.lower() in STEP_KINDS:
        try:
            text = path.read_text("latin-1")
        except OSError as error:
            raise FileError(f"{path}: cannot be read: {error.strerror or error}") from None

    def check() -> None:
        faults = faults_of(text) if text is not None else []
        if faults:
            more = "; …" if len(faults) > MAX_NAMED else ""
            raise FileError(f"{path}: the file is damaged: {'; '.join(faults[:MAX_NAMED])}{more}. Export it again")

    start_reader()
    outside = external_files(text or "")
    missing = tuple(name for name in outside if not (path.parent / name).is_file())
    try:
        answer = asked(path, "listed", areas, progress=progress, meanwhile=check)
    except FileError as error:
        if outside and "holds no" in str(error):
            where = "" if missing else ", beside it"
            raise FileError(f"{path}: its parts are in other files{where}: {', '.join(outside)}: trace those") from None
        raise
    listed, lost = cast("tuple[list[tuple[str, tuple[str, ...], tuple[str, ...], Colour | None, str, float | None]], "
                        "list[str]]", answer)
    faces = tuple(CadFace(k + 1, *each) for k, each in enumerate(listed))
    return CadFile(path, faces, missing, tuple(lost))


def _shape(sort: str, data: tuple[object, ...], loops: tuple[Array, ...], sign: float) -> FaceShape:
    made = {"quadric": Quadric, "bspline": BSplineSurface, "mesh": SurfaceMesh}[sort](*data)
    return FaceShape(cast("BSplineSurface | Quadric | SurfaceMesh", made), tuple(loops), sign)
