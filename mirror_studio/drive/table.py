"""The table that sets the measures of several mirrors side by side: for people and as CSV."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from mirror_studio.drive.measured import ORIENTATIONS, Measured, value_of
from mirror_studio.report.text import fixed
from raytrace.measures.registry import GROUPS, Measure, measures_of

ORIENTATION_TITLE = "far things are shown"
ORIENTATION_DEFINITION = "beside a flat mirror; of one that shows some things twice, no field, size, line or ground is measured"


def groups_of(measured: Sequence[Measured]) -> list[tuple[str, list[Measure]]]:
    """The measures of any of the mirrors, by the groups of the table, which has no empty one."""
    found: dict[str, Measure] = {}
    for each in measured:
        found |= measures_of(each.use)
    by_group = [(group, [one for one in found.values() if one.group == group]) for group in GROUPS]
    return [(group, rows) for group, rows in by_group if rows]


def orientations(measured: Sequence[Measured]) -> list[str]:
    """Which way round each mirror shows things, in words."""
    return [ORIENTATIONS[each.orientation.sense] for each in measured]


def cells(measure: Measure, measured: Sequence[Measured]) -> list[str]:
    """A measure of each mirror, to the decimals that it has; "≥" before what goes on where looking ends."""
    return [_cell(measure, each) for each in measured]


def _cell(measure: Measure, each: Measured) -> str:
    if measure.name not in measures_of(each.use):
        return fixed(None, measure.decimals)
    bound = measure.at_least is not None and not each.orientation.twice and measure.at_least(each.use)
    return ("≥ " if bound else "") + fixed(value_of(each, measure), measure.decimals)


def write_csv(path: Path, measured: Sequence[Measured]) -> None:
    """The table with unrounded values, one row a measure; empty where a mirror does not show what is measured."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["group", "measure", "figure", "unit", *(each.mirror.name for each in measured)])
        writer.writerow([GROUPS[0], "image", ORIENTATION_TITLE, "", *orientations(measured)])
        for group, rows in groups_of(measured):
            for row in rows:
                values = [value_of(each, row) if row.name in measures_of(each.use) else None for each in measured]
                told = ["" if one is None else repr(float(one)) for one in values]
                writer.writerow([group, row.name, row.title, row.unit, *told])
