"""Right-hand mirrors: their files are the reflection of the left-hand one's, and everything measured on them is the same."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import mirror_cad
import raytrace
from mirror_cad.occt.step import GLASS_COLOUR, Part, read_step, write_step
from mirror_cad.outline import Outline, closed_outline
from mirror_cad.outline.files import read_outline
from mirror_cad.outline.segments import Arc, Line, Spline
from mirror_cad.own_files import hand_of
from mirror_cad.reflection import reflected_mesh, reflected_surface
from mirror_cad.spec.file import load_spec
from mirror_cad.stl_file import read_stl
from mirror_studio.as_json import placement_as_json
from mirror_studio.build.pipeline import build, trace_file
from mirror_studio.drive.mirrors import driven_mirror
from mirror_studio.progress import Progress
from mirror_studio.report.heading import contradictions
from mirror_studio.scene_file import load_scene
from raytrace.placement import Placement

SIDEWAYS = np.array([-1.0, 1.0, 1.0])
HANDS = ("left", "right")


def spec_of_hand(hand: str, **sections: dict[str, object]) -> mirror_cad.MirrorSpec:
    spec = load_spec("progressive-c")
    updates: dict[str, object] = {"part": spec.part.model_validate({"hand": hand}),
                                  "view": spec.view.model_copy(update={"width_px": 96})}
    for name, keys in sections.items():
        updates[name] = getattr(spec, name).model_copy(update=keys)
    return spec.model_copy(update=updates)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Both hands of one design, built."""
    folder = tmp_path_factory.mktemp("hands")
    for hand in HANDS:
        build(spec_of_hand(hand), folder / hand, Progress(quiet=True))
    return {hand: folder / hand for hand in HANDS}


def leaves(entry: object, key: str = "") -> dict[str, object]:
    if isinstance(entry, dict):
        return {k: v for name, value in entry.items() for k, v in leaves(value, f"{key}.{name}").items()}
    if isinstance(entry, list):
        return {k: v for number, value in enumerate(entry) for k, v in leaves(value, f"{key}.{number}").items()}
    return {key: entry}


def test_the_right_hand_files_are_the_reflection(pair: dict[str, Path]) -> None:
    left, right = (read_step(pair[hand] / "progressive-c.step").optical_surface() for hand in HANDS)
    x, y = np.meshgrid(np.linspace(-120.0, 120.0, 33), np.linspace(-170.0, 170.0, 35))
    assert right.is_height_field
    assert np.abs(right.sag(-x, y) - left.sag(x, y)).max() < 1e-11  # what STEP's digits leave
    assert np.abs(left.sag(x, y) - left.sag(-x, y)).max() > 1.0  # which is another mirror
    sheets = [read_step(pair[hand] / "progressive-c-surface.step").optical_surface() for hand in HANDS]
    assert np.abs(sheets[1].sag(-x, y) - sheets[0].sag(x, y)).max() < 1e-11
    points = [np.loadtxt(pair[hand] / "progressive-c-points.csv", delimiter=",", skiprows=1) for hand in HANDS]
    mirrored = points[1] * [-1.0, 1.0, 1.0, -1.0, 1.0, 1.0]
    order = [np.lexsort(np.round(each[:, :2], 6).T) for each in (points[0], mirrored)]
    assert np.abs(points[0][order[0]] - mirrored[order[1]]).max() < 1e-9
    assert (np.diff(points[1][:, 1]) >= 0.0).all()  # row by row, as the left-hand one's
    outlines = [read_outline(pair[hand] / "outline.dxf") for hand in HANDS]
    assert np.array_equal(outlines[1].contains(-x, y), outlines[0].contains(x, y))
    assert not np.array_equal(outlines[0].contains(-x, y), outlines[0].contains(x, y))
    # Other triangles may be chosen, but of the same body: Gauss's theorem gives its volume.
    volumes = []
    for hand in HANDS:
        mesh = read_stl(pair[hand] / "progressive-c.stl")
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        volumes.append(float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0))
        low, high = (extreme(mesh.vertices[np.abs(mesh.vertices[:, 1]) > 150.0][:, 0]) for extreme in (np.min, np.max))
        assert (low + high > 0.0) == (hand == "left")  # the high edge is inboard
    assert volumes[1] == pytest.approx(volumes[0], rel=1e-5)
    assert volumes[0] > 0.0


