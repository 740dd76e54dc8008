"""Piecewise Chebyshev series of a function with breaks: evaluated, differentiated, integrated to rounding error."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numba import njit
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
MAX_PIECES = 4096  # a second of work
BLOCK = 64  # points that are evaluated at once: their working arrays stay next to the processor
ROUGHEST = 1e-6  # of the function's size: what may remain when the pieces run out, far below what glass can take


@dataclass(frozen=True, eq=False)
class PiecewiseChebyshev:
    """f(x) = Σ_k c[i, k]·T_k(ξ) on [breaks[i], breaks[i+1]], ξ running from −1 to 1; continued by the end pieces.

    Attributes
    ----------
    breaks : ndarray
        (m + 1,), rising.
    coefficients : ndarray
        c, (m, n).
    """

    breaks: Array
    coefficients: Array

    def __call__(self, x: ArrayLike) -> Array:
        """f at x, any shape."""
        at = np.asarray(x, dtype=np.float64)
        values = np.empty(at.shape)
        # Copies: what is read-only is of another type to numba, which would compile all of it once more.
        _clenshaw(self.breaks.copy(), self._trimmed, at.flatten(), values.reshape(-1))
        return values

    @cached_property
    def _trimmed(self) -> Array:
        """The coefficients without the degrees that no piece has: those of a constant or linear law are few."""
        used = np.flatnonzero(self.coefficients.any(axis=0))
        return self.coefficients[:, : used[-1] + 1 if used.size else 1].copy()

    def derivative(self) -> PiecewiseChebyshev:
        """f′, piece by piece."""
        scale = 2.0 / np.diff(self.breaks)
        coefficients = self.coefficients @ _differentiating(self.coefficients.shape[1])
        return PiecewiseChebyshev(self.breaks, coefficients * scale[:, None])

    def integral(self, zero_at: float) -> PiecewiseChebyshev:
        """F with F′ = f, continuous, and F(zero_at) = 0.

        Parameters
        ----------
        zero_at : float
            Between the first and the last break.
        """
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
        """Points where pieces narrower than `width` stand: kinks and jumps that nobody announced.

        Parameters
        ----------
        width : float
            Above 0.
        """
        widths = np.diff(self.breaks)
        middles = 0.5 * (self.breaks[:-1] + self.breaks[1:])
        points: list[float] = []
        # The narrowest piece of each crowd stands on the kink itself.
        for i in np.argsort(widths, kind="stable"):
            if widths[i] >= width:
                break
            if all(abs(middles[i] - point) > 10.0 * width for point in points):
                points.append(float(middles[i]))
        return sorted(points)


    def breakpoints(self) -> list[tuple[float, int]]:
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
    """Halve the pieces between breaks, the worst one first, until each is a Chebyshev series to rounding error.

    Interpolated at the Chebyshev points of the first kind, never at the ends, so a jump at a break is harmless.

    Parameters
    ----------
    function : callable
        (n,) -> (n,), finite for any x between the breaks.
    breaks : sequence of float
        Rising; the first and the last are the ends.

    Raises
    ------
    SurfaceError
        Where MAX_PIECES do not bring the error below ROUGHEST of the function's size.

    References
    ----------
    L. N. Trefethen, Approximation Theory and Approximation Practice, chapters 3, 4 and 8.
    """
    nodes, to_coefficients = _nodes()
    smallest = 2.0 * SMALLEST_PIECE * (breaks[-1] - breaks[0])
    done: list[tuple[float, Array]] = []
    # Pieces that may need halving: (−tail, start, end, coefficients, tail of the piece it came from).
    waiting: list[tuple[float, float, float, Array, float]] = []
    size = 0.0

    def add(pieces: Sequence[tuple[float, float]], coarser_tail: float) -> None:
        nonlocal size
        ends = np.array(pieces)
        low, high = ends[:, :1], ends[:, 1:]
        values = function((0.5 * ((high - low) * nodes + high + low)).ravel()).reshape(len(ends), -1)
        size = max(size, float(np.abs(values).max()))
        series = values @ to_coefficients.T
        tails = np.abs(series[:, -3:]).max(axis=1).tolist()
        for (start, end), coefficients, tail in zip(pieces, series, tails, strict=True):
            heapq.heappush(waiting, (-tail, start, end, coefficients, coarser_tail))

    add([(float(low), float(high)) for low, high in itertools.pairwise(breaks) if high > low], np.inf)
    while waiting:
        negative_tail, low, high, coefficients, coarser_tail = heapq.heappop(waiting)
        tail = -negative_tail
        resolved = tail <= RESOLVED * size or 0.25 * coarser_tail < tail <= NOISE * size
        if resolved or high - low < smallest:
            done.append((low, coefficients))
        elif len(done) + len(waiting) < MAX_PIECES:
            middle = 0.5 * (low + high)
            add([(low, middle), (middle, high)], tail)
        elif tail <= ROUGHEST * size:
            done.append((low, coefficients))
        else:
            raise SurfaceError(f"the curvature law is too rough near x = {0.5 * (low + high):.3f} mm: {MAX_PIECES} polynomial "
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


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba's are
def _clenshaw(breaks: Array, coefficients: Array, x: Array, values: Array) -> None:
    """Σ_k c[i, k]·T_k(ξ) by Clenshaw's recurrence: b_k = c_k + 2ξ·b_k+1 − b_k+2, Σ = c_0 + ξ·b_1 − b_2.

    Taken in blocks of points that follow each other in one piece: the recurrence then runs over all of them at once.
    Source: C. W. Clenshaw, MTAC 9 (1955), 118.
    """
    last, count = len(breaks) - 2, coefficients.shape[1]
    xi, one, two = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    start = 0
    while start < x.size:
        piece, above = 0, last  # the piece is the number of inner breaks that are not above x
        while piece < above:
            middle = (piece + above) // 2
            if breaks[middle + 1] <= x[start]:
                piece = middle + 1
            else:
                above = middle
        low, high = breaks[piece], breaks[piece + 1]
        stop = start + 1
        while (stop < x.size and stop < start + BLOCK and (piece == 0 or x[stop] >= low)
               and (piece == last or x[stop] < high)):
            stop += 1
        n = stop - start
        for j in range(n):
            xi[j] = ((x[start + j] - low) - (high - x[start + j])) / (high - low)
            one[j] = two[j] = 0.0
        for k in range(count - 1, 0, -1):
            c = coefficients[piece, k]
            for j in range(n):
                new = c + 2.0 * xi[j] * one[j] - two[j]
                two[j] = one[j]
                one[j] = new
        for j in range(n):
            values[start + j] = coefficients[piece, 0] + xi[j] * one[j] - two[j]
        start = stop


@cache
def _differentiating(count: int) -> Array:
    """The coefficients of T_k′ for k < count, (count, count − 1) or (1, 1)."""
    return np.asarray(chebyshev.chebder(np.eye(count), axis=1), dtype=np.float64)
