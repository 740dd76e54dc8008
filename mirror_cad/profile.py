"""The horizontal profile z(x) of a curvature κ(x), with its tangent angle θ(x)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from mirror_cad.errors import ProfileError
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev, approximate

Array = NDArray[np.float64]
Function = Callable[[Array], Array]

# The surface is carried beyond the outline only while the slope stays below this: past it a sheet over (x, y) is no
# description of it, and no cutter needs it.
STEEPEST_SINE = 0.985
LONGEST_MARCH = 2_000_000  # steps of Euler or RK4: minutes of work, and far below any step that helps


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """The curve z(x) in the plane y = 0, convex towards +z, with z(0) = 0.

    height, slope, bend : z, dz/dx = −tan θ and d²z/dx² as functions of x (n,), mm.
    x_min, x_max : where it is defined.   method : how it was integrated.   steps : pieces or steps that took.
    """

    height: Function
    slope: Function
    bend: Function
    x_min: float
    x_max: float
    method: str
    steps: int

    def tangent_angle(self, x: Array) -> Array:
        """θ(x) in radians, positive where a convex mirror falls away to the right."""
        return np.arctan(-self.slope(x))


def sine_of_tangent_angle(kappa: PiecewiseChebyshev, level_mm: float) -> PiecewiseChebyshev:
    """Compute sin θ(x) = ∫κ dx from where the profile is level: exact, since d(sin θ)/dx = cos θ·dθ/dx = κ."""
    return kappa.integral(zero_at=level_mm)


def existing_interval(sine: PiecewiseChebyshev, level_mm: float, x_min: float, x_max: float) -> tuple[float, float]:
    """Find the part of [x_min, x_max] around the level point where |sin θ| stays below STEEPEST_SINE."""
    x = np.unique(np.concatenate([np.linspace(x_min, x_max, 4001), sine.breaks, [level_mm]]))
    steep = np.abs(sine(x)) >= STEEPEST_SINE
    right = x[(x > level_mm) & steep]
    left = x[(x < level_mm) & steep]
    before_right = x[np.searchsorted(x, right[0]) - 1] if right.size else x_max
    after_left = x[np.searchsorted(x, left[-1]) + 1] if left.size else x_min
    return max(float(after_left), x_min), min(float(before_right), x_max)


def check_profile(sine: PiecewiseChebyshev, level_mm: float, x_min: float, x_max: float) -> None:
    """Raise ProfileError where the profile turns vertical, |∫κ dx| ≥ 1, inside the mirror [x_min, x_max]."""
    pieces = np.concatenate([np.linspace(a, b, 33) for a, b in zip(sine.breaks[:-1], sine.breaks[1:], strict=True)])
    x = np.unique(np.concatenate([pieces[(pieces >= x_min) & (pieces <= x_max)], [x_min, x_max]]))
    vertical = x[np.abs(sine(x)) >= 1.0]
    if vertical.size == 0:
        return
    point = float(vertical[np.argmin(np.abs(vertical - level_mm))])
    edge = x_min if point < level_mm else x_max
    raise ProfileError(
        f"the profile turns vertical at x = {point:.1f} mm of {edge:.1f} mm (|∫κ dx| = {abs(float(sine(point))):.3f} "
        f"there from x = {level_mm:.1f} mm, where it is level; it must stay below 1): shorten the mirror or raise the "
        f"radius near {point:.0f} mm")


def integrate_exactly(sine: PiecewiseChebyshev, kappa: PiecewiseChebyshev) -> Profile:
    """Compute z = −∫ tan θ dx by Chebyshev quadrature, exact to rounding error.

    Parameters
    ----------
    sine : PiecewiseChebyshev
        sin θ on the whole interval, below 1 in size (`check_profile`).
    kappa : PiecewiseChebyshev
        κ, 1/mm.

    References
    ----------
    Eq. 2 of Lee et al. (2014) with z'' = κ·(1 + z'²)^(3/2), which is d(sin θ)/dx = κ.
    """

    def slope(x: Array) -> Array:
        s = sine(x)
        return -s / np.sqrt((1.0 - s) * (1.0 + s))

    series = approximate(slope, list(sine.breaks))
    height = series.integral(zero_at=0.0)

    def bend(x: Array) -> Array:
        s = sine(x)
        return -kappa(x) / ((1.0 - s) * (1.0 + s)) ** 1.5

    x_min, x_max = float(sine.breaks[0]), float(sine.breaks[-1])
    return Profile(height, slope, bend, x_min, x_max, "quadrature", len(series.coefficients))


def integrate_ode(kappa: PiecewiseChebyshev, exact: Profile, method: str, step_mm: float) -> Profile:
    """Integrate g' = −κ·(1 + g²)^(3/2), z' = g the paper's way, in steps of −h from the right end.

    The exact profile lends height and slope there, and the interpolating quintic spline joins the points.

    "euler": g ← g + h·g', z ← z + h·g with the old g (eqs. 4, 5), first order: κ is realised one step late.
    "semi-implicit": the same with z advanced by the new g, which realises κ on time. "rk4": the classical Runge–Kutta
    rule, fourth order.

    Parameters
    ----------
    kappa : PiecewiseChebyshev
        κ(x), 1/mm, on the interval of `exact`.
    exact : Profile
    method : "euler", "semi-implicit" or "rk4"
    step_mm : float
        h.

    Raises
    ------
    ProfileError
        Where the profile turns vertical on the way, or it would take too many steps.

    References
    ----------
    Eqs. 2, 4 and 5 of Lee et al. (2014).
    """
    length = exact.x_max - exact.x_min
    count = round(length / step_mm)
    if not 8 <= count <= LONGEST_MARCH:
        raise ProfileError(f"surface.step_mm = {step_mm:g} gives {count} steps over {length:.0f} mm: "
                           f"choose it between {length / LONGEST_MARCH:.2g} and {length / 8:.3g} mm")
    # Equal steps, the nearest to the asked one that end at the edge: a shorter last step would be a kink.
    x = np.linspace(exact.x_max, exact.x_min, count + 1)
    z = np.empty_like(x)
    g = np.empty_like(x)
    z[0], g[0] = float(exact.height(x[:1])[0]), float(exact.slope(x[:1])[0])
    at, middle = kappa(x), kappa(0.5 * (x[:-1] + x[1:]))
    with np.errstate(over="ignore", invalid="ignore"):
        for i in range(count):
            h = x[i + 1] - x[i]
            if method != "rk4":
                g[i + 1] = g[i] - h * at[i] * (1.0 + g[i] * g[i]) ** 1.5
                z[i + 1] = z[i] + h * (g[i] if method == "euler" else g[i + 1])
                continue
            rates: list[float] = []
            slopes: list[float] = []
            for k, weight in zip((at[i], middle[i], middle[i], at[i + 1]), (0.0, 0.5, 0.5, 1.0), strict=True):
                slopes.append(g[i] + h * weight * (rates[-1] if rates else 0.0))
                rates.append(-k * (1.0 + slopes[-1] * slopes[-1]) ** 1.5)
            g[i + 1] = g[i] + h / 6.0 * (rates[0] + 2.0 * rates[1] + 2.0 * rates[2] + rates[3])
            z[i + 1] = z[i] + h / 6.0 * (slopes[0] + 2.0 * slopes[1] + 2.0 * slopes[2] + slopes[3])
    lost = np.flatnonzero(~(np.abs(g) < 1e3))
    if lost.size:
        raise ProfileError(f"the {method} march turns vertical at x = {x[lost[0]]:.1f} mm: "
                           "take a smaller surface.step_mm or integration = \"quadrature\"")
    spline: BSpline = make_interp_spline(x[::-1], z[::-1], k=5)
    spline = BSpline(spline.t, spline.c - float(spline(0.0)), 5)
    first, second = spline.derivative(1), spline.derivative(2)
    return Profile(spline, first, second, exact.x_min, exact.x_max, method, count)
