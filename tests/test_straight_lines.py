"""Straight lines of the world in a mirror: bow, tilt and straightness against closed forms and the paper's reference plane."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

import mirror_cad
import raytrace
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.surfaces.quadric import Quadric
from raytrace.measures.column_tilt import column_tilt
from raytrace.measures.lane import lane_straightness_percent
from raytrace.measures.line_bow import ARCMIN, line_bow
from raytrace.measures.road_straightness import road_straightness
from raytrace.measures.straight_lane import StraightLane
from raytrace.reflector import Reflector
from raytrace.roots import roots
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.plate import Plate
from raytrace.surfaces.quadric import QuadricFace
from raytrace.viewing.aim import Aim, aimed
from raytrace.viewing.eye import eye_position
from raytrace.viewing.pose import SIDEWAYS, Pose
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.contour import visibility_contour
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.image_points import image_points
from raytrace.visibility.line_image import LineView, StraightLine, column, line_images, road_line
from raytrace.visibility.occlusion import grazing_functions
from tests.conftest import constant, designed, face_of, spec_of
from tests.meshes import grid

Array = NDArray[np.float64]

EYE = np.array([0.0, -490.0, 1900.0])
CENTRE = np.array([-540.0, -1010.0, 1760.0])
OWN = HostVehicle(870.0, 0.0, 3900.0, 2200.0)
BOX = (-115.0, 115.0, -163.45, 163.45)
ROUNDING = 1e-6  # arc minutes: places are found to 1e-10 radians of a reflected ray, 3e-7′
LINES = (road_line(-1750.0), road_line(-5250.0), road_line(-5250.0, 0.0, 60_000.0), column(20_000.0, -5500.0, 6000.0),
         column(8_000.0, -4000.0, 6000.0))


@cache
def posed(name: str) -> tuple[Reflector, Pose]:
    """A preset aimed as a driver does."""
    reflector = Reflector.from_mirror(designed(name))
    return reflector, aimed(reflector, Pose(CENTRE, np.zeros(3)), EYE, OWN.rear_edge("left"), Aim(0.12, 0.6))


def view_of(name: str) -> View:
    reflector, pose = posed(name)
    return View(reflector, pose, EYE)


def flat(yaw_deg: float = 22.0, pitch_deg: float = 3.0) -> View:
    mirror = mirror_cad.design(spec_of(constant(float("inf")), constant(float("inf"))))
    return View(Reflector.from_mirror(mirror), Pose(CENTRE, np.zeros(3), np.radians(yaw_deg), np.radians(pitch_deg)), EYE)


def ball(radius: float = 950.0) -> Reflector:
    """A cap of a true sphere, 230 × 300 mm about, that touches z = 0 from below."""
    half_u, half_v = 115.0 / radius, 150.0 / radius
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # u = v = 0 looks along z
    loop = np.array([[-half_u, -half_v], [half_u, -half_v], [half_u, half_v], [-half_u, half_v]])
    return Reflector(QuadricFace(Quadric("sphere", np.array([0.0, 0.0, -radius]), axes, radius), (loop,)))


def upright_cylinder(radius: float = 900.0) -> Reflector:
    """A cap of a cylinder about the mirror's y axis that touches z = 0 from below."""
    axes = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    half = 115.0 / radius
    loop = np.array([[-half, -150.0], [half, -150.0], [half, 150.0], [-half, 150.0]])
    return Reflector(QuadricFace(Quadric("cylinder", np.array([0.0, 0.0, -radius]), axes, radius), (loop,)))


def seen_off_sphere(eye: Array, point: Array, centre: Array, radius: float) -> Array:
    """The unit direction in which an eye sees a point in a convex sphere: in the plane of both and the centre, where the
    normal halves the angle."""
    a, b = eye - centre, point - centre
    first = a / np.linalg.norm(a)
    second = b - (b @ first) * first
    second /= np.linalg.norm(second)

    def unequal(angle: float) -> float:
        normal = np.cos(angle) * first + np.sin(angle) * second
        to_eye, to_point = a - radius * normal, b - radius * normal
        across = np.cos(angle) * second - np.sin(angle) * first
        return float(across @ (to_eye / np.linalg.norm(to_eye) + to_point / np.linalg.norm(to_point)))

    angle = brentq(unequal, 0.0, np.arccos(np.clip(first @ b / np.linalg.norm(b), -1.0, 1.0)), xtol=1e-15)
    place = radius * (np.cos(angle) * first + np.sin(angle) * second) - a
    return place / np.linalg.norm(place)


