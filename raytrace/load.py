"""Read a reflector from a file: the faces of a CAD file, or a mesh."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from mirror_cad.stl_file import read_stl
from raytrace.errors import TraceError
from raytrace.file_kinds import CAD_KINDS, conversion
from raytrace.reflector import Reflector
from raytrace.surfaces.mesh import Normals

if TYPE_CHECKING:
    from raytrace.seating import Place

Colour = tuple[int, int, int]

GLASS_INDEX = 1.52  # float glass, at the helium d line


def load_reflector(path: str | Path, face: str | int | Colour | None = None, normals: Normals = "facets",
                   index: float = GLASS_INDEX, progress: Callable[[float], None] | None = None,
                   place: Place = "file") -> Reflector:
    """Read a reflector from a CAD file or a mesh.

    In a CAD file (.step, .stp, .iges, .igs, .brep, .brp) the faces named "optical face" reflect, on their outer side, and every
    other face is an obstacle; without such a name every face reflects, on both sides. With a "front face" beside the optical
    one, light goes through glass. Planes, spheres and cylinders are traced as such, other surfaces as the B-splines that they
    are or that are the same surface; faces of triangles alone (AP242) as a mesh. The kernel reads a CAD file in a child
    process, where a damaged one harms nobody. A mesh (.stl, .obj, .ply, .off, .gltf, .glb, .3mf) reflects on both sides.

    Parameters
    ----------
    path : of the file.
    face : which faces of a CAD file reflect, on both sides, the others being obstacles: those of a name, be it their own, or
        else that of their part (product, instance), or else of their layer; that of a number (1 is the first of the file); or
        those of a colour (red, green, blue, 0 to 255). None for what the file says.
    normals : of a mesh: "facets", or "interpolated" for the smooth surface that its vertices lie on.
    index : refractive, of the glass.
    progress : called with the share of a CAD file's faces that have been read.
    place : in which coordinates: "file", those of the file, in which a script shoots its rays; "face", mirror coordinates by
        the face's own frame (`raytrace.seating` has the rules); a `raytrace.Placement`, mirror coordinates as it states them;
        "auto", as the commands have it: those of the file for one that `mirror-cad build` wrote, "face" for any other. A
        right-hand mirror of `build` is reflected into mirror coordinates, which are the left-hand one's, unless they are the
        file's.

    Returns
    -------
    Reflector
        The placement that was taken is its `placement`.

    Raises
    ------
    FileError
        For a file that cannot be read or holds no face.
    TraceError
        For another kind of file, and where no face is the chosen one.
    TypeError
        For what is no path.
    """
    from mirror_cad.own_files import hand_of
    from raytrace.seating import seated

    if not isinstance(path, (str, PathLike)):
        raise TypeError(f"load_reflector() reads a file, and {type(path).__name__} is no path: Reflector.from_mirror(…) takes "
                        "a designed mirror")
    hand = hand_of(Path(path))
    return seated(_as_filed(Path(path), face, normals, index, progress), hand is not None, place, hand or "left")


def _as_filed(path: Path, face: str | int | Colour | None, normals: Normals, index: float,
              progress: Callable[[float], None] | None) -> Reflector:
    """`load_reflector` in the coordinates of the file."""
    kind = path.suffix.lower()
    if not 1.0 <= index < float("inf"):
        raise TraceError(f"an index of {index:g} is no glass in air: it must be 1 or more")
    if normals not in get_args(Normals):
        raise TraceError(f"normals = {normals!r}: a mesh is traced with normals = \"facets\" or \"interpolated\"")
    if kind in CAD_KINDS:
        from mirror_cad.cad_file import read_cad
        from raytrace.cad_reflector import reflector_from_cad

        return reflector_from_cad(read_cad(path), face, index, normals, progress)
    if face is not None:
        raise TraceError(f"{path}: a mesh has no faces to choose from; face = {face!r} is for CAD files")
    if kind == ".stl":
        return Reflector.of_mesh(read_stl(path), normals)
    from raytrace.mesh_files import MESH_KINDS, read_mesh

    if kind not in MESH_KINDS:
        raise TraceError(f"{path}: a reflector is read from {', '.join((*CAD_KINDS, '.stl', *MESH_KINDS))}, not from "
                         f"{kind or 'a file without ending'!r}{conversion(kind)}")
    return Reflector.of_mesh(read_mesh(path), normals)
