"""Trimming loops as the kernels take them: vertices as high as a point, and what is known to be inside without a look."""

from __future__ import annotations

import numpy as np
import pytest

from raytrace.surfaces.trimming import Trimming

# Vertices at whole heights, where an edge ends and the next one goes on, or turns back.
SAW = np.array([[0, 0], [4, 0], [3, 1], [4, 2], [3, 3], [1, 4], [0, 3], [1, 2], [0, 1]], dtype=np.float64)


def is_inside(loop: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """By the turns of the directions to the vertices: 2π all round a point inside, which lies on no edge."""
    z = (loop[:, 0] - u[:, None]) + 1j * (loop[:, 1] - v[:, None])
    return np.abs(np.angle(np.roll(z, -1, axis=1) / z).sum(axis=1)) > np.pi


def test_a_vertex_as_high_as_a_point_counts_once() -> None:
    trimming = Trimming.of((SAW,))
    for v in np.arange(1.0, 4.0):
        u = np.arange(-0.9, 5.0, 0.25)
        np.testing.assert_array_equal(trimming.contains(u, np.full_like(u, v)), is_inside(SAW, u, np.full_like(u, v)), str(v))


def test_nothing_is_inside_just_below_the_first_strip_nor_above_the_last() -> None:
    trimming = Trimming.of((SAW,), 24)
    low, high, height = *trimming.box[2:], 1.0 / trimming.strips.inverse_height
    u = np.linspace(-1.0, 5.0, 301)
    assert trimming.contains(u, np.full_like(u, low + 0.01 * height)).any()
    for v in (low - 0.5 * height, np.nextafter(low, -np.inf), np.nextafter(high, np.inf), high + 0.5 * height, np.nan):
        assert not trimming.contains(u, np.full_like(u, v)).any(), v


@pytest.mark.parametrize(("strips", "least"), [(2048, 0.5), (24, 0.1)])
@pytest.mark.parametrize("seed", range(8))
def test_all_of_an_interior_span_is_inside(seed: int, strips: int, least: float) -> None:
    """Loops of long spikes, whose edges lie in many strips, or many in one, over and beside each other."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 40))
    radius = rng.uniform(1.0, 10.0, 40)
    star = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    hole = 0.9 * np.array([[0.3, 0.0], [0.0, 0.4], [-0.3, 0.0]])
    found = Trimming.of((star, hole), strips).strips
    known = 0
    for k, (left, right) in enumerate(found.interior):
        if not left < right:
            continue
        known += 1
        u = np.linspace(left, right, 203)[1:-1]
        for share in (0.001, 0.25, 0.5, 0.75, 0.999):
            v = np.full_like(u, found.low + (k + share) / found.inverse_height)
            assert (is_inside(star, u, v) & ~is_inside(hole, u, v)).all(), (k, share)
    assert known > least * strips
