"""Glass that reflects from its back: closed forms, reversibility, files, the driver's view, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import brentq

import mirror_cad
import raytrace
from mirror_cad.mirror import Mirror
from mirror_cad.occt.shapes import solids_of
from mirror_cad.occt.solid import is_valid, plate
from mirror_cad.occt.step import read_step
from mirror_cad.stl_file import read_stl
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import collocate
from mirror_cad.surfaces.differential import normals
from mirror_cad.surfaces.offset import offset_surface
from mirror_studio.cli import run
from raytrace.assembly import FRONT_FACE, OPTICAL_FACE
from raytrace.measures.field_of_view import angle_between, traced_fields_of_view
from raytrace.measures.ghost import ghost, reflectance
from raytrace.rays import Rays, Status, Trace
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.plate import Plate, refract
from raytrace.trace import reflect
from raytrace.viewing.eye import eye_position
from tests.conftest import constant, designed, spec_of
from tests.test_plate import assert_closed_and_outward, plate_volume

Array = NDArray[np.float64]

T_MM, INDEX = 3.0, 1.52
ARCMIN = np.degrees(1.0) * 60.0
BOX = (-115.0, 115.0, -163.45, 163.45)
EYE = eye_position(762.0, "right", BOX)
ZONES = {"law": "zones", "right_mm": 1250.0, "left_mm": 400.0, "blend_from": 0.5865}


def unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@cache
def cap(radius: float, offset: float = 0.0, half: tuple[float, float] = (150.0, 200.0)) -> BSplineFace:
    """The offset of a sphere that touches z = 0 from below, on the sphere's x and y, to rounding; radius inf: a plane."""
    degree, spans = 9, 28
    knots = [np.concatenate([[-h] * degree, np.linspace(-h, h, spans + 1), [h] * degree]) for h in half]

    def place(u: Array, v: Array) -> Array:
        x, y = np.meshgrid(u, v, indexing="ij")
        if np.isinf(radius):
            return np.stack([x, y, np.full_like(x, offset)], axis=-1)
        normal = np.stack([x, y, np.sqrt(radius**2 - x**2 - y**2)], axis=-1) / abs(radius)
        if radius < 0:
            normal[..., :2] *= -1.0
        return np.stack([x, y, np.zeros_like(x)], axis=-1) + offset * normal + np.stack(
            [0.0 * x, 0.0 * x, np.sign(radius) * (np.sqrt(radius**2 - x**2 - y**2) - abs(radius))], axis=-1)

    return BSplineFace(collocate(place, knots[0], knots[1], degree), (np.zeros((1, 2)),)).untrimmed()


def trace_through(front: BSplineFace, back: BSplineFace, index: float, origins: np.ndarray, directions: np.ndarray,
                  out: Trace | None = None) -> Trace:
    return reflect(raytrace.Reflector(Plate(front, back, index)), origins, directions, out)


def sheets(radius: float, index: float = INDEX, thickness_mm: float = T_MM) -> Plate:
    return Plate(cap(radius, thickness_mm), cap(radius), index)


@cache
def back_mirror() -> Mirror:
    return mirror_cad.design(spec_of(ZONES, constant(1300.0), glass={"reflecting": "back"}))


def faces_of(mirror: Mirror) -> tuple[BSplineFace, BSplineFace]:
    """Front and back of a designed plate, inside its outline."""
    loop = (mirror.outline.polyline(1e-5),)
    return BSplineFace(mirror.plate.front, loop), BSplineFace(mirror.plate.back, loop)


def grid_rays(n: int = 60) -> Array:
    x, y = np.meshgrid(np.linspace(-112, 112, n), np.linspace(-120, 120, n))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) - EYE


# --- Snell ------------------------------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(st.floats(0.0, 89.999), st.floats(0.0, 360.0), st.floats(1.0, 3.0), st.booleans())
def test_refraction_keeps_snells_invariant_and_goes_back_as_it_came(incidence: float, azimuth: float, n: float,
                                                                    turned: bool) -> None:
    i, a = np.radians(incidence), np.radians(azimuth)
    d = np.array([[np.sin(i) * np.cos(a), np.sin(i) * np.sin(a), -np.cos(i)]])
    normal = np.array([[0.0, 0.0, -1.0 if turned else 1.0]])
    inside, total = refract(d, normal, 1.0 / n)
    assert not total.any()
    assert np.linalg.norm(inside) == pytest.approx(1.0, abs=1e-15)
    assert np.abs(n * np.cross(inside, normal) - np.cross(d, normal)).max() < 1e-15
    assert inside[0, 2] < 0.0
    again, total = refract(-inside, normal, n)
    # The way out takes cos² i as a difference of squares of the size n²: their rounding, some ε·n², over 2·cos i.
    assert np.abs(again + d).max() < 1e-15 + 2.0 * np.finfo(float).eps * n * n / np.cos(i)


