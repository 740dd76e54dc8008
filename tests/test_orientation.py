"""Concave mirrors: which way round they show things, what they show twice, and that this is said and not measured."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mirror_cad.errors import MirrorError
from mirror_cad.surfaces.quadric import Quadric
from mirror_studio.drive.as_json import figures_as_json
from mirror_studio.drive.measured import asked_of, main_figures, measure
from mirror_studio.drive.mirrors import driven_mirror, on_vehicle
from mirror_studio.drive.pictures import World
from mirror_studio.drive.table import cells, groups_of, orientations
from mirror_studio.scene_file import AimSection, SceneFile, load_scene
from raytrace.measures.eye_fields import eye_fields
from raytrace.measures.ground import seen_widths
from raytrace.reflector import Reflector
from raytrace.surfaces.quadric import QuadricFace
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.pose import Pose
from raytrace.viewing.vehicle import Eyes
from raytrace.viewing.view import View
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.image_points import image_points
from raytrace.visibility.orientation import _eigenvalues, orientation
from raytrace.visibility.plan import visible_intervals
from raytrace.visibility.shows import shows
from tests.test_drive import ROAD, box_glb
from tests.test_ground import is_seen, on_ground
from tests.test_magnification import MIDDLE, STRAIGHT, eye_at, quadric, spline
from tests.test_straight_lines import EYE, OWN

NEAR_MM = 1e-3


def dish(radius: float, half: float = 90.0) -> Reflector:
    """A concave sphere's cap, round, that touches z = 0 at the origin."""
    low = 0.5 * np.pi - np.arcsin(half / radius)
    cap = np.array([[0.0, low], [2 * np.pi, low], [2 * np.pi, 0.5 * np.pi], [0.0, 0.5 * np.pi]])
    down = np.diag([1.0, -1.0, -1.0])
    return Reflector(QuadricFace(Quadric("sphere", np.array([0.0, 0.0, radius]), down, radius), (cap,), -1.0))


def trough(radius: float) -> Reflector:
    """A concave cylinder, upright."""
    bulge = quadric("cylinder", radius).surface
    assert isinstance(bulge, QuadricFace)
    turned = replace(bulge.quadric, centre=-bulge.quadric.centre, axes=bulge.quadric.axes * [[-1.0], [1.0], [-1.0]])
    return Reflector(replace(bulge, quadric=turned, sign=-1.0))


@pytest.mark.parametrize("radius", [950.0, 4000.0])
def test_the_eigenvalues_of_a_sphere_are_those_of_its_closed_form(radius: float) -> None:
    """1 + 2aκ/cos β and 1 + 2aκ·cos β at the middle."""
    beta, a = np.radians(30.0), 800.0
    for reflector, kappa in ((dish(radius), -1.0 / radius), (quadric("sphere", radius), 1.0 / radius)):
        view = View(reflector, STRAIGHT, eye_at(beta, 0.3, a))
        expected = sorted((1.0 + 2.0 * a * kappa / np.cos(beta), 1.0 + 2.0 * a * kappa * np.cos(beta)))
        assert [float(one[0]) for one in _eigenvalues(view, MIDDLE)] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(("reflector", "sense", "twice", "converging"), [
    (quadric("sphere", 950.0), "upright", False, False),
    (quadric("plane", 0.0), "upright", False, False),
    (spline("progressive-c"), "upright", False, False),
    (dish(4000.0), "upright", False, True),  # the eye is nearer than the focal length, 2 m
    (dish(800.0), "inverted", False, True),  # and twice as far away as it
    (trough(600.0), "reversed", False, True),
    (dish(1600.0), "reversed", False, True),  # just about there it is, aslant, beyond the one focus and before the other
    (dish(1703.0), "mixed", True, True),  # 2a/cos β: at the one
])
def test_a_mirror_is_told_by_where_its_focus_is(reflector: Reflector, sense: str, twice: bool, converging: bool) -> None:
    found = orientation(View(reflector, STRAIGHT, eye_at(np.radians(20.0), 0.3, 800.0)))
    assert (found.sense, found.twice, found.converging) == (sense, twice, converging)


