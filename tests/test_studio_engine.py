"""The studio's numbers are the program's: the same designs, figures, pictures and deviations, and TOML that comes back."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from pydantic import BaseModel

from mirror_cad.design_stages import design
from mirror_cad.deviation import against_design
from mirror_cad.errors import MirrorError, SpecError
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import load_spec, preset_names, validate_spec
from mirror_studio.viewing_setup import ViewingSetup
from mirror_studio.web import engine, state
from mirror_studio.web.controls import groups
from mirror_studio.web.mirror_pose import MirrorPose, aimed
from mirror_studio.web.protocol import StoppedError, ViewSettings, WrongShapeError, pack, read_message, unpack
from mirror_studio.web.uploads import NAME, Uploads
from raytrace.image import photograph
from raytrace.reflector import Reflector
from raytrace.scene.reference import load_picture
from raytrace.viewing.camera import Frame
from tests.conftest import face_of

SPECS = ("progressive-c", "progressive-a", "sphere-950", "zoned-cylinder")


@pytest.fixture(scope="module")
def uploads() -> Iterator[Uploads]:
    kept = Uploads()
    yield kept
    kept.close()


# --- the numbers ------------------------------------------------------------------------------------------------------


def test_figures_and_deviations_are_those_that_build_writes(tmp_path: Path) -> None:
    """`metrics.json` is traced on the surface read back from STEP, 1e-11 mm from the one here."""
    from mirror_studio.as_json import metrics_as_json, stage_as_json
    from mirror_studio.build.pipeline import build
    from mirror_studio.progress import Progress

    spec = load_spec("progressive-c")
    built = build(spec, tmp_path / "set", Progress(quiet=True))
    metrics, total = metrics_as_json(built.metrics), stage_as_json(built.deviation.total)
    shown = engine.show(spec, ViewSettings(), fine=True).header
    for key in ("h_fov_deg", "v_fov_left_deg"):
        for kind in ("section", "traced"):
            assert shown["figures"][key][kind] == pytest.approx(metrics[key][kind], rel=1e-9)
    assert shown["figures"]["lane_straightness_percent"]["traced"] == pytest.approx(
        metrics["lane_straightness_percent"]["traced"], rel=1e-7)
    for key, value in shown["deviations"].items():
        assert value == pytest.approx(total[key], rel=1e-5)


@pytest.mark.parametrize("name", SPECS)
def test_surface_is_bit_for_bit_that_of_design(name: str) -> None:
    spec = load_spec(name)
    ours, theirs = engine.designed(spec).mirror.surface, design(spec).surface
    np.testing.assert_array_equal(ours.poles, theirs.poles)
    np.testing.assert_array_equal(ours.knots_u, theirs.knots_u)


def test_picture_is_the_driver_view_of_that_surface() -> None:
    """The fine picture is the program's own with the same frame, but for what JPEG does to it."""
    spec = load_spec("progressive-c")
    shown = engine.show(spec, ViewSettings(width=320, height=400), fine=True)
    left, top, pixel, columns, rows = shown.header["frames"]["picture"]
    mirror = design(spec)
    setting = ViewingSetup.of(spec, mirror.box)
    camera = Frame(left, top, pixel, columns, rows).camera(setting.eye)
    view, _ = photograph(Reflector.from_mirror(mirror), camera, setting.scene(load_picture("road"), spec))
    with Image.open(io.BytesIO(shown.pictures["picture0"])) as picture:
        off = np.abs(np.asarray(picture, dtype=float) - view)
    assert off.mean() < 2.0
    assert np.percentile(off, 99) < 20.0


def test_maps_hold_the_curvature_of_the_surface() -> None:
    """On a sphere of 950 mm the middle has that radius both ways; its laws are flat lines."""
    maps = engine.designed(load_spec("sphere-950")).maps
    assert maps["kx"][30, 45] == pytest.approx(1e3 / 950.0, rel=1e-4)
    assert maps["ky"][30, 45] == pytest.approx(1e3 / 950.0, rel=1e-4)
    np.testing.assert_allclose(maps["law_x"], 1e3 / 950.0, rtol=1e-12)
    np.testing.assert_allclose(maps["real_x"], 1e3 / 950.0, rtol=1e-3)


