"""Read a scene, a name or a TOML file in metres: who looks into which mirror of which vehicle, on what road."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from mirror_cad.eyes import EYE_SEPARATION_MM
from mirror_cad.keys import AsTuple, Number, Section
from mirror_cad.spec.file import names_in, read_toml, validated

DEFAULT = "motorway"
MAX_OBJECTS = 2_000  # with their repetitions: a street of them, and still some seconds to build

Metres = Annotated[Number, Field(ge=-1e4, le=1e4)]
Size = Annotated[Number, Field(gt=0, le=1e4)]
Share = Annotated[Number, Field(ge=0, le=1)]
Degrees = Annotated[Number, Field(ge=-360, le=360)]
Colour = Annotated[str, AfterValidator(lambda value: _colour(value))]
Unit = Literal["mm", "cm", "m", "inch", "foot"]


def _colour(value: str) -> str:
    if not re.fullmatch("#[0-9a-fA-F]{6}", value):
        raise ValueError("must be a colour #rrggbb, two hexadecimal digits each for red, green and blue")
    return value


class Listed(Section):
    """A section whose TOML lists become the tuples that a frozen record holds."""

    @field_validator("*", mode="before")
    @classmethod
    def _tuples(cls, value: Any) -> Any:
        return tuple(value) if isinstance(value, list) else value


class EyesSection(Listed):
    """The driver's ocular points, X rearward, Y right, Z up from the ground, X = 0 at themselves."""

    middle_m: tuple[Metres, Metres, Metres] = (0.0, -0.49, 1.9)
    separation_m: Annotated[Number, Field(ge=0, le=0.2)] = EYE_SEPARATION_MM / 1000.0


class MirrorSection(Listed):
    """Where the mirror is: `centre_m` the centre of its surface while it is not turned, `pivot_m` in mirror coordinates.

    An inside mirror is "left" where it is to the driver's left; it needs both angles.
    """

    hand: Literal["left", "right"] = "left"
    centre_m: tuple[Metres, Metres, Metres] = (-0.54, -1.01, 1.76)
    pivot_m: tuple[Metres, Metres, Metres] = (0.0, 0.0, -0.04)
    yaw_deg: Annotated[Number, Field(ge=-80, le=80)] | None = None
    pitch_deg: Annotated[Number, Field(ge=-80, le=80)] | None = None
    bezel_over_m: Annotated[Number, Field(ge=0, le=0.1)] = 0.0
    reflectance: Share = 0.87
    inside: bool = False

    @model_validator(mode="after")
    def _both_angles(self) -> MirrorSection:
        if (self.yaw_deg is None) != (self.pitch_deg is None):
            raise ValueError("yaw_deg and pitch_deg belong together: give both, or neither and [aim]")
        if self.inside and self.yaw_deg is None:
            raise ValueError("inside = true needs yaw_deg and pitch_deg: no flank is seen in an inside mirror to aim it by")
        return self


class AimSection(Section):
    """What yaw and pitch are solved for, as seen from the middle between the eyes."""

    flank_share: Share = 0.12
    horizon_share: Share = 0.6


class PieceSection(Listed):
    """A flat piece of the driver's vehicle: three corners or more, [X, Y, Z] in metres, in order round it."""

    name: Annotated[str, Field(min_length=1, max_length=60)]
    corners_m: tuple[Annotated[tuple[Metres, Metres, Metres], AsTuple], ...]

    @model_validator(mode="after")
    def _flat(self) -> PieceSection:
        if len(self.corners_m) < 3:
            raise ValueError(f"{self.name!r} has {len(self.corners_m)} corners: a flat piece has three or more")
        return self


class OwnVehicleSection(Listed):
    """The host vehicle: a box that hides what is behind it, and how its flank looks, from front_m on.

    opaque : pillars and headrests that hide behind them, window : what alone lets rays out of the box; for rules of the road.
    Body "none" has no looks. A door mirror of the body's own where the mirror is mounted is left out, unless keep_mirror is
    true.
    """

    width_m: Size = 1.74
    front_m: Metres = -0.2
    rear_m: Metres = 3.9
    height_m: Size = 2.45
    body: str = "light-truck-flank"
    paint: Colour | None = None
    keep_mirror: bool = False
    opaque: tuple[PieceSection, ...] = ()
    window: tuple[PieceSection, ...] = ()


