"""Light on small scenes with known answers: closed forms, laws that hold in any scene, and Mitsuba's path tracer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import raytrace
from mirror_cad.mesh import SurfaceMesh
from raytrace import parallel
from raytrace.embree import TriangleScene
from raytrace.errors import SceneError
from raytrace.scene.bodies import Body, body_of
from raytrace.scene.daylight import Daylight
from raytrace.scene.lit_world import LitWorld
from raytrace.scene.materials import Material, linear
from raytrace.scene.road import LaneLine, Road
from raytrace.scene.sky import LUMINANCE, sun_direction
from raytrace.scene.woods import Woods
from tests.meshes import box, icosphere, unit

NONE = (0.0, 0.0, 0.0)
FINE = 1e-7  # rad: rays as thin as no pixel's
UP = np.array([0.0, 0.0, 1.0])
BLACK = Daylight.under(lambda d: np.full(d.shape, 1e-12), UP, NONE, ground=NONE)


class Plain(Road):
    """Ground of one reflectance."""

    def colours(self, points: np.ndarray, extent: np.ndarray, out: np.ndarray) -> None:
        out[:] = 0.3


PLAIN = Plain(-1e4, 1e4)


def even(radiance: float = 1.0, below: float = 1.0, sun: np.ndarray = UP, beam: float = 0.0, **more: Any) -> Daylight:
    """A sky of one radiance, over ground of the reflectance `below`, and a white sun."""
    return Daylight.under(lambda d: np.full(d.shape, radiance), sun, np.full(3, beam), ground=np.full(3, below), **more)


def sun_alone(azimuth: float, elevation: float, beam: float = np.pi) -> Daylight:
    return even(1e-12, 0.0, sun_direction(azimuth, elevation), beam)


def matt(reflectance: float) -> Material:
    return Material("matt", (reflectance,) * 3, NONE)


def ball(radius: float, centre: tuple[float, float, float], material: Material, times: int = 5) -> Body:
    vertices, faces = icosphere(times)
    return body_of(radius * vertices + centre, faces, material, normals=vertices)


def crate(low: tuple[float, float, float], high: tuple[float, float, float], material: Material) -> Body:
    vertices, faces = box(1)
    inside = 0.5 * (1.0 + vertices / [1.0, 0.65, 0.45])
    return body_of(np.array(low) + inside * (np.array(high) - low), faces, material)


def sheet(centre: np.ndarray, right: np.ndarray, up: np.ndarray, material: Material, repeat: float = 1.0) -> Body:
    """A rectangle centre ± right ± up, seen from right × up, its texture `repeat` times each way."""
    corners = np.array([centre - right - up, centre + right - up, centre + right + up, centre - right + up])
    uv = repeat * np.array([[0.0, 1], [1, 1], [1, 0], [0, 0]])
    return body_of(corners, np.array([[0, 1, 2], [0, 2, 3]]), material, uv=uv)


FURNACE = ball(500.0, (0.0, 0.0, 2000.0), matt(1.0), 4)


def around(target: np.ndarray, n: int, seed: int, away: float = 5000.0) -> tuple[np.ndarray, np.ndarray]:
    """Rays from all sides towards places near a target."""
    rng = np.random.default_rng(seed)
    origins = target + away * unit(rng.normal(size=(n, 3)))
    return origins, unit(target + rng.normal(0.0, 300.0, (n, 3)) - origins)


# Even light.


@pytest.mark.parametrize(("specular", "roughness"), [(NONE, 1.0), ((0.04,) * 3, 0.6), ((0.04,) * 3, 0.1), ((0.9,) * 3, 0.0)])
def test_in_an_even_light_a_white_body_cannot_be_seen(specular: tuple[float, float, float], roughness: float) -> None:
    """The white furnace: all that comes in goes out again, with any surface over a white base."""
    body = replace(FURNACE, materials=(Material("white", (1.0, 1.0, 1.0), specular, roughness),))
    origins, directions = around(np.array([0.0, 0, 2000]), 20_000, 1)
    found = LitWorld((body,), None, even(2.0)).radiance(origins, directions, 1e-3)
    assert found == pytest.approx(np.full(found.shape, 2.0), rel=1e-6)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_in_an_even_light_no_body_is_brighter_than_the_light(diffuse: float, specular: float, roughness: float) -> None:
    body = replace(FURNACE, materials=(Material("any", (diffuse,) * 3, (specular,) * 3, roughness),))
    origins, directions = around(np.array([0.0, 0, 2000]), 500, 2)
    found = LitWorld((body,), None, even(1.0)).radiance(origins, directions, 1e-3)
    assert found.max() <= 1.0 + 1e-6
    assert found.min() >= 0.0


@pytest.mark.parametrize("reflectance", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("open_to", [0.9, 0.4])
def test_an_integrating_sphere_shines_as_its_closed_form(reflectance: float, open_to: float) -> None:
    """L·ρ·f/(1 − ρ·(1 − f)), f the opening's part of the sphere: what the light's own bounces add is exact there.

    Over the mean of the places seen, within 2 %: f itself, from 64 directions a vertex, is within 1 %.
    """
    vertices, faces = icosphere(5)
    middles = vertices[faces].mean(axis=1)[:, 2]
    corner = vertices[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    f = area[middles >= open_to].sum() / area.sum()
    body = body_of(1000.0 * vertices, faces[middles < open_to][:, ::-1], matt(reflectance), normals=-vertices)
    rng = np.random.default_rng(3)
    targets = 1000.0 * unit(rng.normal(size=(20_000, 3)) - [0.0, 0.0, 0.8])
    targets = targets[targets[:, 2] < 1000.0 * open_to - 150.0]
    found = LitWorld((body,), None, even(3.0)).radiance(np.zeros(3), unit(targets), 1e-4)
    assert found.mean() == pytest.approx(3.0 * reflectance * f / (1.0 - reflectance * (1.0 - f)), rel=0.02)


# The sun.


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 45.0), (60.0, 30.0), (-100.0, 12.0), (170.0, 70.0)])
def test_the_shadow_of_a_box_ends_where_geometry_says(azimuth: float, elevation: float) -> None:
    """A place on the ground is dark if its ray to the sun enters the box (slab by slab), 3 mm from the edge or more."""
    low, high = np.array([-400.0, -250.0, 0.0]), np.array([400.0, 250.0, 1500.0])
    world = LitWorld((crate((-400.0, -250.0, 0.0), (400.0, 250.0, 1500.0), matt(0.5)),), PLAIN, sun_alone(azimuth, elevation))
    rng = np.random.default_rng(4)
    reach = 1500.0 / np.tan(np.radians(elevation)) + 800.0
    places = np.column_stack([rng.uniform(-reach, reach, (40_000, 2)), np.zeros(40_000)])
    towards = world.daylight.sun

    def shaded(grow: float) -> np.ndarray:
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low - grow - places) / towards, (high + grow - places) / towards
        return np.fmin(a, b).max(axis=1) < np.fmax(a, b).min(axis=1)

    under = (np.abs(places[:, :2]) < high[:2] + 1.0).all(axis=1)
    sure = (shaded(3.0) == shaded(-3.0)) & ~under
    found = world.radiance(places + [0.0, 0.0, 1e5], np.tile(-UP, (40_000, 1)), FINE)[:, 1]
    over = (np.abs(places[:, :2]) < high[:2]).all(axis=1)  # there the ray from above meets the box
    sure &= ~over
    assert 500 < np.count_nonzero(shaded(0.0) & sure) < 39_500
    expected = np.where(shaded(0.0), 0.0, 0.3 * towards[2])
    assert np.abs(found - expected)[sure].max() < 1e-6


@pytest.mark.parametrize(("times", "far"), [(3, 0.0), (5, 0.0), (4, 1.5e6)])
def test_a_ball_under_a_low_sun_has_no_specks_on_either_side(times: int, far: float) -> None:
    """Of 100,000 rays each that finds the lit side sees ρ/π·E·cos, each on the dark side nothing; also 1.5 km away."""
    low_sun = sun_alone(70.0, 8.0)
    bodies = (ball(500.0, (far, 0.0, 800.0), matt(0.8), times),
              crate((-9000.0, 3000.0, 0.0), (-8000.0, 4000.0, 900.0), matt(0.5)))
    origins, directions = around(np.array([far, 0.0, 800.0]), 100_000, 5)
    world = LitWorld(bodies, None, low_sun)
    hits = world.scene.first_hits(origins, directions)
    met = (hits.triangle >= 0) & (hits.triangle < len(bodies[0].faces))
    normals = bodies[0].normals[bodies[0].faces[hits.triangle[met]]]
    u, v = hits.u[met, None], hits.v[met, None]
    normal = unit((1.0 - u - v) * normals[:, 0] + u * normals[:, 1] + v * normals[:, 2])
    facing = -np.einsum("ij,ij->i", normal, directions[met])
    found = world.radiance(origins, directions, 1e-4)[met, 0]
    expected = 0.8 * np.maximum(normal @ low_sun.sun, 0.0)
    plain = facing > 0.02  # not where the normal is turned back to the ray
    assert np.count_nonzero(plain & (expected > 0.0)) > 10_000
    assert np.count_nonzero(plain & (expected == 0.0)) > 10_000
    # 0.0015 where float32 names a neighbour's triangle, on the ball far away; a speck would be off by some 0.1.
    assert np.abs(found - expected)[plain].max() < 3e-3


def test_no_light_gets_into_a_closed_room() -> None:
    """The sun and a bright sky outside; 100,000 rays inside, through the edges and corners too."""
    vertices, faces = box(4)
    room = body_of(1500.0 * vertices + [0.0, 0.0, 900.0], faces[:, ::-1], matt(0.9))
    day = even(5.0, 0.3, sun_direction(30.0, 40.0), 80.0)
    rng = np.random.default_rng(6)
    directions = unit(rng.normal(size=(100_000, 3)))
    corner = rng.integers(len(faces), size=30_000)
    targets = 1500.0 * vertices[faces[corner, rng.integers(3, size=30_000)]] + [0.0, 0.0, 900.0]
    directions[:30_000] = unit(targets - [100.0, 50.0, 900.0])
    found = LitWorld((room,), None, day).radiance(np.array([100.0, 50.0, 900.0]), directions, 1e-3)
    assert found.max() == 0.0


@pytest.mark.parametrize("roughness", [0.3, 0.5, 1.0])
@pytest.mark.parametrize("elevation", [20.0, 60.0])
def test_a_glossy_plate_sends_back_no_more_of_the_sun_than_it_gets(roughness: float, elevation: float) -> None:
    """∫ L·cos dω over the half space against E·sin h: the base's 0.6 and what the surface adds."""
    plate = sheet(np.zeros(3), np.array([1000.0, 0, 0]), np.array([0, 1000.0, 0]),
                  Material("gloss", (0.6,) * 3, (0.3,) * 3, roughness))
    up, turn = (g.ravel() for g in np.meshgrid((np.arange(200) + 0.5) / 200, (np.arange(400) + 0.5) * 2.0 * np.pi / 400))
    level = np.sqrt(1.0 - up**2)
    views = np.stack([level * np.cos(turn), level * np.sin(turn), up], axis=1)
    day = sun_alone(0.0, elevation)
    found = LitWorld((plate,), None, day).radiance(1000.0 * views, -views, 1e-4)[:, 0]
    back = (found * up).mean() * 2.0 * np.pi / (np.pi * day.sun[2])
    assert 0.6 * 0.6 < back < 1.0


