"""Reconstruction against others: Zernike polynomials' curvature, a modal least squares, and a published set of slopes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from mirror_cad.made.gauge import at_points
from mirror_cad.made.spline_fit import Observations, Space, fit_spline

Array = NDArray[np.float64]

RADIUS = 100.0  # mm, of the aperture
DISC = Space((-RADIUS, RADIUS, -RADIUS, RADIUS), (12, 12))


def zernike(x: Array, y: Array) -> dict[str, tuple[Array, Array, Array, Array]]:
    """Z, Z_xx, Z_xy, Z_yy over the unit circle, by hand.

    The curvature polynomials of C. Zhao, J. H. Burge, "Orthonormal curvature polynomials over a unit circle", Opt. Express 21,
    31430 (2013), are made of such second derivatives.
    """
    one, nil, r2 = np.ones_like(x), np.zeros_like(x), x * x + y * y
    return {
        "defocus": (2.0 * r2 - 1.0, 4.0 * one, nil, 4.0 * one),
        "astigmatism": (x * x - y * y, 2.0 * one, nil, -2.0 * one),
        "oblique astigmatism": (2.0 * x * y, nil, 2.0 * one, nil),
        "coma": ((3.0 * r2 - 2.0) * x, 18.0 * x, 6.0 * y, 6.0 * x),
        "trefoil": (x**3 - 3.0 * x * y * y, 6.0 * x, -6.0 * y, -6.0 * x),
        "spherical": (6.0 * r2 * r2 - 6.0 * r2 + 1.0, 72.0 * x * x + 24.0 * y * y - 12.0, 48.0 * x * y,
                      24.0 * x * x + 72.0 * y * y - 12.0),
        "secondary astigmatism": ((4.0 * r2 - 3.0) * (x * x - y * y), 48.0 * x * x - 6.0, nil, 6.0 - 48.0 * y * y),
        "tetrafoil": (x**4 - 6.0 * x * x * y * y + y**4, 12.0 * (x * x - y * y), -24.0 * x * y, 12.0 * (y * y - x * x)),
    }


def disc_grid(step: float) -> tuple[Array, Array]:
    x, y = np.meshgrid(np.arange(-RADIUS, RADIUS + 1e-9, step), np.arange(-RADIUS, RADIUS + 1e-9, step))
    inside = np.hypot(x, y) <= RADIUS
    return x[inside], y[inside]


def without_motion(x: Array, y: Array, height: Array) -> Array:
    """What is left of heights when a plane is taken away."""
    plane = np.column_stack([np.ones_like(x), x, y])
    return np.asarray(height - plane @ np.linalg.lstsq(plane, height, rcond=None)[0])


@pytest.mark.parametrize("name", list(zernike(np.zeros(1), np.zeros(1))))
def test_a_surface_is_had_from_its_curvature_alone_but_for_a_motion(name: str) -> None:
    """Of 10 µm of each polynomial, told by its closed-form curvature at 5 mm: heights to 1e-9 mm."""
    x, y = disc_grid(5.0)
    z, *second = (0.01 * each for each in zernike(x / RADIUS, y / RADIUS)[name])
    operators = np.zeros((3 * x.size, 6))
    for k in range(3):
        operators[k * x.size:(k + 1) * x.size, 3 + k] = 1.0
    values = np.concatenate(second) / RADIUS**2
    observed = Observations(np.tile(x, 3), np.tile(y, 3), operators, values, np.full(values.size, 1e-9), np.ones(values.size))
    found = fit_spline(DISC, observed, (), 1.0).heights(x, y)
    assert np.abs(without_motion(x, y, found) - without_motion(x, y, z)).max() < 1e-9


def test_a_modal_fit_finds_the_same_surface_and_is_as_sure_as_its_fewer_modes_let_it_be() -> None:
    """Chebyshev polynomials to the sixth degree by numpy's least squares, of the same noisy points.

    Where the truth lies in both spaces what they differ by is what only the spline's further modes take up of the noise.
    """
    rng = np.random.default_rng(3)
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(-98.0, 98.0, 50), np.linspace(-98.0, 98.0, 50)))
    basis = chebyshev.chebvander2d(x / RADIUS, y / RADIUS, [6, 6])
    true = basis @ (rng.normal(0.0, 0.01, basis.shape[1]) / (1.0 + np.arange(basis.shape[1])))
    sigma, errors, stated, modal_errors = 0.005, [], np.empty(0), []
    apart: list[Array] = []
    at = np.stack([each.ravel() for each in np.meshgrid(np.linspace(-80.0, 80.0, 9), np.linspace(-80.0, 80.0, 9))], axis=1)
    wanted = chebyshev.chebvander2d(at[:, 0] / RADIUS, at[:, 1] / RADIUS, [6, 6])
    exact = wanted @ np.linalg.lstsq(basis, true, rcond=None)[0]
    for _ in range(12):
        noisy = true + sigma * rng.standard_normal(x.size)
        fit = fit_spline(DISC, Observations.of_heights(x, y, noisy, np.full(x.size, sigma)), (), 1.0)
        modal = wanted @ np.linalg.lstsq(basis, noisy, rcond=None)[0]
        values, covariances = at_points(fit, at)
        stated = np.sqrt(covariances[:, 0, 0])
        errors.append(values[:, 0] - exact)
        modal_errors.append(modal - exact)
        apart.append(values[:, 0] - modal)
    assert np.sqrt(np.mean(np.array(errors) ** 2)) == pytest.approx(np.sqrt(np.mean(stated**2)), rel=0.1)
    # Least squares in a space and in a part of it differ by what is orthogonal to the part: variances subtract.
    both = np.mean(np.array(errors) ** 2) - np.mean(np.array(modal_errors) ** 2)
    assert np.sqrt(np.mean(np.array(apart) ** 2)) == pytest.approx(np.sqrt(both), rel=0.1)
    # 49 modes of 2,500 points against 289 of them, as σ·√(p/n).
    ratio = np.sqrt(np.mean(np.array(modal_errors) ** 2)) / np.sqrt(np.mean(np.array(errors) ** 2))
    assert ratio == pytest.approx(np.sqrt(49.0 / 289.0), rel=0.2)


def test_slopes_on_a_skewed_grid_give_the_published_surface() -> None:
    """The surface of Huang et al., Appl. Opt. 56, 5139 (2017), on quadrilaterals bent and jittered as theirs are.

    `scripts/slope_set.py` does it on their own 128 × 128 file.
    """
    rng = np.random.default_rng(5)
    u, v = np.meshgrid(np.linspace(-2.0, 2.0, 64), np.linspace(-2.0, 2.0, 64))
    pitch, r2 = 4.0 / 63.0, u * u + v * v
    x, y = (each * (1.0 - 0.01 * r2) + 0.05 * pitch * rng.standard_normal(u.shape) for each in (u, v))
    x, y = (x + 0.05 * y).ravel(), (y - 0.03 * x).ravel()
    z, zx, zy = peaks(x, y)
    operators = np.zeros((2 * x.size, 6))
    operators[: x.size, 1], operators[x.size:, 2] = 1.0, 1.0
    observed = Observations(np.tile(x, 2), np.tile(y, 2), operators, np.concatenate([zx, zy]), np.full(2 * x.size, 1e-6),
                            np.ones(2 * x.size))
    box = float(x.min()), float(x.max()), float(y.min()), float(y.max())
    off = fit_spline(Space(box, (28, 28)), observed, (), 1e9).heights(x, y) - z
    assert (off - off.mean()).std() < 1e-6  # of heights of 0.8: the fifth-order splines' own error


def peaks(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """0.1·peaks(x, y), MATLAB's, with its slopes."""
    a, b, c = np.exp(-x * x - (y + 1.0) ** 2), np.exp(-x * x - y * y), np.exp(-((x + 1.0) ** 2) - y * y)
    inner = x / 5.0 - x**3 - y**5
    z = 3.0 * (1.0 - x) ** 2 * a - 10.0 * inner * b - c / 3.0
    zx = -6.0 * (1.0 - x) * a - 6.0 * x * (1.0 - x) ** 2 * a - 10.0 * (0.2 - 3.0 * x * x) * b + 20.0 * x * inner * b + (
        2.0 / 3.0 * (x + 1.0) * c)
    zy = -6.0 * (y + 1.0) * (1.0 - x) ** 2 * a + 50.0 * y**4 * b + 20.0 * y * inner * b + 2.0 / 3.0 * y * c
    return 0.1 * z, 0.1 * zx, 0.1 * zy
