"""The main figures of a made mirror: largest and RMS deviations, with the sigma and the interval of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.curvature_fields import QUANTITIES, Quantity
from mirror_cad.made.fields import DeviationFields
from mirror_cad.made.nominal import Nominal

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Point = tuple[float, float]

ARCMIN = 10800.0 / np.pi
COVERAGE = 1.959963984540054  # sigmas to either side that hold 95 %


@dataclass(frozen=True, slots=True)
class Figure:
    """One quantity over the mirror, in its own unit; all None where nothing is known.

    Attributes
    ----------
    largest : float or None
        The signed value of largest size.
    rms : float or None
        Root of the mean square by area.
    sigma : float or None
        Root of the mean square of the places' sigmas.
    at_mm : tuple or None
        Of the largest.
    sigma_at_largest : float or None
        The sigma of the largest.
    """

    largest: float | None = None
    rms: float | None = None
    sigma: float | None = None
    at_mm: Point | None = None
    sigma_at_largest: float | None = None

    @property
    def interval(self) -> tuple[float, float] | None:
        """Of the largest, 95 %."""
        if self.largest is None or self.sigma_at_largest is None:
            return None
        return self.largest - COVERAGE * self.sigma_at_largest, self.largest + COVERAGE * self.sigma_at_largest


@dataclass(frozen=True, slots=True)
class Figures:
    """The main figures.

    Attributes
    ----------
    height : Figure
        mm, over what was measured.
    slope : Figure
        Arc minutes between the normals, over what was measured.
    percent : dict
        Of k1, k2, kx, ky and twist, over where the gauge stands; of a plane nothing.
    per_m : dict
        The same in 1/m.
    measured_share, known_share : float
        Of the mirror near a measured point; of the places that the gauge fits on, where it stands on what was measured.
    """

    height: Figure
    slope: Figure
    percent: dict[Quantity, Figure]
    per_m: dict[Quantity, Figure]
    measured_share: float
    known_share: float


def figures(nominal: Nominal, fields: DeviationFields) -> Figures:
    """Take the main figures.

    Parameters
    ----------
    nominal : Nominal
        The design.
    fields : DeviationFields
        The deviation.
    """
    places, there = fields.lattice.places, fields.measured_there
    height = _figure(fields.height, fields.height_sigma, places, there)
    sloped = there & np.isfinite(fields.slope_x)
    slope = _figure(ARCMIN * slope_angles(nominal, fields), ARCMIN * fields.slope_sigma, places, sloped)
    percent: dict[Quantity, Figure] = {}
    per_m: dict[Quantity, Figure] = {}
    for quantity in QUANTITIES:
        value, sigma = getattr(fields.curvature, quantity), getattr(fields.curvature_sigma, quantity)
        per_m[quantity] = _figure(1e3 * value, 1e3 * sigma, places, fields.known)
        percent[quantity] = Figure() if fields.flat else _figure(*fields.percent(quantity), places, fields.known)
    known = float(fields.known.sum() / max(1, int(fields.fits.sum())))
    return Figures(height, slope, percent, per_m, float(there.mean()), known)


def slope_angles(nominal: Nominal, fields: DeviationFields) -> Array:
    """The angle between the measured and the designed normal at each place, (k,) radians.

    Parameters
    ----------
    nominal : Nominal
        The design.
    fields : DeviationFields
        The deviation.
    """
    places = fields.lattice.places
    _, zx, zy = nominal.heights(places[:, 0], places[:, 1])
    return angle_between_normals(zx, zy, fields.slope_x, fields.slope_y)


def angle_between_normals(zx: Array, zy: Array, dx: Array, dy: Array) -> Array:
    """The angle between the normals of a surface z(x, y) with slopes (zx, zy), and with slopes (zx + dx, zy + dy).

    2 asin(c/2) of the chord c between the unit normals, which keeps its digits where they are nearly one.

    Parameters
    ----------
    zx, zy, dx, dy : ndarray
        (k,).

    Returns
    -------
    ndarray
        (k,) radians.
    """
    before = np.stack([-zx, -zy, np.ones_like(zx)])
    after = np.stack([-zx - dx, -zy - dy, np.ones_like(zx)])
    chord = before / np.linalg.norm(before, axis=0) - after / np.linalg.norm(after, axis=0)
    result: Array = 2.0 * np.arcsin(0.5 * np.linalg.norm(chord, axis=0))
    return result


def _figure(values: Array, sigmas: Array, places: Array, counted: Mask) -> Figure:
    if not counted.any():
        return Figure()
    v, s, p = values[counted], sigmas[counted], places[counted]
    worst = int(np.argmax(np.abs(v)))
    return Figure(float(v[worst]), float(np.sqrt(np.mean(v**2))), float(np.sqrt(np.mean(s**2))),
                  (float(p[worst, 0]), float(p[worst, 1])), float(s[worst]))
