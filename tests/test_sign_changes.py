"""Where sampled functions may cross zero twice between samples, and how low they go there."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from raytrace.visibility.sign_changes import lowest, may_cross

Array = NDArray[np.float64]


@pytest.mark.parametrize("depth", [0.0, -1e-6])
def test_the_lowest_point_is_found_wherever_it_lies(depth: float) -> None:
    """To 3e-3 of the cell; of a parabola it is 1e-5 of its rise too high there."""
    at = np.linspace(0.0, 1.0, 41)
    share, best = lowest(lambda t: (t - at) ** 2 + 1.0 + depth, len(at))
    assert np.abs(share - at).max() < 5e-3
    assert np.abs(best - 1.0 - depth).max() < 2e-5
    # Steep on one side and level on the other.
    share, _ = lowest(lambda t: np.where(t < at, 50.0 * (at - t), t - at) + 1.0, len(at))
    assert np.abs(share - at).max() < 5e-3


def test_below_zero_is_enough_and_what_has_no_value_is_high() -> None:
    at = np.linspace(0.1, 0.9, 9)
    asked = []

    def function(t: Array) -> Array:
        asked.append(t)
        return (t - at) ** 2 - 2.0

    share, best = lowest(function, len(at))
    assert (best <= -1.0).all()
    assert best == pytest.approx((share - at) ** 2 - 2.0, abs=1e-15)
    assert len(asked) == 2
    share, best = lowest(lambda t: np.where(t < 0.5, np.nan, t), 3)
    assert np.abs(share - 0.5).max() < 5e-3
    assert np.isinf(lowest(lambda t: np.full_like(t, np.nan), 2)[1]).all()


def test_a_parabola_that_dips_below_zero_between_samples_may_cross_there_and_one_that_stays_above_does_not() -> None:
    at = np.array([0.0, 1.0, 3.0])[:, None]
    top = np.array([0.5, 2.0, 0.5, 2.0, 0.5, 5.0])
    low = np.array([-0.1, -0.2, 1.0, 2.0, -0.1, -1.0])
    for sign in (1.0, -1.0):
        values = sign * ((at - top) ** 2 + low)
        first, second = may_cross(np.broadcast_to(at, values.shape), values)
        assert first.tolist() == [True, False, False, False, True, False]
        assert second.tolist() == [False, True, False, False, False, False]
    # A parabola the other way round, a straight line and one that crosses once have no dip.
    for values in (-((at - 0.5) ** 2) + 9.0, at + 0.01, at - 0.5):
        first, second = may_cross(at, values)
        assert not first[0]
        assert not second[0]


def test_a_parabola_may_cross_where_it_all_but_does_and_where_its_top_lies_a_little_beside_the_cell() -> None:
    """A twentieth of what the samples span above 0, but not a fifth; an eighth of a cell beside it, but not three."""
    at = np.array([0.0, 1.0, 2.0])[:, None]
    top = np.array([0.5, 0.5, 1.125, 1.375, 0.875, 0.625])
    low = np.array([0.05, 0.2, 0.0, 0.0, 0.0, 0.0]) * ((at - top) ** 2).max(axis=0)
    low[2:] = -0.01
    for sign in (1.0, -1.0):
        values = sign * ((at - top) ** 2 + low)
        first, second = may_cross(np.broadcast_to(at, values.shape), values)
        assert first.tolist() == [True, False, True, False, True, True]
        assert second.tolist() == [False, False, True, True, True, False]
