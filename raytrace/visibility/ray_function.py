"""Functions of rays that say on which side of a point, a line or a plane each passes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.sheet_rim import values

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class RayFunction:
    """Functions f0 + f1..3·q + f4..6·d + f7..9·(q × d) of rays from q along unit d.

    Whatever says on which side of a point, a line or a plane a ray passes is one of them.
    coefficients (1, 10), or (n, 10) for n rays.
    """

    coefficients: Array

    @staticmethod
    def of(constant: Array | float = 0.0, point: Array | None = None, direction: Array | None = None,
           moment: Array | None = None) -> RayFunction:
        """By f0, f1..3, f4..6 and f7..9: (3,) or (n, 3); 0 where left out."""
        parts = [np.atleast_2d(np.asarray(constant, dtype=np.float64).reshape(-1, 1)),
                 *(np.zeros((1, 3)) if part is None else np.atleast_2d(part) for part in (point, direction, moment))]
        n = next((len(part) for part in parts if len(part) != 1), 1)
        return RayFunction(np.concatenate([np.broadcast_to(part, (n, part.shape[1])) for part in parts], axis=1))

    def some(self, rows: Index) -> RayFunction:
        """Those of some rays, where there is one a ray."""
        return self if len(self.coefficients) == 1 else RayFunction(self.coefficients[rows])

    def __call__(self, points: Array, directions: Array) -> Array:
        """Values (n,) of rays from points (n, 3) along directions (n, 3)."""
        found = np.empty(len(points))
        values(self.coefficients, points, directions, found)
        return found


LEVEL = RayFunction.of(direction=np.array([0.0, 0.0, 1.0]))  # above 0 for rays that rise
