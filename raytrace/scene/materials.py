"""What surfaces are made of in, the diffuse reflectance at places on them out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from raytrace.errors import SceneError

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Colour = tuple[float, float, float]

DIELECTRIC = (0.04, 0.04, 0.04)  # reflectance at normal incidence of plastics, paint and glass: ((n − 1)/(n + 1))², n = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """A diffuse base under a glossy surface.

    diffuse : reflectance of the base, linear sRGB, 0 … 1; times the texture where there is one.
    specular : reflectance of the surface at normal incidence (Schlick's F0), linear sRGB.
    roughness : its square is the width α of the GGX distribution of slopes; 0 is a mirror, 1 is matt.
    texture (h, w, 3) : sRGB, row 0 at v = 0, repeated beyond 0 … 1.
    opacity : the share of what is behind that the surface covers, 0 … 1; times `cover` (h, w), 0 … 255, laid as the texture.
    cutoff : where the surface covers less than this, there is none, and elsewhere it covers all; without it it is blended.
    Raises: SceneError for values outside 0 … 1 and for textures of another shape.
    """

    name: str
    diffuse: Colour
    specular: Colour = DIELECTRIC
    roughness: float = 1.0
    texture: Picture | None = None
    opacity: float = 1.0
    cover: Picture | None = None
    cutoff: float | None = None

    def __post_init__(self) -> None:
        for what, values in (("diffuse", self.diffuse), ("specular", self.specular), ("roughness", (self.roughness,)),
                             ("opacity", (self.opacity,))):
            if not all(0.0 <= value <= 1.0 for value in values):
                raise SceneError(f"material {self.name!r}: {what} {values} must lie from 0 to 1")
        if self.texture is not None and (self.texture.ndim != 3 or self.texture.shape[2] != 3 or not self.texture.size
                                         or self.texture.dtype != np.uint8):
            raise SceneError(f"material {self.name!r}: a texture is (h, w, 3) of uint8, not {self.texture.shape} of "
                             f"{self.texture.dtype}")
        if self.cover is not None and (self.cover.ndim != 2 or not self.cover.size or self.cover.dtype != np.uint8):
            raise SceneError(f"material {self.name!r}: a cover is (h, w) of uint8, not {self.cover.shape} of "
                             f"{self.cover.dtype}")
        if self.cutoff is not None and not self.cutoff >= 0.0:
            raise SceneError(f"material {self.name!r}: cutoff {self.cutoff} must be 0 or more")

    @property
    def whole(self) -> bool:
        """Whether it covers all that is behind it, wherever it is."""
        return self.cutoff is None and self.opacity == 1.0 and self.cover is None

    @property
    def mean_cover(self) -> float:
        """The share of what is behind that it covers, in the mean over its picture."""
        share = self.opacity * (np.ones((1, 1)) if self.cover is None else self.cover / 255.0)
        return float((share if self.cutoff is None else share >= self.cutoff).mean())


class Palette(NamedTuple):
    """Materials as kernels read them.

    diffuse, specular (k, 3), roughness (k,).
    first, levels_of (k,) : where a material's texture has its levels in `levels`, and how many; 0 without a texture.
    levels (m, 3) : offset into texels, rows, columns, each level half as large as the one before.
    texels : sRGB values of all levels.
    """

    diffuse: Array
    specular: Array
    roughness: Array
    first: NDArray[np.int64]
    levels_of: NDArray[np.int64]
    levels: NDArray[np.int64]
    texels: Picture

    @staticmethod
    def of(materials: Sequence[Material]) -> Palette:
        """Textures that are the same array are held once."""
        levels: list[tuple[int, int, int]] = []
        texels: list[Picture] = []
        known: dict[int, tuple[int, int]] = {}
        size = 0
        for material in materials:
            if material.texture is None or id(material.texture) in known:
                continue
            pyramid = _pyramid(material.texture)
            known[id(material.texture)] = len(levels), len(pyramid)
            for level in pyramid:
                levels.append((size, level.shape[0], level.shape[1]))
                texels.append(level.ravel())
                size += level.size
        where = np.array([known.get(id(m.texture), (0, 0)) for m in materials], dtype=np.int64).reshape(-1, 2)
        return Palette(np.array([m.diffuse for m in materials], dtype=np.float64).reshape(-1, 3),
                       np.array([m.specular for m in materials], dtype=np.float64).reshape(-1, 3),
                       np.array([m.roughness for m in materials], dtype=np.float64),
                       np.ascontiguousarray(where[:, 0]), np.ascontiguousarray(where[:, 1]),
                       np.array(levels, dtype=np.int64).reshape(-1, 3), np.concatenate(texels or [np.zeros(0, np.uint8)]))


def linear(srgb: Any) -> Array:
    """Linear values 0 … 1 of sRGB values 0 … 255 (IEC 61966-2-1)."""
    value = np.asarray(srgb, dtype=np.float64) / 255.0
    result: Array = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return result


LINEAR = linear(np.arange(256))


def _pyramid(picture: Picture) -> list[Picture]:
    """The picture and its halves down to one element: means of the light, not of the coded values."""
    from PIL import Image

    levels = [np.ascontiguousarray(picture)]
    light = LINEAR[picture].astype(np.float32)
    while max(light.shape[:2]) > 1:
        rows, columns = max(light.shape[0] // 2, 1), max(light.shape[1] // 2, 1)
        light = np.stack([np.asarray(Image.fromarray(light[..., c]).resize((columns, rows), Image.Resampling.BOX))
                          for c in range(3)], axis=2)
        coded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0) ** (1.0 / 2.4) - 0.055)
        levels.append(np.rint(255.0 * np.clip(coded, 0.0, 1.0)).astype(np.uint8))
    return levels


def diffuse_colours(palette: Palette, material: NDArray[np.int32], uv: Array, extent: Array, out: Array) -> None:
    """Diffuse reflectance (n, 3) into `out` of places with a material each, at uv (n, 2).

    extent (n,) : what one ray covers, in u and v: the textures' light is averaged over about as much (trilinear).
    """
    _diffuse(palette.diffuse, palette.first, palette.levels_of, palette.levels, palette.texels, LINEAR, material, uv, extent,
             out)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba's are
def _bilinear(levels: NDArray[np.int64], texels: Picture, light: Array, level: int, u: float, v: float, c: int) -> float:
    offset, rows, columns = levels[level, 0], levels[level, 1], levels[level, 2]
    row, column = (v - np.floor(v)) * rows - 0.5, (u - np.floor(u)) * columns - 0.5
    i, j = np.floor(row), np.floor(column)
    a, b = row - i, column - j
    i0, j0 = int(i) % rows, int(j) % columns
    i1, j1 = (i0 + 1) % rows, (j0 + 1) % columns
    above = (1.0 - b) * light[texels[offset + 3 * (i0 * columns + j0) + c]] \
        + b * light[texels[offset + 3 * (i0 * columns + j1) + c]]
    below = (1.0 - b) * light[texels[offset + 3 * (i1 * columns + j0) + c]] \
        + b * light[texels[offset + 3 * (i1 * columns + j1) + c]]
    return float((1.0 - a) * above + a * below)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _diffuse(diffuse: Array, first: NDArray[np.int64], levels_of: NDArray[np.int64], levels: NDArray[np.int64], texels: Picture,
             light: Array, material: NDArray[np.int32], uv: Array, extent: Array, out: Array) -> None:
    for n in range(material.size):
        m = material[n]
        for c in range(3):
            out[n, c] = diffuse[m, c]
        if levels_of[m] == 0 or not np.isfinite(uv[n, 0] + uv[n, 1]):
            continue
        covered = extent[n] * np.sqrt(levels[first[m], 1] * levels[first[m], 2])
        fine = min(max(np.log2(covered), 0.0), levels_of[m] - 1.0) if covered > 1.0 else 0.0
        level = min(int(fine), max(levels_of[m] - 2, 0))
        share = fine - level
        for c in range(3):
            value = _bilinear(levels, texels, light, first[m] + level, uv[n, 0], uv[n, 1], c)
            if share > 0.0:
                value += share * (_bilinear(levels, texels, light, first[m] + level + 1, uv[n, 0], uv[n, 1], c) - value)
            out[n, c] *= value
