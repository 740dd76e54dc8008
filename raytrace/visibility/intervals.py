"""Intervals on numbered rows: what they cover together, in common, or as any rule of their flags has it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    steps = np.concatenate([sign * np.eye(len(sets), dtype=np.int32)[[k] * len(spans.row)]
                            for k, spans in enumerate(sets) for sign in (1, -1)])
    order = np.lexsort((at, row))
    row, at = row[order], at[order]
    kept = keep(*(np.cumsum(steps[order], axis=0) > 0)[:-1].T) & (row[1:] == row[:-1]) & (at[1:] > at[:-1])
    k = np.flatnonzero(kept)
    fresh = np.ones(len(k), dtype=np.bool_)
    fresh[1:] = (row[k[1:]] != row[k[:-1]]) | (at[k[1:]] != at[k[:-1] + 1])
    first = np.flatnonzero(fresh)
    last = np.append(first[1:], len(k))[:len(first)] - 1
    return IntervalSet(row[k[first]], at[k[first]], at[k[last] + 1])


def union(a: IntervalSet, b: IntervalSet) -> IntervalSet:
    """What lies in one or the other."""
    return combined(lambda in_a, in_b: in_a | in_b, a, b)


def intersection(a: IntervalSet, b: IntervalSet) -> IntervalSet:
    """What lies in one and the other."""
    return combined(lambda in_a, in_b: in_a & in_b, a, b)
