"""Newton for rays that meet a height field z(x, y) once, sixteen at a time, in float64."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.block_heights import forget_cells, heights_over
from raytrace.kernels.blocks import (
    BLOCK,
    DX,
    DY,
    DZ,
    LIMIT,
    MISS,
    NX,
    NY,
    NZ,
    OX,
    OY,
    OZ,
    RX,
    RY,
    RZ,
    ZX,
    ZY,
    Results,
    T,
    X,
    Y,
    Z,
    clamp,
    fix_degenerate_rays,
    go_along,
    load,
    store,
    store_all,
    work,
)
from raytrace.kernels.cells import PADDED_POWERS, Cells, cell_at, taylor
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.newton import begin_newton, newton_step
from raytrace.kernels.outcomes import ACCEPTED, HIT, LOST, MAX_STEPS, NEAREST_MM, OUTSIDE
from raytrace.kernels.trimming import Strips, in_interior, inside
from raytrace.kernels.vectors import RAYS, count_of, eight, put, root, where

Array = NDArray[np.float64]

TOGETHER = 0.1  # of the sheet: rays that lie as near to each other begin better at a paraboloid than at the plane above
KEPT_STEPS = 2  # of Newton's from a paraboloid: where it takes more, the next block gets a paraboloid of its own
CLEAR_MM = 1e-6  # of the rectangle: what is nearer to it may be met within, but for rounding
FALLS = 0.01  # how far a ray comes down a mm, at the least, where it is known to meet one place alone: enough for CLEAR_MM
SHALLOWEST = 0.05  # −d_z below which the plane above the sheet is no good place to start from


class HeightField(NamedTuple):
    """A sheet z(x, y), mm, with what says how rays can meet it.

    Attributes
    ----------
    cells : z as polynomials of u = x and v = y.
    top, bottom : above and below all of it, mm.
    steepest : a ray meets the sheet once only where d_z² > steepest·(d_x² + d_y²): the square of its largest slope.
    bend : bound on the second derivative in any direction, 1/mm.
    twist : bound on what a step of 1 mm changes of the second derivatives, 1/mm²; inf where they jump.
    """

    cells: Cells
    top: float
    steepest: float
    bottom: float
    bend: float
    twist: float


def plain(field: HeightField, strips: Strips) -> tuple[Any, ...]:
    """Both as one plain tuple, for `records`: records in records take 2 µs longer to enter compiled code."""
    return (*field.cells, *field[1:], *strips)


@compiled(inline="always")
def records(n):
    """The height field and the strips of `plain`."""
    cells = Cells(n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9])
    return HeightField(cells, n[10], n[11], n[12], n[13], n[14]), Strips(n[15], n[16], n[17], n[18], n[19])


@inner(fastmath={"contract"}, forceinline=True)
def _osculate(powers, cells, w, q):
    """Move the paraboloid q to where the block's middle ray meets the sheet."""
    c = BLOCK // 2
    slope = w[DZ + c] - q[1] * w[DX + c] - q[2] * w[DY + c]
    t = (q[0] + q[1] * (w[OX + c] - q[6]) + q[2] * (w[OY + c] - q[7]) - w[OZ + c]) / slope
    a, b = w[OX + c] + t * w[DX + c] - q[6], w[OY + c] + t * w[DY + c] - q[7]
    z = q[0] + a * (q[1] + q[3] * a + q[4] * b) + b * (q[2] + q[5] * b)
    slope -= (2.0 * q[3] * a + q[4] * b) * w[DX + c] + (q[4] * a + 2.0 * q[5] * b) * w[DY + c]
    t -= (w[OZ + c] + t * w[DZ + c] - z) / slope
    taylor(powers, cells, w[OX + c] + t * w[DX + c], w[OY + c] + t * w[DY + c], q)


