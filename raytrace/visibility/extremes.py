"""Functions over what is shown of a mirror: their largest values, inside and along its edge, refined to 1e-9 of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels import extremes as kernel

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

REFINED = 1e-9  # of a value: what its neighbourhood still changes it by when it is done
ROUNDS = 10
SQUARE = 9  # samples a direction about a place inside; each round leaves a quarter of its size
ON_EDGE = 33  # samples of a piece of the edge; each round leaves a sixteenth
CANDIDATES = 8  # places inside, and pieces of the edge, that are followed for each function
OVERSHOOT = 0.5  # of the change to a neighbouring sample: how much higher than a sample a top beside it may be


_SQUARE = np.stack(np.meshgrid(*2 * [np.linspace(-1.0, 1.0, SQUARE)]), axis=2).reshape(-1, 2)
_LINE = np.stack([np.linspace(-1.0, 1.0, ON_EDGE), np.zeros(ON_EDGE)], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Several functions at n points of a mirror. Values beside what counts help to tell where the largest may be.

    Attributes
    ----------
    values : (m, n), of the m functions, NaN where there are none.
    inside : (n,), whether a point counts.
    at : (n, 2), where it is.
    """

    values: Array
    inside: Mask
    at: Array


# On which closed curve places (n,) are, −1 for none; what of it, (n, 2): (x, y), or the place on the curve and nothing; and of
# which function's value is asked there, (n,), −1 for those of all.
Evaluate = Callable[[Index, Array, Index], Samples]


@dataclass(frozen=True, slots=True, eq=False)
class Largest:
    """The largest of the values of each of m functions, and where it is.

    Attributes
    ----------
    value : (m,), NaN without one.
    at : (m, 2), as in `Samples`.
    curve, place : (m,) and (m, 2), as they were asked for.
    """

    value: Array
    at: Array
    curve: Index
    place: Array


@dataclass(slots=True, eq=False)
class _Search:
    """What is followed: candidates (c,) for the function `of`, about places on curves, with half the size of each."""

    of: Index
    curve: Index
    place: Array
    half: Array

    def stencil(self) -> tuple[Index, Index, Array]:
        """The candidate (n,), the curve and the place of all samples."""
        inner = self.curve < 0
        which = np.repeat(np.arange(len(self.of)), np.where(inner, len(_SQUARE), len(_LINE)))
        pattern = np.concatenate([_SQUARE if one else _LINE for one in inner])
        return which, self.curve[which], self.place[which] + self.half[which] * pattern


def largest(evaluate: Evaluate, x: Array, y: Array, lengths: Array, on_curve: int) -> Largest:
    """Find the largest values of functions over what counts: on a grid and closed curves, then closer about the best of both.

    A largest value lies inside, at a point of the edge, or where two edges meet; in each case it is approached by samples
    that get closer, of which only those count that are `inside`.

    Parameters
    ----------
    evaluate : the functions, m of them.
    x, y : of the grid, (c,) and (r,), rising and even.
    lengths : of the closed curves, (k,), in any measure; a curve's points run from 0 to its length.
    on_curve : samples on each of the curves.

    Returns
    -------
    Largest
        To REFINED of the values.
    """
    at_x, at_y = np.meshgrid(x, y)
    grid = np.stack([at_x.ravel(), at_y.ravel()], axis=1)
    step = lengths / on_curve
    curve = np.concatenate([np.full(len(grid), -1), np.repeat(np.arange(len(lengths)), on_curve)])
    along = (step[:, None] * np.arange(on_curve)).ravel()
    place = np.concatenate([grid, np.stack([along, np.zeros_like(along)], axis=1)])
    found = evaluate(curve, place, np.full(len(curve), -1))
    m = len(found.values)
    best = Largest(np.full(m, np.nan), np.full((m, 2), np.nan), np.full(m, -1), np.full((m, 2), np.nan))
    best = _better(best, found, curve, place)
    parts = []
    rectangle = (len(y), len(x))
    for k, values in enumerate(found.values):
        inner = _inner(values[:len(grid)].reshape(rectangle), found.inside[:len(grid)].reshape(rectangle), best.value[k])
        half = np.array([x[1] - x[0] if len(x) > 1 else 0.0, y[1] - y[0] if len(y) > 1 else 0.0])
        parts.append(_Search(np.full(len(inner), k), np.full(len(inner), -1), grid[inner], np.tile(half, (len(inner), 1))))
        shape = (len(lengths), on_curve)
        of, piece = _pieces(values[len(grid):].reshape(shape), found.inside[len(grid):].reshape(shape), best.value[k])
        middle = np.stack([(piece + 0.5) * step[of], np.zeros(len(of))], axis=1)
        parts.append(_Search(np.full(len(of), k), of, middle, 0.5 * step[of, None] * [1.0, 0.0]))
    search = _Search(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("of", "curve", "place", "half")))
    for _ in range(ROUNDS):
        if len(search.of) == 0:
            break
        which, curve, place = search.stencil()
        found = evaluate(curve, place, search.of[which])
        best = _better(best, found, curve, place)
        search = _closer(search, which, found, place, best.value)
    return best


