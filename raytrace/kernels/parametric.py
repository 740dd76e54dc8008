"""Newton for rays that meet a B-spline surface S(u, v) once, sixteen at a time, in float64."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.blocks import (
    AX,
    AY,
    AZ,
    BLOCK,
    BX,
    BY,
    BZ,
    DX,
    DY,
    DZ,
    LAST,
    LIMIT_P,
    MISS,
    NX,
    NY,
    NZ,
    OX,
    OY,
    OZ,
    V0,
    V1,
    V2,
    K,
    P,
    Results,
    T,
    U,
    V,
    X,
    Y,
    Z,
    at,
    box,
    clamp,
    fix_degenerate_rays,
    load,
    reflect,
    store,
    store_all,
    work,
)
from raytrace.kernels.cells import MAX_CELLS, PADDED_POWERS, Cells, cell_at, horner
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.lanes import horner_apart, pitch
from raytrace.kernels.outcomes import ACCEPTED, BEHIND, HIT, LOST, MAX_STEPS, NEAREST_MM, OUTSIDE, RESIDUAL
from raytrace.kernels.trimming import Strips, in_interior, inside
from raytrace.kernels.vectors import RAYS, count_of, eight, maximum, minimum, put, root, size, where

Array = NDArray[np.float64]


BEYOND = 0.05  # of its size, by which a step may leave the surface


class Patches(NamedTuple):
    """Any B-spline surface, as polynomials in coordinates about a centre of its own.

    Attributes
    ----------
    cells : of the coordinates.
    parts : 3 coordinates, or 4 homogeneous ones.
    centre : (3,), mm, what the coordinates are counted from.
    extent : their largest size, mm.
    sheet : (12,), mean normal n, sine of the cone of rays that meet the surface once only, and the affine maps from a place on
        the plane n·x = 0 to u and to v; (0,) where the surface is no such sheet.
    closed : (2,), 1 for a direction whose two ends are the same curve.
    """

    cells: Cells
    parts: int
    centre: Array
    extent: float
    sheet: Array
    closed: Array


@compiled(fastmath={"contract"}, inline="always")
def _evaluate_parts(powers, parts, flat, base, centre_u, centre_v, w):
    """One cell's polynomials, whose coefficients begin at base, and their derivatives at (U, V) into the rows P."""
    base = at(base)
    for part in range(parts):
        for m in range(0, BLOCK, RAYS):
            a, b = eight(w, U + m) - centre_u, eight(w, V + m) - centre_v
            value, along_u, along_v = horner(powers, flat, base + part * powers * pitch(powers), a, b)
            put(w, P + 3 * part * BLOCK + m, value)
            put(w, P + (3 * part + 1) * BLOCK + m, along_u)
            put(w, P + (3 * part + 2) * BLOCK + m, along_v)


@compiled(fastmath={"contract"}, inline="always")
def _evaluate_parts_apart(powers, parts, cells, w):
    """`_evaluate_parts` for rays that each have a cell of their own."""
    flat, ends_u, ends_v = cells.coefficients, cells.ends_u, cells.ends_v
    for m in range(BLOCK):
        u, v = clamp(w[U + m], ends_u[0], ends_u[-2]), clamp(w[V + m], ends_v[0], ends_v[-2])
        i, j = cell_at(cells, u, v)
        w[V0 + m], w[V1 + m] = w[U + m] - cells.middle_u[i], w[V + m] - cells.middle_v[j]
        w[V2 + m] = (i * (ends_v.size - 2) + j) * parts * powers * pitch(powers)
    for part in range(parts):
        to = P + 3 * part * BLOCK
        for m in range(0, BLOCK, RAYS):
            horner_apart(powers, flat, w, m, V2, V0, V1, to, to + BLOCK, to + 2 * BLOCK)
        for m in range(BLOCK):
            w[V2 + m] += powers * pitch(powers)


