"""The ground that a mirror shows, and what stays blind: closed forms of a flat mirror, exact rays one by one, symmetry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mirror_cad.mesh import SurfaceMesh
from raytrace.measures.asked import NearLane
from raytrace.measures.blind_zone import blind_along, blind_zone, hidden_car
from raytrace.measures.ground import Plan, horizon_margin, nearest_at_flank, seen_ground, seen_widths
from raytrace.measures.line_bow import line_bow
from raytrace.measures.yaw_coverage import yaw_coverage
from raytrace.reflector import Reflector
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.plate import Plate
from raytrace.viewing.aim import Aim
from raytrace.viewing.pose import SIDEWAYS, Pose
from raytrace.viewing.vehicle import Eyes, HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.image_points import follow_image_points, image_points
from raytrace.visibility.intervals import IntervalSet, combined, intersection, union
from raytrace.visibility.line_image import road_line
from raytrace.visibility.plan import outlines, visible_intervals
from tests.conftest import designed
from tests.test_straight_lines import EYE, OWN, ball, flat, posed

Array = NDArray[np.float64]

EYES = Eyes(EYE)
LANE = NearLane(-5250.0, -1750.0)
NEAR_MM = 1e-3  # what widths are promised to


def two(name: str) -> tuple[View, View]:
    reflector, pose = posed(name)
    return View(reflector, pose, EYES.left), View(reflector, pose, EYES.right)


def two_flat(pitch_deg: float = 3.0) -> tuple[View, View]:
    view = flat(22.0, pitch_deg)
    return View(view.reflector, view.pose, EYES.left), View(view.reflector, view.pose, EYES.right)


def is_seen(view: View, points: Array, own: HostVehicle | None) -> NDArray[np.bool_]:
    """Point by point, by the inverse ray."""
    on_plane, inside = image_points(view, points)
    return inside & ~own.hides(view.trace_points(on_plane).points, points) if own is not None else inside


def on_ground(x: Array, y: Array, z: float = 0.0) -> Array:
    return np.stack([*np.broadcast_arrays(x, y, np.float64(z))], axis=-1).reshape(-1, 3)


# --- closed forms -----------------------------------------------------------------------------------------------------


def test_a_flat_mirror_shows_what_its_window_shows_the_eye_behind_it() -> None:
    """The eye's image in the plane looks through the outline: straight lines to the ground, a polygon on every line."""
    for view in two_flat():
        normal, foot = view.pose.rotation[:, 2], view.pose.offset
        behind = view.eye - 2.0 * ((view.eye - foot) @ normal) * normal
        corners = view.reflector.outline()
        t = np.linspace(0.0, 1.0, 200, endpoint=False)[None, :, None]
        window = view.pose.to_vehicle((corners[:, None] + t * (np.roll(corners, -1, axis=0) - corners)[:, None]).reshape(-1, 3))
        way = window - behind
        edge = behind + (-behind[2] / way[:, 2])[:, None] * way  # on the ground
        lands = way[:, 2] < 0.0
        x = np.array([4000.0, 10_000.0, 20_000.0])
        found = visible_intervals(edge_of(view), 0, x)
        for row, value in enumerate(x):
            a, b = edge, np.roll(edge, -1, axis=0)
            crossing = ((a[:, 0] > value) != (b[:, 0] > value)) & lands & np.roll(lands, -1)
            t = (value - a[crossing, 0]) / (b[crossing, 0] - a[crossing, 0])
            y = np.sort(a[crossing, 1] + t * (b[crossing, 1] - a[crossing, 1]))
            assert found.of(row).ravel() == pytest.approx(y, abs=NEAR_MM)


def test_the_flanks_shadow_is_a_line_from_the_eye_behind_the_mirror() -> None:
    """In a flat mirror the rear corner's shadow on the ground is straight."""
    view = two_flat()[0]
    normal, foot = view.pose.rotation[:, 2], view.pose.offset
    behind = view.eye - 2.0 * ((view.eye - foot) @ normal) * normal
    x = np.array([6000.0, 15_000.0, 40_000.0])
    found = visible_intervals(edge_of(view), 0, x, 0.0, OWN)
    bare = visible_intervals(edge_of(view), 0, x)
    for row, value in enumerate(x):
        corner = behind[1] + (-870.0 - behind[1]) * (value - behind[0]) / (3900.0 - behind[0])
        assert bare.of(row)[-1, 1] > corner
        assert found.of(row)[-1, 1] == pytest.approx(corner, abs=NEAR_MM)
        assert found.of(row)[0, 0] == pytest.approx(bare.of(row)[0, 0], abs=1e-9)


