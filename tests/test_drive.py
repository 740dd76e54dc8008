"""Mirrors driven through a scene: files, pictures and figures, and what is said of scenes and mirrors that cannot be."""

from __future__ import annotations

import csv
import json
import re
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import mirror_cad
from mirror_cad.errors import MirrorError, SpecError
from mirror_studio.cli import run
from mirror_studio.drive.mirrors import NAME, driven_mirror, named_apart, on_vehicle
from mirror_studio.drive.pictures import World, both_eyes, camera_at
from mirror_studio.drive.reference import lane_on_plane, plane_mm, reference_picture
from mirror_studio.drive.sensitivity import with_radii
from mirror_studio.scene_file import SceneFile, load_scene
from raytrace.reflector import Reflector
from raytrace.viewing.pose import STRAIGHT
from raytrace.visibility.image_points import image_points
from tests.conftest import designed
from tests.test_bodies import Glb, car

ROAD = """
[aim]
flank_share = 0.12
horizon_share = 0.6
[own_vehicle]
body = "none"
[road]
left_m = -9.6
right_m = 4.6
[[road.line]]
y_m = -1.75
colour = "yellow"
[[vehicle]]
name = "box"
body = "box.glb"
x_m = 12.0
y_m = -3.5
paint = "#c02020"
[[object]]
name = "post"
body = "box.glb"
x_m = 40.0
y_m = -5.0
[measured]
line_y_m = -1.75
vehicle = "box"
column = "post"
"""


