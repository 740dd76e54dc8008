"""Outlines of intervals on lines, and the longest rectangle in them, against what is known of a few by hand."""

from __future__ import annotations

import numpy as np
import pytest

from raytrace.kernels.outlines import longest_rectangle, outlines

LINES = 10.0 * np.arange(6.0)


def polygons(*intervals: tuple[int, float, float]) -> list[list[tuple[float, float]]]:
    row, low, high = (np.array(each) for each in zip(*intervals, strict=True))
    return [[tuple(point) for point in polygon] for polygon in outlines(row.astype(np.intp), low, high, LINES)]


def test_one_that_becomes_two_and_these_one_again_is_parted_at_their_middles() -> None:
    found = polygons((0, 0.0, 10.0), (1, 0.0, 10.0), (2, 1.0, 3.0), (2, 7.0, 9.0), (3, 2.0, 8.0), (4, 2.0, 8.0))
    assert sorted(found) == sorted([
        [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)],
        [(10.0, 0.0), (20.0, 1.0), (30.0, 2.0), (30.0, 5.0), (20.0, 3.0), (10.0, 5.0)],
        [(10.0, 5.0), (20.0, 7.0), (30.0, 5.0), (30.0, 8.0), (20.0, 9.0), (10.0, 10.0)],
        [(30.0, 2.0), (40.0, 2.0), (40.0, 8.0), (30.0, 8.0)]])


def test_what_only_touches_or_has_a_line_without_any_between_is_not_one() -> None:
    first = [(0.0, 0.0), (10.0, 0.0), (10.0, 2.0), (0.0, 2.0)]
    touching = polygons((0, 0.0, 2.0), (1, 0.0, 2.0), (2, 2.0, 4.0), (3, 2.0, 4.0))
    assert sorted(touching) == [first, [(20.0, 2.0), (30.0, 2.0), (30.0, 4.0), (20.0, 4.0)]]
    assert len(polygons((0, 2.0, 4.0), (1, 2.0, 4.0), (2, 0.0, 2.0), (3, 0.0, 2.0))) == 2
    parted = polygons((0, 0.0, 2.0), (1, 0.0, 2.0), (3, 0.0, 2.0), (4, 0.0, 2.0))
    assert sorted(parted) == [first, [(30.0, 0.0), (40.0, 0.0), (40.0, 2.0), (30.0, 2.0)]]


@pytest.mark.parametrize(("start", "width", "expected"), [
    (2.0, 3.0, 50.0),  # inside on every line
    (1.0, 3.0, 35.0),  # its low end stands out from line 40 on: half-way between 30, where there is 1 mm, and 40
    (2.0, 6.0, 35.0),  # and its high end, of which line 40 has 1 mm too little and line 30 has 1 mm left
    (4.0, 6.0, 0.0),
])
def test_the_longest_rectangle_ends_where_its_tighter_end_does(start: float, width: float, expected: float) -> None:
    low = np.array([0.0, 0.0, 0.0, 0.0, 2.0, 2.0])
    high = np.array([9.0, 9.0, 9.0, 9.0, 7.0, 7.0])
    found = longest_rectangle(np.arange(6), low, high, LINES, -5.0, 20.0, np.array([start]), width)
    assert found == pytest.approx(expected, abs=1e-12)


def test_a_lane_s_edge_bounds_nothing() -> None:
    """A car that touches it is inside, and where the interval leaves it, its end is as if it were far away."""
    low, high = np.full(6, 0.0), np.array([9.0, 9.0, 9.0, 9.0, 5.0, 5.0])
    at_edges = longest_rectangle(np.arange(6), low, high, LINES, 0.0, 9.0, np.array([0.0]), 9.0)
    assert at_edges == 30.0  # no end between lines is known, of one at which nothing ends
    for lane, expected in ((20.0, 35.0), (9.0, 30.0)):
        found = longest_rectangle(np.arange(6), low, high, LINES, 0.0, lane, np.array([0.0]), 7.0)
        assert found == pytest.approx(expected, abs=1e-12)
