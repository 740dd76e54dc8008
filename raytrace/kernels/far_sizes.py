"""The compiled part of `raytrace.visibility.far_sizes`: Newton for far directions from near by, and how large each is shown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.cells import AT_X, AT_Y, Z_X, Z_Y, Z, taylor_of_any
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.height_field_search import HIT_T, HIT_X, HIT_Y, HIT_Z, KNOWN
from raytrace.kernels.image_points import smallest_axis
from raytrace.kernels.sheet import Sheet, sheet_of
from raytrace.kernels.sheet_differentials import NUMBERS as WORKED_WITH
from raytrace.kernels.sheet_differentials import differential
from raytrace.kernels.sheet_image_points import AXES, MISS, NUMBERS, POINT, RAY, aimed, settle

Array = NDArray[np.float64]

NEAR = 0.2  # radians by which a ray may miss for Newton to begin there: what does not settle is looked for otherwise


@inner(fastmath={"contract"})
def _look_at(w, s, eye, x, y):
    """The point of the sheet at (x, y) and the eye's ray to it into w; whether the ray comes from before the sheet."""
    q, ray = w[:KNOWN], w[RAY:POINT]
    taylor_of_any(s.field.cells, x, y, q)
    dx, dy, dz = q[AT_X] - eye[0], q[AT_Y] - eye[1], q[Z] - eye[2]
    q[HIT_T], q[HIT_X], q[HIT_Y], q[HIT_Z] = np.sqrt(dx * dx + dy * dy + dz * dz), q[AT_X], q[AT_Y], q[Z]
    ray[0], ray[1], ray[2] = dx / q[HIT_T], dy / q[HIT_T], dz / q[HIT_T]
    return ray[2] - ray[0] * q[Z_X] - ray[1] * q[Z_Y] < 0.0


@inner(fastmath={"contract"})
def _towards(w, s, eye, wanted, n, settled, passes, longest):
    """Move from what `_look_at` has put into w to the point whose ray leaves along wanted[n]; whether Newton settles there.

    If not, what is in w is of no use any more.
    """
    if not abs(wanted[n, 0]) + abs(wanted[n, 1]) + abs(wanted[n, 2]) < np.inf:
        return False
    miss, least = w[MISS:AXES], smallest_axis(eye, wanted, n, True)
    aimed(w, w[RAY:POINT], wanted, n, True, least)
    now = np.sqrt(miss[0] * miss[0] + miss[1] * miss[1])
    return (now < NEAR and settle(w, s, eye, wanted, n, True, least, settled, passes, longest, 0.0, now) <= passes
            and _look_at(w, s, eye, w[HIT_X], w[HIT_Y]))


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _far_sizes(w, rest, shift, numbers, eye, rotation, starts, wanted, around, settled, passes, longest, leaving, jacobian):
    s, q, ray = sheet_of(numbers), w[:KNOWN], w[RAY:POINT]
    ready = False  # whether w holds what is shown beside the direction before: neighbours follow each other
    for m in range(wanted.shape[0]):
        leaving[m, :] = np.nan
        for j in range(1 + around.shape[0]):
            jacobian[j, m, :] = np.nan
        ready = ready and _towards(w, s, eye, wanted, m, settled, passes, longest)
        if not ready:
            x, y = starts[m]
            ready = (x + y < np.inf and _look_at(w, s, eye, x, y)
                     and _towards(w, s, eye, wanted, m, settled, passes, longest))
        if not ready:
            continue
        leaving[m, 0], leaving[m, 1], leaving[m, 2] = q[HIT_X], q[HIT_Y], q[HIT_Z]
        differential(q, ray, rest, rotation, jacobian[0, m], shift)
        for j in range(around.shape[0]):
            if np.isnan(around[j, m, 0]):
                continue
            ready = _towards(w, s, eye, around[j], m, settled, passes, longest)
            if not ready:
                leaving[m, :] = np.nan
                break
            differential(q, ray, rest, rotation, jacobian[1 + j, m], shift)


def far_sizes(sheet: Sheet, eye: Array, rotation: Array, starts: Array, wanted: Array, around: Array, settled: float,
              passes: float, longest: float) -> tuple[Array, Array]:
    """Find where a sheet shows far directions, and how its rays turn there, from places near them.

    Parameters
    ----------
    sheet, eye : in mirror coordinates, mm.
    rotation : (3, 3), to the coordinates whose level counts.
    starts : (n, 2), mm, (x, y) on the sheet.
    wanted : (n, 3), unit, in mirror coordinates.
    around : (k, n, 3), others beside each of them; NaN for what is not asked.
    settled, passes, longest : as in `sheet_image_points.image_points`.

    Returns
    -------
    Where the rays towards `wanted` leave, (n, 3), and the jacobians, ((1 + k), n, 2, 2), of all as `RayDifferentials` has
    them. Rows of what Newton does not reach from its start are NaN.
    """
    k, n = around.shape[:2]
    leaving, jacobian = np.empty((n, 3)), np.empty((1 + k, n, 2, 2))
    _far_sizes(np.zeros(NUMBERS), np.zeros(WORKED_WITH), np.empty((2, 2)), sheet.numbers, eye, rotation, starts, wanted, around,
               settled, passes, longest, leaving, jacobian)
    return leaving, jacobian
