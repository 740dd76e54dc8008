"""Rays in blocks of sixteen, as the kernels that need no search take them, and their results.

Each kernel takes a run of rays on one thread and gives up the interpreter lock; `raytrace.parallel` hands out the runs.
Arrays of vectors come flat (x, y, z, x, …): numba then knows that they are contiguous. The kernels are compiled without
reference counts (_nrt), which took a third of the time, and need their working arrays from outside.
"""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.lanes import load_three, store_three
from raytrace.kernels.outcomes import BEHIND, HIT, INVALID
from raytrace.kernels.vectors import RAYS, count_of, eight, ends_of, maximum, minimum, put, root, size

Array = NDArray[np.float64]

BLOCK = 16  # rays taken at once: each step of the arithmetic is one short loop over them, which becomes vector instructions

# Rows of a block's working array, as offsets into it: ray, parameters, surface and results. A literal offset from one array
# is what lets LLVM see that the rows do not overlap.
OX, OY, OZ, DX, DY, DZ, T, X, Y, Z, ZX, ZY, LIMIT, MISS, V0, V1, V2, NX, NY, NZ, RX, RY, RZ = (BLOCK * k for k in range(23))
# More of them, for parametric surfaces: two directions across the ray, parameters, and P, P_u, P_v in up to four
# homogeneous coordinates, each kept (K) and as last evaluated (P).
AX, AY, AZ, BX, BY, BZ, U, V, LAST, LIMIT_P = (BLOCK * k for k in range(23, 33))
P, K = BLOCK * 33, BLOCK * 45
# Newton on a sheet has there the last step, and how high above the sheet and over what slopes it began.
STEP, ABOVE, WAS_ZX, WAS_ZY = AX, AY, AZ, BX
# And for a plate of glass: the way to its front, where its back turns the ray, the share along the normal in which the ray goes
# down, and how far the back was along the normal for the lane's last ray.
ENTRY, BACK_X, BACK_Y, BACK_Z, DOWN, GAP = (BLOCK * k for k in range(57, 63))
MAX_ROWS = 63
CACHE_LINE = 8  # numbers


class Results(NamedTuple):
    """Of n rays, flat; see `raytrace.rays.Trace`."""

    status: NDArray[np.int8]
    points: Array
    normals: Array
    directions: Array
    distances: Array

    def of_rays(self, start: int, stop: int) -> Results:
        """Those of rays start … stop, in the same memory."""
        if start == 0 and stop == len(self.status):
            return self
        three = slice(3 * start, 3 * stop)
        return Results(self.status[start:stop], self.points[three], self.normals[three], self.directions[three],
                       self.distances[start:stop])


class Work(NamedTuple):
    """A thread's working arrays: the rows of a block, what becomes of its rays, and a paraboloid."""

    rows: Array
    state: NDArray[np.int8]
    paraboloid: Array


_own = threading.local()


