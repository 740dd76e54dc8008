"""Which curvature a mirror is asked to have: the sections [horizontal] and [vertical], one law each, with their checks."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator
from pydantic.functional_validators import PlainValidator

from mirror_cad.spec_section import Coordinate, Number, Section

LONGEST_TABLE = 100_000  # rows


def _radius(value: Any) -> float:
    if not _is_number(value) or math.isnan(value) or math.isinf(value) or value == 0:
        raise ValueError("must be a finite number of mm other than 0 (flat, concave and sign-changing laws are written "
                         "as curvature: law = \"expression\" or \"table\")")
    return float(value)


def _radius_or_flat(value: Any) -> float:
    if not _is_number(value) or math.isnan(value) or value == 0:
        raise ValueError("must be a number of mm other than 0 (inf is flat, a negative radius concave)")
    return float(value)


def _number_or(word: str, low: float, high: float, low_open: bool) -> Any:
    span = f"{'above' if low_open else 'at least'} {low:g} and at most {high:g}"

    def check(value: Any) -> float | str:
        if value == word:
            return word
        if not _is_number(value) or not low <= value <= high or (low_open and value == low):
            raise ValueError(f"must be \"{word}\" or a number {span}")
        return float(value)

    return PlainValidator(check)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


Radius = Annotated[float, PlainValidator(_radius)]
RadiusOrFlat = Annotated[float, PlainValidator(_radius_or_flat)]
Exponent = Annotated[Number, Field(gt=0, le=50)]
Share = Annotated[Number, Field(ge=0, le=1)]


class ConstantLaw(Section):
    """R = radius."""

    law: Literal["constant"]
    radius_mm: RadiusOrFlat


class TwoRadii(Section):
    right_mm: Radius
    left_mm: Radius

    @model_validator(mode="after")
    def _one_sign(self) -> TwoRadii:
        if self.right_mm * self.left_mm < 0:
            raise ValueError(f"right_mm = {self.right_mm:g} and left_mm = {self.left_mm:g} have opposite signs, so the "
                             "radius would pass through 0: write a sign-changing law as curvature "
                             "(law = \"expression\" with curvature = \"…\", or \"table\" with curvature_per_mm)")
        return self


class LinearLaw(TwoRadii):
    """R = right + (left − right)·t."""

    law: Literal["linear"]


class PowerLaw(TwoRadii):
    """R = right + (left − right)·t^exponent."""

    law: Literal["power"]
    exponent: Exponent


class ZonesLaw(TwoRadii):
    """R = right up to blend_from, left from blend_to on, blended between."""

    law: Literal["zones"]
    blend_from: Share
    blend_to: Share = 1.0
    blend: Literal["linear", "smooth"] = "smooth"

    @model_validator(mode="after")
    def _in_order(self) -> ZonesLaw:
        if not isinstance(self.blend_from, str) and self.blend_from >= self.blend_to:
            raise ValueError(f"blend_from = {self.blend_from:g} must lie below blend_to = {self.blend_to:g}")
        return self


class TableLaw(Section):
    """κ through the rows of a table, given here or as columns of a CSV file."""

    law: Literal["table"]
    x_mm: tuple[Coordinate, ...]
    radius_mm: tuple[RadiusOrFlat, ...] | None = None
    curvature_per_mm: tuple[Number, ...] | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, raw: Any, info: ValidationInfo) -> Any:
        if not isinstance(raw, dict) or "file" not in raw:
            return raw
        both = sorted({"x_mm", "radius_mm", "curvature_per_mm"} & raw.keys())
        if both:
            raise ValueError(f"file and {', '.join(both)} cannot both be given: leave one of them out")
        if not isinstance(raw["file"], str):
            raise ValueError(f"file = {raw['file']!r} must be the name of a CSV file")
        columns = _read_columns(Path((info.context or {}).get("folder", ".")) / raw["file"])
        return {key: value for key, value in raw.items() if key != "file"} | columns

    @field_validator("x_mm", "radius_mm", "curvature_per_mm", mode="before")
    @classmethod
    def _rows(cls, value: Any) -> Any:
        return tuple(value) if isinstance(value, list) else value

    @model_validator(mode="after")
    def _rectangular(self) -> TableLaw:
        if (self.radius_mm is None) == (self.curvature_per_mm is None):
            raise ValueError("give one of radius_mm and curvature_per_mm beside x_mm")
        rows = len(self.radius_mm or self.curvature_per_mm or ())
        if len(self.x_mm) != rows:
            raise ValueError(f"x_mm has {len(self.x_mm)} rows, the other column {rows}: they must be as many")
        if not 2 <= rows <= LONGEST_TABLE:
            raise ValueError(f"a table needs 2 to {LONGEST_TABLE} rows, this one has {rows} "
                             "(one value everywhere is law = \"constant\")")
        for row, (before, after) in enumerate(zip(self.x_mm, self.x_mm[1:], strict=False), start=2):
            if after <= before:
                raise ValueError(f"x_mm must rise from row to row: row {row} has {after:g} after {before:g}")
        return self

    @property
    def curvature(self) -> tuple[float, ...]:
        """κ of each row, 1/mm."""
        if self.curvature_per_mm is not None:
            return self.curvature_per_mm
        return tuple(1.0 / radius for radius in self.radius_mm or ())


class ExpressionLaw(Section):
    """R or κ as a formula in t and x (mm)."""

    law: Literal["expression"]
    radius: str | None = None
    curvature: str | None = None

    @field_validator("radius", "curvature")
    @classmethod
    def _readable(cls, formula: str | None) -> str | None:
        from mirror_cad.errors import SpecError
        from mirror_cad.formula import parse_formula

        if formula is not None:
            try:
                parse_formula(formula)
            except SpecError as error:
                raise ValueError(str(error)) from None
        return formula

    @model_validator(mode="after")
    def _one_formula(self) -> ExpressionLaw:
        if (self.radius is None) == (self.curvature is None):
            raise ValueError("give one of radius and curvature, a formula in t and x")
        return self

    @property
    def formula(self) -> tuple[str, str]:
        """The formula and what it is a formula of."""
        return (self.radius, "radius") if self.radius is not None else (self.curvature or "", "curvature")


def _read_columns(path: Path) -> dict[str, list[float]]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as lines:
            rows = list(csv.reader(lines))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"file = \"{path}\" cannot be read as CSV: {error}") from None
    header = [name.strip() for name in rows[0]] if rows else []
    if sorted(header) not in (["radius_mm", "x_mm"], ["curvature_per_mm", "x_mm"]):
        raise ValueError(f"file = \"{path}\" must start with a line naming the columns x_mm and radius_mm, or x_mm and "
                         f"curvature_per_mm; it starts with {', '.join(header)[:80] or 'nothing'}")
    columns: dict[str, list[float]] = {name: [] for name in header}
    for number, row in enumerate(rows[1:], start=2):
        if not row:
            continue
        try:
            for name, cell in zip(header, row, strict=True):
                columns[name].append(float(cell))
        except ValueError:
            raise ValueError(f"file = \"{path}\", line {number}: {','.join(row)[:80]!r} is not two numbers") from None
    return columns


# --- the horizontal section: a law, where it runs, and where it is level ---------------------------------------------


class Match(Section):
    """What the section H-FOV has to equal: that of a sphere, or an angle."""

    sphere_mm: Annotated[Number, Field(gt=0)] | None = None
    h_fov_deg: Annotated[Number, Field(gt=0, lt=360)] | None = None

    @model_validator(mode="after")
    def _one(self) -> Match:
        if (self.sphere_mm is None) == (self.h_fov_deg is None):
            raise ValueError("give one of sphere_mm and h_fov_deg")
        return self


class Horizontal(Section):
    level_at: Annotated[float | str, PlainValidator(lambda value: _level(value))] = "centre"
    span_mm: tuple[Coordinate, Coordinate] | None = None

    @field_validator("span_mm", mode="before")
    @classmethod
    def _pair(cls, value: Any) -> Any:
        return tuple(value) if isinstance(value, list) else value

    @field_validator("span_mm")
    @classmethod
    def _rising(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and value[0] >= value[1]:
            raise ValueError(f"must rise from where t = 1 (left) to where t = 0 (right), not {value[0]:g} to {value[1]:g}")
        return value


def _level(value: Any) -> float | str:
    if value in ("centre", "right", "left"):
        return str(value)
    if not _is_number(value) or not math.isfinite(value):
        raise ValueError("must be \"centre\", \"right\", \"left\" or a number of mm")
    return float(value)


class MatchedHorizontal(Horizontal):
    match: Match | None = None

    @model_validator(mode="after")
    def _both_or_none(self) -> MatchedHorizontal:
        key = "exponent" if hasattr(self, "exponent") else "blend_from"
        asked = getattr(self, key) == "match"
        if asked and self.match is None:
            raise ValueError(f"{key} = \"match\" needs a section [horizontal.match] with sphere_mm or h_fov_deg")
        if self.match is not None and not asked:
            raise ValueError(f"[horizontal.match] has nothing to solve for: set {key} = \"match\" or leave it out")
        return self


class HorizontalConstant(Horizontal, ConstantLaw):
    pass


class HorizontalLinear(Horizontal, LinearLaw):
    pass


class HorizontalPower(MatchedHorizontal, PowerLaw):
    exponent: Annotated[Any, _number_or("match", 0.0, 50.0, low_open=True)]


class HorizontalZones(MatchedHorizontal, ZonesLaw):
    blend_from: Annotated[Any, _number_or("match", 0.0, 1.0, low_open=False)]


class HorizontalTable(Horizontal, TableLaw):
    pass


class HorizontalExpression(Horizontal, ExpressionLaw):
    pass


AnyHorizontal = Annotated[
    HorizontalConstant | HorizontalLinear | HorizontalPower | HorizontalZones | HorizontalTable | HorizontalExpression,
    Field(discriminator="law"),
]
AnyLaw = Annotated[
    ConstantLaw | LinearLaw | PowerLaw | ZonesLaw | TableLaw | ExpressionLaw,
    Field(discriminator="law"),
]