def test_horizon_in_a_flat_mirror() -> None:
    """The elevation of the ray at the upper edge, and whether the horizon leaves by the sides."""
    view = flat(22.0, 3.0)
    margin = horizon_margin(view, OWN)
    corners = np.sort(view.reflector.outline()[:, 1])
    top = np.array([0.0, 0.5 * (135.0 + 170.0), 0.0])  # of the outline's slanting upper side
    assert corners[-1] > top[1]
    assert margin.whole
    assert 0.0 < margin.height < 1.0
    ray = view.pose.to_vehicle(top) - view.eye
    normal = view.pose.rotation[:, 2]
    out = ray - 2.0 * (ray @ normal) * normal
    assert margin.angle == pytest.approx(np.arcsin(out[2] / np.linalg.norm(out)), abs=1e-4)
    low = horizon_margin(flat(22.0, -6.0), OWN)
    assert np.isnan(low.height)
    assert not low.whole
    curved = posed("progressive-c")
    aimed_at = horizon_margin(View(*curved, EYE), OWN)
    assert aimed_at.aim == Aim(pytest.approx(0.12, abs=1e-9), pytest.approx(0.6, abs=1e-9))
    assert aimed_at.whole


def test_direct_view_ends_at_its_azimuth() -> None:
    """The blind zone begins on the lane's middle where the limit's line crosses it, whatever the mirror."""
    left, right = two("progressive-c")
    for limit in (60.0, 90.0, 95.0, 100.0, 120.0):
        zone = blind_zone(left, right, OWN, LANE, 0.0, np.radians(limit))
        begins = EYE[0] - 3010.0 / np.tan(np.radians(limit))
        assert zone.middle[0, 0] == pytest.approx(begins, abs=1e-6)
        assert zone.length_mm == pytest.approx(zone.middle[0, 1] - begins)
    assert blind_zone(left, right, OWN, LANE, 0.0, np.radians(150.0)).length_mm == 0.0


# --- ray by ray -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["progressive-a", "progressive-c", "sphere-950"])
def test_masks_are_those_of_the_inverse_rays(name: str) -> None:
    """All cells, and the rule for either and both."""
    left, right = two(name)
    plan = Plan.beside(-1.0, 800.0)
    ground = seen_ground(left, right, OWN, plan)
    points = on_ground(*np.meshgrid(plan.x_mm, plan.y_mm, indexing="ij"))
    for seen, view in ((ground.left, left), (ground.right, right)):
        assert np.array_equal(seen.mask.ravel(), is_seen(view, points, OWN))
        assert 0.1 < seen.mask.mean() < 0.9
    assert np.array_equal(ground.either.mask, ground.left.mask | ground.right.mask)
    assert np.array_equal(ground.both.mask, ground.left.mask & ground.right.mask)


def test_seen_at_a_height_and_along_the_road_as_by_inverse_rays() -> None:
    view = two("progressive-b")[0]
    rng = np.random.default_rng(3)
    for axis, low, high in ((0, 300.0, 30_000.0), (1, -15_000.0, 2000.0)):
        values = np.sort(rng.uniform(low, high, 12))
        for height in (0.0, 800.0):
            spans = visible_intervals(edge_of(view), axis, values, height, OWN)
            other = np.sort(rng.uniform(-15_000.0, 2000.0, 60) if axis == 0 else rng.uniform(300.0, 30_000.0, 60))
            grid = np.meshgrid(values, other, indexing="ij")
            points = on_ground(grid[axis], grid[1 - axis], height)
            assert np.array_equal(spans.mask(12, other).ravel(), is_seen(view, points, OWN))


@pytest.mark.parametrize("name", ["progressive-a", "progressive-b", "progressive-c"])
def test_ends_of_widths_are_exact(name: str) -> None:
    """A micrometre inside an end the ground is seen, a micrometre beyond it is not."""
    left, right = two(name)
    for width in seen_widths(left, right, OWN):
        for intervals, rule in ((width.either, np.logical_or), (width.both, np.logical_and)):
            for low, high in intervals:
                y = np.array([low - NEAR_MM, low + NEAR_MM, high - NEAR_MM, high + NEAR_MM])
                points = on_ground(np.full(4, width.x_mm), y)
                assert rule(is_seen(left, points, OWN), is_seen(right, points, OWN)).tolist() == [False, True, True, False]
        assert width.either_mm == pytest.approx(-870.0 - width.either[0, 0])
        assert width.either_mm > width.both_mm > 0.0


