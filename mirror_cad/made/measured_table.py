"""Read a table of measured values from a text file, as measuring machines and spreadsheets write it.

Columns stand between commas, semicolons, tabs or blanks, the latter three with decimal points or decimal commas. A first line
may name them, with their units; without one they are x, y, z, and with six the normal.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_cad.columns import decoded
from mirror_cad.errors import FileError

Array = NDArray[np.float64]

MAX_BYTES = 1_000_000_000
UNIT_LENGTH = 1e-2  # what a normal in a file may be off 1 by
LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "nm": 1e-6, "in": 25.4, "inch": 25.4,
           "inches": 25.4, "mil": 0.0254, "millimeter": 1.0, "millimetre": 1.0, "millimeters": 1.0, "millimetres": 1.0,
           "meter": 1000.0, "metre": 1000.0, "meters": 1000.0, "metres": 1000.0}  # in mm
ANGLES = {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "µrad": 1e-6, "μrad": 1e-6, "deg": np.pi / 180.0, "°": np.pi / 180.0,
          "arcmin": np.pi / 10800.0, "arcsec": np.pi / 648000.0, "1": 1.0, "mm/mm": 1.0, "mm/m": 1e-3}  # in radians
CURVATURES = {"1/mm": 1.0, "1/m": 1e-3, "per_mm": 1.0, "per_m": 1e-3, "mm^-1": 1.0, "m^-1": 1e-3, "dpt": 1e-3}  # in 1/mm
NAMES = {  # what a column may be called, in lower case without unit, and the unit that its values have
    "x": (r"x|x[ _-]?(coord|coordinate|pos|position|meas|measured|actual|act|ist)|(meas|measured|actual|coord|pos|point)[ "
           "_-]?x",
          LENGTHS),
    "y": (r"y|y[ _-]?(coord|coordinate|pos|position|meas|measured|actual|act|ist)|(meas|measured|actual|coord|pos|point)[ "
           "_-]?y",
          LENGTHS),
    "z": (r"z|z[ _-]?(coord|coordinate|pos|position|meas|measured|actual|act|ist)|(meas|measured|actual|coord|pos|point)[ _-]?z"
          r"|height|sag", LENGTHS),
    "nx": (r"n[ _-]?x|normal[ _-]?x|i", {"1": 1.0}), "ny": (r"n[ _-]?y|normal[ _-]?y|j", {"1": 1.0}),
    "nz": (r"n[ _-]?z|normal[ _-]?z|k", {"1": 1.0}),
    "sigma": (r"sigma|σ|s|u|std|uncertainty|sigma[ _-]?z", LENGTHS),
    "slope_x": (r"slope[ _-]?x|x[ _-]?slope|sx|dz[ _/]?dx|z_x", ANGLES),
    "slope_y": (r"slope[ _-]?y|y[ _-]?slope|sy|dz[ _/]?dy|z_y", ANGLES),
    "slope_sigma": (r"slope[ _-]?sigma|sigma[ _-]?slope", ANGLES),
    "kx": (r"kx|κx|k11|curvature[ _-]?x", CURVATURES), "ky": (r"ky|κy|k22|curvature[ _-]?y", CURVATURES),
    "twist": (r"twist|kxy|k12", CURVATURES), "curvature_sigma": (r"curvature[ _-]?sigma|sigma[ _-]?k|k[ _-]?sigma", CURVATURES),
    "radius": (r"r|radius", LENGTHS), "sagitta": (r"sagitta|reading|dial", LENGTHS),
    "leg": (r"leg|legs|chord|feet|leg[ _-]?distance", LENGTHS),
    "angle": (r"angle|direction|azimuth", ANGLES),
    "radius_sigma": (r"radius[ _-]?sigma|sigma[ _-]?r(adius)?", LENGTHS),
}
_UNITS = sorted({*LENGTHS, *ANGLES, *CURVATURES}, key=len, reverse=True)
_UNIT = "|".join(re.escape(unit) for unit in _UNITS)
_WITH_UNIT = re.compile(rf"(?P<name>.*?)[\s_]*(?:in\s+|/\s*)?[\[(]?\s*(?<![a-z])(?P<unit>{_UNIT})\s*[\])]?")
_STATED = re.compile(rf"\bunits?\b\s*[:=]?\s*[\"']?(?P<unit>{_UNIT})\b", re.IGNORECASE)
_SEPARATORS = ("\t", ";", ",", None)  # None: blanks
_COMMENTS = "#%!/*"


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredTable:
    """Columns of one length under the names of NAMES, in mm, radians and 1/mm where their unit is stated.

    Attributes
    ----------
    path : Path
        Of the file.
    columns : mapping
        Of ndarray (n,), finite.
    length_unit : str or None
        What lengths were stated to be in; None where nothing was, and they are as they stand.
    not_numbers : int
        How many rows were left out for a cell that is empty or not finite.
    ignored : tuple
        The columns that are not understood.
    header : bool
        Whether a line names the columns.
    """

    path: Path
    columns: Mapping[str, Array]
    length_unit: str | None
    not_numbers: int
    ignored: tuple[str, ...]
    header: bool

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


def read_measured(path: Path) -> MeasuredTable:
    """Read a table of measured values.

    Parameters
    ----------
    path : Path
        CSV, TSV, XYZ, TXT, ASC; UTF-8, UTF-16, or Windows-1252.

    Raises
    ------
    FileError
        For a file that cannot be read, or holds no such table, with the line at fault.
    """
    lines = _text(path).splitlines()
    stated = next((found["unit"].lower() for line in lines[:50] if (found := _STATED.search(line))), None)
    rows = [(number, line.strip()) for number, line in enumerate(lines, start=1)]
    if rows and re.fullmatch(r"sep=.", rows[0][1], re.IGNORECASE):
        rows = rows[1:]
    body = [(number, line) for number, line in rows if line and line[0] not in _COMMENTS]
    commented = [(number, line.lstrip(_COMMENTS + " ")) for number, line in rows[:50] if line and line[0] in _COMMENTS]
    if not body:
        raise FileError(f"{path}: the file holds no table of points")
    separator, decimal = _punctuation(path, body)
    first = _cells(body[0][1], separator)
    header = not all(_is_number(cell, decimal) for cell in first if cell)
    if header:
        names, body = first, body[1:]
    else:
        width = len(first)
        fitting = [cells for _, line in commented if len(cells := _cells(line, separator)) == width]
        known = [cells for cells in fitting if sum(_column(cell) is not None for cell in cells) >= 2]
        names = known[-1] if known else ["x", "y", "z", "nx", "ny", "nz"][:width] if width in (3, 6) else ["x", "y", "z"]
        header = bool(known)
    columns, ignored, unit = _understood(path, names, stated)
    if not body:
        raise FileError(f"{path}: the file names columns and holds no row below them")
    indices = [index for _, index, _ in columns]
    values = _numbers(path, body, separator, decimal, indices, len(first))
    finite = np.isfinite(values).all(axis=1)
    if not finite.any():
        raise FileError(f"{path}: none of its {len(values)} rows holds finite numbers")
    kept = values[finite]
    if not header and len(columns) == 6:
        length = np.linalg.norm(kept[:, 3:], axis=1)
        if np.abs(length - 1.0).max() > UNIT_LENGTH:
            raise FileError(f"{path}, line {body[0][0]}: {body[0][1][:80]!r} has six columns without names, and the last "
                            "three are no unit normals: name the columns in the first line, and if these are decimal commas, "
                            "put semicolons or tabs between them")
    named = {name: kept[:, k] * scale for k, (name, _, scale) in enumerate(columns)}
    return MeasuredTable(path, named, unit, int((~finite).sum()), ignored, header)


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise FileError(f"{path}: {path.stat().st_size / 1e6:.0f} MB are more than {MAX_BYTES / 1e6:g}: thin the points "
                            "out")
        data = path.read_bytes()
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from None
    text = decoded(data)
    if text is not None:
        return text.translate({0x2212: "-", 0x2013: "-"})
    raise FileError(f"{path}: no text: measured points come as CSV, TSV, XYZ or TXT, as a mesh or as STEP")


def _cells(line: str, separator: str | None) -> list[str]:
    return [cell.strip().strip("\"'") for cell in (line.split(separator) if separator else line.split())]


def _is_number(cell: str, decimal: str) -> bool:
    try:
        float(cell.replace(",", ".") if decimal == "," else cell)
    except ValueError:
        return False
    return "_" not in cell


def _punctuation(path: Path, body: list[tuple[int, str]]) -> tuple[str | None, str]:
    """What stands between columns, and before decimals."""
    best, found = 0, None
    for separator in _SEPARATORS:
        for decimal in (".", ","):
            if decimal == "," and separator == ",":
                continue
            numbers = [sum(_is_number(cell, decimal) for cell in _cells(line, separator) if cell) for _, line in body[:60]]
            score = sum(count for count in numbers if count >= 3)
            if score > best:
                best, found = score, (separator, decimal)
    if found is not None:
        return found
    number, line = body[min(1, len(body) - 1)]
    raise FileError(f"{path}, line {number}: {line[:80]!r} holds no three numbers: columns x, y, z stand between commas, "
                    "semicolons, tabs or blanks")


def _column(name: str) -> tuple[str, str | None] | None:
    """The name that a column's heading stands for, and the unit it states."""
    text = name.strip().lower()
    for key, (pattern, units) in NAMES.items():
        if re.fullmatch(pattern, text):
            return key, None
        stated = _WITH_UNIT.fullmatch(text)
        if stated and stated["unit"] in units and re.fullmatch(pattern, stated["name"].strip(" _-[(")):
            return key, stated["unit"]
    return None


