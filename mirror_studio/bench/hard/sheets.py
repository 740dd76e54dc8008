"""The surface of two curvature laws, worked out a second time by nothing of the program: height, slopes, curvatures.

Closed forms where radii are constant, else the paper's equation by scipy's Runge-Kutta rule, and the textbook's fundamental
forms.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Law = float | Callable[[Array], Array]  # κ in 1/mm, constant or of x (n,)

STEP_MM = 0.05  # of the differences that stand for κ_y′, κ_y″: fourth order, some 1e-9 of a law that changes over 10 mm


class Sheet(Protocol):
    """A surface z(x, y) known from elsewhere, and the two curvatures asked for."""

    def laws(self, x: Array) -> tuple[Array, Array]:
        """Designed κ_x and κ_y at x, 1/mm."""
        ...

    def height(self, x: Array, y: Array) -> Array:
        """z at (x, y), mm."""
        ...

    def derivatives(self, x: Array, y: Array) -> tuple[Array, Array, Array, Array, Array]:
        """z_x, z_y, z_xx, z_xy, z_yy."""


@dataclass(frozen=True, eq=False)
class Decoupled:
    """z(x, y) = z_p(x) − s(κ_y(x), y) between x = low and high, with z_p level at `level_mm` and 0 at x = 0.

    across, upright : κ_x, κ_y.   breaks : x where a law is less than smooth.
    """

    across: Law
    upright: Law
    level_mm: float
    breaks: tuple[float, ...]
    low: float
    high: float

    def laws(self, x: Array) -> tuple[Array, Array]:
        """Designed κ_x and κ_y at x, 1/mm."""
        return _value(self.across, x), _value(self.upright, x)

    def height(self, x: Array, y: Array) -> Array:
        """z at (x, y), mm."""
        return self.profile(x)[0] - _circle(_value(self.upright, x), y)

    def derivatives(self, x: Array, y: Array) -> tuple[Array, Array, Array, Array, Array]:
        """z_x, z_y, z_xx, z_xy and z_yy at (x, y), mm and 1/mm."""
        k1, k = self.laws(x)
        g = self.profile(x)[1]
        k_x = k_xx = np.zeros_like(x)
        if not isinstance(self.upright, float):
            a, b, c, d = (self.upright(x + i * STEP_MM) for i in (-2, -1, 1, 2))
            k_x = (a - 8.0 * b + 8.0 * c - d) / (12.0 * STEP_MM)
            k_xx = (-a + 16.0 * b - 30.0 * k + 16.0 * c - d) / (12.0 * STEP_MM**2)
        w = np.sqrt((1.0 - k * y) * (1.0 + k * y))
        s_k = y**2 / (w * (1.0 + w))
        s_kk = k * y**4 * (1.0 + 2.0 * w) / (w**3 * (1.0 + w) ** 2)
        return (g - s_k * k_x, -k * y / w, -k1 * (1.0 + g * g) ** 1.5 - s_kk * k_x**2 - s_k * k_xx, -k_x * y / w**3,
                -k / w**3)

    def profile(self, x: Array) -> tuple[Array, Array]:
        """z_p and z_p′ at x: the arc's closed form, or the solution of the paper's eq. 2."""
        if isinstance(self.across, float):
            s = self.across * (x - self.level_mm)
            height = _circle(self.across, -self.level_mm) - _circle(self.across, x - self.level_mm)
            return height, -s / np.sqrt((1.0 - s) * (1.0 + s))
        state = np.full((2, x.size), np.nan)
        for low, high, solution in self._pieces:
            here = (x >= low) & (x <= high)
            if here.any():
                state[:, here] = solution(x[here])
        at_origin = next(float(solution(0.0)[0]) for low, high, solution in self._pieces if low <= 0.0 <= high)
        return state[0] - at_origin, state[1]

    @cached_property
    def _pieces(self) -> list[tuple[float, float, Any]]:
        """z′ = g, g′ = −κ(1 + g²)^(3/2) from the level point to either end, from break to break."""

        def rates(x: float, state: Array) -> tuple[float, float]:
            return state[1], -float(_value(self.across, np.array([x]))[0]) * (1.0 + state[1] ** 2) ** 1.5

        pieces = []
        for end in (min(self.low, self.level_mm), max(self.high, self.level_mm)):
            between = [b for b in self.breaks if min(end, self.level_mm) < b < max(end, self.level_mm)]
            stops = [self.level_mm, *sorted(between, reverse=end < self.level_mm), end]
            state = np.zeros(2)
            for a, b in itertools.pairwise(stops):
                inset = 1e-12 * (b - a)  # so that a jump at an end is seen from inside
                solved = solve_ivp(rates, (a + inset, b - inset), state, "DOP853", dense_output=True, rtol=1e-13,
                                   atol=1e-15, max_step=max(abs(b - a) / 8.0, 1e-9))
                pieces.append((min(a, b), max(a, b), solved.sol))
                state = solved.y[:, -1]
        return pieces


@dataclass(frozen=True, slots=True)
class Sphere:
    """z = √(R² − x² − y²) − R, convex for R > 0; R = inf is the plane."""

    radius_mm: float

    def laws(self, x: Array) -> tuple[Array, Array]:
        """Designed κ_x and κ_y at x, 1/mm."""
        return np.full_like(x, 1.0 / self.radius_mm), np.full_like(x, 1.0 / self.radius_mm)

    def height(self, x: Array, y: Array) -> Array:
        """z at (x, y), mm."""
        return -_circle(1.0 / self.radius_mm, np.hypot(x, y))

    def derivatives(self, x: Array, y: Array) -> tuple[Array, Array, Array, Array, Array]:
        """z_x, z_y, z_xx, z_xy and z_yy at (x, y), mm and 1/mm."""
        k = 1.0 / self.radius_mm
        w = np.sqrt(1.0 - k * k * (x * x + y * y))
        return (-k * x / w, -k * y / w, -k * (1.0 - (k * y) ** 2) / w**3, -(k**3) * x * y / w**3,
                -k * (1.0 - (k * x) ** 2) / w**3)


def _value(law: Law, x: Array) -> Array:
    return np.full(np.shape(x), law) if isinstance(law, float) else np.asarray(law(x), dtype=np.float64)


def _circle(kappa: ArrayLike, y: ArrayLike) -> Array:
    """Sag of a circle of curvature κ at y."""
    k, y = np.asarray(kappa, dtype=np.float64), np.asarray(y, dtype=np.float64)
    result: Array = k * y**2 / (1.0 + np.sqrt((1.0 - k * y) * (1.0 + k * y)))
    return result


def mean_and_gauss(derivatives: Sequence[Array]) -> tuple[Array, Array]:
    """H (convex positive) and K of z(x, y). Source: M. do Carmo, Differential Geometry, section 3-3, example 5."""
    p, q, r, s, t = derivatives
    n2 = 1.0 + p * p + q * q
    mean = -((1.0 + q * q) * r - 2.0 * p * q * s + (1.0 + p * p) * t) / (2.0 * n2**1.5)
    return mean, (r * t - s * s) / n2**2


def principal(mean: Array, gauss: Array) -> Array:
    """The two principal curvatures of H and K, larger first, (2, n)."""
    root = np.sqrt(np.maximum(mean**2 - gauss, 0.0))
    return np.stack([mean + root, mean - root])


def designed(sheet: Sheet, x: Array) -> Array:
    """The two curvatures asked for, as `principal` has them."""
    result: Array = np.sort(np.stack(sheet.laws(x)), axis=0)[::-1]
    return result


def normals(derivatives: Sequence[Array]) -> Array:
    """Unit normals of z(x, y), (n, 3)."""
    p, q = derivatives[:2]
    normal = np.stack([-p, -q, np.ones_like(p)], axis=1)
    result: Array = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return result
