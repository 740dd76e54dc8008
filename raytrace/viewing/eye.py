"""Where the driver's eye sits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import TraceError

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

EYE_DISTANCE_MM = 762.0  # from the centre of the mirror's surface: Lee et al. (2014), section 3.2


def eye_position(distance_mm: float, aligned: str, box: Box) -> Array:
    """The eye at the stated distance from the centre of the mirror surface (the origin), in the plane y = 0, over the
    right edge, the centre or the left edge of the outline's box; (3,) mm.

    e = (x_a, 0, √(d² − x_a²)), with x_a the x of what it is aligned with.
    Raises: TraceError where the edge is farther from the centre than the eye.
    """
    x = {"right": box[1], "centre": 0.0, "left": box[0]}[aligned]
    if abs(x) >= distance_mm:
        raise TraceError(f"eye.distance_mm = {distance_mm:g} is not above {abs(x):g} mm, how far the mirror's {aligned} edge "
                         "is from the origin: an eye aligned with it would sit in the mirror")
    return np.array([x, 0.0, math.sqrt(distance_mm**2 - x**2)])