def test_a_ray_beyond_the_critical_angle_is_flagged_and_none_without_a_step_of_index() -> None:
    angle = np.arcsin(1.0 / INDEX) + np.array([-1e-9, 1e-9, 0.2])
    d = np.stack([np.sin(angle), np.zeros(3), np.cos(angle)], axis=1)
    normals = np.tile([0.0, 0.0, 1.0], (3, 1))
    out, total = refract(d, normals, INDEX)
    assert total.tolist() == [False, True, True]
    assert np.isnan(out[1:]).all()
    grazing = unit(np.array([[1.0, 0.0, -1e-12]]))
    same, total = refract(grazing, normals[:1], 1.0)
    assert not total.any()
    assert np.array_equal(same, grazing)


def test_fresnel_at_normal_incidence_at_brewsters_angle_and_grazing() -> None:
    assert reflectance(np.array([1.0]), INDEX)[0] == pytest.approx(((INDEX - 1) / (INDEX + 1)) ** 2, rel=1e-14)
    assert reflectance(np.array([1.0]), INDEX)[0] == pytest.approx(0.0426, abs=5e-5)
    brewster = np.cos(np.arctan(INDEX))  # there only light across the plane of incidence is reflected
    across = ((1.0 - INDEX**2) / (1.0 + INDEX**2)) ** 2
    assert reflectance(np.array([brewster]), INDEX)[0] == pytest.approx(0.5 * across, rel=1e-13)
    assert reflectance(np.array([1e-9]), INDEX)[0] == pytest.approx(1.0, abs=1e-7)
    assert (reflectance(np.array([1.0, 0.5, 1e-3]), 1.0) == 0.0).all()


# --- closed forms -----------------------------------------------------------------------------------------------------------


def test_a_plane_parallel_plate_is_a_plane_mirror_whose_ray_is_shifted_by_twice_t_tan_r() -> None:
    rays = grid_rays()
    trace = trace_through(cap(np.inf, T_MM), cap(np.inf), INDEX, EYE, rays)
    assert set(trace.counts()) == {"reflected"}
    d = unit(rays)
    assert np.abs(trace.directions - d * [1.0, 1.0, -1.0]).max() < 1e-14
    r = np.arcsin(np.hypot(d[:, 0], d[:, 1]) / INDEX)
    entry = EYE + ((T_MM - EYE[2]) / d[:, 2])[:, None] * d
    shift = 2.0 * T_MM * np.tan(r)[:, None] * d[:, :2] / np.hypot(d[:, 0], d[:, 1])[:, None]
    assert np.abs(trace.points - entry - np.pad(shift, ((0, 0), (0, 1)))).max() < 1e-11
    assert trace.distances == pytest.approx(np.linalg.norm(entry - EYE, axis=1), abs=1e-11)
    # Paraxially the mirror lies t/n behind the front: the apparent depth.
    near = np.array([[1e-4, 0.0, -1.0]])
    steep = trace_through(cap(np.inf, T_MM), cap(np.inf), INDEX, np.array([0.0, 0.0, 700.0]), near)
    assert 0.5 * (steep.points[0, 0] - 1e-4 * (700.0 - T_MM)) / 1e-4 == pytest.approx(T_MM / INDEX, rel=1e-7)


def concentric(radius: float, psi: Array, distance: float, index: float = INDEX) -> dict[str, Array]:
    """Rays in a plane through the centre of spheres of radii R and R + t: all angles from the sine rule alone.

    psi : at the eye, from the line to the centre, which is `distance` away. `back`, `exit` : where a ray is reflected and
    where it leaves. `image`, `ghost` : directions in which the two rays leave. All but psi from the line centre to eye.
    """
    i = np.arcsin(distance * np.sin(psi) / (radius + T_MM))
    r = np.arcsin(np.sin(i) / index)
    j = np.arcsin((radius + T_MM) * np.sin(r) / radius)
    turned = 2.0 * (j - r)
    return {"back": i - psi + 0.5 * turned, "exit": i - psi + turned, "ghost": 2.0 * i - psi, "image": 2.0 * i - psi + turned}


