"""Scene files: what they may say, and what is said of those that may not be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mirror_cad.errors import SpecError
from mirror_studio.scene_file import SceneFile, load_scene, scene_names


def read(tmp_path: Path, text: str) -> SceneFile:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return load_scene(path)


def test_every_scene_of_the_package_is_read() -> None:
    assert "motorway" in scene_names()
    for name in scene_names():
        scene = load_scene(name)
        assert scene.name == name
        assert scene.vehicle
        assert scene.measured.vehicle in [vehicle.name for vehicle in scene.vehicle]


def test_an_empty_file_is_a_scene_without_a_road(tmp_path: Path) -> None:
    scene = read(tmp_path, "")
    assert (scene.name, scene.road, scene.vehicle) == ("mine", None, ())
    assert np.linalg.norm(np.subtract(scene.mirror.centre_m, scene.eyes.middle_m)) == pytest.approx(0.76, abs=0.005)


def test_files_are_relative_to_the_scene_and_names_are_the_packages(tmp_path: Path) -> None:
    scene = read(tmp_path, '[[vehicle]]\nname = "mine"\nbody = "bodies/car.glb"\nx_m = 9\ny_m = -3\n'
                           '[[object]]\nbody = "column"\nx_m = 1\ny_m = 2\n')
    assert scene.vehicle[0].body == str(tmp_path / "bodies" / "car.glb")
    assert scene.object[0].body == "column"


@pytest.mark.parametrize(("text", "message"), [
    ("[light]\nelevation_deg = 2", "light.elevation_deg = 2: must be at least 5 and at most 90"),
    ("[ligt]\n", "ligt: unknown key; did you mean 'light'?"),
    ('[[vehicle]]\nname = "a"\nbody = "saloon"\nx_m = 1\ny_m = "s"', 'vehicle.0.y_m = "s": must be a number'),
    ('[[vehicle]]\nname = "a"\nbody = "saloon"\nx_m = 1\ny_m = 0\npant = "#fff"',
     "vehicle.0.pant: unknown key; did you mean 'paint'"),
    ('[[vehicle]]\nname = "a"\nbody = "saloon"\nx_m = 1\ny_m = 0\npaint = "red"',
     'vehicle.0.paint = "red": must be a colour #rrggbb'),
    ("[aim]\n[mirror]\nyaw_deg = 3\npitch_deg = 1", r"\[aim\] and mirror.yaw_deg, pitch_deg cannot both be given"),
    ("[mirror]\nyaw_deg = 3", "yaw_deg and pitch_deg belong together"),
    ('[measured]\nvehicle = "q"', "measured.vehicle = 'q': the scene has no vehicle of this name; there is none"),
    ("[measured]\nlane_m = [3, 1]", r"lane_m = \[3, 1\] must rise"),
    ("[[road.line]]\ny_m = 1\ndash_m = 2", "dash_m and period_m belong together"),
    ("[road]\nleft_m = 4\nright_m = -4", "left_m = 4 must lie below right_m = -4"),
    ("[eyes]\nmiddle_m = [1, 2]", "eyes.middle_m"),
    ("[eyes]\nmiddle_m = [1, 2, nan]", "eyes.middle_m.2 = nan: must be finite"),
    ('[[object]]\nbody = "tree"\nx_m = 1\ny_m = 0\ncount = 999\n[[object]]\nbody = "tree"\nx_m = 1\ny_m = 0\ncount = 999\n'
     '[[object]]\nbody = "tree"\nx_m = 1\ny_m = 0\ncount = 3', "2001 bodies are too many"),
    ("name = [", "not TOML"),
])
def test_what_a_scene_may_not_say_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SpecError, match=message):
        read(tmp_path, text)


def test_an_eye_under_the_ground_and_a_mirror_in_the_vehicle_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="eyes.middle_m, Z = -1 m is not above the ground"):
        read(tmp_path, "[eyes]\nmiddle_m = [0.0, -0.5, -1.0]")
    with pytest.raises(SpecError, match="is inside the vehicle"):
        read(tmp_path, "[own_vehicle]\nwidth_m = 8.0\nfront_m = -2.0")
    with pytest.raises(SpecError, match="is not beside the vehicle on the mirror's side"):
        read(tmp_path, "[measured]\nlane_m = [1.75, 5.25]")


def test_a_scene_that_is_not_there_is_named_beside_those_that_are() -> None:
    with pytest.raises(SpecError, match="did you mean the scene 'motorway'"):
        load_scene("motorwy")