def _understood(path: Path, names: list[str], stated: str | None) -> tuple[list[tuple[str, int, float]], tuple[str, ...],
                                                                          str | None]:
    """The columns as name, index and factor; those that are not understood; the unit of lengths."""
    found: dict[str, tuple[int, str | None]] = {}
    ignored = []
    for index, name in enumerate(names):
        column = _column(name)
        if column is None:
            if name:
                ignored.append(name)
        elif column[0] in found:
            raise FileError(f"{path}: two columns mean {column[0]}: {names[found[column[0]][0]]!r} and {name!r}: leave one")
        else:
            found[column[0]] = (index, column[1])
    if "x" not in found or "y" not in found:
        raise FileError(f"{path}: no columns x and y among {', '.join(repr(name) for name in names if name) or 'none'}: name "
                        "them in the first line (x_mm, y_mm, z_mm), or leave that line out")
    coordinates = {unit for key in ("x", "y", "z") if key in found for unit in [found[key][1]] if unit}
    if len({LENGTHS[unit] for unit in coordinates}) > 1:
        raise FileError(f"{path}: x, y and z are in different units: {', '.join(sorted(coordinates))}")
    unit = next(iter(coordinates), stated)
    columns = []
    for key, (index, own) in found.items():
        units = NAMES[key][1]
        if units is LENGTHS:
            # A sigma in µm beside coordinates in mm states its own.
            factor = LENGTHS[own] if own else LENGTHS[unit] if unit else 1.0
        else:
            factor = units[own] if own else 1.0
            if own is None and key == "angle":
                factor = ANGLES["deg"]
            elif own is None and units is CURVATURES:
                raise FileError(f"{path}: the column {names[index]!r} states no unit: write {key}_per_m or {key}_per_mm")
        columns.append((key, index, factor))
    return columns, tuple(ignored), unit


