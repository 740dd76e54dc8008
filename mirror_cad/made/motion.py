"""A rigid motion that takes measured points to the design."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """p_design = R·p + t; with `reflected`, R·(−x, y, z) + t.

    Attributes
    ----------
    rotation : ndarray
        R, (3, 3), a rotation.
    translation : ndarray
        t, (3,), mm.
    reflected : bool
        Whether the points were those of the other hand's mirror.
    """

    rotation: Array
    translation: Array
    reflected: bool = False

    @staticmethod
    def identity() -> Motion:
        """Points that are in the design's coordinates already."""
        return Motion(np.eye(3), np.zeros(3))

    @property
    def rotation_deg(self) -> Array:
        """The rotation vector, (3,): its direction is the axis, its length the angle in degrees."""
        result: Array = np.degrees(Rotation.from_matrix(self.rotation).as_rotvec())
        return result

    def of_points(self, points: Array) -> Array:
        """Move points.

        Parameters
        ----------
        points : ndarray
            (n, 3), mm.
        """
        result: Array = self.of_directions(points) + self.translation
        return result

    def of_directions(self, directions: Array) -> Array:
        """Turn directions.

        Parameters
        ----------
        directions : ndarray
            (n, 3).
        """
        return (directions * [-1.0, 1.0, 1.0] if self.reflected else directions) @ self.rotation.T

    def then(self, turn: Array, shift: Array, about: Array) -> Motion:
        """Add a motion p ↦ exp([ω]×)·(p − c) + c + s in the design's coordinates.

        Parameters
        ----------
        turn : ndarray
            ω, (3,), radians.
        shift : ndarray
            s, (3,), mm.
        about : ndarray
            c, (3,), mm.
        """
        added = Rotation.from_rotvec(turn).as_matrix()
        return Motion(added @ self.rotation, added @ (self.translation - about) + about + shift, self.reflected)
