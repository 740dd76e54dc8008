"""Points on what reflects with the area around each: they tell its side and its size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.rays import Mask

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class AreaSamples:
    """Points on what reflects, that tell its side and size.

    Attributes
    ----------
    points : (n, 3), mm.
    areas : (n, 3), mm², area times outward normal around each.
    owner : (n,), the number of the face that each is on.
    """

    points: Array
    areas: Array
    owner: NDArray[np.intp]

    @property
    def sizes(self) -> Array:
        """Areas (n,), mm²."""
        result: Array = np.linalg.norm(self.areas, axis=1)
        return result

    def those(self, wanted: Mask) -> AreaSamples:
        """Those of a mask (n,)."""
        return AreaSamples(self.points[wanted], self.areas[wanted], self.owner[wanted])
