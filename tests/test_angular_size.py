"""How large a following vehicle is seen, and how much a grid of the world is distorted: plane geometry and flat mirrors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

import mirror_cad
from raytrace.measures.angular_size import ARCMIN, AngularSize, angular_sizes
from raytrace.measures.asked import Face
from raytrace.measures.grid_distortion import grid_distortion
from raytrace.reflector import Reflector
from raytrace.viewing.pose import Pose
from raytrace.viewing.ray_differentials import ray_differentials
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.image_points import image_points
from tests.conftest import constant, spec_of
from tests.test_both_eyes import LEVEL, RADIUS, UPRIGHT, LevelSphere
from tests.test_magnification import EYE, POSE, flat_mesh, quadric, spline

Array = NDArray[np.float64]

OWN = HostVehicle(870.0, 0.0, 3900.0, 2200.0)
CAR = Face(1800.0, 1500.0, -3500.0)


# --- angular size -----------------------------------------------------------------------------------------------------------


def test_a_flat_mirror_shows_a_vehicle_as_large_as_from_the_eyes_image() -> None:
    view = View(quadric("plane", 0.0), replace(POSE, yaw=np.radians(20.0)), EYE)
    for size in angular_sizes(view, CAR, (20_000.0, 50_000.0)):
        assert size.mirror is not None
        assert size.mirror == pytest.approx(size.flat, rel=1e-6)  # the view finds the places to 1e-10 rad
        assert all(flat < direct for flat, direct in zip(size.flat or (), size.direct, strict=True))


def test_an_eye_that_looks_round_sees_a_vehicle_behind_it_under_twice_the_arc_tangent() -> None:
    view = View(spline("sphere-950"), POSE, EYE)
    face = Face(1800.0, 2.0 * float(EYE[2]), float(EYE[1]))  # its middle at the eye's height, straight behind it
    for distance, size in zip((20_000.0, 50_000.0), angular_sizes(view, face), strict=True):
        expected = [2.0 * ARCMIN * np.arctan(half / distance) for half in (900.0, float(EYE[2]))]
        assert size.distance_mm == distance
        assert size.direct == pytest.approx(expected, rel=1e-12)


def test_a_sphere_at_eye_height_shows_a_width_as_plane_geometry_says() -> None:
    face = Face(1800.0, 2.0 * float(LEVEL.middle[2]), -3500.0)
    view = View(quadric("sphere", RADIUS), UPRIGHT, LEVEL.middle)
    plan = LevelSphere(UPRIGHT, LEVEL.middle)

    def seen(target: Array) -> float:
        """The azimuth in which the eye sees a point (X, Y)."""
        def passes(angle: float) -> float:
            azimuth, _, _ = plan.ray(angle)
            start = plan.centre + RADIUS * np.array([np.cos(plan.facing + angle), np.sin(plan.facing + angle)])
            to = target - start
            return float(np.cos(azimuth) * to[1] - np.sin(azimuth) * to[0])

        angle = brentq(passes, -0.2, 0.2, xtol=1e-15)
        start = plan.centre + RADIUS * np.array([np.cos(plan.facing + angle), np.sin(plan.facing + angle)])
        return float(np.arctan2(*(start - plan.eye)[::-1]))

    for distance in (20_000.0, 50_000.0):
        (size,) = angular_sizes(view, face, (distance,))
        expected = ARCMIN * abs(np.subtract(*(seen(np.array([distance, y])) for y in (-4400.0, -2600.0))))
        assert size.mirror is not None
        assert size.mirror[0] == pytest.approx(expected, rel=1e-6)


def test_the_size_over_that_in_a_flat_mirror_is_the_magnification_at_that_distance() -> None:
    """To first order in the vehicle's size: 1.3 % of the distance here."""
    view = View(spline("progressive-c"), POSE, EYE)
    small = Face(20.0, 1500.0, -3500.0)
    (size,) = angular_sizes(view, replace(small, height_mm=1500.0), (20_000.0,))
    on_plane, _ = image_points(view, np.array([[20_000.0, -3500.0, 750.0]]))
    start = view.trace_points(on_plane).points[0]
    found = ray_differentials(view, on_plane).at(float(np.linalg.norm([20_000.0, -3500.0, 750.0] - start)))
    assert size.mirror is not None
    assert size.flat is not None
    # The width lies along Y, not quite across the ray, for both alike; the height is not small.
    assert size.mirror[0] / size.flat[0] == pytest.approx(found.horizontal[0], rel=2e-3)
    assert size.mirror[1] / size.flat[1] == pytest.approx(found.vertical[0], rel=2e-3)


