"""The spans of a fit: shared out between the breaks of its laws, cut where they miss, and when they are too many."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mirror_cad.laws.curvature import Break

Array = NDArray[np.float64]

# More soft breaks (a table's nodes) than this are left to the refinement at first: a knot at each would only slow it, unless
# the table is so rough that nothing less will do.
MAX_SOFT_BREAKS = 64
# Two breaks within this share of the width (0.003 mm on a mirror) are one: on a span between them the rounding of z, some
# 50·ε·|z|/h², would be more than 0.01 % of the curvature.
NEAREST_BREAKS = 1e-5
# Derivatives of z more than of κ_x and κ_y that stay continuous at a break: the decoupled surface holds κ_y itself.
DECOUPLED_CONTINUITY, FAITHFUL_CONTINUITY = (2, 0), (2, 2)
MAX_SPANS = 400  # a direction; a law that needs more holds structure far below what glass can take
MAX_PATCHES = 10_000  # in all: seconds of work for each try, and more than a kernel likes
# A span that misses is cut into as many parts as its error asks for by the order of convergence, with some room for what
# the neighbours add; not more than this at once, since far from the tolerance the order is not reached yet.
SAFETY_FACTOR, MAX_PARTS = 1.15, 6
# A span is at most so many times as wide as its neighbour: through smooth knots the error of wide spans reaches into narrow
# ones, and the second derivative divides it by their width squared.
STEEPEST_GRADE = 4.0


def orders_at_breaks(horizontal: Sequence[Break], vertical: Sequence[Break], continuity: tuple[int, int],
                     width_mm: float) -> tuple[tuple[float, int], ...]:
    """Continuous x-derivatives of a surface at each break of its laws.

    Breaks too near for a span between them are one: seen from afar that is two orders harder.

    Parameters
    ----------
    horizontal, vertical : sequence of Break
        Of κ_x and of κ_y.
    continuity : tuple
        How many derivatives more than of κ_x and of κ_y stay continuous.
    width_mm : float
        Of the sheet.

    Returns
    -------
    tuple
        (x, continuous derivatives) of each break.
    """
    order: dict[float, int] = {}
    for breaks, more in zip((horizontal, vertical), continuity, strict=True):
        for b in breaks:
            order[b.x_mm] = min(order.get(b.x_mm, 99), b.smoothness + more)
    kept: list[tuple[float, int]] = []
    for x, derivatives in sorted(order.items()):
        if kept and x - kept[-1][0] <= NEAREST_BREAKS * width_mm:
            kept[-1] = (kept[-1][0], max(min(kept[-1][1], derivatives) - 2, 0))
        else:
            kept.append((x, derivatives))
    return tuple(kept)


def span_ends(low: float, high: float, breaks: Sequence[tuple[float, int]], degree: int, count: int,
              most_soft: int = MAX_SOFT_BREAKS) -> Array:
    """Share out spans between low and high over the stretches between breaks, by their length.

    Parameters
    ----------
    low, high : float
        mm.
    breaks : sequence
        (x, continuous derivatives).
    degree : int
        Of the splines.
    count : int
        Of spans, at least.
    most_soft : int
        Where there are more breaks than this, those of a table's nodes get no knots.

    Returns
    -------
    ndarray
        (n + 1,), rising, mm.
    """
    nearest = NEAREST_BREAKS * (high - low)
    hard = [(x, order) for x, order in breaks if order < degree and low + nearest < x < high - nearest]
    if len(hard) > most_soft:
        hard = [(x, order) for x, order in hard if order < 4]
    if len(hard) > MAX_SPANS:  # a table far finer than spans may be: its nodes cannot be held one by one
        hard = []
    corners = [low, *(x for x, _ in hard), high]
    lengths = np.diff(corners)
    shares = np.ones(len(lengths), dtype=int)
    while shares.sum() < count:
        shares[np.argmax(lengths / shares)] += 1
    parts = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(corners[:-1], corners[1:], shares, strict=True)]
    return np.concatenate([*parts, [high]])


def parts_of_each(parts: Array, span: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Into how many parts each of `count` spans is to be cut, (count,), for what points (n,) in spans (n,) ask for."""
    largest = np.zeros(count)
    np.maximum.at(largest, span, parts)
    asked = np.where(largest > 1.0, np.maximum(np.ceil(SAFETY_FACTOR * largest), 2.0), 1.0)
    return np.minimum(asked, MAX_PARTS).astype(np.int64)


def cut_spans(ends: Array, parts: NDArray[np.int64], narrowest: float) -> Array:
    """The span ends with each span cut into its parts, as far as those are not too narrow to gain from, and graded."""
    widths = np.diff(ends)
    parts = np.clip(parts, 1, np.maximum((widths / narrowest).astype(np.int64), 1))
    if np.all(parts == 1):
        return ends
    cut = _divided(ends, parts)
    while True:
        widths = np.diff(cut)
        before, after = np.concatenate([widths[:1], widths[:-1]]), np.concatenate([widths[1:], widths[-1:]])
        steep = widths > STEEPEST_GRADE * np.minimum(before, after)
        if not steep.any():
            return cut
        cut = _divided(cut, np.where(steep, 2, 1))


def _divided(ends: Array, parts: NDArray[np.int64]) -> Array:
    return np.concatenate([*(a + w * np.arange(n) / n for a, w, n in zip(ends[:-1], np.diff(ends), parts, strict=True)),
                           ends[-1:]])


def too_many(ends_x: Array, ends_y: Array) -> bool:
    """Whether spans with these ends are more than a fit may have."""
    return max(len(ends_x), len(ends_y)) > MAX_SPANS or len(ends_x) * len(ends_y) > MAX_PATCHES