def test_nearest_ground_beside_the_flank_is_exact() -> None:
    left, right = two("progressive-c")
    for beside in (1.0, 100.0, 200.0):
        one, two_ = nearest_at_flank(left, right, OWN, beside)
        for x, rule in ((one, np.logical_or), (two_, np.logical_and)):
            points = on_ground(np.array([x - NEAR_MM, x + NEAR_MM]), np.full(2, -870.0 - beside))
            assert rule(is_seen(left, points, OWN), is_seen(right, points, OWN)).tolist() == [False, True]
    assert all(np.isnan(nearest_at_flank(flat(70.0), flat(70.0), OWN)))


def test_blind_zone_is_what_no_view_shows() -> None:
    left, right = two("progressive-b")
    zone = blind_zone(left, right, OWN, LANE, 800.0)
    rng = np.random.default_rng(5)
    k = rng.choice(len(zone.x_mm), 150, replace=False)
    k.sort()
    y = np.sort(rng.uniform(LANE.y_min_mm, LANE.y_max_mm, 20))
    points = on_ground(*np.meshgrid(zone.x_mm[k], y, indexing="ij"), z=800.0)
    azimuth = np.arctan2(np.abs(points[:, 1] - EYE[1]), EYE[0] - points[:, 0])
    blind = ~is_seen(left, points, OWN) & ~is_seen(right, points, OWN) & (azimuth > np.radians(95.0))
    assert np.array_equal(zone.spans.mask(len(zone.x_mm), y)[k].ravel(), blind)
    assert blind.any()
    # Both of its ways agree: along the middle, and across.
    middle = zone.spans.mask(len(zone.x_mm), np.array([-3500.0]))[:, 0]
    inside = (zone.x_mm > zone.middle[0, 0]) & (zone.x_mm < zone.middle[0, 1])
    assert np.array_equal(middle, inside)
    assert not zone.endless


def test_areas_of_outlines_are_those_of_the_widths() -> None:
    """Polygons and trapezia over the same lines; and points of the plan lie inside where the mask says so."""
    left, right = two("sphere-950")
    ground = seen_ground(left, right, OWN)
    zone = blind_zone(left, right, OWN, LANE)
    assert sum(area(polygon) for polygon in zone.outlines) == pytest.approx(zone.area_mm2, rel=1e-3)  # its tips are cut
    for seen in (ground.left, ground.either, ground.both):
        cell = 400.0**2
        total = sum(area(polygon) for polygon in seen.outlines)
        assert total == pytest.approx(seen.mask.sum() * cell, rel=0.01)
        assert len(seen.outlines) == 1
        x, y = np.meshgrid(ground.plan.x_mm, ground.plan.y_mm, indexing="ij")
        assert np.mean(within(seen.outlines[0], x.ravel(), y.ravel()) == seen.mask.ravel()) > 0.9995  # chords near by


def test_outlines_reach_to_their_tips() -> None:
    """The least and the largest X of what one eye sees without a vehicle: those of dense rays through the mirror's edge."""
    view, _ = two("sphere-950")
    edge = edge_of(view)
    k = np.repeat(np.arange(len(edge.following)), 20)
    _, traced = edge.between(k, np.tile(np.linspace(0.0, 1.0, 20, endpoint=False), len(edge.following)))
    lands = traced.directions[:, 2] < 0.0
    x = traced.points[lands, 0] - traced.points[lands, 2] * traced.directions[lands, 0] / traced.directions[lands, 2]
    (outline,) = seen_ground(view, view).left.outlines
    assert outline[:, 0].min() == pytest.approx(x.min(), abs=2.0)  # by a vertex of the edge, and 1e-3 mm inside


def area(polygon: Array) -> float:
    x, y = polygon.T
    return float(abs(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))


def within(polygon: Array, x: Array, y: Array) -> NDArray[np.bool_]:
    inside = np.zeros(len(x), dtype=np.bool_)
    for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if x0 != x1:
            crosses = (x0 > x) != (x1 > x)
            inside ^= crosses & (y < y0 + (x - x0) / (x1 - x0) * (y1 - y0))
    return inside


# --- hidden cars --------------------------------------------------------------------------------------------------------