# Reflections and textures.


def checker(cells: int, side: int) -> tuple[np.ndarray, np.ndarray]:
    """A picture of cells² squares of `side` elements, each of its own colour; and those colours."""
    colours = np.random.default_rng(7).integers(20, 255, (cells, cells, 3), dtype=np.uint8)
    return np.repeat(np.repeat(colours, side, axis=0), side, axis=1), colours


def test_a_checker_in_a_plane_mirror_is_where_its_image_is() -> None:
    """From the eye's image behind the mirror a ray goes straight to the wall: closed form, cell by cell."""
    picture, colours = checker(8, 16)
    centre = np.array([4000.0, -7300.0, 800.0])
    right, up = np.array([0.0, 1600.0, 0.0]), np.array([0.0, 0.0, 1600.0])
    wall = sheet(centre, -right, up, Material("wall", (1.0,) * 3, NONE, texture=picture))
    glass = np.array([[-500.0, -1300, 1000], [-500, -700, 1000], [-500, -700, 1400], [-500, -1300, 1400]])
    mirror = raytrace.Reflector.of_mesh(SurfaceMesh(glass, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)))
    eye = np.array([0.0, -300.0, 1250.0])
    y, z = (g.ravel() for g in np.meshgrid(np.linspace(-1298.3, -701.7, 160), np.linspace(1001.3, 1398.7, 120)))
    directions = unit(np.stack([np.full_like(y, -500.0), y, z], axis=1) - eye)
    trace = raytrace.reflect(mirror, eye, directions)
    assert (trace.status == 0).all()
    found = LitWorld((wall,), None, even(1.0)).radiance(trace.points, trace.directions, 1e-6)
    image = np.array([-1000.0 - eye[0], eye[1], eye[2]])
    onward = np.stack([np.full_like(y, -500.0), y, z], axis=1) - image
    at = image + onward * ((centre[0] - image[0]) / onward[:, 0])[:, None]
    # Seen from −X the wall's right is −Y.
    column, row = (centre[1] - at[:, 1] + 1600.0) / 400.0, (centre[2] - at[:, 2] + 1600.0) / 400.0
    on = (np.minimum(column, row) > 0.0) & (np.maximum(column, row) < 8.0)
    middle = on & (np.abs(column % 1.0 - 0.5) < 0.44) & (np.abs(row % 1.0 - 0.5) < 0.44)  # an element off the edges
    assert np.count_nonzero(middle) > 5000
    expected = linear(colours[row[middle].astype(int), column[middle].astype(int)])
    assert np.abs(found[middle] - expected).max() < 1e-6
    assert found[~on] == pytest.approx(np.ones((np.count_nonzero(~on), 3)), rel=1e-6)  # beside it: the even sky