def work() -> Work:
    """The calling thread's working arrays, made once.

    They begin where a cache line does, which is worth 3 % of the time, and share none with another thread's.
    """
    found: Work | None = getattr(_own, "work", None)
    if found is None:
        memory = np.zeros(MAX_ROWS * BLOCK + 4 * CACHE_LINE)
        memory = memory[-(memory.ctypes.data // 8) % CACHE_LINE:]
        rows, paraboloid, state = np.split(memory, [MAX_ROWS * BLOCK, MAX_ROWS * BLOCK + CACHE_LINE])
        found = _own.work = Work(rows, state.view(np.int8)[:BLOCK], paraboloid)
    return found


@inner()
def at(index):
    """The same index, known not to be negative.

    numba then does not look for one that counts from the end, and the loop becomes vector instructions. (A slice would do the
    same, at the price of two atomic reference counts.)
    """
    return np.int64(np.uint32(index))


@inner()
def clamp(x, low, high):
    """The number, or the nearer of two ends."""
    return min(max(x, low), high)


@inner()
def box(w, first, second):
    """Smallest and largest value of two rows, of what is not NaN: a ray that is lost must not hide where the others are."""
    a, b, c, d = eight(w, first), eight(w, first + RAYS), eight(w, second), eight(w, second + RAYS)
    return ends_of(minimum(a, minimum(b, np.inf)), maximum(a, maximum(b, -np.inf)),
                   minimum(c, minimum(d, np.inf)), maximum(c, maximum(d, -np.inf)))


@inner(fastmath={"contract"})
def go_along(w):
    """Points (X, Y) of the rays at T, and their box."""
    for m in range(0, BLOCK, RAYS):
        t = eight(w, T + m)
        put(w, X + m, eight(w, OX + m) + t * eight(w, DX + m))
        put(w, Y + m, eight(w, OY + m) + t * eight(w, DY + m))
    return box(w, X, Y)


@inner()
def unit(directions, n, w, m):
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


@inner()
def load(origins, directions, start, count, w):
    """Rays start … start + count into the first lanes; the lanes after them repeat the last ray.

    Returns how many have no length of their own that a square root can take: `fix_degenerate_rays` has to look at them.
    """
    k = at(3 * start)
    if count == BLOCK:
        for m in range(0, BLOCK, RAYS):
            load_three(directions, k + 3 * m, w, DX + m, DY + m, DZ + m)
    else:
        for m in range(BLOCK):
            n = at(k + 3 * min(m, count - 1))
            w[DX + m], w[DY + m], w[DZ + m] = directions[n], directions[n + 1], directions[n + 2]
    if origins.size == 3:
        for m in range(0, BLOCK, RAYS):
            put(w, OX + m, origins[0])
            put(w, OY + m, origins[1])
            put(w, OZ + m, origins[2])
    elif count == BLOCK:
        for m in range(0, BLOCK, RAYS):
            load_three(origins, k + 3 * m, w, OX + m, OY + m, OZ + m)
    else:
        for m in range(BLOCK):
            n = at(k + 3 * min(m, count - 1))
            w[OX + m], w[OY + m], w[OZ + m] = origins[n], origins[n + 1], origins[n + 2]
    odd = BLOCK
    for m in range(0, BLOCK, RAYS):
        x, y, z = eight(w, DX + m), eight(w, DY + m), eight(w, DZ + m)
        square = x * x + y * y + z * z
        scale = 1.0 / root(square)
        put(w, DX + m, x * scale)
        put(w, DY + m, y * scale)
        put(w, DZ + m, z * scale)
        finite = size(eight(w, OX + m)) + size(eight(w, OY + m)) + size(eight(w, OZ + m)) < np.inf
        odd -= count_of((square > 1e-200) & (square < 1e200) & finite)
    return odd


@inner()
def fix_degenerate_rays(directions, start, count, w, state):
    """The lanes of a block in which some ray is degenerate: HIT for those with a direction, INVALID for the others.

    Those that are INVALID are given an origin and a direction.
    """
    for m in range(BLOCK):
        n = start + min(m, count - 1)
        finite = abs(w[OX + m]) + abs(w[OY + m]) + abs(w[OZ + m]) < np.inf
        if finite and unit(directions, n, w, m):
            state[m] = HIT
        else:
            state[m] = INVALID
            w[OX + m] = w[OY + m] = w[OZ + m] = w[DX + m] = w[DY + m] = 0.0
            w[DZ + m] = -1.0


@inner()
def reflect(w):
    """r = d − 2(d·n)n."""
    for m in range(0, BLOCK, RAYS):
        dx, dy, dz = eight(w, DX + m), eight(w, DY + m), eight(w, DZ + m)
        nx, ny, nz = eight(w, NX + m), eight(w, NY + m), eight(w, NZ + m)
        twice = 2.0 * (dx * nx + dy * ny + dz * nz)
        put(w, RX + m, dx - twice * nx)
        put(w, RY + m, dy - twice * ny)
        put(w, RZ + m, dz - twice * nz)


@inner()
def store_all(w, start, results):
    """A block of which every ray hits."""
    status, points, normals, reflected, distances = results
    k, n = at(3 * start), at(start)
    for m in range(0, BLOCK, RAYS):
        store_three(points, k + 3 * m, w, X + m, Y + m, Z + m)
        store_three(normals, k + 3 * m, w, NX + m, NY + m, NZ + m)
        store_three(reflected, k + 3 * m, w, RX + m, RY + m, RZ + m)
        put(distances, n + m, eight(w, T + m))
    for m in range(BLOCK):
        status[n + m] = HIT


@inner()
def store(w, state, start, count, results):
    """A block ray by ray: NaN in every result of a ray that does not hit, but the distance of one from behind."""
    status, points, normals, reflected, distances = results
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


@compiled(nogil=True)
def unit_directions(rays, units, valid):
    """Rays (n, 3) of any length to unit length; those without a direction become (0, 0, 1) and not valid."""
    w = np.zeros(6 * BLOCK)
    for n in range(rays.shape[0]):
        valid[n] = unit(rays[n], 0, w, 0)
        if valid[n]:
            units[n, 0], units[n, 1], units[n, 2] = w[DX], w[DY], w[DZ]
        else:
            units[n, 0], units[n, 1], units[n, 2] = 0.0, 0.0, 1.0
