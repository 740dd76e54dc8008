"""The loops that are compiled for one sheet find what the same steps, taken over all rays at once, find."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mirror_cad.surfaces.basis import greville_abscissae
from mirror_cad.surfaces.bspline import BSplineSurface
from raytrace.kernels.intervals import swept
from raytrace.kernels.loops import loops
from raytrace.kernels.sheet import Sheet
from raytrace.reflector import Reflector
from raytrace.surfaces.bspline import BSplineFace
from raytrace.viewing.pose import Pose
from raytrace.viewing.ray_differentials import ray_differentials
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.edges import Edges
from raytrace.visibility.far_sizes import far_points, far_sizes
from raytrace.visibility.image_points import follow_image_points, image_points
from raytrace.visibility.plan import visible_intervals, visible_on_each
from raytrace.visibility.ray_function import LEVEL, RayFunction
from tests.conftest import designed

Array = NDArray[np.float64]

EYE = np.array([0.0, -490.0, 1900.0])
CENTRE = np.array([-540.0, -1010.0, 1760.0])
POSES = {"left": Pose(CENTRE, np.zeros(3), np.radians(17.0), np.radians(-3.0)),
         "right": Pose(CENTRE, np.zeros(3), np.radians(17.0), np.radians(-3.0), "right")}
SHAPES = ("progressive-c", "flat", "bowl", "waves")


class Searched(BSplineFace):
    """The same face, for which nothing compiled is at hand: its rays are found as those of any surface are."""

    @property
    def sheet(self) -> Sheet | None:
        return None

    def untrimmed(self) -> BSplineFace:
        return searched(super().untrimmed())

    def points_over(self, x: Array, y: Array) -> Array:
        return super(BSplineFace, self).points_over(x, y)


def searched(face: BSplineFace) -> Searched:
    return Searched(face.surface, face.loops, face.sign, face.one_sided)


def sheet(name: str) -> BSplineFace:
    """A designed mirror, or one that no law gives: a bowl that enlarges, and waves that a ray may meet more than once."""
    if name in ("bowl", "waves"):
        knots = np.concatenate([np.full(6, -130.0), np.linspace(-130.0, 130.0, 12)[1:-1], np.full(6, 130.0)])
        x = greville_abscissae(knots, 5)
        at_x, at_y = np.meshgrid(x, x, indexing="ij")
        z = (at_x**2 + at_y**2) / 6000.0 if name == "bowl" else 4.0 * np.cos(at_x / 25.0) * np.cos(at_y / 30.0)
        surface = BSplineSurface(5, 5, knots, knots, np.stack([at_x, at_y, z], axis=2), None)
    else:
        surface = designed(name).surface
    t = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    return BSplineFace(surface, (np.stack([90.0 * np.cos(t), 110.0 * np.sin(t)], axis=1),))


def views(name: str, hand: str) -> tuple[View, View]:
    face, pose = sheet(name), POSES[hand]
    eye = EYE * [1.0, -1.0 if hand == "right" else 1.0, 1.0]
    return View(Reflector(face), pose, eye), View(Reflector(searched(face)), pose, eye)


@pytest.mark.parametrize("hand", POSES)
@pytest.mark.parametrize("name", SHAPES)
def test_few_rays_are_traced_as_many_are(name: str, hand: str) -> None:
    one, other = views(name, hand)
    on_plane = np.random.default_rng(1).uniform(-170.0, 170.0, (120, 2))
    on_plane[0], on_plane[1] = np.nan, 1e9
    here, there = one.trace_points(on_plane), other.trace_points(on_plane)
    assert np.array_equal(here.status, there.status)
    assert np.abs(here.points - there.points)[there.seen].max() < 1e-9  # mm
    assert np.abs(here.directions - there.directions)[there.seen].max() < 1e-12
    assert np.isnan(here.points[~there.seen]).all()


def test_rays_from_the_side_meet_first_what_a_search_finds() -> None:
    """Grazing rays, and rays that come from below the crests before they meet a wave."""
    face = replace(sheet("waves"), one_sided=False)
    pose = Pose.identity()
    eye = np.array([400.0, 30.0, 12.0])
    here, there = (View(Reflector(one), pose, eye).trace_points(np.random.default_rng(2).uniform(-120.0, 120.0, (100, 2)))
                   for one in (face, searched(face)))
    assert len(set(there.status.tolist())) > 1
    assert np.array_equal(here.status, there.status)
    assert np.abs(here.points - there.points)[there.seen].max() < 1e-8  # mm: rays at some degrees to the sheet


@pytest.mark.parametrize("hand", POSES)
@pytest.mark.parametrize("name", ["progressive-c", "flat"])
def test_newton_finds_the_same_image_points(name: str, hand: str) -> None:
    one, other = views(name, hand)
    rng = np.random.default_rng(3)
    shown = other.untrimmed.trace_points(rng.uniform(-110.0, 110.0, (300, 2))).directions
    wanted = shown + rng.normal(size=shown.shape) * 0.02  # some of them are shown nowhere
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    for targets, at_infinity in ((wanted, True), (other.eye + 3e4 * wanted, False)):
        (here, inside), (there, inside_2) = (image_points(view, targets, at_infinity) for view in (one, other))
        assert np.array_equal(inside, inside_2)
        assert inside.any()
        assert np.array_equal(np.isfinite(here), np.isfinite(there))
        assert np.nanmax(np.abs(here - there)) < 1e-8  # mm: the rays agree to 1e-13 rad
        starts = there + rng.normal(size=there.shape) * 5.0
        (here, leaving), (there, leaving_2) = (follow_image_points(view, starts, targets, at_infinity) for view in (one, other))
        both = np.isfinite(here).all(axis=1) & np.isfinite(there).all(axis=1)
        assert both.sum() > 0.9 * np.isfinite(there).all(axis=1).sum()
        assert np.abs(here - there)[both].max() < 1e-7
        assert np.abs(leaving - leaving_2)[both].max() < 1e-7


@pytest.mark.parametrize("hand", POSES)
@pytest.mark.parametrize("name", SHAPES)
def test_differentials_are_those_of_any_surface(name: str, hand: str) -> None:
    one, other = views(name, hand)
    on_plane = np.random.default_rng(4).uniform(-100.0, 100.0, (80, 2))
    here, there = ray_differentials(one, on_plane), ray_differentials(other, on_plane)
    assert np.array_equal(here.seen, there.seen)
    for part in ("jacobian", "shift", "path_mm"):
        a, b = getattr(here, part), getattr(there, part)
        assert np.nanmax(np.abs(a - b) / (1.0 + np.abs(b))) < 1e-11
        assert np.array_equal(np.isnan(a), np.isnan(b))


@pytest.mark.parametrize("hand", POSES)
@pytest.mark.parametrize("name", ["progressive-c", "flat", "bowl"])
def test_rays_to_the_rim_cross_where_a_search_finds_them(name: str, hand: str) -> None:
    edges = [edge_of(view) for view in views(name, hand)]
    assert edges[0].sheet_rim is not None
    assert edges[1].sheet_rim is None
    assert np.abs(edges[0].directions - edges[1].directions).max() < 1e-11
    rng = np.random.default_rng(5)
    for function in (LEVEL, RayFunction.of(12.0, point=rng.normal(size=3)),
                     RayFunction.of(direction=rng.normal(size=3) * 1e3, moment=rng.normal(size=3))):
        (k, on_plane, traced), (k_2, places_2, traced_2) = (edge.crossings(function) for edge in edges)
        assert np.array_equal(k, k_2)
        assert np.abs(on_plane - places_2).max(initial=0.0) < 1e-7
        assert np.abs(traced.directions - traced_2.directions).max(initial=0.0) < 1e-9
        size = np.abs(function(edges[0].points, edges[0].directions)).max()
        assert np.abs(function(traced.points, traced.directions)).max(initial=0.0) < 1e-12 * size


def test_a_function_of_rays_is_what_its_formula_says() -> None:
    rng = np.random.default_rng(6)
    q, d, p, a, m = rng.normal(size=(5, 20, 3))
    found = RayFunction.of(rng.normal(size=20), p, a, m)
    dot = np.einsum("ij,ij->i", p, q) + np.einsum("ij,ij->i", a, d) + np.einsum("ij,ij->i", m, np.cross(q, d))
    assert np.abs(found(q, d) - found.coefficients[:, 0] - dot).max() < 1e-14
    assert len(RayFunction.of(direction=np.empty((0, 3)), moment=p[0]).coefficients) == 0


def test_loops_are_followed_round() -> None:
    order, ends = loops(np.array([2, 4, 3, 0, 1], dtype=np.intp))
    assert order.tolist() == [0, 2, 3, 1, 4]
    assert ends.tolist() == [3]
    assert loops(np.empty(0, dtype=np.intp))[0].size == 0


def test_ends_that_touch_make_one_interval() -> None:
    row, at = np.array([0, 0, 0, 0, 1, 1]), np.array([0.0, 1.0, 1.0, 2.0, 2.0, 3.0])
    of = np.array([0, 1, 2, 3, 0, 1])
    rows, low, high = swept(row, at, of, np.arange(6), np.array([False, True, True, True]))
    assert rows.tolist() == [0, 1]
    assert low.tolist() == [0.0, 2.0]
    assert high.tolist() == [2.0, 3.0]


@pytest.mark.parametrize("hand", POSES)
def test_edges_asked_together_are_those_asked_alone(hand: str) -> None:
    """Of one sheet that is turned, in one call; and with another surface among them, one by one."""
    face, pose = sheet("progressive-c"), POSES[hand]
    eye = EYE * [1.0, -1.0 if hand == "right" else 1.0, 1.0]
    reflector = Reflector(face)
    turned = [View(reflector, replace(pose, yaw=pose.yaw + turn), eye) for turn in (-0.1, 0.0, 0.1)]
    together = Edges.of(turned)
    mixed = Edges.of([View(Reflector(searched(face)) if j == 1 else reflector, view.pose, eye)
                      for j, view in enumerate(turned)])
    assert together.shared is not None
    assert mixed.shared is None
    y = -2500.0 if hand == "left" else 2500.0
    host = HostVehicle(900.0, -2000.0, 3000.0, 1450.0)
    for edges in (together, mixed):
        found = visible_on_each(edges, 1, y, 0.0, host, -5e3, 6e4)
        assert len(found.row) > 1
        of, _, _, level = edges.crossings(LEVEL)
        for j, view in enumerate(turned):
            alone = visible_intervals(edge_of(view), 1, np.array([y]), 0.0, host, -5e3, 6e4)
            assert found.of(j).shape == alone.of(0).shape
            assert np.abs(found.of(j) - alone.of(0)).max(initial=0.0) < 1e-6  # mm, of up to 60 m
            directions = edge_of(view).crossings(LEVEL)[2].directions
            assert np.abs(level[of == j] - directions).max() < 1e-11


@pytest.mark.parametrize("first", ["rays", "crossings", "reach", "shared"])
def test_edges_of_which_one_is_not_seen_whole_are_those_asked_alone(first: str) -> None:
    """Turned away so far that the eye sees only a part of its face; whatever is asked first."""
    reflector, pose = Reflector(sheet("progressive-c")), POSES["left"]
    turned = [View(reflector, replace(pose, yaw=pose.yaw + turn), EYE) for turn in (-0.1, -1.0, 0.1)]
    assert [edge_of(view).rim for view in turned] == [True, False, True]
    edges = Edges.of(turned)
    asked = {"rays": lambda: edges.rays(0), "crossings": lambda: edges.crossings(LEVEL), "reach": lambda: edges.reach,
             "shared": lambda: edges.shared}
    asked[first]()
    for j, view in enumerate(turned):
        alone = edge_of(view)
        for one, expected in zip(edges.rays(j), (alone.points, alone.directions, alone.following), strict=True):
            np.testing.assert_array_equal(one, expected)
        np.testing.assert_array_equal([side[j] for side in edges.reach], alone.extent[1:])
        assert edges.show_more_than_half[j] == alone.shows_more_than_half
    assert edges.shared is None
    of, _, _, level = edges.crossings(LEVEL)
    host = HostVehicle(900.0, -2000.0, 3000.0, 1450.0)
    found = visible_on_each(edges, 1, -2500.0, 0.0, host, -5e3, 6e4)
    for j, view in enumerate(turned):
        np.testing.assert_allclose(level[of == j], edge_of(view).crossings(LEVEL)[2].directions, rtol=0.0, atol=1e-11)
        np.testing.assert_allclose(found.of(j), visible_intervals(edge_of(view), 1, np.array([-2500.0]), 0.0, host, -5e3, 6e4)
                                   .of(0), rtol=0.0, atol=1e-6)  # mm, of up to 60 m


def test_how_far_edges_reach_is_told_of_each_whatever_was_asked_before() -> None:
    reflector, pose = Reflector(sheet("progressive-c")), POSES["left"]
    turned = [View(reflector, replace(pose, yaw=pose.yaw + turn), EYE) for turn in (-0.1, 0.0, 0.1)]
    edges = Edges.of(turned)
    edges.rays(1)
    edges.crossings(LEVEL)
    for j, view in enumerate(turned):
        np.testing.assert_array_equal([side[j] for side in edges.reach], edge_of(view).extent[1:])
        np.testing.assert_array_equal(edges.rays(j)[0], edge_of(view).points)
        assert edges.show_more_than_half[j] == edge_of(view).shows_more_than_half


@pytest.mark.parametrize("hand", POSES)
@pytest.mark.parametrize("name", ["progressive-c", "flat", "bowl"])
def test_far_directions_are_found_from_near_by_as_from_a_grid_and_are_as_large(name: str, hand: str) -> None:
    """In any order, with directions among them that the sheet shows nowhere, and with starts that are far off or none."""
    one, other = views(name, hand)
    chance = np.random.default_rng(11)
    at = chance.uniform(-100.0, 100.0, (150, 2))
    _, traced = one.trace_over(*at.T)
    directions = traced.directions.copy()
    directions[3], directions[4] = -directions[3], np.nan
    near = at + chance.normal(0.0, 15.0, at.shape)
    near[5], near[6] = np.nan, [-125.0, 125.0]
    around = np.stack([one.trace_over(at[:, 0] + step, at[:, 1])[1].directions for step in (-0.25, 0.25)])
    around[0, 7], around[1, 8] = np.nan, np.nan
    (sizes, shown), (expected, expected_shown) = (far_sizes(view, directions, around, near) for view in (one, other))
    assert np.array_equal(shown, expected_shown)
    assert shown.sum() > 100
    for size in ("horizontal", "vertical", "area"):
        assert getattr(sizes, size) == pytest.approx(getattr(expected, size), rel=1e-9, nan_ok=True)
    known = np.isfinite(directions).all(axis=1)
    found, inside = far_points(one, directions, near)
    assert np.array_equal(inside, shown)
    assert np.abs(found - at)[known & (np.arange(150) != 3)].max() < 1e-8  # mm: 1e-13 radians at a mirror's distance
    assert np.isnan(found[3:5]).all()


def test_what_lies_under_places_is_what_they_were_found_over() -> None:
    one, other = views("progressive-c", "left")
    at = np.random.default_rng(12).uniform(-120.0, 120.0, (60, 2))
    at[0], at[1] = np.nan, 1e4  # nothing reflects there
    for view in (one, other):
        on_plane, traced = view.trace_over(*at.T)
        assert np.array_equal(np.isnan(on_plane[:, 0]), ~traced.seen)
        assert traced.seen.sum() == 58
        assert view.surface_under(on_plane[2:]) == pytest.approx(at[2:], abs=1e-9)
        assert traced.directions[2:] == pytest.approx(one.untrimmed.trace_points(on_plane[2:]).directions, abs=1e-12)