def test_a_checker_far_away_is_the_mean_of_its_light() -> None:
    """Of the light, not of the coded values: black and white become a gray of one half."""
    picture = np.zeros((64, 64, 3), dtype=np.uint8)
    picture[::2, ::2] = picture[1::2, 1::2] = 255
    wall = sheet(np.array([0.0, 0, 5000]), np.array([2000.0, 0, 0]), np.array([0.0, 2000, 0]),
                 Material("checker", (1.0,) * 3, NONE, texture=picture), repeat=8.0)
    rng = np.random.default_rng(8)
    targets = np.column_stack([rng.uniform(-1900.0, 1900.0, (4000, 2)), np.full(4000, 5000.0)])
    origin = np.array([0.0, 0.0, 25_000.0])
    world = LitWorld((wall,), None, even(1.0))
    near, far = (world.radiance(origin, unit(targets - origin), spread)[:, 0] for spread in (1e-6, 0.01))
    assert near.std() > 0.1
    assert far == pytest.approx(np.full(4000, 0.5), abs=0.01)


def test_a_mirror_ball_shows_the_sky_s_gradient_in_closed_form() -> None:
    """L(d) = 1 + d_z + 0.4·d_x at d = i − 2(n·i)n, n the exact sphere's normal where the ray meets it.

    Within 0.5 %: the facets' interpolated normals and the table of the sky.
    """
    day = Daylight.under(lambda d: np.repeat((1.0 + d[:, 2] + 0.4 * d[:, 0])[:, None], 3, axis=1), UP, NONE)
    centre = np.array([0.0, 0.0, 1000.0])
    world = LitWorld((ball(600.0, (0.0, 0.0, 1000.0), Material("mirror", NONE, (1.0, 1.0, 1.0), 0.0), 6),), None, day)
    eye = np.array([4000.0, 500.0, 2500.0])
    rng = np.random.default_rng(9)
    directions = unit(centre + rng.uniform(-500.0, 500.0, (20_000, 3)) - eye)
    b, c = (eye - centre) @ directions.T, (eye - centre) @ (eye - centre) - 600.0**2
    root = b**2 - c
    directions, t = directions[root > 0.0], (-b - np.sqrt(np.maximum(root, 0.0)))[root > 0.0]
    normal = (eye + t[:, None] * directions - centre) / 600.0
    cosine = np.einsum("ij,ij->i", normal, directions)
    mirrored = directions - 2.0 * cosine[:, None] * normal
    up = (mirrored[:, 2] > 0.02) & (cosine < -0.1)
    found = world.radiance(eye, directions, 1e-5)[up, 0]
    assert np.count_nonzero(up) > 5000
    assert found == pytest.approx(1.0 + mirrored[up, 2] + 0.4 * mirrored[up, 0], rel=5e-3)