def test_a_vehicle_that_is_not_wholly_shown_has_no_size_in_the_mirror() -> None:
    view = View(spline("progressive-c"), POSE, EYE)

    def shown(face: Face, own: HostVehicle | None = None) -> AngularSize:
        return angular_sizes(view, face, (20_000.0,), own)[0]

    assert shown(CAR, OWN).mirror is not None
    behind = replace(CAR, y_mm=0.0)  # in the own lane: hidden by the host vehicle, in part
    assert shown(behind).mirror is not None
    assert shown(behind, OWN).mirror is None
    assert shown(behind, OWN).flat is None  # nor would a flat mirror show its middle
    far_out = shown(replace(CAR, y_mm=-40_000.0))  # outside the field
    assert far_out.mirror is None
    assert shown(replace(CAR, y_mm=-16_500.0)).mirror is None  # its outer side is
    assert far_out.direct[0] > 0.0


def test_a_vehicle_is_seen_as_large_in_the_right_hand_mirror() -> None:
    left = angular_sizes(View(spline("progressive-c"), POSE, EYE), CAR, host=OWN)
    right = angular_sizes(View(spline("progressive-c"), replace(POSE, hand="right"), EYE * [1.0, -1.0, 1.0]),
                          replace(CAR, y_mm=3500.0), host=OWN)
    for a, b in zip(left, right, strict=True):
        assert a.mirror == pytest.approx(b.mirror, rel=1e-7)
        assert a.flat == pytest.approx(b.flat, rel=1e-7)
        assert a.direct == pytest.approx(b.direct, rel=1e-12)


# --- distortion of a grid ---------------------------------------------------------------------------------------------------


def test_a_flat_mirror_does_not_distort_however_it_is_turned() -> None:
    designed_flat = Reflector.from_mirror(mirror_cad.design(spec_of(constant(np.inf), constant(np.inf))))
    for reflector in (quadric("plane", 0.0), designed_flat, flat_mesh()):
        for pose in (POSE, replace(POSE, yaw=np.radians(25.0), pitch=np.radians(-8.0))):
            found = grid_distortion(View(reflector, pose, EYE))
            assert found.shown.sum() > 100
            assert found.max_arcmin is not None
            assert found.max_arcmin < 1e-5  # float32 places of a mesh; 1e-6 otherwise
            assert found.affine == pytest.approx(np.eye(2, 3), abs=1e-7)


def test_nodes_are_seen_where_the_view_finds_them_and_their_lines_are_rows_and_columns() -> None:
    view = View(spline("progressive-c"), POSE, EYE)
    found = grid_distortion(view)
    assert np.diff(found.azimuth_deg) == pytest.approx(1.0)
    assert np.diff(found.elevation_deg) == pytest.approx(1.0)
    traced = view.trace_points(found.on_plane[found.shown])
    assert traced.seen.all()
    azimuth, elevation = np.meshgrid(found.azimuth_deg, found.elevation_deg)
    ways = traced.directions
    assert np.degrees(np.arctan2(ways[:, 1], ways[:, 0])) == pytest.approx(azimuth[found.shown], abs=1e-7)
    assert np.degrees(np.arcsin(ways[:, 2])) == pytest.approx(elevation[found.shown], abs=1e-7)
    assert np.array_equal(np.isfinite(found.residual_arcmin), found.shown)
    # Every node of the world that is seen is in the grid: one column and row beyond on every side is not shown.
    for beside in (found.shown[0], found.shown[-1], found.shown[:, 0], found.shown[:, -1]):
        assert not beside.any()


