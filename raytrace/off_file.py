"""An OFF file in, its polygons with colours and texture coordinates out.

Source: Geomview manual, section 4.2.5: [ST][C][N][4][n]OFF, counts, vertices, faces that may end in a colour.
"""

from __future__ import annotations

import re
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from raytrace.polygon_mesh import CornerValues, PolygonMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

HEADER = re.compile(rb"(ST)?(C)?(N)?(4)?(n)?OFF(?![A-Za-z0-9])")


def read_off(path: Path) -> PolygonMesh:
    """The polygons of an OFF file in text.

    Raises
    ------
    FileError
        For a file that is none, or that holds less than its header names.
    OSError
    """
    data = path.read_bytes().removeprefix(b"\xef\xbb\xbf").replace(b"\r", b"\n")
    lines = [line for line in (line.partition(b"#")[0].strip() for line in data.split(b"\n")) if line]
    header = HEADER.match(lines[0]) if lines else None
    if header is None:
        raise _misread(path, "it does not begin with OFF")
    textured, coloured, with_normals, four, high = (group is not None for group in header.groups())
    lines[0] = lines[0][header.end():].strip()
    if lines[0].upper().startswith(b"BINARY"):
        raise FileError(f"{path}: a binary OFF file is not read: export as text")
    if four or high:
        raise FileError(f"{path}: its vertices have four or more coordinates, three are needed")
    lines = [line for line in lines if line]
    try:
        count, faces = (int(word) for word in lines[0].split()[:2])
    except (ValueError, IndexError):
        raise _misread(path, "its header names no counts of vertices and faces") from None
    if count < 0 or faces < 0:
        raise _misread(path, f"its header names {count} vertices and {faces} faces")
    if len(lines) - 1 < count + faces:
        raise FileError(f"{path}: holds {len(lines) - 1} of the {count + faces} lines that its header names: is it cut short?")
    rows = [line.split() for line in lines[1:count + 1]]
    least = 3 + 3 * with_normals + 3 * coloured + 2 * textured
    try:
        if min(map(len, rows), default=least) < least:
            row = next(k for k, words in enumerate(rows) if len(words) < least)
            raise _misread(path, f"vertex {row} has {len(rows[row])} numbers, {least} are needed")
        vertices = np.array([list(map(float, row[:3])) for row in rows], dtype=np.float64).reshape(-1, 3)
        corners, starts, behind = _faces(path, [line.split() for line in lines[count + 1:count + faces + 1]])
        inside = np.where((corners >= 0) & (corners < count), corners, -1)  # others are refused when polygons are cut
        at = 3 + 3 * with_normals
        colours = uv = None
        if textured:
            uv = CornerValues(np.array([list(map(float, row[-2:])) for row in rows]).reshape(-1, 2), inside)
        if coloured:
            colours = CornerValues(_colours([row[at:at + 3] for row in rows]), inside)
        elif any(len(row) >= 3 for row in behind):
            given = np.array([len(row) >= 3 for row in behind])
            of = np.where(given, np.cumsum(given) - 1, -1)
            colours = CornerValues(_colours([row[:3] for row in behind if len(row) >= 3]), np.repeat(of, np.diff(starts)))
    except (ValueError, OverflowError) as error:
        raise _misread(path, str(error)) from None
    return PolygonMesh.of_one_look(vertices, corners, starts, uv, colours)


def _faces(path: Path, rows: list[list[bytes]]) -> tuple[Integers, Integers, list[list[bytes]]]:
    """Corners, where each face begins, and what stands behind its corners."""
    counts = np.fromiter((int(row[0]) for row in rows), dtype=np.int64, count=len(rows))
    lengths = np.fromiter(map(len, rows), dtype=np.int64, count=len(rows))
    wrong = (counts < 1) | (lengths < counts + 1)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise _misread(path, f"face {row} names {lengths[row] - 1} of its {counts[row]} vertices: is it cut short?")
    corners = np.array(list(map(int, chain.from_iterable(row[1:n + 1] for row, n in zip(rows, counts.tolist(), strict=True)))),
                       dtype=np.int64)
    behind = [row[n + 1:] for row, n in zip(rows, counts.tolist(), strict=True)]
    return corners, np.concatenate([[0], np.cumsum(counts)]), behind


def _colours(rows: list[list[bytes]]) -> Array:
    """0 … 255, of whole numbers as they are and of others as shares of 1."""
    values = np.array([list(map(float, row)) for row in rows], dtype=np.float64).reshape(-1, 3)
    shares = any(b"." in word or b"e" in word for word in chain.from_iterable(rows))
    return np.clip(np.nan_to_num(values) * (255.0 if shares else 1.0), 0.0, 255.0)


def _misread(path: Path, what: str) -> FileError:
    return FileError(f"{path}: not a readable OFF file ({what})")