def box_glb(path: Path, length: float = 4.0, width: float = 1.8, height: float = 1.4, paint: str = "paint") -> None:
    """A box in glTF's axes, metres, its front end at z = 0 and looking along +z."""
    corners = np.array([[x, y, z] for x in (-width / 2, width / 2) for y in (0.0, height) for z in (-length, 0.0)])
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
             [1, 5, 7], [1, 7, 3]]
    data = corners.astype("<f4").tobytes() + np.array(faces, dtype="<u2").tobytes()
    header: dict[str, Any] = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"name": paint, "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1], "roughnessFactor": 1,
                                                                "metallicFactor": 0}}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 72}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3",
                       "min": corners.min(axis=0).tolist(), "max": corners.max(axis=0).tolist()},
                      {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"}]}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    path.write_bytes(b"glTF" + struct.pack("<III", 2, 28 + len(text) + len(data), len(text)) + b"JSON" + text
                     + struct.pack("<I", len(data)) + b"BIN\0" + data)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drive")
    box_glb(path / "box.glb")
    (path / "street.toml").write_text(ROAD, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def scene(folder: Path) -> SceneFile:
    return load_scene(folder / "street.toml")


@pytest.fixture(scope="module")
def driven(folder: Path) -> Path:
    """Two mirrors through the command."""
    out = folder / "out"
    assert run(["drive", "progressive-c", "flat", "--scene", str(folder / "street.toml"), "--out", str(out)]) == 0
    return out


def test_the_set_holds_pictures_measures_drawings_and_a_sheet(driven: Path) -> None:
    names = {path.name for path in driven.iterdir()}
    assert names == {"progressive-c-eyes.png", "flat-eyes.png", "maps.svg", "lines.svg", "plan.svg", "turned.svg",
                     "measures.json", "measures.csv", "index.html", "manifest.json"}
    assert Image.open(driven / "progressive-c-eyes.png").size == (1280, 720)
    page = (driven / "index.html").read_text("utf-8")
    assert "http" not in page
    for name in names - {"index.html", "manifest.json"}:
        assert name in page


def test_mirrors_in_one_sheet_have_the_same_aim(driven: Path) -> None:
    measures = json.loads((driven / "measures.json").read_text("utf-8"))
    for figures in measures.values():
        assert figures["aim"]["flank_share"] == pytest.approx(0.12, abs=1e-9)
        assert figures["aim"]["horizon_share"] == pytest.approx(0.6, abs=1e-9)


def test_the_flat_mirror_shows_things_as_they_are(driven: Path) -> None:
    """Differences of exact rays leave some 1e-10."""
    flat = json.loads((driven / "measures.json").read_text("utf-8"))["flat"]
    for direction in ("horizontal", "vertical", "ratio"):
        for key in ("least", "middle", "largest"):
            assert flat["magnification"][direction][key] == pytest.approx(1.0, abs=1e-8)
    assert flat["disparity"]["max_percent"] == pytest.approx(0.0, abs=1e-6)
    assert flat["lane_line"]["bow_arcmin"] == pytest.approx(0.0, abs=1e-6)
    # Its ends are found to 1e-10 radians, and it is some 2° high: 3e-9 radians.
    assert flat["column"]["own_tilt_arcmin"] == pytest.approx(0.0, abs=1e-5)
    assert flat["grid"]["max_arcmin"] == pytest.approx(0.0, abs=1e-5)


def test_the_sheet_s_figures_are_those_of_the_json(driven: Path) -> None:
    measures = json.loads((driven / "measures.json").read_text("utf-8"))
    rows = {row["figure"]: row for row in csv.DictReader((driven / "measures.csv").open(encoding="utf-8"))}
    assert float(rows["lane bow"]["progressive-c"]) == measures["progressive-c"]["lane_line"]["bow_arcmin"]
    assert float(rows["yaw"]["flat"]) == measures["flat"]["aim"]["yaw_deg"]
    assert len(rows) > 35


def test_a_flatter_mirror_shows_less_and_a_turned_one_something_else(driven: Path) -> None:
    changes = json.loads((driven / "measures.json").read_text("utf-8"))["progressive-c"]["sensitivity"]
    for key, more, less in (("horizon_either_deg", "R −5 %", "R +5 %"), ("flank_share", "yaw +1°", "yaw −1°"),
                            ("horizon_share", "pitch −1°", "pitch +1°")):
        assert changes[more][key] > changes["as aimed"][key] > changes[less][key]


@pytest.mark.parametrize("name", ["progressive-c", "sphere-950", "european-aspheric"])
def test_radii_are_scaled_in_every_law(name: str) -> None:
    """Curvature of the laws, read from the design itself, at places over the mirror."""
    spec = mirror_cad.load_spec(name)
    x = np.linspace(-110.0, 110.0, 9)
    before, after = (mirror_cad.design(each).curvature for each in (spec, with_radii(spec, 1.05)))
    for law in ("horizontal", "vertical"):
        assert np.allclose(getattr(after, law)(x) * 1.05, getattr(before, law)(x), rtol=1e-9, atol=0)


# --- pictures ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def world(scene: SceneFile) -> World:
    return World(scene)


def test_a_picture_shows_things_where_the_measures_have_them(scene: SceneFile, world: World) -> None:
    """The red box's middle, found by the tracer, is a red pixel in each eye's picture; the lane line's middle a yellow one."""
    mirror = on_vehicle("progressive-c", Reflector.from_mirror(designed("progressive-c")), scene)
    picture, _ = both_eyes(mirror, world, width=320, height=360)
    for k, view in enumerate((mirror.views.left, mirror.views.right)):
        camera, _ = camera_at(mirror, view, 320, 360)
        targets = np.array([[12_000.0, -3500.0, 700.0], [9_000.0, -1750.0, 0.0]])
        places, shown = image_points(view, targets)
        assert shown.all()
        ways = np.column_stack([places, np.zeros(2)]) - view.eye_in_mirror
        coefficients = np.linalg.solve(np.stack([camera.base, camera.across, camera.down], axis=1), ways.T)
        column, row = np.floor(coefficients[1:] / coefficients[0]).astype(int)
        box, line = (picture[row[i], column[i] + 320 * k].astype(int) for i in range(2))
        assert box[0] > 2 * max(box[1], box[2]), f"the box is seen at {column[0]}, {row[0]} of eye {k}, coloured {box}"
        assert min(line[0], line[1]) > line[2] + 40, f"the line is seen at {column[1]}, {row[1]} of eye {k}, coloured {line}"


def test_the_right_hand_mirror_of_the_reflected_scene_shows_the_reflected_picture(folder: Path) -> None:
    """All but the ground's own noise, which is not symmetric: mean colours of the whole picture agree to some values."""
    other = ROAD.replace("y_m = -", "y_m = ").replace("left_m = -9.6", "left_m = -4.6") \
        .replace("right_m = 4.6", "right_m = 9.6").replace("[measured]", "[measured]\nlane_m = [1.75, 5.25]") \
        + "[eyes]\nmiddle_m = [0.0, 0.49, 1.9]\n" \
        + "[mirror]\nhand = \"right\"\ncentre_m = [-0.54, 1.01, 1.76]\n" \
        + "[light]\nazimuth_deg = 35.0\n"
    (folder / "mirrored.toml").write_text(other, encoding="utf-8")
    pictures = []
    for name in ("street", "mirrored"):
        scene = load_scene(folder / f"{name}.toml")
        mirror = on_vehicle("progressive-c", Reflector.from_mirror(designed("progressive-c")), scene)
        pictures.append(both_eyes(mirror, World(scene), width=160, height=180)[0].astype(float))
    left, right = pictures
    assert np.abs(left - right[:, ::-1]).mean() < 6.0
    assert np.abs(left - right).mean() > 12.0


def test_the_photographed_lane_lies_on_the_plane_where_geometry_has_it(scene: SceneFile, world: World) -> None:
    width = 500
    picture = reference_picture(scene, world, width_px=width).astype(int)
    size = 10_000.0 / width
    slope = lane_on_plane(scene)
    for x_mm in (-900.0, -1400.0):
        row = (-1200.0 + 5400.0 - slope * x_mm) / size
        column = (-2500.0 + 5000.0 - x_mm) / size  # its left is at +X
        pixel = picture[int(row), int(column)]
        assert min(pixel[0], pixel[1]) > pixel[2] + 40, f"no yellow at {x_mm} mm: {pixel}"
    beside = STRAIGHT.T @ (np.array([9_000.0, -1750.0, 0.0]) - [-540.0, -1010.0, 1760.0])
    assert beside[1] / beside[2] * plane_mm() == pytest.approx(slope * beside[0] / beside[2] * plane_mm())


# --- bad input ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("change", "message"), [
    (('body = "box.glb"\nx_m = 12.0', 'body = "gone.glb"\nx_m = 12.0'), "gone.glb: cannot be read"),
    (('body = "box.glb"\nx_m = 12.0', 'body = "saloom"\nx_m = 12.0'), "body = 'saloom': no such body; the package has"),
    (('[aim]\nflank_share = 0.12\nhorizon_share = 0.6', "[mirror]\nyaw_deg = -75.0\npitch_deg = -60.0"),
     "behind the face of the mirror, which is turned away from it"),
    (('[own_vehicle]\n', "[mirror]\ncentre_m = [0.0, -0.49, 1.9]\n[own_vehicle]\nwidth_m = 0.5\n"),
     "sphere-950: aim: the eye is inside the mirror"),
    (('[own_vehicle]\n', "[own_vehicle]\nfront_m = -9.0\nrear_m = -3.0\nwidth_m = 1.0\n"), "sphere-950: aim: no yaw and pitch"),
    (('[own_vehicle]\n', "[own_vehicle]\nrear_m = -3.0\n"), "own_vehicle.front_m = -0.2 must lie before rear_m = -3"),
    (('[aim]\n', "[mirror]\nhand = \"right\"\n[aim]\n"), r"centre_m has Y = -1.01 m, which is not on the right"),
    (('[aim]\n', "[mirror]\ncentre_m = [-0.54, -1.01, -1.0]\n[aim]\n"), "mirror.centre_m, Z = -1 m is not above the ground"),
    (('[aim]\n', "[mirror]\ncentre_m = [1.0, -1.01, 1.7]\n[aim]\n"), r"aim: the eye is \d+ mm ahead of the mirror"),
    (('name = "post"', 'name = "box"'), "two things are called 'box'"),
    (('name = "post"', 'name = "post"\ncount = 3'), "'post' stands there 3 times"),
])
def test_a_scene_that_cannot_be_is_refused_and_nothing_is_written(folder: Path, tmp_path: Path, change: tuple[str, str],
                                                                  message: str, capsys: pytest.CaptureFixture[str]) -> None:
    box_glb(tmp_path / "box.glb")
    assert change[0] in ROAD
    (tmp_path / "bad.toml").write_text(ROAD.replace(*change, 1), encoding="utf-8")
    out = tmp_path / "out"
    assert run(["drive", "sphere-950", "--scene", str(tmp_path / "bad.toml"), "--out", str(out)]) == 2
    assert re.search(message, capsys.readouterr().err)
    assert not out.exists()


