"""The compiled kernels: rays in, points and normals on B-splines out, in float64.

They stand in one file because numba's cache does not notice a change in a compiled function of another module.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

# What the kernels report of a ray; the meaning for users is in `raytrace.Status`.
HIT, OUTSIDE, LOST = 0, 1, 2

BLOCK = 16  # rays that a kernel takes at once: two or four vector registers of each quantity
MOST_STEPS = 14
TASK = 4096  # rays that a thread takes at once: its working arrays are made once for them
SHALLOWEST = 0.05  # −d_z below which the plane above the sheet is no good place to start from
# A step this small against the ray's length is rounding: the next one could not improve the point.
STEP_TOLERANCE = 4e-15


@njit(cache=True, error_model="numpy")
def _inside(strips, first, edges, low, inverse_height, u, v):
    """Even-odd rule on the trimming polygon; its edges are sorted into strips of v."""
    strip = int((v - low) * inverse_height)
    if strip < 0 or strip >= strips or v < low:
        return False
    inside = False
    for k in range(first[strip], first[strip + 1]):
        u0, v0, u1, v1 = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        if (v0 <= v) != (v1 <= v) and u < u0 + (v - v0) * (u1 - u0) / (v1 - v0):
            inside = not inside
    return inside


def _height_field_kernel(powers):
    """The height-field kernel for `powers` = degree + 1 in both directions.

    With `powers` a constant the two Horner loops unroll, and what is left of the loop over a block is straight-line code
    that LLVM turns into vector instructions; with a variable it does not, and runs six times slower.
    """
    size = powers * powers

    @njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
    def hits(flat, ends_x, ends_y, lookup_x, lookup_y, top, strips, first, edges, low, inverse_height,
             origins, directions, state, points, normals, distances):
        n_rays = directions.shape[0]
        stride = 0 if origins.shape[0] == 1 else 1
        cells_y = ends_y.size - 2
        x_min, x_max, y_min, y_max = ends_x[0], ends_x[-2], ends_y[0], ends_y[-2]
        last_x, last_y = lookup_x.size - 1, lookup_y.size - 1
        bins_x, bins_y = lookup_x.size / (x_max - x_min), lookup_y.size / (y_max - y_min)
        for task in prange((n_rays + TASK - 1) // TASK):
            ox, oy, oz = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
            dx, dy, dz, t = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
            a, b, out_x, out_y = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
            z, z_a, z_b = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
            step, allowed = np.empty(BLOCK), np.empty(BLOCK)
            base = np.empty(BLOCK, dtype=np.int32)
            for start in range(np.int64(task) * TASK, min((np.int64(task) + 1) * TASK, n_rays), BLOCK):
                for m in range(BLOCK):
                    n = min(start + m, n_rays - 1)  # the last block repeats its last ray
                    k = n * stride
                    ox[m], oy[m], oz[m] = origins[k, 0], origins[k, 1], origins[k, 2]
                    dx[m], dy[m], dz[m] = directions[n, 0], directions[n, 1], min(directions[n, 2], -SHALLOWEST)
                    t[m] = (top - oz[m]) / dz[m]
                    allowed[m] = STEP_TOLERANCE * (abs(t[m]) + abs(ox[m]) + abs(oy[m]) + abs(oz[m]))
                for _ in range(MOST_STEPS):
                    for m in range(BLOCK):
                        x = ox[m] + t[m] * dx[m]
                        y = oy[m] + t[m] * dy[m]
                        inside_x = min(max(x, x_min), x_max)
                        inside_y = min(max(y, y_min), y_max)
                        out_x[m] = x - inside_x
                        out_y[m] = y - inside_y
                        # Clamped from below too: a ray that diverges to NaN becomes the most negative integer.
                        i = lookup_x[max(min(np.int32((inside_x - x_min) * bins_x), last_x), 0)]
                        j = lookup_y[max(min(np.int32((inside_y - y_min) * bins_y), last_y), 0)]
                        # At the very end of the sheet the last cell goes on: there is none after it.
                        i = min(i + np.int32(inside_x >= ends_x[i + 1]), ends_x.size - 3)
                        j = min(j + np.int32(inside_y >= ends_y[j + 1]), ends_y.size - 3)
                        a[m] = inside_x - ends_x[i]
                        b[m] = inside_y - ends_y[j]
                        base[m] = (i * cells_y + j) * size
                    one_cell = True
                    for m in range(1, BLOCK):
                        one_cell = one_cell and base[m] == base[0]
                    if one_cell:
                        cell = flat[base[0]:base[0] + size]
                        for m in range(BLOCK):
                            height = along_a = along_b = 0.0
                            for r in range(powers):
                                row = cell[r * powers]
                                slope = 0.0
                                for c in range(1, powers):
                                    slope = slope * b[m] + row
                                    row = row * b[m] + cell[r * powers + c]
                                along_a = along_a * a[m] + height
                                height = height * a[m] + row
                                along_b = along_b * a[m] + slope
                            z[m], z_a[m], z_b[m] = height, along_a, along_b
                    else:
                        for m in range(BLOCK):
                            height = along_a = along_b = 0.0
                            for r in range(powers):
                                row = flat[base[m] + r * powers]
                                slope = 0.0
                                for c in range(1, powers):
                                    slope = slope * b[m] + row
                                    row = row * b[m] + flat[base[m] + r * powers + c]
                                along_a = along_a * a[m] + height
                                height = height * a[m] + row
                                along_b = along_b * a[m] + slope
                            z[m], z_a[m], z_b[m] = height, along_a, along_b
                    for m in range(BLOCK):
                        height = z[m] + z_a[m] * out_x[m] + z_b[m] * out_y[m]
                        step[m] = (oz[m] + t[m] * dz[m] - height) / (dz[m] - z_a[m] * dx[m] - z_b[m] * dy[m])
                        t[m] -= step[m]
                    moving = False
                    for m in range(BLOCK):
                        moving = moving or not abs(step[m]) <= allowed[m]
                    if not moving:
                        break
                for m in range(min(BLOCK, n_rays - start)):
                    n = start + m
                    state[n] = LOST
                    coming = dz[m] - z_a[m] * dx[m] - z_b[m] * dy[m] < 0.0 and directions[n, 2] <= -SHALLOWEST
                    if not (coming and abs(step[m]) <= allowed[m] and t[m] > 0.0):
                        continue
                    distances[n] = t[m]
                    x = ox[m] + t[m] * dx[m]
                    y = oy[m] + t[m] * dy[m]
                    if not _inside(strips, first, edges, low, inverse_height, x, y):
                        state[n] = OUTSIDE
                        continue
                    scale = 1.0 / np.sqrt(1.0 + z_a[m] * z_a[m] + z_b[m] * z_b[m])
                    points[n, 0], points[n, 1], points[n, 2] = x, y, oz[m] + t[m] * dz[m]
                    normals[n, 0], normals[n, 1], normals[n, 2] = -z_a[m] * scale, -z_b[m] * scale, scale
                    state[n] = HIT

    return hits


# One kernel for each number of powers that sheets are padded to with zeros: degrees to 5, to 7 and to 9.
_KERNELS = {powers: _height_field_kernel(powers) for powers in (6, 8, 10)}
PADDED_POWERS = tuple(_KERNELS)


def height_field_hits(powers, *arguments):
    """Newton on f(t) = o_z + t·d_z − z(o_x + t·d_x, o_y + t·d_y) from the plane above the sheet, BLOCK rays at once.

    For a convex sheet f is convex along the ray, so the steps from above run down to the first hit and cannot pass it.
    Beyond its rectangle the sheet goes on as the tangent plane at the nearest edge. Rays that do not come down steeply
    enough, do not converge, or arrive from below are LOST: the general kernel takes them.
    """
    _KERNELS[powers](*arguments)


@njit(cache=True, error_model="numpy")
def _basis(knots, degree, u, values, slopes):
    """The degree + 1 B-splines at u and their first derivatives; returns the index of the first.

    Source: The NURBS Book, algorithm A2.2 and eq. 2.7.
    """
    low, high = degree, knots.size - degree - 1
    while high - low > 1:
        middle = (low + high) // 2
        if u < knots[middle]:
            high = middle
        else:
            low = middle
    while low > degree and knots[low] == knots[low + 1]:
        low -= 1
    values[0] = 1.0
    for p in range(1, degree + 1):
        if p == degree:
            for j in range(degree + 1):
                slopes[j] = 0.0
            for j in range(degree):
                share = degree * values[j] / (knots[low + j + 1] - knots[low + j + 1 - degree])
                slopes[j] -= share
                slopes[j + 1] += share
        saved = 0.0
        for j in range(p):
            right = knots[low + j + 1]
            left = knots[low + j + 1 - p]
            share = values[j] / (right - left)
            values[j] = saved + (right - u) * share
            saved = (u - left) * share
        values[p] = saved
    return low - degree


@njit(cache=True, error_model="numpy")
def _point(knots_u, knots_v, degree_u, degree_v, homogeneous, u, v, nu, du, nv, dv, out):
    """S, S_u, S_v of a rational B-spline into out (3, 3)."""
    iu = _basis(knots_u, degree_u, u, nu, du)
    iv = _basis(knots_v, degree_v, v, nv, dv)
    sums = np.zeros((3, 4))
    for i in range(degree_u + 1):
        for c in range(4):
            along = 0.0
            along_v = 0.0
            for j in range(degree_v + 1):
                along += nv[j] * homogeneous[iu + i, iv + j, c]
                along_v += dv[j] * homogeneous[iu + i, iv + j, c]
            sums[0, c] += nu[i] * along
            sums[1, c] += du[i] * along
            sums[2, c] += nu[i] * along_v
    w = sums[0, 3]
    for c in range(3):
        out[0, c] = sums[0, c] / w
        out[1, c] = (sums[1, c] - sums[1, 3] * out[0, c]) / w
        out[2, c] = (sums[2, c] - sums[2, 3] * out[0, c]) / w


@njit(cache=True, parallel=True, error_model="numpy")
def parametric_hits(knots_u, knots_v, degree_u, degree_v, homogeneous, size,
                    strips, first, edges, low, inverse_height,
                    origins, directions, start_uv, state, points, normals, distances):
    """Newton for S(u, v) on the line o + t·d, as two plane equations a·(S − o) = b·(S − o) = 0 with a, b ⟂ d.

    start_uv (n, 2): from a hit on a coarse mesh. Converged means |S − (o + t·d)| below 1e-13 of the surface's size and
    the eye's distance; a ray that is not is LOST. Normals are S_u × S_v, not turned.
    """
    u_min, u_max = knots_u[degree_u], knots_u[-degree_u - 1]
    v_min, v_max = knots_v[degree_v], knots_v[-degree_v - 1]
    stride = 0 if origins.shape[0] == 1 else 1
    for n in prange(directions.shape[0]):
        k = np.int64(n) * stride
        nu, du = np.empty(degree_u + 1), np.empty(degree_u + 1)
        nv, dv = np.empty(degree_v + 1), np.empty(degree_v + 1)
        s = np.empty((3, 3))
        d = directions[n]
        o = origins[k]
        # Two directions across the ray, the first against its smallest component.
        a = np.zeros(3)
        axis = 0
        if abs(d[1]) < abs(d[axis]):
            axis = 1
        if abs(d[2]) < abs(d[axis]):
            axis = 2
        a[axis] = 1.0
        along = a[0] * d[0] + a[1] * d[1] + a[2] * d[2]
        a -= along * d
        a /= np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
        b = np.array([d[1] * a[2] - d[2] * a[1], d[2] * a[0] - d[0] * a[2], d[0] * a[1] - d[1] * a[0]])
        u, v = start_uv[n, 0], start_uv[n, 1]
        state[n] = LOST
        reach = 0.0
        for c in range(3):
            reach = max(reach, abs(o[c]))
        allowed = 1e-13 * (size + reach)
        best = np.inf
        for step in range(MOST_STEPS):
            _point(knots_u, knots_v, degree_u, degree_v, homogeneous, u, v, nu, du, nv, dv, s)
            f = g = fu = fv = gu = gv = 0.0
            for c in range(3):
                f += a[c] * (s[0, c] - o[c])
                g += b[c] * (s[0, c] - o[c])
                fu += a[c] * s[1, c]
                fv += a[c] * s[2, c]
                gu += b[c] * s[1, c]
                gv += b[c] * s[2, c]
            miss = np.sqrt(f * f + g * g)
            if miss <= allowed and miss >= 0.5 * best:
                break
            best = min(best, miss)
            determinant = fu * gv - fv * gu
            if determinant == 0.0 or step == MOST_STEPS - 1:
                break
            u -= (f * gv - g * fv) / determinant
            v -= (g * fu - f * gu) / determinant
            # A step may leave the surface by a little, where the end polynomials go on; not by more.
            u = min(max(u, u_min - 0.05 * (u_max - u_min)), u_max + 0.05 * (u_max - u_min))
            v = min(max(v, v_min - 0.05 * (v_max - v_min)), v_max + 0.05 * (v_max - v_min))
        _point(knots_u, knots_v, degree_u, degree_v, homogeneous, u, v, nu, du, nv, dv, s)
        t = miss = 0.0
        for c in range(3):
            t += d[c] * (s[0, c] - o[c])
        for c in range(3):
            miss += (s[0, c] - o[c] - t * d[c]) ** 2
        if not np.sqrt(miss) <= allowed:
            continue
        distances[n] = t
        if t <= 0.0 or not _inside(strips, first, edges, low, inverse_height, u, v):
            state[n] = OUTSIDE
            continue
        nx = s[1, 1] * s[2, 2] - s[1, 2] * s[2, 1]
        ny = s[1, 2] * s[2, 0] - s[1, 0] * s[2, 2]
        nz = s[1, 0] * s[2, 1] - s[1, 1] * s[2, 0]
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        if not length > 0.0:
            continue
        for c in range(3):
            points[n, c] = s[0, c]
        normals[n, 0], normals[n, 1], normals[n, 2] = nx / length, ny / length, nz / length
        state[n] = HIT


@njit(cache=True, parallel=True, error_model="numpy")
def unit_directions(rays, units, valid):
    """Rays (n, 3) of any length to unit length; rays that are zero or not finite become (0, 0, 1) and not valid."""
    for n in prange(rays.shape[0]):
        length = np.sqrt(rays[n, 0] ** 2 + rays[n, 1] ** 2 + rays[n, 2] ** 2)
        valid[n] = length > 0.0 and length < np.inf
        if valid[n]:
            units[n, 0], units[n, 1], units[n, 2] = rays[n, 0] / length, rays[n, 1] / length, rays[n, 2] / length
        else:
            units[n, 0], units[n, 1], units[n, 2] = 0.0, 0.0, 1.0


@njit(cache=True, parallel=True, error_model="numpy")
def finish(units, status, points, normals, reflected, distances):
    """r = d − 2(d·n)n where the status is 0; NaN in every result elsewhere."""
    for n in prange(units.shape[0]):
        if status[n] != 0:
            for c in range(3):
                points[n, c] = normals[n, c] = reflected[n, c] = np.nan
            distances[n] = np.nan
            continue
        dot = units[n, 0] * normals[n, 0] + units[n, 1] * normals[n, 1] + units[n, 2] * normals[n, 2]
        for c in range(3):
            reflected[n, c] = units[n, c] - 2.0 * dot * normals[n, c]