@pytest.mark.parametrize("name", SPECS)
def test_deviation_maps_agree_with_the_deviation(name: str) -> None:
    """The map's largest value inside the outline comes near the one that deviation.json states, and does not pass it: its peak
    is on the edge, which the map's places only come near."""
    one = engine.designed(load_spec(name))
    mirror = one.mirror
    x, y = np.linspace(*mirror.box[:2], engine.MAP[0]), np.linspace(*mirror.box[2:], engine.MAP[1])
    inside = mirror.outline.contains(x[:, None], y)
    total = against_design(mirror.curvature, mirror.outline, mirror.exact, mirror.surface)
    for key in ("k1_percent", "k2_percent"):
        values = one.maps[key][inside]
        largest = values[np.argmax(np.abs(values))]
        stated = total.of(key.removesuffix("_percent")).max_percent
        assert largest == pytest.approx(stated, rel=0.15, abs=0.02)
        assert abs(largest) <= 1.01 * abs(stated) + 0.01


def test_magnification_of_a_sphere_is_that_of_its_closed_form() -> None:
    """Looked at along its axis from d, a ray at the small angle a meets the sphere at d·a from the axis, where the normal is
    turned by d·a/R: it leaves at a·(1 + 2d/R), so the mirror magnifies by 1/(1 + 2d/R) both ways."""
    spec = validate_spec(load_spec("sphere-950").model_dump(mode="python", exclude_none=True) | {
        "eye": {"distance_mm": 762.0, "aligned": "centre"}})
    found = engine.probe(engine.designed(spec), ViewSettings(), 0.0, 0.0, 0)
    assert found
    for key in ("across", "up"):
        assert found[key] == pytest.approx(1.0 / (1.0 + 2.0 * 762.0 / 950.0), rel=1e-4)


def test_a_ray_beside_the_mirror_finds_nothing() -> None:
    assert engine.probe(engine.designed(load_spec("sphere-950")), ViewSettings(), 300.0, 0.0, 0) is None


def test_a_newer_request_ends_a_fine_picture() -> None:
    def stop(share: float) -> None:
        raise StoppedError

    with pytest.raises(StoppedError):
        engine.show(load_spec("sphere-950"), ViewSettings(), fine=True, progress=stop)


# --- a turned mirror --------------------------------------------------------------------------------------------------


def test_turning_a_mirror_turns_what_its_middle_shows_by_twice_the_angle() -> None:
    """Law of reflection: by 2·yaw in the horizontal plane; the eye is aligned with the centre."""
    spec = validate_spec(load_spec("sphere-950").model_dump(mode="python", exclude_none=True) | {
        "eye": {"distance_mm": 762.0, "aligned": "centre"}})
    one = engine.designed(spec)
    for yaw in (-3.0, 2.0):
        found = engine.probe(one, ViewSettings(yaw_deg=yaw), 0.0, 0.0, 0)
        assert found
        assert found["landed_mm"][0] == pytest.approx(one.setup.plane_z_mm * math.tan(math.radians(2.0 * yaw)), rel=1e-6)


