"""κ(x), what every law comes to: the curvature at x, and where it is less than smooth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirror_cad.errors import SpecError
from mirror_cad.keys import SMALLEST_RADIUS_MM

if TYPE_CHECKING:
    from mirror_cad.surfaces.piecewise import PiecewiseChebyshev

Array = NDArray[np.float64]
Function = Callable[[Array], Array]

SMOOTH = 99  # continuous derivatives of a law where it has no break worth a knot
LARGEST_CURVATURE = 1.0 / SMALLEST_RADIUS_MM  # 1/mm: a pole in a formula passes it at once
# A piece of the series narrower than this marks a kink or jump that the law's text does not announce (an expression
# with min or max, say): halving stops there at some 1e-4 mm, and nothing smooth needs pieces of less than 0.01 mm.
HIDDEN_BREAK_MM = 5e-3
MAX_ANNOUNCED = 1000


@dataclass(frozen=True, slots=True)
class Span:
    """The law's variable: t = 0 at `right_mm`, 1 at `left_mm`, held at 0 and 1 beyond."""

    left_mm: float
    right_mm: float

    def t(self, x: ArrayLike) -> Array:
        """Return t at x, mm."""
        return np.clip((self.right_mm - np.asarray(x, dtype=np.float64)) / (self.right_mm - self.left_mm), 0.0, 1.0)

    def x(self, t: float) -> float:
        """Return x, mm, at t."""
        return self.right_mm - t * (self.right_mm - self.left_mm)


@dataclass(frozen=True, slots=True)
class Break:
    """A point where only `smoothness` derivatives of κ are continuous: −1 is a jump, 0 a kink."""

    x_mm: float
    smoothness: int


@dataclass(frozen=True, slots=True, eq=False)
class CurvatureLaw:
    """κ(x) in 1/mm, convex positive, on the whole line.

    Attributes
    ----------
    function : callable
        x (n,), mm -> κ (n,), 1/mm.
    breaks : tuple of Break
        Where κ is less than smooth, in rising x.
    description : str
        In messages.
    """

    function: Function
    breaks: tuple[Break, ...]
    description: str = field(default="law")

    def at(self, x: Array) -> Array:
        """Evaluate κ at x (n,), 1/mm, infinite or NaN and without a warning where the law has no value there."""
        with np.errstate(all="ignore"):
            return self.function(x)

    def series(self, x_min: float, x_max: float) -> PiecewiseChebyshev:
        """Make κ on [x_min, x_max] a series, to rounding error.

        Raises
        ------
        SpecError
            Where κ is not finite or above LARGEST_CURVATURE, with the point.
        """
        from mirror_cad.surfaces.piecewise import (
            approximate,  # compiled: loaded where a law is worked with, not where one is read
        )

        def checked(x: Array) -> Array:
            kappa = self.at(x)
            bad = ~(np.abs(kappa) <= LARGEST_CURVATURE)
            if bad.any():
                value = f"{kappa[bad][0]:.3g} per mm" if np.isfinite(kappa[bad][0]) else "not finite"
                raise SpecError(f"{self.description}: the curvature is {value} at x = {x[bad][0]:.6g} mm; no mirror has a "
                                f"radius below {1 / LARGEST_CURVATURE:g} mm: change the law there")
            return kappa

        # Beyond so many, the soft ones (a long table's nodes) are found where they matter, and cost nothing where not.
        few = len(self.breaks) <= MAX_ANNOUNCED
        inner = sorted(b.x_mm for b in self.breaks if x_min < b.x_mm < x_max and (few or b.smoothness < 2))
        return approximate(checked, [x_min, *inner, x_max])

    def all_breaks(self, series: PiecewiseChebyshev) -> tuple[Break, ...]:
        """The announced breaks inside the series' interval and those that only its pieces show.

        A kink that nobody announced either has pieces crowd around it, or lies by chance just where two pieces meet.
        """
        x_min, x_max = float(series.breaks[0]), float(series.breaks[-1])
        found = [b for b in self.breaks if x_min < b.x_mm < x_max]
        for x in series.tight_breaks(HIDDEN_BREAK_MM):
            if x - x_min > 1e-3 and x_max - x > 1e-3 and all(abs(x - b.x_mm) > 1e-3 for b in found):
                left, right = self.at(np.array([x - 1e-4, x + 1e-4]))
                jump = abs(right - left) > 1e-3 * float(np.abs(series.coefficients).max())
                found.append(Break(x, -1 if jump else 0))
        for x, smoothness in series.breakpoints():
            if all(abs(x - b.x_mm) > 1e-3 for b in found):
                found.append(Break(x, smoothness))
        return tuple(sorted(found, key=lambda b: b.x_mm))


def over_t(radius: Function, span: Span, breaks: dict[float, int], description: str) -> CurvatureLaw:
    """Make the law κ(x) = 1/R(t(x)) of a radius over t, mm.

    Parameters
    ----------
    radius : callable
        t (n,) -> R (n,), finite and of one sign.
    span : Span
        Where t is 0 and 1.
    breaks : dict
        How many derivatives are continuous at t, by t.
    description : str
        The law in words.
    """
    at = sorted((Break(span.x(t), smoothness) for t, smoothness in breaks.items()), key=lambda b: b.x_mm)
    return CurvatureLaw(lambda x: 1.0 / radius(span.t(x)), tuple(at), description)


def smooth_extrapolation(law: CurvatureLaw, x_min: float, x_max: float, largest: float) -> CurvatureLaw:
    """Continue a law beyond [x_min, x_max] without a kink: κ, κ′ and κ″ go on and level off.

    κ(e + d) = κ(e) + κ′·L·tanh(d/L) + κ″/2·(L·tanh(d/L))², with the one-sided derivatives at the edge e and L a
    tenth of the width, or less where |κ| would come more than half the way from κ(e) to `largest`. A vertical law needs
    this: its kink at the mirror's edge would be a crease in the surface around the mirror, where a cutter still has to run
    (docs/decisions/0002-sheet-beyond-the-outline.md).
    """
    inside = law.series(x_min, x_max)
    first = inside.derivative()
    second = first.derivative()
    lengths = {}
    for edge in (x_min, x_max):
        margin = 0.5 * max(largest - abs(float(inside(edge))), 0.0)
        slope, bend = abs(float(first(edge))), abs(float(second(edge)))
        longest = 0.1 * (x_max - x_min)
        wanted = min([longest, *([0.5 * margin / slope] if slope else []), *([np.sqrt(margin / bend)] if bend else [])])
        lengths[edge] = max(wanted, 1e-6 * longest)

    def kappa(x: Array) -> Array:
        edge = np.clip(x, x_min, x_max)
        length = np.where(x < x_min, lengths[x_min], lengths[x_max])
        eased = length * np.tanh((x - edge) / length)
        beyond = inside(edge) + first(edge) * eased + 0.5 * second(edge) * eased**2
        return np.where(x == edge, law.function(edge), beyond)

    inner = tuple(b for b in law.breaks if x_min < b.x_mm < x_max)
    return CurvatureLaw(kappa, (Break(x_min, 2), *inner, Break(x_max, 2)), law.description)
