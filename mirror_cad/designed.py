"""The designed shape operator of a mirror, and what counts as 100 % of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirror_cad.grid import Grid
from mirror_cad.outline import Outline
from mirror_cad.surfaces.differential import ShapeOperator, principal_curvatures_of, rms_norm
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev

Array = NDArray[np.float64]

# Where the designed value is smaller than this share of the RMS curvature, percent are of this share instead.
FLOOR = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class DesignedCurvature:
    """The two designed curvatures of a mirror.

    Attributes
    ----------
    horizontal, vertical : PiecewiseChebyshev
        1/Rx(x) and 1/Ry(x), 1/mm.
    """

    horizontal: PiecewiseChebyshev
    vertical: PiecewiseChebyshev

    def shape(self, x: ArrayLike) -> ShapeOperator:
        """diag(1/Rx, 1/Ry) at x.

        Parameters
        ----------
        x : array_like
            mm.
        """
        kx = self.horizontal(x)
        return ShapeOperator(kx, self.vertical(x), np.zeros_like(kx))

    def rms(self, outline: Outline) -> float:
        """RMS ‖diag(1/Rx, 1/Ry)‖ over the trimmed mirror, by area in (x, y), 1/mm.

        Parameters
        ----------
        outline : Outline
            What the mirror is trimmed to.
        """
        grid = Grid.over(outline)
        # The laws depend on x alone: each column of cells counts as often as it has cells inside, the edge not at all.
        return rms_norm(self.shape(grid.cells_x), grid.inside.sum(axis=1, dtype=np.float64))

    def reference_curvature(self, x: Array, rms: float) -> Array:
        """What counts as 100 % for k1 and k2 at x, as the function `reference_curvature` has it.

        Parameters
        ----------
        x : ndarray
            (n,), mm.
        rms : float
            As `rms` gives it.

        Returns
        -------
        ndarray
            (n, 2), 1/mm.
        """
        return reference_curvature(self.shape(x), rms)


def reference_curvature(designed: ShapeOperator, rms: float) -> Array:
    """What counts as 100 % for k1 and k2: the designed pair in size, larger curvature first, not below FLOOR of the RMS.

    Parameters
    ----------
    designed : ShapeOperator
        1/mm.
    rms : float
        RMS ‖diag(1/Rx, 1/Ry)‖ over the mirror, 1/mm.

    Returns
    -------
    ndarray
        (…, 2), 1/mm.
    """
    pair = np.stack(principal_curvatures_of(designed), axis=-1)
    return np.maximum(np.abs(pair), FLOOR * rms)
