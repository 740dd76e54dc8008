"""The compiled rays of one eye into one sheet z(x, y), one ray at a time: image points, and roots along the sheet's rim.

What takes many steps on few rays is done in one call, where a call a step would cost more than its rays. The rays meet the
sheet as those of height_field.py do.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.blocks import clamp
from raytrace.kernels.cells import span
from raytrace.kernels.compiled import compiled
from raytrace.kernels.height_field import SHALLOWEST
from raytrace.kernels.height_field_search import MAX_STEPS as MAX_SAFE_STEPS
from raytrace.kernels.outcomes import ACCEPTED, BEHIND, HIT, INVALID, LOST, MAX_STEPS, NEAREST_MM, OUTSIDE, RESIDUAL
from raytrace.kernels.trimming import odd_to_the_right

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# What is known of a place of the sheet and of the ray that meets it there.
Z, Z_X, Z_Y, HALF_XX, XY, HALF_YY, AT_X, AT_Y, T, X, Y, HEIGHT = range(12)
# Radians: a ray that passes its target by less is so near that Newton goes on along the sheet itself.
NEAR = 0.05
MAX_ROOT_STEPS = 80  # halving alone takes 37


class Sheet(NamedTuple):
    """A sheet z(x, y) inside trimming loops, as `HeightField` and `Trimming` have it.

    one_sided : 1 where only its upper side reflects.
    """

    powers: int
    flat: Array
    ends_x: Array
    ends_y: Array
    middle_x: Array
    middle_y: Array
    lookup_x: NDArray[np.int32]
    lookup_y: NDArray[np.int32]
    top: float
    bottom: float
    steepest: float
    bend: float
    one_sided: bool
    first: NDArray[np.int64]
    edges: Array
    low: float
    inverse_height: float


class Posed(NamedTuple):
    """Eyes (m, 3) in mirror coordinates, mm, and for each the rotation (m, 3, 3) and offset (m, 3) to other coordinates."""

    eyes: Array
    rotations: Array
    offsets: Array


NONE: Index = np.empty(0, dtype=np.intp)  # all rays are those of the first eye


class Rim(NamedTuple):
    """The curves that bound a sheet, in (x, y).

    From each of n vertices, `pieces` lead to the following one, from piece `first` on; pieces go from start (m, 2) to end
    (m, 2).
    """

    start: Array
    end: Array
    first: Index
    pieces: Index


@compiled(fastmath={"contract"}, inline="always")
def _cell(powers, flat, k, a, b, q):
    """z, z_x, z_y, z_xx/2, z_xy, z_yy/2 at (a, b) from the middle of the cell whose coefficients begin at k, into q."""
    z = z_a = z_b = z_aa = z_ab = z_bb = 0.0
    for r in range(powers):
        row, slope, bend = flat[k + r * powers], 0.0, 0.0
        for c in range(1, powers):
            bend = bend * b + slope
            slope = slope * b + row
            row = row * b + flat[k + r * powers + c]
        z_aa = z_aa * a + z_a
        z_a = z_a * a + z
        z = z * a + row
        z_ab = z_ab * a + z_b
        z_b = z_b * a + slope
        z_bb = z_bb * a + bend
    q[Z], q[Z_X], q[Z_Y], q[HALF_XX], q[XY], q[HALF_YY] = z, z_a, z_b, z_aa, z_ab, z_bb


@compiled(fastmath={"contract"}, _nrt=False)
def _taylor(s, x, y, q):
    """z, z_x, z_y, z_xx/2, z_xy, z_yy/2 at the place of the sheet nearest to (x, y), then that place, into q.

    Loops over a number of powers that is written down unroll: those of degrees 3, 5 and 7 are.
    """
    x, y = clamp(x, s.ends_x[0], s.ends_x[-2]), clamp(y, s.ends_y[0], s.ends_y[-2])
    i, j = span(x, s.ends_x, s.lookup_x), span(y, s.ends_y, s.lookup_y)
    a, b = x - s.middle_x[i], y - s.middle_y[j]
    k = np.int64(np.uint32((i * (s.ends_y.size - 2) + j) * s.powers * s.powers))
    if s.powers == 6:
        _cell(6, s.flat, k, a, b, q)
    elif s.powers == 4:
        _cell(4, s.flat, k, a, b, q)
    elif s.powers == 8:
        _cell(8, s.flat, k, a, b, q)
    else:
        _cell(s.powers, s.flat, k, a, b, q)
    q[AT_X], q[AT_Y] = x, y


@compiled(_nrt=False)
def _inside(s, u, v):
    """Even-odd rule on the trimming polygon; its edges are sorted into strips of v."""
    strip = int((v - s.low) * s.inverse_height)
    if strip < 0 or strip >= s.first.size - 1 or v < s.low:
        return False
    return odd_to_the_right(s.edges, s.first[strip], s.first[strip + 1], u, v)


@compiled(_nrt=False)
def _once(s, dx, dy, dz):
    """Whether a ray comes down steeply enough to meet the sheet only once."""
    return dz <= -SHALLOWEST and dz * dz > s.steepest * (dx * dx + dy * dy)


@compiled(fastmath={"contract"}, _nrt=False)
def _first_hit(s, ox, oy, oz, dx, dy, dz, start, q):
    """What a ray, from where and in what unit direction, meets first: its status, and where it does in q.

    start : the distance at which Newton begins where the ray can meet the sheet only once.
    """
    if not abs(ox) + abs(oy) + abs(oz) + abs(dx) + abs(dy) + abs(dz) < np.inf:
        return INVALID
    if _once(s, dx, dy, dz):
        t, missed = start, np.inf
        limit = RESIDUAL * (abs(t) + abs(ox) + abs(oy) + abs(oz))
        settled = False
        for _ in range(MAX_STEPS):
            x, y = ox + t * dx, oy + t * dy
            _taylor(s, x, y, q)
            above = oz + t * dz - (q[Z] + q[Z_X] * (x - q[AT_X]) + q[Z_Y] * (y - q[AT_Y]))
            t -= above / (dz - q[Z_X] * dx - q[Z_Y] * dy)
            miss, bound = abs(above), limit * np.sqrt(1.0 + q[Z_X] * q[Z_X] + q[Z_Y] * q[Z_Y])
            settled = miss <= bound or (miss <= ACCEPTED * bound and miss >= 0.5 * missed)
            missed = miss
            if settled:
                break
        if settled or missed <= ACCEPTED * bound:
            x, y = ox + t * dx, oy + t * dy
            facing = dx * -q[Z_X] + dy * -q[Z_Y] + dz
            if t > NEAREST_MM and facing < 0.0 and s.ends_x[0] <= x <= s.ends_x[-2] and s.ends_y[0] <= y <= s.ends_y[-2]:
                q[T], q[X], q[Y], q[HEIGHT] = t, x, y, oz + t * dz
                return HIT if _inside(s, x, y) else OUTSIDE
    return _search(s, ox, oy, oz, dx, dy, dz, q)


@compiled(fastmath={"contract"}, _nrt=False)
def _search(s, ox, oy, oz, dx, dy, dz, q):
    """`raytrace.kernels.height_field_search`  for one ray."""
    near, far = NEAREST_MM, np.inf
    for o, d, from_, to in ((ox, dx, s.ends_x[0], s.ends_x[-2]), (oy, dy, s.ends_y[0], s.ends_y[-2]),
                            (oz, dz, s.bottom, s.top)):
        if d == 0.0:
            if not from_ <= o <= to:
                far = -np.inf
        else:
            a, b = (from_ - o) / d, (to - o) / d
            near, far = max(near, min(a, b)), min(far, max(a, b))
    most = s.bend * (dx * dx + dy * dy) + 1e-300
    t = near
    limit = RESIDUAL * (abs(ox) + abs(oy) + abs(oz) + abs(far) + abs(s.top) + abs(s.bottom))
    for _ in range(MAX_SAFE_STEPS):
        if not t <= far:
            return OUTSIDE
        x, y = ox + t * dx, oy + t * dy
        _taylor(s, x, y, q)
        above = oz + t * dz - q[Z]
        rise = dz - q[Z_X] * dx - q[Z_Y] * dy
        steep = np.sqrt(1.0 + q[Z_X] * q[Z_X] + q[Z_Y] * q[Z_Y])
        if abs(above) <= ACCEPTED * limit * steep:
            if rise != 0.0:  # the last step is Newton's
                t -= above / rise
                x, y = ox + t * dx, oy + t * dy
                _taylor(s, x, y, q)
                steep = np.sqrt(1.0 + q[Z_X] * q[Z_X] + q[Z_Y] * q[Z_Y])
            if _inside(s, x, y):
                q[T], q[X], q[Y], q[HEIGHT] = t, x, y, oz + t * dz
                return BEHIND if s.one_sided and rise >= 0.0 else HIT
            # Trimmed away: on behind it, where the distance is no rounding any more.
            t += max(1e3 * ACCEPTED * limit * steep / max(abs(rise), 1e-6), NEAREST_MM)
            continue
        side = 1.0 if above > 0.0 else -1.0
        slope = side * rise
        root = np.sqrt(slope * slope + 2.0 * most * abs(above))
        t += 2.0 * abs(above) / (root - slope) if slope < 0.0 else (slope + root) / most
    return LOST


@compiled(fastmath={"contract"}, _nrt=False)
def _miss(wanted, n, at_infinity, points, directions, miss, axes):
    """`misses` of image_points.py for one ray: along two axes, NaN where it leaves the target behind; (d·τ)/|T − P|."""
    to_x, to_y, to_z = wanted[n, 0], wanted[n, 1], wanted[n, 2]
    if not at_infinity:
        to_x, to_y, to_z = to_x - points[0], to_y - points[1], to_z - points[2]
    length = np.sqrt(to_x * to_x + to_y * to_y + to_z * to_z)
    axes[6], axes[7], axes[8] = to_x / length, to_y / length, to_z / length
    along = axes[6] * directions[0] + axes[7] * directions[1] + axes[8] * directions[2]
    least = int(axes[9])
    a, b = (least + 1) % 3, (least + 2) % 3
    across = np.sqrt(axes[6 + a] * axes[6 + a] + axes[6 + b] * axes[6 + b])
    axes[least], axes[a], axes[b] = 0.0, axes[6 + b] / across, -axes[6 + a] / across
    for c in range(3):
        i, j = (c + 1) % 3, (c + 2) % 3
        axes[3 + c] = axes[6 + i] * axes[j] - axes[6 + j] * axes[i]
    miss[0] = miss[1] = np.nan
    if along > 0.0:
        for k in range(2):
            miss[k] = (axes[3 * k] * directions[0] + axes[3 * k + 1] * directions[1] + axes[3 * k + 2] * directions[2])
    return 0.0 if at_infinity else along / length


@compiled(fastmath={"contract"}, _nrt=False)
def _newton(ray, length, on_sheet, q, axes, reach, miss, longest, step):
    """Newton's step, no longer than `longest`, for the place whose ray is one.

    Of the picture plane, `length` from the eye, or of the sheet's (x, y). Derivatives as in image_points.py: dP = t·(δ −
    ω·(n·δ)/(n·ω)), dd = δ − 2(δ·n + ω·dn)·n − 2(ω·n)·dn, with the normal's change dn = −(h − n·(n·h))/w, h = H·dP the second
    derivatives' and w = √(1 + z_x² + z_y²); on the sheet dP is given, and δ = (dP − ω·(ω·dP))/t.
    """
    nz, near = 1.0 / np.sqrt(1.0 + q[Z_X] * q[Z_X] + q[Z_Y] * q[Z_Y]), 1.0 / length
    nx, ny = -q[Z_X] * nz, -q[Z_Y] * nz
    along = ray[0] * nx + ray[1] * ny + ray[2] * nz
    s00 = s01 = s10 = s11 = 0.0
    for i in range(2):
        if on_sheet:
            px, py, pz = (1.0, 0.0, q[Z_X]) if i == 0 else (0.0, 1.0, q[Z_Y])
            far = ray[0] * px + ray[1] * py + ray[2] * pz
            ex, ey, ez = (px - ray[0] * far) * near, (py - ray[1] * far) * near, (pz - ray[2] * far) * near
            leaning = ex * nx + ey * ny + ez * nz
        else:
            ex, ey, ez = -ray[0] * ray[i] * near, -ray[1] * ray[i] * near, -ray[2] * ray[i] * near
            if i == 0:
                ex += near
            else:
                ey += near
            leaning = ex * nx + ey * ny + ez * nz
            share = leaning / along
            px, py, pz = q[T] * (ex - ray[0] * share), q[T] * (ey - ray[1] * share), q[T] * (ez - ray[2] * share)
        hx, hy = 2.0 * q[HALF_XX] * px + q[XY] * py, q[XY] * px + 2.0 * q[HALF_YY] * py
        over = nx * hx + ny * hy
        bx, by, bz = (nx * over - hx) * nz, (ny * over - hy) * nz, nz * over * nz
        twice = leaning + bx * ray[0] + by * ray[1] + bz * ray[2]
        vx = ex - 2.0 * twice * nx - 2.0 * along * bx + reach * px
        vy = ey - 2.0 * twice * ny - 2.0 * along * by + reach * py
        vz = ez - 2.0 * twice * nz - 2.0 * along * bz + reach * pz
        first = axes[0] * vx + axes[1] * vy + axes[2] * vz
        second = axes[3] * vx + axes[4] * vy + axes[5] * vz
        if i == 0:
            s00, s10 = first, second
        else:
            s01, s11 = first, second
    determinant = s00 * s11 - s01 * s10
    x, y = (s01 * miss[1] - s11 * miss[0]) / determinant, (s10 * miss[0] - s00 * miss[1]) / determinant
    far = np.sqrt(x * x + y * y)
    if far < np.inf:
        shorter = longest / far if far > longest else 1.0
        step[0], step[1] = shorter * x, shorter * y


@compiled(fastmath={"contract"}, _nrt=False)
def _reflected_ray(ray, q, out):
    """d − 2(d·n)n."""
    twice = 2.0 * (ray[2] - ray[0] * q[Z_X] - ray[1] * q[Z_Y]) / (1.0 + q[Z_X] * q[Z_X] + q[Z_Y] * q[Z_Y])
    out[0], out[1], out[2] = ray[0] + twice * q[Z_X], ray[1] + twice * q[Z_Y], ray[2] - twice


@compiled(fastmath={"contract"}, _nrt=False)
def _settle(w, s, eye, wanted, n, at_infinity, settled, passes, longest, reach, now):
    """Newton on the sheet's (x, y) itself, from what is near already: one look at the sheet a step, and no search.

    By what angle the best place passes, which is then in w[:12]; NaN where that is not within `passes`, or where the eye is not
    sure to see it first. The working array holds the place to start from, its ray, misses and axes.
    """
    q, ray, point, out, miss, axes, step = w[:12], w[12:15], w[15:18], w[18:21], w[21:23], w[23:33], w[33:35]
    x, y, length, best = q[X], q[Y], q[T], now
    for _ in range(MAX_STEPS):
        _newton(ray, length, True, q, axes, reach, miss, longest, step)
        x, y = x + step[0], y + step[1]
        _taylor(s, x, y, q)
        point[0], point[1], point[2] = x, y, q[Z]
        dx, dy, dz = x - eye[0], y - eye[1], q[Z] - eye[2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        ray[0], ray[1], ray[2] = dx / length, dy / length, dz / length
        facing = ray[2] - ray[0] * q[Z_X] - ray[1] * q[Z_Y]
        if not (q[AT_X] == x and q[AT_Y] == y and facing < 0.0 and _once(s, ray[0], ray[1], ray[2])):
            return np.nan
        _reflected_ray(ray, q, out)
        reach = _miss(wanted, n, at_infinity, point, out, miss, axes)
        here = np.sqrt(miss[0] * miss[0] + miss[1] * miss[1])
        if not here < best:
            break
        best, q[X], q[Y], q[HEIGHT] = here, x, y, q[Z]
        if here <= settled:
            break
    return best if best <= passes and _inside(s, q[X], q[Y]) else np.nan


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _solve(w, s, eyes, of, starts, wanted, at_infinity, max_steps, settled, passes, smallest, longest, halved_to, best, kept,
           leaving):
    q, ray, point, out, miss, axes, step = (w[:12], w[12:15], w[15:18], w[18:21], w[21:23], w[23:33], w[33:35])
    for n in range(starts.shape[0]):
        eye = eyes[of[n] if of.size else 0]
        at_x, at_y = starts[n, 0], starts[n, 1]
        best[n], kept[n, 0], kept[n, 1] = np.inf, at_x, at_y
        leaving[n, 0] = leaving[n, 1] = leaving[n, 2] = np.nan
        finite = abs(at_x) + abs(at_y) + abs(wanted[n, 0]) + abs(wanted[n, 1]) + abs(wanted[n, 2]) < np.inf
        size = np.inf
        for c in range(3):  # the axis that misses are measured from is the same for all rays to one target
            far = abs(wanted[n, c] if at_infinity else wanted[n, c] - eye[c])
            if far < size:
                axes[9], size = c, far
        step[0] = step[1] = shortest = 0.0
        plane = True  # whether to begin from the plane above the sheet, or from the place that was met last
        for _ in range(max_steps if finite else 0):
            x, y, z = at_x - eye[0], at_y - eye[1], -eye[2]
            length = np.sqrt(x * x + y * y + z * z)
            ray[0], ray[1], ray[2] = x / length, y / length, z / length
            begin = (s.top - eye[2]) / ray[2]
            if not plane:
                begin = (((q[X] - eye[0]) * q[Z_X] + (q[Y] - eye[1]) * q[Z_Y] - (q[HEIGHT] - eye[2]))
                         / (ray[0] * q[Z_X] + ray[1] * q[Z_Y] - ray[2]))
            status = _first_hit(s, eye[0], eye[1], eye[2], ray[0], ray[1], ray[2], begin, q)
            plane = status != HIT
            now, reach = np.nan, 0.0
            if status == HIT:
                point[0], point[1], point[2] = q[X], q[Y], q[HEIGHT]
                _reflected_ray(ray, q, out)
                reach = _miss(wanted, n, at_infinity, point, out, miss, axes)
                now = np.sqrt(miss[0] * miss[0] + miss[1] * miss[1])
            step[0], step[1] = 0.5 * step[0], 0.5 * step[1]
            if now < best[n]:  # not where it is NaN
                best[n], kept[n, 0], kept[n, 1] = now, at_x, at_y
                leaving[n, 0], leaving[n, 1], leaving[n, 2] = point[0], point[1], point[2]
                if now <= settled:
                    break
                if now < NEAR:
                    found = _settle(w, s, eye, wanted, n, at_infinity, settled, passes, longest, reach, now)
                    if found <= passes:
                        lowered = eye[2] / (eye[2] - q[HEIGHT])
                        best[n], leaving[n, 0], leaving[n, 1], leaving[n, 2] = found, q[X], q[Y], q[HEIGHT]
                        kept[n, 0], kept[n, 1] = eye[0] + (q[X] - eye[0]) * lowered, eye[1] + (q[Y] - eye[1]) * lowered
                        break
                    ray[0], ray[1], ray[2] = x / length, y / length, z / length  # all as it was
                    _first_hit(s, eye[0], eye[1], eye[2], ray[0], ray[1], ray[2], begin, q)
                    point[0], point[1], point[2] = q[X], q[Y], q[HEIGHT]
                    _reflected_ray(ray, q, out)
                    reach = _miss(wanted, n, at_infinity, point, out, miss, axes)
                _newton(ray, length, False, q, axes, reach, miss, longest, step)
                shortest = halved_to * max(abs(step[0]), abs(step[1]))
            elif best[n] <= passes:
                break
            if not max(abs(step[0]), abs(step[1])) > max(smallest, shortest):
                break
            at_x, at_y = kept[n, 0] + step[0], kept[n, 1] + step[1]


def image_points(sheet: Sheet, eyes: Array, of: Index, starts: Array, wanted: Array, at_infinity: bool, max_steps: int,
                 settled: float, passes: float, smallest: float, longest: float, halved_to: float,
                 ) -> tuple[Array, Array, Array]:
    """Newton for the places of the picture plane z = 0 whose rays are reflected towards targets, from starts (n, 2).

    Parameters
    ----------
    sheet : in mirror coordinates, mm.   eyes : (m, 3), there.   of : (n,), whose ray each is; empty where it is the first's.
    starts : (n, 2).   wanted : (n, 3), targets, or unit directions.   at_infinity : whether they are directions.
    max_steps : rays for each.   settled, passes : radians, at which it ends, and at which what betters nothing ends it.
    smallest, longest : steps, mm.   halved_to : of Newton's own step, down to which it is halved.

    Returns
    -------
    The best places (n, 2), where their rays leave (n, 3), and by what angles they pass, about (n,).
    """
    n = len(starts)
    best, kept, leaving = np.empty(n), np.empty((n, 2)), np.empty((n, 3))
    _solve(np.zeros(40), sheet, eyes, of, starts, wanted, at_infinity, max_steps, settled, passes, smallest, longest, halved_to,
           best, kept, leaving)
    return kept, leaving, best


# --- places of the picture plane, one by one ---------------------------------------------------------------------------


@compiled(fastmath={"contract"}, _nrt=False)
def _ray_through(s, eye, x, y, w):
    """What the eye's ray through (x, y) of the picture plane meets first: its status; where in w[:12], the ray in w[12:15]."""
    dx, dy, dz = x - eye[0], y - eye[1], -eye[2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    w[12], w[13], w[14] = dx / length, dy / length, dz / length
    return _first_hit(s, eye[0], eye[1], eye[2], w[12], w[13], w[14], (s.top - eye[2]) / w[14], w)


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _trace(w, s, eyes, rotations, offsets, of, places, status, points, directions, on_mirror):
    for n in range(places.shape[0]):
        p = of[n] if of.size else 0
        eye, rotation, offset = eyes[p], rotations[p], offsets[p]
        status[n] = _ray_through(s, eye, places[n, 0], places[n, 1], w)
        if status[n] != HIT:
            for c in range(3):
                points[n, c] = directions[n, c] = on_mirror[n, c] = np.nan
            continue
        twice = (2.0 * (w[14] - w[12] * w[Z_X] - w[13] * w[Z_Y])) / (1.0 + w[Z_X] * w[Z_X] + w[Z_Y] * w[Z_Y])
        dx, dy, dz = w[12] + twice * w[Z_X], w[13] + twice * w[Z_Y], w[14] - twice
        on_mirror[n, 0], on_mirror[n, 1], on_mirror[n, 2] = w[X], w[Y], w[HEIGHT]
        for c in range(3):
            points[n, c] = rotation[c, 0] * w[X] + rotation[c, 1] * w[Y] + rotation[c, 2] * w[HEIGHT] + offset[c]
            directions[n, c] = rotation[c, 0] * dx + rotation[c, 1] * dy + rotation[c, 2] * dz


def trace(sheet: Sheet, posed: Posed, places: Array, of: Index = NONE) -> tuple[NDArray[np.int8], Array, Array, Array]:
    """Trace eyes' rays through points of the picture plane, of which there are too few for blocks of them to be worth it.

    Parameters
    ----------
    sheet, posed, of : as in `reflected`.   places : (n, 2), mm.

    Returns
    -------
    Status (n,); points and unit directions (n, 3) in the other coordinates; points (n, 3) in the mirror's.
    """
    n = len(places)
    status, points, directions, on_mirror = np.empty(n, dtype=np.int8), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    _trace(np.zeros(15), sheet, posed.eyes, posed.rotations, posed.offsets, of, places, status, points, directions, on_mirror)
    return status, points, directions, on_mirror


@compiled(_nrt=False)
def _frame(x, y, z, f):
    """To the right, level, and upward, as one looks along a unit direction, into f (6,)."""
    across = np.sqrt(x * x + y * y)
    f[0], f[1], f[2] = y / across, -x / across, 0.0
    f[3], f[4], f[5] = f[1] * z - f[2] * y, f[2] * x - f[0] * z, f[0] * y - f[1] * x


@compiled(fastmath={"contract"}, _nrt=False)
def _differential(w, rotation, jacobian, shift):
    """How the ray in w[12:15], that meets the sheet at what is in w[:12], leaves when it turns: jacobian and shift (2, 2)."""
    before, after, turn, p, d = w[15:21], w[21:27], w[27:30], w[30:33], w[33:36]
    root = np.sqrt(1.0 + w[Z_X] * w[Z_X] + w[Z_Y] * w[Z_Y])
    nx, ny, nz = -w[Z_X] / root, -w[Z_Y] / root, 1.0 / root
    along = w[12] * nx + w[13] * ny + w[14] * nz
    rx, ry, rz = w[12] - 2.0 * along * nx, w[13] - 2.0 * along * ny, w[14] - 2.0 * along * nz
    for c in range(3):
        turn[c] = rotation[c, 0] * w[12] + rotation[c, 1] * w[13] + rotation[c, 2] * w[14]
    _frame(turn[0], turn[1], turn[2], before)
    for c in range(3):
        turn[c] = rotation[c, 0] * rx + rotation[c, 1] * ry + rotation[c, 2] * rz
    _frame(turn[0], turn[1], turn[2], after)
    for j in range(2):
        for c in range(3):
            turn[c] = 0.0
            for k in range(3):
                turn[c] += rotation[k, c] * before[3 * j + k]
        leaning = turn[0] * nx + turn[1] * ny + turn[2] * nz
        share = leaning / along
        for c in range(3):
            p[c] = w[T] * (turn[c] - w[12 + c] * share)
        hx, hy = 2.0 * w[HALF_XX] * p[0] + w[XY] * p[1], w[XY] * p[0] + 2.0 * w[HALF_YY] * p[1]
        over = nx * hx + ny * hy
        bx, by, bz = -(hx - nx * over) / root, -(hy - ny * over) / root, nz * over / root
        twice = leaning + bx * w[12] + by * w[13] + bz * w[14]
        d[0] = turn[0] - 2.0 * twice * nx - 2.0 * along * bx
        d[1] = turn[1] - 2.0 * twice * ny - 2.0 * along * by
        d[2] = turn[2] - 2.0 * twice * nz - 2.0 * along * bz
        for i in range(2):
            jacobian[i, j] = shift[i, j] = 0.0
            for c in range(3):
                at = rotation[c, 0] * d[0] + rotation[c, 1] * d[1] + rotation[c, 2] * d[2]
                jacobian[i, j] += after[3 * i + c] * at
                at = rotation[c, 0] * p[0] + rotation[c, 1] * p[1] + rotation[c, 2] * p[2]
                shift[i, j] += after[3 * i + c] * at


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _differentials(w, s, eye, places, rotation, jacobian, shift, path, seen):
    for n in range(places.shape[0]):
        seen[n] = _ray_through(s, eye, places[n, 0], places[n, 1], w) == HIT
        if seen[n]:
            path[n] = w[T]
            _differential(w, rotation, jacobian[n], shift[n])
        else:
            path[n] = jacobian[n, :] = shift[n, :] = np.nan


def ray_differentials(sheet: Sheet, eye: Array, places: Array, rotation: Array,
                      ) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """`raytrace.viewing.ray_differentials` of the rays through points (n, 2) of the picture plane.

    Returns
    -------
    jacobian, shift (n, 2, 2), path (n,) and seen (n,), as `RayDifferentials` has them.
    """
    n = len(places)
    jacobian, shift, path, seen = np.empty((n, 2, 2)), np.empty((n, 2, 2)), np.empty(n), np.empty(n, dtype=np.bool_)
    _differentials(np.zeros(36), sheet, eye, places, rotation, jacobian, shift, path, seen)
    return jacobian, shift, path, seen


# --- the rim ----------------------------------------------------------------------------------------------------------


@compiled(fastmath={"contract"}, _nrt=False)
def _reflected_at(s, eye, x, y, z, z_x, z_y, rotation, offset, ray):
    """How the eye's ray to a point of the sheet leaves: point and direction, then both turned and moved, into ray (12,).

    Whether it is sure to meet that point first.
    """
    dx, dy, dz = x - eye[0], y - eye[1], z - eye[2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / length, dy / length, dz / length
    facing = dz - dx * z_x - dy * z_y
    twice = 2.0 * facing / (1.0 + z_x * z_x + z_y * z_y)
    ray[0], ray[1], ray[2], ray[3], ray[4], ray[5] = x, y, z, dx + twice * z_x, dy + twice * z_y, dz - twice
    for c in range(3):
        ray[6 + c] = rotation[c, 0] * x + rotation[c, 1] * y + rotation[c, 2] * z + offset[c]
        ray[9 + c] = rotation[c, 0] * ray[3] + rotation[c, 1] * ray[4] + rotation[c, 2] * ray[5]
    return facing < 0.0 and length > NEAREST_MM and _once(s, dx, dy, dz)


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _reflected(w, s, eyes, rotations, offsets, of, surface, places, points, directions):
    for n in range(surface.shape[0]):
        p = of[n] if of.size else 0
        eye, rotation, offset = eyes[p], rotations[p], offsets[p]
        x, y, z, z_x, z_y = surface[n, 0], surface[n, 1], surface[n, 2], surface[n, 3], surface[n, 4]
        if not _reflected_at(s, eye, x, y, z, z_x, z_y, rotation, offset, w):
            return False
        lowered = eye[2] / (eye[2] - surface[n, 2])
        places[n, 0], places[n, 1] = eye[0] + (w[0] - eye[0]) * lowered, eye[1] + (w[1] - eye[1]) * lowered
        for c in range(3):
            points[n, c], directions[n, c] = w[6 + c], w[9 + c]
    return True


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _surface_points(w, s, at, found):
    for n in range(at.shape[0]):
        _taylor(s, at[n, 0], at[n, 1], w)
        found[n, 0], found[n, 1], found[n, 2], found[n, 3], found[n, 4] = w[AT_X], w[AT_Y], w[Z], w[Z_X], w[Z_Y]


@compiled(nogil=True, _nrt=False)
def _are_inside(s, points, answer):
    for n in range(points.shape[0]):
        answer[n] = _inside(s, points[n, 0], points[n, 1])


def inside(sheet: Sheet, points: Array) -> NDArray[np.bool_]:
    """Whether points (n, 3) of the sheet lie inside its trimming loops."""
    answer = np.empty(len(points), dtype=np.bool_)
    _are_inside(sheet, points, answer)
    return answer


def surface_points(sheet: Sheet, at: Array) -> Array:
    """x, y, z, z_x and z_y, (n, 5), at the places of the sheet nearest to at (n, 2)."""
    found = np.empty((len(at), 5))
    _surface_points(np.zeros(12), sheet, at, found)
    return found


@compiled(_nrt=False)
def _on_rim(r, k, t, at):
    """(x, y) at the share t of the way from vertex k to the next, piece by piece."""
    along = t * r.pieces[k]
    piece = min(max(int(along), 0), r.pieces[k] - 1)
    share, piece = along - piece, r.first[k] + piece
    at[0] = r.start[piece, 0] + share * (r.end[piece, 0] - r.start[piece, 0])
    at[1] = r.start[piece, 1] + share * (r.end[piece, 1] - r.start[piece, 1])


@compiled(_nrt=False)
def _value(f, q, d):
    """f0 + f1..3·q + f4..6·d + f7..9·(q × d)."""
    return (f[0] + f[1] * q[0] + f[2] * q[1] + f[3] * q[2] + f[4] * d[0] + f[5] * d[1] + f[6] * d[2]
            + f[7] * (q[1] * d[2] - q[2] * d[1]) + f[8] * (q[2] * d[0] - q[0] * d[2]) + f[9] * (q[0] * d[1] - q[1] * d[0]))


@compiled(nogil=True, _nrt=False)
def values(functions, points, directions, found):
    """Functions (1, 10) or (n, 10), as in `rim_roots`, of rays from points (n, 3) along directions (n, 3): found (n,)."""
    for n in range(found.size):
        found[n] = _value(functions[n if functions.shape[0] > 1 else 0], points[n], directions[n])


@compiled(nogil=True, _nrt=False)
def _roots(w, s, r, eyes, rotations, offsets, of, functions, vertex, low, high, at_low, at_high, settled, found):
    q, ray, at = w[:12], w[12:24], w[24:26]
    for n in range(vertex.size):
        k, f, p = vertex[n], functions[n if functions.shape[0] > 1 else 0], of[n] if of.size else 0
        eye, rotation, offset = eyes[p], rotations[p], offsets[p]
        width = high[n] - low[n]
        here, other, third, at_here, at_other, at_third = 0.0, 1.0, 0.0, at_low[n], at_high[n], 0.0
        share = 0.5 if at_here == at_other else at_here / (at_here - at_other)  # a straight line: most are nearly that
        for _ in range(MAX_ROOT_STEPS):
            there = here + share * (other - here)
            _on_rim(r, k, low[n] + there * width, at)
            _taylor(s, at[0], at[1], q)
            if not _reflected_at(s, eye, q[AT_X], q[AT_Y], q[Z], q[Z_X], q[Z_Y], rotation, offset, ray):
                return False
            now = _value(f, ray[6:9], ray[9:12])
            if (now > 0.0) == (at_here > 0.0):
                third, at_third = here, at_here
            else:
                third, at_third, other, at_other = other, at_other, here, at_here
            here, at_here = there, now
            least = min(0.5, settled / max(abs(other - here), settled))
            if least >= 0.5 or at_here == 0.0:
                break
            x, y = (here - other) / (third - other), (at_here - at_other) / (at_third - at_other)
            share = 0.5
            if y * y < x and (1.0 - y) * (1.0 - y) < 1.0 - x:
                quadratic = (at_here / (at_other - at_here) * at_third / (at_other - at_third) + (third - here) / (other - here)
                             * at_here / (at_third - at_here) * at_other / (at_third - at_other))
                share = clamp(quadratic, least, 1.0 - least)
        found[n] = low[n] + (here if abs(at_here) <= abs(at_other) else other) * width
    return True


@compiled(nogil=True, _nrt=False)
def _places_on(r, vertex, share, at):
    for n in range(vertex.size):
        _on_rim(r, vertex[n], share[n], at[n])


def reflected(sheet: Sheet, posed: Posed, surface: Array, of: Index = NONE) -> tuple[Array, Array, Array] | None:
    """How eyes' rays to points of the sheet leave, without looking for these.

    Parameters
    ----------
    sheet : in mirror coordinates, mm.   posed : the eyes.
    surface : (n, 5), as `surface_points` has them.   of : (n,), whose ray each is; empty where it is the first's.

    Returns
    -------
    Places (n, 2) of the picture plane; points and unit directions (n, 3) in the other coordinates. None where an eye may not
    see one of its points, or another part of the sheet before it.
    """
    n = len(surface)
    places, points, directions = np.empty((n, 2)), np.empty((n, 3)), np.empty((n, 3))
    sure = _reflected(np.zeros(12), sheet, posed.eyes, posed.rotations, posed.offsets, of, surface, places, points, directions)
    return (places, points, directions) if sure else None


def rim_places(rim: Rim, vertex: Index, share: Array) -> Array:
    """(x, y) (n, 2) at shares (n,) of the way from vertices (n,) to the following ones."""
    at = np.empty((len(vertex), 2))
    _places_on(rim, vertex, share, at)
    return at


def rim_roots(sheet: Sheet, rim: Rim, posed: Posed, functions: Array, vertex: Index, low: Array, high: Array, at_low: Array,
              at_high: Array, settled: float, of: Index = NONE) -> Array | None:
    """Where functions of the rays to the rim vanish, as `raytrace.roots.roots` finds it.

    Parameters
    ----------
    sheet, rim, posed, of : as in `reflected`.
    functions : (1, 10) or (n, 10), of rays from q along d: f0 + f1..3·q + f4..6·d + f7..9·(q × d).
    vertex : (n,), after which each lies.   low, high : (n,), shares of the way to the next, between which it lies.
    at_low, at_high : (n,), its values there, of opposite signs.   settled : of the bracket, to which a root is known.

    Returns
    -------
    Shares (n,); None as in `reflected`.
    """
    found = np.empty(len(vertex))
    sure = _roots(np.zeros(26), sheet, rim, posed.eyes, posed.rotations, posed.offsets, of, functions, vertex, low, high,
                  at_low, at_high, settled, found)
    return found if sure else None