class LoadSection(Section):
    """A load that lowers the driver's vehicle at its front and its rear; for rules of the road."""

    name: Annotated[str, Field(min_length=1, max_length=60)]
    front_m: Annotated[Number, Field(ge=-1, le=1)]
    rear_m: Annotated[Number, Field(ge=-1, le=1)]


class LineSection(Section):
    """A line painted along the road, about Y = y_m."""

    y_m: Metres
    width_m: Annotated[Number, Field(gt=0, le=2)] = 0.15
    colour: Literal["white", "yellow"] = "white"
    dash_m: Size | None = None
    period_m: Size | None = None

    @model_validator(mode="after")
    def _dashes(self) -> LineSection:
        if (self.dash_m is None) != (self.period_m is None):
            raise ValueError("dash_m and period_m belong together: a line without them is solid")
        if self.dash_m is not None and self.period_m is not None and self.dash_m >= self.period_m:
            raise ValueError(f"dash_m = {self.dash_m:g} must be shorter than period_m = {self.period_m:g}")
        return self


class RoadSection(Listed):
    """Asphalt from y = left_m to right_m, along X without end, with its lines; grass beside it."""

    left_m: Metres = -9.5
    right_m: Metres = 3.0
    line: tuple[LineSection, ...] = ()

    @model_validator(mode="after")
    def _in_order(self) -> RoadSection:
        if self.left_m >= self.right_m:
            raise ValueError(f"left_m = {self.left_m:g} must lie below right_m = {self.right_m:g}: Y points to the right")
        return self


class BodySection(Section):
    """A body on the ground: one of the package's, or a glTF, OBJ, STL, PLY, OFF or 3MF file beside the scene.

    Its numbers are mm, or `unit`, with `up` upwards (glTF: metres and y by its standard).
    """

    body: str
    x_m: Metres
    y_m: Metres
    z_m: Metres = 0.0
    heading_deg: Degrees = 0.0
    unit: Unit | None = None
    up: Literal["z", "y"] = "z"


class VehicleSection(BodySection):
    """Another vehicle; x_m is where its front is, heading 0 the driver's own."""

    name: Annotated[str, Field(min_length=1, max_length=60)]
    paint: Colour | None = None


class ObjectSection(BodySection):
    """What else stands there, once or `count` times every `every_m` along X."""

    name: str | None = None
    count: Annotated[int, Field(ge=1, le=1000)] = 1
    every_m: Size = 4.0


class LightSection(Section):
    """The sun: azimuth from straight ahead to the right, elevation above the horizon; the air's turbidity; the exposure."""

    azimuth_deg: Degrees = -35.0
    elevation_deg: Annotated[Number, Field(ge=5, le=90)] = 42.0
    turbidity: Annotated[Number, Field(ge=2, le=6)] = 2.2
    exposure_ev: Annotated[Number, Field(ge=-10, le=10)] = 0.5


class MeasuredSection(Listed):
    """What the measures are of."""

    lane_m: tuple[Metres, Metres] = (-5.25, -1.75)
    line_y_m: Metres = -1.75
    vehicle: str | None = None
    distances_m: tuple[Size, ...] = (20.0, 50.0)
    column: str | None = None
    widths_at_m: tuple[Size, ...] = (4.0, 10.0, 20.0, 30.0)
    direct_view_deg: Annotated[Number, Field(gt=0, lt=180)] = 95.0
    hidden_height_m: Annotated[Number, Field(ge=0, le=10)] = 0.8

    @model_validator(mode="after")
    def _rising(self) -> MeasuredSection:
        if self.lane_m[0] >= self.lane_m[1]:
            raise ValueError(f"lane_m = [{self.lane_m[0]:g}, {self.lane_m[1]:g}] must rise")
        return self