# --- closed forms -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("line", LINES)
def test_a_flat_mirror_bends_no_line_and_adds_no_tilt(line: StraightLine) -> None:
    for view in (flat(), flat(20.0, -2.0)):
        bow, tilt = line_bow(view, line, OWN), column_tilt(view, line, OWN) if line.direction[2] == 1.0 else None
        straightness = road_straightness(view, line, OWN)
        assert bow is None or abs(bow.arcmin) < ROUNDING
        assert tilt is None or abs(tilt.by_curvature_arcmin) < ROUNDING
        assert straightness is None or abs(straightness.percent) < 1e-4  # the tangent's differences of places
    assert (line_bow(flat(), line) is not None) == any(line is each for each in LINES[:3])  # it is narrow


def test_a_pitched_flat_mirror_leans_a_vertical_as_a_turned_plane_does() -> None:
    """Upright and flat, no tilt at all; pitched, that of the vertical's reflection in the plane: Z − 2(Z·n)n."""
    line = column(15_000.0, -3000.0, 5000.0)
    upright = column_tilt(flat(22.0, 0.0), line)
    assert upright is not None
    assert abs(upright.arcmin) < ROUNDING
    view = flat(22.0, 4.0)
    tilt = column_tilt(view, line)
    assert tilt is not None
    normal = view.pose.rotation[:, 2]
    ends = line.at(tilt.image.along_mm[[0, -1]])
    seen = ends - 2.0 * ((ends - view.pose.offset) @ normal)[:, None] * normal - EYE
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    middle = seen.sum(axis=0)
    planes = np.cross(seen[0], seen[1]), np.cross(middle, [0.0, 0.0, 1.0])
    between = np.arccos(abs(planes[0] @ planes[1]) / np.linalg.norm(planes[0]) / np.linalg.norm(planes[1]))
    assert abs(tilt.arcmin) == pytest.approx(ARCMIN * between, abs=1e-5)
    assert abs(tilt.arcmin) > 60.0


def test_lines_in_a_sphere_are_seen_where_the_normal_halves_the_angle() -> None:
    """Bow, tilt and extent from another working-out: one equation in one plane a point."""
    pose = Pose(CENTRE, np.zeros(3), np.radians(14.0), np.radians(2.7))
    view = View(ball(), pose, EYE)
    centre = pose.to_vehicle(np.array([0.0, 0.0, -950.0]))
    for line in (road_line(-1750.0, 0.0, 80_000.0), road_line(-5250.0, 0.0, 80_000.0), column(20_000.0, -5500.0, 6000.0)):
        bow = line_bow(view, line)
        assert bow is not None
        seen = np.array([seen_off_sphere(EYE, point, centre, 950.0) for point in line.at(bow.image.along_mm)])
        assert np.linalg.norm(seen - bow.image.directions, axis=1).max() < 1e-9
        worst = seen_off_sphere(EYE, line.at(np.array([bow.along_mm]))[0], centre, 950.0)
        normal = np.cross(seen[0], seen[-1])
        assert abs(bow.arcmin) == pytest.approx(ARCMIN * abs(np.arcsin(worst @ normal / np.linalg.norm(normal))), abs=1e-5)
        tilt = column_tilt(view, line)
        assert tilt is not None
        middle = seen[0] + seen[-1]
        upright = np.cross(middle, [0.0, 0.0, 1.0])
        cosine = normal @ upright / np.linalg.norm(normal) / np.linalg.norm(upright)
        assert np.cos(tilt.arcmin / ARCMIN) == pytest.approx(abs(cosine), abs=1e-9)


