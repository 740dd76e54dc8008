"""Write the tables of the benchmark: Markdown, JSON, PNG, and one page of it all."""

from __future__ import annotations

import base64
import os
import platform
from pathlib import Path
from typing import Any

import numpy as np

from mirror_studio.bench.plots import figure_of
from mirror_studio.bench.table import Column, Row, Table
from mirror_studio.build.pipeline import versions, write_json
from mirror_studio.json_types import Json, JsonObject
from mirror_studio.report.text import count, number, templates


def write_tables(folder: Path, parts: dict[str, tuple[str, tuple[Table, ...]]]) -> JsonObject:
    """Write NAME.md and NAME.png of each table, bench.json and index.html; returns what bench.json holds.

    parts : name of the part -> its heading and tables.
    """
    pictures: dict[str, str] = {}
    for _, tables in parts.values():
        for table in tables:
            (folder / f"{table.name}.md").write_text(markdown(table), encoding="utf-8")
            picture = figure_of(table)
            if picture is not None:
                (folder / f"{table.name}.png").write_bytes(picture)
                pictures[table.name] = "data:image/png;base64," + base64.b64encode(picture).decode("ascii")
    content: JsonObject = {"schema": 1, "versions": versions(), "machine": machine(), "tables": {
        table.name: _as_json(part, table) for part, (_, tables) in parts.items() for table in tables}}
    write_json(folder / "bench.json", content)
    shown = [(heading, [_for_page(table, pictures.get(table.name)) for table in tables]) for heading, tables in parts.values()]
    page = templates().get_template("bench.html.j2").render(
        title="Speed against error", versions=content["versions"], machine=content["machine"], parts=shown)
    (folder / "index.html").write_text(page, encoding="utf-8")
    return content


def machine() -> dict[str, Json]:
    """What a reader of times should know of the machine, and nothing that names it."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {"cores": cores, "architecture": platform.machine(), "system": platform.system(),
            "python": platform.python_version()}


def markdown(table: Table) -> str:
    """A table as Markdown."""
    def line(cells: list[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    rule = "|" + "|".join("---:" if _numeric(table, column) else "---" for column in table.columns) + "|"
    lines = [f"# {table.title}", "", table.text, "", line([column.title for column in table.columns]), rule]
    lines += [line([_cell(row, column) for column in table.columns]) for row in table.rows]
    return "\n".join(lines) + "\n"


def _as_json(part: str, table: Table) -> JsonObject:
    return {"part": part, "title": table.title, "text": table.text,
            "columns": {column.key: column.title for column in table.columns},
            "rows": [{key: _plain(value) for key, value in row.items()} for row in table.rows]}


def _for_page(table: Table, picture: str | None) -> JsonObject:
    first = table.columns[0]
    names = [row.get(first.key) for row in table.rows]
    # A name that stands for several rows is shown once.
    rows = [{"again": i > 0 and name == names[i - 1], "cells": [_cell(row, column) for column in table.columns]}
            for i, (name, row) in enumerate(zip(names, table.rows, strict=True))]
    return {"title": table.title, "text": table.text, "picture": picture, "rows": rows, "name": table.name,
            "columns": [(column.title, _numeric(table, column)) for column in table.columns]}


def _cell(row: Row, column: Column) -> str:
    value = _plain(row.get(column.key))
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    return count(value) if isinstance(value, int) else number(value, column.digits)


def _numeric(table: Table, column: Column) -> bool:
    values = [_plain(row.get(column.key)) for row in table.rows]
    return any(isinstance(value, int | float) for value in values) or not any(isinstance(value, str) for value in values)


def _plain(value: Any) -> Any:
    """A value as JSON holds it: numpy's numbers as Python's, what is not finite as None."""
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value
