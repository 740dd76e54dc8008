"""Errors of form that a mirror may have: plane waves of a stated wavelength, added to its exact surface."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import collocate_height

Array = NDArray[np.float64]

# Splines of degree 5 or more meet a wave's height to 1e-4 of its amplitude and its curvature to 0.2 %; those of a lower degree
# need more spans for that.
SPANS_A_WAVE = {3: 32, 4: 14}
USUAL_SPANS_A_WAVE = 6
MAX_PATCHES = 40_000  # of a surface with waves on it: some tenth of a second to make and to trace
COMPONENTS = 24  # of a random map: its heights are normally distributed to a few percent
BAND = 0.25  # of a random map's wavelength, to either side


@dataclass(frozen=True, slots=True, eq=False)
class Waves:
    """h(x, y) = Σ a·sin(k·(x cos α + y sin α) + φ), along z; convex mirrors are higher where it is positive.

    Attributes
    ----------
    amplitude : ndarray
        a, (n,), mm.
    wavelength : ndarray
        2π/k, (n,), mm.
    direction, phase : ndarray
        α and φ, (n,), radians.
    """

    amplitude: Array
    wavelength: Array
    direction: Array
    phase: Array

    def height(self, x: Array, y: Array) -> Array:
        """Evaluate h.

        Parameters
        ----------
        x, y : ndarray
            mm, of shapes that broadcast.
        """
        result = np.zeros(np.broadcast_shapes(np.shape(x), np.shape(y)))
        for a, length, alpha, phi in zip(self.amplitude, self.wavelength, self.direction, self.phase, strict=True):
            k = 2.0 * np.pi / length
            # sin(p + q) of a column and a row: no sine for each point of a grid
            p, q = k * np.cos(alpha) * x, k * np.sin(alpha) * y + phi
            result += a * (np.sin(p) * np.cos(q) + np.cos(p) * np.sin(q))
        return result


def wave(amplitude_mm: float, wavelength_mm: float, direction: float, phase: float) -> Waves:
    """Make one wave.

    Parameters
    ----------
    amplitude_mm, wavelength_mm : float
        Half of what is between crest and trough, and from crest to crest.
    direction, phase : float
        Radians: of the line from crest to crest to x, and at the mirror's centre.
    """
    return Waves(*(np.array([value]) for value in (amplitude_mm, wavelength_mm, direction, phase)))


def random_map(rms_mm: float, wavelength_mm: float, rng: np.random.Generator) -> Waves:
    """Draw a map of no direction from the band of wavelengths within BAND of the one that is stated.

    Parameters
    ----------
    rms_mm : float
        Its root mean square over a wide area.
    wavelength_mm : float
        The middle of its band.
    rng : Generator
        What is drawn from.
    """
    each = np.full(COMPONENTS, rms_mm * np.sqrt(2.0 / COMPONENTS))
    lengths = wavelength_mm * (1.0 + BAND * rng.uniform(-1.0, 1.0, COMPONENTS))
    return Waves(each, lengths, rng.uniform(0.0, np.pi, COMPONENTS), rng.uniform(0.0, 2.0 * np.pi, COMPONENTS))


def with_form_error(surface: BSplineSurface, waves: Waves) -> BSplineSurface:
    """Add waves to a surface z(x, y): on its own knots and so many more that the waves are held; it itself is kept exactly.

    Parameters
    ----------
    surface : BSplineSurface
        A height field over its parameters.
    waves : Waves
        What is added along z.
    """
    degree = max(surface.degree_u, surface.degree_v)
    span = float(waves.wavelength.min()) / _spans_a_wave(surface)
    knots_x, knots_y = _refined(surface.knots_u, span), _refined(surface.knots_v, span)

    def height(x: Array, y: Array) -> Array:
        return surface.on_grid(x[:, 0], y, component=2, order=0)["s"] + waves.height(x, y)

    return collocate_height(height, knots_x, knots_y, degree)


def shortest_wavelength(surface: BSplineSurface) -> float:
    """Find the shortest waves that a surface holds without more than MAX_PATCHES patches, mm.

    Parameters
    ----------
    surface : BSplineSurface
        Without them.
    """
    u0, u1, v0, v1 = surface.domain
    return _spans_a_wave(surface) * float(np.sqrt((u1 - u0) * (v1 - v0) / MAX_PATCHES))


def _spans_a_wave(surface: BSplineSurface) -> int:
    return SPANS_A_WAVE.get(max(surface.degree_u, surface.degree_v), USUAL_SPANS_A_WAVE)


def _refined(knots: Array, span: float) -> Array:
    """The knots, with more between them so that no span is longer."""
    ends = np.unique(knots)
    inner = [np.linspace(a, b, int(np.ceil((b - a) / span)) + 1)[1:-1] for a, b in pairwise(ends)]
    return np.sort(np.concatenate([knots, *inner]))