def test_what_a_sphere_adds_to_a_columns_tilt_is_over_the_plane_that_touches_it_at_the_images_middle() -> None:
    """The eye's image in that plane sees the column's ends directly; the plane from the sphere alone."""
    pose = Pose(CENTRE, np.zeros(3), np.radians(14.0), np.radians(6.0))
    view, centre = View(ball(600.0), pose, EYE), pose.to_vehicle(np.array([0.0, 0.0, -600.0]))
    tilt = column_tilt(view, column(9_000.0, -5500.0, 6000.0))
    assert tilt is not None
    middle = tilt.image.on_plane[[0, -1]].mean(axis=0)
    ray = pose.to_vehicle(np.array([*middle, 0.0])) - EYE
    ray /= np.linalg.norm(ray)
    along = (centre - EYE) @ ray
    foot = EYE + (along - np.sqrt(along**2 - ((centre - EYE) @ (centre - EYE) - 600.0**2))) * ray
    normal = (foot - centre) / 600.0
    behind = EYE - 2.0 * ((EYE - foot) @ normal) * normal
    ends = column(9_000.0, -5500.0, 6000.0).at(tilt.image.along_mm[[0, -1]]) - behind
    low, high = (end - 2.0 * (end @ normal) * normal for end in ends)  # as the mirror turns them over
    low, high = low / np.linalg.norm(low), high / np.linalg.norm(high)
    plane, upright = np.cross(low, high), np.cross(low + high, [0.0, 0.0, 1.0])
    cosine = plane @ upright / np.linalg.norm(plane) / np.linalg.norm(upright)
    assert abs(tilt.flat_arcmin) == pytest.approx(ARCMIN * np.arccos(abs(cosine)), rel=1e-6)
    assert abs(tilt.flat_arcmin) > 60.0
    assert tilt.by_curvature_arcmin == tilt.arcmin - tilt.flat_arcmin


def test_lines_in_a_plane_of_symmetry_stay_straight() -> None:
    """The plane of the eye and a sphere's centre, and the level plane of the eye and an upright cylinder: every normal in them
    lies in them, so all of the image does."""
    pose = Pose(CENTRE, np.zeros(3), np.radians(14.0), np.radians(2.7))
    view = View(ball(), pose, EYE)
    centre = pose.to_vehicle(np.array([0.0, 0.0, -950.0]))
    traced = view.trace_points(np.array([[20.0, 10.0]]))
    along = (centre - EYE) / np.linalg.norm(centre - EYE)  # in the plane of eye, centre, and all of this ray
    bow = line_bow(view, StraightLine(traced.points[0] + 20_000.0 * traced.directions[0] - 1500.0 * along, along, 3000.0))
    assert bow is not None
    assert bow.extent_arcmin > 60.0
    assert abs(bow.arcmin) < ROUNDING
    level = View(upright_cylinder(), Pose(CENTRE, np.zeros(3), np.radians(20.0)), EYE)
    bow = line_bow(level, StraightLine(np.array([3000.0, -4000.0, EYE[2]]), np.array([1.0, 0.0, 0.0]), 40_000.0))
    assert bow is not None
    assert bow.extent_arcmin > 200.0
    assert abs(bow.arcmin) < ROUNDING


@pytest.mark.parametrize(("name", "percent"), [("progressive-a", 27.57), ("progressive-b", 28.28), ("progressive-c", 40.91)])
def test_the_papers_lane_as_a_line_of_the_world_has_the_reference_planes_figure(name: str, percent: float) -> None:
    """A straight mirror before the plane X = 8.2 m behind the eye, the lane on it: two ways to the same percentage."""
    mirror = designed(name)
    eye = eye_position(762.0, "right", BOX)
    lane = StraightLane(0.0, 2400.0, 0.6, eye[2] + 8200.0)
    pose = Pose(np.zeros(3), np.zeros(3))
    view = View(Reflector.from_mirror(mirror), pose, pose.to_vehicle(eye))
    at_share = np.array([0.0, 1.0, 0.6]) / np.hypot(1.0, 0.6)
    line = StraightLine(np.array([lane.plane_z_mm, -9000.0, 2400.0 - 0.6 * 9000.0]), at_share, 14_000.0)
    found = road_straightness(view, line)
    assert found is not None
    assert found.image.ends == ("edge", "edge")
    # The outline is a polygon of chords of 1e-5 mm; the tangents' differences make 1e-6 of it.
    assert found.percent == pytest.approx(lane_straightness_percent(face_of(mirror), eye, lane, BOX), abs=1e-3)
    assert found.percent == pytest.approx(percent, abs=0.01)


