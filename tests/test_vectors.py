"""Eight numbers as one value of compiled code, against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from raytrace.kernels import blocks
from raytrace.kernels.blocks import BLOCK, X, Y
from raytrace.kernels.compiled import compiled
from raytrace.kernels.vectors import RAYS, count_of, eight, ends_of, maximum, minimum, put, root, size, where


@compiled(fastmath={"contract"})
def figures(a, b, number, out):
    """Rows of 8: what operators and functions give."""
    x, y = eight(a, 0), eight(b, 0)
    power = 1.0
    for _ in range(3):  # a number becomes eight of it
        power = power * x
    put(out, 0 * RAYS, x + y)
    put(out, 1 * RAYS, x - number)
    put(out, 2 * RAYS, number * y)
    put(out, 3 * RAYS, number / y)
    put(out, 4 * RAYS, -x)
    put(out, 5 * RAYS, power)
    put(out, 6 * RAYS, minimum(x, y))
    put(out, 7 * RAYS, maximum(x, number))
    put(out, 8 * RAYS, root(size(x)))
    put(out, 9 * RAYS, where((x < y) & (x >= number), x, 7.0))
    put(out, 10 * RAYS, where((x > y) | (y <= number), 7.0, y))
    return count_of(x < y), count_of(x <= x)


@compiled()
def box(a, b):
    """The ends of the eight from 1 on of each."""
    return ends_of(eight(a, 1), eight(a, 1), eight(b, 1), eight(b, 1))


def test_operators_and_functions_are_those_of_numpy() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.normal(size=(2, RAYS))
    x[2], number, out = np.nan, 0.25, np.empty(11 * RAYS)
    less, known = figures(x, y, number, out)
    assert (less, known) == (np.sum(x < y), RAYS - 1)
    kept = np.arange(RAYS) != 2
    wanted = (x + y, x - number, number * y, number / y, -x, x * x * x, np.fmin(x, y), np.fmax(x, number), np.sqrt(np.abs(x)),
              np.where((x < y) & (x >= number), x, 7.0), np.where((x > y) | (y <= number), 7.0, y))
    for row, (found, one) in enumerate(zip(out.reshape(-1, RAYS), wanted, strict=True)):
        np.testing.assert_array_equal(found[kept], one[kept], str(row))
    np.testing.assert_array_equal(np.isnan(out.reshape(-1, RAYS)[[0, 1, 4, 5, 8], 2]), True)
    assert out[6 * RAYS + 2] == y[2]  # of two numbers of which one is NaN, the second
    assert out[9 * RAYS + 2] == 7.0


@pytest.mark.parametrize("at", range(RAYS))
def test_the_least_and_the_greatest_are_found_wherever_they_stand(at: int) -> None:
    a, b = np.linspace(-0.5, 0.5, RAYS + 2), np.linspace(0.7, 0.3, RAYS + 2)
    a[0] = b[0] = -100.0  # beside them
    a[-1] = b[-1] = 100.0
    a[1 + at], b[1 + at] = -3.0, 5.0
    inside = slice(1, RAYS + 1)
    assert box(a, b) == (-3.0, a[inside].max(), b[inside].min(), 5.0)
    assert box(b, a) == (b[inside].min(), 5.0, -3.0, a[inside].max())


@compiled()
def box_of_rows(w):
    return blocks.box(w, X, Y)


@pytest.mark.parametrize("lost", [(0,), (7,), (8,), (15,), (3, 11), tuple(range(8)), tuple(range(8, 16)), tuple(range(1, 16))])
def test_a_lost_ray_does_not_hide_where_the_others_of_its_block_are(lost: tuple[int, ...]) -> None:
    rng = np.random.default_rng(len(lost) + lost[0])
    w = np.full(64 * BLOCK, np.nan)
    x, y = rng.normal(size=(2, BLOCK))
    x[list(lost)] = y[list(lost)] = np.nan
    w[X:X + BLOCK], w[Y:Y + BLOCK] = x, y
    assert box_of_rows(w) == (np.nanmin(x), np.nanmax(x), np.nanmin(y), np.nanmax(y))
