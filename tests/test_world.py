"""A world of triangles in a plane mirror: every colour has a closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import raytrace
from mirror_cad.mesh import SurfaceMesh
from raytrace.errors import SceneError
from raytrace.scene.reference import BACKGROUND
from raytrace.scene.world import AMBIENT, HORIZON, ZENITH, TriangleWorld
from raytrace.viewing.camera import Frame, rays_through

EYE = np.array([0.0, 0.0, 500.0])
HALF_MM = 100.0  # of the plane mirror, which is a square in z = 0
# Rays within this of an edge as seen on the mirror are left out: which side float32 puts them on is not the point here.
NEAR_EDGE_MM = 1e-3


@pytest.fixture(scope="module")
def plane_mirror() -> raytrace.Reflector:
    corners = HALF_MM * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return raytrace.Reflector.of_mesh(SurfaceMesh(corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)))


def seen(mirror: raytrace.Reflector, world: TriangleWorld, x: np.ndarray, y: np.ndarray, samples: int = 1) -> np.ndarray:
    """Sums of the colours of the rays from the eye through (x, y) on the mirror's plane."""
    rays = np.stack([x, y, np.zeros_like(x)], axis=1) - EYE
    trace = raytrace.reflect(mirror, EYE, rays)
    sums = np.zeros((len(x) // samples, 3))
    world.add_colours(trace, EYE, rays, sums, samples)
    return sums


def pixels() -> tuple[np.ndarray, np.ndarray]:
    """Places off every line of the scenes here."""
    x, y = np.meshgrid(np.linspace(-119.3, 119.7, 61), np.linspace(-118.1, 119.9, 59))
    return x.ravel(), y.ravel()


def one_triangle(**more: Any) -> TriangleWorld:
    return TriangleWorld(np.array([[-200.0, -150, 1000], [250, -100, 1000], [0, 220, 1000]]),
                         np.array([[0, 2, 1]], dtype=np.int32), np.array([[200, 100, 50]], dtype=np.uint8), **more)


def sky(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    up = np.maximum(y / np.sqrt(x**2 + y**2 + EYE[2] ** 2), 0.0)[:, None]
    return (1.0 - up) * np.array(HORIZON) + up * np.array(ZENITH)


def test_a_triangle_in_a_plane_mirror_is_where_its_image_is(plane_mirror: raytrace.Reflector) -> None:
    """From the eye's image at z = −500 the plane z = 1000 is three times as far as the mirror."""
    world = one_triangle()
    x, y = pixels()
    at = 3.0 * np.stack([x, y], axis=1)
    corners = world.vertices[world.faces[0], :2]
    # Counter-clockwise as the driver looks back at it: the cross products with its three sides have one sign.
    a, b = corners, np.roll(corners, -1, axis=0)
    side = np.array([(b[k, 0] - a[k, 0]) * (at[:, 1] - a[k, 1]) - (b[k, 1] - a[k, 1]) * (at[:, 0] - a[k, 0]) for k in range(3)])
    side /= np.linalg.norm(b - a, axis=1)[:, None]
    on = (side < 0.0).all(axis=0)
    clear = np.abs(side).min(axis=0) > 3.0 * NEAR_EDGE_MM
    mirrored = (np.abs(x) < HALF_MM) & (np.abs(y) < HALF_MM)
    expected = np.where(on[:, None], [200.0, 100.0, 50.0], sky(x, y))
    expected[~mirrored] = BACKGROUND
    assert 100 < np.count_nonzero(on & mirrored) < np.count_nonzero(mirrored) - 100
    found = seen(plane_mirror, world, x, y)
    # The sky's colours are held as float32: 255 units of its last digit.
    assert np.abs(found - expected)[clear].max() < 1e-4


def test_a_cube_shows_its_front_and_one_side_each_lit_by_the_cosine(plane_mirror: raytrace.Reflector) -> None:
    """The cube stands left of the axis: its front (−z) and its right side (+x) are what the eye's image can see."""
    corners = np.array([[x, y, z] for x in (-400.0, -200.0) for y in (-100.0, 100.0) for z in (900.0, 1100.0)])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])  # −x +x −y +y −z +z
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    colours = np.tile(np.arange(40, 220, 30, dtype=np.uint8)[:, None], (2, 3))
    sun = np.array([0.48, 0.6, -0.64])
    world = TriangleWorld(corners, faces, colours, sun=(float(sun[0]), float(sun[1]), float(sun[2])))
    x, y = pixels()
    mirrored = (np.abs(x) < HALF_MM) & (np.abs(y) < HALF_MM)
    # On the ray p = t·(x, y, 500) from the eye's image at −500: the front is z = 900, the side x = −200.
    to_front = 1400.0 / EYE[2]
    at_x, at_y = to_front * x, to_front * y
    front = (at_x > -400.0) & (at_x < -200.0) & (np.abs(at_y) < 100.0)
    with np.errstate(divide="ignore"):
        to_side = -200.0 / x
    depth, height = to_side * EYE[2] - 500.0, to_side * y
    side = ~front & (depth > 900.0) & (depth < 1100.0) & (np.abs(height) < 100.0)
    lit = [(AMBIENT + (1.0 - AMBIENT) * max(float(n @ sun), 0.0)) for n in (np.array([0.0, 0, -1]), np.array([1.0, 0, 0]))]
    found = seen(plane_mirror, world, x, y)[:, 0]
    assert np.count_nonzero(front & mirrored) > 20
    assert np.count_nonzero(side & mirrored) > 5
    assert found[front & mirrored] == pytest.approx(lit[0] * 160.0, abs=1e-4)
    assert found[side & mirrored] == pytest.approx(lit[1] * 70.0, abs=1e-4)
    assert np.abs(found - sky(x, y)[:, 0])[mirrored & ~front & ~side].max() < 1e-4


def test_a_face_away_from_the_sun_keeps_its_ambient_share_and_none_goes_dark_by_winding(
        plane_mirror: raytrace.Reflector) -> None:
    away = one_triangle(sun=(0.0, 0.0, 1.0))  # its outer side looks along −z, towards the mirror
    square_on = one_triangle(sun=(0.0, 0.0, -1.0))
    for world, share in ((away, AMBIENT), (square_on, 1.0), (one_triangle(), 1.0)):
        found = seen(plane_mirror, world, np.zeros(1), np.zeros(1))
        assert found == pytest.approx(share * np.array([[200, 100, 50]]), abs=1e-4)


def test_samples_of_a_pixel_are_summed_and_only_reflected_rays_go_on(plane_mirror: raytrace.Reflector) -> None:
    x, y = np.array([0.0, 0.0, 0.0, 150.0]), np.array([0.0, 99.0, 1.0, 0.0])
    found = seen(plane_mirror, one_triangle(), x, y, samples=2)
    colour = np.array([200.0, 100.0, 50.0])
    assert found[0] == pytest.approx(colour + sky(x, y)[1], abs=1e-4)
    assert found[1] == pytest.approx(colour + BACKGROUND, abs=1e-4)


def test_a_picture_without_a_reflected_ray_is_background(plane_mirror: raytrace.Reflector) -> None:
    beside = np.full(4, 300.0)
    assert (seen(plane_mirror, one_triangle(), beside, beside) == BACKGROUND).all()


def test_a_triangle_without_area_is_no_hole_in_the_colours(plane_mirror: raytrace.Reflector) -> None:
    vertices = np.array([[-200.0, -150, 1000], [250, -100, 1000], [0, 220, 1000], [0, 0, 950]])
    world = TriangleWorld(vertices, np.array([[0, 2, 1], [3, 3, 3]], dtype=np.int32), np.full((2, 3), 90, dtype=np.uint8),
                          sun=(0.0, 0.0, -1.0))
    assert np.isfinite(world.shown).all()
    frame = Frame(-50.0, 50.0, 10.0, 10, 10)
    column, row = (g.ravel() + 0.5 for g in np.meshgrid(np.arange(10), np.arange(10)))
    rays = rays_through(frame, EYE, column, row)
    sums = np.zeros((100, 3))
    world.add_colours(raytrace.reflect(plane_mirror, EYE, rays), EYE, rays, sums, 1)
    assert np.isfinite(sums).all()


@pytest.mark.parametrize(("change", "message"), [
    ({"colours": np.zeros((2, 3), dtype=np.uint8)}, r"1 triangles needs uint8 colours of shape \(1, 3\)"),
    ({"colours": np.zeros((1, 3))}, "float64"),
    ({"sun": (0.0, 1.0, 1.0)}, "length 1, it has 1.41421"),
    ({"sun": (0.0, np.nan, 1.0)}, "length 1, it has nan"),
    ({"faces": np.array([[0, 1, 3]], dtype=np.int32)}, "a world's triangles: faces"),
    ({"vertices": np.full((3, 3), np.inf)}, "a world's triangles: vertices"),
])
def test_a_world_that_cannot_be_shown_is_refused(change: dict[str, Any], message: str) -> None:
    given: dict[str, Any] = {"vertices": np.eye(3), "faces": np.array([[0, 1, 2]], dtype=np.int32),
                             "colours": np.zeros((1, 3), dtype=np.uint8)}
    with pytest.raises(SceneError, match=message):
        TriangleWorld(**(given | change))
