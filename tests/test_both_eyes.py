"""What two eyes see in a mirror: disparity and fields of view, against plane geometry and closed forms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

import mirror_cad
from mirror_cad.mesh import SurfaceMesh
from raytrace.errors import TraceError
from raytrace.load import load_reflector
from raytrace.measures.disparity import disparity
from raytrace.measures.eye_fields import EyeField, extent, eye_fields
from raytrace.measures.field_of_view import traced_fields_of_view
from raytrace.reflector import Reflector
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.plate import Plate
from raytrace.viewing.eye import eye_position
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.pose import Pose
from raytrace.viewing.ray_differentials import frame, ray_differentials
from raytrace.viewing.vehicle import Eyes, HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.image_points import image_points
from tests.conftest import constant, designed, spec_of
from tests.meshes import cap
from tests.test_glass import sheets
from tests.test_magnification import EYE, POSE, quadric, spline

Array = NDArray[np.float64]

EYES = Eyes(EYE)
OWN = HostVehicle(870.0, 0.0, 3900.0, 2200.0)
LEVEL = Eyes(np.array([0.0, -490.0, 1760.0]))  # at the height of the mirror's middle
UPRIGHT = replace(POSE, pitch=0.0)
RADIUS = 950.0


class LevelSphere:
    """A sphere's horizontal section, seen from its own height: all in plan, (X, Y)."""

    def __init__(self, pose: Pose, eye: Array) -> None:
        self.centre = pose.to_vehicle(np.array([0.0, 0.0, -RADIUS]))[:2]
        self.facing = np.arctan2(*pose.directions_to_vehicle(np.array([0.0, 0.0, 1.0]))[1::-1])
        self.eye = eye[:2]

    def ray(self, angle: float) -> tuple[float, float, float]:
        """The reflected azimuth, the distance of the eye and the cosine of the incidence at an angle off the middle."""
        normal = np.array([np.cos(self.facing + angle), np.sin(self.facing + angle)])
        way = self.centre + RADIUS * normal - self.eye
        distance = float(np.linalg.norm(way))
        way = way / distance
        cosine = -float(way @ normal)
        out = way + 2.0 * cosine * normal
        return float(np.arctan2(out[1], out[0])), distance, cosine

    def magnification(self, azimuth: float) -> float:
        angle = brentq(lambda a: self.ray(a)[0] - azimuth, -0.4, 0.4, xtol=1e-15)
        _, distance, cosine = self.ray(angle)
        return 1.0 / (1.0 + 2.0 * distance / (RADIUS * cosine))


# --- disparity --------------------------------------------------------------------------------------------------------------


def test_a_flat_mirror_has_no_disparity() -> None:
    flat = mirror_cad.design(spec_of(constant(np.inf), constant(np.inf)))
    for reflector in (quadric("plane", 0.0), Reflector.from_mirror(flat)):
        for size in ("horizontal", "vertical", "area"):
            found = disparity(EyeViews.of(reflector, POSE, EYES), size, 9, 5)  # type: ignore[arg-type]
            assert np.isfinite(found.percent).sum() > 15
            assert np.nanmax(np.abs(found.percent)) < 1e-8
            assert found.max_percent == pytest.approx(0.0, abs=1e-8)
            assert found.max_rate_percent_per_mm == pytest.approx(0.0, abs=1e-8)


