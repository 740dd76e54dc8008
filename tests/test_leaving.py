"""Rays that leave a sheet above it: none of them meets it, by dense samples along each."""

from __future__ import annotations

import numpy as np
import pytest

import mirror_cad
from raytrace.kernels.outcomes import HIT, OUTSIDE
from raytrace.rays import Rays, Trace
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.leaving import leaves_above
from tests.conftest import constant, spec_of

SAMPLES = 4000  # along a ray, over the rectangle
LAWS = {
    "a cap": {"law": "linear", "right_mm": 1250.0, "left_mm": 400.0},
    "a saddle": constant(-900.0),
}


def beside_the_edge(face: BSplineFace, n: int) -> Rays:
    """Rays that meet the sheet, or what would continue it, near the ends of its rectangle, under all kinds of angles."""
    rng = np.random.default_rng(5)
    x_min, x_max, y_min, y_max = face.surface.domain
    x, y = rng.uniform(x_min - 30.0, x_max + 30.0, n), rng.uniform(y_min - 30.0, y_max + 30.0, n)
    z = face.surface.evaluate(np.clip(x, x_min, x_max), np.clip(y, y_min, y_max))[:, 2] + rng.uniform(-20.0, 20.0, n)
    directions = rng.normal(size=(n, 3)) * [1.0, 1.0, 0.7] - [0.0, 0.0, 0.4]
    return Rays(np.stack([x, y, z], axis=1) - directions * rng.uniform(-20.0, 900.0, n)[:, None], directions)


@pytest.mark.parametrize("name", LAWS)
def test_what_leaves_a_sheet_above_it_has_not_met_it(name: str) -> None:
    mirror = mirror_cad.design(spec_of(LAWS[name], constant(1300.0)))
    face = BSplineFace(mirror.surface, (mirror.outline.polyline(1e-3),))
    assert face.height_field is not None
    rays = beside_the_edge(face, 3000)
    leaving = leaves_above(face.height_field, face.surface, rays)
    assert leaving.sum() > 200
    x_min, x_max, y_min, y_max = face.surface.domain
    for origin, direction in zip(rays.origins[leaving], rays.directions[leaving], strict=True):
        with np.errstate(divide="ignore"):
            ends = (np.array([[x_min, y_min], [x_max, y_max]]) - origin[:2]) / direction[:2]
        near, far = max(ends.min(axis=0).max(), 0.0), ends.max(axis=0).min()
        points = origin + np.linspace(near, far, SAMPLES)[:, None] * direction if far > near else np.empty((0, 3))
        on_sheet = face.surface.evaluate(np.clip(points[:, 0], x_min, x_max), np.clip(points[:, 1], y_min, y_max))
        assert (points[:, 2] > on_sheet[:, 2]).all()
    # And the search, which they are spared, says the same of them.
    found, searched = Trace.empty(len(rays)), face._search(rays)
    face.first_hits(rays, found)
    assert (searched.status[leaving] == OUTSIDE).all()
    np.testing.assert_array_equal(found.status, searched.status)
    assert (found.status == HIT).sum() > 500
