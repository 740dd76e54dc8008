"""The record that every part of the benchmark hands over: columns and rows, and which of them to draw against each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

Row: TypeAlias = dict[str, Any]  # by column key a number, a text, or None where there is nothing to say


@dataclass(frozen=True, slots=True)
class Column:
    """One column: the rows' key, its title with the unit, and the significant digits shown."""

    key: str
    title: str
    digits: int = 3


@dataclass(frozen=True, slots=True)
class Plot:
    """Column y over column x, both logarithmic, one curve for each value of the column `series`."""

    x: str
    y: str
    series: str | None
    title: str


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """One comparison.

    name : file stem.   text : what is compared with what, in two or three sentences.
    rows : by column key a number, a text, or None where there is nothing to say.
    """

    name: str
    title: str
    text: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    plots: tuple[Plot, ...] = ()