def test_a_smooth_body_mirrors_the_one_beside_it_and_a_rough_one_does_not() -> None:
    red = sheet(np.array([0.0, 2000, 1000]), np.array([3000.0, 0, 0]), np.array([0.0, 0, 3000]),
                Material("red", (0.8, 0, 0), NONE))
    directions = unit(np.array([[0.0, -2.0, -1.0]]))
    for roughness, mirrors in ((0.05, True), (0.9, False)):
        floor = sheet(np.zeros(3), np.array([3000.0, 0, 0]), np.array([0.0, 3000, 0]),
                      Material("floor", NONE, (0.5, 0.5, 0.5), roughness))
        found = LitWorld((floor, red), None, even(1.0)).radiance(np.array([0.0, 0, 500.0]), -directions * [1, 1, -1], 1e-4)[0]
        assert (found[1] < 0.05) == mirrors


# The air and the ground.


def test_what_is_far_away_fades_into_the_horizon() -> None:
    """L·exp(−σ·t) + L_horizon·(1 − exp(−σ·t)), by distance alone."""
    haze = even(2.0, 0.5, beam=0.0, extinction=(1e-6, 2e-6, 3e-6))
    for distance in (1e3, 1e5, 1e6, 1e7):
        wall = sheet(np.array([-distance, 0.0, 2000.0]), np.array([0.0, 0.3 * distance, 0]),
                     np.array([0.0, 0, 0.3 * distance]), matt(0.0))
        found = LitWorld((wall,), None, haze).radiance(np.array([0.0, 0, 2000]), np.array([[-1.0, 0, 0]]), 1e-4)[0]
        assert found == pytest.approx(2.0 * (1.0 - np.exp(-np.array([1e-6, 2e-6, 3e-6]) * distance)), rel=1e-5)


