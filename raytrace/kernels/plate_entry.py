"""Where an eye's rays enter the front of a plate of glass that are reflected at points of its back, one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.blocks import clamp
from raytrace.kernels.cells import HALF_XX, HALF_YY, XY, Z_X, Z_Y, Z, cell_at, expand
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.lanes import pitch
from raytrace.kernels.parametric import Patches

Array = NDArray[np.float64]

S, S_U, S_V, S_UU, S_UV, S_VV = range(6)


@inner(fastmath={"contract"})
def _derivatives(patches, u, v, q, d):
    """S … S_vv at the surface's point nearest to (u, v) into d (6, 3); q (4, 8) is for the parts' own."""
    cells, parts = patches.cells, patches.parts
    u, v = clamp(u, cells.ends_u[0], cells.ends_u[-2]), clamp(v, cells.ends_v[0], cells.ends_v[-2])
    i, j = cell_at(cells, u, v)
    size = cells.powers * pitch(cells.powers)
    base = (i * (cells.ends_v.size - 2) + j) * parts * size
    for part in range(parts):
        expand(cells.powers, cells.coefficients, base + part * size, u - cells.middle_u[i], v - cells.middle_v[j], q[part])
    if parts == 3:  # q[3] is that of no weights
        q[3, Z], q[3, Z_X], q[3, Z_Y], q[3, HALF_XX], q[3, XY], q[3, HALF_YY] = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    w = q[3]
    for c in range(3):
        n = q[c]
        s = n[Z] / w[Z]
        s_u, s_v = (n[Z_X] - w[Z_X] * s) / w[Z], (n[Z_Y] - w[Z_Y] * s) / w[Z]
        d[S, c], d[S_U, c], d[S_V, c] = patches.centre[c] + s, s_u, s_v
        d[S_UU, c] = 2.0 * (n[HALF_XX] - w[Z_X] * s_u - w[HALF_XX] * s) / w[Z]
        d[S_UV, c] = (n[XY] - w[Z_X] * s_v - w[Z_Y] * s_u - w[XY] * s) / w[Z]
        d[S_VV, c] = 2.0 * (n[HALF_YY] - w[Z_Y] * s_v - w[HALF_YY] * s) / w[Z]


@inner()
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner()
def _add_path(d, end, index, unit, by):
    """The derivatives by u, v, uu, uv, vv of index·|S − end|, added to by (5,); the unit vector is for this to use."""
    for c in range(3):
        unit[c] = d[S, c] - end[c]
    length = np.sqrt(_dot(unit, unit))
    for c in range(3):
        unit[c] /= length
    along_u, along_v = _dot(unit, d[S_U]), _dot(unit, d[S_V])
    by[0] += index * along_u
    by[1] += index * along_v
    by[2] += index * (_dot(unit, d[S_UU]) + (_dot(d[S_U], d[S_U]) - along_u * along_u) / length)
    by[3] += index * (_dot(unit, d[S_UV]) + (_dot(d[S_U], d[S_V]) - along_u * along_v) / length)
    by[4] += index * (_dot(unit, d[S_VV]) + (_dot(d[S_V], d[S_V]) - along_v * along_v) / length)


@compiled(nogil=True, _nrt=False)
def _rays(front, index, eye, places, max_steps, settled, q, d, unit, by, rays):
    ends_u, ends_v = front.cells.ends_u, front.cells.ends_v
    for n in range(places.shape[0]):
        rays[n, 0], rays[n, 1], rays[n, 2] = np.nan, np.nan, np.nan
        u, v = places[n, 0], places[n, 1]
        for _ in range(max_steps):
            _derivatives(front, u, v, q, d)
            for k in range(5):
                by[k] = 0.0
            _add_path(d, places[n], index, unit, by)
            _add_path(d, eye, 1.0, unit, by)
            determinant = by[2] * by[4] - by[3] * by[3]
            step_u, step_v = (by[3] * by[1] - by[4] * by[0]) / determinant, (by[3] * by[0] - by[2] * by[1]) / determinant
            u, v = u + step_u, v + step_v
            if not np.sqrt(step_u * step_u + step_v * step_v) > settled:
                break
        else:
            continue
        if ends_u[0] <= u <= ends_u[-2] and ends_v[0] <= v <= ends_v[-2]:
            for c in range(3):
                rays[n, c] = d[S, c] + step_u * d[S_U, c] + step_v * d[S_V, c] - eye[c]


def rays_through(front: Patches, index: float, eye: Array, places: Array, max_steps: int, settled: float) -> Array:
    """Find the directions from an eye to where a plate's front lets rays in that are reflected at places behind it.

    By Fermat's principle: n·|S − P| + |S − eye| is stationary in (u, v); Newton on its two derivatives, from (x, y) of P.

    Parameters
    ----------
    front : S(u, v), mm.   index : n, of the glass.
    eye : (3,), mm.   places : P, (n, 3), mm.
    max_steps : of Newton.   settled : a step in (u, v) by which it has come to its end.

    Returns
    -------
    (n, 3), of any length; NaN where there is no such point on the front, or Newton does not come to its end.
    """
    rays = np.empty((len(places), 3))
    _rays(front, index, eye, places, max_steps, settled, np.empty((4, 8)), np.empty((6, 3)), np.empty(3), np.empty(5), rays)
    return rays
