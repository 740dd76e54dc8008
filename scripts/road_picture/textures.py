"""Random textures: a random stream goes in, functions that give a tone at texel coordinates come out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .maths import Array


class NoiseTile:
    """Periodic random texture with zero mean and unit deviation, made from a power-law spectrum."""

    def __init__(self, rng: np.random.Generator, slope: float, size: int = 512, low_cut: float = 2.0) -> None:
        """Make a tile of ``size`` squared texels; shapes repeat at least ``low_cut`` times across it."""
        frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :]) * size
        spectrum = np.where(frequency >= low_cut, np.maximum(frequency, 1.0) ** -slope, 0.0)
        values = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((size, size))) * spectrum)
        self.size = size
        self.values = (values / values.std()).astype(np.float32)

    def __call__(self, u: Array, v: Array) -> Array:
        """Bilinear value at texel coordinates."""
        u0, v0 = np.floor(u), np.floor(v)
        fu, fv = (u - u0).astype(np.float32), (v - v0).astype(np.float32)
        i0, j0 = u0.astype(np.int64) % self.size, v0.astype(np.int64) % self.size
        i1, j1 = (i0 + 1) % self.size, (j0 + 1) % self.size
        near = self.values[i0, j0] * (1 - fv) + self.values[i0, j1] * fv
        far = self.values[i1, j0] * (1 - fv) + self.values[i1, j1] * fv
        return near * (1 - fu) + far * fu

    def nearest(self, u: Array, v: Array) -> Array:
        """Value of the nearest texel, for grain that supersampling averages anyway."""
        return self.values[np.rint(u).astype(np.int64) % self.size, np.rint(v).astype(np.int64) % self.size]


@dataclass
class Textures:
    """Random textures of the scene."""

    grain: NoiseTile  # no correlation from texel to texel
    patchy: NoiseTile  # blotches of many sizes
    cloudy: NoiseTile  # smooth, dominated by large shapes


def make_textures(rng: np.random.Generator) -> Textures:
    """All textures from one random stream."""
    return Textures(NoiseTile(rng, 0.15), NoiseTile(rng, 1.1), NoiseTile(rng, 1.75, 1024, 4.0))