@pytest.mark.parametrize("radius", [1250.0, 950.0, 400.0])
def test_concentric_spheres_follow_the_sine_rule(radius: float) -> None:
    """Any ray lies in a plane through the centre: places and directions in space from the angles in it."""
    rays = grid_rays()
    trace = trace_through(cap(radius, T_MM), cap(radius), INDEX, EYE, rays)
    assert set(trace.counts()) == {"reflected"}
    d, from_centre = unit(rays), EYE + [0.0, 0.0, radius]
    distance = float(np.linalg.norm(from_centre))
    axis = from_centre / distance
    psi = np.arctan2(np.linalg.norm(np.cross(d, -axis), axis=1), -d @ axis)
    across = unit(d - (d @ axis)[:, None] * axis)
    angles = concentric(radius, psi, distance)

    def at(angle: Array) -> Array:
        return np.cos(angle)[:, None] * axis + np.sin(angle)[:, None] * across

    # What is left is rounding of coordinates and angles, and what the collocation of the caps leaves of their slopes.
    exit_place = (radius + T_MM) * at(angles["exit"]) - [0.0, 0.0, radius]
    assert np.abs(trace.points - exit_place).max() < 1e-11
    assert np.abs(trace.directions - at(angles["image"])).max() < 1e-12
    assert np.abs(trace.normals - at(angles["back"])).max() < 1e-12


def test_the_way_back_is_the_way_there() -> None:
    front, back = faces_of(back_mirror())
    rays = grid_rays()
    there = trace_through(front, back, INDEX, EYE, rays)
    through = there.status == Status.REFLECTED
    assert through.sum() > 3000
    out = there.directions[through]
    again = trace_through(front, back, INDEX, there.points[through] + 700.0 * out, -out)
    assert set(again.counts()) == {"reflected"}
    assert np.abs(again.directions + unit(rays)[through]).max() < 1e-12
    # The ray runs through the eye again.
    assert np.abs(np.cross(again.points - EYE, again.directions)).max() < 1e-9


def test_glass_of_index_1_is_no_glass() -> None:
    front, back = faces_of(back_mirror())
    rays = grid_rays()
    bare = reflect(raytrace.Reflector(back), EYE, rays)
    glass = trace_through(front, back, 1.0, EYE, rays)
    both = (bare.status == Status.REFLECTED) & (glass.status == Status.REFLECTED)
    assert both.sum() > 3000
    assert np.abs(glass.directions - bare.directions)[both].max() < 1e-12
    assert np.abs(glass.normals - bare.normals)[both].max() < 1e-12
    assert np.abs(np.cross(glass.points - bare.points, bare.directions))[both].max() < 1e-11


@pytest.mark.parametrize("radius", [130.0, 400.0, -400.0])
@pytest.mark.parametrize("thickness_mm", [0.001, 0.02, 8.0])
def test_thin_and_thick_glass_loses_no_ray(radius: float, thickness_mm: float) -> None:
    half = (70.0, 70.0)
    x, y = np.meshgrid(np.linspace(-45, 45, 40), np.linspace(-45, 45, 40))
    eye = np.array([20.0, 0.0, 300.0])
    rays = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) - eye
    trace = trace_through(cap(radius, thickness_mm, half), cap(radius, 0.0, half), INDEX, eye, rays)
    assert set(trace.counts()) == {"reflected"}


# --- fates ------------------------------------------------------------------------------------------------------------------


def test_fates_of_rays_beside_the_front_at_its_rim_from_behind_and_bad_ones() -> None:
    front, back = faces_of(back_mirror())
    left = float(back_mirror().plate.front.evaluate(-115.0, 0.0)[0])
    origins = np.array([[0.0, 0, 500], [300.0, 0, 500], [left + 0.05, 0, 500], [0, 0, -500], [0, 0, 500], [0, 0, np.nan]])
    directions = np.array([[0.0, 0, -1], [0, 0, -1], [0, 0, -1], [0, 0, 1], [0, 0, 0], [0, 0, -1]])
    trace = trace_through(front, back, INDEX, origins, directions)
    assert trace.status.tolist() == [Status.REFLECTED, Status.MISSED, Status.BLOCKED, Status.BEHIND, Status.INVALID,
                                     Status.INVALID]
    for rows in (trace.points, trace.normals, trace.directions):
        assert np.isnan(rows[1:]).all()
    assert np.isnan(trace.distances[[1, 2, 4, 5]]).all()
    assert trace.distances[0] == pytest.approx(500.0 - T_MM, abs=1e-5)