def test_the_longest_car_in_zones_of_known_shape() -> None:
    """A trapezium 6 m long that narrows from 3 to 1 m: 1.8 m wide cars up to 3.6 m; beside a car's width, none."""
    left, right = two("progressive-c")
    zone = blind_zone(left, right, OWN, LANE)
    x = np.arange(0.0, 6001.0, 25.0)
    lane = NearLane(-5000.0, -1000.0)
    high = -1500.0 - x / 3.0
    trapezium = replace(zone, x_mm=x, spans=IntervalSet(np.arange(len(x)), np.full(len(x), -4500.0), high))
    found = hidden_car((trapezium,), lane, 3500.0, 1800.0)
    assert found.longest_mm == pytest.approx(3600.0, abs=25.0 * 3.0)  # the nearest place tried is less than 25 mm off
    assert found.hides
    assert not hidden_car((trapezium,), lane, 3700.0, 1800.0).hides
    assert hidden_car((trapezium,), lane, 100.0, 3100.0).longest_mm == 0.0
    assert hidden_car((trapezium,), NearLane(-5000.0, -4000.0), 100.0, 1800.0).longest_mm == 0.0
    # At two heights: what is blind at both.
    shorter = replace(trapezium, spans=IntervalSet(np.arange(40), np.full(40, -4500.0), high[:40]))
    assert hidden_car((trapezium, shorter), lane).longest_mm == pytest.approx(975.0)


def test_a_mirror_that_shows_no_lane_leaves_it_all_blind() -> None:
    view = flat(70.0, 3.0)
    left, right = (View(view.reflector, view.pose, eye) for eye in (EYES.left, EYES.right))
    zone = blind_zone(left, right, OWN, LANE)
    assert zone.endless
    assert zone.length_mm == pytest.approx(60_000.0 - 263.340877, abs=1e-3)
    assert hidden_car((zone,), LANE).hides


# --- turned mirrors -----------------------------------------------------------------------------------------------------


def test_turns_show_what_the_turned_mirror_shows() -> None:
    """No turn, the zone's own length; and at the ends of the azimuths shown, the edge: beyond them the far point is not."""
    reflector, pose = posed("progressive-c")
    turns = np.radians([-6.0, 0.0, 6.0])
    found = yaw_coverage(reflector, pose, EYES, OWN, LANE, turns)
    assert found.blind_mm[1] == pytest.approx(blind_along(*two("progressive-c"), OWN, LANE).total, abs=1e-9)
    for turn, low, high in zip(turns, found.azimuth_from, found.azimuth_to, strict=True):
        view = View(reflector, replace(pose, yaw=pose.yaw + turn), EYE)
        azimuth = np.array([low - 1e-6, low + 1e-6, high - 1e-6, high + 1e-6])
        far = np.stack([-np.cos(azimuth), -np.sin(azimuth), np.zeros(4)], axis=1)
        assert image_points(view, far, at_infinity=True)[1].tolist() == [False, True, True, False]
    # An outward turn looks farther outboard: some two degrees a degree.
    assert np.degrees(found.azimuth_from[1] - found.azimuth_from[0]) == pytest.approx(12.0, abs=1.5)
    assert np.degrees(found.azimuth_to[2] - found.azimuth_to[1]) == pytest.approx(12.0, abs=1.5)


# --- invariance ---------------------------------------------------------------------------------------------------------


def test_a_right_hand_mirror_is_the_reflection_of_the_left() -> None:
    reflector, pose = posed("progressive-a")
    left = two("progressive-a")
    mirrored = replace(pose, hand="right")
    right = [View(reflector, mirrored, SIDEWAYS @ eye) for eye in (EYES.right, EYES.left)]
    for a, b in zip(seen_widths(*left, OWN), seen_widths(right[0], right[1], OWN), strict=True):
        assert b.either == pytest.approx(-a.either[:, ::-1], abs=1e-4)
        assert b.both == pytest.approx(-a.both[:, ::-1], abs=1e-4)
        assert (b.either_mm, b.both_mm) == pytest.approx((a.either_mm, a.both_mm), abs=1e-4)
    assert nearest_at_flank(right[0], right[1], OWN) == pytest.approx(nearest_at_flank(*left, OWN), abs=1e-4)
    here, there = seen_ground(*left, OWN), seen_ground(right[0], right[1], OWN)
    assert np.array_equal(there.either.mask, here.either.mask[:, ::-1])
    one, other = blind_zone(*left, OWN, LANE), blind_zone(right[0], right[1], OWN, NearLane(1750.0, 5250.0))
    assert one.middle == pytest.approx(other.middle, abs=1e-4)
    assert one.area_mm2 == pytest.approx(other.area_mm2, rel=1e-9)
    turns = np.radians([0.0, 4.0])
    a, b = (yaw_coverage(reflector, p, eyes, OWN, lane, turns)
            for p, eyes, lane in ((pose, EYES, LANE), (mirrored, Eyes(SIDEWAYS @ EYE), NearLane(1750.0, 5250.0))))
    assert a.azimuth_from == pytest.approx(b.azimuth_from, abs=1e-9)
    assert a.blind_mm == pytest.approx(b.blind_mm, abs=1e-4)


