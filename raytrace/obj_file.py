"""A Wavefront OBJ file in, its polygons with texture coordinates, colours and the names of materials out.

Source: Wavefront, Object files (.obj), Advanced Visualizer manual, appendix B1. Beyond it: colours behind a vertex's
coordinates, as MeshLab and ZBrush write them.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from raytrace.polygon_mesh import CornerValues, PolygonMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


def read_obj(path: Path) -> PolygonMesh:
    """The polygons of an OBJ file; lines, points and free-form surfaces are no part of it.

    Raises
    ------
    FileError
        For numbers that are none and for faces that name no vertex, with the line.
    OSError
    """
    lines = logical_lines(path.read_bytes())
    places, textures, faces = _Rows(), _Rows(), _Rows()
    before: tuple[list[int], list[int]] = [], []  # vertices and texture coordinates that a face may count back from
    looks: dict[str, int] = {}
    libraries: list[str] = []
    look, used = -1, []
    for number, line in enumerate(lines, 1):
        kind, _, rest = line.partition(b" ")
        if kind == b"v":
            places.add(number, rest)
        elif kind in (b"f", b"fo"):
            faces.add(number, rest)
            before[0].append(len(places.rows))
            before[1].append(len(textures.rows))
            used.append(look)
        elif kind == b"vt":
            textures.add(number, rest)
        elif kind == b"usemtl":
            look = looks.setdefault(text_of(rest), len(looks)) if rest.strip() else -1
        elif kind == b"mtllib":
            libraries += _names(path, text_of(rest))
    vertices, colours = _places(path, places)
    corners, texture, starts = _faces(path, faces, np.array(before, dtype=np.int64).T, len(vertices))
    uv = _texture_coordinates(path, textures)
    if len(uv) and (texture >= len(uv)).any():
        face = int(np.searchsorted(starts, np.argmax(texture >= len(uv)), side="right")) - 1
        raise FileError(f"{path}: line {faces.numbers[face]}: a face names texture coordinate {int(texture.max()) + 1} of "
                        f"{len(uv)}")
    return PolygonMesh(vertices, corners, starts, np.array(used, dtype=np.int64),
                       CornerValues(uv, texture) if len(uv) and (texture >= 0).any() else None,
                       None if colours is None else CornerValues(colours, corners), tuple(looks),
                       tuple(dict.fromkeys(libraries)))


def logical_lines(data: bytes) -> list[bytes]:
    """Lines without what surrounds them, one blank between words; those that end in a backslash with the next."""
    text = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\t", b" ")
    return [line.strip() for line in text.replace(b"\\\n", b" ").split(b"\n")]


def text_of(name: bytes) -> str:
    """A name as text: UTF-8, or what old programs wrote."""
    try:
        return name.decode().strip()
    except UnicodeDecodeError:
        return name.decode("cp1252", "replace").strip()


class _Rows:
    """Lines of one kind and their numbers."""

    def __init__(self) -> None:
        self.numbers: list[int] = []
        self.rows: list[bytes] = []

    def add(self, number: int, row: bytes) -> None:
        self.numbers.append(number)
        self.rows.append(row.partition(b"#")[0] if b"#" in row else row)

    def words(self) -> tuple[list[bytes], Integers]:
        """All words, and how many each line has."""
        # Split twice: a million short lists kept would take the garbage collector longer.
        counts = np.fromiter((len(row.split()) for row in self.rows), dtype=np.int64, count=len(self.rows))
        return b" ".join(self.rows).split(), counts


def _numbers(path: Path, lines: _Rows) -> tuple[Array, Integers]:
    """The numbers of lines, NaN behind the shorter ones, and how many each has."""
    words, counts = lines.words()
    try:
        flat = np.fromiter(map(float, words), dtype=np.float64, count=len(words))
    except ValueError:
        raise _misread(path, lines, float) from None
    if len(counts) == 0:
        return np.zeros((0, 0)), counts
    if (counts == counts[0]).all():
        return flat.reshape(len(counts), -1), counts
    table = np.full((len(counts), int(counts.max())), np.nan)
    table[np.arange(table.shape[1])[None, :] < counts[:, None]] = flat
    return table, counts


def _places(path: Path, lines: _Rows) -> tuple[Array, Array | None]:
    table, counts = _numbers(path, lines)
    if len(counts) == 0:
        return np.zeros((0, 3)), None
    if counts.min() < 3:
        row = int(np.argmin(counts))
        raise FileError(f"{path}: line {lines.numbers[row]}: its vertices have {counts[row]} coordinates, three are needed")
    if table.shape[1] < 6 or counts.min() < 6:
        return table[:, :3], None
    given = table[:, 3:6]
    return table[:, :3], np.clip(given * (255.0 if given.max() <= 1.0 else 1.0), 0.0, 255.0)


def _texture_coordinates(path: Path, lines: _Rows) -> Array:
    table, _ = _numbers(path, lines)
    if len(table) == 0:
        return np.zeros((0, 2))
    return np.concatenate([table, np.zeros((len(table), 1))], axis=1)[:, :2]  # one number: v is 0


def _faces(path: Path, lines: _Rows, before: Integers, count: int) -> tuple[Integers, Integers, Integers]:
    """The vertex and the texture coordinate (−1 for none) of each corner, and where each face begins."""
    words, counts = lines.words()
    starts = np.concatenate([[0], np.cumsum(counts)])
    try:
        named = _indices(words)
    except (ValueError, OverflowError):
        raise _misread(path, lines, lambda word: _indices([word])) from None
    of = np.repeat(np.arange(len(counts)), counts)
    if (named[:, 0] == 0).any():
        number = lines.numbers[of[np.argmax(named[:, 0] == 0)]]
        raise FileError(f"{path}: line {number}: a face names vertex 0: vertices must be numbered from 1, or from −1 back")
    absolute = np.where(named < 0, named + before[of], named - 1)
    absolute[:, 1] = np.where(named[:, 1] == 0, -1, absolute[:, 1])
    wrong = (absolute[:, 0] < 0) | (absolute[:, 0] >= count)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise FileError(f"{path}: line {lines.numbers[of[row]]}: a face names vertex {named[row, 0]} of {count}")
    return absolute[:, 0], absolute[:, 1], starts


def _indices(words: Sequence[bytes]) -> Integers:
    """Vertex and texture coordinate (k, 2) of corners written v, v/t, v//n or v/t/n; 0 where there is none."""
    named = np.zeros((len(words), 2), dtype=np.int64)
    text = b" ".join(words)
    slashes = words[0].count(b"/") if words else 0
    if slashes == 0 and b"/" not in text:
        named[:, 0] = np.fromiter(map(int, words), dtype=np.int64, count=len(words))
        return named
    flat = text.replace(b"//", b"/0/").replace(b"/", b" ").split()
    if len(flat) == len(words) * (slashes + 1) and text.count(b"/") == len(words) * slashes and all(
            word.count(b"/") == slashes for word in words):
        named[:] = np.fromiter(map(int, flat), dtype=np.int64, count=len(flat)).reshape(-1, slashes + 1)[:, :2]
        return named
    for k, word in enumerate(words):
        parts = word.split(b"/")
        named[k] = int(parts[0]), int(parts[1] or 0) if len(parts) > 1 else 0
    return named


def _misread(path: Path, lines: _Rows, read: object) -> FileError:
    """What to say of the first word that is no number."""
    for number, row in zip(lines.numbers, lines.rows, strict=True):
        for word in row.split():
            try:
                read(word)  # type: ignore[operator]
            except (ValueError, OverflowError):
                return FileError(f"{path}: not a readable OBJ file (line {number}: {text_of(word)!r} is no number)")
    return FileError(f"{path}: not a readable OBJ file (a number is too large)")


def _names(path: Path, text: str) -> list[str]:
    """The files that a line names: one name with blanks where there is such a file, else one a word, quoted or not."""
    if (path.parent / text).is_file():
        return [text]
    try:
        words = shlex.split(text, posix=True) if '"' in text or "'" in text else text.split()
    except ValueError:
        return [text]
    # Names with blanks and without quotes, of files that are not there: as one, so that the message names it.
    return words if len(words) < 2 or all(word.lower().endswith(".mtl") for word in words) else [text]