def test_the_ground_below_a_plate_gets_the_sky_past_it() -> None:
    """Closed form: the share 1 − R²/(R² + h²) below its middle, with what the ground's own reflectance makes of it."""
    turn = np.arange(120) * 2.0 * np.pi / 120
    rim = np.stack([800.0 * np.cos(turn), 800.0 * np.sin(turn), np.full(120, 500.0)], axis=1)
    vertices = np.concatenate([[[0.0, 0, 500]], rim])
    k = np.arange(120) + 1
    plate = body_of(vertices, np.stack([np.zeros(120, dtype=int), k, k % 120 + 1], axis=1), matt(0.5))
    rng = np.random.default_rng(10)
    targets = np.column_stack([rng.uniform(-100.0, 100.0, (2000, 2)), np.zeros(2000)])
    origin = np.array([0.0, 0.0, 400.0])
    share = 1.0 - 0.64 / (0.64 + 0.25)
    for position, expected in (((0.0, 0.0, 0.0), share), ((9e4, 0.0, 0.0), 1.0)):
        world = LitWorld((plate.placed(position, 33.0),), PLAIN, even(1.0))
        found = world.radiance(origin, unit(targets - origin), FINE).mean()
        assert found == pytest.approx(0.3 * expected / (1.0 - 0.3 * (1.0 - expected)), rel=0.05)


ROAD = Road(-9000.0, 2400.0, (LaneLine(1750.0), LaneLine(-1750.0, 120.0, "white", 6000.0, 18_000.0, 2500.0),
                              LaneLine(-5250.0, 200.0, "yellow", 3000.0, 4500.0)))


@given(st.floats(-1e5, 1e5), st.sampled_from(ROAD.lines), st.floats(-400.0, 400.0), st.floats(0.5, 9000.0),
       st.floats(0.5, 400.0))
def test_lines_cover_what_64_by_256_points_a_ray_say(x: float, line: LaneLine, beside: float, half_x: float,
                                                     half_y: float) -> None:
    """Half a point is lost or won at each edge: two across, up to eight along 18 m of dashes, 1/64 either way."""
    y = line.y_mm + beside
    px = x + half_x * ((np.arange(256) + 0.5) / 128.0 - 1.0)
    py = y + half_y * ((np.arange(64) + 0.5) / 32.0 - 1.0)
    expected = 0.0
    for other in ROAD.lines:
        across = np.abs(py - other.y_mm) <= 0.5 * other.width_mm
        along = np.ones(256) if other.dash_mm is None else (px - other.start_mm) % other.period_mm < other.dash_mm
        expected += along.mean() * across.mean()
    found = ROAD.line_share(np.array([[x, y]]), np.array([[half_x, half_y]]))[0]
    assert found == pytest.approx(min(expected, 1.0), abs=2.1 / 64)


def test_a_line_s_edges_are_at_half_its_width_exactly() -> None:
    """Half covered there, whatever the ray covers; measures rely on it."""
    for half in (0.1, 5.0, 30.0):
        places = np.array([[700.0, 1750.0 - 75.0], [700.0, 1750.0 + 75.0], [2500.0, -1750.0], [8500.0, -1750.0]])
        assert ROAD.line_share(places, np.full((4, 2), half)) == pytest.approx(np.full(4, 0.5), abs=1e-9)


def test_the_road_s_grain_fades_with_what_a_ray_covers_and_its_colour_stays() -> None:
    rng = np.random.default_rng(11)
    places = np.column_stack([rng.uniform(-2e5, 2e5, 100_000), rng.uniform(-7500.0, 1500.0, 100_000)])
    bare = Road(-9000.0, 2400.0)
    spreads, means = [], []
    for half in (0.5, 5.0, 50.0, 500.0):
        out = np.empty((100_000, 3))
        bare.colours(places, np.full((100_000, 2), half), out)
        spreads.append(out[:, 1].std() / out[:, 1].mean())
        means.append(out[:, 1].mean())
    assert spreads == sorted(spreads, reverse=True)
    assert spreads[0] > 0.12
    assert spreads[-1] < 0.07
    assert np.ptp(means) < 0.01 * means[0]
    assert 0.09 < means[0] < 0.14  # worn asphalt


def test_no_colour_of_the_ground_repeats_itself() -> None:
    """Correlation of 60 m of asphalt with itself, shifted by 1 to 300 m, stays small."""
    x = np.arange(0.0, 360_000.0, 50.0)
    out = np.empty((len(x), 3))
    Road(-9000.0, 2400.0).colours(np.column_stack([x, np.full_like(x, -300.0)]), np.full((len(x), 2), 25.0), out)
    tone = np.diff(out[:, 1])  # without the slow changes
    first = tone[:1200] - tone[:1200].mean()
    for shift in range(20, 6000, 7):
        other = tone[shift:shift + 1200] - tone[shift:shift + 1200].mean()
        assert abs(first @ other) < 0.25 * np.linalg.norm(first) * np.linalg.norm(other)


