"""Rays in, how much of each a distant edge of a wood hides and what it looks like there out: the country's skyline.

Two curtains along the road, without triangles; noise makes their height and colour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from raytrace.errors import SceneError
from raytrace.scene.shading import SurfaceInteraction

Array = NDArray[np.float64]

GREEN = (0.034, 0.052, 0.020)  # reflectance of leaves in the mass, linear sRGB
TALLEST = 1.4  # over the mean height
OPEN = 0.55  # share of its surroundings that a place on the edge sees: leaves hide each other
# An edge is bulges of crowns: its mean face looks half outward, half up.
OUTWARD, UPWARD = 0.80, 0.60


@dataclass(frozen=True, slots=True)
class Woods:
    """Edges of woods at Y = ±distance_mm, some height_mm high, with gaps."""

    distance_mm: float = 140_000.0
    height_mm: float = 13_000.0

    def __post_init__(self) -> None:
        if not (0.0 < self.distance_mm < np.inf and 0.0 < self.height_mm < np.inf):
            raise SceneError(f"woods need a distance and a height above 0, not {self.distance_mm} and {self.height_mm} mm")

    def met(self, origins: Array, directions: Array, spread: Array, radius: Array, nearest: Array, sun: Array,
            ) -> tuple[SurfaceInteraction, Array, Array]:
        """Points of the edges that rays meet before `nearest` (n,), the share of each ray that they hide, and reflectance."""
        n = len(directions)
        found, share, diffuse = SurfaceInteraction.empty(n), np.empty(n), np.empty((n, 3))
        k = _met(origins, directions, spread, radius, nearest, self.distance_mm, self.height_mm, sun, found, share, diffuse)
        return found.rows(slice(0, k)), share[:k], diffuse[:k]


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba's are
def _random(i: int, j: int) -> float:
    h = i * -7046029254386353131 + j * -4417276706812531889
    h = (h ^ (h >> 29)) * -4658895280553007687
    return float((h >> 40) & 0xFFFFFF) / 16777216.0


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _noise(x: float, y: float) -> float:
    """Value noise, −1 … 1, with waves of length 1."""
    i, j = np.floor(x), np.floor(y)
    a, b = x - i, y - j
    a, b = a * a * (3.0 - 2.0 * a), b * b * (3.0 - 2.0 * b)
    m, n = int(i), int(j)
    low = _random(m, n) * (1.0 - a) + _random(m + 1, n) * a
    high = _random(m, n + 1) * (1.0 - a) + _random(m + 1, n + 1) * a
    return 2.0 * (low * (1.0 - b) + high * b) - 1.0


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _skyline(x: float, half: float, side: float, square: float) -> float:
    """Height over the mean one, −1 … 1 or so; waves that `half` of the ray's width covers are left out.

    square : how squarely the edge is seen, 0 … 1. Seen along it, crowns fill the notches between those before them.
    """
    value = 0.85 * _noise(x / 310_000.0, 7.0 * side) + 0.30 * _noise(x / 71_000.0, 7.0 * side + 1.5)
    # Crowns are round above and meet in notches, as the noise's amount does.
    for wave, share in ((17_000.0, 0.24), (6100.0, 0.20), (2300.0, 0.08)):
        value += square * share * (2.0 * abs(_noise(x / wave, 7.0 * side + wave)) - 0.75) / (1.0 + 2.0 * half / wave)
    return value


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _met(origins: Array, directions: Array, spread: Array, radius: Array, nearest: Array, distance: float, height: float,
         sun: Array, out: SurfaceInteraction, share: Array, diffuse: Array) -> int:
    one = origins.shape[0] == 1
    k = 0
    for n in range(directions.shape[0]):
        o, d = origins[0 if one else n], directions[n]
        side = 1.0 if d[1] > 0.0 else -1.0
        if d[1] == 0.0:
            continue
        t = (side * distance - o[1]) / d[1]
        half = radius[n] + spread[n] * t
        z = o[2] + t * d[2]
        if not 0.0 < t < nearest[n] or z > TALLEST * height + half or z < -half:
            continue
        x = o[0] + t * d[0]
        square = max(abs(d[1]) / np.sqrt(d[0] * d[0] + d[1] * d[1]), 1e-6)
        wide = half / square  # of the ray along the curtain
        top = height * min(0.62 + _skyline(x, wide, side, square), TALLEST)
        # The foot is at Z = 0, where the ground before it ends.
        hidden = min(max(0.5 + 0.5 * (top - z) / half, 0.0), 1.0) * min(max(0.5 + 0.5 * z / half, 0.0), 1.0)
        if hidden <= 0.0:
            continue
        crowns = 0.0
        for wave, part in ((5200.0, 0.26), (2100.0, 0.24), (800.0, 0.20)):
            fade = np.sqrt((1.0 + 2.0 * wide / wave) * (1.0 + 2.0 * half / wave))
            crowns += part * _noise(x / wave, z / (0.8 * wave) + 31.0 * side) / fade
        tone = (0.62 + 0.42 * min(max(z / max(top, 1.0), 0.0), 1.0)) * (1.0 + crowns)
        hue = 0.5 + 0.5 * _noise(x / 38_000.0, 3.0 * side)
        share[k] = hidden
        for c in range(3):
            diffuse[k, c] = GREEN[c] * tone * (1.0 + hue * (0.35 if c == 0 else 0.12))
        out.ray[k], out.distance[k], out.radius[k] = n, t, half
        out.point[k, 0], out.point[k, 1], out.point[k, 2] = x, side * distance, z
        out.normal[k, 0], out.normal[k, 1], out.normal[k, 2] = 0.0, -side * OUTWARD, UPWARD
        out.sky[k], out.material[k] = OPEN, -1
        # Crowns stand in each other's light, but some always face the sun.
        out.to_sun[k] = 0.55 * max(sun[2] * UPWARD - side * sun[1] * OUTWARD, 0.0) + 0.10 * sun[2]
        k += 1
    return k
