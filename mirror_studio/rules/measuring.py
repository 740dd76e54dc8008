"""A rule and a mirror, alone or on a vehicle, in; the quantities that the rule asks for, each worked out once, out.

Each record holds what it is made of, so that what is worked out in it is right for as long as it lives: the shape hangs on
neither rule nor instrument, the readings on the spherometer, what is seen on the eyes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from mirror_studio.rules.mounted import Mounted, MountedViews
from mirror_studio.rules.radii import Radii
from mirror_studio.rules.readings import SpherometerReadings
from mirror_studio.rules.schema import RuleFile
from mirror_studio.rules.shape import MirrorShape
from raytrace.reflector import Reflector


@dataclass(frozen=True, slots=True)
class StatedProperties:
    """What the shape of a mirror does not tell, None where nobody says it.

    Attributes
    ----------
    reflectance_percent, reflectance_night_percent
        As its maker measured them.
    transition_mm
        x of the upright line beyond which, outboard, the aspheric part lies, in mirror coordinates.
    """

    reflectance_percent: float | None = None
    reflectance_night_percent: float | None = None
    transition_mm: float | None = None


NOTHING_STATED = StatedProperties()


@dataclass(frozen=True, slots=True, eq=False)
class RuleQuantities:
    """What a rule asks of one mirror.

    Attributes
    ----------
    rule
        Which asks.
    readings
        Of the spherometer, with the shape that it stands on.
    seen
        What the driver sees; None for a mirror on no vehicle.
    stated
        What the shape does not tell.
    """

    rule: RuleFile
    readings: SpherometerReadings
    seen: MountedViews | None
    stated: StatedProperties

    @classmethod
    def of(cls, reflector: Reflector, rule: RuleFile, leg_mm: float, mounted: Mounted | None = None,
           stated: StatedProperties = NOTHING_STATED) -> RuleQuantities:
        """Of what reflects, in mirror coordinates, with the outer feet of the spherometer leg_mm apart."""
        alone = cls(rule, SpherometerReadings(MirrorShape(reflector, stated.transition_mm), leg_mm), None, stated)
        return alone if mounted is None else alone.mounted_as(mounted)

    def mounted_as(self, mounted: Mounted) -> RuleQuantities:
        """The same mirror on a vehicle."""
        return replace(self, seen=MountedViews(self.shape, mounted, self.rule.eyes.separation_mm))

    def by_rule(self, rule: RuleFile) -> RuleQuantities:
        """The same mirror by another rule; what is seen is kept where that has the eyes as far apart."""
        other = replace(self, rule=rule)
        if self.seen is None or self.seen.eye_separation_mm == rule.eyes.separation_mm:
            return other
        return other.mounted_as(self.seen.mounted)

    @property
    def shape(self) -> MirrorShape:
        """What does not hang on the rule."""
        return self.readings.shape

    @property
    def main(self) -> RuleQuantities:
        """Of the main part alone: itself, where nothing parts it from an aspheric one."""
        if self.shape.main is self.shape:
            return self
        return replace(self, readings=self.readings.main, seen=None if self.seen is None else self.seen.main)

    @property
    def radii(self) -> Radii:
        """The readings that the rule asks for."""
        return self.readings.at_three_points if self.rule.readings == "annex 7" else self.readings.at_five_places

    @property
    def on_vehicle(self) -> MountedViews:
        """What the mirror shows on its vehicle.

        Raises
        ------
        ValueError
            Where it is on none.
        """
        if self.seen is None:
            raise ValueError("this quantity is one of a mirror on a vehicle")
        return self.seen
