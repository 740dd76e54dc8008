"""Curvature laws: the position x along the horizontal in, the curvature κ(x) and the places where it breaks out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from mirror_cad.errors import SpecError
from mirror_cad.formula import parse_formula
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev, approximate

Array = NDArray[np.float64]

SMOOTH = 99  # continuous derivatives of a law where it has no break worth a knot
LARGEST_CURVATURE = 1.0  # 1/mm: a pole in a formula passes it at once, a radius that any mirror has never does
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
        return np.clip((self.right_mm - np.asarray(x, dtype=np.float64)) / (self.right_mm - self.left_mm), 0.0, 1.0)

    def x(self, t: float) -> float:
        return self.right_mm - t * (self.right_mm - self.left_mm)


@dataclass(frozen=True, slots=True)
class Break:
    """A place where only `smoothness` derivatives of κ are continuous: −1 is a jump, 0 a kink."""

    x_mm: float
    smoothness: int


@dataclass(frozen=True, slots=True, eq=False)
class CurvatureLaw:
    """κ(x) in 1/mm, convex positive, on the whole line.

    function : x (n,) -> κ (n,).   breaks : where κ is less than smooth, in rising x.
    """

    function: Callable[[Array], Array]
    breaks: tuple[Break, ...]
    description: str = field(default="law")

    def series(self, x_min: float, x_max: float) -> PiecewiseChebyshev:
        """κ on [x_min, x_max] to rounding error.

        Raises: SpecError where κ is not finite or above LARGEST_CURVATURE, with the place.
        """

        def checked(x: Array) -> Array:
            kappa = self.function(x)
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
                left, right = self.function(np.array([x - 1e-4, x + 1e-4]))
                jump = abs(right - left) > 1e-3 * float(np.abs(series.coefficients).max())
                found.append(Break(x, -1 if jump else 0))
        for x, smoothness in series.joints():
            if all(abs(x - b.x_mm) > 1e-3 for b in found):
                found.append(Break(x, smoothness))
        return tuple(sorted(found, key=lambda b: b.x_mm))


def _over_t(radius: Callable[[Array], Array], span: Span, breaks: dict[float, int], description: str) -> CurvatureLaw:
    places = sorted((Break(span.x(t), smoothness) for t, smoothness in breaks.items()), key=lambda b: b.x_mm)
    return CurvatureLaw(lambda x: 1.0 / radius(span.t(x)), tuple(places), description)


def constant(radius_mm: float) -> CurvatureLaw:
    """κ = 1/R; R = inf is flat."""
    return CurvatureLaw(lambda x: np.full(np.shape(x), 1.0 / radius_mm), (), "constant law")


def linear(right_mm: float, left_mm: float, span: Span) -> CurvatureLaw:
    """R = right + (left − right)·t."""
    breaks = {} if right_mm == left_mm else {0.0: 0, 1.0: 0}
    return _over_t(lambda t: right_mm + (left_mm - right_mm) * t, span, breaks, "linear law")


def power(right_mm: float, left_mm: float, exponent: float, span: Span) -> CurvatureLaw:
    """R = right + (left − right)·t^exponent."""
    at_zero = int(np.ceil(exponent)) - 1  # t^n with t held at 0 beyond has ⌈n⌉ − 1 continuous derivatives at 0
    breaks = {} if right_mm == left_mm else {0.0: at_zero, 1.0: 0}
    return _over_t(lambda t: right_mm + (left_mm - right_mm) * t**exponent, span, breaks, "power law")


def zones(right_mm: float, left_mm: float, blend_from: float, blend_to: float, blend: str, span: Span) -> CurvatureLaw:
    """R = right up to blend_from, left from blend_to on; between them right + (left − right)·b(u).

    u = (t − blend_from)/(blend_to − blend_from); b = u (linear) or u²(3 − 2u) (smooth).
    """

    def radius(t: Array) -> Array:
        u = np.clip((t - blend_from) / (blend_to - blend_from), 0.0, 1.0)
        return right_mm + (left_mm - right_mm) * (u if blend == "linear" else u * u * (3.0 - 2.0 * u))

    smoothness = 0 if blend == "linear" else 1
    breaks = {} if right_mm == left_mm else {blend_from: smoothness, blend_to: smoothness}
    return _over_t(radius, span, breaks, "zones law")


def table(x_mm: ArrayLike, curvature_per_mm: ArrayLike) -> CurvatureLaw:
    """The cubic C² spline (not-a-knot) through (x, κ), held at its end values beyond the table.

    x_mm : (n,) rising, n ≥ 2; with two rows the law is linear in κ, with three a parabola.
    Source: C. de Boor, A Practical Guide to Splines, chapter IV.
    """
    x = np.asarray(x_mm, dtype=np.float64)
    kappa = np.asarray(curvature_per_mm, dtype=np.float64)
    spline = CubicSpline(x, kappa)
    # Inner nodes: the third derivative jumps. Ends: the law is held, so its slope jumps.
    inner = tuple(Break(float(at), 2) for at in x[1:-1])
    breaks = (Break(float(x[0]), 0), *inner, Break(float(x[-1]), 0))
    return CurvatureLaw(lambda at: spline(np.clip(at, x[0], x[-1])), breaks, "table law")


def expression(formula: str, span: Span, of: str) -> CurvatureLaw:
    """κ or R (mm) as a formula in t and x; `of` is "curvature" or "radius"."""
    parsed = parse_formula(formula)

    def kappa(x: Array) -> Array:
        value = parsed(span.t(x), x)
        if of == "curvature":
            return value
        with np.errstate(divide="ignore"):
            return 1.0 / value

    # t is held beyond the span: a kink there unless the formula happens to be level.
    return CurvatureLaw(kappa, (Break(span.left_mm, 0), Break(span.right_mm, 0)), f"expression law {formula!r}")


def smooth_extrapolation(law: CurvatureLaw, x_min: float, x_max: float, largest: float) -> CurvatureLaw:
    """The law as it is on [x_min, x_max], continued beyond without a kink: κ, κ′ and κ″ go on and level off.

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
        room = 0.5 * max(largest - abs(float(inside(edge))), 0.0)
        slope, bend = abs(float(first(edge))), abs(float(second(edge)))
        longest = 0.1 * (x_max - x_min)
        wanted = min([longest, *([0.5 * room / slope] if slope else []), *([np.sqrt(room / bend)] if bend else [])])
        lengths[edge] = max(wanted, 1e-6 * longest)

    def kappa(x: Array) -> Array:
        edge = np.clip(x, x_min, x_max)
        length = np.where(x < x_min, lengths[x_min], lengths[x_max])
        eased = length * np.tanh((x - edge) / length)
        beyond = inside(edge) + first(edge) * eased + 0.5 * second(edge) * eased**2
        return np.where(x == edge, law.function(edge), beyond)

    inner = tuple(b for b in law.breaks if x_min < b.x_mm < x_max)
    return CurvatureLaw(kappa, (Break(x_min, 2), *inner, Break(x_max, 2)), law.description)
