"""One radius in, the sphere's exact sag z(x, y) and where it can be made as a sheet out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirror_cad.errors import ProfileError
from mirror_cad.profile import STEEPEST_SINE
from mirror_cad.sections import SagDerivatives

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

# A sphere is fitted to what float64 holds of it, whatever a specification allows other surfaces: then volume, area and sag are
# the closed forms' to 1e-9, and its deviations are rounding. Degree 9 needs a few dozen patches for that, degree 5 thousands.
SPHERE_POSITION_MM, SPHERE_CURVATURE_PERCENT, SPHERE_DEGREE = 1e-10, 1e-7, 9


@dataclass(frozen=True, slots=True)
class SphericalSag:
    """z(x, y) = s(x₀, 0) − s(x − x₀, y), s = κρ²/(1 + √(1 − κ²ρ²)), ρ² = x² + y²: a sphere through the origin.

    Attributes
    ----------
    kappa : float
        1/R, 1/mm; convex positive, 0 a plane.
    level_mm : float
        x₀, where its tangent plane is level.
    """

    kappa: float
    level_mm: float = 0.0

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """z at (x, y), mm, broadcast."""
        across, y = np.asarray(x, dtype=np.float64) - self.level_mm, np.asarray(y, dtype=np.float64)
        at_origin = self.kappa * self.level_mm**2 / (1.0 + self._cosine(self.level_mm**2))
        result: Array = at_origin - self.kappa * (across**2 + y**2) / (1.0 + self._cosine(across**2 + y**2))
        return result

    def derivatives(self, x: ArrayLike, y: ArrayLike) -> SagDerivatives:
        """z, z_x, z_y, z_xx, z_xy, z_yy at (x, y), broadcast; mm and 1/mm."""
        across, y = np.asarray(x, dtype=np.float64) - self.level_mm, np.asarray(y, dtype=np.float64)
        k, w = self.kappa, self._cosine(across**2 + y**2)
        cubed = k / w**3
        return SagDerivatives(self.height(x, y), -k * across / w, -k * y / w, -cubed * (1.0 - (k * y) ** 2),
                              -cubed * k**2 * across * y, -cubed * (1.0 - (k * across) ** 2))

    def _cosine(self, squared: Array | float) -> Array:
        """cos of the angle from the axis at distance ρ; `squared` is ρ²."""
        result: Array = np.sqrt(1.0 - self.kappa**2 * np.asarray(squared))
        return result


def spherical_domain(sag: SphericalSag, box: Box, wanted: Box) -> Box:
    """The rectangle about `box`, as much of `wanted` as the sphere reaches with all four corners.

    Parameters
    ----------
    sag : SphericalSag
    box, wanted : tuple
        (x_min, x_max, y_min, y_max) mm, the second around the first.

    Raises
    ------
    ProfileError
        Where a corner of `box` lies beyond the sphere, or where it is steeper than a sheet over (x, y) may be.
    """
    if sag.kappa == 0.0:
        return wanted
    reach = STEEPEST_SINE / abs(sag.kappa)
    farthest = _farthest_corner(sag, box)
    if farthest > reach:
        raise ProfileError(
            f"the sphere of {1.0 / abs(sag.kappa):.1f} mm does not reach the corners of the mirror's box, {farthest:.1f} mm "
            f"from its axis: a sheet of it ends at {reach:.1f} mm, where it is steeper than 80°; raise the radius or make the "
            "outline smaller")
    if _farthest_corner(sag, wanted) <= reach:
        return wanted
    low, high = 0.0, 1.0  # share of the way from the box to what is wanted
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _farthest_corner(sag, _between(box, wanted, middle)) <= reach else (low, middle)
    return _between(box, wanted, low)


def _between(box: Box, wanted: Box, share: float) -> Box:
    x_min, x_max, y_min, y_max = (a + share * (b - a) for a, b in zip(box, wanted, strict=True))
    return x_min, x_max, y_min, y_max


def _farthest_corner(sag: SphericalSag, box: Box) -> float:
    x_min, x_max, y_min, y_max = box
    return float(np.hypot(max(abs(x_min - sag.level_mm), abs(x_max - sag.level_mm)), max(-y_min, y_max)))
