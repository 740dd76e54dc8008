"""Read a reflector from a file: the faces of a STEP file, or a mesh."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import numpy as np

from mirror_cad.mesh import SurfaceMesh
from raytrace.errors import TraceError
from raytrace.reflector import OBSTACLE_DEFLECTION_MM, Reflector
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.faces import Face
from raytrace.surfaces.mesh import Normals
from raytrace.surfaces.plate import Plate
from raytrace.surfaces.quadric import QuadricFace
from raytrace.surfaces.seams import without_seams

if TYPE_CHECKING:
    from mirror_cad.occt.step import StepFace, StepFile

Colour = tuple[int, int, int]

OPTICAL_FACE = "optical face"
FRONT_FACE = "front face"
GLASS_INDEX = 1.52  # float glass, at the helium d line


def load_reflector(path: str | Path, face: str | int | Colour | None = None, normals: Normals = "facets",
                   index: float = GLASS_INDEX) -> Reflector:
    """Read a reflector from a STEP file (.step, .stp) or a mesh (.stl, .obj, .ply, .off, .gltf, .glb, .3mf).

    In a STEP file the faces named "optical face" reflect, on their outer side, and every other face is an obstacle;
    without such a name every face reflects, on both sides. `face` chooses otherwise: the faces of another name, the face of a
    number (1 is the first of the file), or the faces of a colour (red, green, blue, 0 to 255); these reflect on both sides,
    and the others are obstacles. With a "front face" beside the optical one, light goes through
    glass of refractive index `index`. Planes, spheres and cylinders are traced as such, other surfaces as the B-splines
    that they are or that are the same surface. A mesh reflects on both sides, from its facets or, with
    normals = "interpolated", as the smooth surface its vertices lie on.
    Raises: FileError for a file that cannot be read or holds no face; TraceError for another kind of file, or where no face
    is the chosen one.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if not 1.0 <= index < float("inf"):
        raise TraceError(f"an index of {index:g} is no glass in air: it must be 1 or more")
    if normals not in get_args(Normals):
        raise TraceError(f"normals = {normals!r}: a mesh is traced with normals = \"facets\" or \"interpolated\"")
    if kind in (".step", ".stp"):
        from mirror_cad.occt.step import read_step

        file = read_step(path)
        return reflector_of(file, index) if face is None else _chosen(file, path, face)
    if face is not None:
        raise TraceError(f"{path}: a mesh has no faces to choose from; face = {face!r} is for STEP files")
    if kind == ".stl":
        from mirror_cad.occt.tessellate import read_stl

        return Reflector.of_mesh(read_stl(path), normals)
    from raytrace.mesh_files import MESH_KINDS, read_mesh

    if kind not in MESH_KINDS:
        raise TraceError(f"{path}: a reflector is read from .step, .stp, .stl, {', '.join(MESH_KINDS)}, not from "
                         f"{kind or 'a file without ending'!r}")
    return Reflector.of_mesh(read_mesh(path), normals)


def reflector_of(file: StepFile, index: float = GLASS_INDEX) -> Reflector:
    """`load_reflector` for a STEP file that has been read already."""
    from mirror_cad.occt.tessellate import face_mesh, triangulate

    named = any(face.name == OPTICAL_FACE for face in file.faces)
    fronts = [face for face in file.faces if face.name == FRONT_FACE] if named else []
    surfaces, obstacles = [], []
    for face in file.faces:
        if not named or face.name == OPTICAL_FACE:
            surfaces.append(_face(face, one_sided=named))
        elif face not in fronts:
            triangulate(face.raw, OBSTACLE_DEFLECTION_MM, straight=True)
            obstacles.append(face_mesh(face.raw))
    surfaces = list(without_seams(surfaces))
    if not fronts:
        return Reflector.of_faces(tuple(surfaces), _joined(obstacles))
    if len(fronts) != 1 or len(surfaces) != 1:
        raise TraceError(f"glass is traced through one {FRONT_FACE!r} and one {OPTICAL_FACE!r}; the file has "
                         f"{len(fronts)} and {len(surfaces)}")
    # The reflecting side of the back is that of the glass, the file's inner one.
    back = replace(surfaces[0], sign=-surfaces[0].sign)
    return Reflector(Plate(_face(fronts[0], one_sided=True), back, index), _joined(obstacles))


def _chosen(file: StepFile, path: Path, face: str | int | Colour) -> Reflector:
    """The reflector in which the faces of a name, a number or a colour reflect."""
    from mirror_cad.occt.tessellate import face_mesh, triangulate

    if isinstance(face, bool) or not isinstance(face, str | int | np.integer | tuple | list):
        raise TraceError(f"face = {face!r}: a name, a number from 1 on, or a colour (red, green, blue), 0 to 255, chooses a "
                         "face")
    if isinstance(face, str):
        wanted = [k for k, each in enumerate(file.faces) if each.name == face]
        there = "names: " + (", ".join(sorted({repr(each.name) for each in file.faces if each.name})) or "none")
    elif isinstance(face, int | np.integer):
        wanted = [face - 1] if 1 <= face <= len(file.faces) else []
        there = f"numbers: 1 to {len(file.faces)}"
    else:
        from mirror_cad.occt.step import face_colours

        colours = face_colours(path)
        if len(colours) != len(file.faces):
            raise TraceError(f"{path}: the kernel has colours for {len(colours)} of {len(file.faces)} faces: choose the face "
                             "by its number")
        wanted = [k for k, colour in enumerate(colours) if colour == tuple(face)]
        there = "colours: " + (", ".join(str(colour) for colour in sorted({c for c in colours if c is not None})) or "none")
    if not wanted:
        raise TraceError(f"{path}: no face is {face!r}; the file has {there}")
    obstacles = []
    for each in (each for k, each in enumerate(file.faces) if k not in wanted):
        triangulate(each.raw, OBSTACLE_DEFLECTION_MM, straight=True)
        obstacles.append(face_mesh(each.raw))
    return Reflector.of_faces(without_seams([_face(file.faces[k], one_sided=False) for k in wanted]), _joined(obstacles))


def _face(face: StepFace, one_sided: bool) -> Face:
    from mirror_cad.occt.convert import face_loops, is_reversed

    quadric = face.quadric
    if quadric is not None:
        return QuadricFace(quadric, face_loops(face.raw), -1.0 if is_reversed(face.raw) else 1.0, one_sided)
    return BSplineFace(face.surface, face_loops(face.face), -1.0 if is_reversed(face.face) else 1.0, one_sided)


def _joined(meshes: list[SurfaceMesh]) -> SurfaceMesh | None:
    if not meshes:
        return None
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return SurfaceMesh(np.concatenate([mesh.vertices for mesh in meshes]),
                       np.concatenate([mesh.faces + o for mesh, o in zip(meshes, offsets, strict=False)]).astype(np.int32))
