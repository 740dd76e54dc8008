"""Slope and curvature of a spline over a gauge: what the least-squares quadratic over a disc has, with its covariance.

A curvature has no meaning without the length that it is told over. Here it is that of the quadratic

    q(X, Y) = z + p·X + q·Y + r·X²/2 + s·X·Y + t·Y²/2

which is nearest to d in the mean square over the disc of the gauge's diameter. That is the mean of d's second derivatives over
the disc, weighted with (1 − ρ²/R²)²; docs/derivations has the proof.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mirror_cad.made.spline_fit import DEGREE, SplineFit
from mirror_cad.surfaces.basis import basis_functions

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ACROSS = 15  # sample points across the disc
PLACES_AT_ONCE = 400
# Of the quadratic's normal matrix, smallest to largest eigenvalue in units of the radius: below it what is left of a disc at
# an edge does not tell all six.
MIN_CONDITION = 1e-5


class GaugeValues(NamedTuple):
    """What a gauge tells of d at m places.

    values : (m, 5), d_x, d_y, d_xx, d_xy, d_yy; NaN where what is left of the disc does not tell them.
    covariances : (m, 5, 5), for the sigmas of the observations.
    """

    values: Array
    covariances: Array


def disc(diameter_mm: float) -> Array:
    """Sample points of a disc about the origin, (n, 2) mm, each of one area."""
    step = 2.0 / ACROSS
    line = -1.0 + step * (np.arange(ACROSS) + 0.5)
    x, y = (each.ravel() for each in np.meshgrid(line, line, indexing="ij"))
    kept = x * x + y * y <= 1.0
    return 0.5 * diameter_mm * np.stack([x[kept], y[kept]], axis=1)


def on_gauge(fit: SplineFit, places: Array, diameter_mm: float, counted: Mask) -> GaugeValues:
    """Slope and curvature over a gauge.

    Parameters
    ----------
    fit : SplineFit
        d.
    places : ndarray
        (m, 2), mm, in the spline's box.
    diameter_mm : float
        Of the gauge.
    counted : ndarray
        (m, n), which of the `disc`'s points about each place count.
    """
    offsets = disc(diameter_mm)
    rows = _quadratic_rows(offsets, 0.5 * diameter_mm)
    values, covariances = np.full((len(places), 5), np.nan), np.full((len(places), 5, 5), np.nan)
    whole = counted.all(axis=1)
    weights = np.broadcast_to(rows, (len(places), *rows.shape)).copy()
    told = np.ones(len(places), dtype=bool)
    for k in np.flatnonzero(~whole):
        found = _quadratic_rows_of_part(offsets, 0.5 * diameter_mm, counted[k])
        told[k] = found is not None
        if found is not None:
            weights[k] = found
    at = np.flatnonzero(told)
    for start in range(0, at.size, PLACES_AT_ONCE):
        part = at[start: start + PLACES_AT_ONCE]
        values[part], covariances[part] = _functionals(fit, places[part], offsets, weights[part])
    return GaugeValues(values, covariances)


def at_points(fit: SplineFit, places: Array) -> tuple[Array, Array]:
    """d, d_x and d_y at places themselves, (m, 3), and their covariances, (m, 3, 3), for the sigmas of the observations.

    Parameters
    ----------
    fit : SplineFit
        d.
    places : ndarray
        (m, 2), mm, in the spline's box.
    """
    knots_x, knots_y = fit.space.knots
    first_x, bx = basis_functions(knots_x, DEGREE, places[:, 0], 1)
    first_y, by = basis_functions(knots_y, DEGREE, places[:, 1], 1)
    patches = np.stack([bx[:, a, :, None] * by[:, b, None, :] for a, b in ((0, 0), (1, 0), (0, 1))], axis=1)
    found: tuple[Array, Array] = _propagated(patches, np.stack([first_x, first_y], axis=1), fit.coefficients, fit.covariance)
    return found


def _functionals(fit: SplineFit, places: Array, offsets: Array, weights: Array) -> tuple[Array, Array]:
    """Values (m, k) and covariances (m, k, k) of Σ_q weights[m, k, q]·d(place + offset_q)."""
    knots_x, knots_y = fit.space.knots
    x_min, x_max, y_min, y_max = fit.space.box
    x = np.clip(places[:, :1] + offsets[:, 0], x_min, x_max)  # points beyond weigh nothing
    y = np.clip(places[:, 1:] + offsets[:, 1], y_min, y_max)
    first_x, bx = basis_functions(knots_x, DEGREE, x.ravel(), 0)
    first_y, by = basis_functions(knots_y, DEGREE, y.ravel(), 0)
    first_x, first_y = first_x.reshape(x.shape), first_y.reshape(x.shape)
    low = np.stack([first_x.min(axis=1), first_y.min(axis=1)], axis=1)
    wide = int((first_x.max(axis=1) - low[:, 0]).max()) + DEGREE + 1, int((first_y.max(axis=1) - low[:, 1]).max()) + DEGREE + 1
    low = np.minimum(low, np.array(fit.space.shape) - wide)
    patches = _patches(first_x, bx[:, 0].reshape(*x.shape, -1), first_y, by[:, 0].reshape(*x.shape, -1), weights, low, *wide)
    return _propagated(patches, low, fit.coefficients, fit.covariance)


def _moments(offsets: Array, radius: float) -> Array:
    x, y = offsets.T / radius
    return np.stack([np.ones_like(x), x, y, 0.5 * x * x, x * y, 0.5 * y * y], axis=1)


def _scales(radius: float) -> Array:
    return np.array([1.0, 1.0 / radius, 1.0 / radius, *(1.0 / radius**2,) * 3])


def _quadratic_rows(offsets: Array, radius: float) -> Array:
    """(5, n): the weights of d's values that give d_x … d_yy of the quadratic."""
    rows: Array = np.linalg.pinv(_moments(offsets, radius)) * _scales(radius)[:, None]
    return rows[1:]