# --- the road -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "percents", "bows", "first_order"), [
    ("progressive-a", (27.57, 31.30, 15.83, 18.90, 19.36, 18.39), (21.2, 39.1, 17.6), (21.92, 14.47, 11.54)),
    ("progressive-b", (28.28, 31.60, 16.05, 19.03, 19.45, 18.19), (18.5, 40.1, 18.4), (22.75, 15.13, 12.14)),
    ("progressive-c", (40.91, 41.81, 25.00, 26.62, 27.30, 25.54), (12.5, 45.5, 22.0), (35.93, 25.95, 22.25)),
    ("sphere-950", (16.77, 18.88, 4.86, 4.25, 4.28, 3.98), (20.2, 5.2, -0.6), (12.10, 3.92, 0.89))])
def test_figures_of_the_derivation(name: str, percents: tuple[float, ...], bows: tuple[float, ...],
                                   first_order: tuple[float, ...]) -> None:
    """docs/derivations/straight-lines.md: from the paper's lane to the road's line, one change at a time; bow; and that the
    percentage of a low lane depends on where it crosses the level of the middle, not on its slope."""
    view, line = view_of(name), road_line(-5250.0)
    surface = face_of(designed(name))
    found = road_straightness(view, line, OWN)
    assert found is not None
    papers, eye = eye_position(762.0, "right", BOX), view.eye_in_mirror

    def lane_at(depth: float) -> StraightLane:
        """The line on a plane that hides the road's from the mirror's middle."""
        normal = np.cross(view.pose.to_mirror(line.start), view.pose.directions_to_mirror(line.direction))
        return StraightLane(0.0, -normal[2] * depth / normal[1], -normal[0] / normal[1], depth)

    plane, behind, seen = papers[2] + 8200.0, eye[2] + 8200.0, (found.near[0], found.far[0], *BOX[2:])
    chain = ((papers, StraightLane(0.0, 2400.0, 0.6, plane), BOX), (eye, StraightLane(0.0, 2400.0, 0.6, behind), BOX),
             (eye, lane_at(behind), BOX), (eye, lane_at(behind), seen), (eye, lane_at(1e8), seen))
    figures = [lane_straightness_percent(surface, at, lane, box) for at, lane, box in chain]
    assert [*figures, found.percent] == pytest.approx(list(percents), abs=0.006)
    for y, arcmin in zip((-1750.0, -5250.0, -8750.0), bows, strict=True):
        bow = line_bow(view, road_line(y), OWN)
        assert bow is not None
        assert bow.arcmin == pytest.approx(arcmin, abs=0.06)
    for x_0, percent in zip((-4000.0, -1145.0, 0.0), first_order, strict=True):
        low = [lane_straightness_percent(surface, papers, StraightLane(0.0, -x_0 * m, m, plane), BOX) for m in (0.01, 0.02)]
        assert low == pytest.approx([percent, percent], abs=0.02)


def test_ends_are_exact() -> None:
    """At the edge: a micrometre inside the image the line is shown, a micrometre beyond not. Behind the vehicle: it touches."""
    view = view_of("progressive-c")
    image = line_images(view, road_line(-5250.0), OWN)[0]
    assert image.ends == ("edge", "line")
    near = image.along_mm[0]
    assert image_points(view, road_line(-5250.0).at(near + np.array([-1e-2, 1e-2])))[1].tolist() == [False, True]
    assert np.isinf(image.along_mm[-1])
    rearward = image_points(view, np.array([[1.0, 0.0, 0.0]]), at_infinity=True)[0]
    assert rearward[0] == pytest.approx(image.on_plane[-1], abs=1e-6)
    # A line across the road behind the vehicle, from the adjacent lane to behind its rear.
    across = StraightLine(np.array([20_000.0, -6000.0, 0.0]), np.array([0.0, 1.0, 0.0]), 8000.0)
    hidden = line_images(view, across, OWN)[0]
    assert hidden.ends == ("line", "hidden")
    q = view.trace_points(hidden.on_plane[-1:]).points
    assert np.abs(grazing_functions(OWN, q, across.at(hidden.along_mm[-1:]))).min() < 1e-6
    # In plan, the way from the mirror to the last point seen passes the vehicle's rear corner.
    end = across.at(hidden.along_mm[-1:])[0]
    passes = q[0, 1] + (end[1] - q[0, 1]) * (3900.0 - q[0, 0]) / (end[0] - q[0, 0])
    assert passes == pytest.approx(-870.0, abs=1e-4)
    assert line_images(view, across)[0].along_mm[-1] > hidden.along_mm[-1] + 500.0