def test_the_disparity_of_a_sphere_is_that_of_its_closed_form_at_each_eyes_own_place() -> None:
    views = EyeViews.of(quadric("sphere", RADIUS), UPRIGHT, LEVEL)
    found = disparity(views, columns=15, rows=3)  # the middle row is at the eyes' height
    left, right = LevelSphere(UPRIGHT, LEVEL.left), LevelSphere(UPRIGHT, LEVEL.right)
    traced = views.middle.trace_points(found.on_plane[1])
    assert np.abs(traced.directions[:, 2]).max() < 1e-9
    compared = 0
    for percent, way in zip(found.percent[1], traced.directions, strict=True):
        if np.isfinite(percent):
            azimuth = float(np.arctan2(way[1], way[0]))
            m_left, m_right = left.magnification(azimuth), right.magnification(azimuth)
            assert percent == pytest.approx(200.0 * (m_left - m_right) / (m_left + m_right), abs=1e-6)
            compared += 1
    assert compared >= 12
    assert found.max_percent is not None
    assert found.max_percent > 2.0  # the left eye is nearer to the left mirror


def test_one_eye_has_no_disparity_and_eyes_exchanged_by_reflection_have_the_opposite_one() -> None:
    reflector = spline("progressive-c")
    alone = disparity(EyeViews.of(reflector, POSE, Eyes(EYE, 0.0)), columns=9, rows=5)
    assert np.nanmax(np.abs(alone.percent)) == 0.0
    left = disparity(EyeViews.of(reflector, POSE, EYES), columns=9, rows=5)
    right = disparity(EyeViews.of(reflector, replace(POSE, hand="right"), Eyes(EYE * [1.0, -1.0, 1.0])), columns=9, rows=5)
    assert np.array_equal(np.isnan(left.percent), np.isnan(right.percent))
    assert np.nanmax(np.abs(left.percent + right.percent)) < 1e-6
    assert left.max_percent == pytest.approx(-float(right.max_percent or 0.0), rel=1e-6)


def test_disparity_does_not_depend_on_the_sampling_and_its_largest_values_converge() -> None:
    views = EyeViews.of(spline("progressive-c"), POSE, EYES)
    usual = disparity(views)
    dense = disparity(views, columns=93, rows=45)
    assert np.nanmax(np.abs(dense.percent[1::3, 1::3] - usual.percent)) < 1e-7
    assert usual.max_percent == pytest.approx(dense.max_percent, rel=1e-3)
    assert usual.max_rate_percent_per_mm == pytest.approx(dense.max_rate_percent_per_mm, rel=0.03)  # on a slanting edge
    assert abs(usual.max_percent or 0.0) >= np.nanmax(np.abs(usual.percent))


def test_the_rate_is_the_derivative_along_a_row() -> None:
    views = EyeViews.of(quadric("sphere", RADIUS), UPRIGHT, LEVEL)
    found = disparity(views, columns=45, rows=1)
    left, right = LevelSphere(UPRIGHT, LEVEL.left), LevelSphere(UPRIGHT, LEVEL.right)
    middle = LevelSphere(UPRIGHT, LEVEL.middle)

    def percent(x: float) -> float:
        azimuth = middle.ray(np.arcsin(x / RADIUS))[0]
        a, b = left.magnification(azimuth), right.magnification(azimuth)
        return 200.0 * (a - b) / (a + b)

    compared = 0
    for k in range(1, 44):
        if np.isfinite(found.percent[0, k - 1:k + 2]).all():  # where the map has it from both neighbours, 5 mm away
            expected = percent(found.x[k] + 0.5) - percent(found.x[k] - 0.5)
            assert found.rate_percent_per_mm[0, k] == pytest.approx(expected, abs=2e-6)
            compared += 1
    assert compared > 35


