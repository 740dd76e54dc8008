"""A simulated bending of glass over a mould, to try the compensation on: it bends more at the edge, and springs back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.made.nominal import Nominal
from mirror_cad.surfaces.bspline import BSplineSurface

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedBending:
    """z_made = z_design + s·(z_mould − z_design) + b·(ρ² − ½)·ρ² + a·xy/r², with noise.

    ρ is the distance from the middle over r, half of the mirror's diagonal.

    Attributes
    ----------
    nominal : Nominal
        The design, which the glass relaxes to by 1 − s of what the mould differs from it.
    springback : float
        s.
    edge_mm, twist_mm : float
        b and a: how the edge curls and the corners twist, whatever the mould.
    noise_mm : float
        Of the measurement of a point.
    """

    nominal: Nominal
    springback: float = 0.88
    edge_mm: float = 0.6
    twist_mm: float = 0.3
    noise_mm: float = 0.005

    def measured(self, mould: BSplineSurface, pitch_mm: float, rng: np.random.Generator) -> Array:
        """Points (n, 3) of a mirror that was bent over a mould, mm.

        Parameters
        ----------
        mould : BSplineSurface
            Heights over (x, y), as the optical face would have them.
        pitch_mm : float
            Between points.
        rng : numpy.random.Generator
            Of the noise.
        """
        x_min, x_max, y_min, y_max = self.nominal.box
        x, y = (each.ravel() for each in np.meshgrid(np.arange(x_min, x_max, pitch_mm), np.arange(y_min, y_max, pitch_mm)))
        kept = self.nominal.outline.contains(x, y)
        x, y = x[kept], y[kept]
        z, _, _ = self.nominal.heights(x, y)
        r = 0.5 * self.nominal.size_mm
        rho2 = (x * x + y * y) / r**2
        bent = self.edge_mm * (rho2 - 0.5) * rho2 + self.twist_mm * x * y / r**2
        made = z + self.springback * (mould.sag(x, y) - z) + bent + self.noise_mm * rng.standard_normal(x.size)
        return np.stack([x, y, made], axis=1)
