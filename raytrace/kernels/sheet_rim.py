"""The curves that bound one sheet, and where functions of eyes' rays to them vanish, one by one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.blocks import clamp
from raytrace.kernels.cells import AT_X, AT_Y, Z_X, Z_Y, Z, taylor_of_any
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.eye_rays import NONE, Posed, ray_to
from raytrace.kernels.sheet import Sheet, sheet_of

Array = NDArray[np.float64]
Index = NDArray[np.intp]

MAX_ROOT_STEPS = 80  # halving alone takes 37


class Rim(NamedTuple):
    """The curves that bound a sheet, in (x, y).

    From each of n vertices, `pieces` lead to the following one, from piece `first` on; pieces go from start (m, 2) to end
    (m, 2).
    """

    start: Array
    end: Array
    first: Index
    pieces: Index


@inner()
def _on_rim(r, k, t, at):
    """(x, y) at the share t of the curve from vertex k to the next, piece by piece."""
    along = t * r.pieces[k]
    piece = min(max(int(along), 0), r.pieces[k] - 1)
    share, piece = along - piece, r.first[k] + piece
    at[0] = r.start[piece, 0] + share * (r.end[piece, 0] - r.start[piece, 0])
    at[1] = r.start[piece, 1] + share * (r.end[piece, 1] - r.start[piece, 1])


@compiled(nogil=True, _nrt=False)
def _points_on(r, vertex, share, at):
    for n in range(vertex.size):
        _on_rim(r, vertex[n], share[n], at[n])


def rim_points(rim: Rim, vertex: Index, share: Array) -> Array:
    """(x, y) (n, 2) at shares (n,) of the curve from vertices (n,) to the following ones."""
    at = np.empty((len(vertex), 2))
    _points_on(rim, vertex, share, at)
    return at


@inner()
def _value(f, q, d):
    """f0 + f1..3·q + f4..6·d + f7..9·(q × d)."""
    return (f[0] + f[1] * q[0] + f[2] * q[1] + f[3] * q[2] + f[4] * d[0] + f[5] * d[1] + f[6] * d[2]
            + f[7] * (q[1] * d[2] - q[2] * d[1]) + f[8] * (q[2] * d[0] - q[0] * d[2]) + f[9] * (q[0] * d[1] - q[1] * d[0]))


@compiled(nogil=True, _nrt=False)
def values(functions, points, directions, found):
    """Functions (1, 10) or (n, 10), as in `rim_roots`, of rays from points (n, 3) along directions (n, 3): found (n,)."""
    for n in range(found.size):
        found[n] = _value(functions[n if functions.shape[0] > 1 else 0], points[n], directions[n])


@compiled(nogil=True, _nrt=False)
def _roots(w, numbers, r, eyes, rotations, offsets, of, functions, vertex, low, high, at_low, at_high, settled, found):
    s = sheet_of(numbers)
    q, ray, at = w[:8], w[8:14], w[14:16]
    for n in range(vertex.size):
        k, f, p = vertex[n], functions[n if functions.shape[0] > 1 else 0], of[n] if of.size else 0
        eye, rotation, offset = eyes[p], rotations[p], offsets[p]
        width = high[n] - low[n]
        here, other, third, at_here, at_other, at_third = 0.0, 1.0, 0.0, at_low[n], at_high[n], 0.0
        share = 0.5 if at_here == at_other else at_here / (at_here - at_other)  # a straight line: most are nearly that
        for _ in range(MAX_ROOT_STEPS):
            there = here + share * (other - here)
            _on_rim(r, k, low[n] + there * width, at)
            taylor_of_any(s.field.cells, at[0], at[1], q)
            if not ray_to(s, eye, q[AT_X], q[AT_Y], q[Z], q[Z_X], q[Z_Y], rotation, offset, ray):
                return False
            now = _value(f, ray[:3], ray[3:])
            if (now > 0.0) == (at_here > 0.0):
                third, at_third = here, at_here
            else:
                third, at_third, other, at_other = other, at_other, here, at_here
            here, at_here = there, now
            least = min(0.5, settled / max(abs(other - here), settled))
            if least >= 0.5 or at_here == 0.0:
                break
            x, y = (here - other) / (third - other), (at_here - at_other) / (at_third - at_other)
            share = 0.5
            if y * y < x and (1.0 - y) * (1.0 - y) < 1.0 - x:
                quadratic = (at_here / (at_other - at_here) * at_third / (at_other - at_third) + (third - here) / (other - here)
                             * at_here / (at_third - at_here) * at_other / (at_third - at_other))
                share = clamp(quadratic, least, 1.0 - least)
        found[n] = low[n] + (here if abs(at_here) <= abs(at_other) else other) * width
    return True


def rim_roots(sheet: Sheet, rim: Rim, posed: Posed, functions: Array, vertex: Index, low: Array, high: Array, at_low: Array,
              at_high: Array, settled: float, of: Index = NONE) -> Array | None:
    """Where functions of the rays to the rim vanish, as `raytrace.roots.roots` finds it.

    Parameters
    ----------
    sheet, rim, posed, of : as in `raytrace.kernels.eye_rays.rays_to`.
    functions : (1, 10) or (n, 10), of rays from q along d: f0 + f1..3·q + f4..6·d + f7..9·(q × d).
    vertex : (n,), after which each lies.   low, high : (n,), shares of the curve to the next, between which it lies.
    at_low, at_high : (n,), its values there, of opposite signs.   settled : of the bracket, to which a root is known.

    Returns
    -------
    Shares (n,); None as in `raytrace.kernels.eye_rays.rays_to`.
    """
    found = np.empty(len(vertex))
    direct = _roots(np.zeros(16), sheet.numbers, rim, *posed, of, functions, vertex, low, high, at_low, at_high, settled, found)
    return found if direct else None
