"""The field of view of one section alone, with the eye on its axis: the definition that table 1 of the paper rests on."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from mirror_cad.profile import Profile, integrate_exactly
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev

Array = NDArray[np.float64]

# Gauss–Legendre on so many nodes a piece is exact to rounding while |sin θ| stays below this: tan θ is a series in sin θ whose
# nearest singularity is at 1.
GAUSS_NODES, STEEPEST_GAUSS = 40, 0.7


def section_fov(profile: Profile, x_min: float, x_max: float, eye_distance_mm: float) -> float:
    """Compute the field of view of the profile alone between its edges: the angle between the two reflected rays.

    The eye is on the axis through the section's centre x_c at the stated distance d, (x_c, z(x_c) + d). A ray to the
    edge (x, z) leaves at the angle atan((x − x_c)/(z(x_c) + d − z)) + 2θ from the axis.
    For a circle of radius R: 2·[2·asin(a/R) + atan(a/(d + R − √(R² − a²)))].

    Parameters
    ----------
    profile : Profile
    x_min, x_max : float
        The edges, mm.
    eye_distance_mm : float
        d.

    Returns
    -------
    float
        Radians.

    References
    ----------
    Table 1 of Lee et al. (2014), whose figures it gives.
    """
    x = np.array([x_min, x_max])
    centre = np.array([0.5 * (x_min + x_max)])
    eye_height = profile.height(centre) + eye_distance_mm
    reflected = np.arctan2(x - centre, eye_height - profile.height(x)) + 2.0 * profile.tangent_angle(x)
    return float(reflected[1] - reflected[0])


def section_fov_of_sine(sine: PiecewiseChebyshev, x_min: float, x_max: float, eye_distance_mm: float) -> float:
    """Compute `section_fov` from sin θ alone, radians: what `match` is solved with, many times over.

    NaN where the profile turns vertical.

    z(x) − z(x_c) = −∫ tan θ dx by Gauss–Legendre quadrature between the series' breaks; where the profile is steeper than
    STEEPEST_GAUSS that would lose digits, and the whole profile is integrated.
    """
    centre = 0.5 * (x_min + x_max)
    ends = np.unique(np.concatenate([np.clip(sine.breaks, x_min, x_max), [centre]]))
    nodes, weights = _gauss()
    half = 0.5 * np.diff(ends)
    s = sine(np.append((ends[:-1] + half)[:, None] + half[:, None] * nodes, [x_min, x_max]))
    steepest = np.abs(s).max()
    if steepest >= 1.0:
        return float("nan")
    if steepest > STEEPEST_GAUSS:
        return section_fov(integrate_exactly(sine, sine.derivative()), x_min, x_max, eye_distance_mm)
    at_nodes = s[:-2].reshape(len(half), len(nodes))
    falls = half * ((at_nodes / np.sqrt((1.0 - at_nodes) * (1.0 + at_nodes))) @ weights)
    left = ends[:-1] < centre
    below = np.array([-falls[left].sum(), falls[~left].sum()])  # z(x_c) − z at either edge
    reflected = np.arctan2(np.array([x_min, x_max]) - centre, eye_distance_mm + below) + 2.0 * np.arcsin(s[-2:])
    return float(reflected[1] - reflected[0])


def rough_section_fov(x: Array, curvature: Array, level_mm: float, eye_distance_mm: float) -> float:
    """Compute `section_fov` by the trapezoidal rule, radians; NaN where the profile is steeper than STEEPEST_GAUSS.

    Parameters
    ----------
    x, curvature : ndarray
        (n,) equally spaced from edge to edge, n odd, mm, and κ there, 1/mm.
    level_mm : float
        Where θ = 0.
    eye_distance_mm : float
    """
    h, middle = x[1] - x[0], len(x) // 2
    sine = np.concatenate([[0.0], np.cumsum(0.5 * h * (curvature[1:] + curvature[:-1]))])
    sine -= np.interp(level_mm, x, sine)
    if np.abs(sine).max() > STEEPEST_GAUSS:
        return float("nan")
    tangent = sine / np.sqrt((1.0 - sine) * (1.0 + sine))
    fall = np.concatenate([[0.0], np.cumsum(0.5 * h * (tangent[1:] + tangent[:-1]))])
    below = fall[[0, -1]] - fall[middle]
    reflected = np.arctan2(x[[0, -1]] - x[middle], eye_distance_mm + below) + 2.0 * np.arcsin(sine[[0, -1]])
    return float(reflected[1] - reflected[0])


@cache
def _gauss() -> tuple[Array, Array]:
    return np.polynomial.legendre.leggauss(GAUSS_NODES)


def circle_section_fov(curvature: float, half_width_mm: float, eye_distance_mm: float) -> float:
    """Compute `section_fov` of a circle in closed form, radians.

    Parameters
    ----------
    curvature : float
        1/R, 1/mm; 0 is flat, negative concave.
    half_width_mm, eye_distance_mm : float
    """
    sag = curvature * half_width_mm**2 / (1.0 + np.sqrt(1.0 - (curvature * half_width_mm) ** 2))
    edge = np.arctan2(half_width_mm, eye_distance_mm + sag)
    return float(2.0 * (2.0 * np.arcsin(curvature * half_width_mm) + edge))
