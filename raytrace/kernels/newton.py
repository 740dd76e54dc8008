"""The compiled kernels that trace rays to B-splines, their normals and reflected rays, in float64.

They stand in one file because numba's cache does not notice a change in a compiled function of another module. Each takes
a run of rays on one thread and gives up the interpreter lock; `raytrace.parallel` hands out the runs. Arrays of vectors
come flat (x, y, z, x, …): numba then knows that they are contiguous. The kernels are compiled without reference counts (_nrt),
which took a third of the time, and need their working arrays from outside. What needs `powers` as a constant is inlined,
and stands at the top of the module: numba's cache does not find kernels that close over compiled functions.
"""

from __future__ import annotations

import numpy as np
from numba import njit

# What the kernels report of a ray; the values are those of `raytrace.Status`. A ray that they leave for the general search
# is LOST until that has looked.
HIT, OUTSIDE, BEHIND, LOST, INVALID = 0, 1, 3, 4, 5

BLOCK = 16  # rays taken at once: each step of the arithmetic is one short loop over them, which becomes vector instructions
MAX_STEPS = 16
MAX_STRIPS = 64  # of a trimming polygon that a block as a whole is looked up in
MANY = 32  # edges in a strip that insertion sorts more slowly than a sort does
MAX_CELLS = 4  # cells of a B-spline that a block is evaluated on as a whole; a block over more goes ray by ray
SHALLOWEST = 0.05  # −d_z below which the plane above the sheet is no good place to start from
# Newton ends where the distance from the surface is rounding: a little more than one of the numbers it is the difference of
# (their sum is taken), or, where it is a little more than that, where the next step does not halve it.
RESIDUAL = 3e-16
ACCEPTED = 30.0  # times RESIDUAL
MAX_SAFE_STEPS = 400  # of the search that cannot pass a root; a ray along the surface takes the most
# A place nearer than this to a ray's origin is the origin itself: rays may start on the surface.
NEAREST_MM = 1e-6

# Rows of a block's working array, as offsets into it: ray, parameters, surface and results. A literal offset from one array
# is what lets LLVM see that the rows do not overlap.
OX, OY, OZ, DX, DY, DZ, T, X, Y, Z, ZX, ZY, LIMIT, MISS, V0, V1, V2, NX, NY, NZ, RX, RY, RZ = (BLOCK * k for k in range(23))
HEIGHT_FIELD_ROWS = 23
# More of them, for parametric surfaces: two directions across the ray, parameters, and P, P_u, P_v in up to four
# homogeneous coordinates, each kept (K) and as last evaluated (P).
AX, AY, AZ, BX, BY, BZ, U, V, LAST, LIMIT_P = (BLOCK * k for k in range(23, 33))
P, K = BLOCK * 33, BLOCK * 45
PARAMETRIC_ROWS = 57


@njit(cache=True, error_model="numpy", _nrt=False)
def _at(index):
    """The same index, known not to be negative: numba then does not look for one that counts from the end, and the loop
    becomes vector instructions. (A slice would do the same, at the price of two atomic reference counts.)"""
    return np.int64(np.uint32(index))


@njit(cache=True, error_model="numpy", _nrt=False)
def _clamp(x, low, high):
    return min(max(x, low), high)


