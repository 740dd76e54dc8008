"""One least squares for a B-spline over (x, y) from heights, slopes, curvatures and readings, with its covariance.

d(x, y) = Σ c_ij·B_i(x)·B_j(y) is fitted to observations that are linear in d: each is m·(d, d_x, d_y, d_xx, d_xy, d_yy) at a
point, or a sum of such. What no observation tells is held by the thin-plate energy with a weight that leaves all others alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.linalg.lapack import dpotri
from scipy.sparse import coo_array, kron

from mirror_cad.errors import SurfaceError
from mirror_cad.sections import SagDerivatives
from mirror_cad.surfaces.basis import basis_functions, dense_basis

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

DEGREE = 5
TERMS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # orders of derivation by x and y that an operator weighs
CHUNK = 50_000  # observations whose basis functions are held at once
# The energy's weight beside the data's, relative, below which rounding would decide what no observation tells.
MIN_ENERGY = 1e-11
# Height and tilt, which have no energy: one observation 0 ± these of the whole, for points on a line, or slopes alone.
PRIOR_HEIGHT, PRIOR_SLOPE = 0.1, 0.1


class Space(NamedTuple):
    """Tensor splines of degree DEGREE on equal spans over a box.

    box : (x_min, x_max, y_min, y_max), mm.   spans : along x and y.
    """

    box: Box
    spans: tuple[int, int]

    @property
    def knots(self) -> tuple[Array, Array]:
        """Clamped, along x and y."""
        x_min, x_max, y_min, y_max = self.box
        return _uniform(x_min, x_max, self.spans[0]), _uniform(y_min, y_max, self.spans[1])

    @property
    def shape(self) -> tuple[int, int]:
        """Of the coefficients."""
        return self.spans[0] + DEGREE, self.spans[1] + DEGREE

    @property
    def span_mm(self) -> tuple[float, float]:
        """The length of a span along x and y."""
        return (self.box[1] - self.box[0]) / self.spans[0], (self.box[3] - self.box[2]) / self.spans[1]


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """What was measured of d at n points.

    Attributes
    ----------
    x, y : ndarray
        (n,), mm.
    operators : ndarray
        (n, 6): what is observed is their product with (d, d_x, d_y, d_xx, d_xy, d_yy).
    values, sigmas : ndarray
        (n,), of the observations, in their own unit.
    weights : ndarray
        (n,), 0 to 1: what robust fitting leaves of each.
    """

    x: Array
    y: Array
    operators: Array
    values: Array
    sigmas: Array
    weights: Array

    @staticmethod
    def of_heights(x: Array, y: Array, values: Array, sigmas: Array, weights: Array | None = None) -> Observations:
        """d itself.

        Parameters
        ----------
        x, y, values, sigmas, weights
            (n,); all weights 1 without them.
        """
        operators = np.zeros((x.size, 6))
        operators[:, 0] = 1.0
        return Observations(x, y, operators, values, sigmas, np.ones(x.size) if weights is None else weights)

    def joined(self, other: Observations) -> Observations:
        """These and others."""
        return Observations(*(np.concatenate([getattr(each, name) for each in (self, other)])
                              for name in ("x", "y", "operators", "values", "sigmas", "weights")))


class Combined(NamedTuple):
    """An observation of d at several points at once: Σ operators·(d, d_x, …) = value.

    x, y : (k,), mm.   operators : (k, 6).
    """

    x: Array
    y: Array
    operators: Array
    value: float
    sigma: float


@dataclass(frozen=True, eq=False)
class SplineFit:
    """d, and how well it is known.

    Attributes
    ----------
    space : Space
        Of d.
    coefficients : ndarray
        c, (n_x, n_y), mm.
    chi2, used : float, int
        Σ weight·(residual/sigma)², and how many observations count.
    normal, vector, held, factor
        N + E, b with (N + E)·c = b, E, what of it is not the observations', and the Cholesky factor of N + E.
    """

    space: Space
    coefficients: Array
    chi2: float
    used: int
    normal: Array = field(repr=False)
    vector: Array = field(repr=False)
    held: coo_array = field(repr=False)
    factor: tuple[Array, bool] = field(repr=False)

    @cached_property
    def covariance(self) -> Array:
        """Of the coefficients in C order, (n, n), mm²; as the sigmas of the observations have it."""
        inverse, info = dpotri(self.factor[0], lower=self.factor[1])
        if info:
            raise SurfaceError(f"the covariance of {len(inverse)} coefficients cannot be had")
        half = np.tril(inverse, -1)  # the other half of LAPACK's is what was there before
        half = half + half.T
        np.fill_diagonal(half, np.diag(inverse))
        return half

    @cached_property
    def determined(self) -> float:
        """How many coefficients the observations determine: n − tr(C·E), E being what they have no part in of the matrix."""
        return self.coefficients.size - float(self.covariance[self.held.row, self.held.col] @ self.held.data)

    @property
    def scale(self) -> float:
        """√(χ²/(n − p)): the residuals over what the sigmas let expect; NaN without redundancy."""
        free = self.used - self.determined
        return float(np.sqrt(self.chi2 / free)) if free > 0.5 else float("nan")

    def derivatives(self, x: Array, y: Array) -> SagDerivatives:
        """d, d_x, d_y, d_xx, d_xy, d_yy at points in the box.

        Parameters
        ----------
        x, y : ndarray
            (n,), mm.
        """
        values = [np.empty(x.size) for _ in TERMS]
        knots_x, knots_y = self.space.knots
        for start in range(0, x.size, CHUNK):
            part = slice(start, start + CHUNK)
            first_x, bx = basis_functions(knots_x, DEGREE, x[part], 2)
            first_y, by = basis_functions(knots_y, DEGREE, y[part], 2)
            for value, (a, b) in zip(values, TERMS, strict=True):
                value[part] = _evaluated(first_x, bx, first_y, by, a, b, self.coefficients)
        z, zx, zy, zxx, zxy, zyy = values
        return SagDerivatives(z, zx, zy, zxx, zxy, zyy)

    def heights(self, x: Array, y: Array) -> Array:
        """d alone, (n,) mm.

        Parameters
        ----------
        x, y : ndarray
            (n,), mm.
        """
        result = np.empty(x.size)
        knots_x, knots_y = self.space.knots
        for start in range(0, x.size, CHUNK):
            part = slice(start, start + CHUNK)
            first_x, bx = basis_functions(knots_x, DEGREE, x[part], 0)
            first_y, by = basis_functions(knots_y, DEGREE, y[part], 0)
            result[part] = _evaluated(first_x, bx, first_y, by, 0, 0, self.coefficients)
        return result


def fit_spline(space: Space, observations: Observations, combined: Sequence[Combined], prior_curvature: float) -> SplineFit:
    """Fit d by least squares.

    Parameters
    ----------
    space : Space
        In whose box all points lie.
    observations, combined
        What was measured.
    prior_curvature : float
        How large second derivatives of d are where nothing was measured, 1/mm: the energy counts as one observation
        0 ± prior_curvature of each of them a span. Chosen large, it leaves alone what was measured.

    Raises
    ------
    SurfaceError
        Where the observations and the energy leave the fit undetermined.
    """
    nx, ny = space.shape
    stencil, right = np.zeros((nx, ny, DEGREE + 1, 2 * DEGREE + 1)), np.zeros((nx, ny))
    knots_x, knots_y = space.knots
    weights = observations.weights / observations.sigmas**2
    order = 2 if observations.operators[:, 3:].any() else 1 if observations.operators[:, 1:3].any() else 0
    for start in range(0, observations.x.size, CHUNK):
        part = slice(start, start + CHUNK)
        first_x, bx = basis_functions(knots_x, DEGREE, observations.x[part], order)
        first_y, by = basis_functions(knots_y, DEGREE, observations.y[part], order)
        _accumulate(first_x, bx, first_y, by, observations.operators[part], observations.values[part], weights[part],
                    stencil, right)
    data = _dense(stencil)
    vector = right.ravel()
    for each in combined:
        row = combined_row(space, each)
        data += np.outer(row, row) / each.sigma**2
        vector += row * each.value / each.sigma**2
    held = _prior(space, float(np.trace(data)), prior_curvature)
    data[held.row, held.col] += held.data
    try:
        fit = _solved(space, data, vector, held)
    except LinAlgError:
        raise SurfaceError(f"{observations.x.size} observations do not determine a surface of {nx} × {ny} "
                           "coefficients") from None
    chi2 = float(weights @ (observations.values - predicted(fit, observations)) ** 2) if observations.x.size else 0.0
    c = fit.coefficients.ravel()
    chi2 += sum(((each.value - float(combined_row(space, each) @ c)) / each.sigma) ** 2 for each in combined)
    used = int((observations.weights > 0.0).sum()) + len(combined)
    return replace(fit, chi2=chi2, used=used)


def with_sigmas(fit: SplineFit, factor: float, prior_curvature: float) -> SplineFit:
    """The fit of the same observations with all their sigmas multiplied.

    Parameters
    ----------
    fit : SplineFit
        With their sigmas as they were.
    factor : float
        Above 0.
    prior_curvature : float
        As for `fit_spline`.
    """
    data = fit.normal.copy()
    data[fit.held.row, fit.held.col] -= fit.held.data
    data /= factor**2
    held = _prior(fit.space, float(np.trace(data)), prior_curvature)
    data[held.row, held.col] += held.data
    return replace(_solved(fit.space, data, fit.vector / factor**2, held), chi2=fit.chi2 / factor**2, used=fit.used)


def _prior(space: Space, total: float, curvature: float) -> coo_array:
    """What holds what no observation tells, beside a normal matrix of this trace."""
    energy, level = _energy(space), _level(space)
    hx, hy = space.span_mm
    return (energy * max(1.0 / (curvature**2 * hx * hy), MIN_ENERGY * total / energy.trace())
            + level * max(1.0, MIN_ENERGY * total / level.trace())).tocoo()


def _solved(space: Space, matrix: Array, vector: Array, held: coo_array) -> SplineFit:
    """The coefficients, without χ². Raises: LinAlgError."""
    factor = cho_factor(matrix, lower=True, check_finite=False)
    coefficients = cho_solve(factor, vector, check_finite=False)
    # Once more on what is left: the normal equations alone lose half the digits.
    coefficients += cho_solve(factor, vector - matrix @ coefficients, check_finite=False)
    return SplineFit(space, coefficients.reshape(space.shape), 0.0, 0, matrix, vector, held, factor)


def predicted(fit: SplineFit, observations: Observations) -> Array:
    """What d would have had observed, (n,).

    Parameters
    ----------
    fit : SplineFit
        d.
    observations : Observations
        Points and operators.
    """
    if not observations.operators[:, 1:].any():
        return observations.operators[:, 0] * fit.heights(observations.x, observations.y)
    d = fit.derivatives(observations.x, observations.y)
    result: Array = np.einsum("nk,kn->n", observations.operators, np.stack(d))
    return result


def combined_row(space: Space, each: Combined) -> Array:
    """The row of the coefficients in C order that a combined observation is the product with.

    Parameters
    ----------
    space : Space
        Of d.
    each : Combined
        In its box.
    """
    knots_x, knots_y = space.knots
    bx, by = dense_basis(knots_x, DEGREE, each.x, 2), dense_basis(knots_y, DEGREE, each.y, 2)
    row = sum(np.einsum("k,ki,kj->ij", each.operators[:, k], bx[a], by[b]) for k, (a, b) in enumerate(TERMS))
    return np.asarray(row).ravel()


def _uniform(low: float, high: float, spans: int) -> Array:
    return np.concatenate([np.full(DEGREE, low), np.linspace(low, high, spans + 1), np.full(DEGREE, high)])


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba's are
def _accumulate(first_x: NDArray[np.int64], bx: Array, first_y: NDArray[np.int64], by: Array, operators: Array, values: Array,
                weights: Array, stencil: Array, right: Array) -> None:
    """Add rows to the normal equations; stencil[i, j, di, dj + degree] couples (i, j) with (i + di, j + dj)."""
    wide, order = bx.shape[2], bx.shape[1] - 1
    row = np.empty((wide, wide))
    for n in range(values.size):
        if weights[n] == 0.0:
            continue
        i, j = first_x[n], first_y[n]
        m = operators[n]
        for a in range(wide):
            for b in range(wide):
                value = m[0] * bx[n, 0, a] * by[n, 0, b]
                if order > 0:
                    value += m[1] * bx[n, 1, a] * by[n, 0, b] + m[2] * bx[n, 0, a] * by[n, 1, b]
                if order > 1:
                    value += (m[3] * bx[n, 2, a] * by[n, 0, b] + m[4] * bx[n, 1, a] * by[n, 1, b]
                              + m[5] * bx[n, 0, a] * by[n, 2, b])
                row[a, b] = value
        for a in range(wide):
            for b in range(wide):
                weighted = weights[n] * row[a, b]
                right[i + a, j + b] += weighted * values[n]
                for c in range(a, wide):
                    for d in range(wide):
                        stencil[i + a, j + b, c - a, d - b + wide - 1] += weighted * row[c, d]


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _evaluated(first_x: NDArray[np.int64], bx: Array, first_y: NDArray[np.int64], by: Array, a: int, b: int,
               coefficients: Array) -> Array:
    result = np.empty(first_x.size)
    for n in range(first_x.size):
        total = 0.0
        for i in range(bx.shape[2]):
            along = 0.0
            for j in range(by.shape[2]):
                along += by[n, b, j] * coefficients[first_x[n] + i, first_y[n] + j]
            total += bx[n, a, i] * along
        result[n] = total
    return result


def _dense(stencil: Array) -> Array:
    """The whole symmetric matrix in C order of (i, j)."""
    nx, ny, wide, _ = stencil.shape
    full = np.zeros((nx, ny, nx, ny))
    i, j = np.arange(nx), np.arange(ny)
    for di in range(wide):
        for dj in range(-(wide - 1), wide):
            rows = j[max(0, -dj): ny - max(0, dj)]
            columns = i[: nx - di]
            values = stencil[columns[:, None], rows[None], di, dj + wide - 1]
            full[columns[:, None], rows, columns[:, None] + di, rows + dj] = values
            if di:
                full[columns[:, None] + di, rows + dj, columns[:, None], rows] = values
    return full.reshape(nx * ny, nx * ny)


def _energy(space: Space) -> coo_array:
    """∫ d_xx² + 2·d_xy² + d_yy² over the box as a quadratic form of the coefficients."""
    gx, gy = grams(space)
    return kron(gx[2], gy[0]) + 2.0 * kron(gx[1], gy[1]) + kron(gx[0], gy[2])


def _level(space: Space) -> coo_array:
    """The mean square of d over PRIOR_HEIGHT of the box and that of its slopes over PRIOR_SLOPE, as a quadratic form."""
    gx, gy = grams(space)
    width, height = space.box[1] - space.box[0], space.box[3] - space.box[2]
    return (kron(gx[0], gy[0]) / (PRIOR_HEIGHT * np.hypot(width, height)) ** 2
            + (kron(gx[1], gy[0]) + kron(gx[0], gy[1])) / PRIOR_SLOPE**2) / (width * height)


def grams(space: Space) -> tuple[list[coo_array], list[coo_array]]:
    """∫ B_i^(k)·B_j^(k) along x and along y, for k = 0 to 3.

    Parameters
    ----------
    space : Space
        Whose B-splines.
    """
    along_x, along_y = (_gram(knots) for knots in space.knots)
    return along_x, along_y


def _gram(knots: Array) -> list[coo_array]:
    nodes, weights = np.polynomial.legendre.leggauss(DEGREE + 1)
    ends = np.unique(knots)
    half = 0.5 * np.diff(ends)
    x = (0.5 * (ends[1:] + ends[:-1])[:, None] + half[:, None] * nodes).ravel()
    b = dense_basis(knots, DEGREE, x, 3)
    w = (half[:, None] * weights).ravel()
    return [coo_array((b[k] * w[:, None]).T @ b[k]) for k in range(4)]
