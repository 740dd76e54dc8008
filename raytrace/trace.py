"""Reflector and rays in, where each ray meets it and where it goes from there out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace import first_hit
from raytrace.errors import TraceError
from raytrace.kernels import newton
from raytrace.parallel import parallel_for
from raytrace.reflector import Reflector, TrimmedSurface

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

# An obstacle counts as in front of the mirror only by more than its own mesh error.
OBSTACLE_MARGIN_MM = 0.2
# Rays searched for at once: the working arrays are some 300 bytes a ray.
SEARCHED = 200_000


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

    def counts(self) -> dict[str, int]:
        """How many rays have each status, by name; statuses that none has are left out."""
        found = np.bincount(self.status, minlength=len(Status))
        return {status.name.lower(): int(found[status]) for status in Status if found[status]}

    def check_room(self, n: int) -> None:
        """Raise TraceError where the results of n rays do not fit."""
        for name, shape, kind in (("status", (n,), np.int8), ("points", (n, 3), np.float64), ("normals", (n, 3), np.float64),
                                  ("directions", (n, 3), np.float64), ("distances", (n,), np.float64)):
            array = getattr(self, name)
            if array.shape != shape or array.dtype != kind or not (array.flags.c_contiguous and array.flags.writeable):
                raise TraceError(f"out.{name} must be a contiguous, writeable {np.dtype(kind)} array of shape {shape} for {n} "
                                 f"rays, not {array.dtype} of shape {array.shape}: Trace.empty({n}) makes one")
        arrays = (self.status, self.points, self.normals, self.directions, self.distances)
        if any(np.may_share_memory(one, other) for k, one in enumerate(arrays) for other in arrays[:k]):
            raise TraceError(f"two arrays of out are the same memory: Trace.empty({n}) makes one without")

    def take(self, index: Index, found: Trace) -> None:
        """Put the results of some rays at their places."""
        for name in ("status", "points", "normals", "directions", "distances"):
            getattr(self, name)[index] = getattr(found, name)

    def drop(self, index: Index) -> None:
        """Make the rows of rays that are not reflected NaN."""
        for array in (self.points, self.normals, self.directions, self.distances):
            array[index] = np.nan


def reflect(reflector: Reflector, origins: ArrayLike, directions: ArrayLike, out: Trace | None = None) -> Trace:
    """Trace rays to their first reflection: d' = d − 2(d·n)n at the first reflecting place each ray meets.

    origins : (3,) for one eye, or (n, 3), mm.   directions : (n, 3), any length.   out : a Trace of n rays to reuse.
    On surfaces points and normals are float64 and exact but for rounding; on meshes they are those of the facets. A place
    nearer than 1e-6 mm to the ray's origin is not met, so that rays may start on the surface.
    With glass before it, see `raytrace.surfaces.plate.trace_through`.
    Raises: TraceError for arrays of other shapes or that are no real numbers.
    """
    eye, rays = _checked(origins, directions)
    n = len(rays)
    if out is None:
        out = Trace.empty(n)
    else:
        if not isinstance(out, Trace):
            raise TraceError(f"out must be a Trace, as Trace.empty({n}) makes it, not {type(out).__name__}")
        out.check_room(n)
        results = (out.status, out.points, out.normals, out.directions, out.distances)
        # The rays may be the results of the trace before: they are still read when results are written.
        eye, rays = (given.copy() if any(np.may_share_memory(given, result) for result in results) else given
                     for given in (eye, rays))
        if out.normals_from != "surface":
            out = replace(out, normals_from="surface")
    if reflector.glass is not None:
        from raytrace.surfaces.plate import trace_through

        out = trace_through(reflector.glass.front, reflector.surfaces[0], reflector.glass.index, eye, rays, out)
    elif reflector.mesh is not None:
        out = replace(out, normals_from=reflector.normals)
        for part in _parts(np.arange(n)):
            out.take(part, _on_mesh(reflector, _some(eye, part), rays[part]))
    else:
        _on_surfaces(reflector, eye, rays, out)
    _mark_blocked(reflector, eye, rays, out)
    return out


def _checked(origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
    """Contiguous float64 origins (1 or n, 3) and directions (n, 3)."""
    try:
        eye, rays = np.asarray(origins), np.asarray(directions)
    except ValueError:
        raise TraceError("origins and directions must be arrays (n, 3): their rows have different lengths") from None
    for name, array in (("origins", eye), ("directions", rays)):
        if array.dtype.kind not in "fiu":
            raise TraceError(f"{name} must be real numbers, not {array.dtype}")
    if rays.ndim != 2 or rays.shape[1] != 3:
        raise TraceError(f"directions must be of shape (n, 3), not {rays.shape}")
    if eye.shape not in ((3,), rays.shape):
        raise TraceError(f"origins must be of shape (3,) or {rays.shape} like the directions, not {eye.shape}")
    return (np.ascontiguousarray(eye, dtype=np.float64).reshape(-1, 3), np.ascontiguousarray(rays, dtype=np.float64))


def _parts(index: Index) -> Iterator[Index]:
    for start in range(0, len(index), SEARCHED):
        yield index[start:start + SEARCHED]


def _some(eye: Array, index: Index) -> Array:
    return eye if len(eye) == 1 else eye[index]


def _units(eye: Array, rays: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Origins (n, 3), unit directions, and which rays are usable; the others get an origin and a direction that are."""
    units, valid = np.empty_like(rays), np.empty(len(rays), dtype=np.bool_)
    parallel_for(lambda i, j: newton.unit_directions(rays[i:j], units[i:j], valid[i:j]), len(rays))
    finite: Mask = np.asarray(np.isfinite(eye).all(axis=1))
    valid &= finite
    return np.broadcast_to(np.where(finite[:, None], eye, 0.0), rays.shape), units, valid


