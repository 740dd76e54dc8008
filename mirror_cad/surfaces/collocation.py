"""Collocate a B-spline surface: through given points at the Greville abscissae of its knots."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from mirror_cad.errors import SurfaceError
from mirror_cad.surfaces.basis import greville_abscissae
from mirror_cad.surfaces.bspline import BSplineSurface

Array = NDArray[np.float64]
PointSet = Callable[[Array, Array], Array]


def collocate(points: PointSet, knots_u: Array, knots_v: Array, degree: int) -> BSplineSurface:
    """The B-spline surface through points(u, v) at the Greville abscissae.

    Parameters
    ----------
    points : callable
        u (m,), v (n,) -> (m, n, 3), mm.
    knots_u, knots_v : ndarray
        Clamped.
    degree : int
        In both directions.

    Raises
    ------
    SurfaceError
        Where a point is not finite, with its parameters.

    References
    ----------
    C. de Boor, A Practical Guide to Splines, chapter XIII.
    """
    return BSplineSurface(degree, degree, knots_u, knots_v, _poles(points, knots_u, knots_v, degree))


def collocate_height(height: Callable[[Array, Array], Array], knots_x: Array, knots_y: Array, degree: int) -> BSplineSurface:
    """`collocate` for (x, y, z(x, y)); x and y are reproduced exactly, so u = x and v = y.

    Parameters
    ----------
    height : callable
        z of a column x (m, 1) and a row y (n,) -> (m, n), mm.
    knots_x, knots_y : ndarray
        Clamped, mm.
    degree : int
        In both directions.
    """
    heights = _poles(lambda x, y: height(x[:, None], y)[..., None], knots_x, knots_y, degree)
    return graph(knots_x, knots_y, degree, heights[..., 0])


def graph(knots_x: Array, knots_y: Array, degree: int, heights: Array) -> BSplineSurface:
    """The surface (x, y, Σ N_i(x)·N_j(y)·heights_ij) with u = x, v = y.

    The Greville abscissae are the poles of the identity.

    Parameters
    ----------
    knots_x, knots_y : ndarray
        Clamped, mm.
    degree : int
        In both directions.
    heights : ndarray
        (n_x, n_y), mm.
    """
    poles = np.empty((*heights.shape, 3))
    poles[..., 0] = greville_abscissae(knots_x, degree)[:, None]
    poles[..., 1] = greville_abscissae(knots_y, degree)
    poles[..., 2] = heights
    return BSplineSurface(degree, degree, knots_x, knots_y, poles)


def knot_vector(ends: Array, breaks: Sequence[tuple[float, int]], degree: int) -> Array:
    """Clamped knots over the ends of spans, repeated at a break so that only its derivatives stay continuous.

    Parameters
    ----------
    ends : ndarray
        (m + 1,), rising.
    breaks : sequence
        (x, continuous derivatives), each at one of the ends.
    degree : int
        Of the splines.
    """
    orders = dict(breaks)
    inner = [[end] * max(1, min(degree, degree - orders.get(float(end), degree - 1))) for end in ends[1:-1]]
    return np.concatenate([[ends[0]] * (degree + 1), *inner, [ends[-1]] * (degree + 1)]).astype(np.float64)


def _poles(points: PointSet, knots_u: Array, knots_v: Array, degree: int) -> Array:
    u, v = greville_abscissae(knots_u, degree), greville_abscissae(knots_v, degree)
    values = points(u, v)
    bad = ~np.isfinite(values).all(axis=2)
    if bad.any():
        i, j = np.argwhere(bad)[0]
        raise SurfaceError(f"the point set is not finite at (x, y) = ({u[i]:.3f}, {v[j]:.3f}) mm")
    along_u = make_interp_spline(u, values, k=degree, t=knots_u, axis=0, check_finite=False).c
    poles = make_interp_spline(v, along_u, k=degree, t=knots_v, axis=1, check_finite=False).c
    return np.ascontiguousarray(np.moveaxis(poles, 0, 1))  # scipy puts the interpolated axis first
