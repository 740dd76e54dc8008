"""Photograph a scene from the mirror's position: a reference plane for the paper's set-up."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from mirror_cad.spec import Eye
from mirror_studio.build.folder import MANIFEST, new_set
from mirror_studio.build.pipeline import hashes, versions, write_json, write_png
from mirror_studio.drive.pictures import World
from mirror_studio.drive.world import MM, pose_of
from mirror_studio.json_types import JsonObject
from mirror_studio.progress import Progress
from mirror_studio.scene_file import SceneFile
from raytrace.image import photograph
from raytrace.scene.mirror_scene import Cones, MirrorScene
from raytrace.scene.reference import Picture
from raytrace.viewing.camera import Camera
from raytrace.viewing.eye import eye_position
from raytrace.viewing.pose import STRAIGHT, Pose

WIDTH_MM, HEIGHT_MM, CENTRE_MM = 10_000.0, 10_800.0, (-2500.0, -1200.0)
WIDTH_PX = 2500
DISTANCE_MM = 8200.0  # of the plane behind the eye: the paper's


def write_reference(scene: SceneFile, out: Path, progress: Progress) -> JsonObject:
    """Photograph the scene into a folder, with a specification that shows it in progressive-c; returns what it says of it."""
    lane = lane_on_plane(scene)
    with new_set(out) as folder:
        progress.step(f"{scene.name}: reading bodies")
        world = World(scene)
        for line in world.left_out:
            progress.step(line)
        progress.step(f"{scene.name}: photographing")
        write_png(folder / "reference.png", reference_picture(scene, world, progress.share))
        (folder / "reference.toml").write_text(_specification(scene, lane), encoding="utf-8")
        write_json(folder / MANIFEST, {"schema": 1, "scene": scene.model_dump(mode="json", exclude_none=True),
                                       "versions": versions(), "files": hashes(folder)})
    progress.step(f"{scene.name}: done, in {out}; `mirror-cad build {out / 'reference.toml'}` shows it in a mirror")
    return {"width_mm": WIDTH_MM, "centre_mm": CENTRE_MM, "distance_mm": DISTANCE_MM, "lane_slope": lane}


def reference_picture(scene: SceneFile, world: World, progress: Callable[[float], None] | None = None,
                      width_px: int = WIDTH_PX) -> Picture:
    """What a camera in the mirror's place, looking straight rearward, sees of the world.

    The picture is of a part of the plane DISTANCE_MM behind the paper's eye. Its right lies at −X, as a rear-facing camera has
    it.
    """
    size = WIDTH_MM / width_px
    pose = pose_of(scene)
    straight = Pose(pose.centre, pose.pivot, hand=pose.hand)
    top, left = CENTRE_MM[1] + 0.5 * HEIGHT_MM, CENTRE_MM[0] + 0.5 * WIDTH_MM  # of the picture; its left is at +X
    camera = Camera(np.zeros(3), np.array([left, top, plane_mm()]), np.array([-size, 0.0, 0.0]), np.array([0.0, -size, 0.0]),
                    width_px, round(HEIGHT_MM / size))
    same = Cones((0.0, 1.0, 0.0, 1.0), np.ones((2, 2)))
    driven = MirrorScene(world.lit, world.lit, straight, 1.0, 0.5 * size / plane_mm(), same)
    return photograph(None, camera, driven, progress)[0]


def plane_mm() -> float:
    """z of the reference plane in the paper's set-up with its own mirror, 230 mm wide."""
    eye = Eye()
    return float(eye_position(eye.distance_mm, eye.aligned, (-115.0, 115.0, 0.0, 0.0))[2]) + DISTANCE_MM


def lane_on_plane(scene: SceneFile) -> float:
    """Slope of the measured lane line on the plane, where it runs through (0, 0), the point that it vanishes at."""
    pose = pose_of(scene)
    beside = STRAIGHT.T @ (np.array([0.0, MM * scene.measured.line_y_m, 0.0]) - pose.centre)
    return float(beside[1] / beside[0])


def _specification(scene: SceneFile, slope: float) -> str:
    return f"""# progressive-c before the scene {scene.name!r}, as the mirror's place sees it: a plane 8.2 m behind the eye.
name = "reference"

[horizontal]
law = "zones"
right_mm = 1250.0
left_mm = 400.0
blend_from = "match"
blend_to = 1.0
blend = "smooth"

[horizontal.match]
sphere_mm = 950.0

[vertical]
law = "linear"
right_mm = 1250.0
left_mm = 1350.0

[scene]
image = "reference.png"
distance_mm = {DISTANCE_MM}
width_mm = {WIDTH_MM}
centre_mm = [{CENTRE_MM[0]}, {CENTRE_MM[1]}]

[scene.lane]                  # the line painted at Y = {scene.measured.line_y_m:g} m
x0_mm = 0.0
y0_mm = 0.0
slope = {slope:.6f}
"""
