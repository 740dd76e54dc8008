"""Steps of Newton's to a sheet z(x, y), for blocks of rays: each settled where what is left is known to be rounding."""

from __future__ import annotations

import numpy as np

from raytrace.kernels.blocks import (
    ABOVE,
    BLOCK,
    DX,
    DY,
    DZ,
    LIMIT,
    MISS,
    OX,
    OY,
    OZ,
    STEP,
    WAS_ZX,
    WAS_ZY,
    ZX,
    ZY,
    T,
    Z,
)
from raytrace.kernels.compiled import inner
from raytrace.kernels.outcomes import ACCEPTED, RESIDUAL
from raytrace.kernels.vectors import RAYS, count_of, eight, put, size, where

MOST_ADDED = 0.1  # of a step, that the second derivative may add to it


@inner(fastmath={"contract"}, forceinline=True)
def begin_newton(w):
    """What a residual height has to be below, squared, for rays at T; nothing has been missed yet."""
    for m in range(0, BLOCK, RAYS):
        limit = RESIDUAL * (size(eight(w, T + m)) + size(eight(w, OX + m)) + size(eight(w, OY + m)) + size(eight(w, OZ + m)))
        put(w, LIMIT + m, limit * limit)
        put(w, MISS + m, np.inf)


@inner(fastmath={"contract"})
def _tangent_step(w):
    """Newton's own step, to where rays meet the tangent planes."""
    moving = BLOCK
    for m in range(0, BLOCK, RAYS):
        dx, dy, dz, z_x, z_y = eight(w, DX + m), eight(w, DY + m), eight(w, DZ + m), eight(w, ZX + m), eight(w, ZY + m)
        t = eight(w, T + m)
        above = eight(w, OZ + m) + t * dz - eight(w, Z + m)
        step = -above / (dz - z_x * dx - z_y * dy)
        put(w, T + m, t + step)
        # Squares: of the height, of the limit, and of the height over the distance from the tangent plane.
        miss = above * above
        limit = eight(w, LIMIT + m) * (1.0 + z_x * z_x + z_y * z_y)
        # Not "larger than": a NaN moves on, too.
        moving -= count_of((miss <= limit) | ((miss <= ACCEPTED * ACCEPTED * limit) & (miss >= 0.25 * eight(w, MISS + m))))
        put(w, MISS + m, miss)
        put(w, STEP + m, step)
        put(w, ABOVE + m, above)
        put(w, WAS_ZX + m, z_x)
        put(w, WAS_ZY + m, z_y)
    return moving


@inner(fastmath={"contract"})
def _bent_step(bend, twist, w):
    """Chebyshev's step, with f'' from the two places that were evaluated last, from one to the other of which STEP led.

    Of the height f it leaves less than |f·q| + bend·h²·s²/2, with s the step, h the share of it across, and q what f'' adds to
    it; slopes, which go on as over the step before, are off by less than twist·h²·s·(s + the step before)/2. Where both are
    rounding the ray is settled, and nothing has to be evaluated once more.
    """
    moving, bend, twist = BLOCK, 0.5 * bend, 0.5 * twist
    for m in range(0, BLOCK, RAYS):
        dx, dy, dz, z_x, z_y = eight(w, DX + m), eight(w, DY + m), eight(w, DZ + m), eight(w, ZX + m), eight(w, ZY + m)
        was_x, was_y, before, t = eight(w, WAS_ZX + m), eight(w, WAS_ZY + m), eight(w, STEP + m), eight(w, T + m)
        above = eight(w, OZ + m) + t * dz - eight(w, Z + m)
        slope, per_step = dz - z_x * dx - z_y * dy, 1.0 / before
        inverse = 1.0 / slope
        step = -above * inverse
        # f'' at the end of the cubic through both heights and slopes.
        curve = (4.0 * slope + 2.0 * (dz - was_x * dx - was_y * dy) - 6.0 * (above - eight(w, ABOVE + m)) * per_step) * per_step
        adds = 0.5 * step * curve * inverse
        adds = where(size(adds) < MOST_ADDED, adds, 0.0)
        step = step - step * adds
        put(w, T + m, t + step)
        # The squares of `_tangent_step`.
        miss = above * above
        limit = eight(w, LIMIT + m) * (1.0 + z_x * z_x + z_y * z_y)
        across, long, long_before = dx * dx + dy * dy, size(step), size(before)
        left = size(above * adds) + bend * across * long * long
        known = (left * left <= limit) & (twist * across * long * (long + long_before) <= RESIDUAL)
        accepted = (miss <= ACCEPTED * ACCEPTED * limit) & (miss >= 0.25 * eight(w, MISS + m))
        moving -= count_of((miss <= limit) | accepted | known)
        put(w, MISS + m, where(known, left * left, miss))
        share = where(long < long_before, step * per_step, 0.0)
        put(w, ZX + m, z_x + (z_x - was_x) * share)
        put(w, ZY + m, z_y + (z_y - was_y) * share)
        put(w, STEP + m, step)
        put(w, ABOVE + m, above)
        put(w, WAS_ZX + m, z_x)
        put(w, WAS_ZY + m, z_y)
    return moving


@inner()
def newton_step(field, second, w):
    """Move T to where the rays meet the sheet, from its heights and slopes at (X, Y), and take the slopes along (`_bent_step`).

    MISS is the square of how high above the sheet the ray was there, or will be at most.

    second : whether this place and that of the step before are known to lie within the sheet's rectangle.

    Returns how many are not settled: not below the limit, nor below what is accepted and no longer halved.
    """
    return _bent_step(field.bend, field.twist, w) if second else _tangent_step(w)