@compiled(fastmath={"contract"}, inline="always")
def surface(powers, parts, cells, w):
    """S, S_u, S_v at (U, V) into the first nine rows P."""
    flat, ends_u, ends_v = cells.coefficients, cells.ends_u, cells.ends_v
    u_low, u_high, v_low, v_high = box(w, U, V)
    i_low, j_low = cell_at(cells, clamp(u_low, ends_u[0], ends_u[-2]), clamp(v_low, ends_v[0], ends_v[-2]))
    i_high, j_high = cell_at(cells, clamp(u_high, ends_u[0], ends_u[-2]), clamp(v_high, ends_v[0], ends_v[-2]))
    covered = (i_high - i_low + 1) * (j_high - j_low + 1)
    if covered > MAX_CELLS:
        _evaluate_parts_apart(powers, parts, cells, w)
    else:
        for i in range(i_low, i_high + 1):
            for j in range(j_low, j_high + 1):
                base = (i * (ends_v.size - 2) + j) * parts * powers * pitch(powers)
                _evaluate_parts(powers, parts, flat, base, cells.middle_u[i], cells.middle_v[j], w)
                if covered > 1:  # each ray keeps the last cell that starts before it
                    from_u = ends_u[i] if i > i_low else -np.inf
                    from_v = ends_v[j] if j > j_low else -np.inf
                    for m in range(BLOCK):
                        if w[U + m] >= from_u and w[V + m] >= from_v:
                            for row in range(3 * parts):
                                w[K + row * BLOCK + m] = w[P + row * BLOCK + m]
        if covered > 1:
            for k in range(3 * parts * BLOCK):
                w[P + k] = w[K + k]
    if parts == 4:
        for part in range(3):
            for m in range(BLOCK):
                weight = w[P + 9 * BLOCK + m]
                value = w[P + 3 * part * BLOCK + m] / weight
                w[P + 3 * part * BLOCK + m] = value
                w[P + (3 * part + 1) * BLOCK + m] = (w[P + (3 * part + 1) * BLOCK + m]
                                                     - w[P + 10 * BLOCK + m] * value) / weight
                w[P + (3 * part + 2) * BLOCK + m] = (w[P + (3 * part + 2) * BLOCK + m]
                                                     - w[P + 11 * BLOCK + m] * value) / weight


@inner(fastmath={"contract"})
def centred(patches, w):
    """Count origins from the surface's centre, and write the rounding of a distance from them into the row LIMIT_P."""
    centre = patches.centre
    for m in range(0, BLOCK, RAYS):
        x, y, z = eight(w, OX + m) - centre[0], eight(w, OY + m) - centre[1], eight(w, OZ + m) - centre[2]
        put(w, OX + m, x)
        put(w, OY + m, y)
        put(w, OZ + m, z)
        put(w, LIMIT_P + m, RESIDUAL * (patches.extent + size(x) + size(y) + size(z)))


@inner(fastmath={"contract"})
def from_plane(patches, w):
    """Parameters to begin from: of the plane through the sheet, by the affine map that is nearest to its parameters.

    Returns how many rays do not keep to the sheet's cone: they may meet it more than once.
    """
    sheet = patches.sheet
    shallow = BLOCK
    for m in range(0, BLOCK, RAYS):
        ox, oy, oz, dx, dy, dz = (eight(w, OX + m), eight(w, OY + m), eight(w, OZ + m),
                                  eight(w, DX + m), eight(w, DY + m), eight(w, DZ + m))
        down = sheet[0] * dx + sheet[1] * dy + sheet[2] * dz
        t = -(sheet[0] * ox + sheet[1] * oy + sheet[2] * oz) / down
        x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
        put(w, U + m, sheet[4] + sheet[5] * x + sheet[6] * y + sheet[7] * z)
        put(w, V + m, sheet[8] + sheet[9] * x + sheet[10] * y + sheet[11] * z)
        shallow -= count_of(size(down) > sheet[3])
    return shallow


@inner(fastmath={"contract"})
def across(w):
    """Two directions across each ray: of the axes that are not nearest to it, and of the cross product with that."""
    for m in range(0, BLOCK, RAYS):
        dx, dy, dz = eight(w, DX + m), eight(w, DY + m), eight(w, DZ + m)
        to_z = size(dz) < 0.9
        ax, ay, az = where(to_z, dy, 0.0), where(to_z, -dx, dz), where(to_z, 0.0, -dy)
        length = root(ax * ax + ay * ay + az * az)
        ax, ay, az = ax / length, ay / length, az / length
        put(w, AX + m, ax)
        put(w, AY + m, ay)
        put(w, AZ + m, az)
        put(w, BX + m, dy * az - dz * ay)
        put(w, BY + m, dz * ax - dx * az)
        put(w, BZ + m, dx * ay - dy * ax)
        put(w, LAST + m, np.inf)


@inner(fastmath={"contract"})
def kept_near(patches, w):
    """A step may leave the surface by a little, where the end polynomials go on; not by more."""
    ends_u, ends_v = patches.cells.ends_u, patches.cells.ends_v
    u_min, u_max, v_min, v_max = ends_u[0], ends_u[-2], ends_v[0], ends_v[-2]
    beyond_u, beyond_v = BEYOND * (u_max - u_min), BEYOND * (v_max - v_min)
    for m in range(0, BLOCK, RAYS):
        put(w, U + m, minimum(maximum(eight(w, U + m), u_min - beyond_u), u_max + beyond_u))
        put(w, V + m, minimum(maximum(eight(w, V + m), v_min - beyond_v), v_max + beyond_v))


