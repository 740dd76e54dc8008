"""A mirror turned within its adjustment, or on a vehicle that a load has lowered: what of a field is seen then."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product

import numpy as np

from mirror_cad.errors import SpecError
from mirror_studio.json_types import Json
from mirror_studio.rules.ground import field_margin, missing_ground
from mirror_studio.rules.measuring import RuleQuantities
from mirror_studio.rules.mounted import Mounted
from mirror_studio.rules.schema import FieldSection
from mirror_studio.rules.verdicts import applying, part_of
from raytrace.errors import TraceError
from raytrace.viewing.pose import TiltedPose
from raytrace.viewing.vehicle import Eyes, HostVehicle

MAX_DEG = 20.0  # that a mirror is turned by in its housing
GRID = 7  # settings a direction that are tried first
FINEST_DEG = 0.005  # step of the search from the best of these
ROUNDS = 4  # of going to the middle of yaw's range and of pitch's
ENDS_DEG = 0.01  # to which the ends of the range are looked for


@dataclass(frozen=True, slots=True)
class Adjustment:
    """The middle of the settings at which a mirror shows all fields of a class, and how far a driver may be off it.

    Attributes
    ----------
    within_deg
        Of the scene's own setting, yaw and pitch were looked at.
    yaw_deg, pitch_deg
        Of that middle beside the scene's; yaw turns the face towards the vehicle, pitch upwards.
    margin_m
        Least margin of the fields there, as the lines have it.
    yaw_range_deg, pitch_range_deg
        About the scene's, through the middle, over which all is seen; None where no setting shows all.
    """

    within_deg: float
    yaw_deg: float
    pitch_deg: float
    margin_m: float
    yaw_range_deg: tuple[float, float] | None
    pitch_range_deg: tuple[float, float] | None

    def as_json(self) -> dict[str, Json]:
        """As rules.json holds it."""
        return asdict(self)

    @property
    def words(self) -> str:
        """For the sheet."""
        at = (f"{self.yaw_deg:+.2f}° of yaw and {self.pitch_deg:+.2f}° of pitch from the scene's, where the least margin is "
              f"{self.margin_m:+.3f} m; the lines are those of this setting")
        if self.yaw_range_deg is None or self.pitch_range_deg is None:
            said = f"within ±{self.within_deg:g}° no setting shows all; the one that misses least is {at}"
        else:
            (a, b), (c, d) = self.yaw_range_deg, self.pitch_range_deg
            said = (f"within ±{self.within_deg:g}° all is seen from {a:+.2f} to {b:+.2f}° of yaw and from {c:+.2f} to "
                    f"{d:+.2f}° of pitch; in the middle, {at}")
        return said.replace("-", "−")


def adjusted(m: RuleQuantities, class_name: str, within_deg: float) -> tuple[RuleQuantities, Adjustment]:
    """Turn a mirror to the middle of the settings at which it shows all fields of a class.

    One such setting is looked for on a grid about the scene's own, and then in ever smaller steps; from there yaw and pitch go
    to the middle of their ranges in turn. Where there is none, it is the one that misses least.

    Parameters
    ----------
    m : RuleQuantities
        On its vehicle.
    class_name : str
        Whose fields.
    within_deg : float
        Largest change of yaw and of pitch.

    Returns
    -------
    RuleQuantities, Adjustment
        The mirror at the best setting, and what that is.

    Raises
    ------
    SpecError
        For a range that is none, a mirror on no vehicle, and a class without fields.
    """
    check_adjustment(within_deg, m.seen is not None)
    fields = [line.field for line in applying(m, class_name) if line.quantity == "field_missing_m2" and line.field is not None]
    if not fields:
        raise SpecError(f"--adjust-deg: class {class_name} of {m.rule.rule} asks for no field of vision")
    known: dict[tuple[float, float], float] = {}

    def margin(yaw: float, pitch: float) -> float:
        at = (round(yaw, 9), round(pitch, 9))
        if at not in known:
            known[at] = _margin(turned_by(m, *at), fields)
        return known[at]

    steps: list[float] = np.linspace(-within_deg, within_deg, GRID).tolist()
    yaw, pitch = max(product(steps, steps), key=lambda at: (margin(*at), -abs(at[0]) - abs(at[1])))
    step = (steps[1] - steps[0]) / 2.0
    while step > FINEST_DEG and margin(yaw, pitch) < 0.0:
        around = [(yaw + a * step, pitch + b * step) for a, b in product((-1, 0, 1), (-1, 0, 1))]
        best = max((at for at in around if max(map(abs, at)) <= within_deg + 1e-9), key=lambda at: margin(*at))
        if margin(*best) > margin(yaw, pitch):
            yaw, pitch = best
        else:
            step *= 0.5
    ranges = None
    for _ in range(ROUNDS if margin(yaw, pitch) >= 0.0 else 0):
        before = yaw, pitch
        across = _range(lambda t, pitch=pitch: margin(t, pitch), yaw, within_deg)  # type: ignore[misc]
        yaw = 0.5 * sum(across)
        upward = _range(lambda t, yaw=yaw: margin(yaw, t), pitch, within_deg)  # type: ignore[misc]
        pitch, ranges = 0.5 * sum(upward), (across, upward)
        if max(abs(yaw - before[0]), abs(pitch - before[1])) < ENDS_DEG:
            break
    found = Adjustment(within_deg, yaw, pitch, margin(yaw, pitch) / 1e3, *(ranges or (None, None)))
    return turned_by(m, float(yaw), float(pitch)), found


def check_adjustment(within_deg: float, on_vehicle: bool) -> None:
    """Refuse an adjustment that there cannot be.

    Raises
    ------
    SpecError
        For a range that is none, and for a mirror on no vehicle.
    """
    if not 0.0 < within_deg <= MAX_DEG:
        raise SpecError(f"--adjust-deg {within_deg:g}: must be above 0 and at most {MAX_DEG:g}")
    if not on_vehicle:
        raise SpecError("--adjust-deg needs --vehicle: fields of vision are those of a mirror on one")


def turned_by(m: RuleQuantities, yaw_deg: float, pitch_deg: float) -> RuleQuantities:
    """The mirror with its yaw and pitch changed."""
    there = m.on_vehicle.mounted
    pose = replace(there.pose, yaw=there.pose.yaw + math.radians(yaw_deg), pitch=there.pose.pitch + math.radians(pitch_deg))
    return m.mounted_as(replace(there, pose=pose))


def _margin(m: RuleQuantities, fields: Sequence[FieldSection]) -> float:
    """The least margin of fields, mm; −inf where an eye does not see the mirror."""
    seen = part_of(m, "field_missing_m2").on_vehicle
    try:
        return min(field_margin(seen.views.left, seen.views.right, seen.required(each)) for each in fields)
    except TraceError:
        return -math.inf


def _range(margin: Callable[[float], float], middle: float, within: float) -> tuple[float, float]:
    """How far to either side of a setting that shows all it still does, to ENDS_DEG."""
    ends = []
    for end in (-within, within):
        good, bad = middle, end
        if margin(end) >= 0.0:
            ends.append(float(end))
            continue
        while abs(bad - good) > ENDS_DEG:
            half = 0.5 * (good + bad)
            good, bad = (half, bad) if margin(half) >= 0.0 else (good, half)
        ends.append(float(good))
    return ends[0], ends[1]


# --- loads ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Load:
    """A state in which the vehicle's body is lower than the scene has it, mm, at its front and at its rear."""

    name: str
    front_mm: float
    rear_mm: float