def test_a_line_that_the_mirror_does_not_show_has_no_figure() -> None:
    view = view_of("progressive-c")
    for line in (road_line(-5250.0, -20_000.0, -3000.0), column(-5000.0, -2000.0, 3000.0), road_line(3000.0, 1000.0, 3000.0)):
        assert line_images(view, line, OWN) == ()
        assert line_bow(view, line, OWN) is None
        assert column_tilt(view, line, OWN) is None
        assert road_straightness(view, line, OWN) is None


def test_bow_converges_with_sampling() -> None:
    """The parabola's error is of higher order than the samples': one four times as dense changes the last digits only."""
    view, line = view_of("progressive-c"), road_line(-5250.0)
    found = {n: line_bow(view, line, None, n) for n in (17, 65, 257)}
    figures = {n: bow.arcmin for n, bow in found.items() if bow is not None}
    assert figures[17] == pytest.approx(figures[257], rel=1e-5)
    assert figures[65] == pytest.approx(figures[257], rel=2e-7)
    assert all(len(bow.image.along_mm) == n for n, bow in found.items() if bow is not None)


@pytest.mark.parametrize("line", LINES)
def test_a_right_hand_mirror_is_the_reflection_of_the_left(line: StraightLine) -> None:
    reflector, pose = posed("progressive-b")
    left = View(reflector, pose, EYE)
    right = View(reflector, replace(pose, hand="right"), SIDEWAYS @ EYE)
    other = StraightLine(SIDEWAYS @ line.start, SIDEWAYS @ line.direction, line.length_mm)
    for measure, name in ((line_bow, "arcmin"), (column_tilt, "arcmin"), (column_tilt, "by_curvature_arcmin"),
                          (road_straightness, "percent")):
        if measure is column_tilt and line.direction[2] == 0.0:
            continue
        a, b = measure(left, line, OWN), measure(right, other, OWN)
        assert (a is None) == (b is None)
        if a is not None:
            assert getattr(a, name) == pytest.approx(getattr(b, name), rel=1e-7, abs=1e-6)


def test_nothing_changes_when_everything_moves() -> None:
    reflector, pose = posed("progressive-a")
    move = np.array([700.0, -300.0, 250.0])
    moved = View(reflector, replace(pose, centre=pose.centre + move), EYE + move)
    for line in (StraightLine(np.array([0.0, -5250.0, 0.0]), np.array([1.0, 0.0, 0.0]), 60_000.0), LINES[3]):
        here, there = (line_bow(view, replace(line, start=line.start + by))
                       for view, by in ((View(reflector, pose, EYE), np.zeros(3)), (moved, move)))
        assert here is not None
        assert there is not None
        assert here.arcmin == pytest.approx(there.arcmin, abs=1e-5)
        assert here.place == pytest.approx(there.place, abs=1e-4)


# --- other reflectors ---------------------------------------------------------------------------------------------------


def test_glass_of_index_1_shows_what_its_bare_back_shows() -> None:
    """The one by an edge that is looked for, the other by its outline."""
    mirror = designed("progressive-c")
    loops = (mirror.outline.polyline(1e-5),)
    bare = Reflector(BSplineFace(mirror.surface, loops))
    in_front = BSplineFace(mirror.surface, loops)
    shifted = replace(mirror.surface, poles=mirror.surface.poles + np.array([0.0, 0.0, 3.0]))
    wide = np.array([[-124.0, -180.0], [124.0, -180.0], [124.0, 180.0], [-124.0, 180.0]])
    glass = Reflector(Plate(BSplineFace(shifted, (wide,)), in_front, 1.0))
    pose = posed("progressive-c")[1]
    a, b = View(bare, pose, EYE), View(glass, pose, EYE)
    for line in (road_line(-5250.0), column(20_000.0, -5500.0, 6000.0)):
        one, two = line_bow(a, line), line_bow(b, line)
        assert one is not None
        assert two is not None
        assert one.arcmin == pytest.approx(two.arcmin, abs=1e-4)  # an edge that is looked for
        assert one.extent_arcmin == pytest.approx(two.extent_arcmin, abs=1e-3)


