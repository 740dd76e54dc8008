"""The package's own scene: what a driver must recognise in it is where the tracer has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirror_studio.drive.mirrors import DrivenMirror, on_vehicle
from mirror_studio.drive.pictures import World, camera_at, cones_of, eye_picture
from mirror_studio.scene_file import load_scene
from raytrace.image import photograph
from raytrace.reflector import Reflector
from raytrace.scene.mirror_scene import MirrorScene
from raytrace.viewing.camera import Camera
from raytrace.viewing.view import View
from raytrace.visibility.image_points import image_points
from tests.conftest import designed

WIDTH, HEIGHT = 640, 480


@pytest.fixture(scope="module")
def world() -> World:
    return World(load_scene("motorway"))


@pytest.fixture(scope="module")
def mirror() -> DrivenMirror:
    return on_vehicle("progressive-c", Reflector.from_mirror(designed("progressive-c")), load_scene("motorway"))


def pixels(view: View, camera: Camera, targets: np.ndarray) -> np.ndarray:
    """Columns and rows (n, 2) at which a camera sees points of the world in the mirror; NaN for those it does not."""
    places, shown = image_points(view, targets)
    ways = np.column_stack([places, np.zeros(len(places))]) - view.eye_in_mirror
    a, b, c = np.linalg.solve(np.stack([camera.base, camera.across, camera.down], axis=1), ways.T)
    return np.where(shown[:, None], np.stack([b / a, c / a], axis=1), np.nan)


def test_lane_cars_column_and_horizon_are_where_the_tracer_has_them(mirror: DrivenMirror, world: World, tmp_path: Path) -> None:
    view = mirror.views.middle
    picture, rays = eye_picture(mirror, view, world, world.beside(mirror), WIDTH, HEIGHT)
    Image.fromarray(picture).save(tmp_path / "motorway.png")
    assert rays["reflected"] > 0.1 * WIDTH * HEIGHT
    camera, _ = camera_at(mirror, view, WIDTH, HEIGHT)
    bodies = dict(world.named)
    saloon, column = (bodies[name].vertices for name in ("saloon", "column"))
    bonnet = np.array([saloon[:, 0].min() + 600.0, np.median(saloon[:, 1]), 800.0])
    post = np.append(0.5 * (column[:, :2].min(axis=0) + column[:, :2].max(axis=0)), 3000.0)
    line = np.array([14_000.0, -8_750.0, 0.0])
    at = pixels(view, camera, np.stack([bonnet, post, line]))
    assert np.isfinite(at).all()
    colours = [picture[int(row), int(column_of)].astype(int) for column_of, row in at]
    where = f"see {tmp_path / 'motorway.png'}: {at.tolist()}, {[c.tolist() for c in colours]}"
    blue, gray, yellow = colours
    assert blue[2] > 1.4 * blue[0], where
    assert np.ptp(gray) < 40, where
    assert min(yellow[0], yellow[1]) > yellow[2] + 40, where
    # The horizon: along its row the sky above is brighter than the woods and fields below.
    azimuths = np.radians(np.linspace(-20.0, -8.0, 30))
    far = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(30)], axis=1)
    for lift, brighter in ((np.radians(9.0), True), (np.radians(-1.5), False)):
        ways = far * np.cos(lift) + np.array([0.0, 0.0, np.sin(lift)])
        column_of, row = pixels(view, camera, view.eye + 1e9 * ways).T
        seen = np.isfinite(column_of)
        shade = picture[row[seen].astype(int), column_of[seen].astype(int)].mean()
        assert (shade > 140.0) == brighter, f"{shade:.0f} at {np.degrees(lift):.1f}°; {where}"


def test_the_number_plate_is_mirror_written(mirror: DrivenMirror, world: World, tmp_path: Path) -> None:
    """Seen from near, the picture holds the plate's own texture, with what is its right on the left."""
    body = dict(world.named)["saloon"]
    plate = next(k for k, material in enumerate(body.materials) if material.texture is not None)
    texture = body.materials[plate].texture
    assert texture is not None
    faces = body.faces[body.material == plate]
    front = faces[body.vertices[faces, 0].mean(axis=1) < body.vertices[:, 0].mean()]
    uv, points = body.uv[front].reshape(-1, 2), body.vertices[front].reshape(-1, 3)
    # Both are linear in each other on the flat plate.
    fit, *_ = np.linalg.lstsq(np.column_stack([uv, np.ones(len(uv))]), points, rcond=None)
    u, v = (g.ravel() for g in np.meshgrid(np.linspace(0.06, 0.94, 120), np.linspace(0.15, 0.85, 30)))
    targets = np.column_stack([u, v, np.ones_like(u)]) @ fit
    view = mirror.views.middle
    places, shown = image_points(view, targets)
    assert shown.all()
    middle = view.towards(places).mean(axis=0)
    camera = Camera.looking_at(view.eye, view.eye + middle, np.array([0.0, 0.0, 1.0]), np.radians(1.6), 400, 160)
    turned = view.pose.directions_to_mirror
    camera = Camera(view.eye_in_mirror, turned(camera.base), turned(camera.across), turned(camera.down), 400, 160)
    pixel = np.radians(1.6) / 400
    driven = MirrorScene(world.lit, world.lit, view.pose, 1.0, 0.5 * pixel, cones_of(view))
    picture, _ = photograph(view.reflector, camera, driven)
    Image.fromarray(picture).save(tmp_path / "plate.png")
    at = pixels(view, camera, targets)
    inside = (at >= 0.0).all(axis=1) & (at[:, 0] < 400) & (at[:, 1] < 160)
    assert inside.mean() > 0.9, at
    shown_gray = picture[at[inside, 1].astype(int), at[inside, 0].astype(int)].mean(axis=1)
    height, width = texture.shape[:2]
    row = np.clip((v * height).astype(int), 0, height - 1)
    own = texture[row, np.clip((u * width).astype(int), 0, width - 1)].mean(axis=1)[inside]
    other = texture[row, np.clip(((1.0 - u) * width).astype(int), 0, width - 1)].mean(axis=1)[inside]
    where = f"see {tmp_path / 'plate.png'}"
    assert np.corrcoef(shown_gray, own)[0, 1] > 0.8, where
    assert np.corrcoef(shown_gray, other)[0, 1] < 0.5, where
    # What lies to the right on the plate, as one reads it, lies to the left in the mirror.
    assert np.corrcoef(u[inside], at[inside, 0])[0, 1] < -0.99, where
