"""κ(x) beyond the mirror's edges, and where it breaks: against derivatives and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from mirror_cad.laws.curvature import Break, CurvatureLaw, smooth_extrapolation

Array = NDArray[np.float64]
EDGES = (-115.0, 115.0)
LARGEST = 0.01  # 1/mm, what the extrapolation keeps away from


def wave(x: Array, order: int = 0) -> Array:
    """A wave about 1/(1000 mm), and its derivatives."""
    return 1e-3 * (order == 0) + 3e-4 * np.sin(x / 40.0 + 0.5 * np.pi * order) / 40.0**order


@pytest.mark.parametrize("edge", EDGES)
def test_value_slope_and_bend_of_a_law_go_on_beyond_its_edge(edge: float) -> None:
    law = smooth_extrapolation(CurvatureLaw(wave, ()), *EDGES, LARGEST)
    beyond = edge + 0.5 * np.sign(edge) * np.arange(1, 10)  # tanh(d/L) with L = 23 mm: its ninth power is 1e-12 there
    outside = Polynomial.fit(beyond, law.at(beyond), 8)
    for order, relative in ((0, 1e-12), (1, 1e-10), (2, 1e-8)):
        assert outside.deriv(order)(edge) == pytest.approx(wave(np.array(edge), order), rel=relative)
    assert law.at(np.array([edge]))[0] == wave(np.array(edge))
    x = np.linspace(*EDGES, 101)[1:-1]
    assert law.at(x) == pytest.approx(wave(x), rel=1e-12)


@pytest.mark.parametrize(("slope", "bend", "level"), [
    (1e-6, 0.0, 1e-3 + 1e-6 * 23.0),  # gently: level after a tenth of the width
    (4e-4, 0.0, 1e-3 + 0.25 * (LARGEST - 1e-3)),  # steeply: a quarter of the way for the slope,
    (0.0, 4e-5, 1e-3 + 0.25 * (LARGEST - 1e-3)),  # and one for the bend
    (0.0, 0.0, 1e-3),
])
def test_a_law_levels_off_before_half_the_way_to_the_largest_curvature(slope: float, bend: float, level: float) -> None:
    right = EDGES[1]

    def kappa(x: Array) -> Array:
        # Flat up to 1 mm before the right edge, so that the law itself stays small.
        d = np.asarray(x) - right
        return 1e-3 + np.where(d > -1.0, slope * d + 0.5 * bend * d**2, slope * -1.0 + 0.5 * bend)

    law = smooth_extrapolation(CurvatureLaw(kappa, (Break(right - 1.0, 0),)), *EDGES, LARGEST)
    assert law.at(np.array([right + 1e4]))[0] == pytest.approx(level, rel=1e-6)  # second derivatives of a series
    beyond = law.at(right + np.linspace(0.0, 200.0, 2001))
    assert (np.diff(beyond) >= -1e-12).all()


def test_the_law_is_said_to_be_smooth_to_the_second_derivative_at_its_edges() -> None:
    law = smooth_extrapolation(CurvatureLaw(wave, (Break(-115.0, 0), Break(20.0, 1), Break(115.0, -1))), *EDGES, LARGEST)
    assert law.breaks == (Break(-115.0, 2), Break(20.0, 1), Break(115.0, 2))


@pytest.mark.parametrize(("jump", "smoothness"), [(1e-4, -1), (0.0, 0)])
def test_a_break_that_nobody_announced_is_found_and_told_for_a_jump_or_a_kink(jump: float, smoothness: int) -> None:
    at = 31.234567

    def kappa(x: Array) -> Array:
        return 1e-3 + np.where(x < at, 0.0, jump + 1e-6 * (x - at))

    law = CurvatureLaw(kappa, (Break(-50.0, 2),))
    found = law.all_breaks(law.series(*EDGES))
    assert [b.smoothness for b in found] == [2, smoothness]
    assert found[1].x_mm == pytest.approx(at, abs=5e-3)