def test_the_files_say_their_hand(pair: dict[str, Path], tmp_path: Path) -> None:
    for hand in HANDS:
        for name in ("progressive-c.step", "progressive-c-surface.step", "progressive-c.stl"):
            assert hand_of(pair[hand] / name) == hand
            assert f"{hand}-hand mirror".encode() in (pair[hand] / name).read_bytes()[:300]
    assert hand_of(pair["left"] / "outline.dxf") is None
    # A file from before they said is left-handed; one of another program says nothing.
    text = (pair["right"] / "progressive-c.step").read_text("ascii")
    (tmp_path / "old.step").write_text(text.replace("right-hand mirror", "Open CASCADE Model"), encoding="ascii")
    assert hand_of(tmp_path / "old.step") == "left"
    shape = read_step(pair["right"] / "progressive-c.step").shape
    write_step(tmp_path / "other.step", [Part(shape, "part", GLASS_COLOUR)], "x")
    (tmp_path / "other.step").write_text(
        (tmp_path / "other.step").read_text("ascii").replace("'mirror-cad',''", "'other',''"), encoding="ascii")
    assert hand_of(tmp_path / "other.step") is None


@pytest.mark.parametrize("name", ["metrics.json", "deviation.json"])
def test_both_hands_have_the_same_measures(name: str, pair: dict[str, Path]) -> None:
    left, right = (leaves(json.loads((pair[hand] / name).read_text("utf-8"))) for hand in HANDS)
    assert left.keys() == right.keys()
    for key, value in left.items():
        if "_at_mm" in key or key.startswith((".files", ".stl_", ".stages.stl", ".stages.integration", ".stages.step",
                                              ".error_budget", ".plate.back")):
            continue  # where a maximum of equals is, what files and facets leave, differences that are rounding alone
        if isinstance(value, float):
            # Curvatures carry 1e-9 of rounding from the fit's poles to those of the file.
            assert right[key] == pytest.approx(value, rel=1e-9, abs=1e-7), key
        else:
            assert right[key] == value, key


def test_the_pictures_are_the_same(pair: dict[str, Path]) -> None:
    from PIL import Image

    left, right = (np.asarray(Image.open(pair[hand] / "driver-view.png")).astype(int) for hand in HANDS)
    assert np.abs(left - right).max() <= 1


@pytest.mark.parametrize("kind", ["step", "stl"])
def test_a_trace_takes_the_hand_from_the_file(kind: str, pair: dict[str, Path], tmp_path: Path) -> None:
    spec = spec_of_hand("left")
    left, right = (trace_file(pair[hand] / f"progressive-c.{kind}", spec, tmp_path / f"{hand}-{kind}", Progress(quiet=True),
                              normals="interpolated") for hand in HANDS)
    assert placement_as_json(right.placement) == placement_as_json(left.placement) | {"hand": "right"}
    same = {"rel": 1e-9} if kind == "step" else {"rel": 2e-3}  # other facets
    assert right.h_fov_deg == pytest.approx(left.h_fov_deg, **same)
    lanes = [each.lane_straightness_percent.traced for each in (left, right)]
    assert (lanes == [None, None]) if kind == "stl" else (lanes[1] == pytest.approx(lanes[0], **same))
    assert right.box_mm == pytest.approx(left.box_mm, abs=1e-3 if kind == "stl" else 1e-9)


