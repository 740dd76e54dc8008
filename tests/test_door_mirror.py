"""A host vehicle's own door mirror, where the mirror under test is mounted: left out, named, or kept on request."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirror_studio.drive.pictures import World
from mirror_studio.drive.world import MM, bodies_and_left_out, bodies_of
from mirror_studio.scene_file import SceneFile, load_scene
from raytrace.embree import TriangleScene
from raytrace.scene.bodies import Body

FRONT_M = -1.6  # of a saloon whose door mirrors then are at X = 0.30 to 0.43 m, |Y| = 0.70 to 1.00 m
HOST = """
[eyes]
middle_m = [0.9, -0.37, 1.15]
[mirror]
centre_m = [{x}, {y}, 1.075]
hand = "{hand}"
yaw_deg = 12.0
pitch_deg = 2.0
[own_vehicle]
body = "saloon"
front_m = -1.6
rear_m = 3.0
width_m = 1.76
height_m = 1.43
{more}
[measured]
lane_m = {lane}
"""


def host(folder: Path, hand: str = "left", x: float = 0.38, more: str = "") -> SceneFile:
    path = folder / "host.toml"
    path.write_text(HOST.format(x=x, y=-0.92 if hand == "left" else 0.92, hand=hand, more=more,
                                lane="[-5.25, -1.75]" if hand == "left" else "[1.75, 5.25]"))
    return load_scene(path)


def in_box(body: Body, side: float) -> int:
    """How many vertices of the body lie where its door mirror's housing is, by the numbers of the saloon's own file."""
    low, high = np.array([[1903.0, 800.0, 1005.0], [2028.0, 1003.0, 1145.0]])
    at = body.vertices * [1.0, side, 1.0] - [MM * FRONT_M, 0.0, 0.0]
    return int(((at >= low) & (at <= high)).all(axis=1).sum())


@pytest.mark.parametrize(("hand", "side"), [("left", -1.0), ("right", 1.0)])
def test_the_saloon_s_mirror_is_left_out_on_the_side_of_the_mirror_alone(tmp_path: Path, hand: str, side: float) -> None:
    kept = bodies_of(host(tmp_path, hand, more="keep_mirror = true"))[0][1]
    world = World(host(tmp_path, hand))
    body = world.bodies[0]
    assert in_box(kept, side) > 100
    assert in_box(body, side) == 0
    assert in_box(body, -side) == in_box(kept, -side) > 100
    _, left_out = bodies_and_left_out(host(tmp_path, hand))
    assert left_out is not None
    assert left_out.parts == 3  # housing, glass and stalk
    assert set(left_out.materials) == {"paint", "trim", "glass"}
    assert len(kept.faces) - len(body.faces) == left_out.triangles
    assert "mirror under test is mounted there" in str(left_out)
    assert world.left_out == [f"{left_out}; own_vehicle.keep_mirror = true keeps it"]


def test_nothing_stands_behind_the_mirror_any_more(tmp_path: Path) -> None:
    """Rays rearward and outward from the mirror's face: the housing is in their way only where it is kept."""
    random = np.random.default_rng(0)
    starts = np.array([MM * 0.33, -920.0, 1075.0]) + random.uniform(-1.0, 1.0, (500, 3)) * [0.0, 60.0, 40.0]
    ways = np.stack([np.ones(500), -random.uniform(0.0, 0.5, 500), random.uniform(-0.05, 0.05, 500)], axis=1)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    hit = []
    for more in ("keep_mirror = true", ""):
        body = bodies_of(host(tmp_path, more=more))[0][1]
        hit.append((TriangleScene(body.vertices, body.faces).first_hits(starts, ways).triangle >= 0).mean())
    assert hit[0] > 0.5
    assert hit[1] == 0.0


def test_a_mirror_elsewhere_and_a_flank_without_one_leave_the_body_whole(tmp_path: Path) -> None:
    assert World(host(tmp_path, x=-1.2)).left_out == []
    assert World(load_scene("motorway")).left_out == []
