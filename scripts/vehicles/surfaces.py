"""Curves and grids of points in, B-spline faces and fair outlines out."""

from __future__ import annotations

import build123d as bd
import numpy as np
from numpy.typing import ArrayLike, NDArray
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
from OCP.Geom import Geom_BSplineSurface
from OCP.gp import gp_Pnt
from OCP.TColgp import TColgp_Array2OfPnt
from OCP.TColStd import TColStd_Array1OfInteger, TColStd_Array1OfReal
from scipy.interpolate import make_interp_spline

Array = NDArray[np.float64]

DEGREE = 3
DEGENERATE = 1e-3  # mm, an edge shorter than this is a point
TURN_WEIGHT = 0.35  # of an outline's sampling: how much a half turn counts beside the whole length


def interpolated(points: Array) -> bd.Face:
    """The bicubic B-spline face through a grid of points (nu, nv, 3), parametrised by mean chord length."""
    nu, nv = points.shape[:2]
    along = make_interp_spline(_chords(points, 0), points, k=DEGREE, axis=0)
    across = make_interp_spline(_chords(points, 1), along.c.transpose(1, 0, 2), k=DEGREE, axis=0)
    poles = TColgp_Array2OfPnt(1, nu, 1, nv)
    for j, row in enumerate(across.c):
        for i, pole in enumerate(row):
            poles.SetValue(i + 1, j + 1, gp_Pnt(*(float(value) for value in pole)))
    surface = Geom_BSplineSurface(poles, *_knots(along.t, across.t), DEGREE, DEGREE)
    return bd.Face(BRepBuilderAPI_MakeFace(surface, DEGENERATE).Face())


def facing(face: bd.Face, x: float, y: float, z: float) -> bd.Face:
    """The face with the side out that looks along a direction at the middle of its parameters."""
    return face if face.normal_at(0.5, 0.5).dot(bd.Vector(x, y, z)) > 0.0 else -face


def _chords(points: Array, axis: int) -> Array:
    lengths = np.linalg.norm(np.diff(points, axis=axis), axis=2).mean(axis=1 - axis)
    return np.concatenate([[0.0], np.cumsum(lengths)])


def _knots(*vectors: Array) -> tuple[TColStd_Array1OfReal | TColStd_Array1OfInteger, ...]:
    """Knots of all vectors, then the multiplicities, as the kernel takes them."""
    knots, counts = [], []
    for vector in vectors:
        values, times = np.unique(vector, return_counts=True)
        knot, count = TColStd_Array1OfReal(1, len(values)), TColStd_Array1OfInteger(1, len(values))
        for index, (value, number) in enumerate(zip(values, times, strict=True)):
            knot.SetValue(index + 1, float(value))
            count.SetValue(index + 1, int(number))
        knots.append(knot)
        counts.append(count)
    return (*knots, *counts)


def quarter(length: float, half_width: float, exponent: float, bow: float) -> Array:
    """An end of a plan outline, (n, 2): distance x from its foremost point and offset y, from y = 0 to half_width.

    x = bow·q² + length·(1 − (1 − q^exponent)^(1/exponent)), q = y/half_width: a superellipse's quarter, bowed.
    """
    q = 1.0 - np.linspace(1.0, 0.0, 1500) ** 3
    along = bow * q**2 + length * (1.0 - np.maximum(1.0 - q**exponent, 0.0) ** (1.0 / exponent))
    return np.column_stack([along, half_width * q])


def resampled(curve: Array, count: int) -> Array:
    """The curve (n, 2) by count points, close together where it is long or bent."""
    steps = np.diff(curve, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    turns = np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])), prepend=0.0))
    turns[0] = 0.0
    weight = np.concatenate([[0.0], np.cumsum(lengths / lengths.sum() + TURN_WEIGHT * turns / np.pi)])
    at = np.linspace(0.0, weight[-1], count)
    return np.column_stack([np.interp(at, weight, curve[:, 0]), np.interp(at, weight, curve[:, 1])])


def height_field(x: ArrayLike, y: ArrayLike, z: Array) -> bd.Face:
    """The face z(x, y) through values (nx, ny) on a grid."""
    gx, gy = np.meshgrid(x, y, indexing="ij")
    return interpolated(np.stack([gx, gy, z], axis=-1))