def test_a_trace_says_where_specification_and_file_differ(pair: dict[str, Path], tmp_path: Path,
                                                          capsys: pytest.CaptureFixture[str]) -> None:
    trace_file(pair["right"] / "progressive-c.step", spec_of_hand("left"), tmp_path / "out", Progress())
    said = capsys.readouterr().err
    assert "the file has a right-hand mirror, progressive-c states part.hand = \"left\"" in said
    assert "taken as the left-hand one that it is the reflection of" in said


def test_a_script_gets_the_file_s_own_coordinates(pair: dict[str, Path]) -> None:
    raw = raytrace.load_reflector(pair["right"] / "progressive-c.step")
    left = raytrace.load_reflector(pair["left"] / "progressive-c.step")
    eye, to = np.array([115.0, 0.0, 753.3]), np.array([[-0.1, 0.02, -1.0], [-0.22, -0.1, -1.0]])
    one, other = raytrace.reflect(left, eye, to), raytrace.reflect(raw, SIDEWAYS * eye, SIDEWAYS * to)
    assert (one.status == 0).all()
    assert np.abs(SIDEWAYS * other.points - one.points).max() < 1e-10
    assert np.abs(SIDEWAYS * other.directions - one.directions).max() < 1e-12


@pytest.mark.parametrize("scene_hand", HANDS)
def test_drive_reflects_a_mirror_once_and_says_where_it_is_of_the_other_side(
        scene_hand: str, pair: dict[str, Path], tmp_path: Path) -> None:
    scene = load_scene("motorway")
    x, y, z = scene.mirror.centre_m
    side = 1.0 if scene_hand == "right" else -1.0
    section = scene.mirror.model_copy(update={"hand": scene_hand, "centre_m": (x, side * abs(y), z)})
    ex, ey, ez = scene.eyes.middle_m
    eyes = scene.eyes.model_copy(update={"middle_m": (ex, side * abs(ey), ez)})
    scene = scene.model_copy(update={"mirror": section, "eyes": eyes})
    files = {hand: driven_mirror(str(pair[hand] / "progressive-c.step"), scene) for hand in HANDS}
    (tmp_path / "right.toml").write_text(
        'name = "right"\n[part]\nhand = "right"\n[horizontal]\nlaw = "zones"\nright_mm = 1250.0\nleft_mm = 400.0\n'
        'blend_from = "match"\n[horizontal.match]\nsphere_mm = 950.0\n[vertical]\nlaw = "linear"\nright_mm = 1250.0\n'
        'left_mm = 1350.0\n', encoding="utf-8")
    files["specification"] = driven_mirror(str(tmp_path / "right.toml"), scene)
    views = [each.views.middle.trace(np.array([30.0, -80.0]), np.array([10.0, -60.0])) for each in files.values()]
    for view in views[1:]:
        assert np.abs(view.directions - views[0].directions).max() < 1e-9
    assert files["right"].hand == files["specification"].hand == "right"
    assert files[scene_hand].of_other_hand is None
    other = "left" if scene_hand == "right" else "right"
    said = f"by its file a {other}-hand mirror, while the scene's is the {scene_hand}-hand one"
    assert said in str(files[other].of_other_hand)
    assert driven_mirror("progressive-c", scene).of_other_hand is None  # which states none


def test_glass_that_reflects_from_its_back_is_reflected_with_both_faces(tmp_path: Path) -> None:
    reflectors = []
    for hand in HANDS:
        mirror = mirror_cad.design(spec_of_hand(hand, glass={"reflecting": "back"}))
        mirror.export_step(tmp_path / f"{hand}.step")
        reflectors.append(raytrace.load_reflector(tmp_path / f"{hand}.step", place="auto"))
    eye, to = np.array([115.0, 0.0, 753.3]), np.array([[-0.1, 0.02, -1.0], [-0.22, -0.1, -1.0]])
    left, right = (raytrace.reflect(each, eye, to) for each in reflectors)
    assert (left.status == 0).all()
    assert np.abs(left.directions - right.directions).max() < 1e-9