def test_two_eyes_see_a_direction_at_places_as_far_apart_as_they_are_times_the_magnification() -> None:
    """M·b across the sight, b being the eyes' distance across it (docs/derivations/what-the-eye-sees.md)."""
    apart = 0.1
    views = EyeViews.of(spline("progressive-c"), POSE, Eyes(EYE, apart))
    on_plane = np.array([[-70.0, 20.0], [-20.0, -60.0], [80.0, 90.0]])
    way = views.middle.trace_points(on_plane).directions
    left, right = (view.towards(image_points(view, way, at_infinity=True)[0]) for view in (views.left, views.right))
    found = ray_differentials(views.middle, on_plane)
    # The place moves by a·J⁻¹·S·b/a, a·S being the shift of the ray, and the eye itself by b: the direction, by 1/a of both.
    across = np.stack(frame(views.middle.towards(on_plane)), axis=1)
    b = np.einsum("nki,i->nk", across, [0.0, apart, 0.0])
    moved = np.linalg.solve(found.jacobian, np.einsum("nij,nj->ni", found.shift, b)[..., None])[..., 0] / found.path_mm[:, None]
    turned = np.einsum("nki,ni->nk", across, right - left)
    assert turned * found.path_mm[:, None] == pytest.approx(moved - b, abs=1e-4 * apart)


def test_the_disparity_of_a_mesh_is_that_of_its_sphere_but_for_its_facets() -> None:
    vertices, faces, _ = cap(60)
    mesh = disparity(EyeViews.of(Reflector.of_mesh(SurfaceMesh(vertices, faces), "facets"), POSE, EYES), columns=9, rows=5)
    sphere = EyeViews.of(quadric("sphere", RADIUS), POSE, EYES)
    on_plane = sphere.middle.on_plane_over(*(axis.ravel() for axis in np.meshgrid(mesh.x, mesh.y)))
    inside = sphere.middle.trace_points(on_plane).seen.reshape(5, 9)
    assert inside.sum() > 20
    percent = disparity(EyeViews.of(spline("sphere-950"), POSE, EYES), columns=9, rows=5).percent
    assert np.nanmean(mesh.percent[inside]) == pytest.approx(np.nanmean(percent), abs=0.3)
    assert np.nanmax(np.abs(mesh.percent)) < 6.0


# --- fields of view ---------------------------------------------------------------------------------------------------------


def test_either_and_both_are_union_and_intersection() -> None:
    field = EyeField(left=((-30.0, -20.0), (-10.0, 5.0)), right=((-25.0, -12.0), (0.0, 7.0)))
    assert field.either == ((-30.0, -12.0), (-10.0, 7.0))
    assert field.both == ((-25.0, -20.0), (0.0, 5.0))
    assert extent(field.either) + extent(field.both) == pytest.approx(extent(field.left) + extent(field.right))
    assert EyeField((), ()).either == EyeField((), ()).both == ()


def test_a_level_sphere_shows_of_the_horizon_what_plane_geometry_says() -> None:
    views = EyeViews.of(quadric("sphere", RADIUS), UPRIGHT, LEVEL)
    found = eye_fields(views)
    half = float(np.arcsin(115.0 / RADIUS))
    for eye, seen in ((LEVEL.left, found.horizon.left), (LEVEL.right, found.horizon.right)):
        plan = LevelSphere(UPRIGHT, eye)
        expected = sorted(np.degrees([plan.ray(-half)[0], plan.ray(half)[0]]))
        assert len(seen) == 1
        assert seen[0] == pytest.approx(expected, abs=1e-8)
    # Nothing is hidden without a vehicle; both edges lie on the row y = 0.
    assert found.horizon_clear == found.horizon
    plan = LevelSphere(UPRIGHT, LEVEL.middle)
    assert found.between_edges_deg[1] == pytest.approx(np.degrees(plan.ray(half)[0] - plan.ray(-half)[0]), abs=1e-5)


def test_a_flat_mirror_shows_what_its_images_of_the_eyes_see_through_it() -> None:
    """A flat mirror is a window for the eye's image behind it."""
    found = eye_fields(EyeViews.of(quadric("plane", 0.0), UPRIGHT, LEVEL))
    corners = UPRIGHT.to_vehicle(np.array([[-115.0, 0.0, 0.0], [115.0, 0.0, 0.0]]))
    normal = UPRIGHT.directions_to_vehicle(np.array([0.0, 0.0, 1.0]))
    for eye, seen in ((LEVEL.left, found.horizon.left), (LEVEL.right, found.horizon.right)):
        way = corners - (eye - 2.0 * ((eye - UPRIGHT.centre) @ normal) * normal)
        assert seen[0] == pytest.approx(sorted(np.degrees(np.arctan2(way[:, 1], way[:, 0]))), abs=1e-8)


