"""The lit world around the vehicle, the eyes and the vehicle itself, in mm."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import MirrorError
from mirror_cad.mesh import SurfaceMesh
from mirror_studio.scene_file import BodySection, SceneFile
from raytrace.errors import SceneError
from raytrace.scene.bodies import Body, body_of, read_body
from raytrace.scene.daylight import Daylight
from raytrace.scene.door_mirror import LeftOut, without_door_mirror
from raytrace.scene.materials import Colour, Material, linear
from raytrace.scene.road import LaneLine, Road
from raytrace.viewing.pose import Pose
from raytrace.viewing.vehicle import Eyes, HostVehicle

Array = NDArray[np.float64]

MM = 1000.0
HOUSING = Material("housing", diffuse=(0.018, 0.018, 0.02), roughness=0.45)


def eyes_of(scene: SceneFile) -> Eyes:
    """The driver's ocular points."""
    return Eyes(MM * np.array(scene.eyes.middle_m), MM * scene.eyes.separation_m)


def host_vehicle_of(scene: SceneFile) -> HostVehicle:
    """The box of the driver's vehicle."""
    own = scene.own_vehicle
    return HostVehicle(0.5 * MM * own.width_m, MM * own.front_m, MM * own.rear_m, MM * own.height_m)


def pose_of(scene: SceneFile) -> Pose:
    """Where the mirror is, with the scene's yaw and pitch, or straight where it is aimed.

    The scene's place of a right-hand mirror is its own, not that of the left one it is the reflection of.
    """
    mirror = scene.mirror
    side = np.array([1.0, -1.0 if mirror.hand == "right" else 1.0, 1.0])
    return Pose(MM * np.array(mirror.centre_m) * side, MM * np.array(mirror.pivot_m),
                np.radians(mirror.yaw_deg or 0.0), np.radians(mirror.pitch_deg or 0.0), mirror.hand)


def bodies_of(scene: SceneFile) -> tuple[tuple[str, Body], ...]:
    """All that stands on the ground, the host vehicle first; each with its name, "" for what has none.

    Raises: SceneError for a body that cannot be had, with its place in the scene.
    """
    return bodies_and_left_out(scene)[0]


def bodies_and_left_out(scene: SceneFile) -> tuple[tuple[tuple[str, Body], ...], LeftOut | None]:
    """The same, and what of the host vehicle is left out because the mirror is mounted there.

    Raises: SceneError for a body that cannot be had, with its place in the scene.
    """
    known: dict[tuple[str, str | None, str], Body] = {}

    def body(name: str, unit: str | None = None, up: Any = "z") -> Body:
        if (name, unit, up) not in known:
            known[name, unit, up] = read_body(_path(name), unit, up)
        return known[name, unit, up]

    def painted(made: Body, paint: str | None) -> Body:
        return made if paint is None else made.painted(_colour(paint))

    found, where = [], "own_vehicle"
    left_out: LeftOut | None = None
    try:
        if scene.own_vehicle.body != "none":
            own = body(scene.own_vehicle.body).placed(MM * np.array([scene.own_vehicle.front_m, 0.0, 0.0]))
            if not scene.own_vehicle.keep_mirror:
                own, left_out = without_door_mirror(own, MM * np.array(scene.mirror.centre_m))
            found.append(("", painted(own, scene.own_vehicle.paint)))
        for vehicle in scene.vehicle:
            where = f"vehicle {vehicle.name!r}"
            made = painted(body(vehicle.body, vehicle.unit, vehicle.up), vehicle.paint)
            found.append((vehicle.name, _placed(made, vehicle)))
        for number, thing in enumerate(scene.object):
            where = f"object {thing.name!r}" if thing.name else f"object.{number}"
            made = body(thing.body, thing.unit, thing.up)
            found += [(thing.name or "", _placed(made, thing, k * thing.every_m)) for k in range(thing.count)]
    except MirrorError as error:
        raise SceneError(f"{scene.name}: {where}: {error}") from None
    return tuple(found), left_out


def road_of(scene: SceneFile) -> Road | None:
    """The road with its lines."""
    if scene.road is None:
        return None
    lines = tuple(LaneLine(MM * line.y_m, MM * line.width_m, line.colour)
                  if line.dash_m is None or line.period_m is None else
                  LaneLine(MM * line.y_m, MM * line.width_m, line.colour, MM * line.dash_m, MM * line.period_m)
                  for line in scene.road.line)
    return Road(MM * scene.road.left_m, MM * scene.road.right_m, lines)


def daylight_of(scene: SceneFile) -> Daylight:
    """The scene's sun, sky and exposure."""
    light = scene.light
    return Daylight.clear(light.azimuth_deg, light.elevation_deg, light.turbidity, light.exposure_ev)


def housing_body(shell: SurfaceMesh, pose: Pose) -> Body:
    """A mirror's housing in the world."""
    faces = shell.faces if pose.hand == "left" else shell.faces[:, ::-1]  # a reflection turns them inside out
    return body_of(pose.to_vehicle(shell.vertices), faces, HOUSING)


def _placed(body: Body, section: BodySection, further_m: float = 0.0) -> Body:
    return body.placed(MM * np.array([section.x_m + further_m, section.y_m, section.z_m]), section.heading_deg)


def _path(name: str) -> Path:
    """A file as it is named, or the package's body of that name."""
    if "." in name:
        return Path(name)
    assets = resources.files("raytrace") / "scene" / "assets"
    path = Path(str(assets / f"{name}.glb"))
    if not path.is_file():
        own = sorted(entry.name.removesuffix(".glb") for entry in assets.iterdir() if entry.name.endswith(".glb"))
        raise SceneError(f"body = {name!r}: no such body; the package has {', '.join(own) or 'none'}, and a file is named with "
                         "its ending")
    return path


def _colour(text: str) -> Colour:
    red, green, blue = linear(np.array([int(text[k:k + 2], 16) for k in (1, 3, 5)])).tolist()
    return red, green, blue
