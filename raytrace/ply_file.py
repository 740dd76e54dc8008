"""A PLY file in, its polygons with texture coordinates and colours out.

Source: G. Turk, The PLY polygon file format, 1994. Beyond it, as MeshLab and Blender write them: s, t and texture_u, texture_v
of vertices, `texcoord` of faces, "comment TextureFile", strips as `tristrips`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from raytrace.polygon_mesh import CornerValues, PolygonMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

TYPES = {"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
         "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8",
         "float64": "f8"}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TEXTURE_COORDINATES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
COLOURS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
MAX_ENTRIES = 2**31  # more than any file holds that is read


@dataclass(frozen=True, slots=True)
class _Property:
    """kind : of the values.   counted : the type of a list's length, "" for a single value."""

    name: str
    kind: str
    counted: str = ""


@dataclass(frozen=True, slots=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]


@dataclass(frozen=True, slots=True)
class _List:
    """Lists one after the other, and where each begins."""

    values: Array
    starts: Integers


_Columns = dict[str, Array | _List]


def read_ply(path: Path) -> PolygonMesh:
    """The polygons of a PLY file, text or binary.

    Raises
    ------
    FileError
        For a file that is none, or that holds less than its header names.
    OSError
    """
    data = path.read_bytes()
    order, elements, picture, body = _header(path, data)
    found: dict[str, _Columns] = {}
    reader = _Text(path, body) if order == "" else _Binary(path, body, order)
    with np.errstate(invalid="ignore"):  # NaN of some patterns of bits; what is no place is refused when polygons are cut
        for element in elements:
            found[element.name] = reader.read(element)
    vertices = found.get("vertex", {})
    columns = [_column(vertices, name) for name in ("x", "y", "z")]
    known = [column for column in columns if column is not None]
    if len(known) < 3:
        raise FileError(f"{path}: its vertices have {len(known)} coordinates, three are needed")
    corners, starts = _polygons(path, found)
    uv = _columns(vertices, TEXTURE_COORDINATES)
    colours = _columns(vertices, COLOURS)
    kinds = {p.name: p.kind for e in elements if e.name in ("vertex", "face") for p in e.properties}
    faces = found.get("face", {})
    given = faces.get("texcoord")
    of_uv = corners
    if isinstance(given, _List) and len(given.values) == 2 * len(corners):
        uv, of_uv = given.values.reshape(-1, 2), np.arange(len(corners))
    of_colours = corners
    painted = _columns(faces, COLOURS)
    if colours is None and painted is not None and len(painted) == len(starts) - 1:
        colours, of_colours = painted, np.repeat(np.arange(len(painted)), np.diff(starts))
    if colours is not None and "f" in "".join(kinds.get(name, "") for row in COLOURS for name in row):
        colours = 255.0 * colours
    if colours is not None:
        colours = np.clip(np.nan_to_num(colours), 0.0, 255.0)
    inside = (corners >= 0) & (corners < len(known[0]))  # others are refused when polygons are cut
    return PolygonMesh.of_one_look(
        np.stack(known, axis=1), corners, starts,
        None if uv is None else CornerValues(uv, np.where(inside, of_uv, -1)),
        None if colours is None else CornerValues(colours, np.where(inside, of_colours, -1)),
        picture if uv is not None else None)


def _header(path: Path, data: bytes) -> tuple[str, list[_Element], str | None, bytes]:
    """Byte order ("" for text), elements, the texture that a comment names, and what follows the header."""
    end = re.search(rb"^end_header[ \t]*(\r\n|\n|\r(?!\n))", data, re.MULTILINE) or re.search(rb"\rend_header(\r)", data)
    if not data.startswith(b"ply") or end is None:
        raise FileError(f"{path}: not a readable PLY file (no header from 'ply' to 'end_header')")
    order, picture = None, None
    elements: list[_Element] = []
    for line in data[:end.start()].decode("utf-8", "replace").splitlines():
        words = line.split()
        try:
            match words:
                case ["format", name, *_]:
                    order = ORDERS[name]
                case ["comment", "TextureFile", *_]:
                    picture = line.split("TextureFile", 1)[1].strip()
                case ["element", name, count]:
                    elements.append(_Element(name, int(count), []))
                case ["property", "list", counted, kind, name]:
                    elements[-1].properties.append(_Property(name, TYPES[kind], TYPES[counted]))
                case ["property", kind, name]:
                    elements[-1].properties.append(_Property(name, TYPES[kind]))
        except (KeyError, ValueError, IndexError):
            raise FileError(f"{path}: not a readable PLY file (its header has the line {line.strip()!r})") from None
    if order is None:
        raise FileError(f"{path}: not a readable PLY file (its header names no format)")
    for element in elements:
        if not 0 <= element.count <= MAX_ENTRIES:
            raise FileError(f"{path}: not a readable PLY file (its header names {element.count} entries of {element.name!r})")
    return order, elements, picture, data[end.end():]