def _numbers(path: Path, body: list[tuple[int, str]], separator: str | None, decimal: str, indices: list[int],
             width: int) -> Array:
    """The columns of these indices, (n, k); NaN where a cell is empty."""
    lines = [line for _, line in body]
    if decimal == ",":
        lines = [line.replace(",", ".") for line in lines]
    try:
        return np.loadtxt(io.StringIO("\n".join(lines)), delimiter=separator, usecols=indices, ndmin=2, comments=None)
    except ValueError:
        pass  # row by row, to say which
    result = np.full((len(lines), len(indices)), np.nan)
    for row, ((number, _), line) in enumerate(zip(body, lines, strict=True)):
        cells = _cells(line, separator)
        if separator == "," and len(cells) > width and any(cells[width:]):
            raise FileError(f"{path}, line {number}: {line[:80]!r} has {len(cells)} entries under {width} columns: if these "
                            "are decimal commas, put semicolons or tabs between the columns")
        for k, index in enumerate(indices):
            cell = cells[index] if index < len(cells) else ""
            if cell.lower() in ("", "nan", "na", "n/a", "-", "--", "null", "none", "#n/a", "inf", "-inf", "+inf"):
                continue
            try:
                result[row, k] = float(cell)
            except ValueError:
                raise FileError(f"{path}, line {number}: {cell[:40]!r} is no number") from None
    return result
