"""Half plan outlines at all heights, and a top surface, in; the points of a dome through them out.

A dome is one B-spline face: up a wall, over a rounded edge and inward on the top. A plan outline has a superellipse at
either end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .surfaces import quarter, resampled

Array = NDArray[np.float64]

AROUND = 64  # points of a half plan outline
BLEND = np.array([0.0, 0.25, 0.5, 0.75, 1.0])  # where the rounded edge is sampled
HANDLE = 0.62  # of a rounded edge's Bézier curve: 0.55 is nearly a circle for a right angle, 2/3 nearly a parabola


@dataclass(frozen=True, slots=True)
class End:
    """A plan outline's end: length of the curved part [mm], exponent of its superellipse, bow [mm]."""

    length: float
    exponent: float
    bow: float

    def recess(self, q: float) -> float:
        """How far the end lies back at a share q of the half width [mm]."""
        return float(self.bow * q**2 + self.length * (1.0 - max(1.0 - q**self.exponent, 0.0) ** (1.0 / self.exponent)))


def half_plan(front: float, rear: float, half: float, ends: tuple[End, End]) -> Array:
    """Half a plan outline (AROUND, 2) from the front's middle to the rear's."""
    first = quarter(ends[0].length, half, ends[0].exponent, ends[0].bow) + (front, 0.0)
    last = quarter(ends[1].length, half, ends[1].exponent, ends[1].bow) * (-1.0, 1.0) + (rear, 0.0)
    between = np.column_stack([np.linspace(first[-1, 0], last[-1, 0], 400)[1:-1], np.full(398, half)])
    return resampled(np.vstack([first, between, last[::-1]]), AROUND)


def dome(plan: Callable[[float], Array], swell: Callable[[Array, Array], Array], top: Callable[[Array, Array], Array],
         heights: tuple[float, float], inner: Array, rounding: float, rows: Array, inward: Array) -> Array:
    """Points (AROUND, n, 3) of a wall from the lower of two heights up to the top surface, rounded there, and on inward.

    plan : height -> outline (AROUND, 2); swell : points (n, 3) and their share of the wall's height (n,) -> shift along Y.
    top : height of the top surface at x, y; inner : ring (AROUND, 2) where the top's part ends.
    rows : shares of the wall's height; inward : shares of the way from the edge to the ring, the first 0, the last 1.
    """
    low = heights[0]
    levels = np.linspace(*heights, 120)
    wall = np.stack([np.column_stack([plan(z), np.full(AROUND, z)]) for z in levels], axis=1)
    edge = np.empty((AROUND, 3))
    columns = np.empty((AROUND, len(rows) + len(BLEND) + len(inward) - 2, 3))
    for i, column in enumerate(wall):
        edge_height = _meeting(column, top)
        column[:, 1] += swell(column, (levels - low) / (edge_height - low))
        edge_height = _meeting(column, top)
        edge[i] = [np.interp(edge_height, levels, column[:, k]) for k in range(3)]
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(column, axis=0), axis=1))])
        at_edge = float(np.interp(edge_height, levels, arc))
        below = np.array([np.interp(at_edge - rounding, arc, column[:, k]) for k in range(3)])
        way = inner[i] - edge[i, :2]
        share = rounding / float(np.linalg.norm(way))
        flat = edge[i, :2] + share * way
        beyond = np.array([*flat, float(top(flat[0], flat[1]))])
        up = np.column_stack([np.interp(low + rows * (below[2] - low), levels, column[:, k]) for k in range(3)])
        handles = below + HANDLE * (edge[i] - below), beyond + HANDLE * (edge[i] - beyond)
        t = BLEND[:, None]
        bend = (1 - t) ** 3 * below + 3 * t * (1 - t) ** 2 * handles[0] + 3 * t**2 * (1 - t) * handles[1] + t**3 * beyond
        shares = share + inward * (1.0 - share)
        plane = edge[i, :2] + shares[:, None] * way
        over = np.column_stack([plane, top(plane[:, 0], plane[:, 1])])
        columns[i] = np.vstack([up[:-1], bend[:-1], over])
    columns[[0, -1], :, 1] = 0.0
    return columns


def _meeting(column: Array, top: Callable[[Array, Array], Array]) -> float:
    """The height at which a wall's column (n, 3) passes the top surface."""
    above = column[:, 2] - top(column[:, 0], column[:, 1])
    k = int(np.argmax(above > 0.0))
    t = above[k - 1] / (above[k - 1] - above[k])
    return float(column[k - 1, 2] + t * (column[k, 2] - column[k - 1, 2]))