def test_everything_may_move_along_the_road() -> None:
    reflector, pose = posed("progressive-c")
    move = np.array([1234.5, 0.0, 0.0])
    own = HostVehicle(870.0, 1234.5, 3900.0 + 1234.5, 2200.0)
    moved = [View(reflector, replace(pose, centre=pose.centre + move), eye + move) for eye in (EYES.left, EYES.right)]
    at = (4000.0, 20_000.0)
    for a, b in zip(seen_widths(*two("progressive-c"), OWN, at),
                    seen_widths(moved[0], moved[1], own, tuple(x + 1234.5 for x in at)), strict=True):
        assert a.either == pytest.approx(b.either, abs=1e-5)
        assert a.both == pytest.approx(b.both, abs=1e-5)


# --- other reflectors, and lines without an end -------------------------------------------------------------------------


def test_glass_of_index_1_and_a_sphere_of_a_file_show_their_ground() -> None:
    """By an edge that is looked for: glass against its bare back, a quadric against inverse rays."""
    mirror = designed("progressive-c")
    wide = np.array([[-124.0, -180.0], [124.0, -180.0], [124.0, 180.0], [-124.0, 180.0]])
    shifted = replace(mirror.surface, poles=mirror.surface.poles + np.array([0.0, 0.0, 3.0]))
    back = BSplineFace(mirror.surface, (mirror.outline.polyline(1e-5),))
    pose = posed("progressive-c")[1]
    views = [[View(one, pose, eye) for eye in (EYES.left, EYES.right)]
             for one in (Reflector(back), Reflector(Plate(BSplineFace(shifted, (wide,)), back, 1.0)))]
    for a, b in zip(seen_widths(*views[0], OWN), seen_widths(*views[1], OWN), strict=True):
        assert b.either == pytest.approx(a.either, abs=NEAR_MM)
        assert b.both == pytest.approx(a.both, abs=NEAR_MM)
    view = View(ball(), replace(pose, yaw=np.radians(14.0)), EYE)
    x = np.array([5000.0, 15_000.0])
    spans = visible_intervals(edge_of(view), 0, x, 0.0, OWN)
    for row, value in enumerate(x):
        low, high = spans.of(row)[0]
        y = np.array([low - NEAR_MM, low + NEAR_MM, high - NEAR_MM, high + NEAR_MM])
        assert is_seen(view, on_ground(np.full(4, value), y), OWN).tolist() == [False, True, True, False]


def test_a_mirror_that_looks_sideways_shows_lines_across_without_an_end() -> None:
    view = View(posed("progressive-c")[0], replace(posed("progressive-c")[1], yaw=np.radians(-20.0)), EYE)
    spans = visible_intervals(edge_of(view), 0, np.array([2000.0, 4000.0]), 0.0, OWN)
    for row, x in enumerate((2000.0, 4000.0)):
        assert spans.of(row)[0, 0] == -1e6
        y = spans.of(row)[0, 1]
        assert is_seen(view, on_ground(np.full(3, x), np.array([-9e5, y - NEAR_MM, y + NEAR_MM])), OWN).tolist() == [
            True, True, False]


def test_a_mirror_behind_a_wall_shows_nothing() -> None:
    reflector, pose = posed("progressive-c")
    corners = np.array([[-9e3, -9e3, 60.0], [9e3, -9e3, 60.0], [0.0, 9e3, 60.0]])
    wall = SurfaceMesh(corners, np.array([[0, 1, 2]], dtype=np.int32))
    view = View(replace(reflector, obstacles=wall), pose, EYE)
    assert len(edge_of(view).on_plane) == 0
    assert [width.either_mm for width in seen_widths(view, view, OWN)] == [0.0, 0.0, 0.0, 0.0]
    assert not seen_ground(view, view, OWN).either.mask.any()
    assert blind_zone(view, view, OWN, LANE).endless
    assert line_bow(view, road_line(-5250.0)) is None
    assert np.isnan(horizon_margin(view, OWN).height)
    turned = yaw_coverage(view.reflector, pose, EYES, OWN, LANE, np.radians([0.0, -110.0]))
    assert np.isnan(turned.azimuth_from).all()
    assert np.isnan(turned.blind_mm).tolist() == [False, True]  # at the second the eye is behind the mirror
    assert turned.endless.tolist() == [True, False]