def test_a_mesh_with_interpolated_normals_bends_a_line_as_its_surface_does() -> None:
    x, y, faces = grid(np.linspace(-115.0, 115.0, 116), np.linspace(-150.0, 150.0, 151))
    mesh = SurfaceMesh(np.stack([x, y, np.sqrt(950.0**2 - x**2 - y**2) - 950.0], axis=1), faces)
    pose = Pose(CENTRE, np.zeros(3), np.radians(14.0), np.radians(2.7))
    line = column(20_000.0, -5500.0, 6000.0)
    exact, found = (line_bow(View(one, pose, EYE), line) for one in (ball(), Reflector.of_mesh(mesh, "interpolated")))
    assert exact is not None
    assert found is not None
    assert found.arcmin == pytest.approx(exact.arcmin, abs=0.1)
    assert found.extent_arcmin == pytest.approx(exact.extent_arcmin, abs=0.1)


# --- the edge -----------------------------------------------------------------------------------------------------------


def test_an_edge_that_is_looked_for_is_the_outline() -> None:
    view = view_of("progressive-b")
    known = edge_of(view)
    in_the_way_of_nothing = View(replace(view.reflector, obstacles=far_away()), view.pose, EYE)
    assert np.array_equal(edge_of(in_the_way_of_nothing).on_plane, known.on_plane)
    found = visibility_contour(view)
    assert len(found.on_plane) < len(known.on_plane) < 10_000

    def area(edge: raytrace.visibility.edge.Edge) -> float:
        k = np.arange(len(edge.on_plane))
        a, b, c = edge.on_plane, edge.at_share(k, np.full(len(k), 0.5)), edge.on_plane[edge.following]
        return abs(float(0.5 * sum(np.sum(p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]) for p, q in ((a, b), (b, c)))))

    assert area(found) == pytest.approx(area(known), rel=2e-5)  # chords of 0.6 mm, in corners of 40 mm
    for value in (lambda q, d: d[:, 2], lambda q, d: d[:, 1] + 0.3):
        k, on_plane, traced = known.crossings(value)
        k_2, places_2, _ = found.crossings(value)
        assert len(k) == len(k_2) == 2
        assert np.abs(value(traced.points, traced.directions)).max() < 1e-12
        assert on_plane[np.argsort(on_plane[:, 0])] == pytest.approx(places_2[np.argsort(places_2[:, 0])], abs=1e-4)


def far_away() -> SurfaceMesh:
    """An obstacle behind the eye: it is in nobody's way, and that is not known beforehand."""
    corners = np.array([[0.0, 0.0, 5e4], [1.0, 0.0, 5e4], [0.0, 1.0, 5e4]])
    return SurfaceMesh(corners, np.array([[0, 1, 2]], dtype=np.int32))


def test_a_ray_through_the_edge_meets_the_line() -> None:
    view, line = view_of("progressive-c"), road_line(-5250.0)
    seen = LineView.of(view, line)
    angle, on_plane, _ = seen.crossings()
    traced = view.untrimmed.trace_points(on_plane)
    point = line.at(seen.along(angle))
    across = np.cross(point - traced.points, traced.directions)
    assert np.linalg.norm(across, axis=1).max() < 1e-6


def test_roots_are_found_in_few_steps_and_to_rounding() -> None:
    calls = 0
    wanted = np.linspace(0.01, 0.99, 50)

    def cubic(t: Array) -> Array:
        nonlocal calls
        calls += 1
        return np.asarray((t - wanted) * (1.0 + 5.0 * t * t))

    found = roots(cubic, cubic(np.zeros(50)), cubic(np.ones(50)))
    assert np.abs(found - wanted).max() < 1e-11
    assert calls < 20
    step = roots(lambda t: np.where(t < wanted, -1.0, 1.0), -np.ones(50), np.ones(50))
    assert np.abs(step - wanted).max() < 1e-10
