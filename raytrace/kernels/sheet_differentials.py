"""How rays that one sheet reflects change with the rays that meet it.

The formulas are those of image_points.py. There the shape operator comes as a tensor, from any surface; here z's second
derivatives, of which the sheet has told with the hit, take its place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.cells import HALF_XX, HALF_YY, XY, Z_X, Z_Y
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.eye_rays import turned
from raytrace.kernels.height_field_search import HIT_T, KNOWN
from raytrace.kernels.outcomes import HIT
from raytrace.kernels.sheet import Sheet, ray_through, reflected, sheet_of

Array = NDArray[np.float64]

NUMBERS = 21  # that `differential` works with


@inner(fastmath={"contract"})
def point_change(ray, q, turn, step):
    """How far the hit moves when the unit ray ω turns by δ: dP = t·(δ − ω·(n·δ)/(n·ω)), into step (3,)."""
    share = (turn[2] - turn[0] * q[Z_X] - turn[1] * q[Z_Y]) / (ray[2] - ray[0] * q[Z_X] - ray[1] * q[Z_Y])
    for c in range(3):
        step[c] = q[HIT_T] * (turn[c] - ray[c] * share)


@inner(fastmath={"contract"})
def direction_change(ray, q, turn, step, bent):
    """How the reflected direction turns when ω turns by δ and the hit moves by dP, into bent (3,).

    dd = δ − 2(δ·n + ω·dn)·n − 2(ω·n)·dn, with the normal's change dn = −(h − n·(n·h))/w, h = H·dP of the second derivatives
    H, and w = √(1 + z_x² + z_y²).
    """
    nz = 1.0 / np.sqrt(1.0 + q[Z_X] * q[Z_X] + q[Z_Y] * q[Z_Y])
    nx, ny = -q[Z_X] * nz, -q[Z_Y] * nz
    along = ray[0] * nx + ray[1] * ny + ray[2] * nz
    hx = 2.0 * q[HALF_XX] * step[0] + q[XY] * step[1]
    hy = q[XY] * step[0] + 2.0 * q[HALF_YY] * step[1]
    over = nx * hx + ny * hy
    bx, by, bz = (nx * over - hx) * nz, (ny * over - hy) * nz, nz * over * nz
    twice = turn[0] * nx + turn[1] * ny + turn[2] * nz + bx * ray[0] + by * ray[1] + bz * ray[2]
    bent[0] = turn[0] - 2.0 * twice * nx - 2.0 * along * bx
    bent[1] = turn[1] - 2.0 * twice * ny - 2.0 * along * by
    bent[2] = turn[2] - 2.0 * twice * nz - 2.0 * along * bz


@inner()
def _frame(x, y, z, f):
    """To the right, level, and upward, as one looks along a unit direction, into f (6,)."""
    across = np.sqrt(x * x + y * y)
    f[0], f[1], f[2] = y / across, -x / across, 0.0
    f[3], f[4], f[5] = f[1] * z - f[2] * y, f[2] * x - f[0] * z, f[0] * y - f[1] * x


@inner(fastmath={"contract"})
def differential(q, ray, w, rotation, jacobian, shift):
    """How a ray that meets the sheet at what is in q leaves when it turns: jacobian, shift (2, 2); w (NUMBERS,) is written."""
    before, after, turn, step, bent = w[:6], w[6:12], w[12:15], w[15:18], w[18:21]
    rx, ry, rz = reflected(ray[0], ray[1], ray[2], q[Z_X], q[Z_Y])
    _frame(turned(rotation, 0, ray[0], ray[1], ray[2]), turned(rotation, 1, ray[0], ray[1], ray[2]),
           turned(rotation, 2, ray[0], ray[1], ray[2]), before)
    _frame(turned(rotation, 0, rx, ry, rz), turned(rotation, 1, rx, ry, rz), turned(rotation, 2, rx, ry, rz), after)
    for j in range(2):
        for c in range(3):
            turn[c] = rotation[0, c] * before[3 * j] + rotation[1, c] * before[3 * j + 1] + rotation[2, c] * before[3 * j + 2]
        point_change(ray, q, turn, step)
        direction_change(ray, q, turn, step, bent)
        for i in range(2):
            jacobian[i, j] = shift[i, j] = 0.0
            for c in range(3):
                jacobian[i, j] += after[3 * i + c] * turned(rotation, c, bent[0], bent[1], bent[2])
                shift[i, j] += after[3 * i + c] * turned(rotation, c, step[0], step[1], step[2])


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _differentials(w, numbers, eye, at, rotation, jacobian, shift, path, seen):
    s = sheet_of(numbers)
    q, ray, rest = w[:KNOWN], w[KNOWN:KNOWN + 3], w[KNOWN + 3:]
    for n in range(at.shape[0]):
        seen[n] = ray_through(s, eye, at[n, 0], at[n, 1], ray, q) == HIT
        if seen[n]:
            path[n] = q[HIT_T]
            differential(q, ray, rest, rotation, jacobian[n], shift[n])
        else:
            path[n] = jacobian[n, :] = shift[n, :] = np.nan


def ray_differentials(sheet: Sheet, eye: Array, at: Array, rotation: Array) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """`raytrace.viewing.ray_differentials` of the rays through points (n, 2) of the picture plane.

    Returns
    -------
    jacobian, shift (n, 2, 2), path (n,) and seen (n,), as `RayDifferentials` has them.
    """
    n = len(at)
    jacobian, shift, path, seen = np.empty((n, 2, 2)), np.empty((n, 2, 2)), np.empty(n), np.empty(n, dtype=np.bool_)
    _differentials(np.zeros(KNOWN + 3 + NUMBERS), sheet.numbers, eye, at, rotation, jacobian, shift, path, seen)
    return jacobian, shift, path, seen