@inner(fastmath={"contract"})
def residuals(w):
    """How far the points of the rows P are off their rays, across them, into NX and NY; how many are off by no rounding."""
    sx, sy, sz = P, P + 3 * BLOCK, P + 6 * BLOCK
    moving = BLOCK
    for m in range(0, BLOCK, RAYS):
        x = eight(w, sx + m) - eight(w, OX + m)
        y = eight(w, sy + m) - eight(w, OY + m)
        z = eight(w, sz + m) - eight(w, OZ + m)
        f = eight(w, AX + m) * x + eight(w, AY + m) * y + eight(w, AZ + m) * z
        g = eight(w, BX + m) * x + eight(w, BY + m) * y + eight(w, BZ + m) * z
        miss, limit = root(f * f + g * g), eight(w, LIMIT_P + m)
        moving -= count_of((miss <= limit) | ((miss <= ACCEPTED * limit) & (miss >= 0.5 * eight(w, LAST + m))))
        put(w, LAST + m, miss)
        put(w, NX + m, f)
        put(w, NY + m, g)
    return moving


@inner(fastmath={"contract"})
def stepped(patches, w):
    """A step of Newton's from the residuals in NX and NY with the derivatives of the rows P."""
    ends_u, ends_v, closed = patches.cells.ends_u, patches.cells.ends_v, patches.closed
    sx, sy, sz = P, P + 3 * BLOCK, P + 6 * BLOCK
    u_min, u_max, v_min, v_max = ends_u[0], ends_u[-2], ends_v[0], ends_v[-2]
    beyond_u, beyond_v = BEYOND * (u_max - u_min), BEYOND * (v_max - v_min)
    # On a closed surface it goes on at the other side of the seam.
    turn_u, turn_v = closed[0] * (u_max - u_min), closed[1] * (v_max - v_min)
    for m in range(0, BLOCK, RAYS):
        ux, uy, uz = eight(w, sx + BLOCK + m), eight(w, sy + BLOCK + m), eight(w, sz + BLOCK + m)
        vx, vy, vz = eight(w, sx + 2 * BLOCK + m), eight(w, sy + 2 * BLOCK + m), eight(w, sz + 2 * BLOCK + m)
        ax, ay, az = eight(w, AX + m), eight(w, AY + m), eight(w, AZ + m)
        bx, by, bz = eight(w, BX + m), eight(w, BY + m), eight(w, BZ + m)
        fu, fv = ax * ux + ay * uy + az * uz, ax * vx + ay * vy + az * vz
        gu, gv = bx * ux + by * uy + bz * uz, bx * vx + by * vy + bz * vz
        f, g, inverse = eight(w, NX + m), eight(w, NY + m), 1.0 / (fu * gv - fv * gu)
        u = eight(w, U + m) - (f * gv - g * fv) * inverse
        v = eight(w, V + m) - (g * fu - f * gu) * inverse
        u = u + where(u < u_min, turn_u, 0.0) - where(u > u_max, turn_u, 0.0)
        v = v + where(v < v_min, turn_v, 0.0) - where(v > v_max, turn_v, 0.0)
        put(w, U + m, minimum(maximum(u, u_min - beyond_u), u_max + beyond_u))
        put(w, V + m, minimum(maximum(v, v_min - beyond_v), v_max + beyond_v))


@compiled(fastmath={"contract"}, inline="always")
def refined(powers, parts, patches, w):
    """Newton from (U, V) until S there is off the ray by rounding only: S, S_u, S_v of that place in the rows P."""
    for step in range(MAX_STEPS):
        surface(powers, parts, patches.cells, w)
        if residuals(w) == 0 or step == MAX_STEPS - 1:
            break
        stepped(patches, w)


@inner(fastmath={"contract"})
def met(patches, sign, one_sided, w):
    """Distances, points and normals that look back along the ray, from the rows P; the ray's share along outward into MISS.

    Returns how many rays hit.
    """
    centre = patches.centre
    sx, sy, sz = P, P + 3 * BLOCK, P + 6 * BLOCK
    good, most = 0, 0.0 if one_sided else np.inf
    for m in range(0, BLOCK, RAYS):
        x, y, z = eight(w, sx + m), eight(w, sy + m), eight(w, sz + m)
        ux, uy, uz = eight(w, sx + BLOCK + m), eight(w, sy + BLOCK + m), eight(w, sz + BLOCK + m)
        vx, vy, vz = eight(w, sx + 2 * BLOCK + m), eight(w, sy + 2 * BLOCK + m), eight(w, sz + 2 * BLOCK + m)
        dx, dy, dz = eight(w, DX + m), eight(w, DY + m), eight(w, DZ + m)
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = root(nx * nx + ny * ny + nz * nz)
        facing = sign * (nx * dx + ny * dy + nz * dz)
        turn = sign / length
        turn = where(facing <= 0.0, turn, -turn)
        t = (x - eight(w, OX + m)) * dx + (y - eight(w, OY + m)) * dy + (z - eight(w, OZ + m)) * dz
        put(w, NX + m, nx * turn)
        put(w, NY + m, ny * turn)
        put(w, NZ + m, nz * turn)
        put(w, T + m, t)
        put(w, X + m, x + centre[0])
        put(w, Y + m, y + centre[1])
        put(w, Z + m, z + centre[2])
        put(w, MISS + m, facing)
        found = (eight(w, LAST + m) <= ACCEPTED * eight(w, LIMIT_P + m)) & (length > 0.0) & (t > NEAREST_MM)
        good += count_of(found & (facing < most))
    return good


