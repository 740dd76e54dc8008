"""Where a mirror was measured: the distance from any place to the nearest measured point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from mirror_cad.made.nominal import Nominal

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CELLS = 600  # of the raster along the longer side
# Of the distances to the nearest point over the mirror, a low quantile that gaps do not change, and how many of it a place may
# be from a point: on a square grid of step s that is 1.2·s, where the middle of a square is 0.7·s away.
QUANTILE, REACH = 0.3, 4.0
GAUGE_SHARE = 0.25  # of the gauge: a larger gap leaves a hole in what it stands on


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """A raster of distances to the nearest measured point.

    Attributes
    ----------
    low : ndarray
        (2,), mm, the raster's corner.
    pitch_mm : float
        Of its cells.
    distances : ndarray
        (m, n), mm, of the cells' middles.
    reach_mm : float
        How far from a point a place still counts as measured.
    spacing_mm : float
        Between points, about.
    """

    low: Array
    pitch_mm: float
    distances: Array
    reach_mm: float
    spacing_mm: float

    @staticmethod
    def of(nominal: Nominal, x: Array, y: Array, gauge_mm: float) -> Coverage:
        """The coverage by points.

        Parameters
        ----------
        nominal : Nominal
            The design.
        x, y : ndarray
            (n,), mm.
        gauge_mm : float
            A gap that is larger than a quarter of it is one.
        """
        x_min, x_max, y_min, y_max = nominal.box
        pitch = max(x_max - x_min, y_max - y_min) / CELLS
        low = np.array([x_min, y_min]) - 2.0 * pitch
        shape = int(np.ceil((x_max - x_min) / pitch)) + 4, int(np.ceil((y_max - y_min) / pitch)) + 4
        i, j = ((np.stack([x, y]) - low[:, None]) / pitch).astype(int)
        there = (i >= 0) & (i < shape[0]) & (j >= 0) & (j < shape[1])
        empty = np.ones(shape, dtype=bool)
        empty[i[there], j[there]] = False
        distances = distance_transform_edt(empty, sampling=pitch) if not empty.all() else np.full(shape, np.inf)
        cx, cy = np.meshgrid(low[0] + pitch * (np.arange(shape[0]) + 0.5), low[1] + pitch * (np.arange(shape[1]) + 0.5),
                             indexing="ij")
        inside = nominal.outline.contains(cx, cy)
        usual = float(np.quantile(distances[inside], QUANTILE)) if inside.any() else 0.0
        reach = max(min(REACH * usual, GAUGE_SHARE * gauge_mm), 2.0 * pitch)
        covered = float((inside & (distances <= reach)).sum()) * pitch**2
        return Coverage(low, pitch, distances, reach, float(np.sqrt(covered / max(1, int(there.sum())))))

    def covers(self, x: Array, y: Array) -> Mask:
        """Whether a measured point is near.

        Parameters
        ----------
        x, y : ndarray
            Of one shape, mm.
        """
        i = np.clip(((x - self.low[0]) / self.pitch_mm).astype(int), 0, self.distances.shape[0] - 1)
        j = np.clip(((y - self.low[1]) / self.pitch_mm).astype(int), 0, self.distances.shape[1] - 1)
        result: Mask = self.distances[i, j] <= self.reach_mm
        return result
