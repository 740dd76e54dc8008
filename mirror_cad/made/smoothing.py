"""The smooth surface that a measured mirror most likely has: the fitted spline, as rough as the noise lets one believe.

Least squares alone is right on the average and rough everywhere, most of all at the rim, where nothing holds it from one side.
Here λ·∫|∇³d|² is added, which leaves a changed radius or astigmatism alone, and λ is that of the least expected error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve, solve_triangular
from scipy.sparse import coo_array, kron

from mirror_cad.made.spline_fit import SplineFit, grams

Array = NDArray[np.float64]

DECADES = np.arange(-12.0, 4.0, 3.0)  # of λ over the ratio of the traces of both forms
FINE = (1.5, 0.75)  # decades to either side of the best
PROBES = 24  # random signs that a trace is told with
SEED = 1


def smoothed(fit: SplineFit, sigma_factor: float) -> SplineFit:
    """Add the roughness that minimises Mallows' Cp = χ²/s² + 2·tr(A), an unbiased estimate of the error of what is fitted.

    The covariance of what comes back is Bayes's: its intervals count the bias of smoothing on the average over the mirror.

    Parameters
    ----------
    fit : SplineFit
        By least squares.
    sigma_factor : float
        s, what the sigmas of the observations are to be multiplied with.

    References
    ----------
    P. Craven, G. Wahba, Smoothing noisy data with spline functions, Numer. Math. 31 (1979); D. Nychka, Bayesian confidence
    intervals for smoothing splines, J. Am. Stat. Assoc. 83 (1988).
    """
    rough = _roughness(fit)
    first = fit.coefficients.ravel()
    data = fit.normal.copy()
    data[fit.held.row, fit.held.col] -= fit.held.data
    probes = np.random.default_rng(SEED).choice([-1.0, 1.0], (first.size, PROBES))
    of_data = data @ probes
    unit = float(np.trace(fit.normal) / rough.trace())
    tried: dict[float, tuple[float, SplineFit]] = {}

    def attempt(decade: float) -> None:
        matrix = fit.normal.copy()
        weight = unit * 10.0**decade
        matrix[rough.row, rough.col] += weight * rough.data
        try:
            factor = cho_factor(matrix, lower=True, check_finite=False)
        except LinAlgError:  # so much roughness that rounding of it outweighs what was measured
            tried[decade] = np.inf, fit
            return
        coefficients = cho_solve(factor, fit.vector, check_finite=False)
        coefficients += cho_solve(factor, fit.vector - matrix @ coefficients, check_finite=False)
        off = coefficients - first
        chi2 = fit.chi2 + float(off @ (data @ off) - 2.0 * off @ (fit.held @ first))
        trace = float(np.mean(np.einsum("ij,ij->j", of_data, cho_solve(factor, probes, check_finite=False))))
        held = (fit.held + weight * rough).tocoo()
        tried[decade] = chi2 / sigma_factor**2 + 2.0 * trace, SplineFit(
            fit.space, coefficients.reshape(fit.coefficients.shape), chi2, fit.used, matrix, fit.vector, held, factor)
        for other in [each for each in tried if each != _best(tried)]:
            tried[other] = tried[other][0], fit  # one matrix is enough to hold
    for decade in (-np.inf, *DECADES):
        attempt(float(decade))
    for step in FINE:
        middle = _best(tried)
        for side in (-step, step):
            if np.isfinite(middle):
                attempt(middle + side)
    best = _best(tried)
    if tried[best][1] is fit and np.isfinite(tried[best][0]):
        attempt(best)
    return tried[best][1]


def drawn(fit: SplineFit, sigma_factor: float, rng: np.random.Generator) -> Array:
    """Coefficients of a surface that may be the real one: drawn from the fit's mean and covariance.

    Parameters
    ----------
    fit : SplineFit
        As `smoothed` gives it.
    sigma_factor : float
        What the sigmas of the observations are to be multiplied with.
    rng : numpy.random.Generator
        Draws.
    """
    normal = rng.standard_normal(fit.coefficients.size)
    away = solve_triangular(fit.factor[0], normal, lower=True, trans="T", check_finite=False)
    result: Array = fit.coefficients + sigma_factor * away.reshape(fit.coefficients.shape)
    return result


def _best(tried: dict[float, tuple[float, SplineFit]]) -> float:
    return min(tried, key=lambda decade: tried[decade][0])


def _roughness(fit: SplineFit) -> coo_array:
    """∫ d_xxx² + 3·d_xxy² + 3·d_xyy² + d_yyy² as a quadratic form of the coefficients."""
    gx, gy = grams(fit.space)
    return (kron(gx[3], gy[0]) + 3.0 * kron(gx[2], gy[1]) + 3.0 * kron(gx[1], gy[2]) + kron(gx[0], gy[3])).tocoo()
