"""Smooth functions sampled in cells, those whose turn between two samples may cross zero, and how far they go there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels import sign_changes as kernel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A turn is looked for where the parabola through three samples comes nearer to 0 than this share of what they span: of smooth
# functions it is right to much less.
NEAR_ZERO = 0.1
BESIDE_CELL = 0.25  # of a cell: a parabola's top may lie so far beside the cell in which the function turns
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
STEPS = 12  # of golden section: to 3e-3 of a cell, of a parabola 1e-5 of its rise in the cell


def may_cross(at: Array, values: Array) -> tuple[Mask, Mask]:
    """Whether functions may cross 0 twice between two of three samples that have the same sign.

    Parameters
    ----------
    at : (3, n) places of the samples, rising.
    values : (3, …, n).

    Returns
    -------
    Whether between the first and the second, and between the second and the third, (…, n) each.
    """
    shape = values.shape[1:]
    found = np.empty((2, *shape), dtype=np.bool_)
    rows = np.ascontiguousarray(values.reshape(3, -1, shape[-1]))
    kernel.may_cross(np.ascontiguousarray(at), rows, NEAR_ZERO, BESIDE_CELL, found.reshape(2, -1, shape[-1]))
    return found[0], found[1]


def lowest(function: Callable[[Array], Array], n: int) -> tuple[Array, Array]:
    """Find where functions are least between 0 and 1, by golden section; below 0 they are not followed further.

    Parameters
    ----------
    function : (n,) to (n,), one function a row; NaN counts as high.
    n : how many there are.

    Returns
    -------
    at, value : (n,) each, to 3e-3 in `at`.
    """
    def height(share: Array) -> Array:
        found = function(share)
        return np.where(np.isfinite(found), found, np.inf)

    low, high = np.zeros(n), np.ones(n)
    one, two = np.full(n, 1.0 - GOLDEN), np.full(n, GOLDEN)
    at_one, at_two = height(one), height(two)
    share, best = np.where(at_one <= at_two, one, two), np.minimum(at_one, at_two)
    for _ in range(STEPS):
        if (best <= 0.0).all():
            break
        nearer = at_one <= at_two
        low, high = np.where(nearer, low, one), np.where(nearer, two, high)
        fresh = np.where(nearer, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
        now = height(fresh)
        one, two = np.where(nearer, fresh, two), np.where(nearer, one, fresh)
        at_one, at_two = np.where(nearer, now, at_two), np.where(nearer, at_one, now)
        share, best = np.where(now < best, fresh, share), np.minimum(now, best)
    return share, best
