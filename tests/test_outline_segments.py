"""What is true of lines, arcs and splines."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mirror_cad.errors import OutlineError
from mirror_cad.outline import Arc, Line, Spline, arc_between
from tests.outline_helpers import SEGMENTS, wavy_spline


@pytest.mark.parametrize("segment", SEGMENTS, ids=lambda s: type(s).__name__)
def test_a_segment_runs_from_its_start_to_its_end_and_reversed_runs_back(segment):
    s = np.linspace(0, 1, 101).reshape(-1, 1)
    points = segment.point(s)
    assert points.shape == (101, 1, 2)
    np.testing.assert_allclose(points[0, 0], segment.start, atol=1e-12)
    np.testing.assert_allclose(points[-1, 0], segment.end, atol=1e-12)
    np.testing.assert_allclose(segment.reversed().point(1 - s), points, atol=1e-12)
    np.testing.assert_allclose(segment.moved(3, -4).point(s), points + [3, -4], atol=1e-12)


@pytest.mark.parametrize("segment", SEGMENTS, ids=lambda s: type(s).__name__)
def test_bounds_hold_every_point_and_are_reached(segment):
    points = segment.point(np.linspace(0, 1, 200_001))
    dense = np.array([points[:, 0].min(), points[:, 0].max(), points[:, 1].min(), points[:, 1].max()])
    excess = (np.array(segment.bounds()) - dense) * [-1, 1, -1, 1]
    assert (excess > -1e-12).all()
    assert (excess < 1e-6).all()


@given(st.integers(1, 9), st.integers(0, 2**32 - 1), st.booleans())
@settings(deadline=None, max_examples=40)
def test_bounds_of_splines_of_any_degree_hold_every_point_and_are_reached(degree, seed, rational):
    rng = np.random.default_rng(seed)
    count = degree + 1 + rng.integers(0, 5)
    # Evenly spread knots: between crowded ones a curve turns more sharply than the points below can follow.
    inner = np.linspace(0, 1, count - degree + 1)[1:-1]
    knots = np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])
    weights = rng.uniform(0.2, 5, count) if rational else None
    spline = Spline(degree, knots, rng.uniform(-100, 100, (count, 2)), weights)
    points = spline.point(np.sort(np.append(rng.uniform(0, 1, 5_000), knots)))
    dense = np.array([points[:, 0].min(), points[:, 0].max(), points[:, 1].min(), points[:, 1].max()])
    excess = (np.array(spline.bounds()) - dense) * [-1, 1, -1, 1]
    assert (excess > -1e-11).all()
    assert (excess < 0.05).all()


@pytest.mark.parametrize("tolerance", [1.0, 1e-2, 1e-4])
@pytest.mark.parametrize("segment", SEGMENTS, ids=lambda s: type(s).__name__)
def test_samples_stay_within_the_chord_tolerance(segment, tolerance):
    samples = segment.samples(tolerance)
    assert tuple(samples[0]) == segment.start
    assert tuple(samples[-1]) == segment.end
    points = segment.point(np.linspace(0, 1, 301))
    direction = np.diff(samples, axis=0)
    worst = 0.0
    for point in points:
        offset = point - samples[:-1]
        along = np.clip((offset * direction).sum(-1) / (direction**2).sum(-1), 0, 1)
        worst = max(worst, np.hypot(*(offset - along[:, None] * direction).T).min())
    assert worst <= tolerance * 1.001


def test_an_arc_of_three_quarters_is_bounded_by_its_quadrant_points():
    assert Arc((10, 20), 5, -math.pi / 4, 1.5 * math.pi).bounds() == pytest.approx(
        (5, 15, 20 - 5 * math.sqrt(0.5), 25), abs=1e-14
    )


def test_an_arc_between_two_points_has_the_sweep_and_the_ends_asked_for():
    for sweep in (-6.0, -math.pi, -0.1, 1e-3, 1.0, math.pi, 5.5):
        arc = arc_between((3, 4), (-7, 12), sweep)
        assert arc.sweep == sweep
        np.testing.assert_allclose([arc.start, arc.end], [(3, 4), (-7, 12)], atol=1e-10)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Line((0, math.nan), (1, 1)), "finite"),
        (lambda: Line((0, 0, 0), (1, 1)), "two finite numbers"),
        (lambda: Arc((0, 0), 0.0, 0, 1), "not above 0"),
        (lambda: Arc((0, 0), math.inf, 0, 1), "finite"),
        (lambda: Arc((0, 0), 1, 0, 7), "full turn"),
        (lambda: Arc((0, 0), 1, 0, 0), "must not be 0"),
        (lambda: Spline(0, np.zeros(2), np.zeros((2, 2))), "degree"),
        (lambda: Spline(2, np.zeros(5), np.zeros((2, 2))), "poles"),
        (lambda: Spline(1, np.array([0, 0, 1]), np.zeros((2, 2))), "knots"),
        (lambda: Spline(1, np.array([0, 0, 1, 1]), np.full((2, 2), np.nan)), "finite"),
        (lambda: Spline(1, np.array([0, 0, -1, -1]), np.zeros((2, 2))), "decrease"),
        (lambda: Spline(1, np.array([0, 0.5, 1, 1]), np.zeros((2, 2))), "clamped"),
        (lambda: Spline(1, np.array([0, 0, 0.5, 0.5, 1, 1]), np.zeros((4, 2))), "broken"),
        (lambda: Spline(1, np.array([0, 0, 1, 1]), np.zeros((2, 2)), np.array([1, 0])), "weights"),
        (lambda: Spline(1, np.array([0, 0, 1, 1]), np.ones((2, 2)), np.array([1, 1e-13])), "factor"),
        (lambda: Spline(1, np.array([0, 0, 1e-300, 1, 1]), np.ones((3, 2))), "differ"),
        (lambda: Spline(1, np.array([0, 0, 1e-300, 1e-300]), np.ones((2, 2))), "span"),
        (lambda: Spline(1, np.array([0, 0, 1, 1]), np.full((2, 2), 1e300)), "finite"),
        (lambda: Spline(26, np.repeat([0, 1], 27), np.ones((27, 2))), "degree"),
        (lambda: arc_between((0, 0), (0, 0), 1.0), "no arc"),
        (lambda: Line((0, 0), (1, 1)).samples(0), "tolerance"),
        (lambda: wavy_spline().samples(-1), "tolerance"),
        (lambda: Arc((0, 0), 1e5, 0, 6).samples(1e-12), "edges"),
    ],
)
def test_a_segment_that_is_not_one_is_refused(make, said):
    with pytest.raises(OutlineError, match=said):
        make()


@pytest.mark.parametrize("edges", [1, 2, 7, 50])
def test_an_arc_gets_as_few_edges_as_the_tolerance_allows(edges):
    arc = Arc((3.0, -2.0), 40.0, 0.3, -0.6)
    exact = 40.0 * (1.0 - math.cos(0.6 / edges / 2.0))  # of a chord over that share of the arc
    assert len(arc.samples(exact * (1.0 + 1e-6))) == edges + 1
    assert len(arc.samples(exact * (1.0 - 1e-6))) == edges + 2


def test_a_spline_is_not_broken_into_more_edges_than_the_limit(monkeypatch):
    monkeypatch.setattr("mirror_cad.outline.spline.MAXIMUM_EDGES", 1000)
    assert len(wavy_spline().samples(1e-2)) < 1000
    with pytest.raises(OutlineError, match="more than 1000 edges"):
        wavy_spline().samples(1e-8)