def plates_of_many_kinds() -> list[Plate]:
    """Cut and whole, convex, flat and concave, thin, thick, wedges, and sheets that do not lie over each other.

    Of the last three one is coated within its edge and but for a hole, one reflects totally at its front from whole blocks of
    rays, and of one the back lies before the front on one side.
    """
    front, back = faces_of(back_mirror())
    small = (70.0, 70.0)
    ball, wedge = cap(130.0, 0.0, small), cap(150.0, 0.0, small)
    return [Plate(front, back, INDEX), sheets(400.0), sheets(-500.0, 1.9, 6.0), sheets(np.inf, 1.0), sheets(950.0, 1.5, 0.001),
            Plate(cap(130.0, 8.0, small), ball, INDEX), Plate(cap(np.inf, 60.0), wedge, INDEX),
            Plate(cap(950.0, T_MM), replace(cap(950.0), loops=(rectangle(100.0, 120.0), rectangle(30.0, 20.0))), INDEX),
            Plate(cap(np.inf, 60.0), tilted(14.0), INDEX), Plate(cap(np.inf, 1.0), tilted(2.0), INDEX)]


def rectangle(x: float, y: float) -> Array:
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])


def tilted(degrees: float) -> BSplineFace:
    """A plane through the y axis."""
    flat = cap(np.inf).surface
    poles = flat.poles.copy()
    poles[..., 2] += np.tan(np.radians(degrees)) * poles[..., 0]
    return BSplineFace(replace(flat, poles=poles), (np.zeros((1, 2)),)).untrimmed()


@pytest.mark.parametrize("number", range(10))
def test_the_way_through_in_one_kernel_is_that_face_by_face(number: int) -> None:
    """Rays from everywhere to everywhere, among them hopeless ones, alone or beside each other, in any number."""
    plate = plates_of_many_kinds()[number]
    rng = np.random.default_rng(number)
    low, high = plate.outline().min(axis=0), plate.outline().max(axis=0)
    met = 0
    for n in (1, 15, 16, 17, 400, 3000):
        targets = low - 10.0 + rng.random((n, 3)) * (high - low + 20.0)
        anywhere = rng.normal(size=(n, 3)) * 300.0 + [0.0, 0.0, 200.0]
        origins = np.where(rng.random((n, 1)) < 0.8, [[250.0, 30.0, 700.0]], anywhere)
        exponents = np.where(rng.random((n, 1)) < 0.1, rng.choice([-200.0, 200.0], (n, 1)), rng.uniform(-3.0, 3.0, (n, 1)))
        rays = Rays.of(origins, (targets - origins) * 10.0**exponents)
        rays.directions[rng.random(n) < 0.01] = 0.0
        rays.origins[rng.random(n) < 0.01] = np.nan
        at_once, by_faces = Trace.empty(n), Trace.empty(n)
        plate.first_hits(rays, at_once)
        plate.face_by_face(rays, by_faces)
        assert at_once.status.tolist() == by_faces.status.tolist()
        met += at_once.counts().get("reflected", 0)
        # Rounding: of coordinates of some 1000 mm, where the ray is nearly parallel to what it meets of more of it.
        steep = np.abs(np.einsum("ij,ij->i", by_faces.normals, by_faces.directions))
        room = 1.0 / np.fmax(steep, 1e-3)
        assert np.nanmax(np.abs(at_once.points - by_faces.points).max(axis=1) / room, initial=0.0) < 3e-12
        assert np.nanmax(np.abs(at_once.directions - by_faces.directions).max(axis=1) / room, initial=0.0) < 1e-13
        assert np.nanmax(np.abs(at_once.normals - by_faces.normals).max(axis=1) / room, initial=0.0) < 1e-13
        assert at_once.distances == pytest.approx(by_faces.distances, abs=1e-12, rel=1e-14, nan_ok=True)
        for name in ("points", "normals", "directions"):
            assert np.array_equal(np.isnan(getattr(at_once, name)), np.isnan(getattr(by_faces, name)))
    assert met > 300


