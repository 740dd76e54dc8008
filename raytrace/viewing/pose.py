"""Where a mirror is put on a vehicle and how it is turned there: coordinates of the one in those of the other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Hand = Literal["left", "right"]

# Columns: the mirror's x (to the right as the driver looks at it), y (up) and z (towards him) in vehicle coordinates.
STRAIGHT = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
SIDEWAYS = np.diag([1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Pose:
    """A mirror on a vehicle, in the vehicle's coordinates X rearward, Y right, Z up (ISO 4130 has their directions), mm.

        p_vehicle = S·(c + q + T·(p_mirror − q)),   T = Rz(yaw)·Rpitch·STRAIGHT,   all for the left-hand mirror

    A file describes the left mirror; the right one is its reflection in the plane Y = 0 (S), and centre, yaw and pitch are
    those of the left one that it is the reflection of.

    Parameters
    ----------
    centre : (3,), c, mm, where the centre of the mirror's surface is while yaw = pitch = 0.
    pivot : (3,), q, mm, in mirror coordinates, what it turns about.
    yaw : about Z, radians; a positive one turns the left mirror's face towards the vehicle, the right one's too.
    pitch : then about the mirror's own x, radians; a positive one turns its face upwards.
    hand : whether it is the left mirror or the right one.
    """

    centre: Array
    pivot: Array
    yaw: float = 0.0
    pitch: float = 0.0
    hand: Hand = "left"

    def __repr__(self) -> str:
        x, y, z = self.centre
        return (f"<Pose: {self.hand} mirror at ({x:.0f}, {y:.0f}, {z:.0f}) mm, yaw {np.degrees(self.yaw):.2f}°, "
                f"pitch {np.degrees(self.pitch):.2f}°>")

    @cached_property
    def rotation(self) -> Array:
        """Mirror directions to vehicle directions, (3, 3), orthogonal; its determinant is −1 for the right-hand mirror."""
        cy, sy, cp, sp = np.cos(self.yaw), np.sin(self.yaw), np.cos(self.pitch), np.sin(self.pitch)
        yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        # From rearward (X) to up (Z), about Y: the mirror's x before the yaw.
        pitch = np.array([[cp, 0.0, -sp], [0.0, 1.0, 0.0], [sp, 0.0, cp]])
        left: Array = yaw @ pitch @ STRAIGHT
        return SIDEWAYS @ left if self.hand == "right" else left

    @cached_property
    def offset(self) -> Array:
        """Where the mirror's origin is in the vehicle, (3,)."""
        fixed = self.centre + STRAIGHT @ self.pivot
        return (SIDEWAYS @ fixed if self.hand == "right" else fixed) - self.rotation @ self.pivot

    @staticmethod
    def identity() -> Pose:
        """The mirror in its own coordinates, as the paper has it: x right, y up, z towards the driver."""
        return _Identity(np.zeros(3), np.zeros(3))

    def to_vehicle(self, points: Array) -> Array:
        """Points (…, 3), mm, of the mirror in vehicle coordinates."""
        return points @ self.rotation.T + self.offset

    def to_mirror(self, points: Array) -> Array:
        """Points (…, 3), mm, of the vehicle in mirror coordinates."""
        return (points - self.offset) @ self.rotation

    def directions_to_vehicle(self, directions: Array) -> Array:
        """Directions (…, 3) in the mirror's coordinates, in the vehicle's."""
        return directions @ self.rotation.T

    def directions_to_mirror(self, directions: Array) -> Array:
        """Directions (…, 3) in the vehicle's coordinates, in the mirror's."""
        return directions @ self.rotation


@dataclass(frozen=True, eq=False)
class TiltedPose(Pose):
    """A mirror on a vehicle whose body a load has tilted about Y and lowered, seen from the road.

        X' = X cos t + Z sin t,   Z' = Z cos t − X sin t − s

    Parameters
    ----------
    tilt : t, radians; a positive one lowers the rear.
    sink : s, mm, by which X = 0 is lower.
    """

    tilt: float = 0.0
    sink: float = 0.0

    @staticmethod
    def of(pose: Pose, tilt: float, sink: float) -> TiltedPose:
        """A pose on the body as it stands without a load, tilted with it."""
        return TiltedPose(pose.centre, pose.pivot, pose.yaw, pose.pitch, pose.hand, tilt, sink)

    @cached_property
    def _turn(self) -> Array:
        c, s = np.cos(self.tilt), np.sin(self.tilt)
        return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])

    def tilted(self, points: Array) -> Array:
        """Points (…, 3), mm, of the body without a load, where they are with it."""
        result: Array = points @ self._turn.T - [0.0, 0.0, self.sink]
        return result

    @cached_property
    def rotation(self) -> Array:
        """As of a pose, to the coordinates of the road."""
        base = Pose(self.centre, self.pivot, self.yaw, self.pitch, self.hand)
        result: Array = self._turn @ base.rotation
        return result

    @cached_property
    def offset(self) -> Array:
        """As of a pose."""
        return self.tilted(Pose(self.centre, self.pivot, self.yaw, self.pitch, self.hand).offset)


class _Identity(Pose):
    """Mirror coordinates as they are."""

    def __repr__(self) -> str:
        return "in mirror coordinates"

    @cached_property
    def rotation(self) -> Array:
        return np.eye(3)

    @cached_property
    def offset(self) -> Array:
        return np.zeros(3)
