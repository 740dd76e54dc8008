"""The front of a study, as `optimise` wrote it: its designs with their figures, and the specification that they are of."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mirror_cad.errors import FileError

FRONT, SUMMARY = "front.csv", "optimise.json"
NOT_MEASURES = {"status", "cause", "step_apart"}  # columns beside keys and measures
MAX_ROWS = 10_000

Value = float | str


@dataclass(frozen=True, slots=True)
class Front:
    """Designs that no other beats, in the order of the first objective.

    Attributes
    ----------
    name : str
        Of the study.
    keys, measures : tuple of str
        What was varied and what was measured.
    values, figures : tuple of tuple
        A row a design; None for what a mirror does not show.
    objectives : tuple of str
        What was small or large to be; empty where the summary is not there.
    spec : dict or None
        The specification as JSON has it, whose keys were varied; None where the summary is not there.
    scene : str or None
        That figures on a vehicle are of.
    """

    name: str
    keys: tuple[str, ...]
    measures: tuple[str, ...]
    values: tuple[tuple[Value, ...], ...]
    figures: tuple[tuple[float | None, ...], ...]
    objectives: tuple[str, ...] = ()
    spec: dict[str, Any] | None = None
    scene: str | None = None


def read_front(folder: Path) -> Front:
    """Read the front of a study's directory.

    Parameters
    ----------
    folder : Path
        What `mirror-cad optimise` wrote.

    Raises
    ------
    FileError
        Where it holds no front.
    """
    path, summary = folder / FRONT, folder / SUMMARY
    if not path.is_file():
        raise FileError(f"{folder}: holds no {FRONT}: `mirror-cad optimise` writes it")
    try:
        return front_of(folder.resolve().name, path.read_text("utf-8"),
                        summary.read_text("utf-8") if summary.is_file() else None)
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: not a text file (byte {error.start} is no UTF-8)") from None


def front_of(name: str, table: str, summary: str | None = None) -> Front:
    """Make a front of what its files hold.

    Parameters
    ----------
    name : str
        What it is called.
    table : str
        front.csv.
    summary : str, optional
        optimise.json.

    Raises
    ------
    FileError
        For a table that is none of a study, or a summary of another one.
    """
    rows = list(csv.reader(io.StringIO(table)))
    columns = rows[0] if rows else []
    if "status" not in columns or "cause" not in columns:
        raise FileError(f"{name}: no front of a study: `mirror-cad optimise` writes {FRONT} with the columns status and cause")
    keys = [k for k, column in enumerate(columns) if "." in column]
    measures = [k for k, column in enumerate(columns) if "." not in column and column not in NOT_MEASURES]
    status = columns.index("status")
    designs = [(line, row) for line, row in enumerate(rows[1:], 2) if row]
    for line, row in designs:
        if len(row) != len(columns):
            raise FileError(f"{name}: line {line} has {len(row)} fields, and the first one {len(columns)}")
    designs = [(line, row) for line, row in designs if row[status] == "ok"]
    if not keys or not measures:
        raise FileError(f"{name}: no front of a study: it has no column of a " + ("measure" if keys else "key"))
    if not designs:
        raise FileError(f"{name}: the front is empty: no design met the study's limits")
    if len(designs) > MAX_ROWS:
        raise FileError(f"{name}: {len(designs)} designs; a front of at most {MAX_ROWS} is shown")
    told = _summary(name, summary, [columns[k] for k in measures])
    return Front(name, tuple(columns[k] for k in keys), tuple(columns[k] for k in measures),
                 tuple(tuple(_value(row[k]) for k in keys) for _, row in designs),
                 tuple(tuple(_figure(name, line, columns[k], row[k]) for k in measures) for line, row in designs), *told)


def _summary(name: str, text: str | None, measures: Sequence[str]) -> tuple[tuple[str, ...], dict[str, Any] | None, str | None]:
    if text is None:
        return (), None, None
    try:
        content = json.loads(text)
        objectives = tuple(str(each) for each in (*content.get("minimise", ()), *content.get("maximise", ())))
        spec, scene = content.get("spec"), content.get("scene")
    except (ValueError, AttributeError, TypeError, RecursionError):
        raise FileError(f"{name}: its {SUMMARY} is none that `mirror-cad optimise` wrote") from None
    if not set(objectives) <= set(measures) or not isinstance(spec, dict | None) or not isinstance(scene, str | None):
        raise FileError(f"{name}: its {SUMMARY} is of another study")
    return objectives, spec, scene


def _value(text: str) -> Value:
    """A key's value: a number, or a text."""
    try:
        number = float(text)
    except ValueError:
        return text
    return number if math.isfinite(number) else text


def _figure(name: str, line: int, column: str, text: str) -> float | None:
    if not text:
        return None
    try:
        number = float(text)
    except ValueError:
        raise FileError(f"{name}: line {line}: {column} = {text[:40]!r} is no number") from None
    return number if math.isfinite(number) else None