@inner(fastmath={"contract"})
def _from_paraboloid(w, q):
    """Take every ray to the paraboloid q: by its tangent plane, then twice with the same slope. The box of where they are."""
    z0, zx, zy, zxx, zxy, zyy, x, y = q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7]
    for m in range(0, BLOCK, RAYS):
        p, r, h = eight(w, OX + m) - x, eight(w, OY + m) - y, eight(w, OZ + m) - z0
        dx, dy, dz = eight(w, DX + m), eight(w, DY + m), eight(w, DZ + m)
        inverse = 1.0 / (dz - zx * dx - zy * dy)
        t = (zx * p + zy * r - h) * inverse
        for _ in range(2):
            a, b = p + t * dx, r + t * dy
            t = t - (h + t * dz - a * (zx + zxx * a + zxy * b) - b * (zy + zyy * b)) * inverse
        put(w, T + m, t)
    return go_along(w)


@inner(fastmath={"contract"})
def _from_above(top, w):
    """Take every ray to the plane above the sheet. The box of where they are."""
    for m in range(0, BLOCK, RAYS):
        put(w, T + m, (top - eight(w, OZ + m)) / eight(w, DZ + m))
    return go_along(w)


@inner(fastmath={"contract"})
def comes_down(steepest, m, w):
    """Which of eight rays come down steeply enough, and can meet the sheet only once."""
    dx, dy, dz = eight(w, DX + m), eight(w, DY + m), eight(w, DZ + m)
    return (dz <= -SHALLOWEST) & (dz * dz > steepest * (dx * dx + dy * dy))


@inner(fastmath={"contract"})
def shallow_rays(steepest, w):
    """How many rays do not come down so."""
    shallow = BLOCK
    for m in range(0, BLOCK, RAYS):
        shallow -= count_of(comes_down(steepest, m, w))
    return shallow


@inner(fastmath={"contract"})
def met(nearest, w):
    """Heights, upward normals and reflected directions at T, and MISS 0 where a ray meets the sheet; how many do.

    From above: all rays come down more steeply than the sheet does.

    nearest : mm, what is no farther from the origin is not met.
    """
    good = 0
    for m in range(0, BLOCK, RAYS):
        t, dx, dy, dz = eight(w, T + m), eight(w, DX + m), eight(w, DY + m), eight(w, DZ + m)
        put(w, Z + m, eight(w, OZ + m) + t * dz)
        z_x, z_y = eight(w, ZX + m), eight(w, ZY + m)
        steep = 1.0 + z_x * z_x + z_y * z_y
        upright = 1.0 / root(steep)
        nx, ny = -z_x * upright, -z_y * upright
        put(w, NX + m, nx)
        put(w, NY + m, ny)
        put(w, NZ + m, upright)
        facing = dx * nx + dy * ny + dz * upright
        put(w, RX + m, dx - 2.0 * facing * nx)
        put(w, RY + m, dy - 2.0 * facing * ny)
        put(w, RZ + m, dz - 2.0 * facing * upright)
        found = (eight(w, MISS + m) <= ACCEPTED * ACCEPTED * eight(w, LIMIT + m) * steep) & (t > nearest)
        put(w, MISS + m, where(found, 0.0, 1.0))
        good += count_of(found)
    return good


@inner()
def _passes(field, w, m):
    """Whether a ray that meets the sheet's continuation beyond the rectangle is known to meet none of the sheet.

    Beside an edge the continuation is z + z_x·Δx, and its slopes differ from the edge's by z_xy·Δx. A ray that comes down more
    steeply than that has no second place where its height is 0: not over the rectangle, before or behind.
    """
    ends_x, ends_y = field.cells.ends_u, field.cells.ends_v
    x, y = w[X + m], w[Y + m]
    beyond = max(abs(x - clamp(x, ends_x[0], ends_x[-2])), abs(y - clamp(y, ends_y[0], ends_y[-2])))
    slope = np.sqrt(field.steepest) + field.bend * beyond
    return beyond > CLEAR_MM and -w[DZ + m] > slope * np.sqrt(w[DX + m] * w[DX + m] + w[DY + m] * w[DY + m]) + FALLS


