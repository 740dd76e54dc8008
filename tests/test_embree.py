"""Embree behind its wrapper: hits exact to float64, no ray lost between triangles, nothing let through that would crash."""

from __future__ import annotations

import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from raytrace.embree import TriangleScene
from raytrace.parallel import RUN
from tests.meshes import box, icosphere, unit

TRIANGLE = np.array([[-50.0, -50, 0], [50, -50, 0], [0, 50, 0]])
FACE = np.array([[0, 1, 2]], dtype=np.int32)
DOWN = np.array([[0.0, 0, -1]])


def random_mesh(rng: np.random.Generator, triangles: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of a few millimetres strewn over a box of 100 mm."""
    corners = rng.uniform(-50.0, 50.0, (triangles, 1, 3)) + rng.uniform(-9.0, 9.0, (triangles, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * triangles, dtype=np.int32).reshape(-1, 3)


def by_brute_force(vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> tuple[float, int]:
    """First hit by solving o + t·d = v0 + u·e1 + v·e2 for every triangle."""
    best = (np.inf, -1)
    for k, (a, b, c) in enumerate(vertices[faces]):
        u, v, t = np.linalg.solve(np.stack([b - a, c - a, -direction], axis=1), origin - a)
        if u >= 0.0 and v >= 0.0 and u + v <= 1.0 and 0.0 <= t < best[0]:
            best = (t, k)
    return best


@pytest.mark.parametrize("offset", [np.zeros(3), np.array([1e5, -2e5, 3e5])])
@pytest.mark.parametrize("away_mm", [100.0, 1e5])
def test_hits_agree_with_brute_force_in_float64(offset: np.ndarray, away_mm: float) -> None:
    """Also 100 m away, and for a mesh in a vehicle's coordinates: no digit is lost but those of the coordinates."""
    rng = np.random.default_rng(1)
    vertices, faces = random_mesh(rng)
    vertices = vertices + offset
    targets = vertices[faces[rng.integers(len(faces), size=400)]].mean(axis=1)
    origins = offset + away_mm * unit(rng.normal(size=(400, 3)))
    directions = unit(targets - origins)
    hits = TriangleScene(vertices, faces).first_hits(origins, directions)
    expected = [by_brute_force(vertices, faces, o, d) for o, d in zip(origins, directions, strict=True)]
    assert hits.triangle.tolist() == [k for _, k in expected]
    ulp = np.spacing(np.abs(origins).max() + away_mm)
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    cosine = np.abs(np.einsum("ij,ij->i", unit(normals)[hits.triangle], directions))
    assert (np.abs(hits.distance - [t for t, _ in expected]) <= 16.0 * ulp / cosine).all()
    # The barycentric point is the same place as the point on the ray.
    a, b, c = np.moveaxis(vertices[faces[hits.triangle]], 1, 0)
    u, v = hits.u[:, None], hits.v[:, None]
    apart = np.linalg.norm((1.0 - u - v) * a + u * b + v * c - origins - hits.distance[:, None] * directions, axis=1)
    assert (apart <= 16.0 * ulp / cosine).all()


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_the_unit_of_length_does_not_matter(scale: float) -> None:
    hits = TriangleScene(scale * TRIANGLE, FACE).first_hits(scale * np.array([3.0, 4, 700]), DOWN)
    assert hits.triangle.tolist() == [0]
    assert hits.distance[0] == pytest.approx(700.0 * scale, rel=1e-15)


@pytest.mark.parametrize("shape", ["ball", "box"])
@pytest.mark.parametrize("aim", ["vertices", "sides"])
def test_no_ray_from_inside_a_closed_mesh_gets_out(shape: str, aim: str) -> None:
    """Embree alone loses 0.1 to 0.3 % of the rays aimed at vertices."""
    rng = np.random.default_rng(2)
    vertices, faces = icosphere(4) if shape == "ball" else box(12)
    n = 200_000
    corner, side = rng.integers(len(faces), size=n), rng.integers(3, size=n)
    share = np.zeros((n, 1)) if aim == "vertices" else rng.random((n, 1))
    targets = (1.0 - share) * vertices[faces[corner, side]] + share * vertices[faces[corner, (side + 1) % 3]]
    origins = rng.uniform(-0.25, 0.25, (n, 3)) * np.ptp(vertices, axis=0)
    hits = TriangleScene(vertices, faces).first_hits(origins, unit(targets - origins))
    assert np.count_nonzero(hits.triangle < 0) == 0
    # What is hit is the aimed place: float32's last digits of the mesh's size beside it at most.
    assert np.abs(hits.distance - np.linalg.norm(targets - origins, axis=1)).max() < 1e-5 * np.abs(vertices).max()


def test_triangles_grow_by_less_than_a_micrometre() -> None:
    """A mirror of 0.4 m: rays 0.5 µm beside its edge miss."""
    corners = np.array([[-125.0, -190, 0], [125, -190, 0], [125, 190, 0], [-125, 190, 0]])
    scene = TriangleScene(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    x = 125.0 + np.array([-5e-4, 5e-4])
    origins = np.stack([x, np.full(2, 33.0), np.full(2, 762.0)], axis=1)
    assert (scene.first_hits(origins, np.repeat(DOWN, 2, axis=0)).triangle >= 0).tolist() == [True, False]


def test_slivers_and_triangles_without_area_hide_nothing() -> None:
    """A sheet whose side has a vertex within 1e-9 mm of it, and one on it: the thin triangles are no more than gaps closed."""
    vertices = np.array([[-50.0, -50, 0], [50, -50, 0], [50, 50, 0], [-50, 50, 0], [0, 0, 1e-9], [25, 25, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 2, 4], [0, 2, 5]])
    scene = TriangleScene(vertices, faces)
    rng = np.random.default_rng(3)
    x = rng.uniform(-49.0, 49.0, 50_000)
    origins = np.stack([x, x + rng.normal(0.0, 1e-5, x.size), np.full(x.size, 300.0)], axis=1)
    hits = scene.first_hits(origins, np.repeat(DOWN, x.size, axis=0))
    assert (hits.triangle >= 0).all()
    assert np.abs(hits.distance - 300.0).max() < 1e-8


def test_rays_along_a_triangle_s_plane_give_a_place_on_it_or_none() -> None:
    rng = np.random.default_rng(4)
    angle = rng.uniform(0.0, 2.0 * np.pi, 20_000)
    directions = np.stack([np.cos(angle), np.sin(angle), np.where(rng.random(angle.size) < 0.5, 0.0, 1e-17)], axis=1)
    hits = TriangleScene(TRIANGLE, FACE).first_hits(-200.0 * directions, directions)
    met = hits.triangle >= 0
    assert np.isinf(hits.distance[~met]).all()
    assert ((hits.distance[met] > 100.0) & (hits.distance[met] < 300.0)).all()


@given(st.floats(-1e308, 1e308), st.floats(-1e308, 1e308), st.floats(0.0, 6.28))
def test_any_finite_ray_has_a_result(x: float, z: float, angle: float) -> None:
    direction = np.array([[np.cos(angle), 0.0, np.sin(angle)]])
    hits = TriangleScene(TRIANGLE, FACE).first_hits([x, 0.0, z], direction)
    assert (hits.triangle[0] >= 0) == np.isfinite(hits.distance[0])
    assert hits.distance[0] >= 0.0


def test_origins_are_one_or_as_many_as_the_directions() -> None:
    rng = np.random.default_rng(5)
    scene = TriangleScene(*icosphere(2))
    eye = np.array([0.1, 0.2, 3.0])
    directions = unit(rng.normal(size=(3 * RUN + 17, 3)) - eye)  # more than one chunk
    one = scene.first_hits(eye, directions)
    for origins in (eye[None, :], np.broadcast_to(eye, directions.shape), np.tile(eye, (len(directions), 1))):
        for same, was in zip(scene.first_hits(origins, directions), one, strict=True):
            assert (same == was).all()
    part = slice(RUN - 5, RUN + 5)
    assert (scene.first_hits(eye, directions[part]).distance == one.distance[part]).all()
    for result in scene.first_hits(eye, np.empty((0, 3))):
        assert result.shape == (0,)
    assert one.distance.dtype == one.u.dtype == np.float64
    assert one.triangle.dtype == np.int32
    assert (scene.first_triangles(eye, directions) == one.triangle).all()


@pytest.mark.parametrize(("vertices", "faces", "message"), [
    (np.zeros((3, 2)), FACE, r"vertices must be of shape \(n, 3\), not \(3, 2\)"),
    (np.zeros((0, 3)), FACE, "vertices are empty"),
    (TRIANGLE.astype(complex), FACE, "vertices must be real numbers, not complex128"),
    (TRIANGLE.astype(str), FACE, "vertices must be real numbers"),
    (np.array([[0.0, 0, 0], [1, np.nan, 0], [0, 1, 0]]), FACE, r"vertices must be finite: vertex 1 is \[ 1. nan  0.\]"),
    (np.array([[0.0, 0, 0], [1, 0, 0], [0, np.inf, 0]]), FACE, "vertices must be finite: vertex 2"),
    (1e200 * TRIANGLE, FACE, r"vertices must lie within 1e\+150: one is at 5e\+201"),
    (TRIANGLE, np.array([[0, 1, 2], [0, 1, 3]]), r"faces must name vertices 0 to 2: face 1 is \[0 1 3\]"),
    (TRIANGLE, np.array([[0, 1, -1]]), "faces must name vertices 0 to 2: face 0"),
    (TRIANGLE, np.array([[0, 1, 2**32]]), "faces must name vertices 0 to 2: face 0"),
    (TRIANGLE, np.empty((0, 3), dtype=np.int32), r"faces must be of shape \(m, 3\), m ≥ 1, not \(0, 3\)"),
    (TRIANGLE, np.array([0, 1, 2]), r"faces must be of shape \(m, 3\), m ≥ 1, not \(3,\)"),
    (TRIANGLE, np.array([[0.0, 1, 2]]), "faces must be integers, not float64"),
])
def test_meshes_that_would_crash_embree_are_refused(vertices: np.ndarray, faces: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TriangleScene(vertices, faces)


@pytest.mark.parametrize(("origins", "directions", "message"), [
    (np.zeros((3, 3)), np.repeat(DOWN, 2, axis=0),
     r"origins must be of shape \(3,\) or \(2, 3\) like the directions, not \(3, 3\)"),
    (np.zeros((2, 3)), np.repeat(DOWN, 3, axis=0), r"origins must be of shape \(3,\) or \(3, 3\)"),
    (np.zeros((0, 3)), DOWN, r"origins must be of shape \(3,\) or \(1, 3\)"),
    (np.zeros(2), DOWN, r"origins must be of shape \(n, 3\), not \(1, 2\)"),
    (np.zeros(3), np.zeros((5, 2)), r"directions must be of shape \(n, 3\), not \(5, 2\)"),
    (np.zeros(3), np.array([0.0, 0, -1]), r"directions must be of shape \(n, 3\), not \(3,\)"),
    (np.zeros(3), np.array([[None, 0, 1]]), "directions must be real numbers, not object"),
    (np.zeros(3), np.array([[0, 0, -1], [0, 0, 0]]), "directions must be of length 1: that of ray 1 .* of length 0"),
    (np.zeros(3), np.array([[0, 0, -2.0]]), "directions must be of length 1: that of ray 0 .* of length 2"),
    (np.zeros(3), np.array([[0, np.nan, -1.0]]), "directions must be finite: that of ray 0"),
    (np.zeros(3), np.array([[0, 0, -1], [0, 0, -np.inf]]), "directions must be finite: that of ray 1"),
    (np.array([[0, 0, 0], [0, np.inf, 0]]), np.repeat(DOWN, 2, axis=0),
     r"origins must be finite: that of ray 1 is \[ 0. inf  0.\]"),
    (np.array([0, 0, np.nan]), DOWN, "origins must be finite: that of ray 0"),
])
def test_rays_that_would_crash_embree_are_refused(origins: np.ndarray, directions: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TriangleScene(TRIANGLE, FACE).first_hits(origins, directions)


def test_a_bad_ray_in_a_later_chunk_is_named_by_its_own_row() -> None:
    directions = np.repeat(DOWN, 3 * RUN, axis=0)
    directions[2 * RUN + 5, 0] = np.nan
    with pytest.raises(ValueError, match=f"directions must be finite: that of ray {2 * RUN + 5}"):
        TriangleScene(TRIANGLE, FACE).first_hits(np.zeros(3), directions)


def test_threads_are_kept_and_a_forked_process_starts_its_own() -> None:
    scene = TriangleScene(TRIANGLE, FACE)
    directions = np.repeat(DOWN, 3 * RUN, axis=0)
    scene.first_hits(np.array([0.0, 0, 5]), directions)
    child = os.fork()
    if child == 0:  # no assertion in here: it would run the rest of the tests twice
        os._exit(0 if (TriangleScene(TRIANGLE, FACE).first_hits(np.array([0.0, 0, 5]), directions).triangle == 0).all() else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
