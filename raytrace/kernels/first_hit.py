"""The compiled search for the first point at which rays meet B-splines, in float64.

No start is guessed. With a, b ⟂ d a ray meets a surface P/w where F = (a·P − w·a·o, b·P − w·b·o) vanishes, and on a piece all
of F's second derivatives are bounded. A piece is thrown away where F cannot vanish on it; where it can vanish only once,
Newton's method finds where; else the piece is halved. So what is met is the nearest place, on faces that wind, graze, fold
or share a surface too.
Source: the test for one root is that of Kantorovich and Krawczyk; see Neumaier, Interval Methods for Systems of Equations, 5.1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.blocks import Results
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.outcomes import ACCEPTED, BEHIND, HIT, LOST, MAX_STEPS, NEAREST_MM, OUTSIDE, RESIDUAL
from raytrace.kernels.pieces import (
    BEND_UU,
    BEND_UV,
    BEND_VV,
    CENTRE,
    EXTENT,
    FIRST,
    HALF_U,
    HALF_V,
    INVERSE_HEIGHT,
    LOW,
    MIDDLE_U,
    MIDDLE_V,
    OFF_U,
    OFF_V,
    ONE_SIDED,
    PARTS,
    POWERS_U,
    POWERS_V,
    SIGN,
    STRIPS,
    U_MAX,
    U_MIN,
    V_MAX,
    V_MIN,
    VALUES,
    Pieces,
)
from raytrace.kernels.trees import NODES, entered, inverse, put_children
from raytrace.kernels.trimming import odd_to_the_right
from raytrace.parallel import parallel_for

Array = NDArray[np.float64]
Index = NDArray[np.int64]

ONCE = 0.5  # how much of F's slope its second derivatives may change on a piece where Newton's method cannot go astray
OVERSHOT = 1.05  # of a piece's half size: beyond this after the first step there is no place on it; it is off by 0.03 at most
EDGE = 1e-9  # of a piece's half size: places as far beside its edge count, so that none is lost between two pieces
SNAP = 4e-15  # of the parameters: places as far beside the surface's edge lie on it
FLAT = 1e-14  # of |F_u|·|F_v|: a smaller determinant is rounding, and the ray runs along the piece
ALONG = 1e-3  # of the surface's size: a ray that runs along a flat piece as far lies in it, and meets nothing
MAX_LOOKS = 4000  # at halves of a piece, for one ray; one in a straight line of a curved surface takes the most
DEEPEST = 96  # halvings of a piece: 2^−48 of both sides

# The ray: origin, direction, two directions across it.
OX, OY, OZ, DX, DY, DZ, AX, AY, AZ, BX, BY, BZ = range(12)
# What was found: distance, point, normal, and the direction's share along the outward side.
T, X, Y, Z, NX, NY, NZ, FACING = range(8)
# Outcomes of a search in a piece.
SETTLED, UNSURE = 0, 1


class _Piece(NamedTuple):
    """One piece, with its cell's coefficients and its surface's numbers."""

    coefficients: Array
    base: int
    counts: Index
    sizes: Array
    numbers: Array


class _Work(NamedTuple):
    """A thread's working arrays: the ray, values on a piece, its parts and the tree's nodes that wait, and what was found."""

    ray: Array
    q: Array
    waiting: Array
    found: Array
    stack: Index
    entries: Array

    @staticmethod
    def empty() -> _Work:
        return _Work(np.empty(12), np.empty(12), np.empty((DEEPEST + 2, 4)), np.empty(8), np.empty(NODES, dtype=np.int64),
                     np.empty(NODES))


@inner(fastmath={"contract"})
def _evaluate(flat, base, powers_u, powers_v, parts, a, b, q):
    """P, P_u, P_v (and w, w_u, w_v) of one cell at (a, b) from its middle, into q: x, x_u, x_v, y and so on."""
    k = base
    for part in range(parts):
        value = along_a = along_b = 0.0
        for _ in range(powers_u):
            row, slope = flat[k], 0.0
            for c in range(1, powers_v):
                slope = slope * b + row
                row = row * b + flat[k + c]
            along_a = along_a * a + value
            value = value * a + row
            along_b = along_b * a + slope
            k += powers_v
        q[3 * part], q[3 * part + 1], q[3 * part + 2] = value, along_a, along_b


@inner(fastmath={"contract"})
def _project(q, w):
    """S, S_u, S_v in place of P, P_u, P_v."""
    for k in range(0, 9, 3):
        q[k] /= w
        q[k + 1] = (q[k + 1] - q[10] * q[k]) / w
        q[k + 2] = (q[k + 2] - q[11] * q[k]) / w


@inner(fastmath={"contract"})
def _refined(piece, ray, ox, oy, oz, limit, x, y, q):
    """Newton's method on S(u, v) = o + t·d from (x, y) in the piece's own −1 … 1; whether it met, and where.

    A step ends on the piece's edge at most. The last one is where the distance from the ray is rounding.
    """
    numbers, counts, parts = piece.numbers, piece.counts, piece.counts[PARTS]
    last = np.inf
    for step in range(MAX_STEPS):
        _evaluate(piece.coefficients, piece.base, counts[POWERS_U], counts[POWERS_V], parts,
                  numbers[OFF_U] + x * numbers[HALF_U], numbers[OFF_V] + y * numbers[HALF_V], q)
        if parts == 4:
            _project(q, q[9])
        px, py, pz = q[0] - ox, q[3] - oy, q[6] - oz
        f = ray[AX] * px + ray[AY] * py + ray[AZ] * pz
        g = ray[BX] * px + ray[BY] * py + ray[BZ] * pz
        miss = np.sqrt(f * f + g * g)
        if miss <= limit or (miss <= ACCEPTED * limit and miss >= 0.5 * last):
            return True, x, y
        last = miss
        fu = (ray[AX] * q[1] + ray[AY] * q[4] + ray[AZ] * q[7]) * numbers[HALF_U]
        fv = (ray[AX] * q[2] + ray[AY] * q[5] + ray[AZ] * q[8]) * numbers[HALF_V]
        gu = (ray[BX] * q[1] + ray[BY] * q[4] + ray[BZ] * q[7]) * numbers[HALF_U]
        gv = (ray[BX] * q[2] + ray[BY] * q[5] + ray[BZ] * q[8]) * numbers[HALF_V]
        inverse = 1.0 / (fu * gv - fv * gu)
        x, y = x - (f * gv - g * fv) * inverse, y - (g * fu - f * gu) * inverse
        if step > 0 and not max(abs(x), abs(y)) <= OVERSHOT:
            break
        x, y = min(max(x, -1.0 - EDGE), 1.0 + EDGE), min(max(y, -1.0 - EDGE), 1.0 + EDGE)
    return last <= ACCEPTED * limit, x, y


@inner(fastmath={"contract"})
def _keep(piece, first, edges, ray, ox, oy, oz, x, y, q, found):
    """Keep the place S = q at (x, y) of a piece where it lies inside the trimming and before what was found."""
    sizes, counts, numbers = piece.sizes, piece.counts, piece.numbers
    t = (q[0] - ox) * ray[DX] + (q[3] - oy) * ray[DY] + (q[6] - oz) * ray[DZ]
    if not (t > NEAREST_MM and t < found[T]):
        return
    u = numbers[MIDDLE_U] + (numbers[OFF_U] + x * numbers[HALF_U])
    v = numbers[MIDDLE_V] + (numbers[OFF_V] + y * numbers[HALF_V])
    u_min, u_max, v_min, v_max = sizes[U_MIN], sizes[U_MAX], sizes[V_MIN], sizes[V_MAX]
    snap_u, snap_v = SNAP * (abs(u_min) + abs(u_max)), SNAP * (abs(v_min) + abs(v_max))
    u = min(u, u_max) if u <= u_max + snap_u else u
    u = max(u, u_min) if u >= u_min - snap_u else u
    v = min(v, v_max) if v <= v_max + snap_v else v
    v = max(v, v_min) if v >= v_min - snap_v else v
    strip = int((v - sizes[LOW]) * sizes[INVERSE_HEIGHT])
    if strip < 0 or strip >= counts[STRIPS] \
            or not odd_to_the_right(edges, first[counts[FIRST] + strip], first[counts[FIRST] + strip + 1], u, v):
        return
    nx, ny, nz = q[4] * q[8] - q[7] * q[5], q[7] * q[2] - q[1] * q[8], q[1] * q[5] - q[4] * q[2]
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    facing = sizes[SIGN] * (nx * ray[DX] + ny * ray[DY] + nz * ray[DZ])
    turn = sizes[SIGN] / length if facing <= 0.0 else -sizes[SIGN] / length
    found[T], found[X], found[Y], found[Z] = t, q[0] + sizes[CENTRE], q[3] + sizes[CENTRE + 1], q[6] + sizes[CENTRE + 2]
    found[NX], found[NY], found[NZ] = nx * turn, ny * turn, nz * turn
    found[FACING] = facing if counts[ONE_SIDED] else -1.0


@inner(fastmath={"contract"})
def _meet_piece(piece, first, edges, work):
    """All places where a ray meets a piece, each into `_keep`."""
    sizes, counts, numbers = piece.sizes, piece.counts, piece.numbers
    ray, q, waiting, found = work.ray, work.q, work.waiting, work.found
    parts, bend_uu, bend_uv, bend_vv = counts[PARTS], numbers[BEND_UU], numbers[BEND_UV], numbers[BEND_VV]
    ox, oy, oz = ray[OX] - sizes[CENTRE], ray[OY] - sizes[CENTRE + 1], ray[OZ] - sizes[CENTRE + 2]
    limit = RESIDUAL * (sizes[EXTENT] + abs(ox) + abs(oy) + abs(oz))
    oa = ray[AX] * ox + ray[AY] * oy + ray[AZ] * oz
    ob = ray[BX] * ox + ray[BY] * oy + ray[BZ] * oz
    waiting[0, 0], waiting[0, 1], waiting[0, 2], waiting[0, 3] = 0.0, 0.0, 1.0, 1.0
    count, outcome = 1, SETTLED
    for _ in range(MAX_LOOKS):
        if count == 0:
            return outcome
        count -= 1
        x, y, scale_u, scale_v = waiting[count, 0], waiting[count, 1], waiting[count, 2], waiting[count, 3]
        if scale_u == 1.0 and scale_v == 1.0:
            for k in range(3 * parts):
                q[k] = numbers[VALUES + k]
        else:
            _evaluate(piece.coefficients, piece.base, counts[POWERS_U], counts[POWERS_V], parts,
                      numbers[OFF_U] + x * numbers[HALF_U], numbers[OFF_V] + y * numbers[HALF_V], q)
        w, w_u, w_v = (q[9], q[10], q[11]) if parts == 4 else (1.0, 0.0, 0.0)
        half_u, half_v = scale_u * numbers[HALF_U], scale_v * numbers[HALF_V]
        f = ray[AX] * q[0] + ray[AY] * q[3] + ray[AZ] * q[6] - oa * w
        g = ray[BX] * q[0] + ray[BY] * q[3] + ray[BZ] * q[6] - ob * w
        fu = (ray[AX] * q[1] + ray[AY] * q[4] + ray[AZ] * q[7] - oa * w_u) * half_u
        fv = (ray[AX] * q[2] + ray[AY] * q[5] + ray[AZ] * q[8] - oa * w_v) * half_v
        gu = (ray[BX] * q[1] + ray[BY] * q[4] + ray[BZ] * q[7] - ob * w_u) * half_u
        gv = (ray[BX] * q[2] + ray[BY] * q[5] + ray[BZ] * q[8] - ob * w_v) * half_v
        uu, uv, vv = bend_uu * scale_u * scale_u, bend_uv * scale_u * scale_v, bend_vv * scale_v * scale_v
        bend = uu + 2.0 * uv + vv
        rounding = ACCEPTED * limit * abs(w)
        off = 0.5 * bend + rounding  # how far F may be from what its slopes make it
        determinant = abs(fu * gv - fv * gu)
        long_u, long_v = np.sqrt(fu * fu + gu * gu), np.sqrt(fv * fv + gv * gv)
        # F = 0 is not within `off` of the parallelogram that the piece is to the first order.
        if f * f + g * g > (long_u + long_v + off) ** 2 or abs(f * gu - g * fu) > determinant + off * long_u \
                or abs(f * gv - g * fv) > determinant + off * long_v:
            continue
        longest = max(long_u, long_v)
        steep = determinant > FLAT * long_u * long_v
        if steep and bend * longest <= ONCE * determinant:
            inverse = 1.0 / (fu * gv - fv * gu)
            # The place by the slopes alone, in the half's own −1 … 1, is right to half of what the second derivatives change.
            step_x, step_y = -(f * gv - g * fv) * inverse, -(g * fu - f * gu) * inverse
            reach = 1.0 + EDGE + off * longest / determinant
            if max(abs(step_x), abs(step_y)) > reach:
                continue
            step_x, step_y = min(max(step_x, -1.0), 1.0), min(max(step_y, -1.0), 1.0)
            met, to_x, to_y = _refined(piece, ray, ox, oy, oz, limit, x + step_x * scale_u, y + step_y * scale_v, q)
            if met:
                _keep(piece, first, edges, ray, ox, oy, oz, to_x, to_y, q, found)
            continue
        if 0.5 * bend <= limit * abs(w):
            # Straight to rounding, and the ray runs along it: touches it, or lies in it.
            along = abs(ray[DX] * q[1] + ray[DY] * q[4] + ray[DZ] * q[7]) * half_u \
                + abs(ray[DX] * q[2] + ray[DY] * q[5] + ray[DZ] * q[8]) * half_v
            if along > ALONG * sizes[EXTENT] * abs(w):
                continue
            if parts == 4:
                _project(q, w)
            _keep(piece, first, edges, ray, ox, oy, oz, x, y, q, found)
            continue
        if count + 2 > DEEPEST:
            outcome = UNSURE
            continue
        split_u = long_u > long_v if uv >= max(uu, vv) else uu > vv
        for side in range(2):
            turn = 0.5 - side
            waiting[count, 0] = x + (turn * scale_u if split_u else 0.0)
            waiting[count, 1] = y + (0.0 if split_u else turn * scale_v)
            waiting[count, 2], waiting[count, 3] = (0.5 * scale_u, scale_v) if split_u else (scale_u, 0.5 * scale_v)
            count += 1
    return UNSURE


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _first_hits(pieces, work, origins, units, valid, results):
    nodes, links, boxes = pieces.tree.boxes, pieces.tree.links, pieces.boxes
    ray, found, stack, entries = work.ray, work.found, work.stack, work.entries
    status, points, normals, reflected, distances = results
    for n in range(valid.size):
        if not valid[n]:
            continue
        k, o = 3 * n, 0 if origins.size == 3 else 3 * n
        dx, dy, dz = units[k], units[k + 1], units[k + 2]
        ray[OX], ray[OY], ray[OZ], ray[DX], ray[DY], ray[DZ] = origins[o], origins[o + 1], origins[o + 2], dx, dy, dz
        # Of the axes that are not nearest to it, and of the cross product with that.
        ax, ay, az = (dy, -dx, 0.0) if abs(dz) < 0.9 else (0.0, dz, -dy)
        length = np.sqrt(ax * ax + ay * ay + az * az)
        ax, ay, az = ax / length, ay / length, az / length
        ray[AX], ray[AY], ray[AZ] = ax, ay, az
        ray[BX], ray[BY], ray[BZ] = dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax
        ix, iy, iz = inverse(dx), inverse(dy), inverse(dz)
        before = distances[n] if distances[n] < np.inf else np.inf
        found[T] = before
        unsure = False
        stack[0], entries[0] = 0, entered(nodes, 0, ray[OX], ray[OY], ray[OZ], ix, iy, iz, before)
        left = 1
        while left > 0:
            left -= 1
            if not entries[left] < found[T]:
                continue
            node = stack[left]
            child, size = links[node, 0], links[node, 1]
            if size > 0:
                for piece in range(child, child + size):
                    if entered(boxes, piece, ray[OX], ray[OY], ray[OZ], ix, iy, iz, found[T]) < np.inf:
                        face = pieces.owners[piece]
                        one = _Piece(pieces.coefficients, pieces.bases[piece], pieces.counts[face], pieces.sizes[face],
                                     pieces.numbers[piece])
                        if _meet_piece(one, pieces.first, pieces.edges, work) == UNSURE:
                            unsure = True
                continue
            left = put_children(nodes, child, ray[OX], ray[OY], ray[OZ], ix, iy, iz, found[T], stack, entries, left)
        if not found[T] < before:
            if unsure and status[n] == OUTSIDE:
                status[n] = LOST
            continue
        t = found[T]
        distances[n] = t
        if found[FACING] < 0.0 and abs(found[NX]) <= 1.0:
            status[n] = HIT
            nx, ny, nz = found[NX], found[NY], found[NZ]
            twice = 2.0 * (dx * nx + dy * ny + dz * nz)
            points[k], points[k + 1], points[k + 2] = found[X], found[Y], found[Z]
            normals[k], normals[k + 1], normals[k + 2] = nx, ny, nz
            reflected[k], reflected[k + 1], reflected[k + 2] = dx - twice * nx, dy - twice * ny, dz - twice * nz
        else:
            status[n] = BEHIND if abs(found[NX]) <= 1.0 else LOST
            for c in range(k, k + 3):
                points[c] = normals[c] = reflected[c] = np.nan


def first_hits(pieces: Pieces, origins: Array, units: Array, valid: NDArray[np.bool_], results: Results) -> None:
    """Put what rays meet first of the pieces into the results, where it is nearer than what stands there.

    A ray is LOST where it runs along a surface for so long that the search is ended.

    Parameters
    ----------
    pieces : of one surface or several.
    origins, units : (3,) or (3n,), mm, and (3n,), unit, flat.
    valid : (n,), which rays are rays.
    results : of n rays; their distance is NaN where nothing was met.
    """
    def work(i: int, j: int) -> None:
        _first_hits(pieces, _Work.empty(), origins if origins.size == 3 else origins[3 * i:3 * j], units[3 * i:3 * j],
                    valid[i:j], results.of_rays(i, j))

    parallel_for(work, len(valid))
