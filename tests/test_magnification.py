"""How much smaller a mirror shows things: closed forms, the shape operator, exact rays to small things, and invariance."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import mirror_cad
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.surfaces.differential import shape_operator
from mirror_cad.surfaces.quadric import Quadric
from raytrace.load import load_reflector
from raytrace.measures.magnification import MagnificationMap, magnification_extremes, magnification_map
from raytrace.reflector import Reflector
from raytrace.surfaces.plate import Plate
from raytrace.surfaces.quadric import QuadricFace
from raytrace.viewing.pose import Pose
from raytrace.viewing.ray_differentials import frame, ray_differentials
from raytrace.viewing.view import View
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.image_points import image_points
from tests.conftest import constant, designed, spec_of
from tests.meshes import cap
from tests.test_glass import INDEX, T_MM, sheets

Array = NDArray[np.float64]

EYE = np.array([0.0, -490.0, 1900.0])
POSE = Pose(np.array([-540.0, -1010.0, 1760.0]), np.zeros(3), np.radians(15.0), np.radians(3.0))
STRAIGHT = Pose(np.zeros(3), np.zeros(3))  # mirror x, y, z along the vehicle's Y, Z, X
MIDDLE = np.zeros((1, 2))
A, R, BETA = 1500.0, 1200.0, np.radians(27.5)
TANGENTIAL, SAGITTAL = 1.0 / (1.0 + 2.0 * A / (R * np.cos(BETA))), 1.0 / (1.0 + 2.0 * A * np.cos(BETA) / R)


def quadric(kind: str, radius: float) -> Reflector:
    """A convex mirror of 230 × 340 mm that touches z = 0 at the origin: a plane, a sphere, or an upright cylinder."""
    upright = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # its X out of the mirror, its Z up
    u, v = (115.0, 170.0) if kind == "plane" else (np.arcsin(115.0 / radius), 170.0)
    if kind == "sphere":
        v = np.arcsin(170.0 / radius)
    # Points on the sides too: the box of what reflects is that of the loop's points.
    t, one = np.linspace(-1.0, 1.0, 101)[:-1], np.ones(100)
    box = np.concatenate([np.stack(side, axis=1) for side in ((t, -one), (one, t), (-t, one), (-one, -t))]) * [u, v]
    axes = np.eye(3) if kind == "plane" else upright
    shape = Quadric(kind, np.array([0.0, 0.0, -radius]), axes, radius)  # type: ignore[arg-type]
    return Reflector(QuadricFace(shape, (box,)))


def spline(name: str) -> Reflector:
    return Reflector.from_mirror(designed(name))


def eye_at(incidence: float, azimuth: float, distance: float = A) -> Array:
    """At an angle of incidence on the middle of a straight mirror; azimuth 0: to its right, 90°: above."""
    return distance * np.array([np.cos(incidence), np.sin(incidence) * np.cos(azimuth), np.sin(incidence) * np.sin(azimuth)])


def middle_of(view: View, distance_mm: float = np.inf) -> tuple[float, float]:
    found = ray_differentials(view, MIDDLE).at(distance_mm)
    return float(found.horizontal[0]), float(found.vertical[0])


def same(a: MagnificationMap, b: MagnificationMap) -> float:
    """The largest relative difference of two maps that have NaN in the same places."""
    pairs = [(getattr(a.magnification, name), getattr(b.magnification, name)) for name in ("horizontal", "vertical", "area")]
    assert all(np.array_equal(np.isnan(one), np.isnan(other)) for one, other in pairs)
    return float(max(np.nanmax(np.abs(one / other - 1.0)) for one, other in pairs))


# --- closed forms -----------------------------------------------------------------------------------------------------------


def test_a_spherical_mirror_magnifies_as_the_closed_forms_have_it() -> None:
    """M_t = 1/(1 + 2a/(r cos β)) in the plane of incidence, M_s = 1/(1 + 2a cos β/r) across it."""
    assert (round(TANGENTIAL, 4), round(SAGITTAL, 4)) == (0.2619, 0.3108)
    for azimuth, expected in ((0.0, (TANGENTIAL, SAGITTAL)), (0.5 * np.pi, (SAGITTAL, TANGENTIAL)),
                              (np.pi, (TANGENTIAL, SAGITTAL))):
        assert middle_of(View(quadric("sphere", R), STRAIGHT, eye_at(BETA, azimuth))) == pytest.approx(expected, rel=1e-9)


def test_an_object_at_a_distance_is_magnified_by_both_ways_together() -> None:
    """On a sphere a small object at D is seen as (a + D)/(a + D/M) of its size in a flat mirror, M being that of far ones."""
    view = View(quadric("sphere", R), STRAIGHT, eye_at(BETA, 0.0))
    for distance in (10.0, 3000.0, 20_000.0, 1e9):
        expected = tuple((A + distance) / (A + distance / m) for m in (TANGENTIAL, SAGITTAL))
        assert middle_of(view, distance) == pytest.approx(expected, rel=1e-9)


def test_an_upright_cylinder_changes_what_is_level_only() -> None:
    view = View(quadric("cylinder", R), STRAIGHT, eye_at(BETA, 0.0))
    assert middle_of(view) == pytest.approx((TANGENTIAL, 1.0), rel=1e-9)
    across = View(quadric("cylinder", R), STRAIGHT, eye_at(BETA, 0.5 * np.pi))
    assert middle_of(across) == pytest.approx((SAGITTAL, 1.0), rel=1e-9)


def flat_mesh() -> Reflector:
    corners = np.array([[-115.0, -170, 0], [115, -170, 0], [115, 170, 0], [-115, 170, 0]])
    return Reflector.of_mesh(SurfaceMesh(corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)))


@pytest.mark.parametrize("distance", [np.inf, 2000.0])
def test_a_flat_mirror_shows_things_as_large_as_they_are(distance: float) -> None:
    designed_flat = Reflector.from_mirror(mirror_cad.design(spec_of(constant(np.inf), constant(np.inf))))
    plate = sheets(np.inf)
    thick = Reflector(Plate(plate.front, plate.back, plate.index))
    # A mesh's differences span 12 mm or h = 0.015 rad, and to one side are off by h²/3, an area by twice that. A thick plate
    # turns no ray, but moves it: of 2.7 m it takes 2 mm and some more aslant, twice in an area.
    near = 1e-10 if np.isinf(distance) else 3e-3
    for reflector, tolerance in ((quadric("plane", 0.0), 1e-10), (designed_flat, 1e-10), (flat_mesh(), 2e-4), (thick, near)):
        found = magnification_map(View(reflector, POSE, EYE), distance, 9, 13).magnification
        shown = np.isfinite(found.horizontal)
        assert shown.sum() >= 9 * 13 - 24  # but the corners
        for part in (found.horizontal, found.vertical, found.area, found.ratio):
            assert np.abs(part[shown] - 1.0).max() < tolerance


def test_glass_over_a_sphere_magnifies_as_concentric_spheres_do() -> None:
    """ω = 2i − ψ + 2(j − r) of docs/derivations/second-surface.md: across the ray 1/M is dω/dψ in the plane of incidence,
    and sin ω/sin ψ across it, since all is alike about the line from the eye to the centre."""
    radius, distance = 950.0, 700.0
    plate = sheets(radius)
    view = View(Reflector(Plate(plate.front, plate.back, plate.index)), STRAIGHT, np.array([distance, 0.0, 0.0]))
    front, to_centre = radius + T_MM, distance + radius

    def leaves(psi: float) -> float:
        i = np.arcsin(to_centre * np.sin(psi) / front)
        r, j = np.arcsin(np.sin(i) / INDEX), np.arcsin(front * np.sin(i) / INDEX / radius)
        return float(2.0 * i - psi + 2.0 * (j - r))

    for psi in (0.02, 0.06, 0.1):
        place = np.array([[distance * np.tan(psi), 0.0]])
        found = ray_differentials(view, place).at()
        slope = (leaves(psi + 1e-4) - leaves(psi - 1e-4)) / 2e-4
        assert found.horizontal[0] == pytest.approx(1.0 / slope, rel=1e-6)
        assert found.vertical[0] == pytest.approx(np.sin(psi) / np.sin(leaves(psi)), rel=1e-6)


# --- differential geometry --------------------------------------------------------------------------------------------------


def by_the_shape_operator(view: View, x: Array, y: Array) -> tuple[Array, Array]:
    """J and the shift of `ray_differentials` from the B-spline's second derivatives, by the generalised Coddington equation

        J = S·(1 + 2a·cos β·Tᵀ·W·T),

    S being the reflection of what is across the ray, T its projection along the ray onto the tangent plane.
    """
    only = view.reflector.surface
    assert only is not None
    d = only.surface.derivatives(x, y)
    w = shape_operator(d)
    normal = np.cross(d["u"], d["v"])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    e2 = np.stack([np.zeros(len(x)), normal[:, 2], -normal[:, 1]], axis=1)
    e2 /= np.linalg.norm(e2, axis=1, keepdims=True)
    e1 = np.cross(e2, normal)
    ray = d["s"] - view.eye_in_mirror
    path = np.linalg.norm(ray, axis=1)
    ray /= path[:, None]
    cosine = -np.einsum("ni,ni->n", ray, normal)
    reflected = ray + 2.0 * cosine[:, None] * normal
    level = [np.stack(frame(view.pose.directions_to_vehicle(way)), axis=1) for way in (ray, reflected)]
    ray_frame, out_frame = (view.pose.directions_to_mirror(part) for part in level)
    mirrored = ray_frame - 2.0 * np.einsum("nki,ni->nk", ray_frame, normal)[:, :, None] * normal[:, None]
    s = np.einsum("nki,nli->nkl", out_frame, mirrored)
    # T·f = f + ω·(f·n)/cos β, along the ray onto the tangent plane.
    tangent = ray_frame + (np.einsum("nki,ni->nk", ray_frame, normal) / cosine[:, None])[:, :, None] * ray[:, None]
    t = np.einsum("nki,nli->nkl", np.stack([e1, e2], axis=1), tangent)
    operator = np.stack([np.stack([w.w11, w.w12], axis=1), np.stack([w.w12, w.w22], axis=1)], axis=1)
    bend = 2.0 * (path * cosine)[:, None, None] * np.einsum("nki,nkl,nlj->nij", t, operator, t)
    return np.einsum("nik,nkj->nij", s, np.eye(2) + bend), s * path[:, None, None]


@pytest.mark.parametrize("name", ["progressive-a", "progressive-c", "zoned-cylinder", "sphere-950"])
def test_differences_of_exact_rays_agree_with_the_shape_operator(name: str) -> None:
    view = View(spline(name), POSE, EYE)
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-112.0, 112.0, 45), np.linspace(-120.0, 120.0, 25)))
    seen = view.trace_points(view.on_plane_over(x, y)).seen  # not in the outline's corners
    assert seen.sum() > 1000
    x, y = x[seen], y[seen]
    on_plane = view.on_plane_over(x, y)
    assert np.abs(view.trace_points(on_plane).on_mirror[:, :2] - np.stack([x, y], axis=1)).max() < 1e-9
    found = ray_differentials(view, on_plane)
    jacobian, shift = by_the_shape_operator(view, x, y)
    scale = np.linalg.norm(jacobian, axis=(1, 2))
    assert (np.linalg.norm(found.jacobian - jacobian, axis=(1, 2)) / scale).max() < 1e-6
    assert np.abs(found.shift - shift).max() < 1e-6 * found.path_mm.max()


def test_small_far_things_are_seen_as_large_as_the_magnification_says() -> None:
    """Two far points 1′ apart, found in the mirror by the inverse of the view: the angle between the places they are seen."""
    view = View(spline("progressive-c"), POSE, EYE)
    on_plane = np.array([[-90.0, 40.0], [-30.0, -100.0], [60.0, 10.0], [90.0, 100.0]])
    traced = view.trace_points(on_plane)
    found = ray_differentials(view, on_plane).at()
    half = 0.5 * np.radians(1.0 / 60.0)
    for across, expected in zip(frame(traced.directions), (found.horizontal, found.vertical), strict=True):
        ends = [image_points(view, np.cos(half) * traced.directions + sign * np.sin(half) * across, at_infinity=True)[0]
                for sign in (-1.0, 1.0)]
        seen = np.linalg.norm(view.towards(ends[1]) - view.towards(ends[0]), axis=1) / (2.0 * half)
        # The view finds a far point to 1e-10, of 3e-4; and 1′ is not infinitely small.
        assert seen == pytest.approx(expected, rel=2e-6)


# --- invariance, meshes, sampling -------------------------------------------------------------------------------------------


def test_the_right_hand_mirror_is_the_reflection_of_the_left() -> None:
    left = magnification_map(View(spline("progressive-c"), POSE, EYE), columns=11, rows=15)
    right = magnification_map(View(spline("progressive-c"), replace(POSE, hand="right"), EYE * [1.0, -1.0, 1.0]), columns=11,
                              rows=15)
    assert same(left, right) < 1e-9


def test_moving_everything_along_and_turning_it_about_the_vertical_changes_nothing() -> None:
    here = View(spline("progressive-c"), POSE, EYE)
    turn, shift = np.radians(40.0), np.array([120.0, -300.0, 75.0])
    about = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    there = View(here.reflector, replace(POSE, centre=POSE.centre + shift, yaw=POSE.yaw + turn),
                 POSE.centre + shift + about @ (EYE - POSE.centre))
    for distance in (np.inf, 5000.0):
        assert same(magnification_map(here, distance, 11, 15), magnification_map(there, distance, 11, 15)) < 1e-9


def test_a_mesh_of_a_sphere_comes_to_its_magnification_with_finer_facets() -> None:
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-105.0, 105.0, 9), np.linspace(-160.0, 160.0, 13)))
    sphere = View(quadric("sphere", 950.0), POSE, EYE)
    on_plane = sphere.on_plane_over(x, y)
    exact = ray_differentials(sphere, on_plane).at()
    worst = []
    for cells in (30, 60, 120):
        vertices, faces, _ = cap(cells)
        smooth = Reflector.of_mesh(SurfaceMesh(vertices, faces), "interpolated")
        view = View(smooth, POSE, EYE)
        found = ray_differentials(view, on_plane).at()
        ratio = np.stack([found.horizontal / exact.horizontal, found.vertical / exact.vertical])
        assert np.isfinite(ratio).all()
        worst.append(float(np.abs(ratio - 1.0).max()))
        # A facet by itself is flat: those of the facets' own normals are the same.
        facets = ray_differentials(View(Reflector.of_mesh(SurfaceMesh(vertices, faces)), POSE, EYE), on_plane).at()
        assert np.array_equal(facets.horizontal, found.horizontal)
    assert worst[0] < 1e-3
    assert worst[2] < 0.25 * worst[0]  # of first order in the facets' size: 0.15 measured


def test_the_rim_of_a_plate_does_not_show_in_the_magnification_beside_it(tmp_path: Path) -> None:
    """The mesh of a solid goes on round the edge: differences end at the crease."""
    designed("sphere-950").export_stl(tmp_path / "plate.stl")
    plate = load_reflector(tmp_path / "plate.stl", normals="interpolated")
    mesh, exact = (View(reflector, POSE, EYE) for reflector in (plate, spline("sphere-950")))
    on_plane = np.stack(np.meshgrid(np.linspace(-140.0, 100.0, 121), np.linspace(-160.0, 160.0, 33)), axis=2).reshape(-1, 2)
    found, expected = ray_differentials(mesh, on_plane), ray_differentials(exact, on_plane)
    both = found.seen & expected.seen  # not the rim itself
    assert both.sum() > 2000
    for name in ("horizontal", "vertical"):
        off = getattr(found.at(), name)[both] / getattr(expected.at(), name)[both] - 1.0
        assert np.isnan(off).sum() < 5  # at a corner's very top, with the edge on either side
        assert np.nanmax(np.abs(off)) < 2e-3


def test_a_map_holds_the_same_values_however_finely_it_is_sampled() -> None:
    view = View(spline("progressive-c"), POSE, EYE)
    coarse, fine = magnification_map(view, columns=7, rows=5), magnification_map(view, columns=21, rows=15)
    inner = MagnificationMap(fine.x[1::3], fine.y[1::3], fine.on_plane[1::3, 1::3], type(fine.magnification)(
        *(getattr(fine.magnification, name)[1::3, 1::3] for name in ("horizontal", "vertical", "area"))))
    assert np.allclose(coarse.x, inner.x, rtol=0, atol=1e-12)
    assert same(coarse, inner) < 1e-9


def test_the_least_and_the_largest_are_what_is_found_where_they_are_said_to_be_and_no_dense_grid_has_others() -> None:
    for view in (View(spline("progressive-c"), POSE, EYE), View(quadric("sphere", 900.0), POSE, EYE)):
        found = magnification_extremes(view)
        dense = magnification_map(view, columns=121, rows=181)
        shown = view.trace_points(dense.on_plane.reshape(-1, 2)).seen.reshape(dense.on_plane.shape[:2])
        for extent, name in ((found.horizontal, "horizontal"), (found.vertical, "vertical"), (found.ratio, "ratio")):
            assert extent is not None
            values = getattr(dense.magnification, name)[shown]
            assert extent.least <= values.min() * (1.0 + 1e-6)
            assert extent.largest >= values.max() * (1.0 - 1e-6)
            for value, at in ((extent.least, extent.least_at_mm), (extent.largest, extent.largest_at_mm)):
                place = view.untrimmed.on_plane_over(*np.array(at)[:, None])
                assert getattr(ray_differentials(view.untrimmed, place).at(), name)[0] == pytest.approx(value, rel=1e-5)


def test_the_least_is_found_along_an_edge_that_is_nearly_as_small_for_all_its_length() -> None:
    """A strong outer radius: 4 mm beside the least value the edge has one that is 0.4 % larger and level."""
    horizontal = {"law": "zones", "right_mm": 1250.0, "left_mm": 255.0, "blend_from": "match", "blend_to": 1.0,
                  "blend": "smooth", "match": {"sphere_mm": 950.0}}
    vertical = {"law": "linear", "right_mm": 1000.0, "left_mm": 710.0}
    mirror = mirror_cad.design(spec_of(horizontal, vertical))
    view = View(Reflector.from_mirror(mirror), POSE, EYE)
    found = magnification_extremes(view).horizontal
    assert found is not None
    edge = edge_of(view)
    ring = edge.rings()[0]
    on_plane, _ = edge.along(ring, np.linspace(0.0, len(ring), 40_001))
    along = ray_differentials(view.untrimmed, on_plane).at().horizontal
    assert found.least <= np.nanmin(along) * (1.0 + 1e-6)


def test_a_narrow_cone_is_wider_by_the_root_of_its_solid_angle_and_nothing_is_said_beside_the_mirror() -> None:
    view = View(spline("progressive-c"), POSE, EYE)
    on_plane = np.array([[-80.0, 30.0], [50.0, -60.0], [400.0, 0.0]])
    found = ray_differentials(view, on_plane)
    assert found.seen.tolist() == [True, True, False]
    assert found.widening[:2] == pytest.approx(1.0 / np.sqrt(found.at().area[:2]), rel=1e-12)
    assert np.isnan(found.jacobian[2]).all()
    assert np.isnan([found.path_mm[2], found.widening[2], found.at().horizontal[2], found.at(1e4).ratio[2]]).all()


def test_up_to_the_edge_of_what_ends_there_the_derivatives_are_taken_to_the_inner_side() -> None:
    """A quadric goes on nowhere beyond its outline."""
    view = View(quadric("sphere", 950.0), POSE, EYE)
    x_max = view.box[1]
    on_plane = view.on_plane_over(np.array([x_max - 1e-6, x_max - 0.03, x_max - 0.1]), np.zeros(3))
    sphere = view.reflector.surface
    wide = View(Reflector(replace(sphere, loops=(2.0 * sphere.loops[0],))), POSE, EYE)
    found, expected = ray_differentials(view, on_plane), ray_differentials(wide, on_plane)
    assert found.seen.all()
    assert found.at().horizontal == pytest.approx(expected.at().horizontal, rel=1e-6)
    assert found.at().vertical == pytest.approx(expected.at().vertical, rel=1e-6)
