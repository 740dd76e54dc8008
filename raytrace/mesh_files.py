"""A mesh file in, its triangles out, as one bare mesh in mm or in parts with materials: the only importer of trimesh."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from mirror_cad.mesh import SurfaceMesh
from raytrace.errors import TraceError

if TYPE_CHECKING:
    from raytrace.scene.materials import Material
    from raytrace.scene.parts import Part

Array = NDArray[np.float64]

MESH_KINDS = (".obj", ".ply", ".off", ".gltf", ".glb", ".3mf")
MAX_TRIANGLES = 20_000_000  # some 3 GB in Embree
# The lengths that glTF (always metres) and 3MF (in its header) are written in; the other formats know none.
MM_PER_UNIT = {"micron": 1e-3, "millimeter": 1.0, "millimeters": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8,
               "meter": 1000.0, "meters": 1000.0}
# A face of an OBJ file with a vertex that is 0 or negative.
BAD_NUMBER = rb"^[ \t]*f[ \t](?:[^\n#]*[ \t])?((?:-[0-9]|0+(?![0-9]))[^ \t\r\n]*)"


def read_mesh(path: Path) -> SurfaceMesh:
    """The triangles of an OBJ, PLY, OFF, glTF, GLB or 3MF file, in mm, all its parts in their places as one mesh.

    OBJ, PLY and OFF have no unit: their numbers are mm. glTF's are metres by its standard, with y up; 3MF names its unit.
    Equal places become one vertex, so that normals can be interpolated across; polygons are cut into triangles. STL files
    are read by `mirror_cad.occt.tessellate.read_stl`.
    Raises: FileError for a file that is missing or broken, holds no triangles or more than MAX_TRIANGLES, or has vertices
    that are not finite or faces that name no vertex; TraceError for another kind of file.
    """
    kind = path.suffix.lower()
    if kind not in MESH_KINDS:
        raise TraceError(f"{path}: a mesh is read from {', '.join(MESH_KINDS)}, not from {kind or 'a file without ending'!r}")
    placed, named = _loaded(path, kind, MAX_TRIANGLES, skip_materials=True)
    parts, unit = [mesh for mesh, _ in placed], named or 1.0
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([part.vertices for part in parts]) * unit
    faces = np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=False)])
    return _merged(vertices, faces)


def read_parts(path: Path, most_triangles: int, load_picture: Callable[[bytes, str], NDArray[np.uint8]],
               ) -> tuple[list[Part], float | None]:
    """The triangles of an OBJ, PLY, OFF, 3MF or STL file with their materials, and mm per unit where the file names one.

    An OBJ file's Kd is taken as linear, its shininess Ns as a roughness; where there is no material: light gray, matt.
    load_picture : bytes and the picture's name → (h, w, 3) uint8.
    Raises: FileError as `read_mesh`, and for material files and pictures that are missing.
    """
    from raytrace.scene.parts import Part

    kind = path.suffix.lower()
    try:
        if kind == ".stl":
            _refuse_stl(path, most_triangles)
        if kind == ".obj":
            _refuse_missing(path, load_picture)
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from None
    placed, unit = _loaded(path, kind, most_triangles, skip_materials=False)
    known: dict[int, Material] = {}
    parts = []
    for mesh, look in placed:
        if id(look) not in known:
            known[id(look)] = _material(path, look, load_picture)
        uv = getattr(mesh.visual, "uv", None)
        if uv is not None:
            uv = np.asarray(uv, dtype=np.float64) * [1.0, -1.0] + [0.0, 1.0]  # from the picture's bottom to its top
        parts.append(Part(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64),
                          known[id(look)], uv=uv))
    return parts, unit


def _loaded(path: Path, kind: str, most_triangles: int, skip_materials: bool) -> tuple[list[tuple[Any, Any]], float | None]:
    """The file's meshes in their places, checked, each with its material as trimesh has it; and mm per unit, if named."""
    import trimesh

    try:
        path.open("rb").close()
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from None
    _refuse_misread(path, kind)
    try:
        # Without processing: trimesh would drop vertices that are not finite, and merge by rounding.
        scene = trimesh.load_scene(path, process=False, skip_materials=skip_materials)
        placed = []
        for node in scene.graph.nodes_geometry:
            matrix, name = scene.graph[node]
            mesh = scene.geometry[name]
            if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                placed.append((mesh.copy().apply_transform(matrix), getattr(mesh.visual, "material", None)))
    except Exception as error:  # a broken file raises whatever its reader meets first
        raise FileError(f"{path}: not a readable {kind[1:].upper()} file ({type(error).__name__}: {error})") from None
    if not placed:
        raise FileError(f"{path}: holds no triangles")
    count = sum(len(mesh.faces) for mesh, _ in placed)
    if count > most_triangles:
        raise FileError(f"{path}: {count} triangles are more than {most_triangles}: reduce the mesh")
    declared = _declared_faces(path, kind)
    if count < declared:
        raise FileError(f"{path}: holds {count} triangles of the {declared} faces that its header names: is it cut short?")
    unit = MM_PER_UNIT.get(str(scene.units).lower()) if scene.units else None
    if scene.units and unit is None:
        raise FileError(f"{path}: its unit {scene.units!r} is none of {', '.join(MM_PER_UNIT)}")
    for mesh, _ in placed:
        _check(path, np.asarray(mesh.vertices), np.asarray(mesh.faces))
    return placed, unit


