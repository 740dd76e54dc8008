"""Numbers under named columns from a text file, as spreadsheets and measuring machines write it."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Collection
from pathlib import Path

# Rows of a table and then some, at 100 characters each.
MAX_BYTES = 20_000_000
SEPARATORS = {"\t": "tab", ";": "semicolon", ",": "comma"}
COMMENT = "#"

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?|[+-]?\d+,(?:[eE][+-]?\d+)?")
_MINUS = str.maketrans("−–", "--")  # what word processors make of a sign

ColumnMeaning = tuple[str, float]  # what a column's name stands for, and its unit in that of the key


def read_numbers(path: Path, column: Callable[[str], ColumnMeaning | None],
                 wanted: Callable[[Path, str, list[ColumnMeaning | None]], list[tuple[str, int, float]]],
                 infinite: Collection[str] = ()) -> dict[str, tuple[list[float], float]]:
    """Read columns of numbers from a text file, in the units that it has them in.

    Columns stand between commas, semicolons or tabs, the latter two with decimal points or decimal commas; the first line
    names them. Further columns, empty rows and those that begin with # are left out. UTF-8, UTF-16 with its mark, or
    Windows-1252.

    Parameters
    ----------
    path : Path
    column : callable
        What a column's name stands for; None where that is not known.
    wanted : callable
        The columns that are taken, as key, index and unit: of the path, the first line and what its names stand for.
    infinite : collection of str
        The keys of which a number may be infinite.

    Returns
    -------
    dict
        For each key, its numbers as they stand in the file, and their unit.

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
    headers = {mark: [column(name) for name in _cells(head, mark)] for mark in candidates}
    separator = max(headers, key=lambda mark: len({found[0] for found in headers[mark] if found}))
    header = headers[separator]
    columns = wanted(path, head, header)
    numbers: dict[str, list[float]] = {name: [] for name, _, _ in columns}
    decimal = _decimal_sign(path, separator, lines[1:], [index for _, index, _ in columns])
    for number, line in lines[1:]:
        cells = _cells(line, separator)
        if not any(cells):
            continue
        if separator == "," and len(cells) > len(header) and any(cells[len(header):]):
            raise ValueError(f"file = \"{path}\", line {number}: {line.strip()[:80]!r} has {len(cells)} entries under "
                             f"{len(header)} columns: if these are decimal commas, put semicolons or tabs between the columns")
        for name, index, _ in columns:
            cell = cells[index] if index < len(cells) else ""
            value = _number(cell, decimal)
            if value is None:
                if name in infinite and cell.lower() in ("∞", "infinity", "+inf", "inf"):
                    value = float("inf")
                else:
                    raise ValueError(f"file = \"{path}\", line {number}: {cell[:40]!r} in {line.strip()[:80]!r} is no number")
            numbers[name].append(value)
    return {name: (numbers[name], unit) for name, _, unit in columns}


def _lines(path: Path) -> list[tuple[int, str]]:
    """The lines that hold something, with their numbers."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ValueError(f"file = \"{path}\" has {path.stat().st_size / 1e6:.1f} MB, at most {MAX_BYTES / 1e6:g} are read")
        data = path.read_bytes()
    except OSError as error:
        raise ValueError(f"file = \"{path}\" cannot be read as CSV: {error.strerror or error}") from None
    text = decoded(data)
    if text is None:
        raise ValueError(f"file = \"{path}\" cannot be read as CSV: it is no text")
    return [(number, line) for number, line in enumerate(text.splitlines(), start=1)
            if line.strip() and not line.lstrip("\"' \t").startswith(COMMENT)]


def decoded(data: bytes) -> str | None:
    """Decode a text of UTF-8, UTF-16 or Windows-1252; None for what is no text.

    Parameters
    ----------
    data : bytes
    """
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ["utf-16"]
    elif b"\0" in data[:200]:  # UTF-16 without its mark: every other byte of plain text is 0
        encodings = ["utf-16-le" if data[1:2] == b"\0" else "utf-16-be"]
    else:
        encodings = ["utf-8-sig", "cp1252"]
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    return None


def _cells(line: str, separator: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    except (csv.Error, StopIteration):
        return []


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
