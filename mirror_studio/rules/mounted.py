"""A mirror's shape on a vehicle and how far apart eyes are in, what the driver sees of the ground that rules ask for out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

from mirror_studio.rules.ground import OBSTRUCTED_OVER_MM, MissingGround, RequiredGround, hidden_share, missing_ground
from mirror_studio.rules.obstruction import VehicleBody, obstructed_share
from mirror_studio.rules.schema import FieldSection
from mirror_studio.rules.shape import MirrorShape
from raytrace.errors import TraceError
from raytrace.measures.eye_fields import extent, eye_fields
from raytrace.measures.ghost import Ghost, ghost
from raytrace.measures.ground import side_of
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.pose import Pose
from raytrace.viewing.vehicle import Eyes, HostVehicle
from raytrace.visibility.orientation import orientation

BOX_ALONE = VehicleBody()


@dataclass(frozen=True, eq=False)
class Mounted:
    """A mirror on a vehicle whose driver looks into it."""

    pose: Pose
    eyes: Eyes
    host: HostVehicle
    body: VehicleBody = BOX_ALONE

    @property
    def on_drivers_side(self) -> bool:
        """Whether the mirror is on the side of the median plane where the eyes are."""
        return (self.eyes.middle[1] < 0.0) == (self.pose.hand == "left")


@dataclass(frozen=True, eq=False)
class MountedViews:
    """What a mirror on a vehicle shows two eyes.

    Attributes
    ----------
    shape
        What is looked into.
    mounted
        Where it is, and who looks.
    eye_separation_mm
        As the rule has it.
    """

    shape: MirrorShape
    mounted: Mounted
    eye_separation_mm: float

    @cached_property
    def main(self) -> MountedViews:
        """Of the main part alone."""
        return self if self.shape.main is self.shape else replace(self, shape=self.shape.main)

    @cached_property
    def views(self) -> EyeViews:
        """Seen by both eyes, as far apart as the rule has them.

        Raises
        ------
        TraceError
            For an eye that the mirror does not face.
        """
        there = self.mounted
        return EyeViews.of(self.shape.reflector, there.pose, Eyes(there.eyes.middle, self.eye_separation_mm))

    @cached_property
    def shows_twice(self) -> bool:
        """Whether some things are seen twice: then no field is bounded by the mirror's edge."""
        return orientation(self.views.middle).twice

    def required(self, asked: FieldSection) -> RequiredGround:
        """A field on this vehicle."""
        return RequiredGround.of(asked, self.mounted.host, side_of(self.views.middle))

    def missing(self, asked: FieldSection) -> MissingGround:
        """What of a field is not seen."""
        if asked not in self._fields:
            self._fields[asked] = missing_ground(self.views.left, self.views.right, self.required(asked))
        return self._fields[asked]

    def obstructed_percent(self, asked: FieldSection, upright: bool = False) -> float:
        """How much of a field the vehicle's body hides: exactly where that is a box, else on a grid.

        upright : whether areas are those of the field projected on an upright plane across the road.
        """
        there, at = self.mounted, (asked, upright)
        if at not in self._hidden:
            ground = self.required(asked)
            if there.body.plain and not upright:
                self._hidden[at] = hidden_share(self.views.left, self.views.right, ground, there.host)
            else:
                self._hidden[at] = obstructed_share(self.views.left, self.views.right, ground, there.host, there.body, upright,
                                                    OBSTRUCTED_OVER_MM)
        return 100.0 * self._hidden[at]

    @cached_property
    def _fields(self) -> dict[FieldSection, MissingGround]:
        return {}

    @cached_property
    def _hidden(self) -> dict[tuple[FieldSection, bool], float]:
        return {}

    @property
    def angle_deg(self) -> float:
        """Between the median plane and the upright plane through the mirror's centre and the middle between the eyes."""
        to_mirror = self.mounted.pose.to_vehicle(self.shape.centre_point) - self.mounted.eyes.middle
        return math.degrees(math.atan2(abs(to_mirror[1]), abs(to_mirror[0])))

    @property
    def height_m(self) -> float:
        """Of the mirror's lowest point above the ground."""
        return 1e-3 * float(self.mounted.pose.to_vehicle(self.shape.reflector.outline())[:, 2].min())

    @property
    def horizon_deg(self) -> float:
        """What either eye sees of the horizon."""
        return extent(eye_fields(self.views).horizon.either)

    @cached_property
    def ghost(self) -> Ghost | None:
        """Its reflection beside the image, for an eye between the driver's two; None of glass whose front is no B-spline."""
        plate = self.shape.reflector.surface.glass
        try:
            return ghost(plate.untrimmed(), self.views.middle.eye_in_mirror, self.shape.grid[:, 0], self.shape.grid[:, 1])
        except TraceError:
            return None