def test_a_body_without_paint_a_broken_one_and_two_mirrors_of_one_name_are_refused(tmp_path: Path, scene: SceneFile) -> None:
    box_glb(tmp_path / "box.glb", paint="steel")
    (tmp_path / "bad.toml").write_text(ROAD, encoding="utf-8")
    with pytest.raises(MirrorError, match="vehicle 'box': no material is named 'paint'"):
        World(load_scene(tmp_path / "bad.toml"))
    (tmp_path / "box.glb").write_bytes(b"glTF not really")
    with pytest.raises(MirrorError, match=r"box\.glb"):
        World(load_scene(tmp_path / "bad.toml"))
    assert run(["drive", "flat", "flat", "--out", str(tmp_path / "out")]) == 2
    assert not (tmp_path / "out").exists()


def test_what_a_body_s_look_loses_is_said_once_a_file(tmp_path: Path) -> None:
    """Two objects of one file, and one of another that loses nothing."""
    for name, look in (("lamp", {"emissiveFactor": [1.0, 0.0, 0.0]}), ("post", {})):
        Glb().mesh(*car(), material={"pbrMetallicRoughness": {"metallicFactor": 0.0}} | look).write(tmp_path / f"{name}.glb")
    things = "".join(f'[[object]]\nbody = "{name}.glb"\nx_m = {x}\ny_m = -5.0\n' for name, x in
                     (("lamp", 20.0), ("lamp", 30.0), ("post", 40.0)))
    (tmp_path / "yard.toml").write_text(f'name = "yard"\n[aim]\n[own_vehicle]\nbody = "none"\n[road]\n{things}')
    assert World(load_scene(tmp_path / "yard.toml")).left_out == ["lamp.glb: left out: emission"]