def test_fields_of_view_of_the_sections_do_not_change_with_the_pose() -> None:
    spec = load_spec("progressive-c")
    looks = ViewSettings(), ViewSettings(yaw_deg=4.0, pitch_deg=-2.0)
    straight, turned = (engine.show(spec, look).header["figures"] for look in looks)
    assert straight["h_fov_deg"]["section"] == turned["h_fov_deg"]["section"]
    assert straight["h_fov_deg"]["traced"] != turned["h_fov_deg"]["traced"]


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_turned_places_come_back(yaw: float, pitch: float) -> None:
    turn = MirrorPose(yaw, pitch, (1.0, 2.0, 3.0), (-4.0, 5.0, 6.0))
    points = np.array([[10.0, -20.0, 30.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(turn.to_mirror(turn.to_scene(points)), points, atol=1e-12)
    np.testing.assert_allclose(turn.rotation @ turn.rotation.T, np.eye(3), atol=1e-14)


def test_aim_sends_the_ray_to_the_middle_where_it_was_asked() -> None:
    eye, place, wanted = np.array([115.0, 0.0, 753.0]), np.array([5.0, -3.0, 1.0]), np.array([-0.25, 0.02, 0.97])
    point, normal = np.array([40.0, 7.0, -2.0]), np.array([0.03, -0.05, 1.0])
    normal /= np.linalg.norm(normal)
    turn = aimed(point, normal, place, eye, wanted)
    np.testing.assert_allclose(turn.to_scene(point), place, atol=1e-12)
    ray = (place - eye) / np.linalg.norm(place - eye)
    turned = turn.rotation @ normal
    np.testing.assert_allclose(ray - 2.0 * (ray @ turned) * turned, wanted / np.linalg.norm(wanted), atol=1e-9)


def test_the_designs_own_file_beside_it_shows_the_same(tmp_path: Path, uploads: Uploads) -> None:
    """At equal aim, a STEP of the very design gives its very picture."""
    spec = load_spec("progressive-c")
    mirror = design(spec)
    mirror.export_step(tmp_path / "own.step")
    name = uploads.add("reflector", ".step", (tmp_path / "own.step").read_bytes())
    own = uploads.reflector(name)
    shown = engine.show(spec, ViewSettings(width=400, height=300, yaw_deg=2.0), users_mirror=own)
    pictures = [np.asarray(Image.open(io.BytesIO(shown.pictures[key])), dtype=float) for key in ("picture0", "own0")]
    assert pictures[0].shape == pictures[1].shape
    assert np.mean(np.abs(pictures[0] - pictures[1])) < 0.5
    assert engine.designed(spec).mirror.box == pytest.approx(mirror.box)
    at, _ = face_of(mirror).reflected_at(engine.designed(spec).setup.eye, np.zeros(1), np.zeros(1))
    assert np.isfinite(at).all()


# --- specifications ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", preset_names())
def test_presets_go_to_the_page_and_to_toml_and_come_back(name: str, uploads: Uploads) -> None:
    spec = load_spec(name)
    held = state.as_state(spec)
    assert state.as_spec(held, uploads) == spec
    text = state.as_toml(spec, ViewSettings(yaw_deg=1.5))
    again, look = state.read_toml(text, uploads)
    assert state.as_spec(again, uploads) == spec
    assert look
    assert look["yaw_deg"] == 1.5


def test_toml_of_the_page_is_what_the_command_line_reads(tmp_path: Path, uploads: Uploads) -> None:
    held = state.as_state(load_spec("progressive-c"))
    held["horizontal"] = {"law": "table", "x_mm": [-115, 0, 115], "radius_mm": [400, "inf", 1250.5], "level_at": -3}
    held["vertical"] = {"law": "expression", "radius": "1250 + 100*t", "curvature": None}
    del held["vertical"]["curvature"]
    held["name"] = "mine"
    spec = state.as_spec(held, uploads)
    path = tmp_path / "mine.toml"
    path.write_text(state.as_toml(spec), encoding="utf-8")
    assert load_spec(path) == spec


@pytest.mark.parametrize(("section", "key", "value"), [
    ("outline", "file", "/etc/passwd"), ("outline", "file", "../../x.svg"), ("scene", "image", "/etc/shadow"),
    ("scene", "image", 3), ("outline", "file", ["a"]), ("horizontal", "file", "law.csv"), ("vertical", "file", "/dev/zero"),
    ("outline", "file", f"{'0' * 24}.dxf")])
def test_no_name_from_the_page_reaches_the_file_system(section: str, key: str, value: Any, uploads: Uploads) -> None:
    held = state.as_state(load_spec("progressive-c"))
    held[section] = {key: value} if section == "outline" else held[section] | {key: value}
    with pytest.raises(SpecError, match="reads no files by their names"):
        state.as_spec(held, uploads)


def test_toml_that_names_a_file_is_refused_with_what_to_do(uploads: Uploads) -> None:
    with pytest.raises(SpecError, match="bring this one in"):
        state.read_toml('name = "a"\n[outline]\nfile = "/etc/passwd"\n', uploads)


def test_faults_of_a_specification_are_the_programs_own_words(uploads: Uploads) -> None:
    held = state.as_state(load_spec("progressive-c"))
    held["horizontal"]["left_mm"] = 0
    with pytest.raises(SpecError) as caught:
        state.as_spec(held, uploads)
    with pytest.raises(SpecError) as wanted:
        validate_spec(held)
    assert caught.value.faults == wanted.value.faults


def test_sliders_stay_within_what_the_specification_takes() -> None:
    """Both ends of every slider are accepted for the key by itself."""
    for group in groups():
        for control in group.controls:
            plain = ("eye.", "outline.", "blank.", "glass.", "scene.", "export.", "view.")
            if control.low is None or not control.key.startswith(plain):
                continue
            section, *rest = control.key.split(".")
            model = MirrorSpec.model_fields[section].annotation
            assert isinstance(model, type)
            assert issubclass(model, BaseModel)
            for value in (control.low, control.high):
                value = int(value or 0) if control.key == "view.width_px" else value
                content: Any = value
                for key in reversed(rest):
                    content = [content, 0.0] if key in "01" else {key: content}
                model.model_validate(content)


# --- messages ---------------------------------------------------------------------------------------------------------


def test_packed_messages_are_read_back() -> None:
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.array([np.nan, np.inf, 1e300])}
    header, parts = unpack(pack({"id": 7}, {"p": b"\xff\xd8abc"}, arrays))
    assert header["id"] == 7
    assert parts["p"] == b"\xff\xd8abc"
    np.testing.assert_array_equal(parts["a"], arrays["a"].astype(np.float32))
    assert np.isnan(parts["b"]).all()


@given(st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(), lambda inner: st.lists(
    inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4), max_leaves=12))
def test_other_messages_are_refused_as_such(value: Any) -> None:
    import json

    with pytest.raises(WrongShapeError):
        read_message(json.dumps(value))


@given(st.text(max_size=300))
def test_text_that_is_no_message_is_refused_as_such(text: str) -> None:
    with pytest.raises(WrongShapeError):
        read_message(text)


# --- uploads ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "ending", "data", "says"), [
    ("outline", ".exe", b"MZ", "read from .dxf, .svg"), ("outline", ".dxf", b"no drawing at all", "the file"),
    ("outline", ".svg", b"<svg><rect/></svg>", "outline"), ("picture", ".png", b"\x89PNG\r\n\x1a\nnonsense", "picture"),
    ("reflector", ".step", b"ISO-10303-21; nothing", "the file"), ("reflector", ".stl", b"solid\n", "the file"),
    ("picture", ".jpg", b"x" * 41_000_000, "may have 40 MB")])
