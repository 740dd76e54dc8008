"""Callable with breaks in, piecewise Chebyshev series out: evaluated, differentiated, integrated to rounding error."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from mirror_cad.errors import SurfaceError

Array = NDArray[np.float64]

DEGREE = 24
# A piece is resolved when its last three coefficients lie below this share of the function's largest value:
# a few units of rounding, so that halving further gains nothing.
RESOLVED = 4e-15
ROUNDING = 1e-16  # of the function's largest value: half of what float64 resolves there
# A piece this small against the whole interval is not halved again: what is left there is a kink or a jump.
SMALLEST_PIECE = 1e-10
# Below this share a tail that halving no longer shrinks fast is the function's own rounding noise, not structure.
NOISE = 1e-10
# A jump of a derivative, times the narrower piece's width to its order, above this share of the function's size is no rounding:
# a series of degree 24 has its second derivative to some 1e-11.
JUMP = 1e-8
MOST_PIECES = 4096  # a second of work
ROUGHEST = 1e-6  # of the function's size: what may remain when the pieces run out, far below what glass can take


@dataclass(frozen=True, eq=False)
class PiecewiseChebyshev:
    """f(x) = Σ_k c[i, k]·T_k(ξ) on [breaks[i], breaks[i+1]], ξ running from −1 to 1; continued by the end pieces.

    breaks : (m + 1,) ascending.   coefficients : (m, n).
    """

    breaks: Array
    coefficients: Array

    def __call__(self, x: ArrayLike) -> Array:
        """f at x, any shape."""
        shape = np.shape(x)
        x = np.asarray(x, dtype=np.float64).ravel()
        piece = np.searchsorted(self.breaks[1:-1], x, side="right")
        low, high = self.breaks[piece], self.breaks[piece + 1]
        xi = ((x - low) - (high - x)) / (high - low)
        values: Array = np.einsum("nk,kn->n", self._trimmed[piece], _chebyshev(xi, self._trimmed.shape[1]))
        return values.reshape(shape)

    @cached_property
    def _trimmed(self) -> Array:
        """The coefficients without the degrees that no piece has: those of a constant or linear law are few."""
        used = np.flatnonzero(self.coefficients.any(axis=0))
        return self.coefficients[:, : used[-1] + 1 if used.size else 1]

    def derivative(self) -> PiecewiseChebyshev:
        """f′, piece by piece."""
        scale = 2.0 / np.diff(self.breaks)
        coefficients = self.coefficients @ _differentiating(self.coefficients.shape[1])
        return PiecewiseChebyshev(self.breaks, coefficients * scale[:, None])

    def integral(self, zero_at: float) -> PiecewiseChebyshev:
        """F with F′ = f, continuous, and F(zero_at) = 0."""
        scale = 0.5 * np.diff(self.breaks)
        c = self.coefficients
        # ∫T_k = T_k+1/(2(k+1)) − T_k−1/(2(k−1)), and zero at ξ = −1.
        k = np.arange(1, c.shape[1] + 1)
        primitive = np.zeros((len(c), c.shape[1] + 1))
        primitive[:, 1:] = c
        primitive[:, 1] += c[:, 0]
        primitive[:, 1:-2] -= c[:, 2:]
        primitive[:, 1:] *= scale[:, None] / (2.0 * k)
        primitive[:, 0] = primitive[:, 1::2].sum(axis=1) - primitive[:, 2::2].sum(axis=1)
        gains = primitive.sum(axis=1)  # T_k(1) = 1
        primitive[1:, 0] += np.cumsum(gains)[:-1]
        unanchored = PiecewiseChebyshev(self.breaks, primitive)
        primitive[:, 0] -= float(unanchored(zero_at))
        return PiecewiseChebyshev(self.breaks, primitive)

    def tight_breaks(self, width: float) -> list[float]:
        """Places where pieces narrower than `width` stand: kinks and jumps that nobody announced."""
        widths = np.diff(self.breaks)
        middles = 0.5 * (self.breaks[:-1] + self.breaks[1:])
        places: list[float] = []
        # The narrowest piece of each crowd stands on the kink itself.
        for i in np.argsort(widths, kind="stable"):
            if widths[i] >= width:
                break
            if all(abs(middles[i] - place) > 10.0 * width for place in places):
                places.append(float(middles[i]))
        return sorted(places)


    def joints(self) -> list[tuple[float, int]]:
        """Inner breaks where f, f′ or f″ jumps, with how many derivatives are continuous there (−1, 0, 1)."""
        found: dict[float, int] = {}
        size = float(np.abs(self.coefficients).max())
        widths = np.diff(self.breaks)
        k = np.arange(self.coefficients.shape[1], dtype=np.float64)
        # T_k, T_k' and T_k'' at ξ = 1; at −1 they are (−1)^k, (−1)^(k+1) and (−1)^k times that.
        ends = (np.ones_like(k), k**2, k**2 * (k**2 - 1.0) / 3.0)
        for order in (2, 1, 0):
            scale = (2.0 / widths) ** order
            right = (self.coefficients * ends[order]).sum(axis=1) * scale
            left = (self.coefficients * ends[order] * (-1.0) ** (k + order)).sum(axis=1) * scale
            jump = np.abs(right[:-1] - left[1:]) * np.minimum(widths[:-1], widths[1:]) ** order
            found |= dict.fromkeys(self.breaks[1:-1][jump > JUMP * size].tolist(), order - 1)
        return sorted(found.items())


def approximate(function: Callable[[Array], Array], breaks: Sequence[float]) -> PiecewiseChebyshev:
    """Halve the pieces between `breaks`, the worst one first, until each is a Chebyshev series to rounding error.

    `function` returns finite values for any x between the breaks. Interpolation at the Chebyshev points of the first kind
    (never at the ends, so a jump at a break is harmless).
    Raises: SurfaceError where MOST_PIECES do not bring the error below ROUGHEST of the function's size.
    Source: L. N. Trefethen, Approximation Theory and Approximation Practice, chapters 3, 4 and 8.
    """
    nodes, to_coefficients = _nodes()
    smallest = 2.0 * SMALLEST_PIECE * (breaks[-1] - breaks[0])
    done: list[tuple[float, Array]] = []
    # Pieces that may need halving: (−tail, start, end, coefficients, tail of the piece it came from).
    waiting: list[tuple[float, float, float, Array, float]] = []
    size = 0.0

    def add(low: float, high: float, coarser_tail: float) -> None:
        nonlocal size
        values = function(0.5 * ((high - low) * nodes + high + low))
        size = max(size, float(np.abs(values).max()))
        coefficients = to_coefficients @ values
        tail = float(np.abs(coefficients[-3:]).max())
        heapq.heappush(waiting, (-tail, low, high, coefficients, coarser_tail))

    for low, high in itertools.pairwise(breaks):
        if high > low:
            add(float(low), float(high), np.inf)
    while waiting:
        negative_tail, low, high, coefficients, coarser_tail = heapq.heappop(waiting)
        tail = -negative_tail
        resolved = tail <= RESOLVED * size or 0.25 * coarser_tail < tail <= NOISE * size
        if resolved or high - low < smallest:
            done.append((low, coefficients))
        elif len(done) + len(waiting) < MOST_PIECES:
            middle = 0.5 * (low + high)
            add(low, middle, tail)
            add(middle, high, tail)
        elif tail <= ROUGHEST * size:
            done.append((low, coefficients))
        else:
            raise SurfaceError(f"the curvature law is too rough near x = {0.5 * (low + high):.3f} mm: {MOST_PIECES} polynomial "
                               f"pieces leave {tail / size:.1g} of its size; smooth it, or give it as a table")
    done.sort(key=lambda piece: piece[0])
    starts = np.array([low for low, _ in done] + [float(breaks[-1])])
    series = np.array([c for _, c in done])
    # What a piece's last coefficients hold below rounding is noise that derivatives would blow up.
    meant = np.maximum.accumulate((np.abs(series) > ROUNDING * size)[:, ::-1], axis=1)[:, ::-1]
    return PiecewiseChebyshev(starts, np.where(meant, series, 0.0))


@cache
def _nodes() -> tuple[Array, Array]:
    """Chebyshev points of the first kind, and what takes the values there to the coefficients."""
    nodes = chebyshev.chebpts1(DEGREE + 1)
    to_coefficients: Array = np.linalg.inv(chebyshev.chebvander(nodes, DEGREE)).astype(np.float64)
    return nodes, to_coefficients


def _chebyshev(xi: Array, count: int) -> Array:
    """T_0 … T_count−1 at ξ (n,), (count, n): T_m+j = 2·T_m·T_j − T_m−j doubles what is there, a handful of array operations
    where the recurrence by one would take dozens."""
    rows = np.ones((count, len(xi)))
    if count > 1:
        rows[1] = xi
    m = 1
    while m < count - 1:
        more = min(m, count - 1 - m)
        np.multiply(rows[1:more + 1], 2.0 * rows[m], out=rows[m + 1:m + more + 1])
        rows[m + 1:m + more + 1] -= rows[m - more:m][::-1]
        m += more
    return rows


@cache
def _differentiating(count: int) -> Array:
    """The coefficients of T_k′ for k < count, (count, count − 1) or (1, 1)."""
    return np.asarray(chebyshev.chebder(np.eye(count), axis=1), dtype=np.float64)
