"""The eye and the scene in the frame of a mirror that is turned about its centre."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from raytrace.image import Scene
from raytrace.measures.straight_lane import StraightLane
from raytrace.rays import Trace
from raytrace.scene.reference import Picture
from raytrace.viewing.pose import STRAIGHT, Pose

Array = NDArray[np.float64]

AIMED = 1e-12  # radians between where two mirrors' centres look


@dataclass(frozen=True, eq=False)
class MirrorPose:
    """A place of a turned mirror, p, stands in the scene at `centre` + R·(p − pivot), R = Ry(yaw)·Rx(−pitch).

    As a `Pose` turns it.

    A positive yaw turns the face towards +x, the driver's side, a positive pitch then upwards. Radians, mm.
    """

    yaw: float = 0.0
    pitch: float = 0.0
    pivot: tuple[float, float, float] = (0.0, 0.0, 0.0)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def nothing(self) -> bool:
        """Whether the mirror stands as its file has it."""
        return self.yaw == self.pitch == 0.0 and self.pivot == self.centre

    @property
    def rotation(self) -> Array:
        """R, (3, 3)."""
        result: Array = STRAIGHT.T @ Pose(np.zeros(3), np.zeros(3), self.yaw, self.pitch).rotation
        return result

    def to_scene(self, points: Array) -> Array:
        """Points (…, 3) of the mirror in the scene."""
        result: Array = self.centre + (points - self.pivot) @ self.rotation.T
        return result

    def to_mirror(self, points: Array) -> Array:
        """Points (…, 3) of the scene in the mirror's coordinates."""
        result: Array = self.pivot + (points - self.centre) @ self.rotation
        return result

    def seen_by(self, scene: Scene) -> Scene:
        """The scene for rays in the mirror's coordinates."""
        return scene if self.nothing else TurnedScene(scene, self)

    def lane(self, lane: StraightLane) -> StraightLane:
        """The lane for rays in the mirror's coordinates."""
        return lane if self.nothing else TurnedLane(lane.x0_mm, lane.y0_mm, lane.slope, lane.plane_z_mm, self)


@dataclass(frozen=True, eq=False)
class TurnedScene:
    """A scene as a turned mirror's rays meet it."""

    scene: Scene
    turn: MirrorPose

    def add_colours(self, trace: Trace, eye: Array, rays: Array, sums: Array, samples: int) -> None:
        """As `Scene`: everything is turned into the scene first."""
        turn, rotation = self.turn, self.turn.rotation
        turned = replace(trace, points=turn.to_scene(trace.points), directions=trace.directions @ rotation.T,
                         normals=trace.normals @ rotation.T)
        self.scene.add_colours(turned, turn.to_scene(eye), rays @ rotation.T, sums, samples)

    def to_display(self, means: Array) -> Picture:
        """As the scene has it."""
        return self.scene.to_display(means)


@dataclass(frozen=True, slots=True)
class TurnedLane(StraightLane):
    """A lane as a turned mirror's rays meet it."""

    turn: MirrorPose

    def above(self, points: Array, directions: Array) -> Array:
        """As `StraightLane`: everything is turned into the scene first."""
        lane = StraightLane(self.x0_mm, self.y0_mm, self.slope, self.plane_z_mm)
        return lane.above(self.turn.to_scene(points), directions @ self.turn.rotation.T)


def aimed(point: Array, normal: Array, place: Array, eye: Array, direction: Array) -> MirrorPose:
    """The turn that puts a mirror's `point` (3,) at `place`.

    With its `normal` there such that it sends the eye's ray into `direction`; all but point and normal in the scene.
    """
    ray = place - eye
    ray = ray / np.linalg.norm(ray)
    wanted = direction / np.linalg.norm(direction) - ray
    wanted /= np.linalg.norm(wanted)

    def off(angles: Array) -> Array:
        result: Array = MirrorPose(float(angles[0]), float(angles[1])).rotation @ normal - wanted
        return result

    found = least_squares(off, np.zeros(2), xtol=AIMED, ftol=AIMED, gtol=AIMED)
    at, to = (tuple(float(value) for value in array) for array in (point, place))
    return MirrorPose(float(found.x[0]), float(found.x[1]), at, to)  # type: ignore[arg-type]  # three numbers each
