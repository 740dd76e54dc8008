"""Write the tables of a report as CSV files and one JSON file."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

DIGITS = 12  # of a number: more than the STEP file holds of a coordinate, fewer than rounding changes


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns of one length under their names, which end in their unit; None is an empty cell, as is what is not finite."""

    name: str
    columns: Mapping[str, Sequence[Any] | NDArray[Any]]


def write_tables(folder: Path, prefix: str, tables: Iterable[Table], head: Mapping[str, Any]) -> None:
    """Write prefix-NAME.csv for each table, and prefix-report.json with `head` and the columns of all of them.

    Both have the same digits. A column is a line of the JSON, which stays readable and is a tenth of an indented one.
    """
    parts = []
    for table in tables:
        columns = {key: _texts(values) for key, values in table.columns.items()}
        with (folder / f"{prefix}-{table.name}.csv").open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*(cells for cells, _ in columns.values()), strict=True))
        lines = (f"      {json.dumps(key)}: [{', '.join(texts)}]" for key, (_, texts) in columns.items())
        parts.append(f"    {json.dumps(table.name)}: {{\n" + ",\n".join(lines) + "\n    }")
    start = json.dumps({"schema": 1, **head}, indent=2, allow_nan=False, ensure_ascii=False).removesuffix("\n}")
    text = f'{start},\n  "tables": {{\n' + ",\n".join(parts) + "\n  }\n}\n"
    (folder / f"{prefix}-report.json").write_text(text, encoding="utf-8")


def _texts(values: Sequence[Any] | NDArray[Any]) -> tuple[list[str], list[str]]:
    """A column as cells of CSV and as values of JSON."""
    if isinstance(values, np.ndarray):
        values = values.tolist()
        if all(type(value) is float and math.isfinite(value) for value in values):  # most by far, all at once
            texts = (f"%.{DIGITS}g\n" * len(values) % tuple(values)).splitlines()
            return texts, texts
    cells = [_cell(value) for value in values]
    return [cell for cell, _ in cells], [text for _, text in cells]


def _cell(value: Any) -> tuple[str, str]:
    """As CSV and as JSON."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "", "null"
    if isinstance(value, float):
        text = f"{value:.{DIGITS}g}"
        return text, text
    text = json.dumps(value, ensure_ascii=False)
    return (value if isinstance(value, str) else text), text
