"""What one state of a surface has that another has not: curvature, height and slope, and where they are largest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.curvature_fields import Quantity, differences, in_percent, index_of_largest
from mirror_cad.grid import Grid
from mirror_cad.sections import Sag, SagDerivatives
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import ShapeOperator, normals, rms_norm, shape_operator, shape_operator_of_sag
from mirror_cad.vectors import lengths

Array = NDArray[np.float64]
Point = tuple[float, float]

ARCSEC = np.degrees(1.0) * 3600.0


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceState:
    """A surface as one stage leaves it, at the n points of the grid.

    Attributes
    ----------
    shape
        Shape operator, components (n,), 1/mm.
    height
        (n,), mm.
    normal
        Unit normals, (n, 3).
    """

    shape: ShapeOperator
    height: Array
    normal: Array


@dataclass(frozen=True, slots=True)
class QuantityDeviation:
    """Deviation of one curvature over the mirror.

    Attributes
    ----------
    max_percent
        The signed value of largest size, in percent of the local designed value; None for a plane.
    rms_percent
        Root of the mean square by area, percent; None for a plane.
    max_per_m
        The signed value of largest size, 1/m.
    max_at_mm
        (x, y) of the largest in percent, for a plane of the largest in 1/m; mm.
    """

    max_percent: float | None
    rms_percent: float | None
    max_per_m: float
    max_at_mm: Point


@dataclass(frozen=True, slots=True)
class ShapeDeviation:
    """Deviation ‖W − W₀‖ (Frobenius) of the whole shape operator over the mirror.

    Attributes
    ----------
    max_percent, rms_percent
        In percent of RMS ‖diag(1/Rx, 1/Ry)‖; None for a plane.
    max_per_m, rms_per_m
        1/m.
    max_at_mm
        (x, y) of the largest, mm.
    """

    max_percent: float | None
    rms_percent: float | None
    max_per_m: float
    rms_per_m: float
    max_at_mm: Point


@dataclass(frozen=True, slots=True)
class StageDeviation:
    """What one stage adds to a surface, or all of them together.

    Attributes
    ----------
    k1, k2
        Principal curvatures, larger first.
    kx, ky, twist
        The components W11, W22, W12 of the shape operator.
    shape
        The shape operator as a whole.
    sag_max_mm
        The signed height difference of largest size, mm.
    slope_max_arcsec
        The largest angle between the normals, arc seconds.
    sag_max_at_mm, slope_max_at_mm
        (x, y) of these, mm.
    """

    k1: QuantityDeviation
    k2: QuantityDeviation
    kx: QuantityDeviation
    ky: QuantityDeviation
    twist: QuantityDeviation
    shape: ShapeDeviation
    sag_max_mm: float
    sag_max_at_mm: Point
    slope_max_arcsec: float
    slope_max_at_mm: Point

    def of(self, quantity: Quantity) -> QuantityDeviation:
        """The deviation of the quantity so named."""
        found: QuantityDeviation = getattr(self, quantity)
        return found

    @property
    def largest_principal_percent(self) -> float | None:
        """The larger deviation of k1 and k2 in size, percent; None for a plane."""
        found = [abs(one.max_percent) for one in (self.k1, self.k2) if one.max_percent is not None]
        return max(found) if found else None

    @property
    def largest_principal_per_m(self) -> float:
        """The larger deviation of k1 and k2 in size, 1/m."""
        return max(abs(self.k1.max_per_m), abs(self.k2.max_per_m))


def deviation_of(after: SurfaceState, before: SurfaceState, designed: ShapeOperator, rms: float, grid: Grid) -> StageDeviation:
    """What one state of a surface has that another has not.

    Parameters
    ----------
    after, before
        The two, at the points of the grid.
    designed
        The designed shape operator there, 1/mm.
    rms
        RMS ‖diag(1/Rx, 1/Ry)‖ over the mirror, 1/mm; 0 for a plane, of which there is no percent.
    grid
        Where they are taken.
    """
    per_mm = differences(after.shape, before.shape)
    percent = (None,) * len(per_mm) if rms == 0.0 else in_percent(per_mm, designed, rms)
    k1, k2, kx, ky, twist = (_quantity(*each, grid) for each in zip(per_mm, percent, strict=True))
    sag = after.height - before.height
    highest = index_of_largest(np.abs(sag), grid)
    # |n − m| = 2·sin(angle/2): arccos of n·m would lose the small angles that matter here.
    chord = lengths(after.normal - before.normal)
    steepest = index_of_largest(chord, grid)
    return StageDeviation(
        k1=k1, k2=k2, kx=kx, ky=ky, twist=twist, shape=_shape(after.shape.minus(before.shape), rms, grid),
        sag_max_mm=float(sag[highest]), sag_max_at_mm=_point(grid, highest),
        slope_max_arcsec=float(2.0 * np.arcsin(0.5 * chord[steepest]) * ARCSEC), slope_max_at_mm=_point(grid, steepest))


def state_of_sag(sag: Sag, grid: Grid) -> SurfaceState:
    """Of a sag whose derivatives are known."""
    cells = sag.derivatives(grid.cells_x[:, None], grid.cells_y)
    edge = sag.derivatives(grid.x[grid.edge], grid.y[grid.edge])
    d = SagDerivatives(*(np.concatenate([np.broadcast_to(a, grid.inside.shape)[grid.inside], b])
                         for a, b in zip(cells, edge, strict=True)))
    normal = np.stack([-d.zx, -d.zy, np.ones_like(d.z)], axis=-1)
    return SurfaceState(shape_operator_of_sag(d), d.z, normal / lengths(normal)[..., None])


def state_of_surface(surface: BSplineSurface, grid: Grid) -> SurfaceState:
    """Of a B-spline with u = x, v = y."""
    d = grid.derivatives(surface)
    return SurfaceState(shape_operator(d), d["s"][..., 2], normals(d["u"], d["v"]))


def _quantity(per_mm: Array, percent: Array | None, grid: Grid) -> QuantityDeviation:
    max_per_m = 1e3 * float(per_mm[index_of_largest(np.abs(per_mm), grid)])
    if percent is None:
        return QuantityDeviation(max_percent=None, rms_percent=None, max_per_m=max_per_m,
                                 max_at_mm=_point(grid, index_of_largest(np.abs(per_mm), grid)))
    worst = index_of_largest(np.abs(percent), grid)
    return QuantityDeviation(max_percent=float(percent[worst]),
                             rms_percent=float(np.sqrt(np.average(percent**2, weights=grid.weights))),
                             max_per_m=max_per_m, max_at_mm=_point(grid, worst))


def _shape(difference: ShapeOperator, rms: float, grid: Grid) -> ShapeDeviation:
    size = np.sqrt(difference.w11**2 + difference.w22**2 + 2.0 * difference.w12**2)
    worst, average = index_of_largest(size, grid), rms_norm(difference, grid.weights)
    flat = rms == 0.0
    return ShapeDeviation(max_percent=None if flat else 100.0 * float(size[worst]) / rms,
                          rms_percent=None if flat else 100.0 * average / rms,
                          max_per_m=1e3 * float(size[worst]), rms_per_m=1e3 * average, max_at_mm=_point(grid, worst))


def _point(grid: Grid, index: int) -> Point:
    return float(grid.x[index]), float(grid.y[index])