class SceneFile(Listed):
    """One scene, frozen. Metres and degrees; X rearward, Y right, Z up.

    X = 0 at the ocular points, Y = 0 the median plane of the driver's vehicle, Z = 0 the ground.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
    eyes: EyesSection = EyesSection()
    mirror: MirrorSection = MirrorSection()
    aim: AimSection | None = None
    own_vehicle: OwnVehicleSection = OwnVehicleSection()
    load: tuple[LoadSection, ...] = ()
    road: RoadSection | None = None
    vehicle: tuple[VehicleSection, ...] = ()
    object: tuple[ObjectSection, ...] = ()
    light: LightSection = LightSection()
    measured: MeasuredSection = MeasuredSection()

    @field_validator("own_vehicle", "vehicle", "object", mode="after")
    @classmethod
    def _beside_the_scene(cls, given: Any, info: ValidationInfo) -> Any:
        """File names are relative to the scene's folder; here they become paths."""
        folder = Path((info.context or {}).get("folder", "."))

        def placed(section: Any) -> Any:
            name = section.body
            return section if "." not in name else section.model_copy(update={"body": str(folder / name)})

        return tuple(placed(section) for section in given) if isinstance(given, tuple) else placed(given)

    @model_validator(mode="after")
    def _consistent(self) -> SceneFile:
        faults = []
        if self.aim is not None and self.mirror.yaw_deg is not None:
            faults.append("[aim] and mirror.yaw_deg, pitch_deg cannot both be given: the aim is what solves them")
        count = len(self.vehicle) + sum(each.count for each in self.object)
        if count > MAX_OBJECTS:
            faults.append(f"{count} bodies are too many (at most {MAX_OBJECTS})")
        names = [each.name for each in self.vehicle]
        every = names + [each.name for each in self.object if each.name]
        twice = sorted({name for name in every if every.count(name) > 1})
        if twice:
            faults.append(f"two things are called {twice[0]!r}: each vehicle and object needs a name of its own")
        faults += [f"object {each.name!r} stands there {each.count} times: only one that stands alone can have a name"
                   for each in self.object if each.name and each.count > 1]
        faults += self._impossible()
        for key, named in (("vehicle", names), ("column", [each.name for each in self.object if each.name])):
            asked = getattr(self.measured, key)
            if asked is not None and asked not in named:
                faults.append(f"measured.{key} = {asked!r}: the scene has no {'vehicle' if key == 'vehicle' else 'object'} of "
                              f"this name; there is {', '.join(map(repr, named)) or 'none'}")
        if faults:
            raise ValueError("; ".join(faults))
        return self


    def _impossible(self) -> list[str]:
        """What no vehicle on a road can be."""
        mirror, own, side = self.mirror, self.own_vehicle, -1.0 if self.mirror.hand == "left" else 1.0
        where, lane = mirror.centre_m, self.measured.lane_m
        faults = [f"{key} = {value:g} m is not above the ground" for key, value in (
            ("eyes.middle_m, Z", self.eyes.middle_m[2]), ("mirror.centre_m, Z", where[2])) if value <= 0.0]
        if own.front_m >= own.rear_m:
            faults.append(f"own_vehicle.front_m = {own.front_m:g} must lie before rear_m = {own.rear_m:g}: X points rearward")
        if mirror.inside:
            return faults
        if side * where[1] <= 0.0:
            faults.append(f"mirror.centre_m has Y = {where[1]:g} m, which is not on the {mirror.hand} (Y points to the right): "
                          "turn its sign, and those of measured.lane_m and line_y_m")
        elif side * where[1] <= 0.5 * own.width_m and own.front_m < where[0] < own.rear_m:
            faults.append(f"mirror.centre_m = [{where[0]:g}, {where[1]:g}, {where[2]:g}] is inside the vehicle, which is "
                          f"{own.width_m:g} m wide from X = {own.front_m:g} to {own.rear_m:g} m")
        elif side * (lane[0] + lane[1]) <= 0.0:
            faults.append(f"measured.lane_m = [{lane[0]:g}, {lane[1]:g}] is not beside the vehicle on the mirror's side, the "
                          f"{mirror.hand}: Y points to the right")
        return faults


def scene_names() -> list[str]:
    """The names of the scenes that come with the package."""
    return names_in(_scenes())


def load_scene(name_or_path: str | Path) -> SceneFile:
    """Read a scene: the name of one of the package's, or a TOML file.

    Raises: SpecError with one fault for each unknown, missing, ill-typed or impossible key.
    """
    raw, source, folder = read_toml(name_or_path, _scenes(), "scene")
    raw.setdefault("name", Path(name_or_path).stem)
    return validated(SceneFile, raw, source, folder)


def _scenes() -> Any:
    return resources.files("mirror_studio") / "scenes"