def test_the_affine_map_is_the_one_with_the_least_squares() -> None:
    """Any other leaves more; and what it leaves does not depend on the step of the grid but for its sampling."""
    view = View(spline("progressive-c"), POSE, EYE)
    found, fine = grid_distortion(view), grid_distortion(view, 0.5)
    assert found.rms_arcmin == pytest.approx(float(np.sqrt(np.nanmean(found.residual_arcmin**2))), rel=1e-12)
    assert found.max_arcmin == np.nanmax(found.residual_arcmin)
    assert found.max_at_deg is not None
    assert fine.rms_arcmin == pytest.approx(found.rms_arcmin, rel=0.02)
    assert fine.max_arcmin is not None
    assert fine.max_arcmin == pytest.approx(found.max_arcmin, rel=0.06)  # at the field's edge, where nodes come and go
    assert found.affine is not None
    sizes = np.linalg.svd(found.affine[:, :2])[1]
    middle = ray_differentials(view, np.zeros((1, 2))).at()
    assert sizes.min() < middle.horizontal[0] * 1.2
    assert found.rms_percent is not None
    assert 0.0 < found.rms_percent < 100.0


def test_percent_are_of_the_diagonal_under_which_the_nodes_that_are_shown_are_seen() -> None:
    """Of a picture on the plane across the eye's direction to the mirror's middle, its sides level and upright."""
    view = View(spline("progressive-c"), POSE, EYE)
    found = grid_distortion(view)
    middle = view.pose.to_vehicle(np.zeros(3))
    ahead = (middle - EYE) / np.linalg.norm(middle - EYE)
    level = np.array([ahead[1], -ahead[0], 0.0]) / np.hypot(ahead[0], ahead[1])
    seen = view.pose.to_vehicle(np.concatenate([found.on_plane[found.shown], np.zeros((found.shown.sum(), 1))], axis=1)) - EYE
    upright = np.cross(level, ahead)
    across, up = seen @ level / (seen @ ahead), seen @ upright / (seen @ ahead)
    diagonal = 60.0 * np.degrees(2.0 * np.arctan(0.5 * np.hypot(np.ptp(across), np.ptp(up))))
    assert found.rms_arcmin is not None
    assert found.max_arcmin is not None
    assert found.rms_percent == pytest.approx(100.0 * found.rms_arcmin / diagonal, rel=1e-9)
    assert found.max_percent == pytest.approx(100.0 * found.max_arcmin / diagonal, rel=1e-9)


def test_a_sphere_distorts_less_the_smaller_it_is_and_the_right_hand_mirror_as_much_as_the_left() -> None:
    rms = [grid_distortion(View(_cap(half), POSE, EYE), 0.5).rms_percent or 0.0 for half in (100.0, 50.0)]
    assert 0.1 < rms[1] / rms[0] < 0.6  # coma-like terms vanish with the field, others with its square
    left = grid_distortion(View(spline("sphere-950"), POSE, EYE))
    right = grid_distortion(View(spline("sphere-950"), replace(POSE, hand="right"), EYE * [1.0, -1.0, 1.0]))
    assert left.rms_arcmin == pytest.approx(right.rms_arcmin, rel=1e-6)
    assert left.max_arcmin == pytest.approx(right.max_arcmin, rel=1e-6)
    assert np.array_equal(left.shown, right.shown[:, ::-1])


def _cap(half_mm: float) -> Reflector:
    whole = quadric("sphere", RADIUS)
    share = half_mm / 115.0
    return replace(whole, surface=replace(whole.surface, loops=(share * whole.surface.loops[0],)))


def test_what_is_too_small_or_wide_for_a_grid_is_not_measured() -> None:
    nothing = grid_distortion(View(_cap(0.5), POSE, EYE))
    assert nothing.rms_arcmin is None
    assert np.isnan(nothing.residual_arcmin).all()
    wide = grid_distortion(View(quadric("sphere", 180.0), Pose(POSE.centre, np.zeros(3), POSE.yaw), EYE))
    assert wide.max_arcmin is not None
    assert np.isfinite(wide.max_arcmin)  # of 120° about the middle, though it shows more
