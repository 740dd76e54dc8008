"""Polynomials of rays apart, in vectors that are written down, against the plain rule for one ray."""

from __future__ import annotations

import numpy as np
import pytest

from raytrace.kernels.blocks import BLOCK, V0, V1, V2, ZX, ZY, Z
from raytrace.kernels.cells import PADDED_POWERS, horner
from raytrace.kernels.compiled import compiled
from raytrace.kernels.lanes import RAYS, horner_apart, pitch

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
