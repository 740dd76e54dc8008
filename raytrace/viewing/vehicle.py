"""The host vehicle and where the driver's eyes are in it, as far as they matter for what a mirror shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.eyes import EYE_SEPARATION_MM
from raytrace.viewing.aim import RearEdge
from raytrace.viewing.pose import Hand

Array = NDArray[np.float64]

TOUCHING = 1e-9  # of the way: a ray may start or end on the vehicle's side


@dataclass(frozen=True, slots=True, eq=False)
class Eyes:
    """The driver's two ocular points, a distance apart along Y.

    Parameters
    ----------
    middle : (3,), mm, between them, in vehicle coordinates.
    separation_mm : from one to the other, mm.
    """

    middle: Array
    separation_mm: float = EYE_SEPARATION_MM

    @property
    def left(self) -> Array:
        """The left ocular point, (3,), mm."""
        return self.middle - np.array([0.0, 0.5 * self.separation_mm, 0.0])

    @property
    def right(self) -> Array:
        """The right ocular point, (3,), mm."""
        return self.middle + np.array([0.0, 0.5 * self.separation_mm, 0.0])


@dataclass(frozen=True, slots=True)
class HostVehicle:
    """A box that hides what lies behind it: |Y| ≤ half_width, front ≤ X ≤ rear, 0 ≤ Z ≤ height.

    Parameters
    ----------
    half_width_mm, front_mm, rear_mm, height_mm : its planes, mm, in vehicle coordinates.
    """

    half_width_mm: float
    front_mm: float
    rear_mm: float
    height_mm: float

    def rear_edge(self, hand: Hand) -> RearEdge:
        """The vertical edge that ends the flank on a mirror's side."""
        return RearEdge(self.rear_mm, -self.half_width_mm if hand == "left" else self.half_width_mm)

    @property
    def corners(self) -> tuple[Array, Array]:
        """The box's lowest and highest coordinates, (3,) each, mm."""
        return (np.array([self.front_mm, -self.half_width_mm, 0.0]),
                np.array([self.rear_mm, self.half_width_mm, self.height_mm]))

    def hides(self, starts: Array, ends: Array) -> NDArray[np.bool_]:
        """Find whether the vehicle stands between starts and ends.

        Parameters
        ----------
        starts, ends : (…, 3), mm, in vehicle coordinates.

        Returns
        -------
        (…), whether the segment passes the box's inside; no where it only touches, and for rows that are not numbers.
        """
        segment = ends - starts
        low, high = self.corners
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low - starts) / segment, (high - starts) / segment
            # A way along a side has 0/0 where it lies in the side: it touches, and is not hidden.
            enter, leave = np.fmin(a, b).max(axis=-1), np.fmax(a, b).min(axis=-1)
            found: NDArray[np.bool_] = (enter < leave) & (leave > TOUCHING) & (enter < 1.0 - TOUCHING)
        return found
