"""A mesh file in, its triangles out, as one bare mesh in mm or in parts with materials: the only importer of trimesh."""

from __future__ import annotations

import logging
import re
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from mirror_cad.mesh import SurfaceMesh
from raytrace.errors import TraceError
from raytrace.obj_file import read_obj
from raytrace.off_file import read_off
from raytrace.pictures import Decoded
from raytrace.ply_file import read_ply
from raytrace.polygon_mesh import FARTHEST, PolygonMesh, cut, misplaced, parts_of

if TYPE_CHECKING:
    from raytrace.mtl_file import Placed
    from raytrace.scene.parts import Part

Array = NDArray[np.float64]

POLYGON_KINDS: dict[str, Callable[[Path], PolygonMesh]] = {".obj": read_obj, ".ply": read_ply, ".off": read_off}
GLTF_KINDS = (".gltf", ".glb")
MESH_KINDS = (".obj", ".ply", ".off", ".gltf", ".glb", ".3mf")
MAX_TRIANGLES = 20_000_000  # some 3 GB in Embree
# The lengths that 3MF names in its header, and that trimesh writes glTF in; the other formats know none.
MM_PER_UNIT = {"micron": 1e-3, "millimeter": 1.0, "millimeters": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8,
               "meter": 1000.0, "meters": 1000.0}


class FileParts(NamedTuple):
    """A file's triangles with their materials; mm per unit, where it names one; and what is not drawn, each in some words."""

    parts: list[Part]
    unit_mm: float | None
    left_out: tuple[str, ...]


def read_mesh(path: Path) -> SurfaceMesh:
    """The triangles of an OBJ, PLY, OFF, glTF, GLB or 3MF file, in mm, all its parts in their places as one mesh.

    OBJ, PLY and OFF have no unit: their numbers are mm. glTF's are metres by its standard, with y up, but for files that
    trimesh wrote, whose numbers are in the unit of their extras; 3MF names its unit.
    Equal places become one vertex, so that normals can be interpolated across; polygons are cut into triangles that cover
    what they cover. STL files are read by `mirror_cad.stl_file.read_stl`.

    Raises
    ------
    FileError
        For a file that is missing or broken, holds no triangles or more than MAX_TRIANGLES, or has vertices that are not
        finite, faces that name no vertex or faces whose outline crosses itself.
    TraceError
        For another kind of file.
    """
    kind = path.suffix.lower()
    if kind not in MESH_KINDS:
        raise TraceError(f"{path}: a mesh is read from {', '.join(MESH_KINDS)}, not from {kind or 'a file without ending'!r}")
    if kind in POLYGON_KINDS:
        mesh = _polygons(path, kind)
        triangles = cut(path, mesh, MAX_TRIANGLES)
        if triangles.crossed:
            raise FileError(f"{path}: the outline of {triangles.crossed} of its polygons crosses itself: what they cover is "
                            "not defined; export triangles")
        return _merged(mesh.vertices, mesh.corners[triangles.corners])
    if kind in GLTF_KINDS:
        from raytrace.scene.gltf import read_gltf

        found = read_gltf(path)
        return _joined(path, [(part.vertices, part.faces) for part in found.parts], 1000.0 * found.metres)
    placed, unit = _loaded(path, kind, MAX_TRIANGLES)
    return _joined(path, placed, unit or 1.0)


def read_parts(path: Path, most_triangles: int, load_picture: Callable[[bytes, str], Decoded]) -> FileParts:
    """The triangles of an OBJ, PLY, OFF, 3MF or STL file with their materials, colours and texture coordinates.

    Where there is no material: light gray, matt, or the colours of vertices and faces (sRGB).
    load_picture : bytes and the picture's name → the picture.

    Raises
    ------
    FileError
        As `read_mesh`, and for material files and pictures that are missing.
    """
    from raytrace.scene.materials import Material
    from raytrace.scene.parts import Part

    kind = path.suffix.lower()
    if kind in POLYGON_KINDS:
        return _polygon_parts(path, kind, most_triangles, load_picture)
    if kind == ".stl":
        try:
            _refuse_stl(path, most_triangles)
        except OSError as error:
            raise FileError(f"{path}: cannot be read: {error.strerror or error}") from None
    placed, unit = _loaded(path, kind, most_triangles)
    gray = Material("", (0.5, 0.5, 0.5))
    return FileParts([Part(vertices, faces, gray) for vertices, faces in placed], unit, _undrawn_3mf(path, kind))


def _polygons(path: Path, kind: str) -> PolygonMesh:
    try:
        return POLYGON_KINDS[kind](path)
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from None


def _polygon_parts(path: Path, kind: str, most_triangles: int, load_picture: Callable[[bytes, str], Decoded]) -> FileParts:
    from raytrace.mtl_file import ObjMaterial, Placed, beside, materials_of
    from raytrace.scene.materials import Material

    mesh = _polygons(path, kind)
    named, left_out = materials_of(path, mesh.libraries, load_picture)
    triangles = cut(path, mesh, most_triangles)
    if triangles.crossed:
        left_out.add(f"what {triangles.crossed} polygons cover whose outline crosses itself")
    bare = Material("", (1.0, 1.0, 1.0) if mesh.colours is not None else (0.5, 0.5, 0.5))
    if mesh.picture is not None:
        picture = load_picture(beside(path, mesh.picture, "picture"), f"{path}: picture {mesh.picture!r}")
        bare = Material("", (1.0, 1.0, 1.0), texture=picture.colours)
        if picture.alpha is not None:
            left_out.add("transparency of its picture")
    missing = [name for name in mesh.looks if name not in named]
    if missing:
        left_out.add(f"materials that no file of its own describes ({', '.join(missing)})")
    gray = ObjMaterial(Material("", (0.5, 0.5, 0.5)), Placed(""))
    found = [named.get(name, gray) for name in mesh.looks]
    parts = parts_of(mesh, triangles, [each.material for each in found], bare)
    placed = {id(each.material): each.placed for each in found}
    return FileParts([_texture_placed(part, placed.get(id(part.material), Placed(""))) for part in parts], None,
                     tuple(sorted(left_out)))