def _better(best: Largest, found: Samples, curve: Index, place: Array) -> Largest:
    """The best with what samples have found."""
    value, at, on, where = best.value.copy(), best.at.copy(), best.curve.copy(), best.place.copy()
    for k, values in enumerate(found.values):
        counted = np.where(found.inside & np.isfinite(values), values, -np.inf)
        j = int(np.argmax(counted)) if len(counted) else 0
        if len(counted) and counted[j] > -np.inf and not counted[j] <= value[k]:
            value[k], at[k], on[k], where[k] = counted[j], found.at[j], curve[j], place[j]
    return Largest(value, at, on, where)


def _inner(values: Array, inside: Mask, best: float) -> Index:
    """Nodes of a grid beside which the largest value may be."""
    padded = np.pad(np.where(np.isfinite(values), values, -np.inf), 1, constant_values=-np.inf)
    counted = np.pad(inside, 1)
    rows, columns = values.shape
    beside = [(slice(1 + i, 1 + i + rows), slice(1 + j, 1 + j + columns)) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    around = np.stack([padded[one] for one in beside])
    near = inside | np.any([counted[one] for one in beside], axis=0)
    with np.errstate(invalid="ignore"):
        change = np.where(np.isfinite(around), np.abs(around - values), 0.0).max(axis=0)
        top = np.isfinite(values) & near & (values >= around.max(axis=0))
    return _first(np.flatnonzero(top), (values + OVERSHOOT * change).ravel(), best)


def _pieces(values: Array, inside: Mask, best: float) -> tuple[Index, Index]:
    """The curves and pieces, from one sample to the next, on which the largest value may be."""
    after = np.roll(values, -1, axis=1)
    with np.errstate(invalid="ignore"):
        change = np.abs(after - values)
        around = np.nan_to_num(np.fmax(np.roll(change, 1, axis=1), np.roll(change, -1, axis=1)))
        may_be = np.fmax(values, after) + OVERSHOOT * around
    reached = (inside | np.roll(inside, -1, axis=1)) & np.isfinite(may_be)
    of, piece = np.unravel_index(_first(np.flatnonzero(reached), may_be.ravel(), best), values.shape)
    return of.astype(np.intp), piece.astype(np.intp)


def _first(these: Index, may_be: Array, best: float) -> Index:
    """The most promising of candidates, as many as are followed."""
    with np.errstate(invalid="ignore"):
        these = these[~(may_be[these] < best)]
    result: Index = these[np.argsort(-may_be[these], kind="stable")[:CANDIDATES]]
    return result


def _closer(search: _Search, which: Index, found: Samples, place: Array, best: Array) -> _Search:
    """What is still to be followed, about the best sample of each candidate, from one neighbouring sample to the other."""
    values = found.values[search.of[which], np.arange(len(which))]
    top, height, change = kernel.best_samples(which, values, found.inside, len(search.of))
    kept = np.flatnonzero((height + change >= best[search.of]) & (change > REFINED * np.abs(height)))
    half = search.half * np.where(search.curve < 0, 2.0 / (SQUARE - 1), 2.0 / (ON_EDGE - 1))[:, None]
    return _Search(search.of[kept], search.curve[kept], place[top[kept]], half[kept])