# --- intervals ------------------------------------------------------------------------------------------------------------


ENDS = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 20), st.integers(1, 8)), max_size=12)


def spans_of(parts: list[tuple[int, int, int]]) -> IntervalSet:
    rows = np.array([row for row, _, _ in parts], dtype=np.intp)
    low = np.array([start for _, start, _ in parts], dtype=np.float64)
    return IntervalSet(rows, low, low + np.array([length for _, _, length in parts], dtype=np.float64))


@settings(max_examples=200)
@given(ENDS, ENDS)
def test_intervals_are_combined_as_their_points_are(a: list[tuple[int, int, int]], b: list[tuple[int, int, int]]) -> None:
    one, other = spans_of(a), spans_of(b)
    points = np.arange(0.25, 30.0, 0.5)
    in_a, in_b = one.mask(4, points), other.mask(4, points)
    for found, wanted in ((union(one, other), in_a | in_b), (intersection(one, other), in_a & in_b),
                          (combined(lambda p, q: p & ~q, one, other), in_a & ~in_b)):
        assert np.array_equal(found.mask(4, points), wanted)
        assert found.total == pytest.approx(0.5 * wanted.sum())
        assert all((found.of(row)[1:, 0] > found.of(row)[:-1, 1]).all() for row in range(4))  # joined where they touch
    polygons = outlines(union(one, other), np.arange(4.0))
    assert all(np.isfinite(polygon).all() for polygon in polygons)


def test_outlines_split_and_join() -> None:
    """A ring, line by line: its outlines' area is that of trapezia over its widths; nothing is filled in."""
    x = np.linspace(-2.0, 2.0, 401)
    outer, inner = np.sqrt(np.maximum(4.0 - x**2, 0.0)), np.sqrt(np.maximum(1.0 - x**2, 0.0))
    rows = np.arange(len(x))
    ring = combined(lambda p, q: p & ~q, IntervalSet(rows, -outer, outer), IntervalSet(rows, -inner, inner).clipped(-9.0, 9.0))
    polygons = outlines(ring, x)
    assert sum(area(polygon) for polygon in polygons) == pytest.approx(3.0 * np.pi, rel=5e-3)
    assert not any(within(polygon, np.zeros(1), np.zeros(1))[0] for polygon in polygons)
    assert any(within(polygon, np.zeros(1), np.full(1, 1.5))[0] for polygon in polygons)


def test_newton_from_near_by_finds_what_a_search_finds() -> None:
    view = two("progressive-c")[0]
    points = on_ground(np.array([4000.0, 9000.0, 30_000.0]), np.array([-2000.0, -4000.0, -3000.0]))
    on_plane, _ = image_points(view, points)
    again, on = follow_image_points(view.untrimmed, on_plane + np.array([8.0, -6.0]), points)
    assert again == pytest.approx(on_plane, abs=1e-6)
    way = points - on
    sight = view.untrimmed.trace_points(again)
    assert np.cross(way / np.linalg.norm(way, axis=1, keepdims=True), sight.directions) == pytest.approx(0.0, abs=1e-11)


def test_ground_below_the_mirror_is_seen_on_every_line() -> None:
    """A mirror over the door that looks down shows the ground on both sides of its own X, line by line as point by point."""
    pose = Pose(np.array([-600.0, -1450.0, 2700.0]), np.zeros(3), np.radians(62.0), np.radians(-53.0))
    view = View(ball(320.0), pose, np.array([0.0, -600.0, 2400.0]))
    x, y = np.linspace(-1000.0, 600.0, 321), np.linspace(-3500.0, -1300.0, 12)
    spans = visible_intervals(edge_of(view), 0, x)
    _, inside = image_points(view, on_ground(x[:, None], y[None]))
    assert (np.bincount(spans.row, minlength=len(x)) > 0).all()
    assert (spans.mask(len(x), y).ravel() == inside).all()