@njit(cache=True, error_model="numpy", _nrt=False)
def _box(w, first, second):
    """Smallest and largest value of two rows, halved and halved again: a plain reduction would go one by one.

    A NaN may give anything: indices made of it are clamped.
    """
    for m in range(BLOCK // 2):
        a, b, c, d = w[first + m], w[first + BLOCK // 2 + m], w[second + m], w[second + BLOCK // 2 + m]
        w[V0 + m], w[V1 + m], w[V2 + m], w[RX + m] = min(a, b), max(a, b), min(c, d), max(c, d)
    for m in range(BLOCK // 4):
        k = BLOCK // 4 + m
        w[V0 + m], w[V1 + m] = min(w[V0 + m], w[V0 + k]), max(w[V1 + m], w[V1 + k])
        w[V2 + m], w[RX + m] = min(w[V2 + m], w[V2 + k]), max(w[RX + m], w[RX + k])
    a_low, a_high, b_low, b_high = w[V0], w[V1], w[V2], w[RX]
    for m in range(1, BLOCK // 4):
        a_low, a_high = min(a_low, w[V0 + m]), max(a_high, w[V1 + m])
        b_low, b_high = min(b_low, w[V2 + m]), max(b_high, w[RX + m])
    return a_low, a_high, b_low, b_high


@njit(cache=True, error_model="numpy", _nrt=False)
def _span(value, ends, lookup):
    """Index of the span that holds a value between ends[0] and ends[-2]; the last span holds its end too."""
    bins = lookup.size / (ends[-2] - ends[0])
    # Clamped from below too: a NaN becomes the most negative integer.
    k = lookup[max(min(int((value - ends[0]) * bins), lookup.size - 1), 0)]
    while value >= ends[k + 1] and k < ends.size - 3:
        k += 1
    return k


@njit(cache=True, error_model="numpy", _nrt=False)
def _inside(first, edges, low, inverse_height, u, v):
    """Even-odd rule on the trimming polygon; its edges are sorted into strips of v."""
    strip = int((v - low) * inverse_height)
    if strip < 0 or strip >= first.size - 1 or v < low:
        return False
    inside = False
    for k in range(first[strip], first[strip + 1]):
        u0, v0, u1, v1 = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        if (v0 <= v) != (v1 <= v) and u < u0 + (v - v0) * (u1 - u0) / (v1 - v0):
            inside = not inside
    return inside


@njit(cache=True, error_model="numpy")
def inside(first, edges, low, inverse_height, u, v, answer):
    """`_inside` for arrays u, v (n,)."""
    for n in range(u.size):
        answer[n] = _inside(first, edges, low, inverse_height, u[n], v[n])


@njit(cache=True, error_model="numpy", _nrt=False)
def _in_interior(interior, low, inverse_height, u_low, u_high, v_low, v_high):
    """Whether a whole box lies in the part of its strips that no edge enters."""
    if not v_low > low:
        return False
    from_strip, to_strip = int((v_low - low) * inverse_height), int((v_high - low) * inverse_height)
    if to_strip >= interior.shape[0] or to_strip - from_strip > MAX_STRIPS:
        return False
    for strip in range(from_strip, to_strip + 1):  # noqa: SIM110 (a generator is no numba)
        if not (u_low > interior[strip, 0] and u_high < interior[strip, 1]):
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def into_strips(edges, low, inverse_height, strips):
    """The first edge of each strip of v (strips + 1,), and the edges in that order: one in each strip that it may touch."""
    first = np.zeros(strips + 2, dtype=np.int64)
    ends = np.empty((edges.shape[0], 2), dtype=np.int32)
    for k in range(edges.shape[0]):
        # Rounding puts a place between the ends into no strip beside theirs: what `_inside` computes rises with v, too.
        start = int((min(edges[k, 1], edges[k, 3]) - low) * inverse_height)
        stop = int((max(edges[k, 1], edges[k, 3]) - low) * inverse_height)
        ends[k, 0], ends[k, 1] = max(min(start, strips - 1), 0), max(min(stop, strips - 1), 0)
        for strip in range(ends[k, 0], ends[k, 1] + 1):
            first[strip + 2] += 1
    for strip in range(1, strips + 2):
        first[strip] += first[strip - 1]
    placed = np.empty((first[strips + 1], 4))
    for k in range(edges.shape[0]):
        for strip in range(ends[k, 0], ends[k, 1] + 1):
            to = first[strip + 1]
            for c in range(4):
                placed[to, c] = edges[k, c]
            first[strip + 1] += 1
    return first[:strips + 1].copy(), placed


@njit(cache=True, nogil=True, error_model="numpy")
def interior_spans(first, edges, low, inverse_height, interior):
    """The widest interval of u inside the polygon that no edge enters, in each strip of v; (inf, −inf) for none."""
    most = 0
    for strip in range(first.size - 1):
        most = max(most, first[strip + 1] - first[strip])
    left, right = np.empty(most), np.empty(most)
    for strip in range(first.size - 1):
        interior[strip, 0], interior[strip, 1] = np.inf, -np.inf
        bottom, top = low + strip / inverse_height, low + (strip + 1) / inverse_height
        count = first[strip + 1] - first[strip]
        for n in range(count):
            u0, v0, u1, v1 = edges[first[strip] + n]
            if v0 > v1:
                u0, v0, u1, v1 = u1, v1, u0, v0
            # The part of the edge within the strip; edges that only pass near it count with their nearer end.
            a, b = _clamp(bottom, v0, v1), _clamp(top, v0, v1)
            ua = u0 + (a - v0) * (u1 - u0) / (v1 - v0) if v1 > v0 else u0
            ub = u0 + (b - v0) * (u1 - u0) / (v1 - v0) if v1 > v0 else u1
            left[n], right[n] = min(ua, ub), max(ua, ub)
        if count > MANY:
            order = np.argsort(left[:count])
            left[:count], right[:count] = left[:count][order], right[:count][order]
        for n in range(1, count):  # sorted by insertion: there are a handful, or they are in order
            for k in range(n, 0, -1):
                if left[k] >= left[k - 1]:
                    break
                left[k], left[k - 1], right[k], right[k - 1] = left[k - 1], left[k], right[k - 1], right[k]
        reach = -np.inf
        middle = 0.5 * (bottom + top)
        for n in range(count):
            gap = left[n] - reach
            if gap > max(interior[strip, 1] - interior[strip, 0], 0.0) and reach > -np.inf \
                    and _inside(first, edges, low, inverse_height, 0.5 * (reach + left[n]), middle):
                interior[strip, 0], interior[strip, 1] = reach, left[n]
            reach = max(reach, right[n])


@njit(cache=True, error_model="numpy", _nrt=False)
def _unit(directions, n, w, m):
    """Ray n to unit length into lane m, whatever its length; False where it has no direction."""
    x, y, z = directions[3 * n], directions[3 * n + 1], directions[3 * n + 2]
    largest = max(abs(x), max(abs(y), abs(z)))
    if not (largest > 0.0 and largest < np.inf and abs(x) >= 0.0 and abs(y) >= 0.0 and abs(z) >= 0.0):
        return False
    # 2^−1074 … 2^1024: their squares over- and underflow. A power of two scales without rounding.
    scale = 1.0 if 1e-100 < largest < 1e100 else 2.0 ** (-np.floor(np.log2(largest)))
    x, y, z = x * scale, y * scale, z * scale
    length = np.sqrt(x * x + y * y + z * z)
    w[DX + m], w[DY + m], w[DZ + m] = x / length, y / length, z / length
    return True


@njit(cache=True, error_model="numpy", _nrt=False)
def _load(origins, directions, start, count, w):
    """Rays start … start + count into the first lanes; the lanes after them repeat the last ray.

    Returns how many have no length of their own that a square root can take: `_unit` has to look at them.
    """
    k = _at(3 * start)
    if count == BLOCK:
        for m in range(BLOCK):
            w[DX + m], w[DY + m], w[DZ + m] = directions[k + 3 * m], directions[k + 3 * m + 1], directions[k + 3 * m + 2]
    else:
        for m in range(BLOCK):
            n = _at(k + 3 * min(m, count - 1))
            w[DX + m], w[DY + m], w[DZ + m] = directions[n], directions[n + 1], directions[n + 2]
    if origins.size == 3:
        for m in range(BLOCK):
            w[OX + m], w[OY + m], w[OZ + m] = origins[0], origins[1], origins[2]
    else:
        for m in range(BLOCK):
            n = _at(k + 3 * min(m, count - 1))
            w[OX + m], w[OY + m], w[OZ + m] = origins[n], origins[n + 1], origins[n + 2]
    odd = 0
    for m in range(BLOCK):
        square = w[DX + m] * w[DX + m] + w[DY + m] * w[DY + m] + w[DZ + m] * w[DZ + m]
        scale = 1.0 / np.sqrt(square)
        w[DX + m] *= scale
        w[DY + m] *= scale
        w[DZ + m] *= scale
        finite = abs(w[OX + m]) + abs(w[OY + m]) + abs(w[OZ + m]) < np.inf
        odd += 1 - int((square > 1e-200) & (square < 1e200) & finite)
    return odd


@njit(cache=True, error_model="numpy", _nrt=False)
def fix_degenerate_rays(origins, directions, start, count, w, state):
    """The lanes of a block in which some ray is odd: state HIT for those with a direction, INVALID for the others, which
    are given one."""
    for m in range(BLOCK):
        n = start + min(m, count - 1)
        finite = abs(w[OX + m]) + abs(w[OY + m]) + abs(w[OZ + m]) < np.inf
        if finite and _unit(directions, n, w, m):
            state[m] = HIT
        else:
            state[m] = INVALID
            w[OX + m] = w[OY + m] = w[OZ + m] = w[DX + m] = w[DY + m] = 0.0
            w[DZ + m] = -1.0


@njit(cache=True, error_model="numpy", _nrt=False)
def _reflect(w):
    """r = d − 2(d·n)n."""
    for m in range(BLOCK):
        twice = 2.0 * (w[DX + m] * w[NX + m] + w[DY + m] * w[NY + m] + w[DZ + m] * w[NZ + m])
        w[RX + m] = w[DX + m] - twice * w[NX + m]
        w[RY + m] = w[DY + m] - twice * w[NY + m]
        w[RZ + m] = w[DZ + m] - twice * w[NZ + m]


@njit(cache=True, error_model="numpy", _nrt=False)
def _store_all(w, start, status, points, normals, reflected, distances):
    """A block of which every ray hits."""
    k, n = _at(3 * start), _at(start)
    for m in range(BLOCK):
        points[k + 3 * m], points[k + 3 * m + 1], points[k + 3 * m + 2] = w[X + m], w[Y + m], w[Z + m]
    for m in range(BLOCK):
        normals[k + 3 * m], normals[k + 3 * m + 1], normals[k + 3 * m + 2] = w[NX + m], w[NY + m], w[NZ + m]
    for m in range(BLOCK):
        reflected[k + 3 * m], reflected[k + 3 * m + 1], reflected[k + 3 * m + 2] = w[RX + m], w[RY + m], w[RZ + m]
    for m in range(BLOCK):
        distances[n + m] = w[T + m]
        status[n + m] = HIT


@njit(cache=True, error_model="numpy", _nrt=False)
def _store(w, state, start, count, status, points, normals, reflected, distances):
    """A block ray by ray: NaN in every result of a ray that does not hit, but the distance of one from behind."""
    for m in range(count):
        n = start + m
        status[n] = state[m]
        if state[m] == HIT:
            points[3 * n], points[3 * n + 1], points[3 * n + 2] = w[X + m], w[Y + m], w[Z + m]
            normals[3 * n], normals[3 * n + 1], normals[3 * n + 2] = w[NX + m], w[NY + m], w[NZ + m]
            reflected[3 * n], reflected[3 * n + 1], reflected[3 * n + 2] = w[RX + m], w[RY + m], w[RZ + m]
            distances[n] = w[T + m]
        else:
            for c in range(3 * n, 3 * n + 3):
                points[c] = normals[c] = reflected[c] = np.nan
            distances[n] = w[T + m] if state[m] == BEHIND else np.nan


@njit(cache=True, nogil=True, error_model="numpy")
def unit_directions(rays, units, valid):
    """Rays (n, 3) of any length to unit length; those without a direction become (0, 0, 1) and not valid."""
    w = np.zeros(6 * BLOCK)
    for n in range(rays.shape[0]):
        valid[n] = _unit(rays[n], 0, w, 0)
        if valid[n]:
            units[n, 0], units[n, 1], units[n, 2] = w[DX], w[DY], w[DZ]
        else:
            units[n, 0], units[n, 1], units[n, 2] = 0.0, 0.0, 1.0


# --- height fields ----------------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy", fastmath={"contract"}, inline="always")
def _taylor(powers, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, x, y, q):
    """z, z_x, z_y, z_xx/2, z_xy, z_yy/2 at the place of the sheet nearest to (x, y), then that place: q (8,)."""
    x, y = _clamp(x, ends_x[0], ends_x[-2]), _clamp(y, ends_y[0], ends_y[-2])
    i, j = _span(x, ends_x, lookup_x), _span(y, ends_y, lookup_y)
    a, b = x - middle_x[i], y - middle_y[j]
    base = (i * (ends_y.size - 2) + j) * powers * powers
    z = z_a = z_b = z_aa = z_ab = z_bb = 0.0
    for r in range(powers):
        row, slope, bend = flat[base + r * powers], 0.0, 0.0
        for c in range(1, powers):
            bend = bend * b + slope
            slope = slope * b + row
            row = row * b + flat[base + r * powers + c]
        z_aa = z_aa * a + z_a
        z_a = z_a * a + z
        z = z * a + row
        z_ab = z_ab * a + z_b
        z_b = z_b * a + slope
        z_bb = z_bb * a + bend
    q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7] = z, z_a, z_b, z_aa, z_ab, z_bb, x, y


@njit(cache=True, nogil=True, error_model="numpy")
def height_field_tensors(powers, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, points, normals, tensors):
    """The derivative N of the unit normal along a sheet z(x, y), at points (n, 3) with normals (n, 3) of either sense.

    N = −±Π·H·Π/w with w = √(1 + z_x² + z_y²), Π = 1 − nn and H the second derivatives, in x and y: tensors (n, 3, 3).
    """
    q, h, p = np.empty(8), np.zeros((3, 3)), np.empty((3, 3))
    for n in range(points.shape[0]):
        x, y = points[n, 0], points[n, 1]
        if not (np.isfinite(x) and np.isfinite(y)):
            tensors[n] = np.nan
            continue
        _taylor(powers, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, x, y, q)
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
                tensors[n, i, j] = value


@njit(cache=True, error_model="numpy", fastmath={"contract"}, inline="always")
def _horner(powers, flat, base, a, b):
    """A polynomial in a and b, whose coefficients begin at base, highest powers first, and its derivatives by a and by b."""
    value = along_a = along_b = 0.0
    for r in range(powers):
        row = flat[base + r * powers]
        slope = 0.0
        for c in range(1, powers):
            slope = slope * b + row
            row = row * b + flat[base + r * powers + c]
        along_a = along_a * a + value
        value = value * a + row
        along_b = along_b * a + slope
    return value, along_a, along_b


@njit(cache=True, error_model="numpy", fastmath={"contract"}, inline="always")
def _evaluate(powers, flat, base, centre_x, centre_y, x_min, x_max, y_min, y_max, w):
    """z, z_x, z_y of one cell's polynomial, whose coefficients begin at base, at (X, Y) into the rows Z, ZX, ZY."""
    base = _at(base)
    for m in range(BLOCK):
        x, y = _clamp(w[X + m], x_min, x_max), _clamp(w[Y + m], y_min, y_max)
        a, b = x - centre_x, y - centre_y
        z, z_a, z_b = _horner(powers, flat, base, a, b)
        w[Z + m] = z + z_a * (w[X + m] - x) + z_b * (w[Y + m] - y)
        w[ZX + m] = z_a
        w[ZY + m] = z_b


@njit(cache=True, error_model="numpy", fastmath={"contract"}, inline="always")
def _evaluate_apart(powers, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, w):
    """`_evaluate` for rays that each have a cell of their own."""
    for m in range(BLOCK):
        x, y = _clamp(w[X + m], ends_x[0], ends_x[-2]), _clamp(w[Y + m], ends_y[0], ends_y[-2])
        i, j = _span(x, ends_x, lookup_x), _span(y, ends_y, lookup_y)
        a, b = x - middle_x[i], y - middle_y[j]
        base = (i * (ends_y.size - 2) + j) * powers * powers
        z, z_a, z_b = _horner(powers, flat, base, a, b)
        w[Z + m] = z + z_a * (w[X + m] - x) + z_b * (w[Y + m] - y)
        w[ZX + m] = z_a
        w[ZY + m] = z_b


@njit(cache=True, error_model="numpy", fastmath={"contract"}, inline="always")
def _osculate(powers, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, w, q):
    """Move the paraboloid q to where the block's middle ray meets the sheet."""
    c = BLOCK // 2
    slope = w[DZ + c] - q[1] * w[DX + c] - q[2] * w[DY + c]
    t = (q[0] + q[1] * (w[OX + c] - q[6]) + q[2] * (w[OY + c] - q[7]) - w[OZ + c]) / slope
    a, b = w[OX + c] + t * w[DX + c] - q[6], w[OY + c] + t * w[DY + c] - q[7]
    z = q[0] + a * (q[1] + q[3] * a + q[4] * b) + b * (q[2] + q[5] * b)
    slope -= (2.0 * q[3] * a + q[4] * b) * w[DX + c] + (q[4] * a + 2.0 * q[5] * b) * w[DY + c]
    t -= (w[OZ + c] + t * w[DZ + c] - z) / slope
    _taylor(powers, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, w[OX + c] + t * w[DX + c],
            w[OY + c] + t * w[DY + c], q)


@njit(cache=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _from_paraboloid(w, q):
    """Take every ray to the paraboloid q: by its tangent plane, then twice with the same slope."""
    z0, zx, zy, zxx, zxy, zyy, x, y = q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7]
    for m in range(BLOCK):
        p, r, h = w[OX + m] - x, w[OY + m] - y, w[OZ + m] - z0
        dx, dy, dz = w[DX + m], w[DY + m], w[DZ + m]
        inverse = 1.0 / (dz - zx * dx - zy * dy)
        t = (zx * p + zy * r - h) * inverse
        for _ in range(2):
            a, b = p + t * dx, r + t * dy
            t = t - (h + t * dz - a * (zx + zxx * a + zxy * b) - b * (zy + zyy * b)) * inverse
        w[T + m] = t
        w[X + m], w[Y + m] = w[OX + m] + t * dx, w[OY + m] + t * dy


@njit(cache=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
def _from_above(top, w):
    """Take every ray to the plane above the sheet."""
    for m in range(BLOCK):
        t = (top - w[OZ + m]) / w[DZ + m]
        w[T + m] = t
        w[X + m], w[Y + m] = w[OX + m] + t * w[DX + m], w[OY + m] + t * w[DY + m]


def _height_field_kernel(powers):
    """The height-field kernels for `powers` = degree + 1 in both directions: the fast one and the safe one.

    With `powers` a constant the two Horner loops unroll, and what is left of the loop over a block is straight-line code
    that LLVM turns into vector instructions; with a variable it does not, and runs six times slower.
    """

    @njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
    def hits(w, q, state, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, top, steepest,
             first, edges, low, inverse_height, interior,
             origins, directions, status, points, normals, reflected, distances):
        n_rays = directions.size // 3
        last_x, last_y = ends_x.size - 3, ends_y.size - 3
        x_min, x_max, y_min, y_max = ends_x[0], ends_x[-2], ends_y[0], ends_y[-2]
        near_x, near_y = (x_max - x_min) / 32.0, (y_max - y_min) / 32.0
        warm = False
        cell = 0  # the last one that held a whole block, and its ends
        cell_left, cell_right, cell_bottom, cell_top = np.inf, -np.inf, np.inf, -np.inf
        for start in range(0, n_rays, BLOCK):
            count = min(BLOCK, n_rays - start)
            odd = _load(origins, directions, start, count, w)
            if odd > 0:
                fix_degenerate_rays(origins, directions, start, count, w, state)
            shallow = 0  # rays that do not come down steeply enough, or could meet the sheet twice
            for m in range(BLOCK):
                across = w[DX + m] * w[DX + m] + w[DY + m] * w[DY + m]
                shallow += 1 - int((w[DZ + m] <= -SHALLOWEST) & (w[DZ + m] * w[DZ + m] > steepest * across))
            if shallow > 0:
                for m in range(BLOCK):
                    if odd == 0:
                        state[m] = HIT
                    across = w[DX + m] * w[DX + m] + w[DY + m] * w[DY + m]
                    if not (w[DZ + m] <= -SHALLOWEST and w[DZ + m] * w[DZ + m] > steepest * across):
                        state[m] = LOST
                        w[DX + m] = w[DY + m] = 0.0
                        w[DZ + m] = -1.0
                odd += shallow
            # In a picture the block before is the best place to begin; else the plane above the sheet.
            for _ in range(2):
                if warm:
                    _osculate(powers, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, w, q)
                    _from_paraboloid(w, q)
                else:
                    _from_above(top, w)
                x_low, x_high, y_low, y_high = _box(w, X, Y)
                together = x_high - x_low < near_x and y_high - y_low < near_y
                if together == warm:
                    break
                if together:
                    _taylor(powers, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, w[X + BLOCK // 2],
                            w[Y + BLOCK // 2], q)
                    _osculate(powers, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, w, q)
                warm = together
            for m in range(BLOCK):
                limit = RESIDUAL * (abs(w[T + m]) + abs(w[OX + m]) + abs(w[OY + m]) + abs(w[OZ + m]))
                w[LIMIT + m] = limit * limit
                w[MISS + m] = np.inf
            for _ in range(MAX_STEPS):
                for m in range(BLOCK):
                    w[X + m], w[Y + m] = w[OX + m] + w[T + m] * w[DX + m], w[OY + m] + w[T + m] * w[DY + m]
                x_low, x_high, y_low, y_high = _box(w, X, Y)
                if x_low >= cell_left and x_high < cell_right and y_low >= cell_bottom and y_high < cell_top:
                    i_low = i_high = cell // (last_y + 1)
                    j_low = j_high = cell - i_low * (last_y + 1)
                    cells = 1
                else:
                    i_low = _span(_clamp(x_low, x_min, x_max), ends_x, lookup_x)
                    i_high = _span(_clamp(x_high, x_min, x_max), ends_x, lookup_x)
                    j_low = _span(_clamp(y_low, y_min, y_max), ends_y, lookup_y)
                    j_high = _span(_clamp(y_high, y_min, y_max), ends_y, lookup_y)
                    cells = (i_high - i_low + 1) * (j_high - j_low + 1)
                    if cells == 1:
                        cell = i_low * (last_y + 1) + j_low
                        cell_left = ends_x[i_low] if i_low > 0 else -np.inf
                        cell_right = ends_x[i_low + 1] if i_low < last_x else np.inf
                        cell_bottom = ends_y[j_low] if j_low > 0 else -np.inf
                        cell_top = ends_y[j_low + 1] if j_low < last_y else np.inf
                if cells > MAX_CELLS:
                    _evaluate_apart(powers, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, w)
                else:
                    for i in range(i_low, i_high + 1):
                        for j in range(j_low, j_high + 1):
                            base = (i * (last_y + 1) + j) * powers * powers
                            _evaluate(powers, flat, base, middle_x[i], middle_y[j], x_min, x_max, y_min, y_max, w)
                            if cells > 1:  # each ray keeps the last cell that starts before it
                                from_x = ends_x[i] if i > i_low else -np.inf
                                from_y = ends_y[j] if j > j_low else -np.inf
                                for m in range(BLOCK):
                                    mine = (w[X + m] >= from_x) & (w[Y + m] >= from_y)
                                    w[V0 + m] = w[Z + m] if mine else w[V0 + m]
                                    w[V1 + m] = w[ZX + m] if mine else w[V1 + m]
                                    w[V2 + m] = w[ZY + m] if mine else w[V2 + m]
                    if cells > 1:
                        for m in range(BLOCK):
                            w[Z + m], w[ZX + m], w[ZY + m] = w[V0 + m], w[V1 + m], w[V2 + m]
                moving = 0
                for m in range(BLOCK):
                    above = w[OZ + m] + w[T + m] * w[DZ + m] - w[Z + m]
                    w[T + m] -= above / (w[DZ + m] - w[ZX + m] * w[DX + m] - w[ZY + m] * w[DY + m])
                    # Squares: of the height, of the limit, and of the height over the distance from the tangent plane.
                    miss = above * above
                    limit = w[LIMIT + m] * (1.0 + w[ZX + m] * w[ZX + m] + w[ZY + m] * w[ZY + m])
                    # Not "larger than": a NaN moves on, too.
                    moving += 1 - int((miss <= limit) | ((miss <= ACCEPTED * ACCEPTED * limit) & (miss >= 0.25 * w[MISS + m])))
                    w[MISS + m] = miss
                if moving == 0:
                    break
            good = 0
            for m in range(BLOCK):
                w[X + m], w[Y + m] = w[OX + m] + w[T + m] * w[DX + m], w[OY + m] + w[T + m] * w[DY + m]
                w[Z + m] = w[OZ + m] + w[T + m] * w[DZ + m]
                steep = 1.0 + w[ZX + m] * w[ZX + m] + w[ZY + m] * w[ZY + m]
                upright = 1.0 / np.sqrt(steep)
                w[NX + m], w[NY + m], w[NZ + m] = -w[ZX + m] * upright, -w[ZY + m] * upright, upright
                facing = w[DX + m] * w[NX + m] + w[DY + m] * w[NY + m] + w[DZ + m] * w[NZ + m]
                met = (w[MISS + m] <= ACCEPTED * ACCEPTED * w[LIMIT + m] * steep) & (w[T + m] > NEAREST_MM) & (facing < 0.0)
                w[MISS + m] = 0.0 if met else 1.0
                good += int(met)
            x_low, x_high, y_low, y_high = _box(w, X, Y)
            _reflect(w)
            if good == BLOCK and odd == 0 and count == BLOCK \
                    and _in_interior(interior, low, inverse_height, x_low, x_high, y_low, y_high):
                _store_all(w, start, status, points, normals, reflected, distances)
                continue
            for m in range(BLOCK):
                if odd > 0 and state[m] != HIT:
                    continue
                # Beyond its rectangle the sheet's continuation is not the sheet: what is met there says nothing of before.
                if w[MISS + m] != 0.0 or not (x_min <= w[X + m] <= x_max and y_min <= w[Y + m] <= y_max):
                    state[m] = LOST
                elif _inside(first, edges, low, inverse_height, w[X + m], w[Y + m]):
                    state[m] = HIT
                else:
                    state[m] = OUTSIDE
            _store(w, state, start, count, status, points, normals, reflected, distances)

    @njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
    def first_hits(w, q, state, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, bottom, top, bend,
                   one_sided, first, edges,
                   low, inverse_height,
                   origins, directions, status, points, normals, reflected, distances):
        for n in range(directions.size // 3):
            k = 0 if origins.size == 3 else 3 * n
            ox, oy, oz = origins[k], origins[k + 1], origins[k + 2]
            state[0] = INVALID
            if abs(ox) + abs(oy) + abs(oz) < np.inf and _unit(directions, n, w, 0):
                dx, dy, dz = w[DX], w[DY], w[DZ]
                state[0] = OUTSIDE
                # The part of the ray within the sheet's box.
                near, far = NEAREST_MM, np.inf
                for o, d, from_, to in ((ox, dx, ends_x[0], ends_x[-2]), (oy, dy, ends_y[0], ends_y[-2]),
                                        (oz, dz, bottom, top)):
                    if d == 0.0:
                        if not from_ <= o <= to:
                            far = -np.inf
                    else:
                        a, b = (from_ - o) / d, (to - o) / d
                        near, far = max(near, min(a, b)), min(far, max(a, b))
                most = bend * (dx * dx + dy * dy) + 1e-300
                t = near
                limit = RESIDUAL * (abs(ox) + abs(oy) + abs(oz) + abs(far) + abs(top) + abs(bottom))
                for _ in range(MAX_SAFE_STEPS):
                    if not t <= far:
                        break
                    x, y = ox + t * dx, oy + t * dy
                    _taylor(powers, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, x, y, q)
                    above = oz + t * dz - q[0]
                    rise = dz - q[1] * dx - q[2] * dy
                    steep = np.sqrt(1.0 + q[1] * q[1] + q[2] * q[2])
                    if abs(above) <= ACCEPTED * limit * steep:
                        if rise != 0.0:  # the last step is Newton's
                            t -= above / rise
                            x, y = ox + t * dx, oy + t * dy
                            _taylor(powers, flat, ends_x, ends_y, middle_x, middle_y, lookup_x, lookup_y, x, y, q)
                            steep = np.sqrt(1.0 + q[1] * q[1] + q[2] * q[2])
                        if _inside(first, edges, low, inverse_height, x, y):
                            state[0] = BEHIND if one_sided and rise >= 0.0 else HIT
                            w[X], w[Y], w[Z], w[T] = x, y, oz + t * dz, t
                            turn = -1.0 if rise >= 0.0 else 1.0
                            w[NX], w[NY], w[NZ] = -turn * q[1] / steep, -turn * q[2] / steep, turn / steep
                            break
                        # Trimmed away: on behind it, where the distance is no rounding any more.
                        t += max(1e3 * ACCEPTED * limit * steep / max(abs(rise), 1e-6), NEAREST_MM)
                        continue
                    # As far as the bound on f'' leaves f without a root: nearly a step of Newton's, and never past the root.
                    side = 1.0 if above > 0.0 else -1.0
                    slope = side * rise
                    root = np.sqrt(slope * slope + 2.0 * most * abs(above))
                    t += 2.0 * abs(above) / (root - slope) if slope < 0.0 else (slope + root) / most
                else:
                    state[0] = LOST
            twice = 2.0 * (w[DX] * w[NX] + w[DY] * w[NY] + w[DZ] * w[NZ])
            w[RX], w[RY], w[RZ] = w[DX] - twice * w[NX], w[DY] - twice * w[NY], w[DZ] - twice * w[NZ]
            _store(w, state, n, 1, status, points, normals, reflected, distances)

    return hits, first_hits


# One kernel for each number of powers that sheets are padded to with zeros: degrees to 3, 5, 7, 9, 13 and
# 25, the CAD kernel's highest; those beyond 9 are loops again.
PADDED_POWERS = (4, 6, 8, 10, 14, 26)
_HEIGHT_FIELD = {powers: _height_field_kernel(powers) for powers in PADDED_POWERS}


def _working_arrays():
    return np.zeros(HEIGHT_FIELD_ROWS * BLOCK), np.zeros(8), np.zeros(BLOCK, dtype=np.int8)


def height_field_hits(powers, *arguments):
    """Newton on f(t) = o_z + t·d_z − z(o_x + t·d_x, o_y + t·d_y), BLOCK rays at once.

    It starts from the plane above the sheet or, for rays that lie together, from the paraboloid that osculates the sheet
    between them. A step is the last where |f|·n_z, the distance from the tangent plane, is rounding. Beyond its rectangle
    the sheet goes on as the tangent plane at the nearest edge.

    Rays that do not come down steeply enough to meet the sheet only once (d_z² > steepest·(d_x² + d_y²)), do not
    converge, arrive from below or start beneath it are LOST: the general search takes them.
    """
    _HEIGHT_FIELD[powers][0](*_working_arrays(), *arguments)


def height_field_first_hits(powers, *arguments):
    """The first place where a ray meets a height field, from above or below and however grazing.

    With |f''| ≤ bend·(d_x² + d_y²) there is no root of f before t + s, where |f| + f'·s − bend·(d_x² + d_y²)·s²/2 = 0: steps
    of that length run to the first root and cannot pass it, one ray at a time.
    """
    _HEIGHT_FIELD[powers][1](*_working_arrays(), *arguments)


# --- parametric surfaces ----------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy", fastmath={"contract"}, inline="always")
def _evaluate_parts(powers, parts, flat, base, centre_u, centre_v, w):
    """One cell's polynomials, whose coefficients begin at base, and their derivatives by u and v at (U, V) into the rows
    P."""
    base = _at(base)
    for part in range(parts):
        for m in range(BLOCK):
            a, b = w[U + m] - centre_u, w[V + m] - centre_v
            value, along_u, along_v = _horner(powers, flat, base + part * powers * powers, a, b)
            w[P + 3 * part * BLOCK + m] = value
            w[P + (3 * part + 1) * BLOCK + m] = along_u
            w[P + (3 * part + 2) * BLOCK + m] = along_v


@njit(cache=True, error_model="numpy", fastmath={"contract"}, inline="always")
def _evaluate_parts_apart(powers, parts, flat, ends_u, ends_v, middle_u, middle_v, lookup_u, lookup_v, w):
    """`_evaluate_parts` for rays that each have a cell of their own."""
    for m in range(BLOCK):
        u, v = _clamp(w[U + m], ends_u[0], ends_u[-2]), _clamp(w[V + m], ends_v[0], ends_v[-2])
        i, j = _span(u, ends_u, lookup_u), _span(v, ends_v, lookup_v)
        a, b = w[U + m] - middle_u[i], w[V + m] - middle_v[j]
        base = (i * (ends_v.size - 2) + j) * parts * powers * powers
        for part in range(parts):
            value, along_u, along_v = _horner(powers, flat, base + part * powers * powers, a, b)
            w[P + 3 * part * BLOCK + m] = value
            w[P + (3 * part + 1) * BLOCK + m] = along_u
            w[P + (3 * part + 2) * BLOCK + m] = along_v


@njit(cache=True, error_model="numpy", fastmath={"contract"}, inline="always")
def _surface(powers, parts, flat, ends_u, ends_v, middle_u, middle_v, lookup_u, lookup_v, w):
    """S, S_u, S_v at (U, V) into the first nine rows P."""
    u_low, u_high, v_low, v_high = _box(w, U, V)
    i_low = _span(_clamp(u_low, ends_u[0], ends_u[-2]), ends_u, lookup_u)
    i_high = _span(_clamp(u_high, ends_u[0], ends_u[-2]), ends_u, lookup_u)
    j_low = _span(_clamp(v_low, ends_v[0], ends_v[-2]), ends_v, lookup_v)
    j_high = _span(_clamp(v_high, ends_v[0], ends_v[-2]), ends_v, lookup_v)
    cells = (i_high - i_low + 1) * (j_high - j_low + 1)
    if cells > MAX_CELLS:
        _evaluate_parts_apart(powers, parts, flat, ends_u, ends_v, middle_u, middle_v, lookup_u, lookup_v, w)
    else:
        for i in range(i_low, i_high + 1):
            for j in range(j_low, j_high + 1):
                base = (i * (ends_v.size - 2) + j) * parts * powers * powers
                _evaluate_parts(powers, parts, flat, base, middle_u[i], middle_v[j], w)
                if cells > 1:  # each ray keeps the last cell that starts before it
                    from_u = ends_u[i] if i > i_low else -np.inf
                    from_v = ends_v[j] if j > j_low else -np.inf
                    for m in range(BLOCK):
                        if w[U + m] >= from_u and w[V + m] >= from_v:
                            for row in range(3 * parts):
                                w[K + row * BLOCK + m] = w[P + row * BLOCK + m]
        if cells > 1:
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


def _parametric_kernel(powers, parts):
    """The kernel for surfaces in `parts` coordinates (3, or 4 homogeneous ones) with `powers` = degree + 1 both ways."""
    @njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, _nrt=False)
    def hits(w, state, flat, ends_u, ends_v, middle_u, middle_v, lookup_u, lookup_v, centre, extent, first, edges, low,
             inverse_height, interior,
             sign, one_sided, closed, sheet, starts, origins, directions, status, points, normals, reflected, distances):
        n_rays = directions.size // 3
        u_min, u_max, v_min, v_max = ends_u[0], ends_u[-2], ends_v[0], ends_v[-2]
        # A step may leave the surface by a little, where the end polynomials go on; not by more.
        beyond_u, beyond_v = 0.05 * (u_max - u_min), 0.05 * (v_max - v_min)
        # On a closed surface it goes on at the other side of the seam.
        turn_u, turn_v = closed[0] * (u_max - u_min), closed[1] * (v_max - v_min)
        sx, sy, sz = P, P + 3 * BLOCK, P + 6 * BLOCK
        for start in range(0, n_rays, BLOCK):
            count = min(BLOCK, n_rays - start)
            odd = _load(origins, directions, start, count, w)
            if odd > 0:
                fix_degenerate_rays(origins, directions, start, count, w, state)
            for m in range(BLOCK):
                w[OX + m] -= centre[0]
                w[OY + m] -= centre[1]
                w[OZ + m] -= centre[2]
                w[LIMIT_P + m] = RESIDUAL * (extent + abs(w[OX + m]) + abs(w[OY + m]) + abs(w[OZ + m]))
            if starts.size > 0:
                for m in range(BLOCK):
                    n = start + min(m, count - 1)
                    w[U + m], w[V + m] = starts[2 * n], starts[2 * n + 1]
            else:
                # From the plane through the sheet, by the affine map that is nearest to its parameters.
                shallow = 0
                for m in range(BLOCK):
                    down = sheet[0] * w[DX + m] + sheet[1] * w[DY + m] + sheet[2] * w[DZ + m]
                    t = -(sheet[0] * w[OX + m] + sheet[1] * w[OY + m] + sheet[2] * w[OZ + m]) / down
                    x, y, z = w[OX + m] + t * w[DX + m], w[OY + m] + t * w[DY + m], w[OZ + m] + t * w[DZ + m]
                    w[U + m] = sheet[4] + sheet[5] * x + sheet[6] * y + sheet[7] * z
                    w[V + m] = sheet[8] + sheet[9] * x + sheet[10] * y + sheet[11] * z
                    shallow += 1 - int(abs(down) > sheet[3])
                if shallow > 0:
                    for m in range(BLOCK):
                        if odd == 0:
                            state[m] = HIT
                        down = sheet[0] * w[DX + m] + sheet[1] * w[DY + m] + sheet[2] * w[DZ + m]
                        if not abs(down) > sheet[3]:
                            state[m] = LOST
                            w[DX + m], w[DY + m], w[DZ + m] = -sheet[0], -sheet[1], -sheet[2]
                    odd += shallow
            # Two directions across the ray: of the axes that are not nearest to it, and of the cross product with that.
            for m in range(BLOCK):
                dx, dy, dz = w[DX + m], w[DY + m], w[DZ + m]
                to_z = abs(dz) < 0.9
                ax, ay, az = (dy, -dx, 0.0) if to_z else (0.0, dz, -dy)
                length = np.sqrt(ax * ax + ay * ay + az * az)
                ax, ay, az = ax / length, ay / length, az / length
                w[AX + m], w[AY + m], w[AZ + m] = ax, ay, az
                w[BX + m], w[BY + m], w[BZ + m] = dy * az - dz * ay, dz * ax - dx * az, dx * ay - dy * ax
                w[LAST + m] = np.inf
                w[U + m] = _clamp(w[U + m], u_min - beyond_u, u_max + beyond_u)
                w[V + m] = _clamp(w[V + m], v_min - beyond_v, v_max + beyond_v)
            for step in range(MAX_STEPS):
                _surface(powers, parts, flat, ends_u, ends_v, middle_u, middle_v, lookup_u, lookup_v, w)
                moving = 0
                for m in range(BLOCK):
                    x, y, z = w[sx + m] - w[OX + m], w[sy + m] - w[OY + m], w[sz + m] - w[OZ + m]
                    f = w[AX + m] * x + w[AY + m] * y + w[AZ + m] * z
                    g = w[BX + m] * x + w[BY + m] * y + w[BZ + m] * z
                    miss = np.sqrt(f * f + g * g)
                    settled = (miss <= w[LIMIT_P + m]) \
                        | ((miss <= ACCEPTED * w[LIMIT_P + m]) & (miss >= 0.5 * w[LAST + m]))
                    w[LAST + m] = miss
                    w[NX + m], w[NY + m] = f, g
                    moving += 1 - int(settled)
                if moving == 0 or step == MAX_STEPS - 1:
                    break
                for m in range(BLOCK):
                    ux, uy, uz = w[sx + BLOCK + m], w[sy + BLOCK + m], w[sz + BLOCK + m]
                    vx, vy, vz = w[sx + 2 * BLOCK + m], w[sy + 2 * BLOCK + m], w[sz + 2 * BLOCK + m]
                    fu = w[AX + m] * ux + w[AY + m] * uy + w[AZ + m] * uz
                    fv = w[AX + m] * vx + w[AY + m] * vy + w[AZ + m] * vz
                    gu = w[BX + m] * ux + w[BY + m] * uy + w[BZ + m] * uz
                    gv = w[BX + m] * vx + w[BY + m] * vy + w[BZ + m] * vz
                    inverse = 1.0 / (fu * gv - fv * gu)
                    u = w[U + m] - (w[NX + m] * gv - w[NY + m] * fv) * inverse
                    v = w[V + m] - (w[NY + m] * fu - w[NX + m] * gu) * inverse
                    u += turn_u * (1.0 if u < u_min else 0.0) - turn_u * (1.0 if u > u_max else 0.0)
                    v += turn_v * (1.0 if v < v_min else 0.0) - turn_v * (1.0 if v > v_max else 0.0)
                    w[U + m] = _clamp(u, u_min - beyond_u, u_max + beyond_u)
                    w[V + m] = _clamp(v, v_min - beyond_v, v_max + beyond_v)
            good = 0
            for m in range(BLOCK):
                x, y, z = w[sx + m], w[sy + m], w[sz + m]
                ux, uy, uz = w[sx + BLOCK + m], w[sy + BLOCK + m], w[sz + BLOCK + m]
                vx, vy, vz = w[sx + 2 * BLOCK + m], w[sy + 2 * BLOCK + m], w[sz + 2 * BLOCK + m]
                nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
                length = np.sqrt(nx * nx + ny * ny + nz * nz)
                facing = sign * (nx * w[DX + m] + ny * w[DY + m] + nz * w[DZ + m])
                turn = sign / length if facing <= 0.0 else -sign / length
                w[NX + m], w[NY + m], w[NZ + m] = nx * turn, ny * turn, nz * turn
                w[T + m] = (x - w[OX + m]) * w[DX + m] + (y - w[OY + m]) * w[DY + m] + (z - w[OZ + m]) * w[DZ + m]
                w[X + m], w[Y + m], w[Z + m] = x + centre[0], y + centre[1], z + centre[2]
                w[MISS + m] = facing
                good += int((w[LAST + m] <= ACCEPTED * w[LIMIT_P + m]) & (length > 0.0) & (w[T + m] > NEAREST_MM)
                            & ((facing < 0.0) | (not one_sided)))
            u_low, u_high, v_low, v_high = _box(w, U, V)
            _reflect(w)
            if good == BLOCK and odd == 0 and count == BLOCK \
                    and _in_interior(interior, low, inverse_height, u_low, u_high, v_low, v_high):
                _store_all(w, start, status, points, normals, reflected, distances)
                continue
            for m in range(BLOCK):
                if odd > 0 and state[m] != HIT:
                    continue
                u, v = w[U + m], w[V + m]
                if not (w[LAST + m] <= ACCEPTED * w[LIMIT_P + m] and abs(w[NX + m]) <= 1.0):
                    state[m] = LOST
                elif w[T + m] > NEAREST_MM and _inside(first, edges, low, inverse_height, u, v):
                    state[m] = BEHIND if one_sided and w[MISS + m] >= 0.0 else HIT
                elif starts.size == 0 and (not u_min <= u <= u_max or not v_min <= v <= v_max):
                    state[m] = LOST  # only within its domain is the sheet known to be met once
                else:
                    state[m] = OUTSIDE
            _store(w, state, start, count, status, points, normals, reflected, distances)

    return hits


_PARAMETRIC = {(powers, parts): _parametric_kernel(powers, parts) for powers in PADDED_POWERS for parts in (3, 4)}


def parametric_hits(powers, parts, *arguments):
    """Newton for S(u, v) on the line o + t·d, as two plane equations a·(S − o) = b·(S − o) = 0 with a, b ⟂ d.

    starts : flat (u, v) for each ray, from a hit on a coarse mesh; or empty, for a sheet of which rays within its cone
    (|d·n| > sheet[3]) meet one place only: then the start is sheet's affine map of where the ray meets the
    plane n·x = 0. Converged means that S is off the ray by rounding only; a ray that is not is LOST. Normals look back
    along the ray; on a one-sided surface a ray from behind, against sign·(S_u × S_v), is BEHIND.
    """
    _PARAMETRIC[powers, parts](np.zeros(PARAMETRIC_ROWS * BLOCK), np.zeros(BLOCK, dtype=np.int8), *arguments)