def test_woods_stand_on_the_ground_behind_what_is_nearer_and_leave_the_sky_alone() -> None:
    """Beside the road they hide the sky from Z = 0 up to 1.4 times their height, no further; a wall before them hides them."""
    day, woods = Daylight.clear(40.0, 40.0), Woods(140_000.0, 13_000.0)
    eye = np.array([0.0, 0.0, 1900.0])
    x = np.linspace(-4e5, 4e5, 3000)

    def seen(height: float, wall: bool = False) -> tuple[np.ndarray, np.ndarray]:
        rays = unit(np.column_stack([x, np.full(3000, -140_000.0), np.full(3000, height)]) - eye)
        before = sheet(np.array([0.0, -9e4, 0.0]), np.array([-5e5, 0, 0]), np.array([0.0, 0, 5e4]), matt(0.5))
        bodies = (before,) if wall else ()
        return (LitWorld(bodies, PLAIN, day, woods).radiance(eye, rays, 1e-4) @ LUMINANCE,
                LitWorld(bodies, PLAIN, day).radiance(eye, rays, 1e-4) @ LUMINANCE)

    for height, least, most in ((19_000.0, 0.0, 0.0), (4000.0, 0.5, 1.0), (-300.0, 0.0, 0.0)):
        with_woods, without = seen(height)
        changed = np.abs(with_woods / without - 1.0) > 1e-9
        assert least <= changed.mean() <= most
        assert (with_woods <= without * (1.0 + 1e-9)).all()  # darker than the sky
    assert np.array_equal(*seen(4000.0, wall=True))
    with pytest.raises(SceneError, match="woods need a distance and a height above 0"):
        Woods(-1.0)


@pytest.mark.parametrize(("make", "message"), [
    (lambda: Road(100.0, 100.0), "a road's edges must be in order, not 100.0 and 100.0 mm"),
    (lambda: Road(float("nan"), 100.0), "edges must be in order"),
    (lambda: LaneLine(0.0, 0.0), "needs a width above 0, not 0.0 mm"),
    (lambda: LaneLine(5.0, dash_mm=6000.0, period_mm=6000.0), "dashes of 6000 mm must be shorter than their period, 6000 mm"),
    (lambda: LaneLine(5.0, colour="pink"), "colour 'pink' is none of white, yellow"),  # type: ignore[arg-type]
])
def test_a_road_that_cannot_be_is_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        make()


# Rays.


def test_shadows_agree_with_first_hits_and_are_as_strict() -> None:
    scene = TriangleScene(*icosphere(3))
    origins = 3.0 * unit(np.random.default_rng(12).normal(size=(40_000, 3)))
    directions = unit(np.random.default_rng(13).normal(scale=0.9, size=(40_000, 3)) - origins)
    met = scene.first_hits(origins, directions).triangle >= 0
    assert 10_000 < np.count_nonzero(met) < 35_000
    assert np.array_equal(scene.occluded(origins, directions), met)
    assert np.array_equal(scene.occluded(origins[7], directions), scene.first_hits(origins[7], directions).triangle >= 0)
    assert scene.occluded(np.zeros(3), np.empty((0, 3))).shape == (0,)
    for wrong, message in ((np.array([[0, 0, 2.0]]), "directions must be of length 1"), (np.zeros((1, 2)), "shape"),
                           (np.array([[0, np.nan, 1.0]]), "directions must be finite: that of ray 0")):
        with pytest.raises(ValueError, match=message):
            scene.occluded(np.zeros(3), wrong)
    with pytest.raises(ValueError, match=r"origins must be of shape \(3,\) or \(2, 3\)"):
        scene.occluded(np.zeros((3, 3)), np.tile(UP, (2, 1)))


def street() -> LitWorld:
    paint = Material("paint", (0.3, 0.02, 0.02), roughness=0.25)
    bodies = tuple(crate((-400.0, -900.0, 200.0), (4000.0, 900.0, 1400.0), paint).placed((x, y, 0.0))
                   for x, y in ((3000.0, -3500.0), (15_000.0, 0.0), (-30_000.0, -3500.0)))
    return LitWorld((*bodies, ball(600.0, (6000.0, 3500.0, 600.0), Material("mirror", NONE, (0.9,) * 3, 0.0))), ROAD,
                    Daylight.clear(60.0, 40.0))


def views(n: int) -> np.ndarray:
    across, down = (g.ravel() for g in np.meshgrid(np.linspace(-0.7, 0.7, n), np.linspace(0.3, -0.5, n)))
    return unit(np.stack([np.ones_like(across), across, down], axis=1))


