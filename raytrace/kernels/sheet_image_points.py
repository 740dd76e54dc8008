"""Newton for image points in one sheet, ray by ray: on the picture plane until a ray passes near, then on the sheet itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.cells import AT_X, AT_Y, Z_X, Z_Y, Z, taylor_of_any
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.height_field_search import HIT_T, HIT_X, HIT_Y, HIT_Z, KNOWN
from raytrace.kernels.image_points import miss_of, newton_step, smallest_axis
from raytrace.kernels.outcomes import HIT, MAX_STEPS
from raytrace.kernels.sheet import Sheet, first_hit, meets_once, reflected, sheet_of
from raytrace.kernels.sheet_differentials import direction_change, point_change
from raytrace.kernels.trimming import inside

Array = NDArray[np.float64]
Index = NDArray[np.intp]

# Radians: a ray that passes its target by less is so near that Newton goes on along the sheet itself.
NEAR = 0.05
# Of one ray, as offsets into the working array after what is known of its hit: the ray, the point, the reflected direction,
# misses, their axes, the step, and how a turn of the ray changes the others.
RAY, POINT, OUT, MISS, AXES, STEP, TURN, MOVED, BENT = 13, 16, 19, 22, 24, 33, 35, 38, 41
NUMBERS = 44


@inner(fastmath={"contract"})
def aimed(w, ray, wanted, n, at_infinity, least):
    """Reflect the ray at its point, and by what it passes its target; (d·τ)/|T − P|."""
    out, q = w[OUT:MISS], w[:KNOWN]
    out[0], out[1], out[2] = reflected(ray[0], ray[1], ray[2], q[Z_X], q[Z_Y])
    return miss_of(wanted, n, at_infinity, w[POINT:OUT], out, least, w[MISS:AXES], w[AXES:STEP])


@inner(fastmath={"contract"})
def _newton(w, length, on_sheet, reach, longest):
    """Newton's step, no longer than `longest`, from the point whose ray the working array has.

    On the picture plane, `length` from the eye; or on the sheet's (x, y), where dP is given, and δ = (dP − ω·(ω·dP))/t.
    """
    q, ray, axes, turn, moved, bent = w[:KNOWN], w[RAY:POINT], w[AXES:STEP], w[TURN:MOVED], w[MOVED:BENT], w[BENT:]
    near = 1.0 / length
    s00 = s01 = s10 = s11 = 0.0
    for i in range(2):
        if on_sheet:
            moved[0], moved[1], moved[2] = (1.0, 0.0, q[Z_X]) if i == 0 else (0.0, 1.0, q[Z_Y])
            far = ray[0] * moved[0] + ray[1] * moved[1] + ray[2] * moved[2]
            for c in range(3):
                turn[c] = (moved[c] - ray[c] * far) * near
        else:
            for c in range(3):
                turn[c] = -ray[c] * ray[i] * near
            turn[i] += near
            point_change(ray, q, turn, moved)
        direction_change(ray, q, turn, moved, bent)
        first = second = 0.0
        for c in range(3):
            change = bent[c] + reach * moved[c]
            first += axes[c] * change
            second += axes[3 + c] * change
        if i == 0:
            s00, s10 = first, second
        else:
            s01, s11 = first, second
    newton_step(s00, s01, s10, s11, w[MISS:AXES], longest, w[STEP:TURN])


@inner(fastmath={"contract"})
def settle(w, s, eye, wanted, n, at_infinity, least, settled, passes, longest, reach, now):
    """Newton on the sheet's (x, y) itself, from what is near already: one look at the sheet a step, and no search.

    By what angle the best point passes, which is then in w; NaN where that is not within `passes`, or where the eye is not
    sure to see it first. The working array holds the point to start from, its ray, misses and axes.
    """
    q, ray, point, miss, step = w[:KNOWN], w[RAY:POINT], w[POINT:OUT], w[MISS:AXES], w[STEP:TURN]
    x, y, length, best = q[HIT_X], q[HIT_Y], q[HIT_T], now
    for _ in range(MAX_STEPS):
        _newton(w, length, True, reach, longest)
        x, y = x + step[0], y + step[1]
        taylor_of_any(s.field.cells, x, y, q)
        point[0], point[1], point[2] = x, y, q[Z]
        dx, dy, dz = x - eye[0], y - eye[1], q[Z] - eye[2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        ray[0], ray[1], ray[2] = dx / length, dy / length, dz / length
        facing = ray[2] - ray[0] * q[Z_X] - ray[1] * q[Z_Y]
        if not (q[AT_X] == x and q[AT_Y] == y and facing < 0.0 and meets_once(s.field, ray[0], ray[1], ray[2])):
            return np.nan
        reach = aimed(w, ray, wanted, n, at_infinity, least)
        here = np.sqrt(miss[0] * miss[0] + miss[1] * miss[1])
        if not here < best:
            break
        best, q[HIT_X], q[HIT_Y], q[HIT_Z] = here, x, y, q[Z]
        if here <= settled:
            break
    return best if best <= passes and inside(s.strips, q[HIT_X], q[HIT_Y]) else np.nan


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _solve(w, numbers, eyes, of, starts, wanted, at_infinity, max_steps, settled, passes, smallest, longest, halved_to, best,
           kept, leaving):
    s = sheet_of(numbers)
    q, ray, point, miss, step = w[:KNOWN], w[RAY:POINT], w[POINT:OUT], w[MISS:AXES], w[STEP:TURN]
    for n in range(starts.shape[0]):
        eye = eyes[of[n] if of.size else 0]
        at_x, at_y = starts[n, 0], starts[n, 1]
        best[n], kept[n, 0], kept[n, 1] = np.inf, at_x, at_y
        leaving[n, 0] = leaving[n, 1] = leaving[n, 2] = np.nan
        finite = abs(at_x) + abs(at_y) + abs(wanted[n, 0]) + abs(wanted[n, 1]) + abs(wanted[n, 2]) < np.inf
        least = smallest_axis(eye, wanted, n, at_infinity)
        step[0] = step[1] = shortest = 0.0
        plane = True  # whether to begin from the plane above the sheet, or from the point that was met last
        for _ in range(max_steps if finite else 0):
            x, y, z = at_x - eye[0], at_y - eye[1], -eye[2]
            length = np.sqrt(x * x + y * y + z * z)
            ray[0], ray[1], ray[2] = x / length, y / length, z / length
            begin = (s.field.top - eye[2]) / ray[2]
            if not plane:
                begin = (((q[HIT_X] - eye[0]) * q[Z_X] + (q[HIT_Y] - eye[1]) * q[Z_Y] - (q[HIT_Z] - eye[2]))
                         / (ray[0] * q[Z_X] + ray[1] * q[Z_Y] - ray[2]))
            status = first_hit(s, eye[0], eye[1], eye[2], ray[0], ray[1], ray[2], begin, q)
            plane = status != HIT
            now, reach = np.nan, 0.0
            if status == HIT:
                point[0], point[1], point[2] = q[HIT_X], q[HIT_Y], q[HIT_Z]
                reach = aimed(w, ray, wanted, n, at_infinity, least)
                now = np.sqrt(miss[0] * miss[0] + miss[1] * miss[1])
            step[0], step[1] = 0.5 * step[0], 0.5 * step[1]
            if now < best[n]:  # not where it is NaN
                best[n], kept[n, 0], kept[n, 1] = now, at_x, at_y
                leaving[n, 0], leaving[n, 1], leaving[n, 2] = point[0], point[1], point[2]
                if now <= settled:
                    break
                if now < NEAR:
                    found = settle(w, s, eye, wanted, n, at_infinity, least, settled, passes, longest, reach, now)
                    if found <= passes:
                        lowered = eye[2] / (eye[2] - q[HIT_Z])
                        best[n], leaving[n, 0], leaving[n, 1], leaving[n, 2] = found, q[HIT_X], q[HIT_Y], q[HIT_Z]
                        kept[n, 0], kept[n, 1] = eye[0] + (q[HIT_X] - eye[0]) * lowered, eye[1] + (q[HIT_Y] - eye[1]) * lowered
                        break
                    ray[0], ray[1], ray[2] = x / length, y / length, z / length  # all as it was
                    first_hit(s, eye[0], eye[1], eye[2], ray[0], ray[1], ray[2], begin, q)
                    point[0], point[1], point[2] = q[HIT_X], q[HIT_Y], q[HIT_Z]
                    reach = aimed(w, ray, wanted, n, at_infinity, least)
                _newton(w, length, False, reach, longest)
                shortest = halved_to * max(abs(step[0]), abs(step[1]))
            elif best[n] <= passes:
                break
            if not max(abs(step[0]), abs(step[1])) > max(smallest, shortest):
                break
            at_x, at_y = kept[n, 0] + step[0], kept[n, 1] + step[1]


def image_points(sheet: Sheet, eyes: Array, of: Index, starts: Array, wanted: Array, at_infinity: bool, max_steps: int,
                 settled: float, passes: float, smallest: float, longest: float, halved_to: float,
                 ) -> tuple[Array, Array, Array]:
    """Newton for the points of the picture plane z = 0 whose rays are reflected towards targets, from starts (n, 2).

    Parameters
    ----------
    sheet : in mirror coordinates, mm.   eyes : (m, 3), there.   of : (n,), whose ray each is; empty where it is the first's.
    starts : (n, 2).   wanted : (n, 3), targets, or unit directions.   at_infinity : whether they are directions.
    max_steps : rays for each.   settled, passes : radians, at which it ends, and at which what betters nothing ends it.
    smallest, longest : steps, mm.   halved_to : of Newton's own step, down to which it is halved.

    Returns
    -------
    The best points (n, 2), where their rays leave (n, 3), and by what angles they pass, about (n,).
    """
    n = len(starts)
    best, kept, leaving = np.empty(n), np.empty((n, 2)), np.empty((n, 3))
    _solve(np.zeros(NUMBERS), sheet.numbers, eyes, of, starts, wanted, at_infinity, max_steps, settled, passes, smallest,
           longest, halved_to, best, kept, leaving)
    return kept, leaving, best