def test_the_flank_ends_the_view_where_a_level_ray_passes_the_rear_edge() -> None:
    """And the field that is left is that of the mirror but for what lies inboard of it."""
    views = EyeViews.of(spline("progressive-c"), POSE, EYES)
    found = eye_fields(views, OWN)
    edge = np.array([OWN.rear_mm, -OWN.half_width_mm])
    for view, bare, clear in ((views.left, found.horizon.left, found.horizon_clear.left),
                              (views.right, found.horizon.right, found.horizon_clear.right)):
        assert clear[0][0] == pytest.approx(bare[0][0], abs=1e-9)
        azimuth = np.radians(clear[0][1])
        way = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        on_plane, shown = image_points(view, way[None], at_infinity=True)
        assert shown[0]
        start = view.trace_points(on_plane).points[0, :2]
        passes = way[0] * (edge - start)[1] - way[1] * (edge - start)[0]
        assert abs(passes) < 1e-5  # mm at the edge, 4 m away: 1e-9 rad


@pytest.mark.parametrize("hand", ["left", "right"])
def test_every_direction_of_a_field_is_shown_and_none_beside_it(hand: str) -> None:
    """By the inverse of the view, which finds the place of a direction otherwise."""
    side = 1.0 if hand == "left" else -1.0
    eyes = Eyes(EYE * [1.0, side, 1.0])
    views = EyeViews.of(spline("progressive-c"), replace(POSE, hand=hand), eyes)  # type: ignore[arg-type]
    found = eye_fields(views, OWN)
    assert found.azimuth_deg is not None
    assert found.upright is not None
    level = np.array([np.cos(np.radians(found.azimuth_deg)), np.sin(np.radians(found.azimuth_deg)), 0.0])
    for view, horizon, upright in ((views.left, found.horizon.left, found.upright.left),
                                   (views.right, found.horizon.right, found.upright.right)):
        for (low, high), base, other in ((horizon[0], np.array([1.0, 0, 0]), np.array([0, 1.0, 0])),
                                         (upright[0], level, np.array([0, 0, 1.0]))):
            angles = np.radians(np.concatenate([np.linspace(low + 1e-7, high - 1e-7, 41), [low - 1e-7, high + 1e-7]]))
            ways = np.cos(angles)[:, None] * base + np.sin(angles)[:, None] * other
            assert image_points(view, ways, at_infinity=True)[1].tolist() == [True] * 41 + [False, False]
    if hand == "right":
        mirrored = eye_fields(EyeViews.of(spline("progressive-c"), POSE, EYES), OWN)
        for a, b in ((found.horizon.left, mirrored.horizon.right), (found.horizon_clear.right, mirrored.horizon_clear.left)):
            assert (-a[0][1], -a[0][0]) == pytest.approx(b[0], abs=1e-8)


def test_the_field_between_the_edges_is_the_contracts_for_the_mirror_of_the_paper() -> None:
    """With the eye where the paper has it; bare and through glass."""
    glass = mirror_cad.design(spec_of({"law": "zones", "right_mm": 1250.0, "left_mm": 400.0, "blend_from": 0.5865},
                                      constant(1300.0), glass={"reflecting": "back"}))
    straight = Pose(np.zeros(3), np.zeros(3))
    for mirror in (designed("progressive-c"), glass):
        at = eye_position(762.0, "right", mirror.box)
        views = EyeViews.of(Reflector.from_mirror(mirror), straight, Eyes(straight.to_vehicle(at)))
        loops = (np.zeros((1, 2)),)
        face = BSplineFace(mirror.surface, loops)
        sheet = face if mirror is not glass else Plate(BSplineFace(mirror.plate.front, loops), face, mirror.spec.glass.index)
        expected = np.degrees(traced_fields_of_view(sheet, at, mirror.box, mirror.left_height_mm)[0])
        assert eye_fields(views).between_edges_deg[1] == pytest.approx(expected, abs=1e-8)