def _texture_placed(part: Part, placed: Placed) -> Part:
    """The part with its picture scaled and moved as the options of its map say; there v goes up."""
    if part.uv is None or (placed.scale == (1.0, 1.0) and placed.offset == (0.0, 0.0)):
        return part
    u, v = part.uv.T
    return replace(part, uv=np.stack([placed.scale[0] * u + placed.offset[0],
                                      1.0 - placed.scale[1] * (1.0 - v) - placed.offset[1]], axis=1))


# It logs the tracebacks of files that it cannot read, which Python shows where nobody listens; the cause is said here.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


def _loaded(path: Path, kind: str, most_triangles: int) -> tuple[list[tuple[Array, NDArray[np.int64]]], float | None]:
    """The meshes of a 3MF or STL file in their places, checked; and mm per unit, if named."""
    import trimesh

    try:
        path.open("rb").close()
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from None
    try:
        with np.errstate(all="ignore"):  # what is no place is refused below
            # Without processing: trimesh would drop vertices that are not finite, and merge by rounding.
            scene = trimesh.load_scene(path, process=False, skip_materials=True)
            placed = []
            for node in scene.graph.nodes_geometry:
                matrix, name = scene.graph[node]
                mesh = scene.geometry[name]
                if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                    moved = mesh.copy().apply_transform(matrix)
                    placed.append((np.asarray(moved.vertices, dtype=np.float64), np.asarray(moved.faces, dtype=np.int64)))
            unit_name = scene.units
    except Exception as error:  # a broken file raises whatever its reader meets first
        raise FileError(f"{path}: not a readable {kind[1:].upper()} file ({type(error).__name__}: {error})") from None
    _check(path, placed, most_triangles)
    unit = MM_PER_UNIT.get(str(unit_name).lower()) if unit_name else None
    if unit_name and unit is None:
        raise FileError(f"{path}: its unit {unit_name!r} is none of {', '.join(MM_PER_UNIT)}")
    return placed, unit


def _refuse_stl(path: Path, most_triangles: int) -> None:
    """Refuse a binary STL file that is too large, before it is read, or shorter than its header says."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        header = stream.read(84)
    if size < 84 or header.lstrip().startswith(b"solid"):
        return
    named, held = int.from_bytes(header[80:84], "little"), (size - 84) // 50
    if held > most_triangles:
        raise FileError(f"{path}: {held} triangles are more than {most_triangles}: reduce the mesh")
    if held < named:
        raise FileError(f"{path}: holds {held} of the {named} triangles that its header names: is it cut short, or no STL?")


def _undrawn_3mf(path: Path, kind: str) -> tuple[str, ...]:
    """What a 3MF file says of colours, which are not read."""
    if kind != ".3mf":
        return ()
    try:
        with zipfile.ZipFile(path) as archive:
            models = [archive.read(name) for name in archive.namelist() if name.lower().endswith(".model")]
    except Exception as error:  # what trimesh took, another reader may not
        raise FileError(f"{path}: not a readable 3MF file ({type(error).__name__}: {error})") from None
    found = (re.search(rb"<(?:\w+:)?(?:basematerials|colorgroup|texture2dgroup)\b", model) for model in models)
    return ("its colours (3MF)",) if any(found) else ()


def _joined(path: Path, placed: list[tuple[Array, NDArray[np.int64]]], unit_mm: float) -> SurfaceMesh:
    """All meshes as one, in mm."""
    _check(path, placed, MAX_TRIANGLES)
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in placed)])
    return _merged(np.concatenate([vertices for vertices, _ in placed]) * unit_mm,
                   np.concatenate([faces + offset for (_, faces), offset in zip(placed, offsets, strict=False)]))


def _merged(vertices: Array, faces: NDArray[np.int64]) -> SurfaceMesh:
    """The mesh with the vertices that faces name, those at exactly the same place as one."""
    used, index = np.unique(faces, return_inverse=True)
    rows = np.ascontiguousarray(vertices[used] + 0.0)  # −0 and 0 are one place
    _, first, again = np.unique(rows.view("V24").ravel(), return_index=True, return_inverse=True)
    return SurfaceMesh(rows[first], again[index].reshape(-1, 3).astype(np.int32))


def _check(path: Path, placed: list[tuple[Array, NDArray[np.int64]]], most_triangles: int) -> None:
    count = sum(len(faces) for _, faces in placed)
    if count == 0:
        raise FileError(f"{path}: holds no triangles")
    if count > most_triangles:
        raise FileError(f"{path}: {count} triangles are more than {most_triangles}: reduce the mesh")
    for vertices, faces in placed:
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise FileError(f"{path}: its vertices have {vertices.shape[-1]} coordinates, three are needed")
        wrong = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise FileError(f"{path}: triangle {row} names vertices {faces[row].tolist()} of {len(vertices)}")
        wrong = misplaced(vertices)[faces].any(axis=1)
        if wrong.any():
            raise FileError(f"{path}: triangle {int(np.argmax(wrong))} has a corner that is not finite, or beyond "
                            f"{FARTHEST:g}")