def _quadratic_rows_of_part(offsets: Array, radius: float, counted: Mask) -> Array | None:
    a = _moments(offsets[counted], radius)
    if len(a) < 6:
        return None
    normal = a.T @ a / len(a)
    eigenvalues = np.linalg.eigvalsh(normal)
    if eigenvalues[0] < MIN_CONDITION * eigenvalues[-1]:
        return None
    rows = np.zeros((6, len(offsets)))
    rows[:, counted] = np.linalg.solve(normal, a.T / len(a)) * _scales(radius)[:, None]
    return rows[1:]


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba's are
def _patches(first_x: NDArray[np.int64], bx: Array, first_y: NDArray[np.int64], by: Array, weights: Array,
             low: NDArray[np.int64], wide_x: int, wide_y: int) -> Array:
    count, kinds = weights.shape[0], weights.shape[1]
    patches = np.zeros((count, kinds, wide_x, wide_y))
    for m in range(count):
        for q in range(weights.shape[2]):
            i0, j0 = first_x[m, q] - low[m, 0], first_y[m, q] - low[m, 1]
            for k in range(kinds):
                w = weights[m, k, q]
                if w == 0.0:
                    continue
                for i in range(bx.shape[2]):
                    wx = w * bx[m, q, i]
                    for j in range(by.shape[2]):
                        patches[m, k, i0 + i, j0 + j] += wx * by[m, q, j]
    return patches


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _propagated(patches: Array, low: NDArray[np.int64], coefficients: Array, covariance: Array) -> tuple[Array, Array]:
    count, kinds, wide_x, wide_y = patches.shape
    columns = coefficients.shape[1]
    values, covariances = np.zeros((count, kinds)), np.zeros((count, kinds, kinds))
    index, through = np.empty(wide_x * wide_y, dtype=np.int64), np.empty((kinds, wide_x * wide_y))
    for m in range(count):
        for i in range(wide_x):
            for j in range(wide_y):
                index[i * wide_y + j] = (low[m, 0] + i) * columns + low[m, 1] + j
                for k in range(kinds):
                    values[m, k] += patches[m, k, i, j] * coefficients[low[m, 0] + i, low[m, 1] + j]
        flat = patches[m].reshape(kinds, wide_x * wide_y)
        through[:] = 0.0
        for a in range(index.size):
            for b in range(index.size):
                shared = covariance[index[a], index[b]]
                for k in range(kinds):
                    through[k, a] += shared * flat[k, b]
        for k in range(kinds):
            for n in range(kinds):
                total = 0.0
                for a in range(index.size):
                    total += flat[n, a] * through[k, a]
                covariances[m, k, n] = total
    return values, covariances
