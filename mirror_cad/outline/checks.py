"""Refuse a closed polygon that crosses, touches or folds back on itself, and say where."""

from __future__ import annotations

import numpy as np

from mirror_cad.errors import OutlineError
from mirror_cad.outline.numbers import FloatArray, point_text

_MAXIMUM_PAIRS = 4_000_000


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def check_simple(polygon: FloatArray, source: str) -> None:
    """Refuse a closed polygon that crosses, touches or folds back on itself.

    Parameters
    ----------
    polygon : ndarray
        (n, 2), mm, the first vertex not repeated.
    source : str
        What it is, for messages.

    Raises
    ------
    OutlineError
        Naming the point.
    """
    origin = polygon[0]
    start = polygon - origin
    end = np.roll(start, -1, axis=0)
    direction, after = end - start, np.roll(end - start, -1, axis=0)
    size = np.hypot(*direction.T) * np.hypot(*after.T)
    fold = (np.abs(_cross(direction, after)) <= 1e-12 * size) & ((direction * after).sum(axis=1) < 0.0)
    if fold.any():
        where = end[np.argmax(fold)] + origin
        raise OutlineError(f"{source}: the outline folds straight back on itself at {point_text(where)}; remove the spike")

    # Boxes around runs of 1, 2, 4, ... edges; pairs of runs whose boxes overlap are split until single edges are left.
    levels = [(np.minimum(start, end), np.maximum(start, end))]
    while len(levels[-1][0]) > 1:
        lower, upper = levels[-1]
        if len(lower) % 2:
            lower, upper = np.concatenate([lower, lower[-1:]]), np.concatenate([upper, upper[-1:]])
        levels.append((np.minimum(lower[::2], lower[1::2]), np.maximum(upper[::2], upper[1::2])))
    first = second = np.zeros(1, dtype=np.intp)
    for lower, upper in reversed(levels[:-1]):
        first, second = (
            np.concatenate([2 * first, 2 * first, 2 * first + 1, 2 * first + 1]),
            np.concatenate([2 * second, 2 * second + 1, 2 * second, 2 * second + 1]),
        )
        keep = (first <= second) & (second < len(lower))
        first, second = first[keep], second[keep]
        keep = ((lower[first] <= upper[second]) & (lower[second] <= upper[first])).all(axis=1)
        first, second = first[keep], second[keep]
        if len(first) > _MAXIMUM_PAIRS:
            raise OutlineError(
                f"{source}: the outline is too tangled to check for self-intersection ({len(first)} pairs of its "
                f"{len(start)} edges lie in overlapping boxes); use a simpler outline"
            )
    apart = (second - first > 1) & ~((first == 0) & (second == len(start) - 1))
    first, second = first[apart], second[apart]
    a, b, c, d = start[first], end[first], start[second], end[second]
    # Sides of each edge's line the other edge's ends are on; 0 is touching, and the boxes overlap already.
    c_side, d_side = np.sign(_cross(b - a, c - a)), np.sign(_cross(b - a, d - a))
    a_side, b_side = np.sign(_cross(d - c, a - c)), np.sign(_cross(d - c, b - c))
    hits = np.flatnonzero((c_side * d_side <= 0) & (a_side * b_side <= 0))
    if len(hits):
        hit = hits[np.lexsort((second[hits], first[hits]))[0]]
        along = _cross(b - a, d - c)[hit]
        where = c[hit]
        if along != 0.0:
            where = a[hit] + (b - a)[hit] * (_cross(c - a, d - c)[hit] / along)
        raise OutlineError(
            f"{source}: the outline crosses or touches itself at {point_text(where + origin)}; it must be a single simple "
            "loop, so trim the pieces there"
        )
