"""Deviation of a made mirror from its design over the mirror: height, slope and curvature, each with its sigma."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.curvature_fields import CurvatureFields, Quantity, differences
from mirror_cad.designed import FLOOR, reference_curvature
from mirror_cad.made.gauge import at_points, disc, on_gauge
from mirror_cad.made.nominal import Nominal
from mirror_cad.made.reconstruction import Reconstruction
from mirror_cad.sections import SagDerivatives
from mirror_cad.surfaces.differential import ShapeOperator, principal_curvatures_of, rms_norm, shape_operator_of_sag

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CELLS = 69  # of the lattice of places along the longer side: odd, so that one lies in the middle
COVERED = 0.97  # of what the gauge stands on
STEP = 1e-30  # of complex differentiation: no digit is lost


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """The places that a mirror is judged at: the middles of equal cells of the outline's box.

    x, y : (m,) and (n,), mm.   inside : (m, n), within the outline.   cell_mm2 : the area of a cell.
    """

    x: Array
    y: Array
    inside: Mask
    cell_mm2: float

    @staticmethod
    def over(nominal: Nominal) -> Lattice:
        """About CELLS along the longer side of the outline's box, square as far as that goes."""
        x_min, x_max, y_min, y_max = nominal.box
        pitch = max(x_max - x_min, y_max - y_min) / CELLS
        nx, ny = (2 * int(side / pitch / 2.0) + 1 for side in (x_max - x_min, y_max - y_min))
        x = x_min + (x_max - x_min) * (np.arange(nx) + 0.5) / nx
        y = y_min + (y_max - y_min) * (np.arange(ny) + 0.5) / ny
        return Lattice(x, y, nominal.outline.contains(*np.meshgrid(x, y, indexing="ij")),
                       (x_max - x_min) * (y_max - y_min) / (nx * ny))

    @property
    def places(self) -> Array:
        """Those inside, (k, 2), mm."""
        x, y = np.meshgrid(self.x, self.y, indexing="ij")
        return np.stack([x[self.inside], y[self.inside]], axis=1)

    def as_map(self, values: Array) -> Array:
        """Values (k,) at `places` as a rectangle (m, n), NaN outside."""
        rectangle = np.full(self.inside.shape, np.nan)
        rectangle[self.inside] = values
        return rectangle


@dataclass(frozen=True, slots=True, eq=False)
class DeviationFields:
    """Measured minus designed at k places, convex positive; NaN where it is not known.

    Height and slope are those of the smoothed surface at the place; their sigmas count the bias of smoothing. Curvature is that
    over the gauge, without any other smoothing.

    Attributes
    ----------
    lattice : Lattice
        Where.
    gauge_mm : float
        Over which curvature is told.
    height, height_sigma : ndarray
        (k,), mm, along z.
    slope_x, slope_y : ndarray
        (k,), of the height's deviation, radians.
    slope_sigma : ndarray
        (k,), of the larger of them, radians.
    curvature, curvature_sigma : CurvatureFields
        k1, k2, kx, ky, twist, (k,) each, 1/mm.
    designed, measured : ShapeOperator
        (k,) each, 1/mm.
    scale : CurvatureFields
        What counts as 100 % of each, 1/mm; of a plane all 0.
    measured_there : ndarray
        (k,), whether a measured point is near.
    fits : ndarray
        (k,), whether the gauge stands wholly inside the outline.
    known : ndarray
        (k,), whether it stands so, on what was measured.
    """

    lattice: Lattice
    gauge_mm: float
    height: Array
    height_sigma: Array
    slope_x: Array
    slope_y: Array
    slope_sigma: Array
    curvature: CurvatureFields
    curvature_sigma: CurvatureFields
    designed: ShapeOperator
    measured: ShapeOperator
    scale: CurvatureFields
    measured_there: Mask
    fits: Mask
    known: Mask

    @property
    def flat(self) -> bool:
        """Whether the design is a plane, of which nothing has a percent."""
        return not np.any(self.scale.k1)

    def percent(self, quantity: Quantity) -> tuple[Array, Array]:
        """A curvature's deviation and its sigma in percent of the local designed value, (k,) each."""
        with np.errstate(divide="ignore", invalid="ignore"):
            share = 100.0 / getattr(self.scale, quantity)
        return share * getattr(self.curvature, quantity), share * getattr(self.curvature_sigma, quantity)


