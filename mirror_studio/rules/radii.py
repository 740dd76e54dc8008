"""Readings of a spherometer in pairs: their means, and how far they are apart, as rules reckon them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Radii:
    """Spherometer readings (k, 2) at k places (k, 2), mm: two perpendicular ones at each."""

    at: Array
    readings: Array

    @property
    def flat(self) -> bool:
        """Whether no reading tells any curvature."""
        return bool(np.isinf(self.readings).all())

    @cached_property
    def means(self) -> Array:
        """r_p = (r_i + r'_i)/2, (k,)."""
        result: Array = self.readings.mean(axis=1)
        return result

    @property
    def mean(self) -> float:
        """r, the mean of the points' means; inf where one reading is flat."""
        return float(self.means.mean())

    @property
    def readings_spread_percent(self) -> float:
        """The largest |r_i − r_p| and |r'_i − r_p|, of r, percent."""
        return self._spread(self.means[:, None])

    @property
    def means_spread_percent(self) -> float:
        """The largest |r_p − r|, of r, percent."""
        return self._spread(self.mean, self.means)

    @property
    def off_mean_percent(self) -> float:
        """The largest difference of a reading from the mean of all, percent of it."""
        return self._spread(self.mean)

    def _spread(self, about: Array | float, of: Array | None = None) -> float:
        """Of the readings without `of`. 0 of a flat mirror; inf where some readings are flat and some are not."""
        if self.flat:
            return 0.0
        if not np.isfinite(self.readings).all():
            return math.inf
        return 100.0 * float(np.abs((self.readings if of is None else of) - about).max()) / abs(self.mean)
