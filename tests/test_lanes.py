"""Polynomials of rays apart, in vectors that are written down, against the plain rule for one ray; and a sheet's bounds."""

from __future__ import annotations

import numpy as np
import pytest

from mirror_cad.surfaces.basis import greville_abscissae
from mirror_cad.surfaces.bspline import BSplineSurface
from raytrace.kernels.blocks import BLOCK, V0, V1, V2, ZX, ZY, Z
from raytrace.kernels.cells import PADDED_POWERS, Cells, horner, taylor_of_any
from raytrace.kernels.compiled import compiled
from raytrace.kernels.lanes import horner_apart, pitch
from raytrace.kernels.vectors import RAYS
from raytrace.rays import Rays, Trace
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.polynomials import height_field_of

CELLS = 5


def both(powers: int):
    @compiled(fastmath={"contract"})
    def evaluate(flat, w, plain):
        for m in range(0, BLOCK, RAYS):
            horner_apart(powers, flat, w, m, V2, V0, V1, Z, ZX, ZY)
        for m in range(BLOCK):
            plain[0, m], plain[1, m], plain[2, m] = horner(powers, flat, int(w[V2 + m]), w[V0 + m], w[V1 + m])

    return evaluate


@pytest.mark.parametrize("powers", PADDED_POWERS)
def test_rays_in_cells_of_their_own_are_evaluated_as_one_by_one(powers: int) -> None:
    rng = np.random.default_rng(powers)
    flat = np.zeros((CELLS, powers, pitch(powers)))
    flat[..., :powers] = rng.normal(size=(CELLS, powers, powers))
    w, plain = np.full(64 * BLOCK, np.nan), np.empty((3, BLOCK))
    w[V2:V2 + BLOCK] = rng.integers(0, CELLS, BLOCK) * powers * pitch(powers)
    w[V0:V0 + BLOCK], w[V1:V1 + BLOCK] = rng.uniform(-2.0, 2.0, (2, BLOCK))
    w[V0 + 3] = np.nan
    both(powers)(flat.ravel(), w, plain)
    found = np.array([w[row:row + BLOCK] for row in (Z, ZX, ZY)])
    up = np.arange(powers)[::-1]
    for m in range(BLOCK):
        cell, a, b = flat[int(w[V2 + m]) // (powers * pitch(powers)), :, :powers], w[V0 + m], w[V1 + m]
        for k, (slope_a, slope_b) in enumerate(((0, 0), (1, 0), (0, 1))):  # numpy's own powers, and their derivatives
            along_a = up * a ** np.maximum(up - 1, 0) if slope_a else a ** up
            along_b = up * b ** np.maximum(up - 1, 0) if slope_b else b ** up
            terms = cell * along_b[:, None] * along_a
            rounding = 4 * powers * np.finfo(float).eps * np.abs(terms).sum()  # of as many steps, each way
            np.testing.assert_allclose(found[k, m], terms.sum(), rtol=0, atol=rounding)
            np.testing.assert_allclose(found[k, m], plain[k, m], rtol=0, atol=rounding)


def sheet_with(knots_u: list[float], degree: int) -> BSplineSurface:
    """A bumpy sheet z(x, y) of these knots in x, seven poles in y."""
    u, v = np.array(knots_u), np.concatenate([np.zeros(5), [2.0, 5.0], np.full(5, 9.0)])
    x, y = greville_abscissae(u, degree), greville_abscissae(v, 4)
    z = np.random.default_rng(2).normal(size=(len(x), len(y)))
    return BSplineSurface(degree, 4, u, v, np.stack([*np.meshgrid(x, y, indexing="ij"), z], axis=-1))


def test_second_derivatives_change_by_less_than_the_bound_that_settles_rays() -> None:
    field = height_field_of(sheet_with([*[0.0] * 5, 1.0, 4.0, 4.0, *[10.0] * 5], 4))
    assert field is not None
    rng = np.random.default_rng(3)
    at, angle, step = rng.uniform([0.1, 0.1], [9.9, 8.9], (20_000, 2)), rng.uniform(0.0, 2.0 * np.pi, 20_000), 1e-4
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # By how much the slopes along x and y, on a straight line, are beside the line through two of them: twist·s² at the most.
    three = np.array([taylor_at(field.cells, at + k * step * along) for k in (-1, 0, 1)])
    z, z_x, z_y = (np.abs(three[0] - 2.0 * three[1] + three[2]).max(axis=0) / step**2)[:3]
    assert max(z_x, z_y) < field.twist < 10.0 * max(z_x, z_y)
    assert z < field.bend < 10.0 * z


@pytest.mark.parametrize(("knots", "degree"),
                         [([*[0.0] * 5, 4.0, 4.0, 4.0, *[10.0] * 5], 4), ([*[0.0] * 3, 4.0, *[10.0] * 3], 2)])
def test_no_bound_holds_where_second_derivatives_jump(knots: list[float], degree: int) -> None:
    field = height_field_of(sheet_with(knots, degree))
    assert field is not None
    assert field.twist == np.inf
    assert np.isfinite(field.bend)


def test_no_bound_holds_either_where_some_second_derivatives_jump_and_others_do_not() -> None:
    """The change along x of those that do not is 0/0 in poles, and what the poles say of others must not hide that."""
    sheet = sheet_with([*[0.0] * 5, 4.0, 4.0, 4.0, *[10.0] * 5], 4)
    poles = sheet.poles.copy()
    poles[:, 2, 2] = 0.0  # straight along x
    for along_x in (True, False):
        turned = BSplineSurface(4, 4, sheet.knots_v, sheet.knots_u, poles.swapaxes(0, 1)[..., [1, 0, 2]])
        field = height_field_of(BSplineSurface(4, 4, sheet.knots_u, sheet.knots_v, poles) if along_x else turned)
        assert field is not None
        assert field.twist == np.inf


@pytest.mark.parametrize(("degree_u", "degree_v"), [(3, 1), (1, 3), (1, 1), (2, 1), (1, 2)])
def test_a_sheet_that_is_ruled_has_bounds_and_is_met(degree_u: int, degree_v: int) -> None:
    """A straight line between two poles has no second derivative of its own, and the sheet has that of both."""
    knots = [np.concatenate([[0.0] * (d + 1), [30.0, 60.0][:2 * (d > 1)], [100.0] * (d + 1)]) for d in (degree_u, degree_v)]
    x, y = (greville_abscissae(k, d) for k, d in zip(knots, (degree_u, degree_v), strict=True))
    z = np.random.default_rng(5).normal(size=(len(x), len(y)))
    surface = BSplineSurface(degree_u, degree_v, *knots, np.stack([*np.meshgrid(x, y, indexing="ij"), z], axis=-1))
    field = height_field_of(surface)
    assert field is not None
    u, v = (np.linspace(0.5, 99.5, 298),) * 2
    d = surface.on_grid(u, v, order=2)
    size = np.linalg.eigvalsh(np.stack([d["uu"], d["uv"], d["uv"], d["vv"]], axis=-1)[..., 2, :].reshape(-1, 2, 2))
    assert np.abs(size).max() <= field.bend * (1.0 + 1e-12)  # of one cell they are equal, but for rounding
    assert field.twist == np.inf if 2 in (degree_u, degree_v) else np.isfinite(field.twist)
    face = BSplineFace(surface, (np.zeros((1, 2)),)).untrimmed()
    aimed = surface.evaluate(*np.random.default_rng(6).uniform(0.1, 99.9, (2, 500)))
    rays = Rays(np.array([[40.0, 60.0, 500.0]]), aimed - [40.0, 60.0, 500.0])
    found = Trace.empty(500)
    face.first_hits(rays, found)
    assert found.points == pytest.approx(aimed, abs=1e-11)


def taylor_at(cells: Cells, at: np.ndarray) -> np.ndarray:
    found = np.empty((len(at), 8))
    for place, row in zip(at, found, strict=True):
        taylor_of_any(cells, *place, row)
    return found
