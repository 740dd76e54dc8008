"""25 places of a made mirror to be measured again by hand: designed and measured height and radii, each with its interval."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mirror_cad.made.figures import COVERAGE
from mirror_cad.made.inspection import Inspection
from mirror_studio.report.probe import probe
from mirror_studio.report.text import MISSING, fixed, number

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ProbePlaces:
    """Places of the lattice that are nearest to the report's probe points of the design.

    Attributes
    ----------
    at : ndarray
        (n, 2), mm.
    z, height, height_sigma : ndarray
        (n,), mm: of the design, and what the mirror deviates by; NaN where it is not known.
    designed, measured, sigma : ndarray
        (n, 2), curvature along x and y of the tangent frame (kx, ky), 1/mm.
    """

    at: Array
    z: Array
    height: Array
    height_sigma: Array
    designed: Array
    measured: Array
    sigma: Array

    def write(self, path: Path) -> None:
        """Write a row a place as CSV.

        Parameters
        ----------
        path : Path
            Of the file.
        """
        columns = np.column_stack([self.at, self.z, self.height, self.height_sigma, 1e3 * self.designed, 1e3 * self.measured,
                                   1e3 * self.sigma])
        with path.open("w", encoding="utf-8") as stream:
            stream.write("x_mm,y_mm,z_designed_mm,height_mm,height_sigma_mm,kx_designed_per_m,ky_designed_per_m,"
                         "kx_measured_per_m,ky_measured_per_m,kx_sigma_per_m,ky_sigma_per_m\n")
            for row in columns:
                stream.write(",".join("" if np.isnan(value) else f"{value:.9g}" for value in row) + "\n")

    def rows(self) -> list[tuple[str, ...]]:
        """As the report shows them: number, place, height in µm with 95 %, and both radii, designed and measured with 95 %."""
        out = []
        for k, (x, y) in enumerate(self.at):
            radii = []
            for c in (0, 1):
                radii += [_radius(self.designed[k, c]), _radius_interval(self.measured[k, c], self.sigma[k, c])]
            height = (MISSING if np.isnan(self.height[k]) else
                      f"{number(1e3 * self.height[k], sign=True)} ± {number(1e3 * COVERAGE * self.height_sigma[k], 2)}")
            out.append((str(k + 1), fixed(float(x), 1), fixed(float(y), 1), height, *radii))
        return out


def probe_places(found: Inspection) -> ProbePlaces:
    """Take what is known at 25 places.

    Parameters
    ----------
    found : Inspection
        The mirror.
    """
    fields, nominal = found.fields, found.nominal
    wanted = probe(nominal.surface, nominal.outline).points[:, :2]
    rows = cKDTree(fields.lattice.places).query(wanted)[1]
    at = fields.lattice.places[rows]
    known = fields.known[rows][:, None]
    before, after = (np.stack([w.w11[rows], w.w22[rows]], axis=1) for w in (fields.designed, fields.measured))
    sigma = np.stack([fields.curvature_sigma.kx[rows], fields.curvature_sigma.ky[rows]], axis=1)
    return ProbePlaces(at, nominal.heights(at[:, 0], at[:, 1])[0], fields.height[rows], fields.height_sigma[rows], before,
                       np.where(known, after, np.nan), np.where(known, sigma, np.nan))


def _radius(kappa: float) -> str:
    return MISSING if np.isnan(kappa) else "flat" if abs(kappa) < 1e-9 else fixed(1.0 / float(kappa), 1)


def _radius_interval(kappa: float, sigma: float) -> str:
    """R with the half-width that 95 % of κ make of it."""
    if np.isnan(kappa) or np.isnan(sigma):
        return MISSING
    if abs(kappa) <= COVERAGE * sigma:
        return "flat within its interval"
    return f"{fixed(1.0 / float(kappa), 1)} ± {number(COVERAGE * float(sigma) / float(kappa) ** 2, 2)}"
