"""A mirror in use: what measures are taken of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from raytrace.viewing.eye_views import EyeViews

if TYPE_CHECKING:
    from raytrace.measures.asked import Asked
    from raytrace.measures.straight_lane import Lane
    from raytrace.reflector import Reflector
    from raytrace.viewing.pose import Pose
    from raytrace.viewing.vehicle import Eyes, HostVehicle
    from raytrace.viewing.view import View

Box = tuple[float, float, float, float]
Record = TypeVar("Record")
MM_PER_M = 1e3


@dataclass(frozen=True, eq=False)
class OnVehicle:
    """A mirror as it is aimed on a vehicle, whose driver looks into it with two eyes.

    Parameters
    ----------
    reflector : what is looked into, in mirror coordinates.
    pose : where it is on the vehicle, and how it is turned.
    eyes : the ocular points.
    host : the vehicle that it is mounted on.
    asked : what the scene has measured.
    """

    reflector: Reflector
    pose: Pose
    eyes: Eyes
    host: HostVehicle
    asked: Asked

    @cached_property
    def views(self) -> EyeViews:
        """Seen by the left eye, from the middle between the eyes, and by the right eye."""
        return EyeViews.of(self.reflector, self.pose, self.eyes)


@dataclass(frozen=True, eq=False)
class MirrorInUse:
    """A mirror as measures see it.

    Parameters
    ----------
    setup : the mirror in its own coordinates, with the eye where its specification has it.
    lane : the paper's, on the plane behind that eye.
    outline_box : (x_min, x_max, y_min, y_max) of the outline itself, mm, where it is known better than by the reflector's rim.
    left_height_mm : of the mirror at its left edge, before rounding; that of the box, where it is not known.
    sections_deg : horizontal and left vertical field of view of the design's sections alone, where it was designed.
    vehicle : the mirror on its vehicle; None for what is looked at alone.
    """

    setup: View
    lane: Lane
    outline_box: Box | None = None
    left_height_mm: float | None = None
    sections_deg: tuple[float, float] | None = None
    vehicle: OnVehicle | None = None
    _records: dict[object, object] = field(default_factory=dict, repr=False)

    @property
    def box(self) -> Box:
        """(x_min, x_max, y_min, y_max) of what reflects, mm."""
        return self.setup.box if self.outline_box is None else self.outline_box

    def record(self, take: Callable[[MirrorInUse], Record]) -> Record:
        """Give what a function finds of this mirror, worked out once: several figures come from one record.

        Parameters
        ----------
        take : the function; it is what the record is kept by.

        Returns
        -------
        What `take(self)` returned the first time.
        """
        if take not in self._records:
            self._records[take] = take(self)
        return self._records[take]  # type: ignore[return-value]  # what `take` returned

    @property
    def on_vehicle(self) -> OnVehicle:
        """The mirror on its vehicle.

        Raises
        ------
        ValueError
            Where it is on none.
        """
        if self.vehicle is None:
            raise ValueError("this measure is one of a mirror on a vehicle")
        return self.vehicle


def finite(value: float | None) -> float | None:
    """The value as a float; None for None, an infinity and NaN, which JSON does not know."""
    return None if value is None or not np.isfinite(value) else float(value)


def metres(value_mm: float | None) -> float | None:
    """Millimetres as metres; None for None, an infinity and NaN."""
    return finite(None if value_mm is None else value_mm / MM_PER_M)
