"""Curvature of a spline over a gauge: exact for polynomials, as sure as theory says, and covered by its intervals."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirror_cad.made.gauge import at_points, disc, on_gauge
from mirror_cad.made.spline_fit import Combined, Observations, Space, fit_spline

Array = NDArray[np.float64]

BOX = (-115.0, 115.0, -170.0, 170.0)
GAUGE = 38.0
SPACE = Space(BOX, (25, 36))
SIGMA = 0.005


def grid(step: float) -> tuple[Array, Array]:
    x, y = np.meshgrid(np.arange(BOX[0], BOX[1] + 1e-9, step), np.arange(BOX[2], BOX[3] + 1e-9, step))
    return x.ravel(), y.ravel()


def places(inset: float) -> Array:
    x, y = np.meshgrid(np.linspace(BOX[0] + inset, BOX[1] - inset, 9), np.linspace(BOX[2] + inset, BOX[3] - inset, 11))
    return np.stack([x.ravel(), y.ravel()], axis=1)


def all_counted(at: Array) -> NDArray[np.bool_]:
    around = at[:, None] + disc(GAUGE)
    return (np.abs(around[..., 0]) <= BOX[1]) & (np.abs(around[..., 1]) <= BOX[3])


def test_quadratics_are_told_exactly_also_where_the_disc_is_cut() -> None:
    """Σ of weights times a quadratic is its own derivatives, for whole discs and for what an edge leaves of one."""
    x, y = grid(5.0)
    d = 2e-5 * x * x - 3e-5 * x * y + 1e-5 * y * y + 1e-3 * x
    fit = fit_spline(SPACE, Observations.of_heights(x, y, d, np.full(x.size, 1e-9)), (), 0.02)
    at = places(2.0)
    found = on_gauge(fit, at, GAUGE, all_counted(at)).values
    wanted = np.stack([4e-5 * at[:, 0] - 3e-5 * at[:, 1] + 1e-3, -3e-5 * at[:, 0] + 2e-5 * at[:, 1],
                       np.full(len(at), 4e-5), np.full(len(at), -3e-5), np.full(len(at), 2e-5)], axis=1)
    assert np.abs(found - wanted)[:, :2].max() < 1e-12
    assert np.abs(found - wanted)[:, 2:].max() < 1e-13  # 1/mm; what rounding of d by 1e-16 leaves over 19² mm²


def test_the_quadratic_over_a_disc_is_the_weighted_mean_of_second_derivatives() -> None:
    """Of cos(kx) it is −k²·cos(kx) times the transform of (1 − ρ²/R²)²: 48·J3(kR)/(kR)³ (derivations, made mirrors)."""
    from scipy.special import jv

    x, y = grid(2.5)
    k = 2.0 * np.pi / 70.0
    fit = fit_spline(Space(BOX, (34, 50)), Observations.of_heights(x, y, np.cos(k * x), np.full(x.size, 1e-9)), (), 0.02)
    at = np.array([[0.0, 0.0], [10.0, 20.0], [-35.0, 5.0]])
    found = on_gauge(fit, at, GAUGE, all_counted(at)).values[:, 2]
    argument = k * 0.5 * GAUGE
    wanted = -k * k * np.cos(k * at[:, 0]) * 48.0 * jv(3, argument) / argument**3
    # The disc is told by 177 samples of equal weight: their rim is ragged by a fifteenth of its width.
    assert found == pytest.approx(wanted, rel=0.02)


def test_noise_shows_in_curvature_as_least_squares_over_the_disc_says() -> None:
    """σ·√18·2/(r²·√n) for each second derivative, 2.1 % of r = 1200 mm: a spline that fits more than a disc is no worse."""
    x, y = grid(5.0)
    fit = fit_spline(SPACE, Observations.of_heights(x, y, np.zeros(x.size), np.full(x.size, SIGMA)), (), 0.02)
    at = places(25.0)
    sigma = np.sqrt(on_gauge(fit, at, GAUGE, all_counted(at)).covariances[:, 2, 2].mean())
    of_disc = SIGMA * np.sqrt(18.0) * 2.0 / (19.0**2 * np.sqrt(45.0))
    assert 0.7 * of_disc < sigma < of_disc
    assert 1200.0 * sigma < 0.021


@pytest.mark.parametrize("runs", [100, pytest.param(500, marks=pytest.mark.long)])
def test_the_stated_sigma_is_the_scatter_of_many_runs_and_intervals_cover(runs: int) -> None:
    """Scatter within 10 % of the stated sigma; of 95 % intervals 93 to 97 % hold the truth.

    All places together: the scatter of 500 runs at one place is itself known to 3 % only.
    """
    rng = np.random.default_rng(17)
    x, y = (each.ravel() for each in np.meshgrid(np.arange(-60.0, 61.0, 5.0), np.arange(-60.0, 61.0, 5.0)))
    space = Space((-60.0, 60.0, -60.0, 60.0), (13, 13))
    curved, sigmas = 1e-6 * x * x + 2e-6 * x * y, np.full(x.size, SIGMA)
    at = np.stack([each.ravel() for each in np.meshgrid(np.linspace(-40.0, 40.0, 5), np.linspace(-40.0, 40.0, 5))], axis=1)
    counted = np.ones((len(at), len(disc(GAUGE))), dtype=bool)
    gauge = on_gauge(fit_spline(space, Observations.of_heights(x, y, curved, sigmas), (), 0.02), at, GAUGE, counted)
    stated = np.sqrt(np.diagonal(gauge.covariances, axis1=1, axis2=2))
    drawn = []
    for _ in range(runs):
        noisy = Observations.of_heights(x, y, curved + SIGMA * rng.standard_normal(x.size), sigmas)
        drawn.append(on_gauge(fit_spline(space, noisy, (), 0.02), at, GAUGE, counted).values)
    errors = (np.array(drawn) - gauge.values) / stated
    assert np.abs(errors[..., 2:].std(axis=(0, 1)) - 1.0).max() < 0.1
    covered = (np.abs(errors[..., 2:]) < 1.959964).mean(axis=(0, 1))
    assert (covered > 0.93).all()
    assert (covered < 0.97).all()


def test_slopes_and_heights_together_are_better_than_each_alone() -> None:
    """The information of independent observations adds up."""
    x, y = grid(5.0)
    heights = Observations.of_heights(x, y, np.zeros(x.size), np.full(x.size, SIGMA))
    slopes = _slopes(x, y, 3e-4)
    at = places(25.0)
    sigmas = [np.sqrt(on_gauge(fit_spline(SPACE, each, (), 0.02), at, GAUGE, all_counted(at)).covariances[:, 2, 2])
              for each in (heights, slopes, heights.joined(slopes))]
    assert (sigmas[2] <= np.minimum(sigmas[0], sigmas[1]) * (1.0 + 1e-9)).all()
    # Of a disc of many points information is 1/σ²; the two do not see the very same waves, so it is not equality.
    assert np.median(sigmas[2]) == pytest.approx(np.median(1.0 / np.hypot(1.0 / sigmas[0], 1.0 / sigmas[1])), rel=0.15)


def test_a_combined_observation_counts_as_it_says() -> None:
    """The mean of two heights, very sure, is met."""
    x, y = grid(10.0)
    heights = Observations.of_heights(x, y, np.zeros(x.size), np.full(x.size, SIGMA))
    operators = np.zeros((2, 6))
    operators[:, 0] = 0.5
    mean = Combined(np.array([0.0, 3.0]), np.array([0.0, 3.0]), operators, 0.01, 1e-7)
    fit = fit_spline(SPACE, heights, [mean], 0.02)
    assert fit.heights(mean.x, mean.y).mean() == pytest.approx(0.01, abs=1e-6)


def test_where_nothing_was_measured_nothing_is_sure() -> None:
    """The sigma of a height in a hole is that of the prior, thousands of times the sigma of the points."""
    x, y = grid(5.0)
    kept = np.hypot(x, y) > 60.0
    x, y = x[kept], y[kept]
    fit = fit_spline(SPACE, Observations.of_heights(x, y, np.zeros(x.size), np.full(x.size, SIGMA)), (), 0.02)
    sigma = np.sqrt(at_points(fit, np.array([[0.0, 0.0], [100.0, 0.0]]))[1][:, 0, 0])
    assert sigma[0] > 100.0 * SIGMA
    assert sigma[1] < SIGMA


def _slopes(x: Array, y: Array, sigma: float) -> Observations:
    operators = np.zeros((2 * x.size, 6))
    operators[:x.size, 1], operators[x.size:, 2] = 1.0, 1.0
    zero = np.zeros(2 * x.size)
    return Observations(np.tile(x, 2), np.tile(y, 2), operators, zero, np.full(2 * x.size, sigma), np.ones(2 * x.size))