def _kernel(powers):
    """The kernel for `powers` = degree + 1 in both directions."""
    @compiled(nogil=True, fastmath={"contract"}, _nrt=False)
    def hits(w, q, state, numbers, origins, directions, results):
        field, strips = records(numbers)
        cells, steepest = field.cells, field.steepest
        ends_x, ends_y = cells.ends_u, cells.ends_v
        n_rays = directions.size // 3
        last_x, last_y = ends_x.size - 3, ends_y.size - 3
        x_min, x_max, y_min, y_max = ends_x[0], ends_x[-2], ends_y[0], ends_y[-2]
        near_x, near_y = TOGETHER * (x_max - x_min), TOGETHER * (y_max - y_min)
        forget_cells(w)
        warm = stale = False
        cell = 0  # the last one that held a whole block, and its ends
        cell_left, cell_right, cell_bottom, cell_top = np.inf, -np.inf, np.inf, -np.inf
        for start in range(0, n_rays, BLOCK):
            count = min(BLOCK, n_rays - start)
            degenerate = load(origins, directions, start, count, w)
            if degenerate > 0:
                fix_degenerate_rays(directions, start, count, w, state)
            shallow = shallow_rays(steepest, w)
            if shallow > 0:
                for m in range(BLOCK):
                    if degenerate == 0:
                        state[m] = HIT
                    across = w[DX + m] * w[DX + m] + w[DY + m] * w[DY + m]
                    if not (w[DZ + m] <= -SHALLOWEST and w[DZ + m] * w[DZ + m] > steepest * across):
                        state[m] = LOST
                        w[DX + m] = w[DY + m] = 0.0
                        w[DZ + m] = -1.0
                degenerate += shallow
            # In a picture the block before is the best place to begin; else the plane above the sheet.
            for _ in range(2):
                if warm:
                    if stale:
                        _osculate(powers, cells, w, q)
                        stale = False
                    x_low, x_high, y_low, y_high = _from_paraboloid(w, q)
                else:
                    x_low, x_high, y_low, y_high = _from_above(field.top, w)
                together = x_high - x_low < near_x and y_high - y_low < near_y
                if together == warm:
                    break
                if together:
                    taylor(powers, cells, w[X + BLOCK // 2], w[Y + BLOCK // 2], q)
                    stale = True
                warm = together
            begin_newton(w)
            was_on_sheet = False
            for step in range(MAX_STEPS):
                stale = step >= KEPT_STEPS
                if x_low >= cell_left and x_high < cell_right and y_low >= cell_bottom and y_high < cell_top:
                    i_low = i_high = cell // (last_y + 1)
                    j_low = j_high = cell - i_low * (last_y + 1)
                    covered = 1
                else:
                    i_low, j_low = cell_at(cells, clamp(x_low, x_min, x_max), clamp(y_low, y_min, y_max))
                    i_high, j_high = cell_at(cells, clamp(x_high, x_min, x_max), clamp(y_high, y_min, y_max))
                    covered = (i_high - i_low + 1) * (j_high - j_low + 1)
                    if covered == 1:
                        cell = i_low * (last_y + 1) + j_low
                        cell_left = ends_x[i_low] if i_low > 0 else -np.inf
                        cell_right = ends_x[i_low + 1] if i_low < last_x else np.inf
                        cell_bottom = ends_y[j_low] if j_low > 0 else -np.inf
                        cell_top = ends_y[j_low + 1] if j_low < last_y else np.inf
                heights_over(powers, cells, i_low, i_high, j_low, j_high, w)
                on_sheet = x_low >= x_min and x_high <= x_max and y_low >= y_min and y_high <= y_max
                moving = newton_step(field, was_on_sheet and on_sheet, w)
                x_low, x_high, y_low, y_high = go_along(w)
                if moving == 0:
                    break
                was_on_sheet = on_sheet
            good = met(NEAREST_MM, w)
            if good == BLOCK and degenerate == 0 and count == BLOCK \
                    and in_interior(strips.interior, strips.low, strips.inverse_height, x_low, x_high, y_low, y_high):
                store_all(w, start, results)
                continue
            for m in range(BLOCK):
                if degenerate > 0 and state[m] != HIT:
                    continue
                if w[MISS + m] != 0.0:
                    state[m] = LOST
                elif not (x_min <= w[X + m] <= x_max and y_min <= w[Y + m] <= y_max):
                    state[m] = OUTSIDE if _passes(field, w, m) else LOST
                elif inside(strips, w[X + m], w[Y + m]):
                    state[m] = HIT
                else:
                    state[m] = OUTSIDE
            store(w, state, start, count, results)

    return hits


_KERNELS = {powers: _kernel(powers) for powers in PADDED_POWERS}


def hits(field: HeightField, strips: Strips, origins: Array, directions: Array, results: Results) -> None:
    """Trace rays to a height field by Newton on f(t) = o_z + t·d_z − z(o_x + t·d_x, o_y + t·d_y), BLOCK rays at once.

    It starts from the plane above the sheet or, for rays that lie together, from the paraboloid that osculates the sheet
    between them. A step is the last where |f|·n_z, the distance from the tangent plane, is rounding, or is known to be
    rounding after it: see `newton_step`. Beyond its rectangle the sheet goes on as the tangent plane at the nearest edge; a ray
    that meets it there is OUTSIDE where it is known to meet nothing else.

    Other rays that do, that do not come down steeply enough to meet the sheet only once (d_z² > steepest·(d_x² + d_y²)), do not
    converge, arrive from below or start beneath it are LOST: `raytrace.kernels.height_field_search` takes them.

    Parameters
    ----------
    field : the sheet.
    strips : of its trimming.
    origins, directions : (3,) or (3n,), mm, and (3n,), of any length, flat.
    results : of the n rays.
    """
    rows, state, paraboloid = work()
    _KERNELS[field.cells.powers](rows, paraboloid, state, plain(field, strips), origins, directions, results)


@compiled(nogil=True)
def tensors(cells, points, normals, out):
    """Write the derivative N of the unit normal along a sheet z(x, y).

    N = −±Π·H·Π/w with w = √(1 + z_x² + z_y²), Π = 1 − nn and H the second derivatives, in x and y.

    Parameters
    ----------
    cells : of the sheet.
    points, normals : (n, 3), mm and unit, the normals of either sense.
    out : (n, 3, 3), 1/mm; NaN for points that are not numbers.
    """
    q, h, p = np.empty(8), np.zeros((3, 3)), np.empty((3, 3))
    for n in range(points.shape[0]):
        x, y = points[n, 0], points[n, 1]
        if not (np.isfinite(x) and np.isfinite(y)):
            out[n] = np.nan
            continue
        taylor(cells.powers, cells, x, y, q)
        w = np.sqrt(1.0 + q[1] * q[1] + q[2] * q[2])
        m = (-q[1] / w, -q[2] / w, 1.0 / w)
        along = m[0] * normals[n, 0] + m[1] * normals[n, 1] + m[2] * normals[n, 2]
        scale = (-1.0 if along >= 0.0 else 1.0) / w
        h[0, 0], h[0, 1], h[1, 0], h[1, 1] = 2.0 * q[3] * scale, q[4] * scale, q[4] * scale, 2.0 * q[5] * scale
        for i in range(3):
            for j in range(3):
                p[i, j] = (1.0 if i == j else 0.0) - m[i] * m[j]
        for i in range(3):
            for j in range(3):
                value = 0.0
                for k in range(2):
                    for r in range(2):
                        value += p[i, k] * h[k, r] * p[r, j]
                out[n, i, j] = value