def _material(path: Path, look: Any, load_picture: Callable[[bytes, str], NDArray[np.uint8]]) -> Material:
    from raytrace.scene.materials import Material

    values = getattr(look, "kwargs", {})
    if "kd" not in values and getattr(look, "image", None) is None:
        return Material(str(getattr(look, "name", None) or ""), (0.5, 0.5, 0.5))
    red, green, blue = (min(max(float(v), 0.0), 1.0) for v in values.get("kd", (1.0, 1.0, 1.0)))
    shininess = max(float(values.get("ns", 0.0)), 0.0)
    roughness = float((2.0 / (shininess + 2.0)) ** 0.25)  # Blinn's exponent is 2/α² − 2, and α the roughness squared
    texture = None
    if look.image is not None:
        file = path.parent / look.image.info["file_path"]
        texture = load_picture(file.read_bytes(), f"{path}: picture {look.image.info['file_path']!r}")
    return Material(str(look.name or ""), (red, green, blue), roughness=roughness, texture=texture)


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


def _refuse_missing(path: Path, load_picture: Callable[[bytes, str], NDArray[np.uint8]]) -> None:
    """Refuse an OBJ file whose material files or pictures are missing or broken: trimesh leaves them out without a word."""
    for library in re.findall(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", path.read_bytes(), re.MULTILINE):
        text = _beside(path, library, "material file")
        for picture in re.findall(rb"^[ \t]*map_Kd[ \t]+([^\r\n]+)", text, re.MULTILINE | re.IGNORECASE):
            load_picture(_beside(path, picture, "picture"), f"{path}: picture {picture.decode('utf-8', 'replace').strip()!r}")


def _beside(path: Path, name: bytes, what: str) -> bytes:
    file = path.parent / name.decode("utf-8", "replace").strip()
    try:
        return file.read_bytes()
    except OSError as error:
        raise FileError(f"{path}: its {what} {file.name!r} cannot be read: {error.strerror or error}") from None


def _merged(vertices: Array, faces: NDArray[np.int64]) -> SurfaceMesh:
    """The mesh with the vertices that faces name, those at exactly the same place as one."""
    used, index = np.unique(faces, return_inverse=True)
    rows = np.ascontiguousarray(vertices[used] + 0.0)  # −0 and 0 are one place
    _, first, again = np.unique(rows.view("V24").ravel(), return_index=True, return_inverse=True)
    return SurfaceMesh(rows[first], again[index].reshape(-1, 3).astype(np.int32))


def _check(path: Path, vertices: Array, faces: NDArray[np.int64]) -> None:
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise FileError(f"{path}: its vertices have {vertices.shape[-1]} coordinates, three are needed")
    wrong = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise FileError(f"{path}: triangle {row} names vertices {faces[row].tolist()} of {len(vertices)}")
    finite = np.asarray(np.isfinite(vertices).all(axis=1))
    wrong = ~finite[faces].all(axis=1)
    if wrong.any():
        raise FileError(f"{path}: triangle {int(np.argmax(wrong))} has a corner that is not finite")


def _refuse_misread(path: Path, kind: str) -> None:
    """Refuse what trimesh reads as something else without a word."""
    if kind == ".obj":
        # Taken as counted from the end of the file, not from the line that they stand in; and 0 as −1.
        found = re.search(BAD_NUMBER, path.read_bytes(), re.MULTILINE)
        if found:
            raise FileError(f"{path}: a face names vertex {found[1].decode('ascii', 'replace')}: vertices must be numbered "
                            "from 1, not from the end; export with absolute numbers")
    if kind == ".gltf":
        # One that is no JSON is replaced by any model.gltf beside it.
        try:
            json.loads(path.read_bytes())
        except ValueError as error:
            raise FileError(f"{path}: not a readable GLTF file ({error})") from None


def _declared_faces(path: Path, kind: str) -> int:
    """How many faces the header of a PLY or OFF file names; those of a text cut short are left out without a word."""
    data = path.read_bytes() if kind in (".ply", ".off") else b""
    if kind == ".ply":
        header, _, body = data.partition(b"end_header")
        counts = {name: int(number) for name, number in re.findall(rb"^element[ \t]+(\w+)[ \t]+(\d+)", header, re.MULTILINE)}
        faces, rows = counts.get(b"face", 0), sum(counts.values())
        if not re.search(rb"^format[ \t]+ascii", header, re.MULTILINE):
            return faces
    else:
        start = re.match(rb"(?:\s|#[^\n]*\n)*\w*OFF(?:\s|#[^\n]*\n)+(\d+)\s+(\d+)[^\n]*", data)
        if start is None:
            return 0
        faces, body = int(start[2]), data[start.end():]
        rows = int(start[1]) + faces
    lines = len(re.findall(rb"^[ \t]*[^\s#]", body, re.MULTILINE))
    if lines < rows:
        raise FileError(f"{path}: holds {lines} of the {rows} lines that its header names: is it cut short?")
    return faces
