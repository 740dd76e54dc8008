"""Rays to B-spline sheets that are no z(x, y): Newton in blocks against the search of pieces, which begins nowhere."""

from __future__ import annotations

import numpy as np
import pytest

from mirror_cad.surfaces.bspline import BSplineSurface
from raytrace.rays import Rays, Status, Trace
from raytrace.surfaces.bspline import BSplineFace, search_pieces

LOOP = np.array([[0.1, 0.1], [0.9, 0.2], [0.8, 0.9], [0.2, 0.8]])


@pytest.mark.parametrize("one_sided", [True, False])
@pytest.mark.parametrize("height", [0.5, 8.0])  # mm, of the poles about a plane: a sheet of its own, and one that folds
@pytest.mark.parametrize("rational", [True, False])
def test_newton_finds_what_a_search_finds(rational: bool, height: float, one_sided: bool) -> None:
    rng = np.random.default_rng(9)
    knots_u, knots_v = (np.concatenate([np.zeros(d), np.linspace(0.0, 1.0, 6), np.ones(d)]) for d in (3, 2))
    x, y = np.meshgrid(np.linspace(-40.0, 40.0, 8), np.linspace(-30.0, 30.0, 7), indexing="ij")
    flat = np.stack([x + rng.uniform(-1.0, 1.0, x.shape), y + rng.uniform(-1.0, 1.0, y.shape),
                     rng.uniform(-height, height, x.shape)], axis=-1)
    turn = np.array([[0.6, 0.0, 0.8], [0.48, 0.8, -0.36], [-0.64, 0.6, 0.48]])
    weights = rng.uniform(0.7, 1.4, x.shape) if rational else None
    surface = BSplineSurface(3, 2, knots_u, knots_v, flat @ turn + [5.0, -3.0, 7.0], weights)
    face = BSplineFace(surface, (LOOP,), 1.0, one_sided)
    targets = surface.evaluate(*rng.uniform(0.0, 1.0, (2, 500)))
    back = rng.normal(size=(500, 3)) * [1.0, 1.0, 0.3] @ turn  # many of them along the sheet
    rays = Rays(np.ascontiguousarray(targets + 80.0 * back), np.ascontiguousarray(-back))
    found, searched = Trace.empty(500), Trace.empty(500)
    face.first_hits(rays, found)
    search_pieces(face.pieces, rays, searched)
    np.testing.assert_array_equal(found.status, searched.status)
    hit = found.status == Status.REFLECTED
    assert hit.sum() > (100 if one_sided else 200)
    # As far off as a place along the surface is from the ray: where it grazes, more.
    off = np.linalg.norm(rays.directions[hit], axis=1) / np.abs(np.einsum("ij,ij->i", found.normals[hit], rays.directions[hit]))
    for one, other in ((found.points, searched.points), (found.normals, searched.normals),
                       (found.directions, searched.directions)):
        assert (np.linalg.norm(one[hit] - other[hit], axis=1) / off).max() < 1e-12
