"""What a fit is judged by, and how spans are laid among breaks."""

from __future__ import annotations

import numpy as np
import pytest

from mirror_cad.surfaces.differential import ShapeOperator
from mirror_cad.surfaces.faithful import spans_with_margin
from mirror_cad.surfaces.fit import curvature_percent
from mirror_cad.surfaces.spans import span_ends
from tests.conftest import constant, spec_of
from tests.test_faithful import faithful


def operator(k1: float, k2: float) -> ShapeOperator:
    return ShapeOperator(np.array([k2]), np.array([k1]), np.zeros(1))


@pytest.mark.parametrize(("k1", "k2", "percent"), [
    (2e-3 * 1.01, 1e-3, 1.0), (2e-3, 1e-3 * 0.98, 2.0), (2e-3 * 1.03, 1e-3 * 1.01, 3.0), (2e-3 * 0.99, 1e-3 * 1.03, 3.0),
])
def test_a_curvature_is_off_by_the_larger_share_of_the_two_each_of_its_own(k1: float, k2: float, percent: float) -> None:
    found = curvature_percent(operator(k1, k2), operator(2e-3, 1e-3), np.array([[2e-3, 1e-3]]))
    assert found is not None
    assert found[0] == pytest.approx(percent, rel=1e-12)
    assert curvature_percent(operator(k1, k2), operator(0.0, 0.0), np.zeros((1, 2))) is None


@pytest.mark.parametrize("count", [1, 4, 5, 12])
def test_spans_are_at_least_as_many_as_asked_for_end_at_the_breaks_and_are_even_between_them(count: int) -> None:
    ends = span_ends(-115.0, 115.0, [(-30.0, 2), (20.0, 0), (50.0, 7)], 5, count)
    assert {-115.0, -30.0, 20.0, 115.0} <= set(ends.tolist())  # the third is as smooth as the spline
    assert len(ends) - 1 == max(count, 3)
    widths = np.diff(ends)
    for low, high in ((-115.0, -30.0), (-30.0, 20.0), (20.0, 115.0)):
        inside = widths[(ends[:-1] >= low) & (ends[:-1] < high)]
        assert inside == pytest.approx(inside[0])
    # No span could be cut and another joined so that the widest became narrower.
    assert widths.max() <= 2.0 * widths.min() * (1.0 + 1e-12) or count < 5


def test_spans_beyond_the_mirror_grow_to_the_sheets_edge() -> None:
    ends = spans_with_margin((-400.0, 130.0), (-115.0, 115.0), [], 5, 10)
    assert ends[0] == -400.0
    assert ends[-1] == 130.0
    widths = np.diff(ends)
    inner = (ends[:-1] >= -115.0) & (ends[1:] <= 115.0)
    assert widths[inner] == pytest.approx(23.0)
    beyond = widths[ends[1:] <= -115.0][::-1]
    assert beyond[0] == pytest.approx(46.0)
    assert (np.diff(beyond)[:-1] > 0.0).all()


def test_levels_of_the_faithful_method_say_the_spans_of_the_sheet() -> None:
    mirror = faithful(spec_of({"law": "linear", "right_mm": 1250.0, "left_mm": 900.0}, constant(1250.0)), spans=(8, 6))
    assert mirror.faithful is not None
    (level,) = mirror.faithful.levels
    assert level.spans == (len(set(mirror.surface.knots_u)) - 1, len(set(mirror.surface.knots_v)) - 1)
    assert min(level.spans[0] - 8, level.spans[1] - 6) == 2  # one beyond each edge
