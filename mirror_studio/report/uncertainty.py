"""How far the figures of a deviation may be off: by its grid, by quadrature and by rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.designed import FLOOR, DesignedCurvature
from mirror_cad.deviation import Deviation
from mirror_cad.grid import EDGE_POINTS, GRID, Grid
from mirror_cad.mirror import Mirror
from mirror_cad.sections import SagDerivatives
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import ShapeOperator, rms_norm, shape_operator_of_sag
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev
from mirror_studio.report.fields import DeviationFields, deviation_in
from mirror_studio.report.tables import Table

Array = NDArray[np.float64]

FINER = (2 * GRID[0] - 1, 2 * GRID[1] - 1)  # cells: as near to twice as many as an odd number gets
FINER_EDGE_POINTS = 2 * EDGE_POINTS
GAUSS_NODES = 32  # on each piece of the profile: exact for polynomials of degree 63, where the series have 24


@dataclass(frozen=True, slots=True, eq=False)
class Uncertainty:
    """How far the figures of a deviation may be off.

    cells, points : of the grid inside the outline, and of those on its edge; finer : the same of the refined one.
    largest : of each quantity the largest deviation in size on the grid and on the refined one, in `unit` (% or 1/m).
    rounding_per_m : between two formulas of the realised curvature at the same points.
    quadrature_mm, quadrature_percent : of the exact profile, against Gauss's rule and against its own second derivative;
    None where no part of the mirror is built on a profile by quadrature.
    """

    cells: tuple[int, int]
    points: tuple[int, int]
    finer_cells: tuple[int, int]
    finer: tuple[int, int]
    largest: dict[str, tuple[float, float]]
    unit: str
    rounding_per_m: float
    quadrature_mm: float | None
    quadrature_percent: float | None

    def missed(self, key: str) -> float:
        """How much larger the deviation is on the refined grid, in `unit`; 0 where it is not."""
        coarse, fine = self.largest[key]
        return max(fine - coarse, 0.0)

    def table(self) -> Table:
        """A row a quantity."""
        unit = "percent" if self.unit == "%" else "per_m"
        columns = np.array([self.largest[key] for key in QUANTITIES]).T
        return Table("sampling", {"quantity": list(QUANTITIES), f"grid_{unit}": columns[0], f"refined_grid_{unit}": columns[1]})


def uncertainty(mirror: Mirror, deviation: Deviation, surface: BSplineSurface, fields: DeviationFields) -> Uncertainty:
    """Of a deviation that was taken on `surface`, the optical face as read back (u = x, v = y)."""
    grid, curvature = deviation.grid, mirror.curvature
    rms = rms_norm(deviation.designed, grid.weights)
    finer = Grid.over(mirror.outline, FINER, FINER_EDGE_POINTS)
    largest = _largest(_shape(surface, finer), curvature, finer, rms, fields.unit)
    again = _shape(surface, grid)
    rounding = max(float(np.abs(a - b).max()) for a, b in zip(again, deviation.realised, strict=True))
    height_mm, percent = _quadrature(mirror, rms)
    inside, finer_inside = int(grid.inside.sum()), int(finer.inside.sum())
    return Uncertainty(
        (len(grid.cells_x), len(grid.cells_y)), (inside, len(grid.x) - inside), (len(finer.cells_x), len(finer.cells_y)),
        (finer_inside, len(finer.x) - finer_inside),
        {key: (float(np.abs(fields.values[key]).max()), largest[key]) for key in QUANTITIES}, fields.unit, 1e3 * rounding,
        height_mm, percent)


def _shape(surface: BSplineSurface, grid: Grid) -> ShapeOperator:
    """By the closed form for z(x, y), where `Deviation` has it from the fundamental forms."""
    cells = surface.on_grid(grid.cells_x, grid.cells_y, component=2)
    edge = surface.derivatives(grid.x[grid.edge], grid.y[grid.edge])
    return shape_operator_of_sag(SagDerivatives(*(np.concatenate([cells[key][grid.inside], edge[key][:, 2]])
                                                  for key in ("s", "u", "v", "uu", "uv", "vv"))))


def _largest(realised: ShapeOperator, curvature: DesignedCurvature, grid: Grid, rms: float, unit: str) -> dict[str, float]:
    # The laws are functions of x alone: once a column, not once a point.
    column = curvature.shape(grid.cells_x)
    rows, _ = np.nonzero(grid.inside)
    edge = curvature.shape(grid.x[grid.edge])
    designed = ShapeOperator(*(np.concatenate([along[rows], on_edge]) for along, on_edge in zip(column, edge, strict=True)))
    values = deviation_in(unit, realised, designed, rms)
    return {key: float(np.abs(value).max()) for key, value in values._asdict().items()}


def _quadrature(mirror: Mirror, rms: float) -> tuple[float | None, float | None]:
    """The exact profile's height against Gauss's rule on its slope, and the curvature that its height has against the law."""
    profile, height = mirror.exact.profile, mirror.exact.profile.height
    if not isinstance(height, PiecewiseChebyshev):
        return None, None
    ends = height.breaks
    node, weight = np.polynomial.legendre.leggauss(GAUSS_NODES)
    middle, half = 0.5 * (ends[:-1] + ends[1:]), 0.5 * np.diff(ends)
    x = middle[:, None] + half[:, None] * node
    slope = profile.slope(x.ravel()).reshape(x.shape)
    risen = np.concatenate([[0.0], np.cumsum(half * (slope @ weight))])
    off_mm = float(np.abs(height(ends) - height(ends[0]) - risen).max())
    if rms == 0.0:
        return off_mm, None
    first = height.derivative()
    bend = -first.derivative()(x) / (1.0 + first(x) ** 2) ** 1.5
    wanted = mirror.curvature.horizontal(x)
    inside = (x >= mirror.box[0]) & (x <= mirror.box[1])
    return off_mm, 100.0 * float((np.abs(bend - wanted) / np.maximum(np.abs(wanted), FLOOR * rms))[inside].max())
