"""Reflector and rays in, where each ray meets it and where it goes from there out."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace import newton
from raytrace.errors import TraceError
from raytrace.reflector import Reflector, TrimmedSurface

Array = NDArray[np.float64]

# An obstacle counts as in front of the mirror only by more than its own mesh error.
OBSTACLE_MARGIN_MM = 0.2
MOST_CROSSINGS = 16  # surfaces or trimmed-away parts a ray may pass on its way to a reflecting place


class Status(IntEnum):
    """What became of a ray."""

    REFLECTED = 0
    MISSED = 1  # meets nothing, or only parts that are trimmed away
    BLOCKED = 2  # meets an obstacle first
    BEHIND = 3  # meets the back of a one-sided face
    LOST = 4  # meets a surface but Newton did not converge on it
    INVALID = 5  # its origin or direction is not finite, or its direction is zero


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """Result for n rays, in their order; rows of rays that were not reflected are NaN.

    status (n,) int8, see Status.   points (n, 3) mm.   normals (n, 3), unit, towards the ray's side.
    directions (n, 3), unit, after reflection.   distances (n,) mm, along the ray to the point.
    """

    status: NDArray[np.int8]
    points: Array
    normals: Array
    directions: Array
    distances: Array

    @staticmethod
    def empty(n: int) -> Trace:
        return Trace(np.empty(n, dtype=np.int8), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty(n))

    def counts(self) -> dict[str, int]:
        """How many rays have each status, by name; statuses that none has are left out."""
        return {status.name.lower(): int(count) for status in Status if (count := np.count_nonzero(self.status == status))}


def reflect(reflector: Reflector, origins: ArrayLike, directions: ArrayLike, out: Trace | None = None) -> Trace:
    """Trace rays to their first reflection: d' = d − 2(d·n)n at the first reflecting place each ray meets.

    origins : (3,) for one eye, or (n, 3), mm.   directions : (n, 3), any length.   out : a Trace of n rays to reuse.
    On B-splines points and normals are float64, from Newton on the surface itself; on meshes they are Embree's.
    Raises: TraceError for arrays of other shapes.
    """
    eye, rays, valid = _checked(origins, directions)
    n = len(rays)
    if out is None:
        out = Trace.empty(n)
    elif out.status.shape != (n,):
        raise TraceError(f"out holds {len(out.status)} rays, {n} are to be traced")
    if n == 0:
        return out
    if reflector.mesh is not None:
        _trace_mesh(reflector, eye, rays, out)
    else:
        _trace_surfaces(reflector, eye, rays, out)
    _mark_blocked(reflector, eye, rays, out)
    out.status[~valid] = Status.INVALID
    newton.finish(rays, out.status, out.points, out.normals, out.directions, out.distances)
    return out


def _checked(origins: ArrayLike, directions: ArrayLike) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Contiguous float64 origins (1 or n, 3), unit directions (n, 3), and which rays are usable."""
    eye = np.ascontiguousarray(origins, dtype=np.float64)
    rays = np.ascontiguousarray(directions, dtype=np.float64)
    if rays.ndim != 2 or rays.shape[1] != 3:
        raise TraceError(f"directions must be of shape (n, 3), not {rays.shape}")
    if eye.shape not in ((3,), rays.shape):
        raise TraceError(f"origins must be of shape (3,) or {rays.shape} like the directions, not {eye.shape}")
    eye = eye.reshape(-1, 3)
    units, valid = np.empty(rays.shape), np.empty(len(rays), dtype=np.bool_)
    newton.unit_directions(rays, units, valid)
    finite = np.asarray(np.isfinite(eye).all(axis=1))
    if not finite.all():
        valid &= finite
        eye = np.where(finite[:, None], eye, 0.0)
    return eye, units, valid


def _mark_blocked(reflector: Reflector, eye: Array, rays: Array, out: Trace) -> None:
    """Give the status `blocked` to rays that meet an obstacle before what they reflect from, or instead of it."""
    if reflector.obstacle_scene is None:
        return
    # What stands behind a height field cannot be in front of a place that was reached from above.
    skipped = [Status.LOST, Status.REFLECTED] if reflector.obstacles_behind else [Status.LOST]
    asked = np.flatnonzero(~np.isin(out.status, skipped))
    if asked.size == 0:
        return
    ahead = reflector.obstacle_scene.first_hits(eye if len(eye) == 1 else eye[asked], rays[asked]).distance
    reached = np.where(out.status[asked] == Status.MISSED, np.inf, out.distances[asked])
    out.status[asked[ahead < reached - OBSTACLE_MARGIN_MM]] = Status.BLOCKED


