"""Slopes and curvatures that were measured in mirror coordinates, as observations of the deviation from the design."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirror_cad.made.fields import curvature_jacobian
from mirror_cad.made.nominal import Nominal
from mirror_cad.made.reconstruction import reconstruct
from mirror_cad.made.spline_fit import Observations
from mirror_cad.surfaces.differential import shape_operator_of_sag

Array = NDArray[np.float64]


def slope_observations(nominal: Nominal, x: Array, y: Array, slopes: Array, sigmas: Array, level: bool) -> Observations:
    """z_x and z_y less the design's.

    Parameters
    ----------
    nominal : Nominal
        The design.
    x, y : ndarray
        (n,), mm, on its sheet.
    slopes : ndarray
        (n, 2), ∂z/∂x and ∂z/∂y of the whole surface.
    sigmas : ndarray
        (n,), of either.
    level : bool
        Whether the tilt of the mounting, the median of both differences, is taken away.
    """
    _, zx, zy = nominal.heights(x, y)
    values = slopes - np.stack([zx, zy], axis=1)
    if level:
        values = values - np.median(values, axis=0)
    operators = np.zeros((2 * x.size, 6))
    operators[:x.size, 1], operators[x.size:, 2] = 1.0, 1.0
    return Observations(np.tile(x, 2), np.tile(y, 2), operators, values.T.ravel(), np.tile(sigmas, 2), np.ones(2 * x.size))


def curvature_observations(nominal: Nominal, x: Array, y: Array, curvatures: Array, sigmas: Array) -> Observations:
    """kx, ky and, where it was measured, twist, less the design's, linear in the deviation.

    Parameters
    ----------
    nominal : Nominal
        The design.
    x, y : ndarray
        (n,), mm, on its sheet.
    curvatures : ndarray
        (n, 3), 1/mm, convex positive; a column of NaN was not measured.
    sigmas : ndarray
        (n,), 1/mm.
    """
    design = nominal.derivatives(x, y)
    before = shape_operator_of_sag(design)
    jacobian = curvature_jacobian(design, np.zeros((x.size, 5)), before)[:, 2:]
    kept = [k for k in range(3) if np.isfinite(curvatures[:, k]).all()]
    operators = np.zeros((len(kept), x.size, 6))
    for row, k in enumerate(kept):
        operators[row, :, 1:] = jacobian[:, k]
    values = np.stack([curvatures[:, k] - before[k] for k in kept])
    count = len(kept) * x.size
    return Observations(np.tile(x, len(kept)), np.tile(y, len(kept)), operators.reshape(count, 6), values.ravel(),
                        np.tile(sigmas, len(kept)), np.ones(count))


def with_own_sigma(nominal: Nominal, observations: Observations, gauge_mm: float) -> Observations:
    """The observations with the sigma that their own scatter has about a surface of them alone.

    Parameters
    ----------
    nominal : Nominal
        The design.
    observations : Observations
        Of which the ratio of the sigmas is right.
    gauge_mm : float
        Over which curvature will be told.
    """
    found = reconstruct(nominal, np.zeros((0, 3)), None, gauge_mm, observations)
    scale = found.fit.scale if np.isfinite(found.fit.scale) else 1.0
    return Observations(observations.x, observations.y, observations.operators, observations.values,
                        observations.sigmas * max(scale, 1e-6), observations.weights)