@dataclass(frozen=True, slots=True)
class LoadedField:
    """What of a field is seen under a load: missing ground, m², its end on the horizon, and the least margin, m."""

    load: str
    missing_m2: float
    seen_to_the_horizon: bool | None
    least_margin_m: float

    @property
    def words(self) -> str:
        """For a note."""
        far = "" if self.seen_to_the_horizon is not False else ", its end on the horizon is not seen"
        said = f"{self.load}: {self.missing_m2:.2f} m² missing{far}, least margin {self.least_margin_m:+.3f} m"
        return said.replace("-", "−")


def lowered(there: Mounted, load: Load) -> Mounted:
    """A mirror, its driver and the vehicle's box as a load lowers and tilts them.

    The box stays upright: a lowered roof is all that it knows of a load.
    """
    host = there.host
    slope = (load.rear_mm - load.front_mm) / (host.rear_mm - host.front_mm)
    tilt, sink = math.asin(slope), load.front_mm - slope * host.front_mm  # at X = 0
    pose = TiltedPose.of(there.pose, tilt, sink)
    height = host.height_mm - 0.5 * (load.front_mm + load.rear_mm)
    return replace(there, pose=pose, eyes=Eyes(pose.tilted(there.eyes.middle), there.eyes.separation_mm),
                   host=HostVehicle(host.half_width_mm, host.front_mm, host.rear_mm, height))


def under_load(m: RuleQuantities, asked: FieldSection, load: Load) -> LoadedField:
    """What of a field the mirror shows under a load, as it was set without it."""
    seen = part_of(m.mounted_as(lowered(m.on_vehicle.mounted, load)), "field_missing_m2").on_vehicle
    found = missing_ground(seen.views.left, seen.views.right, seen.required(asked))
    return LoadedField(load.name, found.missing_m2, found.horizon, found.margin_m)
