"""The fields of a deviation that the report draws, with their units and scales."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.curvature_fields import CurvatureFields, differences, in_percent, index_of_largest
from mirror_cad.deviation import Deviation
from mirror_cad.grid import Grid
from mirror_cad.surfaces.differential import ShapeOperator

Array = NDArray[np.float64]

# A radius beyond this is as good as flat, and would leave the colours of a scale in mm to one end.
LARGEST_RADIUS_MM = 1e5
# Differences below these are the last digits of float64: a scale finer than this would paint them as structure.
MIN_SPREAD = 1e-6  # of the values' size
MIN_CURVATURE_PER_M = 1e-6
MIN_PERCENT = 1e-6
# A limit this many times beyond the largest deviation is named beside the scale: on it, the maps would be blank.
FAR_LIMIT = 3.0
# Beyond this a deviation is larger than the curvature it is a percent of, as where a law passes through zero: one line of
# such points would set the scale of all maps.
LARGEST_PERCENT = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """One quantity at the grid, designed and realised; `as_curvature` where a radius cannot be drawn."""

    name: str
    unit: str
    designed: Array
    realised: Array
    as_curvature: bool = False

    def scale(self) -> tuple[float, float]:
        """The one scale of both, in `unit`."""
        low = float(min(self.designed.min(), self.realised.min()))
        high = float(max(self.designed.max(), self.realised.max()))
        least = MIN_CURVATURE_PER_M if self.unit == "1/m" else MIN_SPREAD * max(abs(low), abs(high))
        return widened(low, high, least)


@dataclass(frozen=True, slots=True, eq=False)
class DeviationFields:
    """Realised minus designed at the grid, in `unit`: percent, or 1/m for a plane and where percent mean nothing.

    worst : of each quantity the value largest in size, in `unit`, and its point in mm.
    limit : ± percent that k1 and k2 may have, None without one and in 1/m.   scale : the one scale of all, ± in `unit`.
    """

    values: dict[str, Array]
    unit: str
    worst: dict[str, tuple[float, tuple[float, float]]]
    limit: float | None

    @property
    def largest(self) -> float:
        """The largest deviation in size, in `unit`."""
        return max(float(np.abs(field).max()) for field in self.values.values())

    @property
    def scale(self) -> float:
        """The one scale of all, ± in `unit`."""
        least = MIN_PERCENT if self.unit == "%" else MIN_CURVATURE_PER_M
        largest = max(self.largest, least)
        return largest if self.limit is None or self.limit_is_far else max(largest, 1.1 * self.limit)

    @property
    def limit_is_far(self) -> bool:
        """Whether the limit lies too far outside the deviations to be drawn on their scale."""
        return self.limit is not None and self.limit > FAR_LIMIT * self.largest


def pairs_of(deviation: Deviation) -> list[Pair]:
    """Rx, Ry (mm; as curvature, 1/m, where they are flat or change sign), Km and Ka of eq. 1 (1/m), at the grid."""
    designed, realised = deviation.designed, deviation.realised
    power = [[0.5e3 * (w.w11 + w.w22), 0.5e3 * (w.w11 - w.w22)] for w in (designed, realised)]
    return [radius_pair("Rx", designed.w11, realised.w11), radius_pair("Ry", designed.w22, realised.w22),
            Pair("Km", "1/m", power[0][0], power[1][0]), Pair("Ka", "1/m", power[0][1], power[1][1])]


def deviation_fields(deviation: Deviation, limit_percent: float | None) -> DeviationFields:
    """The deviations the report draws, and where each is worst."""
    if deviation.percent is None or max(float(np.abs(field).max()) for field in deviation.percent) > LARGEST_PERCENT:
        per_mm = differences(deviation.realised, deviation.designed)
        values, unit, limit = {key: 1e3 * field for key, field in per_mm._asdict().items()}, "1/m", None
    else:
        values, unit, limit = deviation.percent._asdict(), "%", limit_percent
    return DeviationFields(values, unit, {key: _worst(field, deviation.grid) for key, field in values.items()}, limit)


def _worst(field: Array, grid: Grid) -> tuple[float, tuple[float, float]]:
    """The value largest in size and its point; of points that rounding alone tells apart the upper, as in deviation.json."""
    at = index_of_largest(np.abs(field), grid)
    return float(field[at]), (float(grid.x[at]), float(grid.y[at]))


def deviation_in(unit: str, realised: ShapeOperator, designed: ShapeOperator, rms: float) -> CurvatureFields:
    """Realised − designed at points, in percent as deviation.json has it, or in 1/m.

    Parameters
    ----------
    unit
        "%" or "1/m".
    realised, designed
        (n,) each, 1/mm.
    rms
        Of the designed curvature over the mirror, 1/mm, above 0 for percent.
    """
    per_mm = differences(realised, designed)
    return in_percent(per_mm, designed, rms) if unit == "%" else CurvatureFields(*(1e3 * value for value in per_mm))


def radius_pair(name: str, designed: Array, realised: Array) -> Pair:
    """Curvatures, 1/mm, as radii, mm; as curvatures, 1/m, where a radius is flat or changes sign."""
    both = np.concatenate([designed, realised])
    one_sign = bool((both > 0.0).all() or (both < 0.0).all())
    if one_sign and float(np.abs(both).min()) * LARGEST_RADIUS_MM >= 1.0:
        return Pair(name, "mm", 1.0 / designed, 1.0 / realised)
    return Pair(f"1/{name}", "1/m", 1e3 * designed, 1e3 * realised, as_curvature=True)


def widened(low: float, high: float, least: float) -> tuple[float, float]:
    """The interval, made `least` wide about its middle where it is narrower."""
    if high - low >= least:
        return low, high
    middle = 0.5 * (low + high)
    return middle - 0.5 * least, middle + 0.5 * least