def test_total_reflection_inside_blocks_the_ray() -> None:
    """A wedge whose back is steep to its front: what comes back meets the front beyond the critical angle."""
    front = cap(np.inf, 60.0)
    back = tilted(22.0)
    eye = np.array([[0.0, 0.0, 500.0]])
    assert trace_through(front, back, 1.2, eye, np.array([[0.0, 0.0, -1.0]])).status.tolist() == [Status.REFLECTED]
    assert trace_through(front, back, INDEX, eye, np.array([[0.0, 0.0, -1.0]])).status.tolist() == [Status.BLOCKED]


def test_results_are_written_where_they_are_asked_for_and_bad_arrays_are_refused() -> None:
    front, back = faces_of(back_mirror())
    rays = grid_rays(20)
    out = Trace.empty(len(rays))
    assert trace_through(front, back, INDEX, EYE, rays, out) is out
    fresh = trace_through(front, back, INDEX, EYE, 7.0 * rays)
    assert np.nanmax(np.abs(fresh.directions - out.directions)) < 1e-13
    assert trace_through(front, back, INDEX, EYE, np.empty((0, 3))).status.shape == (0,)
    with pytest.raises(raytrace.TraceError, match="directions must be"):
        trace_through(front, back, INDEX, EYE, np.zeros((4, 2)))
    for index in (0.99, -1.52, float("nan"), float("inf")):
        with pytest.raises(raytrace.TraceError, match=rf"an index of {index:g} is no glass"):
            trace_through(front, back, index, EYE, rays)


# --- what the driver sees ---------------------------------------------------------------------------------------------------

# Sphere, R mm: field of view added and lost to the sides in degrees, and largest ghost in arc minutes, along y = 0, the eye
# at EYE. As in docs/derivations/second-surface.md.
SEEN = {1250.0: (0.0375, -0.114, 1.79), 950.0: (0.0422, -0.158, 2.12), 400.0: (0.0710, -0.533, 3.47)}


def seen_by_angles(radius: float, eye_x: float, eye_z: float) -> tuple[float, float, float, Array]:
    """In the plane y = 0, from the sine rule; radians. Field of view between the rays that are reflected at x = ±115 of the
    back, and between those that leave over it; the largest angle between image and ghost of one far point for rays to
    x = −115 … 115 of the front; and the directions (2, 3) of the two rays that leave at the rim."""
    centre = np.array([eye_x, eye_z + radius])
    distance, lean = float(np.linalg.norm(centre)), float(np.arctan2(eye_x, eye_z + radius))
    wide, rim = [], []
    widest = 0.999 * float(np.arcsin((radius + T_MM) / distance))
    for x in (-115.0, 115.0):
        place = np.arcsin(x / radius) - lean
        for key, found in (("back", wide), ("exit", rim)):
            found.append(brentq(lambda p, key=key, place=place: float(concentric(radius, p, distance)[key]) - place,
                                -widest, widest, xtol=1e-15))
    apart = []
    for x in np.linspace(-115.0, 115.0, 231):
        # The place of the front over x of the back, seen from the eye.
        front = (radius + T_MM) / radius * np.array([x, np.sqrt(radius**2 - x**2)])
        psi = lean - float(np.arctan2(eye_x - front[0], centre[1] - front[1]))
        wanted = float(concentric(radius, psi, distance)["ghost"])
        image = brentq(lambda p, wanted=wanted: float(concentric(radius, p, distance)["image"]) - wanted,
                       psi - 0.01, psi + 0.01, xtol=1e-15)
        apart.append(abs(image - psi))
    reflected, left = (np.diff(concentric(radius, np.array(each), distance)["image"])[0] for each in (wide, rim))
    down = np.array(rim) - lean
    return reflected, left, max(apart), np.stack([np.sin(down), np.zeros(2), -np.cos(down)], axis=1)