def _kernel(powers, parts):
    """The kernel for surfaces in `parts` coordinates (3, or 4 homogeneous ones) with `powers` = degree + 1 both ways."""
    @compiled(nogil=True, fastmath={"contract"}, _nrt=False)
    def hits(w, state, patches, strips, sign, one_sided, origins, directions, results):
        sheet, ends_u, ends_v = patches.sheet, patches.cells.ends_u, patches.cells.ends_v
        n_rays = directions.size // 3
        u_min, u_max, v_min, v_max = ends_u[0], ends_u[-2], ends_v[0], ends_v[-2]
        for start in range(0, n_rays, BLOCK):
            count = min(BLOCK, n_rays - start)
            degenerate = load(origins, directions, start, count, w)
            if degenerate > 0:
                fix_degenerate_rays(directions, start, count, w, state)
            centred(patches, w)
            shallow = from_plane(patches, w)
            if shallow > 0:
                for m in range(BLOCK):
                    if degenerate == 0:
                        state[m] = HIT
                    down = sheet[0] * w[DX + m] + sheet[1] * w[DY + m] + sheet[2] * w[DZ + m]
                    if not abs(down) > sheet[3]:
                        state[m] = LOST
                        w[DX + m], w[DY + m], w[DZ + m] = -sheet[0], -sheet[1], -sheet[2]
                degenerate += shallow
            across(w)
            kept_near(patches, w)
            refined(powers, parts, patches, w)
            good = met(patches, sign, one_sided, w)
            u_low, u_high, v_low, v_high = box(w, U, V)
            reflect(w)
            if good == BLOCK and degenerate == 0 and count == BLOCK \
                    and in_interior(strips.interior, strips.low, strips.inverse_height, u_low, u_high, v_low, v_high):
                store_all(w, start, results)
                continue
            for m in range(BLOCK):
                if degenerate > 0 and state[m] != HIT:
                    continue
                u, v = w[U + m], w[V + m]
                if not (w[LAST + m] <= ACCEPTED * w[LIMIT_P + m] and abs(w[NX + m]) <= 1.0):
                    state[m] = LOST
                elif w[T + m] > NEAREST_MM and inside(strips, u, v):
                    state[m] = BEHIND if one_sided and w[MISS + m] >= 0.0 else HIT
                elif not u_min <= u <= u_max or not v_min <= v <= v_max:
                    state[m] = LOST  # only within its domain is the sheet known to be met once
                else:
                    state[m] = OUTSIDE
            store(w, state, start, count, results)

    return hits


_KERNELS = {(powers, parts): _kernel(powers, parts) for powers in PADDED_POWERS for parts in (3, 4)}


def hits(patches: Patches, strips: Strips, sign: float, one_sided: bool, origins: Array, directions: Array, results: Results,
         ) -> None:
    """Trace rays to a sheet by Newton for S(u, v) on the line o + t·d: a·(S − o) = b·(S − o) = 0 with a, b ⟂ d.

    Rays within the sheet's cone (|d·n| > sheet[3]) meet it in one place only: Newton starts from the sheet's affine map of
    where the ray meets the plane n·x = 0. Converged means that S is off the ray by rounding only. The other rays, and those
    that do not converge or meet the sheet beyond its domain, are LOST: `raytrace.kernels.first_hit` takes them. Normals look
    back along the ray.

    Parameters
    ----------
    patches : of a sheet.
    strips : of its trimming.
    sign, one_sided : S_u × S_v times sign is outward; whether rays from the other side are BEHIND.
    origins, directions : (3,) or (3n,), mm, and (3n,), of any length, flat.
    results : of the n rays.
    """
    rows, state, _ = work()
    _KERNELS[patches.cells.powers, patches.parts](rows, state, patches, strips, sign, one_sided, origins, directions, results)
