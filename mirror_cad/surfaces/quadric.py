"""Planes, spheres and cylinders as plain records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Quadric:
    """A plane, sphere or cylinder in a frame of its own, parametrised as STEP (ISO 10303-42) does.

    Plane: S = C + u·X + v·Y. Sphere: S = C + R·cos v·(cos u·X + sin u·Y) + R·sin v·Z.
    Cylinder: S = C + R·(cos u·X + sin u·Y) + v·Z. u of sphere and cylinder, and v of the sphere, are in radians.

    Attributes
    ----------
    kind : str
        "plane", "sphere" or "cylinder".
    centre : ndarray
        C, (3,), mm.
    axes : ndarray
        (3, 3), rows X, Y, Z, orthonormal, right- or left-handed.
    radius_mm : float
        R; 0 for a plane.
    """

    kind: Literal["plane", "sphere", "cylinder"]
    centre: Array
    axes: Array
    radius_mm: float

    def evaluate(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Points S(u, v), (…, 3), mm.

        Parameters
        ----------
        u, v : array_like
            Of shapes that broadcast; mm or radians, as the kind has them.
        """
        u, v = np.broadcast_arrays(np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64))
        if self.kind == "plane":
            local = np.stack([u, v, np.zeros_like(u)], axis=-1)
        elif self.kind == "sphere":
            local = self.radius_mm * np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
        else:
            local = np.stack([self.radius_mm * np.cos(u), self.radius_mm * np.sin(u), v], axis=-1)
        result: Array = self.centre + local @ self.axes
        return result
