"""Heights and slopes of a sheet z(x, y) under a block of rays: of one cell, of a few, or of a cell for each ray."""

from __future__ import annotations

import numpy as np

from raytrace.kernels.blocks import BLOCK, V0, V1, V2, ZX, ZY, K, X, Y, Z, at, box, clamp
from raytrace.kernels.cells import MAX_CELLS, cell_at, horner
from raytrace.kernels.compiled import inner
from raytrace.kernels.lanes import horner_apart, pitch
from raytrace.kernels.vectors import RAYS, count_of, eight, maximum, minimum, put, where

# Rows of rays apart: the cell that each has, its middle, and where its coefficients begin.
LEFT, RIGHT, BELOW, OVER, MIDDLE_X, MIDDLE_Y, BASE = (K + BLOCK * k for k in range(7))


@inner(fastmath={"contract"}, forceinline=True)
def _evaluate(powers, flat, base, centre_x, centre_y, x_min, x_max, y_min, y_max, w):
    """z, z_x, z_y of one cell's polynomial, whose coefficients begin at base, at (X, Y) into the rows Z, ZX, ZY."""
    base = at(base)
    for m in range(0, BLOCK, RAYS):
        at_x, at_y = eight(w, X + m), eight(w, Y + m)
        x, y = minimum(maximum(at_x, x_min), x_max), minimum(maximum(at_y, y_min), y_max)
        z, z_a, z_b = horner(powers, flat, base, x - centre_x, y - centre_y)
        put(w, Z + m, z + z_a * (at_x - x) + z_b * (at_y - y))
        put(w, ZX + m, z_a)
        put(w, ZY + m, z_b)


@inner()
def forget_cells(w):
    """No ray has a cell yet: those of another sheet say nothing."""
    for m in range(0, BLOCK, RAYS):
        put(w, LEFT + m, np.inf)


@inner(fastmath={"contract"}, forceinline=True)
def _evaluate_apart(powers, cells, w):
    """`_evaluate` for rays that each have a cell of their own, which is looked up where one has left the cell it had."""
    flat, ends_x, ends_y = cells.coefficients, cells.ends_u, cells.ends_v
    x_min, x_max, y_min, y_max = ends_x[0], ends_x[-2], ends_y[0], ends_y[-2]
    for m in range(0, BLOCK, RAYS):
        at_x, at_y = eight(w, X + m), eight(w, Y + m)
        x, y = minimum(maximum(at_x, x_min), x_max), minimum(maximum(at_y, y_min), y_max)
        in_column = (x >= eight(w, LEFT + m)) & (x < eight(w, RIGHT + m))
        if count_of(in_column & (y >= eight(w, BELOW + m)) & (y < eight(w, OVER + m))) == RAYS:
            put(w, V0 + m, x - eight(w, MIDDLE_X + m))
            put(w, V1 + m, y - eight(w, MIDDLE_Y + m))
        else:
            for k in range(m, m + RAYS):
                place_x, place_y = clamp(w[X + k], x_min, x_max), clamp(w[Y + k], y_min, y_max)
                i, j = cell_at(cells, place_x, place_y)
                i, j = at(i), at(j)
                w[LEFT + k], w[RIGHT + k], w[MIDDLE_X + k] = ends_x[i], ends_x[i + 1], cells.middle_u[i]
                w[BELOW + k], w[OVER + k], w[MIDDLE_Y + k] = ends_y[j], ends_y[j + 1], cells.middle_v[j]
                w[V0 + k], w[V1 + k] = place_x - w[MIDDLE_X + k], place_y - w[MIDDLE_Y + k]
                w[BASE + k] = (i * (ends_y.size - 2) + j) * powers * pitch(powers)
        horner_apart(powers, flat, w, m, BASE, V0, V1, Z, ZX, ZY)
        put(w, Z + m, eight(w, Z + m) + eight(w, ZX + m) * (at_x - x) + eight(w, ZY + m) * (at_y - y))


@inner(fastmath={"contract"}, forceinline=True)
def heights_over(powers, cells, i_low, i_high, j_low, j_high, w):
    """`_evaluate` for rays over cells (i_low, j_low) to (i_high, j_high): each keeps the last that starts before it."""
    flat, ends_x, ends_y = cells.coefficients, cells.ends_u, cells.ends_v
    x_min, x_max, y_min, y_max = ends_x[0], ends_x[-2], ends_y[0], ends_y[-2]
    covered = (i_high - i_low + 1) * (j_high - j_low + 1)
    if covered > MAX_CELLS:
        _evaluate_apart(powers, cells, w)
        return
    for i in range(i_low, i_high + 1):
        for j in range(j_low, j_high + 1):
            base = (i * (ends_y.size - 2) + j) * powers * pitch(powers)
            _evaluate(powers, flat, base, cells.middle_u[i], cells.middle_v[j], x_min, x_max, y_min, y_max, w)
            if covered > 1:
                from_x = ends_x[i] if i > i_low else -np.inf
                from_y = ends_y[j] if j > j_low else -np.inf
                for m in range(0, BLOCK, RAYS):
                    mine = (eight(w, X + m) >= from_x) & (eight(w, Y + m) >= from_y)
                    put(w, V0 + m, where(mine, eight(w, Z + m), eight(w, V0 + m)))
                    put(w, V1 + m, where(mine, eight(w, ZX + m), eight(w, V1 + m)))
                    put(w, V2 + m, where(mine, eight(w, ZY + m), eight(w, V2 + m)))
    if covered > 1:
        for m in range(0, BLOCK, RAYS):
            put(w, Z + m, eight(w, V0 + m))
            put(w, ZX + m, eight(w, V1 + m))
            put(w, ZY + m, eight(w, V2 + m))


@inner(fastmath={"contract"}, forceinline=True)
def heights(powers, cells, w):
    """z, z_x, z_y at (X, Y) into the rows Z, ZX, ZY, for a block of rays that need not lie in one cell.

    Returns whether all of them lie on the sheet, and not beyond its rectangle.
    """
    ends_x, ends_y = cells.ends_u, cells.ends_v
    x_min, x_max, y_min, y_max = ends_x[0], ends_x[-2], ends_y[0], ends_y[-2]
    x_low, x_high, y_low, y_high = box(w, X, Y)
    i_low, j_low = cell_at(cells, clamp(x_low, x_min, x_max), clamp(y_low, y_min, y_max))
    i_high, j_high = cell_at(cells, clamp(x_high, x_min, x_max), clamp(y_high, y_min, y_max))
    heights_over(powers, cells, i_low, i_high, j_low, j_high, w)
    return x_low >= x_min and x_high <= x_max and y_low >= y_min and y_high <= y_max
