"""Where the driver's eye sits, as `mirror_cad.eyes` places it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SpecError
from mirror_cad.eyes import EYE_DISTANCE_MM, Box
from mirror_cad.eyes import eye_position as design_eye
from raytrace.errors import TraceError

__all__ = ["EYE_DISTANCE_MM", "eye_position"]

Array = NDArray[np.float64]


def eye_position(distance_mm: float, aligned: str, box: Box) -> Array:
    """Place the eye at a distance from the centre of the mirror's surface, in the plane y = 0, over an edge or the centre.

    Parameters
    ----------
    distance_mm, aligned, box : as `mirror_cad.eyes.eye_position` has them.

    Returns
    -------
    (3,), mm, in mirror coordinates.

    Raises
    ------
    TraceError
        Where the edge is farther from the centre than the eye.
    """
    try:
        return design_eye(distance_mm, aligned, box)
    except SpecError as error:
        raise TraceError(str(error)) from None