@pytest.mark.parametrize("radius", SEEN)
def test_field_of_view_and_ghost_of_a_sphere_are_those_of_the_closed_form(radius: float) -> None:
    glass = sheets(radius)
    wide, within, apart, last = seen_by_angles(radius, EYE[0], EYE[2])
    h, _ = traced_fields_of_view(glass, EYE, BOX, 270.0)
    assert h == pytest.approx(wide, abs=1e-11)
    bare, _ = traced_fields_of_view(glass.back, EYE, BOX, 270.0)
    assert np.degrees(h - bare) == pytest.approx(SEEN[radius][0], abs=5e-5)
    assert np.degrees(within - bare) == pytest.approx(SEEN[radius][1], abs=5e-4)
    corners = np.array([[-115.0, -9.0], [115.0, -9.0], [115.0, 9.0], [-115.0, 9.0]])
    faces = [BSplineFace(face.surface, (corners,)) for face in (glass.front, glass.back)]
    for share, status in ((1.0 - 1e-7, Status.REFLECTED), (1.0 + 1e-7, Status.BLOCKED)):
        trace = trace_through(*faces, INDEX, EYE, share * last + (1.0 - share) * last.mean(axis=0))
        assert trace.status.tolist() == [status, status]
    x = np.linspace(-115.0, 115.0, 231)
    seen = ghost(glass, EYE, x, np.zeros(231))
    assert seen.rays == 231
    assert seen.max_arcmin == pytest.approx(ARCMIN * apart, rel=1e-6)
    assert seen.max_arcmin == pytest.approx(SEEN[radius][2], abs=0.005)
    assert seen.max_at_mm == (-115.0, 0.0)
    assert seen.front_mean == pytest.approx(0.043, abs=5e-4)
    assert seen.image_mean == pytest.approx((1.0 - 0.0427) ** 2, abs=5e-4)


@pytest.mark.parametrize(("radius", "opened"), [(1250.0, 0.088), (400.0, 0.498)])
def test_rays_that_enter_at_one_place_leave_the_back_wider_than_the_front_reflects_them(radius: float, opened: float) -> None:
    """By 2·(j − r) a side: against the front's own reflection the field of view opens by twice that, eye on the axis."""
    eye = np.array([0.0, 0.0, 762.0])
    x = np.array([-115.0, 115.0]) * (radius / (radius + T_MM))  # of the back; the front over it is at ±115
    places = cap(radius, T_MM).surface.evaluate(x, 0.0 * x)
    behind = trace_through(cap(radius, T_MM), cap(radius), INDEX, eye, places - eye).directions
    before = reflect(raytrace.Reflector(cap(radius, T_MM)), eye, places - eye).directions
    assert np.degrees(angle_between(*behind) - angle_between(*before)) == pytest.approx(opened, abs=6e-4)


def test_a_ray_aimed_through_the_glass_is_reflected_at_its_place() -> None:
    front, back = faces_of(back_mirror())
    glass = Plate(front, back, INDEX).untrimmed()
    x, y = np.array([-115.0, 115.0, -115.0, -115.0, 3.0]), np.array([0.0, 0.0, -135.0, 135.0, -7.0])
    trace = trace_through(glass.front, glass.back, INDEX, EYE, glass.eye_rays(EYE, x, y))
    assert set(trace.counts()) == {"reflected"}
    above = back.surface.evaluate(x, y) + [0.0, 0.0, 9.0]
    bare = reflect(raytrace.Reflector(glass.back), above, np.tile([0.0, 0, -1], (5, 1)))
    assert np.abs(trace.normals - bare.normals).max() < 1e-13
    no_glass = Plate(glass.front, glass.back, 1.0)
    assert np.abs(no_glass.reflected_at(EYE, x, y)[1] - back.untrimmed().reflected_at(EYE, x, y)[1]).max() < 1e-13


@pytest.mark.parametrize("degree", [3, 5, 7])
@pytest.mark.parametrize("rational", [False, True])
def test_a_ray_aimed_through_any_front_is_reflected_at_its_place(degree: int, rational: bool) -> None:
    """Also through one with weights, and with u and v that are not x and y; the trace goes the other way, and searches."""
    rng = np.random.default_rng(degree)
    back = cap(500.0).surface
    knots = [np.concatenate([[-h] * (degree + 1), np.linspace(-h, h, 5)[1:-1], [h] * (degree + 1)]) for h in (150.0, 200.0)]
    round_front = collocate(lambda u, v: np.stack([*np.broadcast_arrays(u[:, None], v), 4.0 - (u[:, None] ** 2 + v * v) / 1e3],
                                                  axis=2), *knots, degree).poles
    poles = round_front + rng.uniform(-0.02, 0.02, round_front.shape)
    weights = rng.uniform(0.998, 1.002, poles.shape[:2]) if rational else None
    front = BSplineSurface(degree, degree, *knots, poles, weights)
    loops = (rectangle(150, 200),)
    glass = Plate(BSplineFace(front, loops), BSplineFace(back, loops), INDEX)
    x, y = rng.uniform(-100.0, 100.0, 60), rng.uniform(-130.0, 130.0, 60)
    eye = np.array([150.0, -80.0, 600.0])
    found = Trace.empty(60)
    glass.face_by_face(Rays.of(eye, glass.eye_rays(eye, x, y)), found)
    assert set(found.counts()) == {"reflected"}
    # 1e-11 mm, where Newton ends, over a radius of 500 mm, and rounding.
    d = back.derivatives(x, y)
    assert np.abs(found.normals - normals(d["u"], d["v"])).max() < 1e-13