# --- surfaces ---------------------------------------------------------------------------------------------------------


def _on_surfaces(reflector: Reflector, eye: Array, rays: Array, out: Trace) -> None:
    """Quadrics in closed form; a single B-spline without a search where it can be met only once; what that leaves, and all
    else, with one."""
    only = reflector.only
    if not reflector.splines:
        _meet_quadrics(reflector, eye, rays, out)
        waiting = np.empty(0, dtype=np.intp)
    elif only is None:
        waiting = np.arange(len(rays))
    else:
        field = only.height_field
        if field is not None:
            _run(lambda *arrays: newton.height_field_hits(  # type: ignore[no-untyped-call]
                field.powers, *field.arguments, field.top, field.steepest, *only.trimming.arguments, only.trimming.sure,
                *arrays), eye, rays, out)
        elif only.patches.sheet is not None:
            _parametric(only, only.patches.sheet, np.empty(0), eye, rays, out)
        else:
            out.status[:] = Status.LOST
        waiting = np.flatnonzero(out.status == Status.LOST)
    for part in _parts(waiting):
        out.take(part, _search(reflector, _some(eye, part), rays[part]))


def _search(reflector: Reflector, eye: Array, rays: Array) -> Trace:
    """The first place that each ray meets, wherever it comes from."""
    found = Trace.empty(len(rays))
    only = reflector.only
    if only is not None and only.height_field is not None:
        field = only.height_field
        _run(lambda *arrays: newton.height_field_first_hits(  # type: ignore[no-untyped-call]
            field.powers, *field.arguments, field.bottom, field.top, field.bend, only.one_sided, *only.trimming.arguments,
            *arrays), eye, rays, found)
        return found
    _, units, valid = _units(eye, rays)
    if reflector.quadrics:
        _meet_quadrics(reflector, eye, rays, found)
    else:
        found.status[:] = np.where(valid, Status.MISSED, Status.INVALID)
        found.drop(np.arange(len(rays)))
    first_hit.first_hits(reflector.pieces, eye.ravel(), units.ravel(), valid, found.status, found.points.ravel(),
                         found.normals.ravel(), found.directions.ravel(), found.distances)
    return found


