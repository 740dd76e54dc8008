"""Draw what each of the driver's eyes sees in a mirror on the vehicle, in the lit world."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mirror_studio.drive.mirrors import DrivenMirror
from mirror_studio.drive.world import bodies_and_left_out, daylight_of, housing_body, road_of
from mirror_studio.scene_file import SceneFile
from raytrace.image import photograph
from raytrace.scene.bodies import Body
from raytrace.scene.lit_world import LitWorld
from raytrace.scene.mirror_scene import Cones, Lit, MirrorScene
from raytrace.scene.reference import Picture
from raytrace.scene.woods import Woods
from raytrace.viewing.bezel import housing
from raytrace.viewing.camera import Camera
from raytrace.viewing.ray_differentials import ray_differentials
from raytrace.viewing.view import View, mirror_grid

Array = NDArray[np.float64]

EYE_WIDTH_PX, EYE_HEIGHT_PX = 640, 720  # two of them side by side: 1280 × 720
MARGIN = 0.16  # of the mirror's angular size, left free around it in the picture
# In the pixels that need more than one sample: nine show no edge's steps, and what differs by less is the asphalt's grain.
SAMPLES, CONTRAST = 3, 16
SHADOWS_FROM_MM = 30_000.0  # behind the eyes: what stands farther back throws no shadow that is seen ahead
CONES = (17, 25)  # columns and rows over the mirror: its magnification changes slowly
UP = np.array([0.0, 0.0, 1.0])


class World:
    """A scene's bodies, road and light, made once for all mirrors; the housing of each comes with it."""

    def __init__(self, scene: SceneFile) -> None:
        named, left_out = bodies_and_left_out(scene)
        self.named: tuple[tuple[str, Body], ...] = named
        self._door_mirror = left_out  # of the host vehicle
        self.bodies = tuple(body for _, body in self.named)
        self.host_bodies = 0 if scene.own_vehicle.body == "none" else 1  # how many of the bodies are the driver's vehicle
        self.road, self.daylight = road_of(scene), daylight_of(scene)
        self.woods = Woods() if self.road is not None else None  # the horizon of a scene that brings its own ground is its own
        self.reflectance = scene.mirror.reflectance

    @property
    def left_out(self) -> list[str]:
        """What is left out of the scene, a line each.

        The host vehicle's own door mirror, and what of bodies' looks is not drawn.
        """
        own = [] if self._door_mirror is None else [f"{self._door_mirror}; own_vehicle.keep_mirror = true keeps it"]
        return own + sorted({body.left_out for body in self.bodies} - {""})

    @cached_property
    def lit(self) -> LitWorld:
        """The lit world: what mirrors show."""
        return LitWorld(self.bodies, self.road, self.daylight, self.woods)

    def beside(self, mirror: DrivenMirror) -> LitWorld:
        """What the driver sees past a mirror, looking ahead: its housing, and nothing of the vehicle that he sits in."""
        return LitWorld((*self._near, housing_body(housing(mirror.whole), mirror.pose)), self.road, self.daylight, self.woods)

    @cached_property
    def past(self) -> LitWorld:
        """What the driver sees where no mirror is in the way."""
        return LitWorld(self._near, self.road, self.daylight, self.woods)

    @cached_property
    def _near(self) -> tuple[Body, ...]:
        return tuple(body for body in self.bodies[self.host_bodies:] if body.vertices[:, 0].min() < SHADOWS_FROM_MM)


def both_eyes(mirror: DrivenMirror, world: World, progress: Callable[[float], None] | None = None, width: int = EYE_WIDTH_PX,
              height: int = EYE_HEIGHT_PX) -> tuple[Picture, dict[str, int]]:
    """What the left and the right eye see, side by side, (height, 2·width, 3); and how many rays had which status."""
    report = progress or (lambda share: None)
    beside = world.beside(mirror)
    pictures, counts = [], dict[str, int]()
    for number, view in enumerate((mirror.views.left, mirror.views.right)):
        picture, rays = eye_picture(mirror, view, world, beside, width, height,
                                    lambda share, number=number: report(0.5 * (number + share)))  # type: ignore[misc]
        pictures.append(picture)
        counts = {name: counts.get(name, 0) + rays.get(name, 0) for name in {*counts, *rays}}
    return np.concatenate(pictures, axis=1), dict(sorted(counts.items()))


def eye_picture(mirror: DrivenMirror, view: View, world: World, beside: Lit, width: int, height: int,
                progress: Callable[[float], None] | None = None) -> tuple[Picture, dict[str, int]]:
    """What one eye sees, looking at the middle of the mirror: the mirror, its housing, and the world beside it."""
    camera, pixel = camera_at(mirror, view, width, height)
    driven = MirrorScene(world.lit, beside, view.pose, world.reflectance, 0.5 * pixel, cones_of(view))
    return photograph(view.reflector, camera, driven, progress, SAMPLES, CONTRAST)


def camera_at(mirror: DrivenMirror, view: View, width: int, height: int) -> tuple[Camera, float]:
    """A camera at an eye, in mirror coordinates, that holds the mirror as the middle eye sees it with MARGIN around it.

    With its pixel, radians. All mirrors of one size and place are seen at one scale.
    """
    x_min, x_max, y_min, y_max = mirror.views.middle.box
    corners = np.array([[x, y, 0.0] for x in (x_min, x_max) for y in (y_min, y_max)])
    centre = view.pose.to_vehicle(np.array([0.5 * (x_min + x_max), 0.5 * (y_min + y_max), 0.0]))
    middle = Camera.looking_at(mirror.views.middle.eye, centre, UP, 1.0, 2, 2)
    directions = view.pose.to_vehicle(corners) - mirror.views.middle.eye
    forward = (centre - mirror.views.middle.eye) / np.linalg.norm(centre - mirror.views.middle.eye)
    right, down = (axis / np.linalg.norm(axis) for axis in (middle.across, middle.down))
    depth = directions @ forward
    half = max(float(np.abs(directions @ right / depth).max()), float(np.abs(directions @ down / depth).max()) * width / height)
    angle = 2.0 * float(np.arctan((1.0 + MARGIN) * half))
    made = Camera.looking_at(view.eye, centre, UP, angle, width, height)
    turned = view.pose.directions_to_mirror
    return (Camera(view.eye_in_mirror, turned(made.base), turned(made.across), turned(made.down), width, height),
            2.0 * np.tan(0.5 * angle) / width)


def cones_of(view: View) -> Cones:
    """How the mirror widens the cones of a view's rays; where it shows nothing, as at the nearest place where it does."""
    columns, rows = CONES
    x, y, places = mirror_grid(view, columns, rows)
    factor = ray_differentials(view, places.reshape(-1, 2)).widening.reshape(rows, columns)
    known = np.isfinite(factor)
    if not known.any():
        return Cones(view.box, np.ones((2, 2)))
    from scipy.interpolate import NearestNDInterpolator

    at_x, at_y = np.meshgrid(x, y)
    nearest = NearestNDInterpolator(np.stack([at_x[known], at_y[known]], axis=1), factor[known])
    return Cones((float(x[0]), float(x[-1]), float(y[0]), float(y[-1])),
                 np.ascontiguousarray(np.where(known, factor, nearest(at_x, at_y)).T))