def test_linear_curvature_widens_the_view_by_the_arc_times_the_sum_of_its_ends_for_an_eye_at_infinity() -> None:
    """W·(κ1 + κ2): the normal turns by ∫κ ds from edge to edge, the reflected ray by twice that."""
    k1, k2, arc = 1.0 / 1250.0, 1.0 / 400.0, 230.0
    s = np.linspace(-0.6 * arc, 0.6 * arc, 2001)
    kappa = k1 + (k2 - k1) * (0.5 - s / arc)  # from the right edge to the left
    # x(s) = ∫cos θ ds with θ = ∫κ ds, level in the middle of the arc.
    theta = (0.5 * (k1 + k2)) * s - (k2 - k1) * s**2 / (2.0 * arc)
    x = np.concatenate([[0.0], np.cumsum(0.5 * (np.cos(theta[1:]) + np.cos(theta[:-1])) * np.diff(s))])
    x -= np.interp(0.0, s, x)
    ends = np.interp([-0.5 * arc, 0.5 * arc], s, x)
    middle, width = float(ends.mean()), float(ends[1] - ends[0])
    pick = slice(None, None, 20)
    law = {"law": "table", "x_mm": (x[pick] - middle).tolist(), "curvature_per_mm": kappa[pick].tolist()}
    mirror = mirror_cad.design(spec_of(law, constant(np.inf), outline={
        "width_mm": width, "left_height_mm": 300.0, "right_height_mm": 300.0, "corner_radius_mm": 20.0}))
    straight = Pose(np.zeros(3), np.zeros(3))
    far = Eyes(np.array([1e9, 0.0, 0.0]))  # mm: its rays part by 2e-7 rad over the mirror
    found = eye_fields(EyeViews.of(Reflector.from_mirror(mirror), straight, far))
    expected = np.degrees(arc * (k1 + k2))
    assert extent(found.horizon.left) == pytest.approx(expected, abs=1e-3)
    assert extent(found.horizon.right) == pytest.approx(expected, abs=1e-3)
    assert found.between_edges_deg[1] == pytest.approx(expected, abs=1e-3)