@pytest.mark.parametrize(("given", "names"), [
    (["c.step", "c.stl"], ["c.step", "c.stl"]),  # by the ending
    (["c.step", "c.STL", "d.step"], ["c.step", "c.STL", "d"]),
    (["old/c.step", "new/c.step"], ["old-c", "new-c"]),  # by the folder
    (["old/parts/c.step", "new/parts/c.step"], ["old-c", "new-c"]),
    (["c.step", "new/c.step"], ["c", "new-c"]),
    (["old/a/c.step", "new/a/c.step", "new/b/c.step"], ["old-a-c", "new-a-c", "new-b-c"]),
    (["old/c.step", "new/c.step", "new/c.obj"], ["old-c.step", "new-c.step", "new-c.obj"]),  # by both
    (["c", "c.toml"], ["c", "c.toml"]),  # a preset and a specification
    (["one.toml", "two.toml"], ["c-one", "c-two"]),  # two specifications that say the same name
    (["c.step", "b.step", "c.stl", "new/b.step"], ["c.step", "b", "c.stl", "new-b"]),
    (["old (2)/c.step", "new/c.step"], ["old_2_-c", "new-c"]),
    ([f"{'long' * 20}/c.step", "new/c.step"], ["c-1", "c-2"]),
])
def test_mirrors_of_equal_names_are_told_apart_by_what_differs(scene: SceneFile, given: list[str], names: list[str]) -> None:
    """What else could be equal: presets, specifications, files; in the same folder, below one another, side by side."""
    made = on_vehicle("c", Reflector.from_mirror(designed("flat")), scene)
    mirrors = [replace(made, name=Path(each).stem if "." in each and not each.endswith(".toml") else "c") for each in given]
    apart = [mirror.name for mirror in named_apart(mirrors, given)]
    assert apart == names
    assert all(re.fullmatch(NAME, name) for name in apart)


def test_a_mirror_given_twice_and_one_whose_name_is_no_file_s_are_refused(scene: SceneFile) -> None:
    made = on_vehicle("c", Reflector.from_mirror(designed("flat")), scene)
    for given in (["c", "c"], ["c.step", "./c.step"], ["a/../c.step", "c.step"]):
        with pytest.raises(SpecError, match="'c' is given twice: give each mirror once"):
            named_apart([made, made], given)
    with pytest.raises(SpecError, match="a mirror's file is called 'a/b': rename it"):
        named_apart([replace(made, name="a/b")], ["a/b"])


def test_a_mirror_mesh_in_metres_is_refused_with_its_size(tmp_path: Path, scene: SceneFile) -> None:
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(-0.115, 0.115, 5), np.linspace(-0.16, 0.16, 5)))
    lines = [f"v {a} {b} {-(a * a + b * b) / 2.0}" for a, b in zip(x, y, strict=True)]
    lines += [f"f {k} {k + a} {k + b}" for a, b in ((1, 6), (6, 5)) for k in range(1, 20) if k % 5]
    (tmp_path / "metres.obj").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(MirrorError, match=r"metres: the mesh is 0\.32 mm across .* was it written in metres"):
        driven_mirror(str(tmp_path / "metres.obj"), scene)


def test_a_mirror_without_its_design_is_driven_and_has_no_radii_to_change(folder: Path, scene: SceneFile) -> None:
    path = folder / "sphere.step"
    designed("sphere-950").export_step(path)
    mirror = driven_mirror(str(path), scene)
    assert mirror.spec is None
    assert mirror.shown().flank == pytest.approx(0.12, abs=1e-9)