def _short(path: Path, element: _Element, held: int) -> FileError:
    name = {"vertex": "vertices", "face": "faces"}.get(element.name, f"entries of {element.name!r}")
    return FileError(f"{path}: holds {max(held, 0)} of the {element.count} {name} that its header names: is it cut short?")


class _Text:
    """The numbers of a text file, in turn."""

    def __init__(self, path: Path, body: bytes) -> None:
        self._path = path
        try:
            self._numbers = np.array(list(map(float, body.split())))
        except ValueError as error:
            raise FileError(f"{path}: not a readable PLY file ({error})") from None
        self._at = 0

    def read(self, element: _Element) -> _Columns:
        n, at, numbers = element.count, self._at, self._numbers
        properties = element.properties
        if not any(p.counted for p in properties):
            width = len(properties)
            if at + n * width > len(numbers):
                raise _short(self._path, element, (len(numbers) - at) // max(width, 1))
            self._at = at + n * width
            table = numbers[at:self._at].reshape(n, width)
            return {p.name: table[:, k] for k, p in enumerate(properties)}
        alike = self._of_one_length(element)
        if alike is not None:
            return alike
        values: list[list[Array]] = [[] for _ in properties]
        for row in range(n):
            for k, p in enumerate(properties):
                count = 1
                if p.counted:
                    if at >= len(numbers):
                        raise _short(self._path, element, row)
                    count, at = _length(self._path, element, row, numbers[at]), at + 1
                if at + count > len(numbers):
                    raise _short(self._path, element, row)
                values[k].append(numbers[at:at + count])
                at += count
        self._at = at
        return _gathered(properties, values)

    def _of_one_length(self, element: _Element) -> _Columns | None:
        """All entries at once where their lists are as long as those of the first."""
        n, at, numbers = element.count, self._at, self._numbers
        lengths, width = [], 0
        for p in element.properties:
            if at + width >= len(numbers):
                return None
            lengths.append(int(numbers[at + width]) if p.counted and 0.0 <= numbers[at + width] < 1e6 else 0)
            width += 1 + (lengths[-1] if p.counted else 0)
        if n == 0 or at + n * width > len(numbers):
            return None
        table = numbers[at:at + n * width].reshape(n, width)
        found: _Columns = {}
        column = 0
        for p, length in zip(element.properties, lengths, strict=True):
            if p.counted and (table[:, column] != length).any():
                return None
            found[p.name] = (_List(table[:, column + 1:column + 1 + length].ravel(), length * np.arange(n + 1)) if p.counted
                             else table[:, column])
            column += 1 + (length if p.counted else 0)
        self._at = at + n * width
        return found


class _Binary:
    """The entries of a binary file, in turn."""

    def __init__(self, path: Path, body: bytes, order: str) -> None:
        self._path, self._body, self._order, self._at = path, body, order, 0

    def read(self, element: _Element) -> _Columns:
        n, properties = element.count, element.properties
        table = self._of_one_length(element)
        if table is not None:
            return table
        kinds = [(np.dtype(self._order + p.kind), np.dtype(self._order + p.counted) if p.counted else None) for p in properties]
        values: list[list[Array]] = [[] for _ in properties]
        at, body = self._at, self._body
        for row in range(n):
            for k, (kind, counted) in enumerate(kinds):
                count = 1
                if counted is not None:
                    if at + counted.itemsize > len(body):
                        raise _short(self._path, element, row)
                    count = _length(self._path, element, row, float(np.frombuffer(body, counted, 1, at)[0]))
                    at += counted.itemsize
                if at + count * kind.itemsize > len(body):
                    raise _short(self._path, element, row)
                values[k].append(np.frombuffer(body, kind, count, at))
                at += count * kind.itemsize
        self._at = at
        return _gathered(properties, values)

    def _of_one_length(self, element: _Element) -> _Columns | None:
        n, at = element.count, self._at
        fields: list[tuple[str, str, int] | tuple[str, str]] = []
        lengths = []
        for k, p in enumerate(element.properties):
            if p.counted:
                start = at + np.dtype([*fields]).itemsize if fields else at
                counted = np.dtype(self._order + p.counted)
                if start + counted.itemsize > len(self._body):
                    return None
                length = float(np.frombuffer(self._body, counted, 1, start)[0])
                lengths.append(int(length) if 0.0 <= length < 1e6 else 0)
                fields += [(f"n{k}", self._order + p.counted), (f"v{k}", self._order + p.kind, lengths[-1])]
            else:
                lengths.append(0)
                fields.append((f"v{k}", self._order + p.kind))
        row = np.dtype(fields)
        if n == 0 or at + n * row.itemsize > len(self._body):
            if n and not any(p.counted for p in element.properties):
                raise _short(self._path, element, (len(self._body) - at) // max(row.itemsize, 1))
            return None if any(p.counted for p in element.properties) else {p.name: np.zeros(0) for p in element.properties}
        table = np.frombuffer(self._body, row, n, at)
        found: _Columns = {}
        for k, p in enumerate(element.properties):
            values = table[f"v{k}"].astype(np.float64)
            if p.counted:
                if (table[f"n{k}"] != lengths[k]).any():
                    return None
                found[p.name] = _List(values.reshape(n * lengths[k]), lengths[k] * np.arange(n + 1))
            else:
                found[p.name] = values
        self._at = at + n * row.itemsize
        return found


def _length(path: Path, element: _Element, row: int, value: float) -> int:
    if not (0.0 <= value < MAX_ENTRIES and value == int(value)):
        raise FileError(f"{path}: not a readable PLY file (entry {row} of {element.name!r} is a list of {value:g})")
    return int(value)


def _gathered(properties: list[_Property], values: list[list[Array]]) -> _Columns:
    found: _Columns = {}
    for p, rows in zip(properties, values, strict=True):
        flat = np.concatenate([np.zeros(0), *rows]).astype(np.float64)
        found[p.name] = _List(flat, np.concatenate([[0], np.cumsum([len(row) for row in rows])]).astype(np.int64)) \
            if p.counted else flat
    return found


def _column(columns: _Columns, name: str) -> Array | None:
    column = columns.get(name)
    return None if isinstance(column, _List) else column


def _columns(columns: _Columns, names: tuple[tuple[str, ...], ...]) -> Array | None:
    """The first of some groups of columns that is there, (n, w)."""
    for group in names:
        found = [column for column in (_column(columns, name) for name in group) if column is not None]
        if len(found) == len(group) and len(found[0]):
            return np.stack(found, axis=1)
    return None


def _polygons(path: Path, found: dict[str, _Columns]) -> tuple[Integers, Integers]:
    for name in ("vertex_indices", "vertex_index"):
        lists = found.get("face", {}).get(name)
        if isinstance(lists, _List):
            return _whole(path, lists.values), lists.starts
    strips = found.get("tristrips", {})
    lists = next((values for values in strips.values() if isinstance(values, _List)), None)
    if lists is None:
        raise FileError(f"{path}: holds no triangles")
    triangles = [_of_strip(strip) for a, b in zip(lists.starts[:-1], lists.starts[1:], strict=True)
                 for strip in np.split(_whole(path, lists.values)[a:b], np.flatnonzero(lists.values[a:b] == -1))]
    corners = np.concatenate([np.zeros((0, 3), dtype=np.int64), *triangles])
    return corners.ravel(), 3 * np.arange(len(corners) + 1)


def _of_strip(strip: Integers) -> Integers:
    """Triangles of a strip, all on the side of the first; what joins two strips has no area."""
    strip = strip[strip >= 0]
    k = np.arange(max(len(strip) - 2, 0))
    triangles = strip[np.stack([k, k + 1 + k % 2, k + 2 - k % 2], axis=1)]
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]


def _whole(path: Path, values: Array) -> Integers:
    if not (np.isfinite(values).all() and (values == np.floor(values)).all() and (np.abs(values) < 2.0**53).all()):
        raise FileError(f"{path}: not a readable PLY file (a face names a vertex that is no whole number)")
    return values.astype(np.int64)