def test_two_mirrors_with_a_gap_show_two_intervals_of_the_horizon() -> None:
    corners, faces = [], []
    for k, (left, right) in enumerate(((-115.0, -20.0), (10.0, 115.0))):
        corners += [[left, -150.0, 0.0], [right, -150.0, 0.0], [right, 150.0, 0.0], [left, 150.0, 0.0]]
        faces += [[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]
    reflector = Reflector.of_mesh(SurfaceMesh(np.array(corners), np.array(faces, dtype=np.int32)))
    found = eye_fields(EyeViews.of(reflector, UPRIGHT, LEVEL))
    edges = UPRIGHT.to_vehicle(np.array([[x, 0.0, 0.0] for x in (-115.0, -20.0, 10.0, 115.0)]))
    normal = UPRIGHT.directions_to_vehicle(np.array([0.0, 0.0, 1.0]))
    way = edges - (LEVEL.left - 2.0 * ((LEVEL.left - UPRIGHT.centre) @ normal) * normal)
    expected = np.sort(np.degrees(np.arctan2(way[:, 1], way[:, 0])))
    # Embree's edges are float32's: 1e-4 mm at 0.6 m.
    assert np.array(found.horizon.left).ravel() == pytest.approx(expected, abs=5e-5)


def test_a_mesh_and_glass_show_nearly_the_same_field_as_the_sphere_itself() -> None:
    bare = spline("sphere-950")
    plate = sheets(RADIUS)
    loop = bare.surface.loops
    thick = Reflector(Plate(replace(plate.front, loops=loop), replace(plate.back, loops=loop), plate.index))
    vertices, faces, _ = cap(60)
    field = eye_fields(EyeViews.of(thick, POSE, EYES), OWN)
    alone = eye_fields(EyeViews.of(bare, POSE, EYES), OWN)
    # Black sides take 0.1 to 0.2° (docs/derivations/second-surface.md); sphere-950 is the sphere but for 0.07 mm.
    assert 0.05 < extent(alone.horizon.left) - extent(field.horizon.left) < 0.4
    assert field.horizon_clear.left[0][1] == pytest.approx(alone.horizon_clear.left[0][1], abs=0.02)
    mesh = Reflector.of_mesh(SurfaceMesh(vertices, faces), "interpolated")
    box = quadric("sphere", RADIUS)
    wide = replace(box, surface=replace(box.surface, loops=(np.array(  # the mesh's own outline, in its parameters
        [[np.arctan2(x, np.sqrt(RADIUS**2 - x**2 - y**2)), np.arcsin(y / RADIUS)] for x, y in _rim(125.0, 190.0)]),)))
    by_mesh, by_sphere = (eye_fields(EyeViews.of(r, POSE, EYES), OWN) for r in (mesh, wide))
    for one, other in ((by_mesh.horizon, by_sphere.horizon), (by_mesh.horizon_clear, by_sphere.horizon_clear)):
        assert np.array(one.left) == pytest.approx(np.array(other.left), abs=2e-3)
        assert np.array(one.right) == pytest.approx(np.array(other.right), abs=2e-3)


def test_the_rim_of_a_plate_is_no_part_of_its_field(tmp_path: Path) -> None:
    designed("sphere-950").export_stl(tmp_path / "plate.stl")
    by_mesh, exact = (eye_fields(EyeViews.of(reflector, POSE, EYES), OWN) for reflector in (
        load_reflector(tmp_path / "plate.stl", normals="interpolated"), spline("sphere-950")))
    for name in ("horizon", "horizon_clear", "upright"):
        one, other = getattr(by_mesh, name), getattr(exact, name)
        assert np.array(one.left) == pytest.approx(np.array(other.left), abs=0.01)
        assert np.array(one.right) == pytest.approx(np.array(other.right), abs=0.01)
    assert by_mesh.between_edges_deg == pytest.approx(exact.between_edges_deg, abs=0.02)


def _rim(half_width: float, half_height: float) -> Array:
    """Points round a rectangle."""
    t = np.linspace(-1.0, 1.0, 201)[:-1]
    one = np.ones_like(t)
    return np.concatenate([np.stack(pair, axis=1) * [half_width, half_height]
                           for pair in ((t, -one), (one, t), (-t, one), (-one, -t))])


def test_a_mirror_that_looks_at_the_ground_shows_nothing_of_the_horizon() -> None:
    views = EyeViews.of(quadric("sphere", RADIUS), replace(POSE, pitch=np.radians(-35.0)), EYES)
    found = eye_fields(views, OWN)
    assert found.horizon == found.horizon_clear == EyeField((), ())
    assert found.upright is not None
    assert all(high < 0.0 for _, high in found.upright.left)


def test_an_eye_behind_the_mirror_is_refused() -> None:
    with pytest.raises(TraceError, match="behind the face"):
        EyeViews.of(quadric("sphere", RADIUS), POSE, Eyes(np.array([-2000.0, -490.0, 1900.0])))


def test_views_are_those_of_the_two_eyes_and_their_middle() -> None:
    views = EyeViews.of(spline("sphere-950"), POSE, EYES)
    assert [view.eye[1] for view in (views.left, views.middle, views.right)] == [-522.5, -490.0, -457.5]
    assert all(isinstance(view, View) for view in (views.left, views.middle, views.right))
