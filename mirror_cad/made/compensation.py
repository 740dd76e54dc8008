"""The next mould from measured mirrors of the last one: what they deviate by, taken away from it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SurfaceError
from mirror_cad.made.nominal import Nominal
from mirror_cad.made.spline_fit import DEGREE, SplineFit
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import collocate_height

Array = NDArray[np.float64]

FORMED_SPAN = 0.05  # of the mirror's size: spans on which an offset of its surface is exact to a nanometre
MAPPING_STEPS = 20  # of the place on the glass that lies on a place of the mould; each leaves thickness·curvature of the error


@dataclass(frozen=True, slots=True)
class Forming:
    """How glass takes the form of its mould.

    Attributes
    ----------
    gain : float
        g, of the deviation that is taken away at once.
    springback : float
        s, by how much the glass follows a change of the mould: 1 wholly, 0.9 if it springs back by a tenth.
    shrink : float
        ρ: the mould is 1 + ρ times as large as the glass that comes from it.
    offset_mm : float
        From the optical face to the mould along the normal: the thickness of the glass that lies between, positive where the
        mould lies behind it, 0 where the optical face itself touches the mould.
    """

    gain: float = 1.0
    springback: float = 1.0
    shrink: float = 0.0
    offset_mm: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Deviations:
    """What mirrors of one mould deviate by, on the average.

    Attributes
    ----------
    fits : tuple of SplineFit
        The smoothed deviation of each.
    """

    fits: tuple[SplineFit, ...]

    def mean(self, x: Array, y: Array) -> Array:
        """The mean deviation, (n,) mm; beyond what a spline reaches over, its value at its edge.

        Parameters
        ----------
        x, y : ndarray
            (n,), mm.
        """
        return np.mean([_clipped(fit, x, y) for fit in self.fits], axis=0)

    def sigma(self, x: Array, y: Array) -> Array | None:
        """The standard uncertainty of the mean from the scatter between the mirrors, (n,) mm; None for a single one.

        Parameters
        ----------
        x, y : ndarray
            (n,), mm.
        """
        if len(self.fits) < 2:
            return None
        scatter = np.std([_clipped(fit, x, y) for fit in self.fits], axis=0, ddof=1)
        return np.asarray(scatter / np.sqrt(len(self.fits)))


def first_mould(nominal: Nominal, forming: Forming) -> BSplineSurface:
    """The mould whose mirrors would be the design, if glass took its form: larger by the shrink, off by the glass.

    Parameters
    ----------
    nominal : Nominal
        The design.
    forming : Forming
        How glass is formed.
    """
    if forming.shrink == 0.0 and forming.offset_mm == 0.0:
        return nominal.surface
    surface, scale = nominal.surface, 1.0 + forming.shrink
    degree = max(surface.degree_u, surface.degree_v, DEGREE)
    room, domain = abs(forming.offset_mm), surface.domain
    knots = [_between(scale * own, scale * (domain[2 * k] + room), scale * (domain[2 * k + 1] - room),
                      scale * FORMED_SPAN * nominal.size_mm, degree)
             for k, own in enumerate((surface.knots_u, surface.knots_v))]

    def height(x: Array, y: Array) -> Array:
        shape = np.broadcast_shapes(x.shape, y.shape)
        glass_x, glass_y = _on_glass(nominal, forming, *(each.ravel() for each in np.broadcast_arrays(x, y)))
        z, zx, zy = nominal.heights(glass_x, glass_y)
        return np.asarray(scale * (z - forming.offset_mm / np.sqrt(1.0 + zx * zx + zy * zy))).reshape(shape)

    return collocate_height(height, knots[0], knots[1], degree)


def next_mould(nominal: Nominal, mould: BSplineSurface | None, deviations: Deviations, forming: Forming) -> BSplineSurface:
    """z_mould − (g/s)·d, where d is the deviation of the place on the glass that lies there.

    Parameters
    ----------
    nominal : Nominal
        The design.
    mould : BSplineSurface or None
        Of the measured mirrors, heights over (x, y); that of `first_mould` without one.
    deviations : Deviations
        Of the mirrors.
    forming : Forming
        How glass is formed.

    Raises
    ------
    SurfaceError
        For a mould that has no heights over (x, y).
    """
    last = first_mould(nominal, forming) if mould is None else mould
    if not last.is_height_field:
        raise SurfaceError("the mould is no surface of heights over (x, y): export it as one face of a B-spline with u = x, v "
                           "= y")
    scale = 1.0 + forming.shrink
    step = scale * forming.gain / forming.springback

    def height(x: Array, y: Array) -> Array:
        z = last.on_grid(x[:, 0], y, component=2, order=0)["s"]
        at = _on_glass(nominal, forming, *(each.ravel() for each in np.broadcast_arrays(x, y)))
        return np.asarray(z - step * deviations.mean(*at).reshape(z.shape))

    degree = max(last.degree_u, last.degree_v, DEGREE)
    span = min(min(fit.space.span_mm) for fit in deviations.fits)
    # No farther than all deviations are known: beyond, there would be a crease.
    boxes = np.array([fit.space.box for fit in deviations.fits])
    room = abs(forming.offset_mm)
    low = np.maximum(scale * (boxes[:, [0, 2]].max(axis=0) + room), last.domain[0::2])
    high = np.minimum(scale * (boxes[:, [1, 3]].min(axis=0) - room), last.domain[1::2])
    knots = [_between(own, low[k], high[k], scale * span, degree) for k, own in enumerate((last.knots_u, last.knots_v))]
    return collocate_height(height, knots[0], knots[1], degree)


def _on_glass(nominal: Nominal, forming: Forming, x: Array, y: Array) -> tuple[Array, Array]:
    """The place (x, y) of the optical face that lies on a place of the mould."""
    scale = 1.0 + forming.shrink
    glass_x, glass_y = x / scale, y / scale
    if forming.offset_mm == 0.0:
        return glass_x, glass_y
    for _ in range(MAPPING_STEPS):
        _, zx, zy = nominal.heights(glass_x, glass_y)
        n = np.sqrt(1.0 + zx * zx + zy * zy)
        # The mould's point is S − t·N, of which x is x_glass + t·z_x/n.
        glass_x, glass_y = x / scale - forming.offset_mm * zx / n, y / scale - forming.offset_mm * zy / n
    return glass_x, glass_y


def _clipped(fit: SplineFit, x: Array, y: Array) -> Array:
    x_min, x_max, y_min, y_max = fit.space.box
    return fit.heights(np.clip(x, x_min, x_max), np.clip(y, y_min, y_max))


def _between(knots: Array, low: float, high: float, span: float, degree: int) -> Array:
    """Clamped simple knots from low to high, with those there are, whose spans are no longer than `span`."""
    ends = np.unique(np.concatenate([[low], knots[(knots > low) & (knots < high)], [high]]))
    parts = [np.linspace(a, b, max(1, int(np.ceil((b - a) / span))) + 1)[:-1] for a, b in pairwise(ends)]
    inner = np.concatenate(parts)[1:]
    return np.concatenate([np.full(degree + 1, ends[0]), inner, np.full(degree + 1, ends[-1])])
