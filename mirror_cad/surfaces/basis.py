"""The B-spline basis on a knot vector: its functions with derivatives at any parameter, as rows, and Greville's abscissae."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


def greville_abscissae(knots: Array, degree: int) -> Array:
    """g_i = (t_i+1 + … + t_i+p)/p: the collocation sites, and the poles of the identity.

    Parameters
    ----------
    knots : ndarray
        (n + p + 1,), clamped.
    degree : int
        p.

    Returns
    -------
    ndarray
        (n,).
    """
    windows = np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree)
    sites: Array = windows.mean(axis=1)
    sites[0], sites[-1] = knots[0], knots[-1]
    return sites


def basis_functions(knots: Array, degree: int, u: Array, order: int) -> tuple[NDArray[np.int64], Array]:
    """The degree + 1 B-splines that live at each u, and their derivatives.

    N_i,p = (u − t_i)/(t_i+p − t_i)·N_i,p−1 + …; derivative p·(N_i,p−1/(t_i+p − t_i) − N_i+1,p−1/(…)).

    Parameters
    ----------
    knots : ndarray
        (m,), clamped.
    degree : int
        p.
    u : ndarray
        (n,), inside the knots.
    order : int
        Of the highest derivative, 0 to 2.

    Returns
    -------
    first : ndarray
        (n,), the index of the first one.
    values : ndarray
        (n, order + 1, degree + 1).

    References
    ----------
    The NURBS Book, eqs. 2.5 and 2.7.
    """
    # Copies: what is read-only is of another type to numba, which would compile all of it once more.
    knots, u = np.array(knots), np.array(u)
    first, out = np.empty(u.size, dtype=np.int64), np.empty((u.size, order + 1, degree + 1))
    _local_basis(knots, degree, u, first, out)
    return first, out


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba's are
def _local_basis(knots: Array, degree: int, u: Array, first: NDArray[np.int64], out: Array) -> None:
    values = np.empty((degree + 1, degree + 1))  # of each degree up to the full one
    lower, higher = np.empty(degree + 1), np.empty(degree + 1)
    for n in range(u.size):
        span, above = degree, len(knots) - degree - 2
        while span < above:
            middle = (span + above + 1) // 2
            if knots[middle] <= u[n]:
                span = middle
            else:
                above = middle - 1
        first[n] = span - degree
        values[0, 0] = 1.0
        for p in range(1, degree + 1):
            values[p, 0] = 0.0
            for j in range(p):  # supports that two neighbours of degree p share begin and end here
                left, right = knots[span + 1 - p + j], knots[span + 1 + j]
                share = values[p - 1, j] / (right - left)
                values[p, j] += (right - u[n]) * share
                values[p, j + 1] = (u[n] - left) * share
        for k in range(out.shape[1]):
            if k > degree:
                out[n, k] = 0.0
                continue
            for j in range(degree - k + 1):  # an assignment of slices compiles its error's words for two seconds
                lower[j] = values[degree - k, j]
            for p in range(degree - k + 1, degree + 1):
                higher[0] = 0.0
                for j in range(p):
                    share = p * lower[j] / (knots[span + 1 + j] - knots[span + 1 - p + j])
                    higher[j] -= share
                    higher[j + 1] = share
                lower, higher = higher, lower
            for j in range(degree + 1):
                out[n, k, j] = lower[j]


def dense_basis(knots: Array, degree: int, u: Array, order: int) -> Array:
    """Basis values and derivatives as full matrices.

    Parameters
    ----------
    knots, degree, u, order
        As for `basis_functions`.

    Returns
    -------
    ndarray
        (order + 1, n, poles).
    """
    first, local = basis_functions(knots, degree, u, order)
    full = np.zeros((order + 1, u.size, len(knots) - degree - 1))
    columns = first[:, None] + np.arange(degree + 1)
    for k in range(order + 1):
        np.put_along_axis(full[k], columns, local[:, k], axis=1)
    return full
