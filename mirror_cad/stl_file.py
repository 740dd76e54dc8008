"""STL files, written and read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError, WriteError
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.own_files import Hand, hand_in_words

STL_HEADER = "mirror-cad, binary STL, mm"  # it must not begin with "solid", which is how a text file begins
STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write_mesh(path: Path, mesh: SurfaceMesh, hand: Hand | None = None) -> None:
    """Write triangles as binary STL: float32 corners, facets in the mesh's order; the header says which hand a mirror is.

    Facets that float32 leaves without three different corners are left out.

    Raises
    ------
    WriteError
        Where the file cannot be written, or reads back different.
    """
    corners = mesh.vertices.astype(np.float32)[mesh.faces]
    corners = corners[(corners != np.roll(corners, 1, axis=1)).any(axis=2).all(axis=1)]
    records = np.zeros(len(corners), dtype=STL_FACET)
    a, b, c = np.moveaxis(corners.astype(np.float64), 1, 0)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    records["normal"] = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0.0)
    records["corners"] = corners
    said = STL_HEADER if hand is None else f"{STL_HEADER}, {hand_in_words(hand)}"
    header = said.encode("ascii").ljust(80) + np.uint32(len(records)).astype("<u4").tobytes()
    try:
        path.write_bytes(header + records.tobytes())
    except OSError as error:
        raise WriteError(f"{path}: the STL file cannot be written: {error.strerror or error}") from None
    read = read_stl(path)
    if not np.array_equal(read.vertices[read.faces], corners):
        raise WriteError(f"{path}: reads back as {len(read.faces)} facets that differ from the {len(corners)} written")


def read_stl(path: Path) -> SurfaceMesh:
    """Read the triangles of a binary or ASCII STL file, equal corners as one vertex.

    Raises
    ------
    FileError
        For one that holds none, or corners that are not finite.
    """
    if not path.is_file():
        raise FileError(f"{path}: no such file")
    corners = _binary_corners(path)
    if corners is not None:
        rows = np.ascontiguousarray(corners.reshape(-1, 3) + np.float32(0.0))  # −0 and 0 are one point
        _, first, index = np.unique(rows.view("V12").ravel(), return_index=True, return_inverse=True)
        return SurfaceMesh(rows[first].astype(np.float64), index.reshape(-1, 3).astype(np.int32))
    from mirror_cad.occt.tessellate import read_stl_by_kernel  # a text file: ours are none, and do without

    return read_stl_by_kernel(path)


def _binary_corners(path: Path) -> NDArray[np.float32] | None:
    """The corners (n, 3, 3) of a binary STL, which is known by its length; None for any other file."""
    data = path.read_bytes()
    count = int(np.frombuffer(data[80:84], "<u4")[0]) if len(data) > 84 else 0
    if count == 0 or len(data) != 84 + STL_FACET.itemsize * count:
        return None
    corners: NDArray[np.float32] = np.frombuffer(data, STL_FACET, count, 84)["corners"].astype(np.float32)
    return corners if np.isfinite(corners).all() else None
