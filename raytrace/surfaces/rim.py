"""The closed curves that bound a face in space, from its trimming loops, without seams and poles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Evaluate = Callable[[ArrayLike, ArrayLike], Array]

LONG = 1e-2  # of the loops' size: a shorter chord is one of a curve's, which are as many as the curve needs
PARTS = 8  # of a long chord that it is looked at in: straight in (u, v), it may be a whole circle
SAME_MM = 1e-6  # a seam's two sides are one curve but for the rounding of the file
AROUND = 4096  # pieces around a face at least: 0.3 mm of the paper's mirror


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A closed curve on a face: n pieces, straight in (u, v), from start (n, 2) to end (n, 2), that join in space.

    points (n, 3) : where they start, mm.
    """

    start: Array
    end: Array
    points: Array

    @property
    def lengths(self) -> Array:
        """Chords of the pieces (n,), mm."""
        result: Array = np.linalg.norm(np.roll(self.points, -1, axis=0) - self.points, axis=1)
        return result


def rim_of(evaluate: Evaluate, loops: tuple[Array, ...]) -> tuple[Curve, ...]:
    """The curves along the loops (n, 2 each, the first point not repeated) of a face S(u, v) = evaluate(u, v).

    What a loop runs along twice, to and fro, is a seam and bounds nothing; nor does a chord that is one point in space. A whole
    sphere has no curve. Chords that are long in space are divided, so that AROUND or more pieces go around.
    """
    start = np.concatenate(loops)
    end = np.concatenate([np.roll(loop, -1, axis=0) for loop in loops])
    points, step = evaluate(*start.T), end - start
    cuts = np.cumsum([len(loop) for loop in loops])[:-1]
    ends = np.concatenate([np.roll(part, -1, axis=0) for part in np.split(points, cuts)])
    length = np.linalg.norm(ends - points, axis=1)
    long = np.flatnonzero((np.abs(step) > LONG * np.ptp(start, axis=0)).any(axis=1))
    at = evaluate(*np.moveaxis(start[long, None] + np.linspace(0.0, 1.0, PARTS + 1)[:, None] * step[long, None], 2, 0))
    length[long] = np.linalg.norm(np.diff(at, axis=1), axis=2).sum(axis=1)
    bounds = length > 0.0
    bounds[long] = length[long] > SAME_MM
    for i, j in cKDTree(at[:, PARTS // 2]).query_pairs(SAME_MM) if long.size else ():
        if bounds[long[i]] and bounds[long[j]] and np.abs(at[i] - at[j, ::-1]).max() < SAME_MM:
            bounds[long[i]] = bounds[long[j]] = False
    if not bounds.any():
        return ()
    count = np.ones(len(start), dtype=np.intp)
    count[long] = np.ceil(length[long] / (length[bounds].sum() / AROUND))
    curves = []
    for chain in _chains(loops, bounds, points, ends):
        k = np.repeat(chain, count[chain])
        share = (np.arange(len(k)) - np.repeat(np.cumsum(count[chain]) - count[chain], count[chain])) / count[k]
        begin = start[k] + share[:, None] * step[k]
        at = points[k]
        between = share > 0.0
        at[between] = evaluate(*begin[between].T)
        curves.append(Curve(begin, begin + step[k] / count[k, None], at))
    return tuple(curves)


def _chains(loops: tuple[Array, ...], bounds: NDArray[np.bool_], begins: Array, ends: Array) -> list[Index]:
    """The chords that bound, in closed rows: the rest of a loop without its seams goes on where its end lies in space."""
    whole, parts, first = [], [], 0
    for loop in loops:
        chords = np.arange(first, first + len(loop))
        first += len(loop)
        gaps = np.flatnonzero(~bounds[chords])
        if gaps.size == 0:
            whole.append(chords)
            continue
        chords = np.roll(chords, -int(gaps[0]))
        parts += [part[1:] for part in np.split(chords, np.sort((gaps - gaps[0]) % len(chords))[1:]) if len(part) > 1]
    while parts:
        chain = [parts.pop(0)]
        while True:
            last = ends[chain[-1][-1]]
            apart = [float(np.linalg.norm(begins[part[0]] - last)) for part in (chain[0], *parts)]
            nearest = int(np.argmin(apart))
            if nearest == 0:
                break
            chain.append(parts.pop(nearest - 1))
        whole.append(np.concatenate(chain))
    return whole
