"""Where the eye sits and what lies behind it, in the set-up of the paper."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.mirror import Mirror
from mirror_cad.spec import MirrorSpec
from raytrace.measures.in_use import MirrorInUse
from raytrace.measures.straight_lane import Lane, StraightLane
from raytrace.reflector import Reflector
from raytrace.scene.reference import Picture, ReferencePlane
from raytrace.viewing.eye import eye_position
from raytrace.viewing.pose import Pose
from raytrace.viewing.view import View

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ViewingSetup:
    """The eye (3,) mm, the z of the reference plane behind it, and the lane on that plane."""

    eye: Array
    plane_z_mm: float
    lane: StraightLane

    @staticmethod
    def of(spec: MirrorSpec, box: tuple[float, float, float, float]) -> ViewingSetup:
        """What [eye] and [scene] ask for, with the eye aligned to the box (x_min, x_max, y_min, y_max)."""
        eye = eye_position(spec.eye.distance_mm, spec.eye.aligned, box)
        plane_z_mm = float(eye[2]) + spec.scene.distance_mm
        lane = spec.scene.lane
        return ViewingSetup(eye, plane_z_mm, StraightLane(lane.x0_mm, lane.y0_mm, lane.slope, plane_z_mm))

    def in_use(self, reflector: Reflector, mirror: Mirror | None = None) -> MirrorInUse:
        """The mirror as measures see it; `mirror` : what it was designed as, where that is known."""
        view = View(reflector, Pose.identity(), self.eye)
        lane = Lane(self.lane.x0_mm, self.lane.y0_mm, self.lane.slope, self.plane_z_mm - float(self.eye[2]))
        if mirror is None:
            return MirrorInUse(view, lane)
        horizontal, vertical = (math.degrees(angle) for angle in mirror.section_fields_of_view())
        return MirrorInUse(view, lane, mirror.box, mirror.left_height_mm, (horizontal, vertical))

    def scene(self, picture: Picture, spec: MirrorSpec) -> ReferencePlane:
        """The picture on the plane, as wide and where [scene] has it."""
        scene = spec.scene
        return ReferencePlane.of_image(scene.image, picture, self.plane_z_mm, scene.width_mm, scene.centre_mm)