def test_what_is_said_to_be_shown_twice_is_and_nothing_else() -> None:
    """By rays: two places far apart that send nearly the same direction, among 40 000 of the mirror."""
    for radius, twice in ((1703.0, True), (1600.0, False), (800.0, False), (4000.0, False)):
        view = View(dish(radius), STRAIGHT, eye_at(np.radians(20.0), 0.3, 800.0))
        x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-90, 90, 200), np.linspace(-90, 90, 200)))
        traced = view.trace_points(np.stack([x, y], axis=1))
        directions, on_mirror = traced.directions[traced.seen], traced.on_mirror[traced.seen][:, :2]
        pairs = cKDTree(directions).query_pairs(1e-4, output_type="ndarray")
        apart = np.linalg.norm(on_mirror[pairs[:, 0]] - on_mirror[pairs[:, 1]], axis=1)
        assert bool((apart > 20.0).any()) == twice


def test_an_inverted_picture_is_measured_exactly() -> None:
    """Widths of the ground and the horizon's field of a mirror beyond its focus, by inverse rays beside their ends."""
    pose = Pose(np.array([-540.0, -1010.0, 1760.0]), np.zeros(3), np.radians(20.0), np.radians(4.0))
    eyes = Eyes(EYE)
    views = EyeViews.of(dish(500.0), pose, eyes)
    assert orientation(views.left).sense == "inverted"
    ends = 0
    for one in seen_widths(views.left, views.right, OWN, (10_000.0, 30_000.0)):
        for low, high in one.either:
            points = on_ground(np.full(4, one.x_mm), np.array([low - NEAR_MM, low + NEAR_MM, high - NEAR_MM, high + NEAR_MM]))
            seen = is_seen(views.left, points, OWN) | is_seen(views.right, points, OWN)
            assert seen.tolist() == [False, True, True, False]
            ends += 2
    assert ends >= 4
    field = eye_fields(views)
    for view, seen_at in ((views.left, field.horizon.left), (views.right, field.horizon.right)):
        (low, high), = seen_at
        angles = np.radians(np.array([low - 1e-7, low + 1e-7, 0.5 * (low + high), high - 1e-7, high + 1e-7]))
        directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(5)], axis=1)
        assert image_points(view, directions, at_infinity=True)[1].tolist() == [False, True, True, True, False]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> SceneFile:
    folder = tmp_path_factory.mktemp("dish")
    box_glb(folder / "box.glb")
    (folder / "street.toml").write_text(ROAD.replace("[aim]\nflank_share = 0.12\nhorizon_share = 0.6", "[mirror]\n"
                                                     "yaw_deg = 21.0\npitch_deg = 4.0"), encoding="utf-8")
    return load_scene(folder / "street.toml")


def test_what_is_shown_twice_is_not_measured_and_the_table_says_so(scene: SceneFile) -> None:
    subject = asked_of(scene, {name: body for name, body in World(scene).named if name})
    seen = [measure(on_vehicle("dish", dish(radius), scene), subject) for radius in (800.0, 1600.0)]
    once, twice = (figures_as_json(each) for each in seen)
    assert once["image"] == {"way": "upside down and left for right", "twice": False}
    assert once["field_deg"]["horizon_either"] > 0.0
    assert twice["image"] == {"way": "some things twice", "twice": True}
    assert twice["magnification"]["horizontal"]["middle"] > 1.0
    json.dumps([once, twice], allow_nan=False)
    rows = {row.name: row for _, rows in groups_of(seen[1:]) for row in rows}
    assert set(rows) == {row.name for _, rows in groups_of(seen[:1]) for row in rows}
    assert orientations(seen) == ["upside down and left for right", "some things twice"]
    for name in ("horizon_either_deg", "lane_bow_arcmin", "ground_width_4_m_either_m", "blind_length_m"):
        assert cells(rows[name], seen[1:]) == ["—"]
        assert twice["measures"][name] is None
    # As aimed it is shown twice: turned away by 10° it need not be.
    middle = len(twice["turned"]["yaw_deg"]) // 2
    assert twice["turned"]["blind_length_m"][middle] is None
    shown = main_figures(on_vehicle("dish", dish(1600.0), scene), subject)
    assert shown.blind_length_m is None
    assert shown.flank_share is None or 0.0 <= float(shown.flank_share) <= 1.0


