"""The other side of a plate: points off a sphere along its normals, by as many halvings of the spans as that takes."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from mirror_cad.errors import SolidError
from mirror_cad.grid import Grid
from mirror_cad.outline import Outline
from mirror_cad.outline.segments import Arc
from mirror_cad.surfaces.basis import greville_abscissae
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import collocate_height, graph
from mirror_cad.surfaces.differential import normals, principal_curvatures
from mirror_cad.surfaces.offset import OFFSET_TOLERANCE_MM, _bent_at_most, offset_surface
from mirror_cad.surfaces.sphere import SphericalSag

ROUND = Outline((Arc((0.0, 0.0), 40.0, 0.0, 2.0 * np.pi),))
RADIUS, THICKNESS = 100.0, 3.0


@pytest.mark.parametrize(("reflecting", "other", "behind"), [("front", "back", -THICKNESS), ("back", "front", THICKNESS)])
def test_the_other_side_of_a_sphere_is_the_sphere_of_the_radius_and_the_thickness(
        reflecting: Literal["front", "back"], other: str, behind: float) -> None:
    knots = np.concatenate([np.full(5, -45.0), np.linspace(-45.0, 45.0, 5), np.full(5, 45.0)])
    sphere = collocate_height(SphericalSag(1.0 / RADIUS).height, knots, knots, 5)
    face, error = offset_surface(sphere, ROUND, THICKNESS, reflecting)
    assert error <= OFFSET_TOLERANCE_MM[other]
    # On as many spans as the sphere the offset misses it: they are halved, evenly, and end where they ended.
    spans = len(np.unique(face.knots_u)) - 1
    assert spans in (4, 8, 16, 32)
    assert (spans > 4) == (reflecting == "back")
    assert np.unique(face.knots_v) == pytest.approx(np.linspace(-45.0, 45.0, spans + 1), abs=1e-12)
    chance = np.random.default_rng(5)
    r, angle = 40.0 * np.sqrt(chance.uniform(0.0, 1.0, 300)), chance.uniform(0.0, 2.0 * np.pi, 300)
    u, v = r * np.cos(angle), r * np.sin(angle)
    centre = np.array([0.0, 0.0, -RADIUS])
    off = np.linalg.norm(face.evaluate(u, v) - centre, axis=1) - (RADIUS + behind)
    held = np.abs(np.linalg.norm(sphere.evaluate(u, v) - centre, axis=1) - RADIUS).max()  # of the sphere, by its spans
    assert np.abs(off).max() < 1.5 * OFFSET_TOLERANCE_MM[other] + 5.0 * held


@pytest.mark.parametrize("seed", range(40))
def test_the_bound_of_curvature_holds_on_dense_samples(seed: int) -> None:
    """Random sheets of degrees 2 to 5, some with a knot that lets the curvature or the slope break: there no bound is known."""
    rng = np.random.default_rng(seed)
    degree, repeated = int(rng.integers(2, 6)), int(rng.integers(1, 4))
    inner = np.sort(np.concatenate([[-20.0], np.full(min(repeated, degree), 10.0)]))
    knots = np.concatenate([np.full(degree + 1, -45.0), inner, np.full(degree + 1, 45.0)])
    sites = greville_abscissae(knots, degree)
    surface = graph(knots, knots, degree, rng.normal(size=(len(sites), len(sites))) * 10.0 ** rng.uniform(-2.0, 1.0))
    largest = np.abs(principal_curvatures(surface, *np.meshgrid(np.linspace(-45.0, 45.0, 301), np.linspace(-45.0, 45.0, 301))))
    bound = _bent_at_most(surface)
    assert not np.isfinite(bound) if repeated >= degree else bound >= largest.max()


def test_the_bound_of_a_parabolic_cylinders_curvature_is_that_at_its_vertex() -> None:
    """z = x²/2R, whose second derivative is 1/R everywhere: a cubic has it exactly."""
    knots = np.concatenate([np.full(4, -45.0), np.linspace(-45.0, 45.0, 5)[1:-1], np.full(4, 45.0)])
    cylinder = collocate_height(lambda x, y: x**2 / (2.0 * RADIUS) + 0.0 * y, knots, knots, 3)
    assert _bent_at_most(cylinder) == pytest.approx(1.0 / RADIUS, rel=1e-9)
    ends = np.array([-50.0, 50.0])
    corners = np.stack([*np.meshgrid(ends, ends, indexing="ij"), np.array([[0.0, 1.0], [2.0, 7.0]])], axis=-1)
    twisted = BSplineSurface(1, 1, ends.repeat(2), ends.repeat(2), corners)  # z_xy alone, 4 mm over 100 mm squared
    assert _bent_at_most(twisted) == pytest.approx(np.sqrt(2.0) * 4e-4, rel=1e-12)


def test_the_error_is_the_largest_distance_on_the_grid() -> None:
    """Against the vectors of all places inside and on the outline, one by one."""
    knots = np.concatenate([np.full(6, -45.0), np.linspace(-45.0, 45.0, 5)[1:-1], np.full(6, 45.0)])
    sphere = collocate_height(SphericalSag(1.0 / RADIUS).height, knots, knots, 5)
    face, error = offset_surface(sphere, ROUND, THICKNESS, "back")
    grid = Grid.over(ROUND)
    d = sphere.derivatives(grid.x, grid.y)
    off = face.evaluate(grid.x, grid.y) - d["s"] - THICKNESS * normals(d["u"], d["v"])
    # Rounding of coordinates of some 40 mm.
    assert error == pytest.approx(float(np.linalg.norm(off, axis=1).max()), abs=1e-13)


def test_a_surface_that_is_no_sag_has_no_other_side() -> None:
    knots = np.array([-45.0] * 4 + [45.0] * 4)
    flat = collocate_height(lambda x, y: 0.0 * (x + y), knots, knots, 3)
    beside = BSplineSurface(3, 3, knots, knots, flat.poles * [0.9, 1.0, 1.0])
    with pytest.raises(SolidError, match="this surface is none"):
        offset_surface(beside, ROUND, THICKNESS)
