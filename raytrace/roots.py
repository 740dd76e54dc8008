"""Roots of many functions of one number at once, each between two places where it has opposite signs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAX_STEPS = 80  # halving alone takes 37
ROOT_SHARE = 1e-11  # of the bracket: a root that is known to less is found


def roots(function: Callable[[Array], Array], at_low: Array, at_high: Array) -> Array:
    """Find where functions vanish between 0 and 1.

    A secant first, then inverse quadratic interpolation where three values allow it, halving elsewhere.

    Parameters
    ----------
    function : (m,) to (m,), one function a row.
    at_low, at_high : (m,), their values at 0 and at 1, of opposite signs.

    Returns
    -------
    (m,), to 1e-11.

    References
    ----------
    Chandrupatla, A new hybrid quadratic/bisection algorithm for finding the zero of a nonlinear function, Advances in
    Engineering Software 28 (1997).
    """
    here, other = np.zeros_like(at_low), np.ones_like(at_low)
    at_here, at_other = at_low, at_high
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(at_low == at_high, 0.5, at_low / (at_low - at_high))  # a straight line: most are nearly that
    for _ in range(MAX_STEPS):
        there = here + share * (other - here)
        now = function(there)
        beside = (now > 0.0) == (at_here > 0.0)
        third, at_third = np.where(beside, here, other), np.where(beside, at_here, at_other)
        other, at_other = np.where(beside, other, here), np.where(beside, at_other, at_here)
        here, at_here = there, now
        least = np.minimum(0.5, ROOT_SHARE / np.maximum(np.abs(other - here), ROOT_SHARE))
        if ((least >= 0.5) | (at_here == 0.0)).all():
            break
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = (here - other) / (third - other), (at_here - at_other) / (at_third - at_other)
            quadratic = (at_here / (at_other - at_here) * at_third / (at_other - at_third)
                         + (third - here) / (other - here) * at_here / (at_third - at_here) * at_other / (at_third - at_other))
        share = np.where((y * y < x) & ((1.0 - y) ** 2 < 1.0 - x), np.clip(quadratic, least, 1.0 - least), 0.5)
        share = np.where(at_here == 0.0, 0.0, share)
    return np.where(np.abs(at_here) <= np.abs(at_other), here, other)