def test_files_of_another_kind_are_refused_in_words(kind: Any, ending: str, data: bytes, says: str, uploads: Uploads) -> None:
    before = set(uploads.folder.iterdir())
    with pytest.raises(MirrorError, match=says):
        uploads.add(kind, ending, data)
    assert set(uploads.folder.iterdir()) == before


def test_a_picture_that_unfolds_to_gigabytes_is_refused(uploads: Uploads) -> None:
    buffer = io.BytesIO()
    Image.new("1", (30_000, 30_000)).save(buffer, format="PNG")
    with pytest.raises(MirrorError, match="too many"):
        uploads.add("picture", ".png", buffer.getvalue())


def test_uploaded_files_are_named_by_their_content(uploads: Uploads) -> None:
    svg = b'<svg xmlns="http://www.w3.org/2000/svg" width="200mm" height="150mm" viewBox="-100 -75 200 150">' \
          b'<ellipse rx="90" ry="60"/></svg>'
    name = uploads.add("outline", ".svg", svg)
    assert NAME.fullmatch(name)
    assert uploads.add("outline", ".svg", svg) == name
    held = state.as_state(load_spec("sphere-950")) | {"outline": {"file": name}}
    box = engine.designed(state.as_spec(held, uploads)).mirror.box
    assert box == pytest.approx((-90.0, 90.0, -60.0, 60.0), abs=1e-6)
