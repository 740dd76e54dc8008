"""Where a driver's eyes are before a mirror, and how far apart."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SpecError

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

EYE_DISTANCE_MM = 762.0  # from the centre of the mirror's surface: Lee et al. (2014), section 3.2
EYE_SEPARATION_MM = 65.0  # between the two ocular points: UN Regulation No. 46, 12


def eye_position(distance_mm: float, aligned: str, box: Box) -> Array:
    """Place the eye at a distance from the centre of the mirror's surface, in the plane y = 0, over an edge or the centre.

    e = (x_a, 0, √(d² − x_a²)), with x_a the x of what it is aligned with; the centre is the origin.

    Parameters
    ----------
    distance_mm : float
        d, mm.
    aligned : str
        "right", "centre" or "left", as the driver looks at the mirror.
    box : tuple
        (x_min, x_max, y_min, y_max) of the mirror, mm.

    Returns
    -------
    ndarray
        (3,), mm, in mirror coordinates.

    Raises
    ------
    SpecError
        Where the edge is farther from the centre than the eye.

    References
    ----------
    Lee et al. (2014), section 3.2.
    """
    x = {"right": box[1], "centre": 0.0, "left": box[0]}[aligned]
    if abs(x) >= distance_mm:
        raise SpecError(f"eye.distance_mm = {distance_mm:g} is not above {abs(x):g} mm, how far the mirror's {aligned} edge "
                        "is from the origin: an eye aligned with it would sit in the mirror")
    return np.array([x, 0.0, math.sqrt(distance_mm**2 - x**2)])


def ocular_points(middle: Array) -> tuple[Array, Array]:
    """Place the left and the right eye beside the middle between them.

    Parameters
    ----------
    middle : ndarray
        (3,), mm, in mirror coordinates, in which x points to the driver's right.

    Returns
    -------
    tuple of ndarray
        (3,) mm each, EYE_SEPARATION_MM apart along x.
    """
    aside = np.array([0.5 * EYE_SEPARATION_MM, 0.0, 0.0])
    return middle - aside, middle + aside
