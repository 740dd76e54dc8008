"""[target]: the view that a mirror is made for, and the wanted view that its keys describe."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationInfo, model_validator
from pydantic.functional_validators import PlainValidator

from mirror_cad.keys import ELSEWHERE, Section, is_number
from mirror_cad.spec.grid_file import read_grid, read_line
from mirror_cad.wanted_view import Box, EqualAngles, Line, SplineAngle, StraightVerticals, TableView, WantedView, WeightMap

BEHIND_DEG = 90.0  # from the axis: a ray that leaves at this angle or more goes behind the mirror
MAX_NODES = 400  # of a table, a direction

Numbers = tuple[float, ...]
Rows = tuple[tuple[float, ...], ...]


def _number(value: object, where: str) -> float:
    if not is_number(value) or not math.isfinite(value):
        raise ValueError(f"must be finite numbers, and {where} is {value!r}")
    return float(value)


def _list(value: object) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value


def _angles(value: object) -> Numbers | Rows:
    value = _list(value)
    if not isinstance(value, list | tuple) or not value:
        raise ValueError("must be a list of angles, [left, right] or [bottom, top], or of rows of a table")
    if any(isinstance(_list(row), list | tuple) for row in value):
        rows = [row for row in map(_list, value) if isinstance(row, list | tuple)]
        if len(rows) != len(value) or any(len(row) != len(rows[0]) for row in rows):
            raise ValueError("must be rows of one length")
        return tuple(tuple(_angle(angle, f"row {i + 1}, entry {j + 1}") for j, angle in enumerate(row))
                     for i, row in enumerate(rows))
    return tuple(_angle(angle, f"entry {i + 1}") for i, angle in enumerate(value))


def _angle(value: object, where: str) -> float:
    angle = _number(value, where)
    if abs(angle) >= BEHIND_DEG:
        raise ValueError(f"{where} is {angle:g}°: a ray {BEHIND_DEG:g}° or more from the mirror's axis would go behind the "
                         f"mirror; above −{BEHIND_DEG:g} and below {BEHIND_DEG:g}")
    return angle


def _nodes(value: object) -> Numbers | None:
    value = _list(value)
    if value is None:
        return None
    if not isinstance(value, list | tuple) or not 2 <= len(value) <= MAX_NODES:
        raise ValueError(f"must be a list of 2 to {MAX_NODES} places, mm")
    places = tuple(_number(place, f"entry {i + 1}") for i, place in enumerate(value))
    for i, (before, after) in enumerate(pairwise(places)):
        if not after > before:
            raise ValueError(f"must rise, and entry {i + 2} ({after:g}) does not lie beyond the one before ({before:g})")
    return places


def _weights(value: object) -> Rows:
    value = _list(value)
    if not isinstance(value, list | tuple) or not value or not all(isinstance(_list(row), list | tuple) for row in value):
        raise ValueError("must be rows of numbers, one for each of y_mm")
    rows = tuple(tuple(_number(weight, f"row {i + 1}, entry {j + 1}") for j, weight in enumerate(_list(row)))
                 for i, row in enumerate(value))
    for i, row in enumerate(rows):
        for j, weight in enumerate(row):
            if weight < 0.0:
                raise ValueError(f"row {i + 1}, entry {j + 1} is {weight:g}: a weight is 0 or above")
    if not any(weight > 0.0 for row in rows for weight in row):
        raise ValueError("is 0 everywhere: some place of the mirror must count")
    return rows


def _columns_of(raw: dict[str, object], columns: dict[str, object]) -> dict[str, object]:
    """The keys of a section with those that its file has instead of it."""
    both = sorted(columns.keys() & raw.keys())
    if both:
        raise ValueError(f"file and {', '.join(both)} cannot both be given: leave one of them out")
    return {key: value for key, value in raw.items() if key != "file"} | columns


def _file_of(raw: dict[str, object], info: ValidationInfo) -> Path:
    if not isinstance(raw["file"], str):
        raise ValueError(f"file = {raw['file']!r} must be the name of a CSV file")
    return Path((info.context or {}).get("folder", ".")) / raw["file"]


Angles = Annotated[Numbers | Rows, PlainValidator(_angles)]
Nodes = Annotated[Numbers | None, PlainValidator(_nodes)]
Weights = Annotated[Rows, PlainValidator(_weights)]
FileName = Annotated[str | None, Field(exclude=True), ELSEWHERE]


class TargetWeight(Section):
    """How much the places of the mirror count: `weight` at the nodes of `x_mm` × `y_mm`, a row for each y.

    Linear between the nodes and held at its ends beyond; only ratios matter. A place of weight 0 shows whatever is smooth.

    file : a CSV file with the columns x_mm, y_mm and weight instead, a row for each node.
    """

    x_mm: Nodes
    y_mm: Nodes
    weight: Weights
    file: FileName = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, raw: object, info: ValidationInfo) -> object:
        if not isinstance(raw, dict) or raw.get("file") is None:
            return raw
        return _columns_of(raw, read_grid(_file_of(raw, info), ("weight",)))

    @model_validator(mode="after")
    def _shapes(self) -> TargetWeight:
        if self.x_mm is None or self.y_mm is None:
            raise ValueError("x_mm and y_mm must be lists of places, mm")
        columns, rows = len(self.x_mm), len(self.y_mm)
        if len(self.weight) != rows or any(len(row) != columns for row in self.weight):
            raise ValueError(f"weight must have a row for each of the {rows} entries of y_mm, with {columns} numbers, one for "
                             "each of x_mm")
        return self

    def map(self) -> WeightMap:
        """Make the weight as a function of (x, y)."""
        return WeightMap(np.array(self.x_mm), np.array(self.y_mm), np.array(self.weight).T.copy())


class Target(Section):
    """Where the eye's rays are to go. Angles are those of (X, Y, 1): azimuth atan X, towards +x; elevation atan Y, towards +y.

    projection : "perspective", X and Y linear between the tangents at the edges of the outline's box; "equal-angle", the
    angles themselves linear; "profile", `azimuth_deg` over `x_mm`, verticals straight, Y as in perspective; "table", both
    angles at the nodes of `x_mm` × `y_mm`, a row for each y.
    file : a CSV file instead: of "table" with the columns x_mm, y_mm, azimuth_deg and elevation_deg, a row for each node; of
    "profile" with x_mm and azimuth_deg.
    weight : how much each place counts; all the same by default.
    eye : the eye of [eye], or two of them, EYE_SEPARATION_MM apart.   convex : refuse a view that no convex mirror can show.
    """

    projection: Literal["perspective", "equal-angle", "profile", "table"]
    azimuth_deg: Angles
    elevation_deg: Angles
    x_mm: Nodes = None
    y_mm: Nodes = None
    eye: Literal["one", "both"] = "one"
    convex: bool = False
    file: FileName = None
    weight: TargetWeight | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, raw: object, info: ValidationInfo) -> object:
        if not isinstance(raw, dict) or raw.get("file") is None:
            return raw
        projection = raw.get("projection")
        if projection == "table":
            return _columns_of(raw, read_grid(_file_of(raw, info), ("azimuth_deg", "elevation_deg")))
        if projection == "profile":
            return _columns_of(raw, read_line(_file_of(raw, info), "azimuth_deg"))
        raise ValueError(f"file belongs to projection = \"table\" or \"profile\", and here it is {projection!r}")

    @model_validator(mode="after")
    def _shapes(self) -> Target:
        faults = []
        nodes = {"x_mm": self.x_mm, "y_mm": self.y_mm}
        wanted = {"profile": ("x_mm",), "table": ("x_mm", "y_mm")}.get(self.projection, ())
        for key, value in nodes.items():
            if key in wanted and value is None:
                faults.append(f"{key} is required with projection = \"{self.projection}\"")
            if key not in wanted and value is not None:
                owners = '"table"' if key == "y_mm" else '"profile" or "table"'
                faults.append(f"{key} belongs to projection = {owners}, and here it is \"{self.projection}\"")
        if not faults:
            columns, rows = len(self.x_mm or (0, 0)), len(self.y_mm or (0, 0))
            for key, angles in (("azimuth_deg", self.azimuth_deg), ("elevation_deg", self.elevation_deg)):
                table = isinstance(angles[0], tuple)
                if self.projection == "table":
                    if not table or len(angles) != rows or len(angles[0]) != columns:  # type: ignore[arg-type]
                        faults.append(f"{key} must have a row for each of the {rows} entries of y_mm, with {columns} angles, "
                                      "one for each of x_mm")
                elif table:
                    faults.append(f"{key} must be a list of numbers with projection = \"{self.projection}\", not of rows")
                elif key == "azimuth_deg" and self.projection == "profile":
                    if len(angles) != columns:
                        faults.append(f"azimuth_deg has {len(angles)} angles, and x_mm {columns} places: one for each")
                elif len(angles) != 2:
                    pair = "[left, right]" if key == "azimuth_deg" else "[bottom, top]"
                    faults.append(f"{key} must have two angles, {pair}, not {len(angles)}")
                elif angles[0] == angles[1]:
                    faults.append(f"{key} = [{angles[0]:g}, {angles[1]:g}]: the two must differ, or all of the mirror would "
                                  "show one direction")
        if faults:
            raise ValueError("; ".join(faults))
        return self

    def view(self, box: Box) -> WantedView:
        """Make the wanted view of a mirror whose outline has this box (x_min, x_max, y_min, y_max), mm."""
        azimuth, elevation = np.radians(np.array(self.azimuth_deg)), np.radians(np.array(self.elevation_deg))
        if self.projection == "table":
            return TableView(np.array(self.x_mm), np.array(self.y_mm), azimuth.T.copy(), elevation.T.copy())
        if self.projection == "equal-angle":
            return StraightVerticals(EqualAngles(_between(box[:2], azimuth)), EqualAngles(_between(box[2:], elevation)))
        upright = _between(box[2:], np.tan(elevation))
        if self.projection == "profile":
            return StraightVerticals(SplineAngle(np.array(self.x_mm), azimuth), upright)
        return StraightVerticals(_between(box[:2], np.tan(azimuth)), upright)

    def in_words(self) -> str:
        """Say it in a few words for a table."""
        spread = [f"{min(flat):g}° to {max(flat):g}°" for flat in (
            np.ravel(np.array(angles)).tolist() for angles in (self.azimuth_deg, self.elevation_deg))]
        eyes = "" if self.eye == "one" else ", for both eyes"
        weighted = "" if self.weight is None else ", weighted over the mirror"
        return f"{self.projection}, azimuth {spread[0]}, elevation {spread[1]}{eyes}{weighted}"


def _between(ends: Sequence[float], values: Sequence[float] | np.ndarray) -> Line:
    return Line(float(ends[0]), float(ends[1]), float(values[0]), float(values[1]))
