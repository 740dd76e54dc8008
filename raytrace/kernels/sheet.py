"""One sheet z(x, y) inside trimming loops, and where single rays meet it first.

What takes many steps on few rays is done in one call, ray by ray, where a call a step would cost more than its rays. The search
is that of height_field_search.py. Newton before it is not that of height_field.py, whose blocks take sixteen rays that are
known beforehand: here each ray follows from the one before it, and begins where that met the sheet.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.cells import AT_X, AT_Y, Z_X, Z_Y, Z, taylor_of_any
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.height_field import SHALLOWEST, HeightField, plain, records
from raytrace.kernels.height_field_search import HIT_T, HIT_X, HIT_Y, HIT_Z, RISE, search
from raytrace.kernels.outcomes import ACCEPTED, HIT, INVALID, MAX_STEPS, NEAREST_MM, OUTSIDE, RESIDUAL
from raytrace.kernels.trimming import Strips, inside

Array = NDArray[np.float64]


class Sheet(NamedTuple):
    """A sheet z(x, y) inside trimming loops.

    Attributes
    ----------
    field : its heights.
    strips : its trimming.
    one_sided : whether only its upper side reflects.
    """

    field: HeightField
    strips: Strips
    one_sided: bool

    @property
    def numbers(self) -> tuple[Any, ...]:
        """All of it as one plain tuple, for `sheet_of`."""
        return (*plain(self.field, self.strips), self.one_sided)


@compiled(inline="always")
def sheet_of(n):
    """The sheet of these numbers."""
    field, strips = records(n)
    return Sheet(field, strips, n[20])


@compiled(inline="always")
def meets_once(field, dx, dy, dz):
    """Whether a ray comes down steeply enough to meet a sheet only once."""
    return dz <= -SHALLOWEST and dz * dz > field.steepest * (dx * dx + dy * dy)


@inner(fastmath={"contract"}, forceinline=True)
def first_hit(s, ox, oy, oz, dx, dy, dz, start, q):
    """What a ray, from where and in what unit direction, meets first: its status, and what is known of that point in q.

    Inlined by force: the sheet is a hundred numbers, which go by the stack to what is not.

    start : the distance at which Newton begins where the ray can meet the sheet only once.
    """
    if not abs(ox) + abs(oy) + abs(oz) + abs(dx) + abs(dy) + abs(dz) < np.inf:
        return INVALID
    if meets_once(s.field, dx, dy, dz):
        t, missed = start, np.inf
        limit = RESIDUAL * (abs(t) + abs(ox) + abs(oy) + abs(oz))
        settled = False
        for _ in range(MAX_STEPS):
            x, y = ox + t * dx, oy + t * dy
            taylor_of_any(s.field.cells, x, y, q)
            above = oz + t * dz - (q[Z] + q[Z_X] * (x - q[AT_X]) + q[Z_Y] * (y - q[AT_Y]))
            t -= above / (dz - q[Z_X] * dx - q[Z_Y] * dy)
            miss, bound = abs(above), limit * np.sqrt(1.0 + q[Z_X] * q[Z_X] + q[Z_Y] * q[Z_Y])
            settled = miss <= bound or (miss <= ACCEPTED * bound and miss >= 0.5 * missed)
            missed = miss
            if settled:
                break
        if settled or missed <= ACCEPTED * bound:
            x, y = ox + t * dx, oy + t * dy
            ends_x, ends_y = s.field.cells.ends_u, s.field.cells.ends_v
            rise = dx * -q[Z_X] + dy * -q[Z_Y] + dz
            if t > NEAREST_MM and rise < 0.0 and ends_x[0] <= x <= ends_x[-2] and ends_y[0] <= y <= ends_y[-2]:
                q[HIT_T], q[HIT_X], q[HIT_Y], q[HIT_Z], q[RISE] = t, x, y, oz + t * dz, rise
                return HIT if inside(s.strips, x, y) else OUTSIDE
    return search(s.field, s.strips, s.one_sided, ox, oy, oz, dx, dy, dz, q)


@compiled(fastmath={"contract"}, inline="always")
def ray_through(s, eye, x, y, ray, q):
    """What the eye's ray through (x, y) of the picture plane z = 0 meets first: its status; the unit ray, and q as above."""
    dx, dy, dz = x - eye[0], y - eye[1], -eye[2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    ray[0], ray[1], ray[2] = dx / length, dy / length, dz / length
    return first_hit(s, eye[0], eye[1], eye[2], ray[0], ray[1], ray[2], (s.field.top - eye[2]) / ray[2], q)


@compiled(fastmath={"contract"}, inline="always")
def reflected(dx, dy, dz, z_x, z_y):
    """d − 2(d·n)n, of a point with these slopes."""
    twice = 2.0 * (dz - dx * z_x - dy * z_y) / (1.0 + z_x * z_x + z_y * z_y)
    return dx + twice * z_x, dy + twice * z_y, dz - twice


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _surface_points(q, numbers, at, found):
    s = sheet_of(numbers)
    for n in range(at.shape[0]):
        taylor_of_any(s.field.cells, at[n, 0], at[n, 1], q)
        found[n, 0], found[n, 1], found[n, 2], found[n, 3], found[n, 4] = q[AT_X], q[AT_Y], q[Z], q[Z_X], q[Z_Y]


def surface_points(sheet: Sheet, at: Array) -> Array:
    """x, y, z, z_x and z_y, (n, 5), of the points of the sheet nearest to at (n, 2)."""
    found = np.empty((len(at), 5))
    _surface_points(np.zeros(8), sheet.numbers, at, found)
    return found