def test_eyes_see_no_points_beside_the_back() -> None:
    glass = sheets(500.0)
    x, y = np.array([0.0, 150.0, 150.1, -150.1, 0.0, 0.0, np.nan]), np.array([0.0, 0.0, 0.0, 0.0, 200.1, -200.1, 0.0])
    known = np.isfinite(glass.eye_rays(np.array([0.0, 0.0, 700.0]), x, y)).all(axis=1)
    assert known.tolist() == [True, True, *5 * [False]]


def test_a_plate_of_plane_faces_has_no_ghost_and_one_whose_sheets_end_no_field_of_view() -> None:
    x = np.linspace(-100.0, 100.0, 21)
    seen = ghost(sheets(np.inf), EYE, x, 0.0 * x)
    assert seen.rays == 21
    assert seen.max_arcmin == pytest.approx(0.0, abs=1e-8)
    half = (115.0, 200.0)
    short = Plate(cap(400.0, T_MM, half), cap(400.0, 0.0, half), INDEX)
    h, v = traced_fields_of_view(short, EYE, BOX, 270.0)
    assert np.isnan(h)
    assert np.isnan(v)


# --- the plate and its files ------------------------------------------------------------------------------------------------


def test_the_front_stands_before_the_designed_face_and_the_files_read_back(tmp_path: Path) -> None:
    mirror = back_mirror()
    assert mirror.plate.back is mirror.surface
    x, y = np.array([-100.0, 0.0, 90.0]), np.array([20.0, 0.0, -100.0])
    away = mirror.plate.front.evaluate(x, y) - mirror.surface.evaluate(x, y)
    assert np.linalg.norm(away, axis=1) == pytest.approx(T_MM, abs=1e-5)
    assert (away[:, 2] > 0.0).all()
    assert mirror.plate.back_error_mm <= 1e-5
    mirror.export_step(tmp_path / "a.step")
    file = read_step(tmp_path / "a.step")
    assert len(solids_of(file.shape)) == 1
    assert is_valid(file.shape)
    assert sorted(face.name for face in file.faces if face.name) == [FRONT_FACE, OPTICAL_FACE]
    assert np.abs(file.optical_surface().evaluate(x, y) - mirror.surface.evaluate(x, y)).max() < 1e-9
    assert np.abs(file.named_surface(FRONT_FACE).evaluate(x, y) - mirror.plate.front.evaluate(x, y)).max() < 1e-9
    assert mirror.to_build123d().volume == pytest.approx(mirror.plate.volume_mm3, rel=1e-8)  # by its own coarser integration
    # The plate over the same face is as much larger as its front is wider: V = ∫(t + t²·H + t³/3·K) dA.
    assert mirror.plate.volume_mm3 == pytest.approx(-plate_volume(mirror, mirror.outline, -T_MM), rel=0.01)
    assert mirror.plate.volume_mm3 > plate(mirror.surface, mirror.outline, T_MM).volume_mm3
    mirror.export_stl(tmp_path / "a.stl")
    mesh = read_stl(tmp_path / "a.stl")
    assert_closed_and_outward(mesh, mirror.plate.volume_mm3)
    stl = mirror.deviation(file.optical_surface(), mesh).stages.stl
    assert stl.height_max_mm <= 0.01
    assert stl.facets > 1000


def test_a_front_that_reflects_is_made_as_ever() -> None:
    mirror = designed("progressive-c")
    assert mirror.plate.front is mirror.surface
    assert mirror.plate.front_face is mirror.plate.optical
    assert mirror.plate.offset is mirror.plate.back


def test_a_file_is_traced_through_its_front_as_the_design_is(tmp_path: Path) -> None:
    mirror = back_mirror()
    mirror.export_step(tmp_path / "a.step")
    reflector = raytrace.load_reflector(tmp_path / "a.step")
    assert reflector.glass.index == INDEX
    rays = grid_rays(30)
    read = reflect(reflector, EYE, rays)
    meant = trace_through(*faces_of(mirror), INDEX, EYE, rays)
    assert (read.status == meant.status).all()
    assert np.nanmax(np.abs(read.directions - meant.directions)) < 1e-10
    denser = raytrace.load_reflector(tmp_path / "a.step", index=1.7)
    assert np.nanmax(np.abs(reflect(denser, EYE, rays).directions - read.directions)) > 1e-5
    designed("sphere-950").export_step(tmp_path / "front.step")
    assert isinstance(raytrace.load_reflector(tmp_path / "front.step").surface, BSplineFace)


