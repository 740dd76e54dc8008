"""Sky and sun in, what kernels light a scene with and how its picture is exposed out.

Sources: Ramamoorthi and Hanrahan, An efficient representation for irradiance environment maps, SIGGRAPH 2001; Reinhard et
al., Photographic tone reproduction for digital images, SIGGRAPH 2002; IEC 61966-2-1 (sRGB). See docs/derivations/daylight.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from raytrace.parallel import parallel_for
from raytrace.scene import sky

Array = NDArray[np.float64]

TABLE = 257  # places a side: 0.5° apart or less; three floats each, 0.8 MB
GRAY = 0.18  # reflectance of the exposure's gray card, and what it becomes in the picture
# Luminance that becomes white, over the gray card's as the curve's argument: sunlit white paint stays below it.
WHITE = 3.0
GROUND = (0.115, 0.125, 0.095)  # asphalt and grass from afar, linear sRGB
CLEAR = 2.2  # turbidity of a clear day, 35 km of visibility
TO_DISPLAY = 65_536  # pixels of a run


@dataclass(frozen=True, slots=True, eq=False)
class Daylight:
    """What lights a scene: the sky, the ground as a mirror of it, the sun; and the air before what is far away.

    table (TABLE, TABLE, 3) float32 : the sky's radiance, kcd/m², on the unfolded octahedron's upper half: with
        p = d/(|dx| + |dy| + |dz|), row and column run with px + py and px − py from −1 to 1; the horizon is its border.
    below (3,) : radiance of all directions below the horizon, where there is no ground to be met.
    harmonics (9, 3) : irradiance, klx, as a polynomial of a face's normal: see `irradiance`.
    sun (3,) unit, sun_irradiance (3,) klx on a face square to it; zero where there is none.
    extinction (3,) 1/mm : of the air along the ground.
    scale (3,) : the tone curve's argument over radiance: exposure and white balance.
    """

    table: NDArray[np.float32]
    below: Array
    harmonics: Array
    sun: Array
    sun_irradiance: Array
    extinction: Array
    scale: Array

    @staticmethod
    def clear(azimuth_deg: float, elevation_deg: float, turbidity: float = CLEAR, ev: float = 0.0,
              ground: ArrayLike = GROUND) -> Daylight:
        """A clear day.

        Parameters
        ----------
        azimuth_deg, elevation_deg : of the sun; azimuth 0 ahead of the vehicle, positive to the right.
        turbidity : of the air.
        ev : exposure, in stops above the gray card's.
        ground : (3,), reflectance, linear sRGB.

        Raises
        ------
        SceneError
            For a sun or turbidity that the sky model does not hold for.
        """
        sun = sky.sun_direction(azimuth_deg, elevation_deg)
        return Daylight.under(lambda directions: sky.sky_radiance(directions, sun, turbidity), sun,
                              sky.sun_irradiance(sun, turbidity), sky.air_extinction(turbidity), ev, ground)

    @staticmethod
    def under(radiance: Callable[[Array], Array], sun: ArrayLike, sun_irradiance: ArrayLike, extinction: ArrayLike = 0.0,
              ev: float = 0.0, ground: ArrayLike = GROUND) -> Daylight:
        """The light of any sky: radiance of unit directions (n, 3) in the upper half space → (n, 3) kcd/m²."""
        towards = np.array(sun, dtype=np.float64)
        beam = np.array(sun_irradiance, dtype=np.float64)
        upper, weights = _sphere_quadrature()
        light = radiance(upper)
        level = (weights * upper[:, 2]) @ light + max(towards[2], 0.0) * beam
        below = np.array(ground, dtype=np.float64) / np.pi * level
        basis = (_basis(upper) * weights[:, None]).T @ light + (_basis(upper * [1.0, 1.0, -1.0]) * weights[:, None]).sum(
            axis=0)[:, None] * below
        card = GRAY / np.pi * level
        return Daylight(_tabulated(radiance), below, basis * _KERNEL[:, None], towards, beam,
                        np.broadcast_to(np.array(extinction, dtype=np.float64), 3).copy(), _argument_of(GRAY * 2.0**ev) / card)

    def irradiance(self, normals: ArrayLike) -> Array:
        """Irradiance (n, 3) klx of faces with unit normals (n, 3) from sky and ground, without the sun's disc.

        Spherical harmonics to order 2; the orders 4, 6 … are left out, which is up to 3 % of the mean irradiance for a sun from
        20° on (turbidity 2.5 or more) and 6 % at 5°.
        """
        result: Array = _basis(np.asarray(normals, dtype=np.float64)) @ self.harmonics
        return result

    def display(self, radiance: Array) -> NDArray[np.uint8]:
        """Radiance (…, 3) as sRGB values: with x = scale·L of each channel, x·(1 + Y/w²)/(1 + Y), Y the luminance of x.

        What is too bright for its colour gets paler at the same luminance, until it fits.
        A gray card of 18 % on level ground becomes a gray of 0.18·2^ev of white.
        """
        pixels = np.ascontiguousarray(radiance, dtype=np.float64).reshape(-1, 3)
        out = np.empty(pixels.shape, dtype=np.uint8)
        parallel_for(lambda start, stop: _to_display(pixels[start:stop], self.scale, out[start:stop]), len(pixels), TO_DISPLAY)
        return out.reshape(np.shape(radiance))


def tone_curve(x: ArrayLike) -> Array:
    """x·(1 + x/w²)/(1 + x): Reinhard et al. 2002, equation 4."""
    value = np.asarray(x, dtype=np.float64)
    result: Array = value * (1.0 + value / WHITE**2) / (1.0 + value)
    return result


def _argument_of(value: float) -> float:
    """Where the tone curve has a value: x²/w² + (1 − value)·x − value = 0."""
    half = 0.5 * (1.0 - value) * WHITE**2
    return float(np.sqrt(half**2 + value * WHITE**2) - half)


def _sphere_quadrature() -> tuple[Array, Array]:
    """Directions over the upper half space and their solid angles."""
    nodes, weights = np.polynomial.legendre.leggauss(96)
    azimuth = (np.arange(192) + 0.5) * (2.0 * np.pi / 192)
    up, turn = (g.ravel() for g in np.meshgrid(0.5 * (nodes + 1.0), azimuth, indexing="ij"))
    sine = np.sqrt(1.0 - up**2)
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), up], axis=1), np.repeat(weights, 192) * (np.pi / 192)


# Squares of the harmonics' norms, n²/4π, times what the cosine kernel leaves of their order: π, 2π/3, π/4.
_KERNEL = np.array([1 / 4, 1 / 2, 1 / 2, 1 / 2, 15 / 16, 15 / 16, 5 / 64, 15 / 16, 15 / 64])


def _basis(normals: Array) -> Array:
    """1, y, z, x, xy, yz, 3z² − 1, xz, x² − y²: the real harmonics to order 2 but for their norms, (n, 9)."""
    x, y, z = normals.T
    return np.stack([np.ones_like(x), y, z, x, x * y, y * z, 3.0 * z * z - 1.0, x * z, x * x - y * y], axis=1)


def _tabulated(radiance: Callable[[Array], Array]) -> NDArray[np.float32]:
    side = np.linspace(-1.0, 1.0, TABLE)
    plus, minus = (g.ravel() for g in np.meshgrid(side, side, indexing="ij"))
    px, py = 0.5 * (plus + minus), 0.5 * (plus - minus)
    directions = np.stack([px, py, np.maximum(1.0 - np.abs(px) - np.abs(py), 0.0)], axis=1)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return radiance(directions).reshape(TABLE, TABLE, 3).astype(np.float32)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba's are
def _to_display(radiance: Array, scale: Array, out: NDArray[np.uint8]) -> None:
    for n in range(radiance.shape[0]):
        y = 0.2126 * scale[0] * radiance[n, 0] + 0.7152 * scale[1] * radiance[n, 1] + 0.0722 * scale[2] * radiance[n, 2]
        gain = (1.0 + y / WHITE**2) / (1.0 + y)
        y *= gain
        highest = gain * max(scale[0] * radiance[n, 0], scale[1] * radiance[n, 1], scale[2] * radiance[n, 2])
        kept = 1.0 if highest <= 1.0 else max((1.0 - y) / (highest - y), 0.0) if highest > y else 0.0
        for c in range(3):
            value = min(max(y + kept * (scale[c] * radiance[n, c] * gain - y), 0.0), 1.0)
            encoded = 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1.0 / 2.4) - 0.055
            out[n, c] = np.uint8(255.0 * encoded + 0.5)
