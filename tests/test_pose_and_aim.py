"""A mirror on a vehicle: where it shows what, against plane geometry, and how it is aimed."""

from __future__ import annotations

import time

import numpy as np
import pytest

import raytrace
from mirror_cad.mesh import SurfaceMesh
from raytrace.errors import TraceError
from raytrace.surfaces.inset import AROUND
from raytrace.viewing.aim import Aim, RearEdge, aimed, shown_aim
from raytrace.viewing.bezel import RIM_STEPS, housing, visible_aperture
from raytrace.viewing.pose import Pose
from raytrace.viewing.vehicle import Eyes, HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.image_points import image_points
from tests.conftest import designed

EYE = np.array([0.0, -490.0, 1900.0])
CENTRE = np.array([-540.0, -1010.0, 1760.0])
PIVOT = np.array([0.0, 0.0, -40.0])
EDGE = RearEdge(3900.0, -870.0)
WANTED = Aim(flank=0.12, horizon=0.6)
SIDEWAYS = np.array([1.0, -1.0, 1.0])


def posed(yaw_deg: float = 0.0, pitch_deg: float = 0.0, **more: object) -> Pose:
    return Pose(CENTRE, PIVOT, np.radians(yaw_deg), np.radians(pitch_deg), **more)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def plane() -> raytrace.Reflector:
    corners = np.array([[-115.0, -160, 0], [115, -160, 0], [115, 160, 0], [-115, 160, 0]])
    return raytrace.Reflector.of_mesh(SurfaceMesh(corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)))


@pytest.fixture(scope="module")
def progressive() -> raytrace.Reflector:
    return raytrace.Reflector.from_mirror(designed("progressive-c"))


