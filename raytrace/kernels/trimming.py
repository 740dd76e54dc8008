"""Whether parameters lie inside trimming polygons: the even-odd rule, on edges that are sorted into strips of v."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.blocks import clamp
from raytrace.kernels.compiled import compiled, inner

Array = NDArray[np.float64]

MAX_STRIPS = 256  # of a trimming polygon that a block of rays as a whole is looked up in: an eighth of it


class Strips(NamedTuple):
    """The edges of closed polygons in (u, v), in strips of v.

    Attributes
    ----------
    first : (strips + 1,), the first edge of each strip.
    edges : (m, 4), u0, v0, u1, v1.
    low, inverse_height : where the strips start, and one over the height of each.
    interior : (strips, 2), an interval of u that lies inside all over its strip.
    """

    first: NDArray[np.int64]
    edges: Array
    low: float
    inverse_height: float
    interior: Array

    def contain(self, u: Array, v: Array) -> NDArray[np.bool_]:
        """Whether points u, v (n,) lie inside."""
        answer = np.empty(len(u), dtype=np.bool_)
        mark_inside(self, np.ascontiguousarray(u), np.ascontiguousarray(v), answer)
        return answer


@inner()
def odd_to_the_right(edges, start, stop, u, v):
    """Whether an odd number of edges start … stop lies to the right of (u, v)."""
    odd = False
    for k in range(start, stop):
        u0, v0, u1, v1 = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        if (v0 <= v) != (v1 <= v) and u < u0 + (v - v0) * (u1 - u0) / (v1 - v0):
            odd = not odd
    return odd


@inner()
def inside(strips, u, v):
    """Even-odd rule on the polygons."""
    strip = int((v - strips.low) * strips.inverse_height)
    if strip < 0 or strip >= strips.first.size - 1:
        return False
    return odd_to_the_right(strips.edges, strips.first[strip], strips.first[strip + 1], u, v)


@compiled()
def mark_inside(strips, u, v, answer):
    """`inside` for arrays u, v (n,), into answer (n,)."""
    for n in range(u.size):
        answer[n] = inside(strips, u[n], v[n])


@inner()
def in_interior(interior, low, inverse_height, u_low, u_high, v_low, v_high):
    """Whether a whole box lies in the part of its strips that no edge enters."""
    if not v_low > low:
        return False
    from_strip, to_strip = int((v_low - low) * inverse_height), int((v_high - low) * inverse_height)
    if to_strip >= interior.shape[0] or to_strip - from_strip > MAX_STRIPS:
        return False
    for strip in range(from_strip, to_strip + 1):  # noqa: SIM110 (a generator is no numba)
        if not (u_low > interior[strip, 0] and u_high < interior[strip, 1]):
            return False
    return True


@compiled(nogil=True)
def into_strips(edges, low, inverse_height, strips):
    """The first edge of each strip of v (strips + 1,), and the edges in that order: one in each strip that it may touch."""
    first = np.zeros(strips + 2, dtype=np.int64)
    ends = np.empty((edges.shape[0], 2), dtype=np.int32)
    for k in range(edges.shape[0]):
        # Rounding puts a place between the ends into no strip beside theirs: what `inside` computes rises with v, too.
        start = int((min(edges[k, 1], edges[k, 3]) - low) * inverse_height)
        stop = int((max(edges[k, 1], edges[k, 3]) - low) * inverse_height)
        ends[k, 0], ends[k, 1] = max(min(start, strips - 1), 0), max(min(stop, strips - 1), 0)
        for strip in range(ends[k, 0], ends[k, 1] + 1):
            first[strip + 2] += 1
    for strip in range(1, strips + 2):
        first[strip] += first[strip - 1]
    placed = np.empty((first[strips + 1], 4))
    for k in range(edges.shape[0]):
        for strip in range(ends[k, 0], ends[k, 1] + 1):
            to = first[strip + 1]
            for c in range(4):
                placed[to, c] = edges[k, c]
            first[strip + 1] += 1
    return first[:strips + 1].copy(), placed


@compiled(nogil=True)
def _sort_pairs(keys, values, count):
    """Sort the first `count` keys, rising, and their values with them: Shell's sort, with Knuth's steps.

    numpy's own takes a second and a half to compile.
    """
    step = 1
    while step < count // 3:
        step = 3 * step + 1
    while step >= 1:
        for n in range(step, count):
            key, value, k = keys[n], values[n], n
            while k >= step and keys[k - step] > key:
                keys[k], values[k] = keys[k - step], values[k - step]
                k -= step
            keys[k], values[k] = key, value
        step //= 3


@compiled(nogil=True)
def interior_spans(strips):
    """Write `interior`: of each strip the widest interval of u inside that no edge enters; (inf, −inf) for none."""
    first, edges, low, inverse_height, interior = strips
    most = 0
    for strip in range(first.size - 1):
        most = max(most, first[strip + 1] - first[strip])
    left, right = np.empty(most), np.empty(most)
    for strip in range(first.size - 1):
        interior[strip, 0], interior[strip, 1] = np.inf, -np.inf
        bottom, top = low + strip / inverse_height, low + (strip + 1) / inverse_height
        count = first[strip + 1] - first[strip]
        for n in range(count):
            u0, v0, u1, v1 = edges[first[strip] + n]
            if v0 > v1:
                u0, v0, u1, v1 = u1, v1, u0, v0
            # The part of the edge within the strip; edges that only pass near it count with their nearer end.
            a, b = clamp(bottom, v0, v1), clamp(top, v0, v1)
            ua = u0 + (a - v0) * (u1 - u0) / (v1 - v0) if v1 > v0 else u0
            ub = u0 + (b - v0) * (u1 - u0) / (v1 - v0) if v1 > v0 else u1
            left[n], right[n] = min(ua, ub), max(ua, ub)
        _sort_pairs(left, right, count)
        reach = -np.inf
        middle = 0.5 * (bottom + top)
        for n in range(count):
            gap = left[n] - reach
            if gap > max(interior[strip, 1] - interior[strip, 0], 0.0) and reach > -np.inf \
                    and inside(strips, 0.5 * (reach + left[n]), middle):
                interior[strip, 0], interior[strip, 1] = reach, left[n]
            reach = max(reach, right[n])