def deviation_fields(nominal: Nominal, found: Reconstruction, gauge_mm: float) -> DeviationFields:
    """Evaluate a reconstruction over the mirror.

    Parameters
    ----------
    nominal : Nominal
        The design.
    found : Reconstruction
        What was measured.
    gauge_mm : float
        The diameter over which curvature is told.
    """
    lattice = Lattice.over(nominal)
    places = lattice.places
    around = places[:, None] + disc(gauge_mm)
    on_mirror = nominal.outline.contains(around[..., 0], around[..., 1])
    covered = on_mirror & found.coverage.covers(around[..., 0], around[..., 1])
    fits = np.asarray(on_mirror.all(axis=1))
    shares = covered.sum(axis=1) / np.maximum(on_mirror.sum(axis=1), 1)
    there = found.coverage.covers(places[:, 0], places[:, 1])
    known = fits & (shares >= COVERED) & there
    # Where the gauge stands whole its few uncovered points count, so that all such places are told alike.
    told = there & (shares >= COVERED)
    gauge = on_gauge(found.fit, places[told], gauge_mm, on_mirror[told])
    slopes, covariances = np.full((len(places), 5), np.nan), np.full((len(places), 5, 5), np.nan)
    slopes[told], covariances[told] = gauge.values, gauge.covariances * found.sigma_factor**2
    form, form_covariances = np.full((len(places), 3), np.nan), np.full((len(places), 3, 3), np.nan)
    form[there], form_covariances[there] = at_points(found.smooth, places[there])
    form_covariances *= found.sigma_factor**2
    design = nominal.derivatives(places[:, 0], places[:, 1])
    with np.errstate(invalid="ignore"):  # of what is not known
        before, after = shape_operator_of_sag(design), shape_operator_of_sag(_moved(design, slopes.T))
        jacobian = curvature_jacobian(design, slopes, after)
    rms = rms_norm(before, np.ones(len(places)))
    variances = np.einsum("kqi,kij,kqj->kq", jacobian, covariances, jacobian)
    variance_of_slopes = np.linalg.eigvalsh(np.nan_to_num(form_covariances[:, 1:, 1:]))[:, -1]
    return DeviationFields(
        lattice, gauge_mm, form[:, 0], np.sqrt(form_covariances[:, 0, 0]), form[:, 1], form[:, 2],
        np.where(there, np.sqrt(np.maximum(variance_of_slopes, 0.0)), np.nan),
        _without_bias(differences(after, before), before, after, jacobian, covariances),
        CurvatureFields(*np.sqrt(np.maximum(variances, 0.0)).T), before, after,
        _scales(before, rms), there, fits, np.logical_and(known, told))


def _without_bias(found: CurvatureFields, before: ShapeOperator, after: ShapeOperator, jacobian: Array,
                  covariances: Array) -> CurvatureFields:
    """k1 and k2 without what noise alone parts them by.

    Of half their difference, |A| with A = (½(W11 − W22), W12), noise makes √(|A|² + tr cov A) on the average of the squares.
    """
    rows = np.stack([0.5 * (jacobian[:, 2] - jacobian[:, 3]), jacobian[:, 4]], axis=1)
    noise = np.einsum("kai,kij,kaj->k", rows, covariances, rows)
    mean = 0.5 * (after.w11 + after.w22)
    half = np.sqrt(np.maximum(0.25 * (after.w11 - after.w22) ** 2 + after.w12**2 - noise, 0.0))
    k1, k2 = principal_curvatures_of(before)
    return found._replace(k1=mean + half - k1, k2=mean - half - k2)


def _scales(designed: ShapeOperator, rms: float) -> CurvatureFields:
    """What counts as 100 %, as in deviation.json."""
    pair, floor = reference_curvature(designed, rms), FLOOR * rms
    return CurvatureFields(pair[..., 0], pair[..., 1], np.maximum(np.abs(designed.w11), floor),
                           np.maximum(np.abs(designed.w22), floor), np.full(len(pair), rms))


def _moved(design: SagDerivatives, change: Array) -> SagDerivatives:
    """The design's derivatives with (d_x, d_y, d_xx, d_xy, d_yy) added."""
    return SagDerivatives(design.z, *(a + b for a, b in zip(design[1:], change, strict=True)))


def curvature_jacobian(design: SagDerivatives, slopes: Array, after: ShapeOperator) -> Array:
    """∂(k1, k2, kx, ky, twist)/∂(d_x, …, d_yy), (k, 5, 5), by complex steps.

    At an umbilic, where k1 and k2 have no derivative, that of the curvature along some direction.

    Parameters
    ----------
    design : SagDerivatives
        At k places.
    slopes : ndarray
        (k, 5), d_x … d_yy there.
    after : ShapeOperator
        Of both together.
    """
    result = np.empty((len(slopes), 5, 5))
    angle = 0.5 * np.arctan2(2.0 * after.w12, after.w11 - after.w22)
    c, s = np.cos(angle), np.sin(angle)
    for n in range(5):
        step = slopes.T.astype(np.complex128, copy=True)
        step[n] += 1j * STEP
        w = shape_operator_of_sag(_moved(design, step))  # type: ignore[arg-type]  # the formulas hold for complex numbers too
        d11, d22, d12 = (np.imag(each) / STEP for each in w)
        result[:, 0, n] = c * c * d11 + 2.0 * c * s * d12 + s * s * d22
        result[:, 1, n] = s * s * d11 - 2.0 * c * s * d12 + c * c * d22
        result[:, 2, n], result[:, 3, n], result[:, 4, n] = d11, d22, d12
    return result