def test_spheres_cylinders_and_planes_are_reflected_as_they_are(tmp_path: Path) -> None:
    from build123d import Box as Block
    from build123d import Cylinder, Pos, Rotation, Sphere

    parts = {"sphere": Pos(20, 5, -900) * Sphere(900) & Block(260, 200, 80),
             "cylinder": Pos(20, 0, -400) * Rotation(90, 0, 10) * Cylinder(400, 600) & Block(260, 200, 80),
             "plane": Pos(15, 0, -10) * Rotation(0, 4, 0) * Block(200, 200, 20)}
    eye, to = np.array([30.0, 10.0, 700.0]), np.array([[0.05, 0.02, -1.0], [-0.1, -0.05, -1.0]])
    for name, part in parts.items():
        write_step(tmp_path / f"{name}.step", [Part(part.wrapped, name, GLASS_COLOUR)], name)
        raw = raytrace.load_reflector(tmp_path / f"{name}.step")
        turned = raw.moved(Placement.identity("file", "right"))
        one, other = raytrace.reflect(raw, eye, to), raytrace.reflect(turned, SIDEWAYS * eye, SIDEWAYS * to)
        assert (one.status == 0).all()
        assert np.array_equal(one.status, other.status)
        assert np.abs(SIDEWAYS * other.points - one.points).max() < 1e-9
        assert np.abs(SIDEWAYS * other.directions - one.directions).max() < 1e-12


def test_reflecting_twice_changes_nothing() -> None:
    mirror = mirror_cad.design(spec_of_hand("right"))
    made = mirror.as_made
    assert made.as_made is made
    again = reflected_surface(made.surface)
    assert np.array_equal(again.poles, mirror.surface.poles)
    assert np.array_equal(again.knots_u, mirror.surface.knots_u)
    mesh = raytrace.Reflector.from_mirror(mirror)
    assert mesh.surface.untrimmed() is not None
    from mirror_cad.mesh import SurfaceMesh

    facets = SurfaceMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]], dtype=np.int32))
    assert np.array_equal(reflected_mesh(reflected_mesh(facets)).faces, facets.faces)
    assert np.allclose(reflected_mesh(facets).facet_normals(), [[0.0, 0.0, 1.0]])


def test_an_outline_of_lines_arcs_and_splines_is_reflected() -> None:
    outline: Outline = closed_outline([
        Line((-50.0, -30.0), (60.0, -30.0)), Arc((60.0, 0.0), 30.0, -np.pi / 2, np.pi),
        Spline(3, np.array([0.0, 0, 0, 0, 1, 1, 1, 1]), np.array([(60.0, 30.0), (20.0, 55.0), (-20.0, 15.0), (-50.0, 30.0)])),
        Line((-50.0, 30.0), (-50.0, -30.0))], "test")
    other = outline.mirrored()
    assert other.area_mm2() == pytest.approx(outline.area_mm2(), rel=1e-14)
    x_min, x_max, y_min, y_max = outline.bounding_box()
    assert other.bounding_box() == pytest.approx((-x_max, -x_min, y_min, y_max), abs=1e-12)
    x, y = np.meshgrid(np.linspace(-95.0, 95.0, 97), np.linspace(-40.0, 60.0, 71))
    assert np.array_equal(other.contains(-x, y), outline.contains(x, y))


def test_a_right_hand_design_is_written_as_the_left_hand_one(tmp_path: Path) -> None:
    assert contradictions(mirror_cad.design(spec_of_hand("right"))) == []
    wrong = mirror_cad.design(spec_of_hand("right", eye={"aligned": "left"}))
    assert "reflected twice" in contradictions(wrong)[0]


def test_cad_scripts_get_the_hand_that_is_asked_for() -> None:
    left, right = (mirror_cad.design(spec_of_hand(hand)).to_build123d().bounding_box() for hand in HANDS)
    assert pytest.approx(-left.max.X, abs=1e-6) == right.min.X
