"""Points and tolerances as callers and files give them, made fit to compute with or refused by an `OutlineError`."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirror_cad.errors import OutlineError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Point = tuple[float, float]
Bounds = tuple[float, float, float, float]

MAXIMUM_EDGES = 300_000
"""Most straight edges one outline may be broken into, so that a malformed one cannot exhaust the memory."""

ROUNDING_MM = 1e-9
"""Ends closer than this differ by rounding; moving them to close the gap would only add rounding of its own."""

FULL_TURN = 2.0 * math.pi
LARGEST = 1e12
"""Numbers larger than this overflow or lose all digits in what is computed with them."""


def point_text(point: Sequence[float] | FloatArray) -> str:
    """A point as messages write it."""
    return f"({point[0]:.6g}, {point[1]:.6g}) mm"


def finite_point(value: ArrayLike, what: str) -> Point:
    """A point that can be computed with.

    Parameters
    ----------
    value : object
        Two finite numbers, if all is well.
    what : str
        Its name in messages.

    Raises
    ------
    OutlineError
        For anything else.
    """
    array = np.asarray(value, dtype=float)
    if array.shape != (2,) or not (np.abs(array) <= LARGEST).all():
        raise OutlineError(f"{what} is {value!r}: it must be two finite numbers up to {LARGEST:g}, x and y in mm")
    return float(array[0]), float(array[1])


def check_tolerance(tolerance_mm: float) -> None:
    """Refuse a chord tolerance that is not finite and above 0.

    Raises
    ------
    OutlineError
    """
    if not (math.isfinite(tolerance_mm) and tolerance_mm > 0.0):
        raise OutlineError(f"chord tolerance is {tolerance_mm!r} mm: it must be a finite number above 0")