def _trace_surfaces(reflector: Reflector, eye: Array, rays: Array, out: Trace) -> None:
    """Height fields straight from the plane above; what they leave, and all else, from an Embree hit."""
    waiting = np.arange(len(rays))
    out.status[:] = Status.MISSED
    only = reflector.surfaces[0] if len(reflector.surfaces) == 1 else None
    field = only.height_field if only is not None else None
    if only is not None and field is not None:
        state = np.empty(len(rays), dtype=np.int64)
        newton.height_field_hits(  # type: ignore[no-untyped-call]
            field.powers, field.coefficients, field.ends_x, field.ends_y, field.lookup_x, field.lookup_y, field.top,
            *only.strips, eye, rays, state, out.points, out.normals, out.distances)
        out.status[state == newton.HIT] = Status.REFLECTED
        waiting = np.flatnonzero(state == newton.LOST)
    # Rays start again just behind every place that turned out to be trimmed away.
    passed = np.zeros(len(rays))
    for _ in range(MOST_CROSSINGS):
        if waiting.size == 0:
            return
        waiting = _cross_once(reflector, eye, rays, passed, waiting, out)
    out.status[waiting] = Status.LOST


def _cross_once(reflector: Reflector, eye: Array, rays: Array, passed: Array, waiting: NDArray[np.intp], out: Trace,
                ) -> NDArray[np.intp]:
    """Take the waiting rays to the next surface each meets; returns those that met a trimmed-away part of it."""
    directions = rays[waiting]
    starts = (eye if len(eye) == 1 else eye[waiting]) + passed[waiting, None] * directions
    hits = reflector.mesh_scene.first_hits(starts, directions)
    owner = np.searchsorted(_triangle_ends(reflector), hits.triangle, side="right")
    again = []
    for k, surface in enumerate(reflector.surfaces):
        mine = np.flatnonzero((hits.triangle >= 0) & (owner == k))
        if mine.size == 0:
            continue
        mesh, uv = surface.start_mesh
        corners = uv[mesh.faces[hits.triangle[mine] - (_triangle_ends(reflector)[k] - len(mesh.faces))]]
        u, v = hits.u[mine, None], hits.v[mine, None]
        start_uv = (1.0 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2]
        index = waiting[mine]
        state = _refine(surface, eye if len(eye) == 1 else eye[index], rays[index], start_uv, index, out)
        out.status[index[state == newton.LOST]] = Status.LOST
        outside = index[state == newton.OUTSIDE]
        passed[outside] += hits.distance[mine[state == newton.OUTSIDE]] + 1e-3 * _size(surface.surface.poles)
        again.append(outside)
    return np.concatenate(again) if again else np.empty(0, dtype=np.intp)


def _refine(surface: TrimmedSurface, eye: Array, rays: Array, start_uv: Array, index: NDArray[np.intp],
            out: Trace) -> NDArray[np.int64]:
    """Newton from the starts; hits are written to out at index, with their status."""
    record = surface.surface
    weights = np.ones(record.poles.shape[:2]) if record.weights is None else record.weights
    homogeneous = np.concatenate([record.poles * weights[..., None], weights[..., None]], axis=2)
    n = len(rays)
    state, points, normals, distances = np.empty(n, dtype=np.int64), np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    newton.parametric_hits(record.knots_u, record.knots_v, record.degree_u, record.degree_v, homogeneous,
                           _size(record.poles), *surface.strips, eye, rays, start_uv, state, points, normals, distances)
    hit = state == newton.HIT
    facing = np.einsum("ij,ij->i", rays, normals) * surface.sign
    # The stored normal looks back along the ray.
    normals *= np.where(np.einsum("ij,ij->i", rays, normals) > 0.0, -1.0, 1.0)[:, None]
    status = np.where(hit, Status.REFLECTED, Status.MISSED)
    if surface.one_sided:
        status[hit & (facing >= 0.0)] = Status.BEHIND
    out.status[index] = status
    out.points[index], out.normals[index], out.distances[index] = points, normals, distances
    return state


def _trace_mesh(reflector: Reflector, eye: Array, rays: Array, out: Trace) -> None:
    """Facets: the normal is the triangle's, the point Embree's distance along the ray."""
    assert reflector.mesh is not None  # _trace_mesh is only called with one
    hits = reflector.mesh_scene.first_hits(eye, rays)
    hit = hits.triangle >= 0
    normals = reflector.mesh.facet_normals()[np.maximum(hits.triangle, 0)]
    normals *= np.where(np.einsum("ij,ij->i", rays, normals) > 0.0, -1.0, 1.0)[:, None]
    out.status[:] = np.where(hit & np.any(normals != 0.0, axis=1), Status.REFLECTED, Status.MISSED)
    with np.errstate(invalid="ignore"):
        out.points[:] = eye + hits.distance[:, None] * rays
    out.normals[:] = normals
    out.distances[:] = hits.distance


def _triangle_ends(reflector: Reflector) -> NDArray[np.int64]:
    return np.cumsum([len(surface.start_mesh[0].faces) for surface in reflector.surfaces])


def _size(poles: Array) -> float:
    return float(np.linalg.norm(poles.reshape(-1, 3).max(axis=0) - poles.reshape(-1, 3).min(axis=0)))
