"""The search for largest values over a grid and closed curves, against functions whose tops are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from raytrace.kernels.extremes import best_samples
from raytrace.visibility.extremes import Samples, largest

Array = NDArray[np.float64]
Index = NDArray[np.intp]
SIDE = np.linspace(-1.0, 1.0, 9)
ON_EDGE = 16
REACHED = 1e-6  # of a value, as promised


def on_circle(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


class Disc:
    """Functions of (x, y) over the unit disc, whose edge is a closed curve of length `length`."""

    def __init__(self, *functions: object, length: float = 5.0) -> None:
        self.functions, self.length = functions, length

    def __call__(self, curve: Index, place: Array, _of: Index) -> Samples:
        at = np.where(curve[:, None] < 0, place, on_circle(2.0 * np.pi * place[:, 0] / self.length))
        inside = (curve >= 0) | (np.hypot(*at.T) <= 1.0)
        return Samples(np.stack([function(*at.T) for function in self.functions]), inside, at)  # type: ignore[operator]

    def largest(self) -> tuple[Array, Array, Index]:
        found = largest(self, SIDE, SIDE, np.array([self.length]), ON_EDGE)
        return found.value, found.at, found.curve


@pytest.mark.parametrize("share", np.arange(0.3, 16.0, 0.75))
def test_a_top_on_the_edge_is_found_wherever_it_lies_between_samples(share: float) -> None:
    angle = 2.0 * np.pi * share / ON_EDGE
    top = on_circle(np.array(angle))

    def ridge(x: Array, y: Array) -> Array:
        return 2.0 + x * top[0] + y * top[1]  # largest on the disc's edge, at the top

    def sharp(x: Array, y: Array) -> Array:
        return np.exp(-4.0 * ((x - top[0]) ** 2 + (y - top[1]) ** 2))

    value, at, curve = Disc(ridge, sharp).largest()
    assert value == pytest.approx([3.0, 1.0], rel=REACHED)
    assert np.linalg.norm(at - top, axis=1).max() < 2e-3  # where a value is within 1e-6 of its top
    assert (curve == 0).all()


def test_a_top_inside_is_found_wherever_it_lies_between_nodes() -> None:
    chance = np.random.default_rng(4)
    for x0, y0 in chance.uniform(-0.6, 0.6, (25, 2)):
        value, at, curve = Disc(lambda x, y, x0=x0, y0=y0: 1.0 / (1.0 + 3.0 * (x - x0) ** 2 + (y - y0) ** 2)).largest()
        assert value == pytest.approx(1.0, rel=REACHED)
        assert np.abs(at[0] - [x0, y0]).max() < 2e-3
        assert curve[0] == -1


def test_the_higher_of_two_tops_is_found_though_the_lower_is_nearer_to_a_sample() -> None:
    def two(x: Array, y: Array) -> Array:
        low, high = 0.95 * np.exp(-6.0 * ((x - 0.5) ** 2 + y**2)), np.exp(-6.0 * ((x + 0.375) ** 2 + (y - 0.125) ** 2))
        return low + high

    dense = two(*np.meshgrid(np.linspace(-1.0, 1.0, 2001), np.linspace(-1.0, 1.0, 2001))).max()
    value, _, _ = Disc(two).largest()
    assert value[0] == pytest.approx(dense, rel=2.0 * REACHED)


def test_what_does_not_count_or_has_no_value_is_no_top() -> None:
    def hole(x: Array, y: Array) -> Array:
        return np.where(np.hypot(x, y) < 0.3, np.nan, 1.0 - np.hypot(x, y))

    value, at, _ = Disc(hole).largest()
    assert value[0] == pytest.approx(0.7, rel=0.02)  # approached from samples, not along the hole's own edge
    assert np.hypot(*at[0]) >= 0.3
    value, _, curve = Disc(lambda x, y: np.full_like(x, np.nan)).largest()
    assert np.isnan(value[0])
    assert curve[0] == -1


def test_of_several_curves_the_one_with_the_top_is_named() -> None:
    def evaluate(curve: Index, place: Array, _of: Index) -> Samples:
        radius = np.where(curve == 1, 0.5, 1.0)
        at = np.where(curve[:, None] < 0, place, radius[:, None] * on_circle(2.0 * np.pi * place[:, 0] / (3.0 + curve)))
        value = -((np.hypot(*at.T) - 0.5) ** 2) - 0.1 * (at[:, 0] - 0.3) ** 2 - 0.1 * (at[:, 1] - 0.4) ** 2
        return Samples(value[None] + 2.0, curve >= 0, at)

    found = largest(evaluate, SIDE, SIDE, np.array([3.0, 4.0]), ON_EDGE)
    assert found.value[0] == pytest.approx(2.0, rel=REACHED)
    assert found.curve[0] == 1
    assert 2.0 * np.pi * found.place[0, 0] / 4.0 == pytest.approx(np.arctan2(0.4, 0.3), abs=5e-3)


def test_of_equal_samples_the_first_is_the_best_of_its_group_and_those_that_do_not_count_change_it() -> None:
    which = np.array([0, 1, 0, 0, 1, 1, 2, 0])
    values = np.array([1.0, 5.0, 3.0, 3.0, 5.0, -2.0, np.nan, 9.0])
    counts = np.array([True, True, True, True, True, True, True, False])
    top, height, change = best_samples(which, values, counts, 3)
    assert top.tolist()[:2] == [2, 1]
    assert height.tolist() == [3.0, 5.0, -np.inf]
    assert change.tolist()[:2] == [8.0, 7.0]
