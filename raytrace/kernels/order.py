"""Rays sorted by the cell of a sheet that they go to, so that a block of them lies together."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.blocks import BLOCK, Results, at
from raytrace.kernels.cells import MAX_CELLS, cell_at, span
from raytrace.kernels.compiled import compiled, inner

Array = NDArray[np.float64]
Order = NDArray[np.int32]

LEAST = 2048  # rays: fewer do not fill a block in each place of a sheet, and gain nothing
SAMPLED = 4  # blocks that are looked at for whether rays lie together
MAX_BINS = 1 << 13


class SortingGrid(NamedTuple):
    """Where rays go on a sheet, roughly: where they meet a plane through it, in the sheet's parameters.

    Attributes
    ----------
    plane : (4,), n and d of n·x + d = 0.
    along_u, along_v : (4,), u = a + b·x + c·y + d·z, and v.
    ends_u, ends_v, lookup_u, lookup_v, bins_u, bins_v : of the cells, as in `raytrace.kernels.cells.Cells`.
    """

    plane: Array
    along_u: Array
    along_v: Array
    ends_u: Array
    ends_v: Array
    lookup_u: NDArray[np.int32]
    lookup_v: NDArray[np.int32]
    bins_u: float
    bins_v: float


class Room(NamedTuple):
    """A thread's own memory for sorted rays.

    Attributes
    ----------
    origins, directions : (3n,), sorted.
    places, bins : (2n,) and (n,), of the rays as they come; of the bins there remains where each ray is among the sorted.
    starts, columns : the first ray of each bin, and the first column of bins of each cell.
    results : of the sorted rays.
    """

    origins: Array
    directions: Array
    places: Array
    bins: Order
    starts: Order
    columns: Order
    results: Results

    @staticmethod
    def of(n: int) -> Room:
        """For n rays."""
        results = Results(np.empty(n, dtype=np.int8), np.empty(3 * n), np.empty(3 * n), np.empty(3 * n), np.empty(n))
        return Room(np.empty(3 * n), np.empty(3 * n), np.empty(2 * n), np.empty(n, dtype=np.int32),
                    np.empty(2 * MAX_BINS, dtype=np.int32), np.empty(MAX_BINS, dtype=np.int32), results)


_own = threading.local()


def room(n: int) -> Room:
    """The calling thread's own, for n rays or more."""
    found: Room | None = getattr(_own, "room", None)
    if found is None or len(found.bins) < n:
        found = _own.room = Room.of(n)
    return found


@inner(fastmath={"contract"})
def _places(cells, origins, directions, start, stop, places):
    """(u, v) of rays start … stop, within the sheet's; rays that go nowhere may lie anywhere."""
    plane, along_u, along_v = cells.plane, cells.along_u, cells.along_v
    u_min, u_max, v_min, v_max = cells.ends_u[0], cells.ends_u[-2], cells.ends_v[0], cells.ends_v[-2]
    for n in range(start, stop):
        k = at(3 * n)
        o = 0 if origins.size == 3 else k
        x, y, z = origins[o], origins[o + 1], origins[o + 2]
        dx, dy, dz = directions[k], directions[k + 1], directions[k + 2]
        t = -(plane[0] * x + plane[1] * y + plane[2] * z + plane[3]) / (plane[0] * dx + plane[1] * dy + plane[2] * dz)
        x, y, z = x + t * dx, y + t * dy, z + t * dz
        places[2 * n] = min(max(along_u[0] + along_u[1] * x + along_u[2] * y + along_u[3] * z, u_min), u_max)
        places[2 * n + 1] = min(max(along_v[0] + along_v[1] * x + along_v[2] * y + along_v[3] * z, v_min), v_max)


@inner()
def _scattered(cells, places, start):
    """Whether the block of rays from start on lies over more cells than are taken as a whole."""
    u_low = v_low = np.inf
    u_high = v_high = -np.inf
    for n in range(start, start + BLOCK):
        u_low, u_high = min(u_low, places[2 * n]), max(u_high, places[2 * n])
        v_low, v_high = min(v_low, places[2 * n + 1]), max(v_high, places[2 * n + 1])
    (i_low, j_low), (i_high, j_high) = cell_at(cells, u_low, v_low), cell_at(cells, u_high, v_high)
    return (i_high - i_low + 1) * (j_high - j_low + 1) > MAX_CELLS


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def scattered(cells, origins, directions, places):
    """Whether rays lie apart, as some blocks of them do: whether it is worth while to sort them."""
    n_rays = directions.size // 3
    if 2 * cells.ends_u.size > MAX_BINS:
        return False
    found = 0
    for k in range(SAMPLED):
        first = (n_rays // BLOCK - 1) * k // (SAMPLED - 1) * BLOCK
        _places(cells, origins, directions, first, first + BLOCK, places)
        found += int(_scattered(cells, places, first))
    return 2 * found > SAMPLED


@compiled(nogil=True, fastmath={"contract"}, _nrt=False)
def gather(cells, origins, directions, room):
    """Put rays into the room, those that go to one place of the sheet side by side.

    Places are the sheet's cells, cut so that each gets a block of rays if they are spread evenly, column by column, up one and
    down the next.
    """
    n_rays = directions.size // 3
    places, bins, starts, columns_before = room.places, room.bins, room.starts, room.columns
    _places(cells, origins, directions, np.int64(0), n_rays, places)  # not a literal, for which it would be compiled anew
    ends_u, v_min, spans = cells.ends_u, cells.ends_v[0], cells.ends_u.size - 2
    v_size = cells.ends_v[-2] - v_min
    wanted = min(n_rays // BLOCK, MAX_BINS)
    per_u = np.sqrt(wanted) / (ends_u[-2] - ends_u[0])
    columns = 0
    for i in range(spans):
        columns_before[i] = columns
        columns += max(1, int((ends_u[i + 1] - ends_u[i]) * per_u + 0.5))
    columns_before[spans] = columns
    rows = max(1, int(wanted / columns + 0.5))
    for k in range(rows * columns + 1):
        starts[k] = 0
    for n in range(n_rays):
        i = span(places[2 * n], ends_u, cells.lookup_u, cells.bins_u)
        share = (places[2 * n] - ends_u[i]) / (ends_u[i + 1] - ends_u[i])
        first, after = columns_before[i], columns_before[i + 1]
        column = max(min(first + int(share * (after - first)), after - 1), first)
        row = max(min(int((places[2 * n + 1] - v_min) / v_size * rows), rows - 1), 0)
        bins[n] = column * rows + (row if column % 2 == 0 else rows - 1 - row)
        starts[bins[n] + 1] += 1
    for k in range(rows * columns):
        starts[k + 1] += starts[k]
    for n in range(n_rays):
        to = starts[bins[n]]
        starts[bins[n]] = to + 1
        bins[n] = to  # from now on the place of ray n among the sorted
        k, j = at(3 * to), at(3 * n)
        for c in range(3):
            room.directions[k + c] = directions[j + c]
        if origins.size > 3:
            for c in range(3):
                room.origins[k + c] = origins[j + c]


@compiled(nogil=True, _nrt=False)
def put_back(room, n_rays, results):
    """The results of sorted rays to where their rays were: written one after the other, read where they are."""
    found, sorted_at = room.results, room.bins
    for n in range(n_rays):
        k = sorted_at[n]
        results.status[n], results.distances[n] = found.status[k], found.distances[k]
        to, of = at(3 * n), at(3 * k)
        for c in range(3):
            results.points[to + c] = found.points[of + c]
            results.normals[to + c] = found.normals[of + c]
            results.directions[to + c] = found.directions[of + c]
