"""A curvature through the rows of a table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, model_validator

from mirror_cad.keys import ELSEWHERE, AsTuple, Coordinate, Curvature, RadiusOrFlat, Shown
from mirror_cad.laws.base import Law
from mirror_cad.laws.curvature import Break, CurvatureLaw, Function, Span
from mirror_cad.laws.table_file import read_columns
from mirror_cad.laws.words import plain

Array = NDArray[np.float64]

MAX_ROWS = 100_000
# Rows of a table that is not interpolated smoothly: each is a kink (linear) or a jump of κ′ (monotone) that the surface needs
# knots for, and with more of them it is made of little else.
MAX_KINKS = 200
# A curve through points passes a little above the highest of them where its own top lies between two: up to this share of
# κ that is what smooth interpolation is for, and less than what glass is bent to.
OVERSHOOT = 0.01
# What a table may lack at either edge of the mirror, mm: x written with three decimals.
EDGE_ROUNDING_MM = 1e-3

SMOOTHNESS = {"smooth": 2, "monotone": 1, "linear": 0}  # continuous derivatives of κ at an inner row


class Table(Law):
    """κ through the rows (x, κ), held at its end values beyond them.

    Parameters
    ----------
    x_mm : sequence of float
        (n,) rising, n ≥ 2.
    radius_mm, curvature_per_mm : sequence of float
        (n,) R in mm (inf is flat, a negative radius concave) or κ in 1/mm: one of the two.
    interpolation : "smooth", "monotone" or "linear"
        In κ: the C² cubic spline (not-a-knot), which may pass above and below the rows; the C¹ cubic of Fritsch and Carlson,
        which stays between neighbouring rows; or straight lines. With two rows all three are a line.
    file : str
        A CSV file with those columns instead; what else is in it is left out.

    References
    ----------
    C. de Boor, A Practical Guide to Splines, chapter IV.
    F. N. Fritsch, R. E. Carlson, Monotone piecewise cubic interpolation, SIAM J. Numer. Anal. 17 (1980), 238.
    """

    law: Literal["table"] = "table"
    x_mm: Annotated[tuple[Coordinate, ...], AsTuple, Shown(elsewhere=True, start="$x")] = ()
    radius_mm: Annotated[tuple[RadiusOrFlat, ...] | None, AsTuple, Shown(elsewhere=True, start="$radius")] = None
    curvature_per_mm: Annotated[tuple[Curvature, ...] | None, AsTuple, Shown(elsewhere=True, start="$curvature")] = None
    interpolation: Annotated[Literal["smooth", "monotone", "linear"],
                             Shown("Between rows", help="A smooth curve may pass above and below the rows; the others do not",
                                   words=(("smooth", "smooth"), ("monotone", "monotone"), ("linear", "straight")),
                                   start="smooth")] = "smooth"
    file: Annotated[str | None, Field(exclude=True), ELSEWHERE] = None

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, raw: object, info: ValidationInfo) -> object:
        if not isinstance(raw, dict) or raw.get("file") is None:
            return raw
        both = sorted({"x_mm", "radius_mm", "curvature_per_mm"} & raw.keys())
        if both:
            raise ValueError(f"file and {', '.join(both)} cannot both be given: leave one of them out")
        if not isinstance(raw["file"], str):
            raise ValueError(f"file = {raw['file']!r} must be the name of a CSV file")
        columns = read_columns(Path((info.context or {}).get("folder", ".")) / raw["file"])
        return {key: value for key, value in raw.items() if key != "file"} | columns

    @model_validator(mode="after")
    def _rectangular(self) -> Self:
        if (self.radius_mm is None) == (self.curvature_per_mm is None):
            raise ValueError("give one of radius_mm and curvature_per_mm beside x_mm, or file, a CSV file with these columns")
        rows = len(self.x_mm)
        other = len(self.radius_mm or self.curvature_per_mm or ())
        if rows != other:
            raise ValueError(f"x_mm has {rows} rows, the other column {other}: they must be as many")
        if not 2 <= rows <= MAX_ROWS:
            raise ValueError(f"a table needs 2 to {MAX_ROWS} rows, this one has {rows} "
                             "(one value everywhere is law = \"constant\")")
        if self.interpolation != "smooth" and rows > MAX_KINKS:
            raise ValueError(f"interpolation = \"{self.interpolation}\" takes up to {MAX_KINKS} rows, this table has {rows}: "
                             "each is a kink that the surface has to follow; leave rows out, or take \"smooth\"")
        for row, (before, after) in enumerate(zip(self.x_mm, self.x_mm[1:], strict=False), start=2):
            if after <= before:
                raise ValueError(f"x_mm must rise from row to row: row {row} has {after:g} after {before:g}")
        return self

    def __repr_args__(self) -> list[tuple[str | None, object]]:
        """A long table by its number of rows."""
        short = [(key, value) for key, value in super().__repr_args__() if not isinstance(value, tuple) or len(value) <= 8]
        return short if len(self.x_mm) <= 8 else [("rows", len(self.x_mm)), *short]

    @property
    def row_curvatures(self) -> Array:
        """κ of each row, 1/mm, (n,)."""
        if self.curvature_per_mm is not None:
            return np.array(self.curvature_per_mm)
        return 1.0 / np.array(self.radius_mm)

    def over(self, span: Span) -> CurvatureLaw:
        """Make κ(x), 1/mm, convex positive, with t = 0 and 1 where `span` has them."""
        x, smoothness = np.array(self.x_mm), SMOOTHNESS[self.interpolation]
        curve = self._curve()
        # At inner rows the derivative after the last continuous one jumps. Ends: the law is held, so its slope jumps.
        inner = tuple(Break(float(at), smoothness) for at in x[1:-1])
        breaks = (Break(float(x[0]), 0), *inner, Break(float(x[-1]), 0))
        return CurvatureLaw(lambda at: curve(np.clip(at, x[0], x[-1])), breaks, "table law")

    def _curve(self) -> Function:
        x, kappa = np.array(self.x_mm), self.row_curvatures
        if self.interpolation == "linear":
            return lambda at: np.interp(at, x, kappa)
        from scipy.interpolate import CubicSpline, PchipInterpolator  # a fifth of a second: a table that is read needs none

        kind = CubicSpline if self.interpolation == "smooth" else PchipInterpolator
        curve: Function = kind(x, kappa)
        return curve

    def scaled(self, factor: float) -> Self:
        """Make the law whose radii are `factor` times as large everywhere."""
        if self.radius_mm is not None:
            return self.model_copy(update={"radius_mm": tuple(factor * radius for radius in self.radius_mm)})
        return self.model_copy(update={"curvature_per_mm": tuple(kappa / factor for kappa in self.curvature_per_mm or ())})

    def in_words(self, solved: float | None = None) -> str:
        """Say the law in a few words for a table."""
        between = "" if self.interpolation == "smooth" else f", {self.interpolation} between"
        return f"table of {len(self.x_mm)} rows{between}"

    def extent(self) -> tuple[float, float] | None:
        """Return the x of the first and the last row, mm."""
        return self.x_mm[0], self.x_mm[-1]

    def remarks(self, x_min: float, x_max: float) -> list[str]:
        """Say where the table ends short of the mirror, or swings between its rows."""
        first, last = self.x_mm[0], self.x_mm[-1]
        if last <= x_min or first >= x_max:
            return super().remarks(x_min, x_max)
        found = []
        if first > x_min + EDGE_ROUNDING_MM or last < x_max - EDGE_ROUNDING_MM:
            covered = min(last, x_max) - max(first, x_min)
            share = 100.0 * covered / (x_max - x_min)
            found.append(f"is a table from x = {first:g} to {last:g} mm, which covers {share:.3g} % of the mirror's width "
                         f"({x_min:g} to {x_max:g} mm): over the other {100.0 - share:.3g} % the curvature is held at the "
                         "table's end values")
        beyond = self._beyond_rows(max(first, x_min), min(last, x_max))
        if beyond:
            rows = self.row_curvatures
            found.append(f"is a table of radii from {_of(float(rows.max()))} to {_of(float(rows.min()))}, but between its rows "
                         f"the {self.interpolation} curve goes beyond them: {' and '.join(beyond)}; interpolation = "
                         "\"monotone\" or \"linear\" does not")
        return found

    def _beyond_rows(self, x_min: float, x_max: float) -> list[str]:
        """Say where between x_min and x_max the smooth curve leaves the range of the rows."""
        if self.interpolation != "smooth" or len(self.x_mm) < 3:
            return []
        from scipy.interpolate import CubicSpline

        rows = self.row_curvatures
        curve = CubicSpline(np.array(self.x_mm), rows)
        turns = curve.derivative().roots(discontinuity=False, extrapolate=False)
        x = np.concatenate([[x_min, x_max], turns[np.isfinite(turns) & (turns > x_min) & (turns < x_max)]])
        kappa = curve(x)
        highest, lowest, size = float(rows.max()), float(rows.min()), float(np.abs(rows).max())
        top, bottom = int(kappa.argmax()), int(kappa.argmin())
        found = []
        for worst, past, row, strange in (
                (top, kappa[top] - highest, highest, "" if highest > 0.0 else "convex, "),
                (bottom, lowest - kappa[bottom], lowest, "" if lowest < 0.0 else "concave, ")):
            # Of a flat row a share is nothing: there it is one of the largest curvature, and small.
            if past > OVERSHOOT * max(abs(row), 1e-3 * size):
                turned = strange if kappa[worst] * row <= 0.0 else ""
                found.append(f"{turned}R = {_of(float(kappa[worst]))} at x = {x[worst]:.1f} mm")
        return found


def _of(kappa: float) -> str:
    """A curvature as its radius."""
    return "∞" if kappa == 0.0 else f"{plain(float(f'{1.0 / kappa:.4g}'))} mm"
