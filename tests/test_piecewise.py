"""Piecewise Chebyshev series against numpy's own Chebyshev class, and where they say that a function breaks."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray

from mirror_cad.surfaces.piecewise import PiecewiseChebyshev, _clenshaw, approximate

Array = NDArray[np.float64]
BREAKS = np.array([-3.0, -1.0, 0.5, 4.0])
SERIES = PiecewiseChebyshev(BREAKS, np.random.default_rng(3).normal(size=(3, 7)))
PIECES = [Chebyshev(c, domain=ends) for c, ends in zip(SERIES.coefficients, itertools.pairwise(BREAKS), strict=True)]


def piece_of(x: float) -> int:
    """The piece that begins at or before x; the first and the last go on."""
    return int(np.clip(np.searchsorted(BREAKS, x, side="right") - 1, 0, 2))


@pytest.mark.parametrize("count", [1, 2, 63, 64, 65, 300])
def test_values_are_those_of_the_piece_that_holds_the_point_in_any_order(count: int) -> None:
    chance = np.random.default_rng(count)
    for x in (chance.uniform(-4.0, 5.0, count), np.sort(chance.uniform(-4.0, 5.0, count)), np.resize(BREAKS, count)):
        assert SERIES(x) == pytest.approx([PIECES[piece_of(at)](at) for at in x], rel=1e-11, abs=1e-13)


def test_nothing_is_written_beside_the_values() -> None:
    """The compiled loop knows no bounds: what stands before and after its arrays stays."""
    for count in (1, 64, 100):
        x, values = np.full(count + 20, 0.3), np.full(count + 20, -7.0)
        _clenshaw(BREAKS, SERIES.coefficients, x[10:-10], values[10:-10])
        assert (values[:10] == -7.0).all()
        assert (values[-10:] == -7.0).all()
        assert values[10:-10] == pytest.approx(float(SERIES(0.3)))


def test_derivative_and_integral_are_those_of_the_pieces_and_the_integral_is_continuous() -> None:
    x = np.linspace(-2.9, 3.9, 101)
    assert SERIES.derivative()(x) == pytest.approx([PIECES[piece_of(at)].deriv()(at) for at in x], rel=1e-11, abs=1e-12)
    for zero_at in (-3.0, 0.0, 4.0):
        integral = SERIES.integral(zero_at)
        assert float(integral(zero_at)) == pytest.approx(0.0, abs=1e-14)
        whole = [integral(high) - integral(low) for low, high in itertools.pairwise(BREAKS)]
        exact = [piece.integ()(piece.domain[1]) - piece.integ()(piece.domain[0]) for piece in PIECES]
        assert whole == pytest.approx(exact, rel=1e-13, abs=1e-13)
        for at in BREAKS[1:-1]:
            assert float(integral(np.nextafter(at, -9.0))) == pytest.approx(float(integral(at)), abs=1e-13)


@pytest.mark.parametrize("power", [0, 1, 2])
def test_a_break_has_as_many_continuous_derivatives_as_the_power_that_sets_in_there_less_one(power: int) -> None:
    at = 1.3

    def function(x: Array) -> Array:
        return np.cos(x) + np.where(x > at, 0.2 * np.maximum(x - at, 0.0) ** power, 0.0)

    assert approximate(function, [-3.0, at, 4.0]).breakpoints() == [(at, power - 1)]
    # Of a cubic it is the third derivative that jumps, and of a smooth function none.
    assert approximate(lambda x: np.cos(x) + 0.2 * np.maximum(x - at, 0.0) ** 3, [-3.0, at, 4.0]).breakpoints() == []
    assert approximate(np.cos, [-3.0, at, 4.0]).breakpoints() == []


def test_a_kink_that_is_not_announced_is_where_the_pieces_crowd_once() -> None:
    series = approximate(lambda x: np.abs(x - 0.731) + np.abs(x + 1.2), [-3.0, 4.0])
    assert series.tight_breaks(1e-4) == pytest.approx([-1.2, 0.731], abs=1e-4)
    x = np.linspace(-3.0, 4.0, 1001)
    assert series(x) == pytest.approx(np.abs(x - 0.731) + np.abs(x + 1.2), abs=1e-7)  # a piece at a kink is so narrow
    assert approximate(np.cos, [-3.0, 4.0]).tight_breaks(1e-4) == []


def test_a_series_is_its_function_to_rounding_off_the_nodes() -> None:
    x = np.linspace(-3.0, 4.0, 2000)
    for function in (np.cos, lambda x: 1.0 / (1.0 + 25.0 * x**2), lambda x: np.exp(-40.0 * (x - 1.0) ** 2)):
        assert np.abs(approximate(function, [-3.0, 4.0])(x) - function(x)).max() < 1e-13
