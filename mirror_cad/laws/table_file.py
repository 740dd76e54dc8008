"""x with R or κ from a text file, as spreadsheets and measuring machines write it."""

from __future__ import annotations

import re
from pathlib import Path

from mirror_cad.columns import read_numbers

LENGTH_UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0}  # in mm

_UNIT = r"(?P<unit>mm|cm|m)"
_PER = rf"(?:1\s*/\s*|per[\s_]+){_UNIT}|{_UNIT.replace('unit', 'inverse')}\s*(?:\^?\s*-\s*1|⁻¹)"
_BEFORE, _AFTER = r"[\s_]*(?:in\s+|/)?\s*[\[(]?\s*", r"\s*[\])]?"  # of a unit: x_mm, x [mm], x (mm), x in mm, x / mm
_X = re.compile(rf"x{_BEFORE}{_UNIT}{_AFTER}", re.IGNORECASE)
_RADIUS = re.compile(rf"(?:r|r_?[xy]|radius(?:\s+of\s+curvature)?){_BEFORE}{_UNIT}{_AFTER}", re.IGNORECASE)
_CURVATURE = re.compile(rf"(?:k|k_?[xy]|κ_?[xy]?|kappa|curvature){_BEFORE}(?:{_PER}){_AFTER}", re.IGNORECASE)


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
    return {name: [value / unit if name == "curvature_per_mm" else value * unit for value in values]
            for name, (values, unit) in read_numbers(path, _column, _wanted, ("radius_mm",)).items()}


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
