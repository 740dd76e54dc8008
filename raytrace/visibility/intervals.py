"""Intervals on numbered rows: what they cover together, in common, or as any rule of their flags has it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.intervals import swept

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class IntervalSet:
    """Intervals on numbered rows, in rising order on each.

    Parameters
    ----------
    row : (m,), of each interval.
    low, high : (m,), from and to; on lines in mm.
    """

    row: Index
    low: Array
    high: Array

    @property
    def total(self) -> float:
        """The length of all."""
        return float(np.sum(self.high - self.low))

    def of(self, row: int) -> Array:
        """The intervals of one row, (k, 2)."""
        return np.stack([self.low, self.high], axis=1)[self.row == row]

    @staticmethod
    def joined(row: Index, low: Array, high: Array, apart: float | Array = 0.0) -> IntervalSet:
        """Intervals (m,), in rising order on rising rows, of which those become one that are no more than `apart` apart."""
        fresh = np.ones(len(row), dtype=np.bool_)
        fresh[1:] = (row[1:] != row[:-1]) | (low[1:] - high[:-1] > apart)
        first = np.flatnonzero(fresh)
        return IntervalSet(row[first], low[first], high[np.append(first[1:], len(row))[:len(first)] - 1])

    def clipped(self, low: float | Array, high: float | Array) -> IntervalSet:
        """What lies between low and high, each a number or one for every interval."""
        a, b = np.maximum(self.low, low), np.minimum(self.high, high)
        kept = a < b
        return IntervalSet(self.row[kept], a[kept], b[kept])

    def mask(self, rows: int, places: Array) -> Mask:
        """Whether rising places (n,) on each of the rows lie inside, (rows, n)."""
        steps = np.zeros((rows, len(places) + 1), dtype=np.int32)
        np.add.at(steps, (self.row, np.searchsorted(places, self.low, "left")), 1)
        np.add.at(steps, (self.row, np.searchsorted(places, self.high, "right")), -1)
        found: Mask = np.cumsum(steps, axis=1)[:, :-1] > 0
        return found


def combined(keep: Callable[..., Mask], *sets: IntervalSet) -> IntervalSet:
    """Find where a rule of flags holds, one flag a set: whether a point of the row lies in it. Intervals that touch become one.

    Parameters
    ----------
    keep : the rule, of k flags (n,) to (n,); it must say no where none of the flags is set.
    *sets : k of them.

    Returns
    -------
    IntervalSet
    """
    row = np.concatenate([row for spans in sets for row in (spans.row, spans.row)])
    at = np.concatenate([end for spans in sets for end in (spans.low, spans.high)])
    of = np.repeat(np.arange(2 * len(sets)), [len(spans.row) for spans in sets for _ in range(2)])
    # What `keep` says of each combination of flags: bit k for set k.
    every = np.arange(1 << len(sets))
    wanted = np.asarray(keep(*((every >> k & 1).astype(np.bool_) for k in range(len(sets)))), dtype=np.bool_)
    return IntervalSet(*swept(row, at, of, np.lexsort((at, row)), wanted))


def union(a: IntervalSet, b: IntervalSet) -> IntervalSet:
    """What lies in one or the other."""
    return combined(lambda in_a, in_b: in_a | in_b, a, b)


def intersection(a: IntervalSet, b: IntervalSet) -> IntervalSet:
    """What lies in one and the other."""
    return combined(lambda in_a, in_b: in_a & in_b, a, b)
