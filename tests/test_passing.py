"""Rays that pass a sheet beside its edge: none of them meets it, by dense samples along each and by the search."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

import mirror_cad
from raytrace.kernels import height_field
from raytrace.kernels.outcomes import HIT, LOST, OUTSIDE
from raytrace.rays import Rays, Trace
from raytrace.surfaces.bspline import BSplineFace, run_kernel
from tests.conftest import constant, spec_of

SAMPLES = 4000  # along a ray, over the rectangle
VERTICAL: dict[str, dict[str, object]] = {"twisted": {"law": "linear", "right_mm": 1300.0, "left_mm": 240.0}}
LAWS = {
    "twisted": {"law": "linear", "right_mm": 1250.0, "left_mm": 300.0},
    "a cap": {"law": "linear", "right_mm": 1250.0, "left_mm": 400.0},
    "a saddle": constant(-900.0),
    "curled at one edge": {"law": "linear", "right_mm": 1250.0, "left_mm": 130.0},
    "a crease of curvature": {"law": "zones", "right_mm": 1250.0, "left_mm": 250.0, "blend_from": 0.7},
    "a wave": {"law": "table", "x_mm": [-120.0, -60.0, 0.0, 60.0, 120.0], "curvature_per_mm": [4e-3, -3e-3, 4e-3, -3e-3, 4e-3]},
}


def face_of(name: str) -> BSplineFace:
    """The whole sheet: what is OUTSIDE it passes it."""
    mirror = mirror_cad.design(spec_of(LAWS[name], VERTICAL.get(name, constant(1300.0))))
    return BSplineFace(mirror.surface, (mirror.outline.polyline(1e-3),)).untrimmed()


def beside_the_edge(face: BSplineFace, n: int) -> Rays:
    """Rays that meet the sheet, or what would continue it, near the ends of its rectangle, under all kinds of angles."""
    rng = np.random.default_rng(5)
    x_min, x_max, y_min, y_max = face.surface.domain
    reach = rng.choice([1e-5, 0.1, 30.0, 300.0], (2, n)) * rng.uniform(-1.0, 1.0, (2, n))
    x, y = rng.uniform(x_min, x_max, n), rng.uniform(y_min, y_max, n)
    side = rng.integers(0, 4, n)
    x = np.where(side == 0, x_min + reach[0], np.where(side == 1, x_max + reach[0], x))
    y = np.where(side == 2, y_min + reach[1], np.where(side == 3, y_max + reach[1], y))
    z = face.surface.evaluate(np.clip(x, x_min, x_max), np.clip(y, y_min, y_max))[:, 2] + 0.1 * reach.sum(axis=0)
    directions = rng.normal(size=(n, 3)) * [1.0, 1.0, 0.7] - [0.0, 0.0, 0.8]
    # A third of them down hardly more steeply than the sheet anywhere.
    assert face.height_field is not None
    steep = -np.sqrt(face.height_field.steepest) * (1.0 + 10.0 ** rng.uniform(-4.0, 0.0, n)) * np.hypot(*directions[:, :2].T)
    directions[::3, 2] = steep[::3]
    return Rays(np.stack([x, y, z], axis=1) - directions * rng.uniform(-20.0, 900.0, n)[:, None], directions)


@pytest.mark.parametrize("name", LAWS)
def test_what_passes_a_sheet_does_not_meet_it(name: str) -> None:
    face = face_of(name)
    assert face.height_field is not None
    rays = beside_the_edge(face, 20_000)
    found, searched = Trace.empty(len(rays)), face._search(rays)
    run_kernel(partial(height_field.hits, face.height_field, face.trimming.strips), rays, found)
    passing = found.status == OUTSIDE
    assert passing.sum() > 500
    known = found.status != LOST
    np.testing.assert_array_equal(found.status[known], searched.status[known])
    assert (found.status == HIT).sum() > 1000
    x_min, x_max, y_min, y_max = face.surface.domain
    for n in np.flatnonzero(passing)[:1500]:
        origin, direction = rays.origins[n], rays.directions[n]
        with np.errstate(divide="ignore"):
            ends = (np.array([[x_min, y_min], [x_max, y_max]]) - origin[:2]) / direction[:2]
        near, far = max(ends.min(axis=0).max(), 0.0), ends.max(axis=0).min()
        if far > near:
            points = origin + np.linspace(near, far, SAMPLES)[:, None] * direction
            on_sheet = face.surface.evaluate(np.clip(points[:, 0], x_min, x_max), np.clip(points[:, 1], y_min, y_max))
            above = points[:, 2] - on_sheet[:, 2]
            assert (above > 0.0).all() or (above < 0.0).all()


@pytest.mark.parametrize("name", [name for name in LAWS if name not in ("twisted", "curled at one edge")])
def test_no_ray_of_a_picture_is_left_to_the_search(name: str) -> None:
    """A frame a tenth wider than the mirror, from a driver's eye: a ray that is searched for takes as long as ten others."""
    face = face_of(name)
    assert face.height_field is not None
    x_min, x_max, y_min, y_max = face.surface.domain
    x, y = np.meshgrid(np.linspace(1.1 * x_min, 1.1 * x_max, 200), np.linspace(1.1 * y_min, 1.1 * y_max, 150))
    eye = np.array([500.0, 100.0, 700.0])
    rays = Rays(eye[None], np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) - eye)
    found = Trace.empty(x.size)
    run_kernel(partial(height_field.hits, face.height_field, face.trimming.strips), rays, found)
    assert (found.status == OUTSIDE).sum() > 1000
    assert (found.status == LOST).sum() == 0