BACK = """[horizontal]
law = "constant"
radius_mm = 1250.0
[vertical]
law = "constant"
radius_mm = 1250.0
[glass]
reflecting = "back"
[view]
width_px = 64
"""


def test_a_build_sees_through_its_glass_and_so_does_a_trace_of_its_file(tmp_path: Path,
                                                                        capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "back.toml").write_text(BACK)
    assert run(["build", str(tmp_path / "back.toml"), "--out", str(tmp_path / "set"), "--json"]) == 0
    metrics = json.loads(capsys.readouterr().out)
    glass = metrics["glass"]
    assert (glass["reflecting"], glass["index"]) == ("back", 1.52)
    # The decoupled surface of a sphere's two laws is a sphere along y = 0 only.
    assert glass["h_fov_added_deg"] == pytest.approx(SEEN[1250.0][0], abs=2e-4)
    assert 1.7 <= glass["ghost_arcmin"]["max"] <= 4.0
    assert glass["front_reflectance"]["mean"] == pytest.approx(0.043, abs=5e-4)
    assert metrics["plate"]["back_error_mm"] <= 1e-5
    assert metrics["rays"]["reflected"] > 100 * metrics["rays"].get("lost", 0)
    page = (tmp_path / "set" / "report.html").read_text("utf-8")
    assert "Through the glass" in page
    assert "ghost beside the image" in page
    assert run(["trace", str(tmp_path / "set" / "back.step"), "--scene", str(tmp_path / "back.toml"), "--out",
                str(tmp_path / "traced"), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    lanes = [each["lane_straightness_percent"]["traced"] for each in (again, metrics)]
    assert lanes[0] == pytest.approx(lanes[1], abs=1e-4)
    assert (tmp_path / "traced" / "driver-view.png").is_file()


# --- what is refused --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("glass", "message"), [
    ({"index": 0.9}, r"glass\.index = 0\.9"), ({"index": 3.1}, r"glass\.index = 3\.1"), ({"index": "1.5"}, r"glass\.index"),
    ({"index": float("nan")}, r"glass\.index = nan"),
    ({"reflecting": "behind"}, r"glass\.reflecting = \"behind\".*front.*back"), ({"refelcting": "back"}, "reflecting"),
])
def test_bad_glass_is_refused_with_key_and_value(glass: dict[str, Any], message: str) -> None:
    with pytest.raises(mirror_cad.SpecError, match=message):
        spec_of(constant(1250.0), constant(1250.0), glass=glass)


def test_a_front_that_folds_and_a_block_of_glass_are_refused() -> None:
    small = {"width_mm": 100.0, "left_height_mm": 100.0, "right_height_mm": 100.0, "corner_radius_mm": 10.0}
    concave = mirror_cad.design(spec_of(constant(-150.0), constant(-160.0), outline=small,
                                        glass={"thickness_mm": 155.0, "reflecting": "back"}))
    with pytest.raises(mirror_cad.SolidError, match=r"_mm = 155 .* smallest concave radius, 1\d\d\.\d\d mm .* front would"):
        _ = concave.plate
    convex = mirror_cad.design(spec_of(constant(150.0), constant(160.0), outline=small,
                                       glass={"thickness_mm": 155.0, "reflecting": "back"}))
    with pytest.raises(mirror_cad.SolidError, match=r"smallest convex radius, 1\d\d\.\d\d mm .* a block and no bent plate"):
        _ = convex.plate


def test_an_offset_stands_on_the_side_it_is_asked_for() -> None:
    mirror = designed("sphere-950")
    x = np.array([0.0, 50.0])
    for side, sign in (("front", -1.0), ("back", 1.0)):
        offset, error = offset_surface(mirror.surface, mirror.outline, T_MM, side)  # type: ignore[arg-type]
        assert error <= 1e-5
        assert (sign * (offset.evaluate(x, 0.0 * x) - mirror.surface.evaluate(x, 0.0 * x))[:, 2] > 2.9).all()
