"""The rays of one or more eyes into one sheet, one by one: through the picture plane, and to points of the sheet."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.cells import Z_X, Z_Y
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.height_field_search import HIT_X, HIT_Y, HIT_Z, KNOWN
from raytrace.kernels.outcomes import HIT, NEAREST_MM
from raytrace.kernels.sheet import Sheet, meets_once, ray_through, reflected, sheet_of

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Posed(NamedTuple):
    """Eyes (m, 3) in mirror coordinates, mm, and for each the rotation (m, 3, 3) and offset (m, 3) to other coordinates."""

    eyes: Array
    rotations: Array
    offsets: Array


NONE: Index = np.empty(0, dtype=np.intp)  # all rays are those of the first eye


@compiled(fastmath={"contract"}, inline="always")
def turned(rotation, c, x, y, z):
    """Coordinate c of a vector in other coordinates."""
    return rotation[c, 0] * x + rotation[c, 1] * y + rotation[c, 2] * z


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _trace(q, ray, numbers, eyes, rotations, offsets, of, at, status, points, directions, on_mirror):
    s = sheet_of(numbers)
    for n in range(at.shape[0]):
        p = of[n] if of.size else 0
        rotation, offset = rotations[p], offsets[p]
        status[n] = ray_through(s, eyes[p], at[n, 0], at[n, 1], ray, q)
        if status[n] != HIT:
            for c in range(3):
                points[n, c] = directions[n, c] = on_mirror[n, c] = np.nan
            continue
        dx, dy, dz = reflected(ray[0], ray[1], ray[2], q[Z_X], q[Z_Y])
        on_mirror[n, 0], on_mirror[n, 1], on_mirror[n, 2] = q[HIT_X], q[HIT_Y], q[HIT_Z]
        for c in range(3):
            points[n, c] = turned(rotation, c, q[HIT_X], q[HIT_Y], q[HIT_Z]) + offset[c]
            directions[n, c] = turned(rotation, c, dx, dy, dz)


def trace(sheet: Sheet, posed: Posed, at: Array, of: Index = NONE) -> tuple[NDArray[np.int8], Array, Array, Array]:
    """Trace eyes' rays through points of the picture plane, of which there are too few for blocks of them to be worth it.

    Parameters
    ----------
    sheet, posed, of : as in `rays_to`.   at : (n, 2), mm, points of the plane z = 0.

    Returns
    -------
    Status (n,); points and unit directions (n, 3) in the other coordinates; points (n, 3) in the mirror's.
    """
    n = len(at)
    status, points, directions, on_mirror = np.empty(n, dtype=np.int8), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    _trace(np.zeros(KNOWN), np.zeros(3), sheet.numbers, *posed, of, at, status, points, directions, on_mirror)
    return status, points, directions, on_mirror


@inner(fastmath={"contract"})
def ray_to(s, eye, x, y, z, z_x, z_y, rotation, offset, ray):
    """How the eye's ray to a point of the sheet leaves, in the other coordinates: point and direction, into ray (6,).

    Whether it is sure to meet that point first.
    """
    dx, dy, dz = x - eye[0], y - eye[1], z - eye[2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / length, dy / length, dz / length
    rx, ry, rz = reflected(dx, dy, dz, z_x, z_y)
    for c in range(3):
        ray[c] = turned(rotation, c, x, y, z) + offset[c]
        ray[3 + c] = turned(rotation, c, rx, ry, rz)
    return dz - dx * z_x - dy * z_y < 0.0 and length > NEAREST_MM and meets_once(s.field, dx, dy, dz)


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def _rays_to(ray, numbers, eyes, rotations, offsets, of, surface, at, points, directions):
    s = sheet_of(numbers)
    for n in range(surface.shape[0]):
        p = of[n] if of.size else 0
        eye = eyes[p]
        x, y, z, z_x, z_y = surface[n, 0], surface[n, 1], surface[n, 2], surface[n, 3], surface[n, 4]
        if not ray_to(s, eye, x, y, z, z_x, z_y, rotations[p], offsets[p], ray):
            return False
        lowered = eye[2] / (eye[2] - z)
        at[n, 0], at[n, 1] = eye[0] + (x - eye[0]) * lowered, eye[1] + (y - eye[1]) * lowered
        for c in range(3):
            points[n, c], directions[n, c] = ray[c], ray[3 + c]
    return True


def rays_to(sheet: Sheet, posed: Posed, surface: Array, of: Index = NONE, out: tuple[Array, Array, Array] | None = None,
            ) -> tuple[Array, Array, Array] | None:
    """How eyes' rays to points of the sheet leave, without looking for these.

    Parameters
    ----------
    sheet : in mirror coordinates, mm.   posed : the eyes.
    surface : (n, 5), as `surface_points` has them.   of : (n,), whose ray each is; empty where it is the first's.
    out : what is returned, to be written over: fresh memory costs more than the rays.

    Returns
    -------
    Points (n, 2) of the picture plane; points and unit directions (n, 3) in the other coordinates. None where an eye may not
    see one of its points, or another part of the sheet before it.
    """
    n = len(surface)
    at, points, directions = out or (np.empty((n, 2)), np.empty((n, 3)), np.empty((n, 3)))
    direct = _rays_to(np.zeros(6), sheet.numbers, *posed, of, surface, at, points, directions)
    return (at, points, directions) if direct else None
