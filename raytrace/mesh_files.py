"""A mesh file in, its triangles in mm out, equal places as one vertex: the only module that imports trimesh."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from mirror_cad.mesh import SurfaceMesh
from raytrace.errors import TraceError

Array = NDArray[np.float64]

MESH_KINDS = (".obj", ".ply", ".off", ".gltf", ".glb", ".3mf")
MOST_TRIANGLES = 20_000_000  # some 3 GB in Embree
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
    Raises: FileError for a file that is missing or broken, holds no triangles or more than MOST_TRIANGLES, or has vertices
    that are not finite or faces that name no vertex; TraceError for another kind of file.
    """
    import trimesh

    kind = path.suffix.lower()
    if kind not in MESH_KINDS:
        raise TraceError(f"{path}: a mesh is read from {', '.join(MESH_KINDS)}, not from {kind or 'a file without ending'!r}")
    try:
        path.open("rb").close()
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from None
    _refuse_misread(path, kind)
    try:
        # Without processing: trimesh would drop vertices that are not finite, and merge by rounding.
        scene = trimesh.load_scene(path, process=False, skip_materials=True)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    except Exception as error:  # a broken file raises whatever its reader meets first
        raise FileError(f"{path}: not a readable {kind[1:].upper()} file ({type(error).__name__}: {error})") from None
    if not parts:
        raise FileError(f"{path}: holds no triangles")
    count = sum(len(part.faces) for part in parts)
    if count > MOST_TRIANGLES:
        raise FileError(f"{path}: {count} triangles are more than {MOST_TRIANGLES}: reduce the mesh")
    declared = _declared_faces(path, kind)
    if count < declared:
        raise FileError(f"{path}: holds {count} triangles of the {declared} faces that its header names: is it cut short?")
    unit = MM_PER_UNIT.get(str(scene.units).lower()) if scene.units else 1.0
    if unit is None:
        raise FileError(f"{path}: its unit {scene.units!r} is none of {', '.join(MM_PER_UNIT)}")
    for part in parts:
        _check(path, np.asarray(part.vertices), np.asarray(part.faces))
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([part.vertices for part in parts]) * unit
    faces = np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=False)])
    return _merged(vertices, faces)


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
