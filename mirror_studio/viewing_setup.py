"""Where the eye sits and what lies behind it, in the set-up of the paper."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirror_cad.mirror import Mirror
from mirror_cad.spec import Eye, MirrorSpec, SceneSpec
from raytrace.measures.in_use import MirrorInUse, OnVehicle
from raytrace.measures.straight_lane import Lane, StraightLane
from raytrace.reflector import Reflector
from raytrace.scene.reference import Picture, ReferencePlane
from raytrace.viewing.eye import eye_position
from raytrace.viewing.pose import Pose
from raytrace.viewing.view import View

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ViewingSetup:
    """The eye (3,) mm, and the lane on the reference plane behind it."""

    eye: Array
    lane_behind_eye: Lane

    @staticmethod
    def of(spec: MirrorSpec | None, box: tuple[float, float, float, float]) -> ViewingSetup:
        """What [eye] and [scene] ask for, with the eye aligned to the box (x_min, x_max, y_min, y_max).

        Without a specification, what a specification has that does not say otherwise.
        """
        seat, scene = (Eye(), SceneSpec()) if spec is None else (spec.eye, spec.scene)
        lane = scene.lane
        return ViewingSetup(eye_position(seat.distance_mm, seat.aligned, box),
                            Lane(lane.x0_mm, lane.y0_mm, lane.slope, scene.distance_mm))

    @property
    def plane_z_mm(self) -> float:
        """The z of the reference plane."""
        return self.lane.plane_z_mm

    @property
    def lane(self) -> StraightLane:
        """The lane on that plane."""
        return self.lane_behind_eye.before(self.eye)

    def in_use(self, reflector: Reflector, mirror: Mirror | None = None, vehicle: OnVehicle | None = None) -> MirrorInUse:
        """The mirror as measures see it; `mirror` : what it was designed as, where that is known.

        On a vehicle its box is that of the rim, as it is of every mirror that is driven beside it.
        """
        use = MirrorInUse(View(reflector, Pose.identity(), self.eye), self.lane_behind_eye, vehicle=vehicle)
        if mirror is None:
            return use
        horizontal, vertical = (math.degrees(angle) for angle in mirror.section_fields_of_view())
        return replace(use, outline_box=mirror.box if vehicle is None else None, left_height_mm=mirror.left_height_mm,
                       sections_deg=(horizontal, vertical))

    def scene(self, picture: Picture, spec: MirrorSpec) -> ReferencePlane:
        """The picture on the plane, as wide and where [scene] has it."""
        scene = spec.scene
        return ReferencePlane.of_image(scene.image, picture, self.plane_z_mm, scene.width_mm, scene.centre_mm)
