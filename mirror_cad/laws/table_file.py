"""The columns of a table from a text file, as spreadsheets and measuring machines write it."""

from __future__ import annotations

import csv
import re
from pathlib import Path

# Rows of a table and then some, at 100 characters each.
MAX_BYTES = 20_000_000
SEPARATORS = {"\t": "tab", ";": "semicolon", ",": "comma"}
LENGTH_UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0}  # in mm
COMMENT = "#"

_UNIT = r"(?P<unit>mm|cm|m)"
_PER = rf"(?:1\s*/\s*|per[\s_]+){_UNIT}|{_UNIT.replace('unit', 'inverse')}\s*(?:\^?\s*-\s*1|⁻¹)"
_BEFORE, _AFTER = r"[\s_]*(?:in\s+|/)?\s*[\[(]?\s*", r"\s*[\])]?"  # of a unit: x_mm, x [mm], x (mm), x in mm, x / mm
_X = re.compile(rf"x{_BEFORE}{_UNIT}{_AFTER}", re.IGNORECASE)
_RADIUS = re.compile(rf"(?:r|r_?[xy]|radius(?:\s+of\s+curvature)?){_BEFORE}{_UNIT}{_AFTER}", re.IGNORECASE)
_CURVATURE = re.compile(rf"(?:k|k_?[xy]|κ_?[xy]?|kappa|curvature){_BEFORE}(?:{_PER}){_AFTER}", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?|[+-]?\d+,(?:[eE][+-]?\d+)?")
_MINUS = str.maketrans("−–", "--")  # what word processors make of a sign


def read_columns(path: Path) -> dict[str, list[float]]:
    """Read x and R, or x and κ, from a text file.

    Columns stand between commas, semicolons or tabs, the latter two with decimal points or decimal commas; the first line
    names them with their units (`x_mm`, `x [mm]`, `R in m`, `curvature (1/m)`). Further columns, empty rows and those that
    begin with # are left out. UTF-8, UTF-16 with its mark, or Windows-1252.

    Parameters
    ----------
    path : Path

    Returns
    -------
    dict
        "x_mm" and one of "radius_mm" and "curvature_per_mm": lists of float.

    Raises
    ------
    ValueError
        For a file that is none of that, with the line.
    """
    lines = _lines(path)
    if lines and re.fullmatch(r"sep=.", lines[0][1].strip(), re.IGNORECASE):  # Excel's own first line
        separator = lines.pop(0)[1].strip()[-1]
        candidates = [separator]
    else:
        candidates = list(SEPARATORS)
    head = lines[0][1] if lines else ""
    headers = {mark: [_column(name) for name in _cells(head, mark)] for mark in candidates}
    separator = max(headers, key=lambda mark: len({column[0] for column in headers[mark] if column}))
    header = headers[separator]
    columns = _wanted(path, head, header)
    numbers: dict[str, list[float]] = {name: [] for name, _, _ in columns}
    decimal = _decimal_sign(path, separator, lines[1:], [index for _, index, _ in columns])
    for number, line in lines[1:]:
        cells = _cells(line, separator)
        if not any(cells):
            continue
        if separator == "," and len(cells) > len(header) and any(cells[len(header):]):
            raise ValueError(f"file = \"{path}\", line {number}: {line.strip()[:80]!r} has {len(cells)} entries under "
                             f"{len(header)} columns: if these are decimal commas, put semicolons or tabs between the columns")
        for name, index, scale in columns:
            cell = cells[index] if index < len(cells) else ""
            value = _number(cell, decimal)
            if value is None:
                if name == "radius_mm" and cell.lower() in ("∞", "infinity", "+inf", "inf"):
                    value = float("inf")
                else:
                    raise ValueError(f"file = \"{path}\", line {number}: {cell[:40]!r} in {line.strip()[:80]!r} is no number")
            numbers[name].append(value / scale if name == "curvature_per_mm" else value * scale)
    return numbers


def _lines(path: Path) -> list[tuple[int, str]]:
    """The lines that hold something, with their numbers."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ValueError(f"file = \"{path}\" has {path.stat().st_size / 1e6:.1f} MB, at most {MAX_BYTES / 1e6:g} are read")
        data = path.read_bytes()
    except OSError as error:
        raise ValueError(f"file = \"{path}\" cannot be read as CSV: {error.strerror or error}") from None
    text = _decoded(data)
    if text is None or "\0" in text:
        raise ValueError(f"file = \"{path}\" cannot be read as CSV: it is no text")
    return [(number, line) for number, line in enumerate(text.splitlines(), start=1)
            if line.strip() and not line.lstrip("\"' \t").startswith(COMMENT)]


def _decoded(data: bytes) -> str | None:
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ["utf-16"]
    elif b"\0" in data[:200]:  # UTF-16 without its mark: every other byte of plain text is 0
        encodings = ["utf-16-le" if data[1:2] == b"\0" else "utf-16-be"]
    else:
        encodings = ["utf-8-sig", "cp1252"]
    for encoding in encodings:
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    return None


def _cells(line: str, separator: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    except (csv.Error, StopIteration):
        return []


def _column(name: str) -> tuple[str, float] | None:
    """The key that a column's name stands for, and its unit in mm."""
    for key, pattern in (("x_mm", _X), ("radius_mm", _RADIUS), ("curvature_per_mm", _CURVATURE)):
        found = pattern.fullmatch(name.strip())
        if found:
            unit = next(unit for unit in found.groups() if unit)
            return key, LENGTH_UNITS[unit.lower()]
    return None


def _wanted(path: Path, head: str, header: list[tuple[str, float] | None]) -> list[tuple[str, int, float]]:
    """The two columns: key, index and unit in mm."""
    found = [(column[0], index, column[1]) for index, column in enumerate(header) if column]
    names = [name for name, _, _ in found]
    if len(found) > 2 and "x_mm" in names:
        raise ValueError(f"file = \"{path}\" has {len(found)} columns that may be meant ({head.strip()[:80]}): leave one x and "
                         "one radius or curvature")
    if sorted(names) not in (["radius_mm", "x_mm"], ["curvature_per_mm", "x_mm"]):
        raise ValueError(f"file = \"{path}\" must start with a line naming the columns x_mm and radius_mm, or x_mm and "
                         "curvature_per_mm, or the same with other units (x [m], R [m], curvature [1/m]), between commas, "
                         f"semicolons or tabs; it starts with {head.strip()[:80] or 'nothing'}")
    return found


def _decimal_sign(path: Path, separator: str, lines: list[tuple[int, str]], indices: list[int]) -> str:
    """What stands before the decimals in the file."""
    if separator == ",":
        return "."
    first: dict[str, tuple[int, str]] = {}
    for number, line in lines:
        cells = _cells(line, separator)
        for cell in (cells[index] for index in indices if index < len(cells)):
            for sign in ",.":
                if sign in cell:
                    first.setdefault(sign, (number, cell))
    if len(first) == 2:
        (at, comma), (other, point) = first[","], first["."]
        raise ValueError(f"file = \"{path}\" has a comma in {comma[:40]!r} (line {at}) and a point in {point[:40]!r} (line "
                         f"{other}): write decimals with one of them, and nothing between thousands")
    return "," if "," in first else "."


def _number(cell: str, decimal: str) -> float | None:
    text = cell.translate(_MINUS)
    if decimal == ",":
        if "," in text and not _DECIMAL_COMMA.fullmatch(text):
            return None
        text = text.replace(",", ".")
    elif "," in text:
        return None
    try:
        return float(text) if "_" not in text else None
    except ValueError:
        return None
