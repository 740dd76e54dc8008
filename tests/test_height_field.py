"""Rays of any direction to sheets z(x, y), with and without a search, against dense samples along them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirror_cad.surfaces.bspline import BSplineSurface
from raytrace.kernels import height_field, height_field_search
from raytrace.rays import Rays, Status, Trace
from raytrace.surfaces.bspline import BSplineFace

Array = NDArray[np.float64]
DEGREE, SPANS = 3, 8
FRAME = np.array([[-30.0, -22.0], [30.0, -22.0], [30.0, 22.0], [-30.0, 22.0]])
HOLE = 0.3 * FRAME


def sheet(kind: str, one_sided: bool) -> BSplineFace:
    """A sheet over ±40 × ±30 with a frame for its edge: waves, or a cap, which is concave."""
    knots = [np.concatenate([np.full(DEGREE, -half), np.linspace(-half, half, SPANS + 1), np.full(DEGREE, half)])
             for half in (40.0, 30.0)]
    x, y = (np.lib.stride_tricks.sliding_window_view(each[1:-1], DEGREE).mean(axis=1) for each in knots)
    x, y = np.meshgrid(x, y, indexing="ij")
    z = np.random.default_rng(8).uniform(-3.0, 3.0, x.shape) if kind == "waves" else -(x**2) / 90.0 - y**2 / 70.0
    return BSplineFace(BSplineSurface(DEGREE, DEGREE, *knots, np.stack([x, y, z], axis=-1)), (FRAME, HOLE), 1.0, one_sided)


def rays(n: int) -> tuple[Array, Array]:
    """From above, beneath and beside, every other one nearly level."""
    rng = np.random.default_rng(3)
    origins = rng.uniform([-60.0, -50.0, -15.0], [60.0, 50.0, 15.0], (n, 3))
    directions = rng.uniform([-30.0, -22.0, -4.0], [30.0, 22.0, 4.0], (n, 3)) - origins
    directions[::2, 2] *= 0.1
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def is_inside(x: Array, y: Array) -> NDArray[np.bool_]:
    """In the frame and not in its hole."""
    return (np.abs(x) < 30.0) & (np.abs(y) < 22.0) & ~((np.abs(x) < 9.0) & (np.abs(y) < 6.6))


def densely(face: BSplineFace, origin: Array, direction: Array) -> float:
    """The first distance at which the ray goes through the sheet inside its frame, by samples 0.05 mm apart; inf without."""
    def above(t: Array) -> Array:
        x, y, z = (origin + t[:, None] * direction).T
        known = (np.abs(x) <= 40.0) & (np.abs(y) <= 30.0)
        return np.where(known, z - face.surface.heights(np.clip(x, -40.0, 40.0), np.clip(y, -30.0, 30.0))[0], np.nan)

    at = np.linspace(0.0, 200.0, 4001)
    value = above(at)
    low = np.flatnonzero(value[1:] * value[:-1] < 0.0)
    if low.size == 0:
        return np.inf
    a, b, sign = at[low], at[low + 1], np.sign(value[low])
    for _ in range(50):
        middle = 0.5 * (a + b)
        before = above(middle) * sign > 0.0
        a, b = np.where(before, middle, a), np.where(before, b, middle)
    x, y, _ = (origin + a[:, None] * direction).T
    return float(min(a[is_inside(x, y)], default=np.inf))


@pytest.mark.parametrize("one_sided", [True, False])
@pytest.mark.parametrize("kind", ["waves", "cap"])
def test_the_first_place_on_a_ray_is_met_from_everywhere(kind: str, one_sided: bool) -> None:
    face = sheet(kind, one_sided)
    assert face.height_field is not None
    origins, directions = rays(600)
    found = Trace.empty(len(origins))
    face.first_hits(Rays(origins, directions), found)
    expected = np.array([densely(face, *ray) for ray in zip(origins, directions, strict=True)])
    assert (found.status != Status.LOST).all()
    met = np.isfinite(found.distances)
    assert met[np.isfinite(expected)].all()
    assert (found.distances[met] <= expected[met] + 1e-8).all()
    points = origins + found.distances[:, None] * directions
    z, z_x, z_y = face.surface.heights(*points[met, :2].T)
    assert np.abs(points[met, 2] - z).max() < 1e-11  # also where samples have passed by two places close together
    assert is_inside(*points[met, :2].T).all()
    assert (~np.isfinite(expected[met])).sum() < 0.05 * len(met)
    normals = np.stack([-z_x, -z_y, np.ones_like(z)], axis=1) / np.sqrt(1.0 + z_x**2 + z_y**2)[:, None]
    along = np.einsum("ij,ij->i", normals, directions[met])
    behind = one_sided & (along >= 0.0)
    assert (found.status[met] == np.where(behind, Status.BEHIND, Status.REFLECTED)).all()
    hit = np.flatnonzero(met)[~behind]
    normals, along = normals[~behind], along[~behind, None]
    assert np.abs(found.points[hit] - points[hit]).max() < 1e-11
    assert np.abs(found.normals[hit] + np.sign(along) * normals).max() < 1e-12
    assert np.abs(found.directions[hit] - (directions[hit] - 2.0 * along * normals)).max() < 1e-12


def test_steep_rays_are_met_without_the_search_and_where_it_meets_them() -> None:
    """Newton takes them all, in blocks that lie together or scattered, and as exactly."""
    face = sheet("waves", True)
    field, strips = face.height_field, face.trimming.strips
    assert field is not None
    rng = np.random.default_rng(5)
    to = rng.uniform(FRAME[0] + 1.0, FRAME[2] - 1.0, (1600, 2))
    for targets in (to, to[np.lexsort(to.T)], 0.1 * to + [20.0, 15.0]):
        origins = np.concatenate([targets + rng.uniform(-5.0, 5.0, targets.shape), np.full((len(targets), 1), 40.0)], axis=1)
        directions = np.concatenate([targets, np.zeros((len(targets), 1))], axis=1) - origins
        by_newton, by_search = Trace.empty(len(origins)), Trace.empty(len(origins))
        height_field.hits(field, strips, origins.ravel(), directions.ravel(), by_newton.flat)
        height_field_search.first_hits(field, strips, True, origins.ravel(), directions.ravel(), by_search.flat)
        np.testing.assert_array_equal(by_newton.status, by_search.status)
        hit = by_newton.status == Status.REFLECTED
        assert hit.sum() > 0.5 * len(hit)
        assert np.abs(by_newton.points[hit] - by_search.points[hit]).max() < 1e-12
        assert np.abs(by_newton.directions[hit] - by_search.directions[hit]).max() < 1e-13
