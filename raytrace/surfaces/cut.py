"""A closed outline cut along an upright line: what of it lies inboard, or outboard."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import TraceError

Array = NDArray[np.float64]


def inboard_of(loop: Array, x: float) -> Array:
    """The part of a polygon (n, 2) with larger x than that of an upright line, (m, 2), mm.

    Raises
    ------
    TraceError
        For a line that does not cut the polygon into two parts.
    """
    right = loop[:, 0] > x
    ends = np.flatnonzero(right != np.roll(right, -1))  # of an edge that crosses the line, its first corner
    if len(ends) != 2:
        low, high = float(loop[:, 0].min()), float(loop[:, 0].max())
        what = ("does not cross the mirror" if len(ends) == 0 else
                f"crosses its outline {len(ends)} times, and does not cut it into two parts")
        raise TraceError(f"the transition line at x = {x:g} mm {what}, which reaches from x = {low:.1f} to {high:.1f} mm")
    into = ends[0] if right[(ends[0] + 1) % len(loop)] else ends[1]
    out_of = ends[1] if into == ends[0] else ends[0]
    kept = (into + 1 + np.arange((out_of - into) % len(loop))) % len(loop)
    return np.concatenate([_at(loop, into, x)[None], loop[kept], _at(loop, out_of, x)[None]])


def outboard_of(loop: Array, x: float) -> Array:
    """The part with smaller x, as `inboard_of`."""
    turned = inboard_of(loop * [-1.0, 1.0], -x)
    return turned * [-1.0, 1.0]


def _at(loop: Array, first: int, x: float) -> Array:
    """Where an edge crosses the line."""
    a, b = loop[first], loop[(first + 1) % len(loop)]
    return np.array([x, a[1] + (x - a[0]) / (b[0] - a[0]) * (b[1] - a[1])])