def test_light_does_not_depend_on_threads_runs_or_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    world, directions, eye = street(), views(220), np.array([0.0, -400.0, 1900.0])
    whole = world.radiance(eye, directions, 5e-4)
    assert np.isfinite(whole).all()
    assert (whole >= 0.0).all()
    assert np.array_equal(world.radiance(np.tile(eye, (len(directions), 1)), directions, np.full(len(directions), 5e-4)), whole)
    part = slice(20_001, 20_777)
    assert np.array_equal(world.radiance(eye, directions[part], 5e-4), whole[part])
    inside = np.empty_like(whole)
    parallel.parallel_for(lambda a, b: inside.__setitem__(slice(a, b), world.radiance(eye, directions[a:b], 5e-4)),
                     len(directions), 5000)
    assert np.array_equal(inside, whole)
    monkeypatch.setattr(parallel, "THREADS", 1)
    monkeypatch.setattr(parallel, "_pools", [])
    assert np.array_equal(world.radiance(eye, directions, 5e-4), whole)
    assert world.radiance(eye, np.empty((0, 3)), 5e-4).shape == (0, 3)


def test_an_empty_world_is_sky_and_road() -> None:
    day = Daylight.clear(0.0, 50.0)
    rays = np.array([[0.0, 0, 1], unit(np.array([1.0, 0, 0.1])), [0.0, 0, -1]])
    found = LitWorld((), ROAD, day).radiance(np.array([0.0, 0, 1900]), rays, 5e-4)
    assert found[0, 2] > found[0, 0]
    assert 0.02 < found[2] @ LUMINANCE / (day.irradiance(UP[None])[0] @ LUMINANCE) < 0.3
    assert LitWorld((), None, day).radiance(np.zeros(3), rays, 5e-4)[2] == pytest.approx(day.below)


@pytest.mark.parametrize(("origins", "directions", "message"), [
    (np.zeros((2, 3)), np.tile(UP, (3, 1)), "origins must be of shape"),
    (np.zeros(3), np.zeros((3, 2)), "directions must be of shape"),
    (np.zeros(3), 2.0 * UP[None], "directions must be of length 1: that of ray 0"),
    (np.full(3, np.nan), UP[None], "origins must be finite"),
    (np.zeros(3), np.full((1, 3), np.inf), "directions must be finite"),
])
@pytest.mark.parametrize("bodies", [True, False])
def test_rays_that_are_none_are_refused(origins: np.ndarray, directions: np.ndarray, message: str, bodies: bool) -> None:
    world = street() if bodies else LitWorld((), ROAD, Daylight.clear(0.0, 40.0))
    with pytest.raises(ValueError, match=message):
        world.radiance(origins, directions, 1e-3)


# Against a path tracer.

WIDE, HIGH, ACROSS_DEG, PATHS = 128, 96, 42.0, 128
EYE, GRID_SHAPE = np.array([4200.0, 1900.0, 2200.0]), np.array([0.0, 500.0, 450.0])
# By how much our mean in a region may differ, relatively. The first two are Mitsuba's noise; the others what is left out: light
# that lit walls throw on the ground and on each other, and how a body hides the sky from another. Measured: 4, 9 % …
REGIONS = {"sunlit ground": 0.004, "box, top": 0.01, "ground near by": 0.05, "ground in shadow": 0.11,
           "box, away from the sun": 0.03, "box, towards the sun": 0.04, "ball, upper part": 0.03, "ball, middle": 0.04,
           "ball, lower part": 0.07}


def pixel_rays(samples: int) -> np.ndarray:
    """Directions (HIGH·s, WIDE·s, 3) of a pinhole camera at EYE."""
    ahead = unit(GRID_SHAPE - EYE)
    right = unit(np.cross(ahead, UP))
    up = np.cross(right, ahead)
    size = 2.0 * np.tan(np.radians(0.5 * ACROSS_DEG)) / WIDE
    column, row = np.meshgrid((np.arange(WIDE * samples) + 0.5) / samples, (np.arange(HIGH * samples) + 0.5) / samples)
    return unit(ahead + (column - WIDE / 2)[..., None] * size * right - (row - HIGH / 2)[..., None] * size * up)


