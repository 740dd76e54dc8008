"""The measured mirror as one B-spline surface: the design's heights and the deviation, which two splines are, added exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirror_cad.made.nominal import Nominal
from mirror_cad.made.spline_fit import DEGREE, SplineFit
from mirror_cad.surfaces.basis import dense_basis, greville_abscissae
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import graph

Array = NDArray[np.float64]

SAME_KNOT = 1e-9  # of the box's width


def measured_surface(nominal: Nominal, fit: SplineFit) -> BSplineSurface:
    """z_design + d over the box of d, u = x, v = y.

    Both lie in the splines of the higher degree on the knots of both, repeated so that neither is smoother than it was; there
    the sum is found by collocation, which for such splines is exact but for rounding.

    Parameters
    ----------
    nominal : Nominal
        The design.
    fit : SplineFit
        d.
    """
    surface, box = nominal.surface, fit.space.box
    degree = max(surface.degree_u, surface.degree_v, DEGREE)
    knots = [_union(own, own_degree, other, degree, low, high) for own, own_degree, other, low, high in (
        (surface.knots_u, surface.degree_u, fit.space.knots[0], box[0], box[1]),
        (surface.knots_v, surface.degree_v, fit.space.knots[1], box[2], box[3]))]
    sites = [greville_abscissae(each, degree) for each in knots]
    heights = surface.on_grid(sites[0], sites[1], component=2, order=0)["s"]
    along = dense_basis(fit.space.knots[0], DEGREE, sites[0], 0)[0] @ fit.coefficients
    heights = heights + along @ dense_basis(fit.space.knots[1], DEGREE, sites[1], 0)[0].T
    for axis in (0, 1):
        matrix = dense_basis(knots[axis], degree, sites[axis], 0)[0]
        heights = np.moveaxis(np.linalg.solve(matrix, np.moveaxis(heights, axis, 0).reshape(len(sites[axis]), -1)).reshape(
            len(sites[axis]), -1), 0, axis)
    return graph(knots[0], knots[1], degree, np.ascontiguousarray(heights))


def _union(own: Array, own_degree: int, other: Array, degree: int, low: float, high: float) -> Array:
    """Knots of the given degree between low and high on which both splines lie, the other one of DEGREE."""
    needed: list[tuple[float, int]] = []
    for knots, raised in ((own, degree - own_degree), (other, degree - DEGREE)):
        values, counts = np.unique(knots, return_counts=True)
        needed += [(float(v), int(n) + raised) for v, n in zip(values, counts, strict=True)]
    needed.sort()
    merged: list[tuple[float, int]] = []
    width = high - low
    for value, count in needed:
        if value <= low + SAME_KNOT * width or value >= high - SAME_KNOT * width:
            continue
        if merged and value - merged[-1][0] <= SAME_KNOT * width:
            merged[-1] = (merged[-1][0], max(merged[-1][1], count))
        else:
            merged.append((value, count))
    inner = [value for value, count in merged for _ in range(min(count, degree))]
    return np.array([low] * (degree + 1) + inner + [high] * (degree + 1))
