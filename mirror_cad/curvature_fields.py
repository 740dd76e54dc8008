"""Differences of curvature at the points of a mirror, in 1/m and in percent of what is designed there."""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from mirror_cad.designed import FLOOR, reference_curvature
from mirror_cad.grid import Grid
from mirror_cad.surfaces.differential import ShapeOperator, principal_curvatures_of

Array = NDArray[np.float64]
Quantity = Literal["k1", "k2", "kx", "ky", "twist"]

QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
SAME_SIZE = 1e-6  # relative: values that rounding alone tells apart, as a mirror that is symmetric in y has them


class CurvatureFields(NamedTuple):
    """Differences of curvature at points: k1, k2, kx, ky and twist, arrays of one shape, in 1/mm or percent."""

    k1: Array
    k2: Array
    kx: Array
    ky: Array
    twist: Array


def differences(after: ShapeOperator, before: ShapeOperator) -> CurvatureFields:
    """k1, k2, kx, ky and twist, after − before, 1/mm."""
    a, b = principal_curvatures_of(after), principal_curvatures_of(before)
    return CurvatureFields(a[0] - b[0], a[1] - b[1], after.w11 - before.w11, after.w22 - before.w22, after.w12 - before.w12)


def in_percent(difference: CurvatureFields, designed: ShapeOperator, rms: float) -> CurvatureFields:
    """Differences of curvature in percent of the local designed value, and nowhere of less than `FLOOR` of the RMS.

    Parameters
    ----------
    difference
        (n,) each, 1/mm.
    designed
        The designed shape operator at the same points, 1/mm.
    rms
        RMS ‖diag(1/Rx, 1/Ry)‖ over the mirror, 1/mm, above 0; twist is in percent of this.
    """
    pair, floor = reference_curvature(designed, rms), FLOOR * rms
    scale = (pair[..., 0], pair[..., 1], np.maximum(np.abs(designed.w11), floor), np.maximum(np.abs(designed.w22), floor),
             np.asarray(rms))
    return CurvatureFields(*(100.0 * value / size for value, size in zip(difference, scale, strict=True)))


def index_of_largest(size: Array, grid: Grid) -> int:
    """The index at which a field is largest; of points that rounding alone tells apart (a mirror is symmetric in y) the upper.

    Parameters
    ----------
    size
        (n,) at the points of the grid, not negative.
    grid
        Whose y decides between equals.
    """
    ties = np.flatnonzero(size >= size.max() * (1.0 - SAME_SIZE))
    return int(ties[np.argmax(grid.y[ties])])
