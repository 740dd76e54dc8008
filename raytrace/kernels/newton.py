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

MOST_ADDED = 0.1  # of a step, that the second derivative may add to it


@inner(fastmath={"contract"}, forceinline=True)
def begin_newton(w):
    """What a residual height has to be below, squared, for rays at T; nothing has been missed yet."""
    for m in range(BLOCK):
        limit = RESIDUAL * (abs(w[T + m]) + abs(w[OX + m]) + abs(w[OY + m]) + abs(w[OZ + m]))
        w[LIMIT + m] = limit * limit
        w[MISS + m] = np.inf


@inner(fastmath={"contract"})
def _tangent_step(w):
    """Newton's own step, to where rays meet the tangent planes."""
    moving = 0
    for m in range(BLOCK):
        dx, dy, dz, z_x, z_y = w[DX + m], w[DY + m], w[DZ + m], w[ZX + m], w[ZY + m]
        above = w[OZ + m] + w[T + m] * dz - w[Z + m]
        step = -above / (dz - z_x * dx - z_y * dy)
        w[T + m] += step
        # Squares: of the height, of the limit, and of the height over the distance from the tangent plane.
        miss = above * above
        limit = w[LIMIT + m] * (1.0 + z_x * z_x + z_y * z_y)
        # Not "larger than": a NaN moves on, too.
        moving += 1 - int((miss <= limit) | ((miss <= ACCEPTED * ACCEPTED * limit) & (miss >= 0.25 * w[MISS + m])))
        w[MISS + m] = miss
        w[STEP + m], w[ABOVE + m], w[WAS_ZX + m], w[WAS_ZY + m] = step, above, z_x, z_y
    return moving


@inner(fastmath={"contract"})
def _bent_step(bend, twist, w):
    """Chebyshev's step, with f'' from the two places that were evaluated last, from one to the other of which STEP led.

    Of the height f it leaves less than |f·q| + bend·h²·s²/2, with s the step, h the share of it across, and q what f'' adds to
    it; slopes, which go on as over the step before, are off by less than twist·h²·s·(s + the step before)/2. Where both are
    rounding the ray is settled, and nothing has to be evaluated once more.
    """
    moving, bend, twist = 0, 0.5 * bend, 0.5 * twist
    for m in range(BLOCK):
        dx, dy, dz, z_x, z_y, was_x, was_y = w[DX + m], w[DY + m], w[DZ + m], w[ZX + m], w[ZY + m], w[WAS_ZX + m], w[WAS_ZY + m]
        above, before = w[OZ + m] + w[T + m] * dz - w[Z + m], w[STEP + m]
        slope, per_step = dz - z_x * dx - z_y * dy, 1.0 / before
        inverse = 1.0 / slope
        step = -above * inverse
        # f'' at the end of the cubic through both heights and slopes.
        curve = (4.0 * slope + 2.0 * (dz - was_x * dx - was_y * dy) - 6.0 * (above - w[ABOVE + m]) * per_step) * per_step
        adds = 0.5 * step * curve * inverse
        adds = adds if abs(adds) < MOST_ADDED else 0.0
        step = step - step * adds
        w[T + m] += step
        # The squares of `_tangent_step`.
        miss = above * above
        limit = w[LIMIT + m] * (1.0 + z_x * z_x + z_y * z_y)
        across, size = dx * dx + dy * dy, abs(step)
        left = abs(above * adds) + bend * across * size * size
        known = (left * left <= limit) & (twist * across * size * (size + abs(before)) <= RESIDUAL)
        moving += 1 - int((miss <= limit) | ((miss <= ACCEPTED * ACCEPTED * limit) & (miss >= 0.25 * w[MISS + m])) | known)
        w[MISS + m] = left * left if known else miss
        share = step * per_step if size < abs(before) else 0.0
        w[ZX + m], w[ZY + m] = z_x + (z_x - was_x) * share, z_y + (z_y - was_y) * share
        w[STEP + m], w[ABOVE + m], w[WAS_ZX + m], w[WAS_ZY + m] = step, above, z_x, z_y
    return moving


@inner()
def newton_step(field, second, w):
    """Move T to where the rays meet the sheet, from its heights and slopes at (X, Y), and take the slopes along (`_bent_step`).

    MISS is the square of how high above the sheet the ray was there, or will be at most.

    second : whether this place and that of the step before are known to lie within the sheet's rectangle.

    Returns how many are not settled: not below the limit, nor below what is accepted and no longer halved.
    """
    return _bent_step(field.bend, field.twist, w) if second else _tangent_step(w)
