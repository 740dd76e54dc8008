"""Intervals on rows against a dumb list of points."""

from __future__ import annotations

import numpy as np
import pytest

from raytrace.visibility.intervals import IntervalSet

ROW = np.array([0, 0, 0, 2, 2])
LOW = np.array([0.0, 1.0, 3.0, 0.0, 1.5])
HIGH = np.array([1.0, 2.0, 4.0, 1.0, 2.0])


def as_list(spans: IntervalSet) -> list[tuple[int, float, float]]:
    return [(int(row), float(low), float(high)) for row, low, high in zip(spans.row, spans.low, spans.high, strict=True)]


@pytest.mark.parametrize(("apart", "expected"), [
    (0.0, [(0, 0.0, 2.0), (0, 3.0, 4.0), (2, 0.0, 1.0), (2, 1.5, 2.0)]),  # what touches is one
    (0.25, [(0, 0.0, 2.0), (0, 3.0, 4.0), (2, 0.0, 1.0), (2, 1.5, 2.0)]),
    (0.5, [(0, 0.0, 2.0), (0, 3.0, 4.0), (2, 0.0, 2.0)]),  # and what is just so far apart as said
    (1.0, [(0, 0.0, 4.0), (2, 0.0, 2.0)]),
    (9.0, [(0, 0.0, 4.0), (2, 0.0, 2.0)]),  # never across rows
])
def test_intervals_no_more_than_so_far_apart_become_one(apart: float, expected: list[tuple[int, float, float]]) -> None:
    assert as_list(IntervalSet.joined(ROW, LOW, HIGH, apart)) == expected


def test_no_intervals_are_joined_to_none() -> None:
    nothing = np.empty(0)
    assert as_list(IntervalSet.joined(np.empty(0, dtype=np.intp), nothing, nothing)) == []


def test_clipped_keeps_what_has_a_length() -> None:
    spans = IntervalSet(ROW, LOW, HIGH)
    assert as_list(spans.clipped(1.0, 3.5)) == [(0, 1.0, 2.0), (0, 3.0, 3.5), (2, 1.5, 2.0)]
    assert spans.clipped(1.0, 3.5).total == pytest.approx(2.0)
    assert spans.clipped(-1.0, np.array([0.5, 1.5, 1.0, 0.25, 2.0])).total == pytest.approx(0.5 + 0.5 + 0.25 + 0.5)


def test_a_mask_has_the_points_of_closed_intervals() -> None:
    places = np.arange(-1.0, 5.0, 0.25)
    found = IntervalSet(ROW, LOW, HIGH).mask(3, places)
    for row in range(3):
        for place, inside in zip(places, found[row], strict=True):
            assert inside == any(low <= place <= high for r, low, high in zip(ROW, LOW, HIGH, strict=True) if r == row)
