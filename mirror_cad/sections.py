"""The sag z(x, y) of the decoupled surface, vertical circles hung on the profile, and its derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirror_cad.errors import ProfileError
from mirror_cad.profile import STEEPEST_SINE, Profile
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev

Array = NDArray[np.float64]


class SagDerivatives(NamedTuple):
    """z and its derivatives to the second order, each of the shape of (x, y)."""

    z: Array
    zx: Array
    zy: Array
    zxx: Array
    zxy: Array
    zyy: Array


class Sag(Protocol):
    """A height field z(x, y) with its derivatives; a column x (m, 1) and a row y (n,) give a grid."""

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """z at (x, y), mm, broadcast."""
        ...

    def derivatives(self, x: ArrayLike, y: ArrayLike) -> SagDerivatives:
        """z, z_x, z_y, z_xx, z_xy, z_yy at (x, y), broadcast; mm and 1/mm."""
        ...


STEEPEST_STEP = STEEPEST_SINE / np.sqrt(1.0 - STEEPEST_SINE**2)  # the slope at which the profile ends too


@dataclass(frozen=True, eq=False)
class DecoupledSag:
    """z(x, y) = z_p(x) − s(κ_y(x), y): circles of radius 1/κ_y(x) in the planes x = const, hung on the profile z_p.

    s = κ_y·y²/(1 + w), w = √(1 − κ_y²·y²): the circle's sag in the form that holds for flat and concave circles too.

    Attributes
    ----------
    profile : Profile
        z_p.
    vertical : PiecewiseChebyshev
        κ_y, 1/mm.

    References
    ----------
    Eq. 6 of Lee et al. (2014), with R₂ constant along y.
    """

    profile: Profile
    vertical: PiecewiseChebyshev

    @cached_property
    def _vertical_derivatives(self) -> tuple[PiecewiseChebyshev, PiecewiseChebyshev]:
        first = self.vertical.derivative()
        return first, first.derivative()

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """z at (x, y), mm, broadcast."""
        x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        result: Array = self.profile.height(x) + self.residual_height(x, y)
        return result

    def residual_height(self, x: Array, y: Array) -> Array:
        """z − z_p: minus the circles' sag, mm, broadcast."""
        kappa = self.vertical(x)
        result: Array = -kappa * y**2 / (1.0 + _cosine(kappa, y))
        return result

    def derivatives(self, x: ArrayLike, y: ArrayLike) -> SagDerivatives:
        """z, z_x, z_y, z_xx, z_xy, z_yy at (x, y), broadcast; mm and 1/mm."""
        x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        first, second = self._vertical_derivatives
        kappa_y, dkappa_dx, d2kappa_dx2 = self.vertical(x), first(x), second(x)
        w = _cosine(kappa_y, y)
        s_k = y**2 / (w * (1.0 + w))
        s_kk = kappa_y * y**4 * (1.0 + 2.0 * w) / (w**3 * (1.0 + w) ** 2)
        profile = self.profile
        return SagDerivatives(
            z=profile.height(x) - kappa_y * y**2 / (1.0 + w),
            zx=profile.slope(x) - s_k * dkappa_dx,
            zy=-kappa_y * y / w,
            zxx=profile.bend(x) - s_kk * dkappa_dx**2 - s_k * d2kappa_dx2,
            zxy=-dkappa_dx * y / w**3,
            zyy=-kappa_y / w**3,
        )


def _cosine(kappa: Array, y: Array) -> Array:
    """cos of the circle's tangent angle at y."""
    sine = kappa * y
    result: Array = np.sqrt((1.0 - sine) * (1.0 + sine))
    return result


def check_circles(vertical: PiecewiseChebyshev, x_min: float, x_max: float, half_height_mm: float) -> None:
    """Refuse a vertical circle whose radius does not exceed the mirror's half-height.

    Parameters
    ----------
    vertical : PiecewiseChebyshev
        κ_y, 1/mm.
    x_min, x_max, half_height_mm : float
        Of the mirror, mm.

    Raises
    ------
    ProfileError
        With the x of the smallest circle.
    """
    x = np.linspace(x_min, x_max, 2001)
    kappa = vertical(x)
    worst = int(np.argmax(np.abs(kappa)))
    if abs(kappa[worst]) * half_height_mm >= 1.0:
        raise ProfileError(
            f"the vertical radius {abs(1.0 / kappa[worst]):.1f} mm at x = {x[worst]:.1f} mm is not above the mirror's "
            f"half-height {half_height_mm:.1f} mm: its circle ends before the edge; raise the vertical radius there or "
            "make the outline lower")


def check_steps(vertical: PiecewiseChebyshev, jumps: Sequence[float], x_min: float, x_max: float,
                half_height_mm: float) -> None:
    """Refuse a κ_y that changes so fast that the decoupled surface stands up: z_x = −κ_y′·y²/(w(1 + w)).

    Parameters
    ----------
    vertical : PiecewiseChebyshev
        κ_y between x_min and x_max at least, 1/mm.
    jumps : sequence of float
        x where κ_y itself is not continuous, mm.
    x_min, x_max, half_height_mm : float
        Of the mirror, mm.

    Raises
    ------
    ProfileError
        With the x where it is steepest.
    """
    first = vertical.derivative()
    ends = np.unique(np.clip(vertical.breaks, x_min, x_max))
    x = (ends[:-1, None] + np.diff(ends)[:, None] * np.linspace(0.02, 0.98, 33)).ravel()
    w = _cosine(vertical(x), np.full_like(x, half_height_mm))
    slope = np.abs(first(x)) * half_height_mm**2 / (w * (1.0 + w))
    worst = int(np.argmax(slope))
    inside = [jump for jump in jumps if x_min < jump < x_max]
    if not inside and slope[worst] <= STEEPEST_STEP:
        return
    what = (f"jumps at x = {inside[0]:.2f} mm: its circles do not meet there" if inside else
            f"changes so fast at x = {round(float(x[worst]), 2) + 0.0:.2f} mm that the surface would stand at "
            f"{np.degrees(np.arctan(slope[worst])):.1f}° at y = {half_height_mm:.0f} mm")
    raise ProfileError(f"the vertical law {what}; blend it over a longer stretch, or take [surface] method = \"faithful\", "
                       "which has no steps")


def existing_half_height(vertical: PiecewiseChebyshev, x_min: float, x_max: float, half_height_mm: float) -> float:
    """As much of the half-height as every circle reaches while its slope stays below STEEPEST_SINE, mm.

    Parameters
    ----------
    vertical : PiecewiseChebyshev
        κ_y, 1/mm.
    x_min, x_max, half_height_mm : float
        What is asked for, mm.
    """
    largest = float(np.abs(vertical(np.linspace(x_min, x_max, 2001))).max())
    return half_height_mm if largest * half_height_mm <= STEEPEST_SINE else STEEPEST_SINE / largest