def _meet_quadrics(reflector: Reflector, eye: Array, rays: Array, found: Trace) -> None:
    """What rays meet first of the quadrics; results are new."""
    surfaces, tree = reflector.quadrics, reflector.quadric_tree
    origins = eye.ravel()
    finite: Mask = np.asarray(np.isfinite(eye).all(axis=1))
    points, normals, reflected = found.points.ravel(), found.normals.ravel(), found.directions.ravel()

    def work(i: int, j: int) -> None:
        units, valid, three = np.empty((j - i, 3)), np.empty(j - i, dtype=np.bool_), slice(3 * i, 3 * j)
        newton.unit_directions(rays[i:j], units, valid)
        valid &= finite if len(finite) == 1 else finite[i:j]
        given = (origins if origins.size == 3 else origins[three], units.ravel(), valid, found.status[i:j], points[three],
                 normals[three], reflected[three], found.distances[i:j])
        if tree is not None:
            tree.meet(*given)
            return
        for number, surface in enumerate(surfaces):
            surface.meet(number == 0, *given)

    parallel_for(work, len(rays))


def _parametric(surface: TrimmedSurface, sheet: Array, starts: Array, eye: Array, rays: Array, out: Trace) -> None:
    patches = surface.patches
    flat = starts.ravel()
    _run(lambda i, j, *arrays: newton.parametric_hits(  # type: ignore[no-untyped-call]
        patches.powers, patches.parts, *patches.arguments, *surface.trimming.arguments, surface.trimming.sure, surface.sign,
        surface.one_sided, patches.closed, sheet, flat[2 * i:2 * j], *arrays), eye, rays, out, ends=True)


def _run(kernel: object, eye: Array, rays: Array, out: Trace, ends: bool = False) -> None:
    """A kernel on all cores; it gets flat arrays of the rays and results of a run, after the run's ends where it asks."""
    origins, directions = eye.ravel(), rays.ravel()
    points, normals, reflected = out.points.ravel(), out.normals.ravel(), out.directions.ravel()

    def work(i: int, j: int) -> None:
        three = slice(3 * i, 3 * j)
        kernel(*((i, j) if ends else ()), origins if origins.size == 3 else origins[three], directions[three],  # type: ignore[operator]
               out.status[i:j], points[three], normals[three], reflected[three], out.distances[i:j])

    parallel_for(work, len(rays))


# --- meshes and obstacles ---------------------------------------------------------------------------------------------


def _on_mesh(reflector: Reflector, eye: Array, rays: Array) -> Trace:
    """The facets' own normals or those between their corners; the point is Embree's facet, met in float64."""
    assert reflector.mesh is not None  # called only with one
    origins, units, valid = _units(eye, rays)
    found = Trace.empty(len(rays))
    hits = reflector.mesh_scene.first_hits(origins, units)
    if reflector.normals == "facets":
        normals = reflector.facet_normals[np.maximum(hits.triangle, 0)]
    else:
        from raytrace.kernels.mesh_normals import interpolated_normals

        normals = interpolated_normals(reflector.corner_normals, hits.triangle, hits.u, hits.v)
    along = np.einsum("ij,ij->i", units, normals)
    normals = np.where(along[:, None] > 0.0, -normals, normals)
    found.status[:] = np.where((hits.triangle >= 0) & np.any(normals != 0.0, axis=1), Status.REFLECTED, Status.MISSED)
    found.status[~valid] = Status.INVALID
    found.distances[:] = hits.distance
    with np.errstate(invalid="ignore"):
        found.points[:] = origins + hits.distance[:, None] * units
    found.normals[:] = normals
    found.directions[:] = units + 2.0 * np.abs(along)[:, None] * normals
    found.drop(np.flatnonzero(found.status != Status.REFLECTED))
    return found


def _mark_blocked(reflector: Reflector, eye: Array, rays: Array, out: Trace) -> None:
    """Give the status `blocked` to rays that meet an obstacle before what they reflect from, or instead of it."""
    if reflector.obstacle_scene is None:
        return
    # What stands behind a height field cannot be in front of a place that was reached from above.
    skipped = [Status.LOST, Status.INVALID] + ([Status.REFLECTED] if reflector.obstacles_behind else [])
    for asked in _parts(np.flatnonzero(~np.isin(out.status, skipped))):
        origins, units, _ = _units(_some(eye, asked), rays[asked])
        ahead = reflector.obstacle_scene.first_hits(origins, units).distance
        reached = np.where(out.status[asked] == Status.MISSED, np.inf, out.distances[asked])
        blocked = asked[ahead < reached - OBSTACLE_MARGIN_MM]
        out.status[blocked] = Status.BLOCKED
        out.drop(blocked)