def by_mitsuba(sun: np.ndarray, beam: float) -> np.ndarray:
    """The scene of the test below by Mitsuba's path integrator, (HIGH, WIDE)."""
    mitsuba.set_variant("scalar_rgb")
    place = mitsuba.ScalarTransform4f()

    def diffuse(reflectance: float) -> dict[str, Any]:
        return {"type": "diffuse", "reflectance": {"type": "rgb", "value": [reflectance] * 3}}

    scene = mitsuba.load_dict({
        "type": "scene", "integrator": {"type": "path", "max_depth": 12},
        "sensor": {"type": "perspective", "fov": ACROSS_DEG, "fov_axis": "x", "near_clip": 1.0, "far_clip": 1e7,
                   "to_world": place.look_at(origin=EYE.tolist(), target=GRID_SHAPE.tolist(), up=[0, 0, 1]),
                   "film": {"type": "hdrfilm", "width": WIDE, "height": HIGH, "rfilter": {"type": "box"},
                            "pixel_format": "rgb"},
                   "sampler": {"type": "independent", "sample_count": PATHS, "seed": 1}},
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [1.0] * 3}},
        "sun": {"type": "directional", "direction": (-sun).tolist(), "irradiance": {"type": "rgb", "value": [beam] * 3}},
        "ground": {"type": "rectangle", "to_world": place.scale([1e6, 1e6, 1]), "bsdf": diffuse(0.3)},
        "box": {"type": "cube", "to_world": place.translate([0, 0, 600]).scale([600, 500, 600]), "bsdf": diffuse(0.6)},
        "ball": {"type": "sphere", "center": [300, 1500, 500], "radius": 500, "bsdf": diffuse(0.8)}})
    return np.array(mitsuba.render(scene))[..., 1]


def test_sun_and_sky_on_a_box_and_a_ball_are_mitsuba_s(tmp_path: Path) -> None:
    """Diffuse ground, box and ball under a directional sun and an even sky: means over regions, a pixel from their edges.

    The sun, the sky that a body sees past itself, and what of both the ground sends up are right; see REGIONS for the rest.
    """
    box_and_ball = (crate((-600.0, -500.0, 0.0), (600.0, 500.0, 1200.0), matt(0.6)),
                    ball(500.0, (300.0, 1500.0, 500.0), matt(0.8), 6))
    world = LitWorld(box_and_ball, PLAIN, even(1.0, 0.3, sun_direction(50.0, 40.0), 5.0))
    fine = world.radiance(EYE, pixel_rays(4).reshape(-1, 3), 1e-4)[:, 1]
    ours = fine.reshape(HIGH, 4, WIDE, 4).mean(axis=(1, 3))
    theirs = by_mitsuba(world.daylight.sun, 5.0)
    found = {name: (float(ours[inside].mean()), float(theirs[inside].mean())) for name, inside in _regions(world).items()}
    wrong = {name: pair for name, pair in found.items() if abs(pair[0] / pair[1] - 1.0) > REGIONS[name]}
    kept = tmp_path / "difference.png"
    if wrong:
        _keep_difference(kept, ours, theirs)
    assert not wrong, f"ours, Mitsuba's: {wrong}; ours | Mitsuba's | 128 + 200·(relative difference): {kept}"


def _regions(world: LitWorld) -> dict[str, np.ndarray]:
    """Pixels of each region whose neighbours are in it too."""
    rays = pixel_rays(1).reshape(-1, 3)
    hits = world.scene.first_hits(EYE, rays)
    with np.errstate(divide="ignore"):
        t = np.where(rays[:, 2] < 0.0, -EYE[2] / rays[:, 2], np.inf)
    ground = t < hits.distance
    place = EYE + np.minimum(t, hits.distance)[:, None] * rays
    sun = np.tile(world.daylight.sun, (len(rays), 1))
    shadow = ground & world.scene.occluded(np.where(ground[:, None], place + [0.0, 0, 0.1], 0.0), sun)
    away = np.abs(place[:, :2] - [0.0, 500.0]).max(axis=1)
    on_box = (hits.triangle >= 0) & (hits.triangle < len(world.bodies[0].faces)) & ~ground
    on_ball = (hits.triangle >= len(world.bodies[0].faces)) & ~ground
    height = (place[:, 2] - 500.0) / 500.0
    regions = {"sunlit ground": ground & ~shadow & (away > 3000.0), "ground near by": ground & ~shadow & (away < 2200.0),
               "ground in shadow": shadow, "box, top": on_box & (place[:, 2] > 1199.0),
               "box, away from the sun": on_box & (place[:, 0] > 599.0), "box, towards the sun": on_box & (place[:, 1] > 499.0),
               "ball, upper part": on_ball & (height > 0.3), "ball, middle": on_ball & (np.abs(height) < 0.3),
               "ball, lower part": on_ball & (height < -0.3)}
    for name, inside in regions.items():
        core = inside.reshape(HIGH, WIDE)
        core = np.logical_and.reduce([np.roll(core, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        assert np.count_nonzero(core) > 40, name
        regions[name] = core
    return regions


def _keep_difference(path: Path, ours: np.ndarray, theirs: np.ndarray) -> None:
    pictures = [255.0 * np.clip(p / 2.2, 0.0, 1.0) ** (1.0 / 2.2) for p in (ours, theirs)]
    difference = np.clip(128.0 + 200.0 * (ours - theirs) / np.maximum(theirs, 0.05), 0.0, 255.0)
    Image.fromarray(np.concatenate([*pictures, difference], axis=1).astype(np.uint8)).save(path)
