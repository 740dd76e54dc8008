"""The compiled part of `raytrace.visibility.far_sizes`: Newton for far directions from near by, and how large each is shown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.compiled import compiled
from raytrace.kernels.eye_rays import (
    AT_X,
    AT_Y,
    HEIGHT,
    Z_X,
    Z_Y,
    Sheet,
    T,
    X,
    Y,
    Z,
    _differential,
    _miss,
    _reflected_ray,
    _settle,
    _taylor,
)

Array = NDArray[np.float64]

NEAR = 0.2  # radians by which a ray may miss for Newton to begin there: what does not settle is looked for otherwise


@compiled(fastmath={"contract"}, _nrt=False)
def _look_at(w, s, eye, x, y):
    """The place of the sheet at (x, y) into w[:12], and the eye's ray to it into w[12:15]; whether it comes from before it."""
    q, ray = w[:12], w[12:15]
    _taylor(s, x, y, q)
    dx, dy, dz = q[AT_X] - eye[0], q[AT_Y] - eye[1], q[Z] - eye[2]
    q[T], q[X], q[Y], q[HEIGHT] = np.sqrt(dx * dx + dy * dy + dz * dz), q[AT_X], q[AT_Y], q[Z]
    ray[0], ray[1], ray[2] = dx / q[T], dy / q[T], dz / q[T]
    return ray[2] - ray[0] * q[Z_X] - ray[1] * q[Z_Y] < 0.0


@compiled(fastmath={"contract"}, _nrt=False)
def _towards(w, s, eye, wanted, n, settled, passes, longest):
    """Move from what `_look_at` has put into w to the place whose ray leaves along wanted[n]; whether Newton settles there.

    If not, what is in w is of no use any more.
    """
    q, ray, out, miss, axes = w[:12], w[12:15], w[18:21], w[21:23], w[23:33]
    size = np.inf
    for c in range(3):
        if abs(wanted[n, c]) < size:
            axes[9], size = c, abs(wanted[n, c])
    if not size < np.inf:
        return False
    _reflected_ray(ray, q, out)
    _miss(wanted, n, True, q, out, miss, axes)
    now = np.sqrt(miss[0] * miss[0] + miss[1] * miss[1])
    return (now < NEAR and _settle(w, s, eye, wanted, n, True, settled, passes, longest, 0.0, now) <= passes
            and _look_at(w, s, eye, q[X], q[Y]))


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _far_sizes(w, shift, s, eye, rotation, starts, wanted, around, settled, passes, longest, leaving, jacobian):
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
        leaving[m, 0], leaving[m, 1], leaving[m, 2] = w[X], w[Y], w[HEIGHT]
        _differential(w, rotation, jacobian[0, m], shift)
        for j in range(around.shape[0]):
            if np.isnan(around[j, m, 0]):
                continue
            ready = _towards(w, s, eye, around[j], m, settled, passes, longest)
            if not ready:
                leaving[m, :] = np.nan
                break
            _differential(w, rotation, jacobian[1 + j, m], shift)


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
    settled, passes, longest : as in `eye_rays.image_points`.

    Returns
    -------
    Where the rays towards `wanted` leave, (n, 3), and the jacobians, ((1 + k), n, 2, 2), of all as `RayDifferentials` has
    them. Rows of what Newton does not reach from its start are NaN.
    """
    k, n = around.shape[:2]
    leaving, jacobian = np.empty((n, 3)), np.empty((1 + k, n, 2, 2))
    _far_sizes(np.zeros(40), np.empty((2, 2)), sheet, eye, rotation, starts, wanted, around, settled, passes, longest, leaving,
               jacobian)
    return leaving, jacobian
