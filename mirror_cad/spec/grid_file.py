"""Values at the nodes of a grid over the mirror, or along its width, from a text file: a row for each node, in any order."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from mirror_cad.columns import ColumnMeaning, read_numbers

_NAME = re.compile(r"(?P<name>[a-z]+)(?:[\s_]*(?:in\s+|/)?\s*[\[(]?\s*(?P<unit>mm|cm|m|deg|degrees?|°)\s*[\])]?)?",
                   re.IGNORECASE)
_LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1000.0}  # in mm
_ANGLES = ("deg", "degree", "degrees", "°")
KEYS = {"x": "x_mm", "y": "y_mm", "azimuth": "azimuth_deg", "elevation": "elevation_deg", "weight": "weight"}


def read_grid(path: Path, values: Sequence[str]) -> dict[str, object]:
    """Read values at the nodes of a grid: columns x and y, mm, and one for each of the values.

    Parameters
    ----------
    path : Path
    values : sequence of str
        The keys that are wanted beside x_mm and y_mm, of KEYS.

    Returns
    -------
    dict
        "x_mm" and "y_mm", rising, and for each value rows of it, one for each y.

    Raises
    ------
    ValueError
        For columns that are missing, a node that is given twice, and one that is not given.
    """
    columns = _columns(path, ("x_mm", "y_mm", *values))
    x, y = (sorted(set(columns[key])) for key in ("x_mm", "y_mm"))
    rows: dict[tuple[float, float], int] = {}
    for k, node in enumerate(zip(columns["x_mm"], columns["y_mm"], strict=True)):
        if node in rows:
            raise ValueError(f"file = \"{path}\" gives the node x = {node[0]:g}, y = {node[1]:g} mm twice, in rows "
                             f"{rows[node] + 1} and {k + 1} of its numbers: leave one of them out")
        rows[node] = k
    missing = next(((at_x, at_y) for at_y in y for at_x in x if (at_x, at_y) not in rows), None)
    if missing is not None:
        raise ValueError(f"file = \"{path}\" has no row for the node x = {missing[0]:g}, y = {missing[1]:g} mm: its {len(x)} "
                         f"places x and {len(y)} places y make {len(x) * len(y)} nodes, and it has {len(rows)} of them")
    found: dict[str, object] = {"x_mm": x, "y_mm": y}
    for key in values:
        found[key] = [[columns[key][rows[at_x, at_y]] for at_x in x] for at_y in y]
    return found


def read_line(path: Path, value: str) -> dict[str, object]:
    """Read a value along the mirror's width: columns x, mm, and that of the value.

    Raises
    ------
    ValueError
        For columns that are missing, and an x that is given twice.
    """
    columns = _columns(path, ("x_mm", value))
    rows = sorted(zip(columns["x_mm"], columns[value], strict=True))
    for (before, _), (after, _) in pairwise(rows):
        if before == after:
            raise ValueError(f"file = \"{path}\" gives x = {after:g} mm twice: leave one of the rows out")
    return {"x_mm": [x for x, _ in rows], value: [found for _, found in rows]}


def _columns(path: Path, keys: Sequence[str]) -> dict[str, list[float]]:
    def wanted(path: Path, head: str, header: list[ColumnMeaning | None]) -> list[tuple[str, int, float]]:
        found = [(column[0], index, column[1]) for index, column in enumerate(header) if column and column[0] in keys]
        names = [name for name, _, _ in found]
        faults = [f"has no column {key}" + _near(key, head) for key in keys if key not in names]
        faults += [f"has {names.count(key)} columns that may be {key}" for key in keys if names.count(key) > 1]
        if faults:
            said, names_wanted, first = ", and ".join(faults), ", ".join(keys), head.strip()[:80] or "empty"
            raise ValueError(f"file = \"{path}\" {said}: its first line must name {names_wanted} between commas, semicolons or "
                             f"tabs, and is {first}")
        return found

    columns = {key: [value * unit for value in values] for key, (values, unit) in read_numbers(path, _column, wanted).items()}
    if not columns[keys[0]]:
        raise ValueError(f"file = \"{path}\" has no rows of numbers under its first line")
    return columns


def _near(key: str, head: str) -> str:
    names = [name.strip() for name in re.split("[,;\t]", head)]
    near = difflib.get_close_matches(key, names, n=1, cutoff=0.7)
    return f" (is it {near[0]!r}?)" if near else ""


def _column(name: str) -> ColumnMeaning | None:
    """The key that a column's name stands for, and its unit in that of the key."""
    found = _NAME.fullmatch(name.strip())
    key = KEYS.get(found["name"].lower()) if found else None
    if found is None or key is None:
        return None
    unit = (found["unit"] or "").lower()
    if key == "weight":
        return None if unit else (key, 1.0)
    if key in ("x_mm", "y_mm"):
        return (key, _LENGTHS[unit]) if unit in _LENGTHS else None
    return (key, 1.0) if unit in _ANGLES else None
