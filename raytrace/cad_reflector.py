"""The reflector that the faces of a CAD file make, and which of them reflect."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mirror_cad.cad_file import CadFace, CadFile, Colour, FaceShape
from mirror_cad.errors import FileError
from mirror_cad.guarded import Progress
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.surfaces.quadric import Quadric
from raytrace.assembly import FRONT_FACE, OPTICAL_FACE, assembled, joined
from raytrace.errors import TraceError
from raytrace.reflector import OBSTACLE_DEFLECTION_MM, Reflector
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.faces import Face
from raytrace.surfaces.mesh import MeshSurface, Normals
from raytrace.surfaces.quadric import QuadricFace

MAX_NAMED = 20  # names of a kind in a message


def reflector_from_cad(file: CadFile, face: str | int | Colour | None, index: float, normals: Normals,
                       progress: Progress | None = None) -> Reflector:
    """The reflector of a CAD file, as `load_reflector` describes it.

    Raises
    ------
    TraceError
        Where no face is the chosen one.
    FileError, SurfaceError
        Where a face cannot be had.
    """
    if face is not None:
        return _reflector(file, chosen(file, face), (), False, index, normals, progress)
    if OPTICAL_FACE in file.lost:
        raise FileError(f"{file.path}: the kernel cannot make its {OPTICAL_FACE!r}: the file is damaged. Export it again")
    optical = [each for each in file.faces if each.name == OPTICAL_FACE]
    if not optical and file.missing:
        raise TraceError(f"{file.path}: parts of it are in files that are not beside it ({', '.join(file.missing)}): put them "
                         "there, or choose by face what reflects")
    if not optical and file.lost:
        total = len(file.faces) + len(file.lost)
        raise FileError(f"{file.path}: the kernel can make {len(file.faces)} of its {total} faces only: export it again, or "
                        "choose by face what reflects (--faces lists those that can be had)")
    fronts = [each for each in file.faces if each.name == FRONT_FACE] if optical else []
    return _reflector(file, optical or list(file.faces), fronts, bool(optical), index, normals, progress)


def plate_reflector(optical: FaceShape, fronts: Sequence[FaceShape], sides: Sequence[SurfaceMesh], index: float) -> Reflector:
    """The reflector of a plate of ours that has been read already, as `load_reflector` makes it, where its file has it.

    Parameters
    ----------
    optical, fronts
        What reflects, on its outer side, and the faces of glass before it.
    sides
        All its other faces.
    index
        Refractive, of the glass.
    """
    return assembled([_face(optical, True)], [_face(each, True) for each in fronts], list(sides), index)


def chosen(file: CadFile, face: str | int | Colour) -> list[CadFace]:
    """The faces of a name, a number or a colour. A name is a face's own, or else its part's, or else its layer's.

    Raises
    ------
    TraceError
        Where there are none, with what there is.
    """
    if isinstance(face, bool) or not isinstance(face, str | int | np.integer | tuple | list):
        raise TraceError(f"face = {face!r}: a name (of a face, a part or a layer), a number from 1 on, or a colour (red, "
                         "green, blue), 0 to 255, chooses a face")
    if isinstance(face, str):
        kinds: dict[str, list[tuple[str, ...]]] = {"names": [(each.name,) for each in file.faces],
                                                    "parts": [each.parts for each in file.faces],
                                                    "layers": [each.layers for each in file.faces]}
        wanted: list[CadFace] = []
        for names in kinds.values():
            wanted = wanted or [each for each, has in zip(file.faces, names, strict=True) if face in has]
        there = "; ".join(f"{kind}: {_named(name for has in names for name in has)}" for kind, names in kinds.items())
    elif isinstance(face, int | np.integer):
        wanted = [each for each in file.faces if each.number == face]
        there = f"numbers: 1 to {len(file.faces)}"
    else:
        wanted = [each for each in file.faces if each.colour == tuple(face)]
        known = sorted({each.colour for each in file.faces if each.colour is not None})
        there = "colours: " + (", ".join(str(colour) for colour in known) or "none")
    if not wanted and face in file.lost:
        raise FileError(f"{file.path}: the kernel cannot make the face {face!r}: the file is damaged. Export it again")
    if not wanted:
        raise TraceError(f"{file.path}: no face is {face!r}; the file has {there}")
    return wanted


def _named(names: Iterable[str]) -> str:
    known = sorted({name for name in names if name})
    shown = [repr(name) for name in known[:MAX_NAMED]] + (["…"] if len(known) > MAX_NAMED else [])
    return ", ".join(shown) or "none"


def _reflector(file: CadFile, reflecting: Sequence[CadFace], fronts: Sequence[CadFace], one_sided: bool, index: float,
               normals: Normals, progress: Progress | None) -> Reflector:
    taken = {each.number for each in (*reflecting, *fronts)}
    others = [each for each in file.faces if each.number not in taken]
    total = len(reflecting) + len(fronts) + len(others)
    done = [0]

    def share(part: int) -> Progress | None:
        start, done[0] = done[0], done[0] + part
        return None if progress is None else lambda value: progress((start + part * value) / total)

    shapes = file.shapes(reflecting, progress=share(len(reflecting)))
    front = [_face(each, True) for each in file.shapes(fronts, progress=share(len(fronts)))] if fronts else []
    obstacles = file.meshes(others, OBSTACLE_DEFLECTION_MM, progress=share(len(others))) if others else []
    meshes = [each.surface for each in shapes if isinstance(each.surface, SurfaceMesh)]
    if not meshes:
        return assembled([_face(each, one_sided) for each in shapes], front, obstacles, index)
    if len(meshes) != len(shapes):
        first = next(each.number for each in reflecting if each.surface == "triangles")
        raise TraceError(f"{file.path}: {len(meshes)} of the {len(shapes)} faces that are to reflect, face {first} the first, "
                         "are triangles without a surface; choose faces of one sort")
    whole = joined(meshes)
    assert whole is not None  # there are some
    return Reflector(MeshSurface(whole, normals), joined(obstacles))


def _face(shape: FaceShape, one_sided: bool) -> Face:
    surface = shape.surface
    if isinstance(surface, SurfaceMesh):
        raise TraceError("a front face of triangles alone is no way into glass")
    if isinstance(surface, Quadric):
        return QuadricFace(surface, shape.loops, shape.sign, one_sided)
    return BSplineFace(surface, shape.loops, shape.sign, one_sided)