def test_a_zone_that_goes_on_is_marked_wherever_it_is_told(scene: SceneFile) -> None:
    """A mirror that looks at the sky shows nothing of the lane: it is in no view as far as it is looked at."""
    subject = asked_of(scene, {name: body for name, body in World(scene).named if name})
    away = on_vehicle("ball", quadric("sphere", 950.0), scene).turned(0.0, np.radians(30.0))
    assert main_figures(away, subject).blind_endless is True
    found = figures_as_json(measure(away, subject))
    assert found["blind_zone"]["at"][0]["endless"] is True
    middle = len(found["turned"]["yaw_deg"]) // 2
    assert found["turned"]["blind_endless"][middle] is True
    usual = on_vehicle("ball", quadric("sphere", 950.0), scene)
    assert main_figures(usual, subject).blind_endless is False


def test_concave_and_whole_spheres_of_another_program_are_driven_or_refused(tmp_path: Path, scene: SceneFile) -> None:
    """A solid all of whose faces reflect; a ball that has no place for an aim, and one that is not aimed."""
    from build123d import Cylinder, Pos, Sphere

    from mirror_cad.occt.step import Part, write_step

    subject = asked_of(scene, {name: body for name, body in World(scene).named if name})
    bowl = Pos(0, 0, -15) * Cylinder(97.0, 30) - Pos(0, 0, 945) * Sphere(950)
    for name, shape in (("bowl", bowl), ("ball", Sphere(150))):
        write_step(tmp_path / f"{name}.step", [Part(shape.wrapped, name)], name)
    found = figures_as_json(measure(driven_mirror(str(tmp_path / "bowl.step"), scene), subject))
    assert found["image"]["way"] == "upside down and left for right"
    ball = figures_as_json(measure(driven_mirror(str(tmp_path / "ball.step"), scene), subject))
    assert ball["image"]["way"] == "upright"
    # Its rim is where it turns by 60° from its front: it shows some 240° of the world but for what hides it.
    assert 60.0 < ball["field_deg"]["horizon_either"] < 240.0
    aimed = scene.model_copy(update={"aim": AimSection(), "mirror": scene.mirror.model_copy(update={"yaw_deg": None})})
    with pytest.raises(MirrorError, match="ball: aim: no yaw and pitch"):
        driven_mirror(str(tmp_path / "ball.step"), aimed)


def test_a_ball_shows_what_inverse_rays_show() -> None:
    """More than half of the world, lines from end to end among it, up to where it turns by 60° from its front.

    Not at its limb, along which it shows what lies ahead: there the inverse ray is not found.
    """
    loop = np.array([[0.0, -0.5 * np.pi], [2 * np.pi, -0.5 * np.pi], [2 * np.pi, 0.5 * np.pi], [0.0, 0.5 * np.pi]])
    ball = Reflector(QuadricFace(Quadric("sphere", np.array([0.0, 0.0, -150.0]), np.eye(3), 150.0), (loop,)))
    pose = Pose(np.array([-540.0, -1010.0, 1760.0]), np.zeros(3), np.radians(10.0), 0.0)
    view = View(ball, pose, EYE)
    edge = edge_of(view)

    x, y = np.array([0.0, 500.0, 3000.0, 8000.0, 30_000.0]), np.array([-15_000.0, -4000.0, -1500.0, 700.0, 9000.0])
    for axis, values, along in ((0, x, y), (1, y, x)):
        spans = visible_intervals(edge, axis, values)  # type: ignore[arg-type]
        for row, value in enumerate(values):
            points = on_ground(np.full(5, value), along) if axis == 0 else on_ground(along, np.full(5, value))
            seen = [bool(((low < at) & (at < high)).any()) for at in along for low, high in [spans.of(row).T]]
            assert seen == edge.image_points(points)[1].tolist(), (axis, value)
    # The horizon by rays forward: level ones of a fine grid, counted by whole degrees.
    (low, high), = eye_fields(EyeViews(view, view, view)).horizon.left
    assert high - low > 200.0
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-200.0, 200.0, 3000), np.linspace(-100.0, 150.0, 1000)))
    on_plane = np.stack([x, y], axis=1)
    traced = view.trace_points(on_plane)
    level = shows(view, on_plane, traced) & (np.abs(traced.directions[:, 2]) < 2e-3)
    azimuth = np.degrees(np.arctan2(traced.directions[level, 1], traced.directions[level, 0]))
    assert low - 0.2 < azimuth.min() < low + 1.0  # the limb, along which little of the picture shows much
    assert high - 0.2 < azimuth.max() < high + 0.2
    assert len(np.unique(np.round(azimuth))) == round(azimuth.max()) - round(azimuth.min()) + 1
