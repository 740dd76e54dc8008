"""The optical face before it is written to STEP and as read back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirror_cad.deviation import Deviation
from mirror_cad.mirror import Mirror
from mirror_cad.stage_deviation import SurfaceState
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import principal_curvatures_of
from mirror_studio.report.tables import Table


@dataclass(frozen=True, slots=True)
class Change:
    """One quantity before and after, in `unit` ("" for counts)."""

    name: str
    before: float
    after: float
    unit: str
    decimals: int  # in the report


@dataclass(frozen=True, slots=True)
class StepChange:
    """The optical face before writing and as read back.

    poles_mm, knots_mm : the farthest that a pole's coordinate and a knot have moved; None where their numbers differ.
    """

    rows: tuple[Change, ...]
    poles_mm: float | None
    knots_mm: float | None

    def table(self) -> Table:
        """A row a quantity."""
        rows = self.rows
        return Table("step", {"quantity": [row.name for row in rows], "unit": [row.unit for row in rows],
                              "before": [row.before for row in rows], "after": [row.after for row in rows],
                              "difference": [row.after - row.before for row in rows]})


def step_change(mirror: Mirror, deviation: Deviation, read_back: BSplineSurface,
                areas_mm2: tuple[float, float] | None) -> StepChange:
    """Form and size of the optical face. areas_mm2 : its area before and after by the kernel; None without it."""
    made, states = mirror.surface, deviation.states
    rows = [Change("degree along x", float(made.degree_u), float(read_back.degree_u), "", 0),
            Change("degree along y", float(made.degree_v), float(read_back.degree_v), "", 0)]
    rows += [Change(f"poles along {axis}", float(made.poles.shape[k]), float(read_back.poles.shape[k]), "", 0)
             for k, axis in enumerate("xy")]
    for name, value in (("lowest point", _lowest), ("k1, largest", _largest_k1), ("k2, smallest", _smallest_k2)):
        unit, decimals = ("mm", 9) if value is _lowest else ("1/m", 9)
        rows.append(Change(name, value(states.fit), value(states.step), unit, decimals))
    if areas_mm2 is not None:
        rows.append(Change("area of the optical face", *areas_mm2, "mm²", 6))
    pairs = ((made.knots_u, read_back.knots_u), (made.knots_v, read_back.knots_v))
    return StepChange(
        tuple(rows), float(np.abs(made.poles - read_back.poles).max()) if made.poles.shape == read_back.poles.shape else None,
        max(float(np.abs(a - b).max()) for a, b in pairs) if all(len(a) == len(b) for a, b in pairs) else None)


def _lowest(state: SurfaceState) -> float:
    return float(state.height.min())


def _largest_k1(state: SurfaceState) -> float:
    return 1e3 * float(principal_curvatures_of(state.shape)[0].max())


def _smallest_k2(state: SurfaceState) -> float:
    return 1e3 * float(principal_curvatures_of(state.shape)[1].min())
