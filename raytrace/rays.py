"""Rays into a reflector, and what becomes of them: the records that every surface reads and writes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import combinations
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import TraceError
from raytrace.kernels.blocks import Results, unit_directions
from raytrace.parallel import parallel_for

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
NormalsFrom = Literal["surface", "facets", "interpolated"]

# Rays searched for at once: the working arrays are some 300 bytes a ray.
SEARCHED = 200_000
# The arrays of a Trace.
NAMES = ("status", "points", "normals", "directions", "distances")
KINDS = (np.dtype(np.int8), *[np.dtype(np.float64)] * 4)
NO_ROWS = np.empty(0, dtype=np.intp)


def all_apart(arrays: Sequence[NDArray[Any]]) -> bool:
    """Whether it is seen at a glance that no two arrays share memory: no two have the same owner, and each owner is known.

    np.may_share_memory knows more, and takes a fifth of a microsecond for each pair.
    """
    owners = set()
    for array in arrays:
        owner = array.base
        if owner is None:
            owner = array
        elif not isinstance(owner, np.ndarray):
            return False
        if not owner.flags.owndata:
            return False
        owners.add(id(owner))
    return len(owners) == len(arrays)


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """n rays: origins (1, 3) of one eye or (n, 3), mm, and directions (n, 3) of any length."""

    origins: Array
    directions: Array

    @staticmethod
    def of(origins: ArrayLike, directions: ArrayLike) -> Rays:
        """Check rays as they come from outside.

        Parameters
        ----------
        origins : (3,) for one eye, (1, 3) or (n, 3), mm.
        directions : (n, 3), any length.

        Raises
        ------
        TraceError
            For arrays of other shapes, or that are no real numbers.
        """
        try:
            eye, rays = np.asarray(origins), np.asarray(directions)
        except ValueError:
            raise TraceError("origins and directions must be arrays (n, 3): their rows have different lengths") from None
        for name, array in (("origins", eye), ("directions", rays)):
            if array.dtype.kind not in "fiu":
                raise TraceError(f"{name} must be real numbers, not {array.dtype}")
        if rays.ndim != 2 or rays.shape[1] != 3:
            raise TraceError(f"directions must be of shape (n, 3), not {rays.shape}")
        if eye.shape not in ((3,), (1, 3), rays.shape):
            raise TraceError(f"origins must be of shape (3,) or {rays.shape} like the directions, not {eye.shape}")
        return Rays(np.ascontiguousarray(eye, dtype=np.float64).reshape(-1, 3),
                    np.ascontiguousarray(rays, dtype=np.float64))

    def __len__(self) -> int:
        return len(self.directions)

    def some(self, index: Index) -> Rays:
        """Those of an index, one eye staying one."""
        return Rays(self.origins if len(self.origins) == 1 else self.origins[index], self.directions[index])

    def in_parts(self, index: Index) -> Iterator[tuple[Index, Rays]]:
        """The rays of an index, SEARCHED at a time: what bounds the memory of a search."""
        for start in range(0, len(index), SEARCHED):
            part = index[start:start + SEARCHED]
            yield part, self.some(part)

    def into(self, out: Trace) -> Rays:
        """The same rays, in memory of their own: they are still read when results are written, and may be those before.

        Raises
        ------
        TraceError
            Where the results do not fit into `out`.
        """
        n, arrays = len(self), out.arrays
        one, three = (n,), (n, 3)
        for name, array, shape, kind in zip(NAMES, arrays, (one, three, three, three, one), KINDS, strict=True):
            # Behaved: contiguous, aligned and writeable.
            if array.shape != shape or array.dtype != kind or not array.flags.carray:
                raise TraceError(f"out.{name} must be a contiguous, writeable {kind} array of shape {shape} for {n} "
                                 f"rays, not {array.dtype} of shape {array.shape}: Trace.empty({n}) makes one")
        if all_apart((self.origins, self.directions, *arrays)):
            return self
        if any(np.may_share_memory(*pair) for pair in combinations(arrays, 2)):
            raise TraceError(f"two arrays of out are the same memory: Trace.empty({n}) makes one without")
        return Rays(*(given.copy() if any(np.may_share_memory(given, result) for result in out.arrays) else given
                      for given in (self.origins, self.directions)))

    def units(self) -> tuple[Array, Array, Mask]:
        """Origins (n, 3), unit directions, and which rays are usable; the others get an origin and a direction that are."""
        units, valid = np.empty_like(self.directions), np.empty(len(self), dtype=np.bool_)
        parallel_for(lambda i, j: unit_directions(self.directions[i:j], units[i:j], valid[i:j]), len(self))
        finite: Mask = np.asarray(np.isfinite(self.origins).all(axis=1))
        valid &= finite
        return np.broadcast_to(np.where(finite[:, None], self.origins, 0.0), units.shape), units, valid


class Status(IntEnum):
    """What became of a ray."""

    REFLECTED = 0
    MISSED = 1  # meets nothing, or only parts that are trimmed away
    BLOCKED = 2  # meets an obstacle first, or stays inside the glass
    BEHIND = 3  # meets the back of a one-sided face
    LOST = 4  # meets a surface but Newton did not converge on it
    INVALID = 5  # its origin or direction is not finite, or its direction is zero


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """Result for n rays, in their order; rows of rays that were not reflected are NaN, but the distance of one from BEHIND.

    status (n,) int8, see Status.   points (n, 3) mm.   normals (n, 3), unit, towards the ray's side.
    directions (n, 3), unit, after reflection.   distances (n,) mm, along the ray to the point.
    normals_from : what the normals are of: the surface itself, a mesh's facets, or a mesh's vertices, interpolated.
    """

    status: NDArray[np.int8]
    points: Array
    normals: Array
    directions: Array
    distances: Array
    normals_from: Literal["surface", "facets", "interpolated"] = "surface"

    @staticmethod
    def empty(n: int) -> Trace:
        """Arrays for n rays, to be given to `reflect` as `out`."""
        return Trace(np.empty(n, dtype=np.int8), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty(n))

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """All of them, in their order."""
        return self.status, self.points, self.normals, self.directions, self.distances

    def rows_of(self, status: Status) -> Index:
        """The rays of a status; told at once where none has it."""
        return np.flatnonzero(self.status == status) if status.to_bytes() in self.status.tobytes() else NO_ROWS

    @property
    def flat(self) -> Results:
        """The same arrays as the kernels take them."""
        return Results(self.status, self.points.ravel(), self.normals.ravel(), self.directions.ravel(), self.distances)

    def counts(self) -> dict[str, int]:
        """How many rays have each status, by name; statuses that none has are left out."""
        found = np.bincount(self.status, minlength=len(Status))
        return {status.name.lower(): int(found[status]) for status in Status if found[status]}

    def scatter(self, index: Index, found: Trace) -> None:
        """Put the results of some rays at their places."""
        for array, other in zip(self.arrays, found.arrays, strict=True):
            array[index] = other

    def invalidate(self, index: Index) -> None:
        """Make the rows of rays that are not reflected NaN."""
        for array in self.arrays[1:]:
            array[index] = np.nan