def test_a_straight_mirror_faces_rearward_with_its_x_to_the_right_and_its_y_up() -> None:
    pose = posed()
    assert np.array_equal(pose.directions_to_vehicle(np.eye(3)), [[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    assert np.allclose(pose.to_vehicle(np.zeros(3)), CENTRE, rtol=0, atol=1e-12)


def test_yaw_turns_the_face_inboard_and_pitch_upwards_on_either_side() -> None:
    for hand, inboard in (("left", 1.0), ("right", -1.0)):
        face = posed(10.0, 0.0, hand=hand).directions_to_vehicle(np.array([0.0, 0.0, 1.0]))
        assert face == pytest.approx([np.cos(np.radians(10)), inboard * np.sin(np.radians(10)), 0.0], abs=1e-15)
        upwards = posed(10.0, 5.0, hand=hand).directions_to_vehicle(np.array([0.0, 0.0, 1.0]))[2]
        assert upwards == pytest.approx(np.sin(np.radians(5.0)), abs=1e-15)


def test_a_pose_is_rigid_and_leaves_the_pivot_where_it_is() -> None:
    points = np.random.default_rng(3).normal(size=(20, 3)) * 200.0
    for pose in (posed(23.0, -7.0), posed(23.0, -7.0, hand="right")):
        assert np.allclose(pose.to_mirror(pose.to_vehicle(points)), points, rtol=0, atol=1e-11)
        assert np.linalg.det(pose.rotation) == pytest.approx(1.0 if pose.hand == "left" else -1.0, abs=1e-14)
        assert np.allclose(pose.to_vehicle(PIVOT), posed(hand=pose.hand).to_vehicle(PIVOT), rtol=0, atol=1e-11)


def test_a_plane_mirror_shows_a_point_on_the_line_to_its_image(plane: raytrace.Reflector) -> None:
    """The image lies as far behind the plane z = 0 as the point before it."""
    view = View(plane, posed(18.0, 2.0), EYE)
    points = np.random.default_rng(4).uniform([500, -6000, -500], [60_000, -900, 3000], (200, 3))
    image = view.pose.to_mirror(points) * [1.0, 1.0, -1.0]
    eye = view.eye_in_mirror
    expected = (eye + (image - eye) * (eye[2] / (eye[2] - image[:, 2]))[:, None])[:, :2]
    on_it = (np.abs(expected) < [115, 160]).all(axis=1)
    places, shown = image_points(view, points)
    assert on_it.sum() > 20
    assert np.array_equal(shown, on_it)
    assert np.allclose(places[on_it], expected[on_it], rtol=0, atol=1e-6)  # 1e-10 rad at 0.7 m


@pytest.mark.parametrize("hand", ["left", "right"])
def test_what_a_ray_meets_is_found_again_where_the_ray_went(progressive: raytrace.Reflector, hand: str) -> None:
    eye = EYE if hand == "left" else EYE * SIDEWAYS
    view = View(progressive, posed(15.0, 3.0, hand=hand), eye)
    x, y = np.meshgrid(np.linspace(-110, 110, 21), np.linspace(-140, 140, 21))
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    traced = view.trace_points(places)
    for at_infinity, targets in ((False, traced.points + 7000.0 * traced.directions), (True, traced.directions)):
        found, shown = image_points(view, targets[traced.seen], at_infinity)
        assert shown.all()
        assert np.allclose(found, places[traced.seen], rtol=0, atol=1e-6)


def test_the_right_hand_mirror_shows_the_reflected_world(progressive: raytrace.Reflector) -> None:
    left = View(progressive, posed(15.0, 3.0), EYE)
    right = View(progressive, posed(15.0, 3.0, hand="right"), EYE * SIDEWAYS)
    places = np.random.default_rng(5).uniform(-100.0, 100.0, (50, 2))
    one, other = left.trace_points(places), right.trace_points(places)
    assert np.allclose(one.points * SIDEWAYS, other.points, rtol=0, atol=1e-9)
    assert np.allclose(one.directions * SIDEWAYS, other.directions, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["progressive-c", "sphere-950", "flat", "european-aspheric"])
def test_mirrors_at_equal_aim_show_the_same_flank_and_horizon(name: str) -> None:
    """What was asked for is found again by searching the mirror for the flank's end and the horizon, to 1e-9 of its size:
    1e-8 degrees of aim move a far thing by some 1e-9 of the width."""
    reflector = raytrace.Reflector.from_mirror(designed(name))
    pose = aimed(reflector, posed(), EYE, EDGE, WANTED)
    shown = shown_aim(reflector, pose, EYE, EDGE)
    assert shown.flank == pytest.approx(WANTED.flank, abs=1e-9)
    assert shown.horizon == pytest.approx(WANTED.horizon, abs=1e-9)


def test_an_aim_is_solved_within_a_fifth_of_a_second(progressive: raytrace.Reflector) -> None:
    aimed(progressive, posed(), EYE, EDGE, WANTED)  # compiles, or loads what was compiled
    times = []
    for _ in range(5):
        start = time.process_time()
        aimed(progressive, posed(), EYE, EDGE, WANTED)
        times.append(time.process_time() - start)
    assert min(times) <= 0.2


def test_an_aimed_plane_mirror_halves_the_angles(plane: raytrace.Reflector) -> None:
    """By hand: the eye's image in the posed plane sees the rear edge through F and the horizon through H."""
    pose = aimed(plane, posed(), EYE, EDGE, WANTED)
    at = View(plane, pose, EYE).eye_in_mirror
    image = pose.to_vehicle(at * [1.0, 1.0, -1.0])
    f, h = (pose.to_vehicle(np.array([x, -160.0 + 0.6 * 320.0, 0.0])) for x in (115.0 - 0.12 * 230.0, 0.0))
    assert (h - image)[2] == pytest.approx(0.0, abs=np.radians(1e-6) * np.linalg.norm(h - image))
    past = image + (f - image) * (EDGE.x_mm - image[0]) / (f - image)[0]
    assert past[1] == pytest.approx(EDGE.y_mm, abs=np.radians(1e-6) * EDGE.x_mm)


def test_an_aim_without_a_solution_is_refused_with_its_numbers(progressive: raytrace.Reflector) -> None:
    with pytest.raises(TraceError, match=r"aim: no yaw and pitch shows the host vehicle's flank on 12 % of the width"):
        aimed(progressive, posed(), EYE, RearEdge(-2000.0, -870.0), WANTED)  # a vehicle that ends before its mirror


@pytest.mark.parametrize(("pose", "eye", "message"), [
    (posed(80.0, 60.0), np.array([0.0, -1900.0, 1000.0]), "behind the face of the mirror, which is turned away from it"),
    (posed(), np.array([-2000.0, -490.0, 1900.0]), "behind the face of the mirror"),
    (posed(), CENTRE + [-5.0, 10.0, 10.0], "is inside the mirror"),
])
def test_an_eye_that_cannot_look_into_the_mirror_is_refused(progressive: raytrace.Reflector, pose: Pose, eye: np.ndarray,
                                                             message: str) -> None:
    with pytest.raises(TraceError, match=message):
        View(progressive, pose, eye)


def test_the_own_vehicle_hides_what_a_way_through_its_box_leads_to() -> None:
    vehicle = HostVehicle(870.0, 0.0, 3900.0, 2200.0)
    start = np.array([-540.0, -1010.0, 1760.0])
    ends = np.array([[3000.0, -1000.0, 0.0],   # beside it
                     [3000.0, -800.0, 1000.0],  # inside it
                     [5000.0, 0.0, 0.0],       # behind it
                     [60_000.0, 2000.0, 30_000.0],  # over its roof
                     [np.nan, 0.0, 0.0]])
    assert vehicle.hides(start, ends).tolist() == [False, True, True, False, False]
    assert not vehicle.hides(np.array([-500.0, -870.0, 500.0]), np.array([[9000.0, -870.0, 500.0]]))[0]  # along its side


def test_the_eyes_are_apart_across_the_vehicle() -> None:
    eyes = Eyes(EYE, 65.0)
    assert np.array_equal(eyes.right - eyes.left, [0.0, 65.0, 0.0])
    assert np.array_equal(0.5 * (eyes.left + eyes.right), EYE)


# --- bezel ------------------------------------------------------------------------------------------------------------


def test_a_bezel_leaves_what_is_farther_from_the_edge_than_it_reaches(progressive: raytrace.Reflector) -> None:
    """Against the outline's own distance, on a grid; 0.01 mm beside the bezel's edge are left out."""
    over = 6.0
    cut = visible_aperture(progressive, over)
    outline = designed("progressive-c").outline.polyline(1e-4)
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(-118.3, 118.9, 120), np.linspace(-168.1, 168.7, 170)))
    places = np.stack([x, y], axis=1)
    a, b = outline, np.roll(outline, -1, axis=0)
    along = b - a
    t = np.clip(np.einsum("nij,ij->ni", places[:, None] - a, along) / np.einsum("ij,ij->i", along, along), 0.0, 1.0)
    distance = np.linalg.norm(places[:, None] - a - t[..., None] * along, axis=2).min(axis=1)
    inside = np.array(designed("progressive-c").outline.contains(x, y))
    sure = np.abs(distance - over) > 0.01
    down = np.broadcast_to([0.0, 0.0, -1.0], (len(places), 3))
    trace = raytrace.reflect(cut, np.column_stack([places, np.full(len(places), 300.0)]), down)
    assert np.array_equal((trace.status == 0)[sure], (inside & (distance > over))[sure])


def test_a_bezel_over_everything_and_one_over_a_mesh_are_refused(progressive: raytrace.Reflector,
                                                                 plane: raytrace.Reflector) -> None:
    with pytest.raises(TraceError, match="leaves nothing of the mirror to see"):
        visible_aperture(progressive, 200.0)
    with pytest.raises(TraceError, match="one B-spline with u = x, v = y"):
        visible_aperture(plane, 5.0)


def test_the_housing_is_a_closed_shell_that_leaves_the_mirror_free(progressive: raytrace.Reflector,
                                                                   plane: raytrace.Reflector) -> None:
    for reflector in (progressive, plane):
        shell = housing(reflector)
        corners = shell.vertices[shell.faces]
        # Behind the rim, sideways and backwards, its faces look outwards.
        middle, normal = corners.mean(axis=1), np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        outward = np.einsum("ij,ij->i", normal, middle - shell.vertices.mean(axis=0))
        assert (outward[2 * AROUND * RIM_STEPS:] > 0.0).all()
    seen = View(progressive, posed(15.0, 3.0), EYE)
    with_housing = View(raytrace.Reflector(progressive.surface, obstacles=housing(progressive)), seen.pose, EYE)
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(-90, 90, 30), np.linspace(-110, 110, 30)))
    places = np.stack([x, y], axis=1)
    assert np.array_equal(seen.trace_points(places).seen, with_housing.trace_points(places).seen)

