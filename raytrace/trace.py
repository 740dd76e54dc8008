"""Trace rays to their first reflection."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import TraceError
from raytrace.rays import Rays, Status, Trace
from raytrace.reflector import Reflector

Array = NDArray[np.float64]

# An obstacle counts as in front of the mirror only by more than its own mesh error.
OBSTACLE_MARGIN_MM = 0.2


def reflect(reflector: Reflector, origins: ArrayLike, directions: ArrayLike, out: Trace | None = None) -> Trace:
    """Trace rays to their first reflection: d' = d − 2(d·n)n at the first reflecting point each ray meets.

    On surfaces points and normals are float64 and exact but for rounding; on meshes they are those of the facets. A point
    nearer than 1e-6 mm to the ray's origin is not met, so that rays may start on the surface. With glass before the
    reflecting surface, see `raytrace.surfaces.plate.Plate`.

    Parameters
    ----------
    reflector : what the rays may meet.
    origins : (3,) for one eye, or (n, 3), mm.
    directions : (n, 3), any length.
    out : a Trace of n rays to reuse.

    Returns
    -------
    Trace
        Of the n rays in their order; a ray that is not reflected has a status that says why.

    Raises
    ------
    TraceError
        For arrays of other shapes or that are no real numbers.
    """
    rays = Rays.of(origins, directions)
    n = len(rays)
    if out is None:
        out = Trace.empty(n)
    else:
        if not isinstance(out, Trace):
            raise TraceError(f"out must be a Trace, as Trace.empty({n}) makes it, not {type(out).__name__}")
        rays = rays.into(out)
    if out.normals_from != reflector.surface.normals_from:
        out = replace(out, normals_from=reflector.surface.normals_from)
    reflector.surface.first_hits(rays, out)
    _mark_blocked(reflector, rays, out)
    return out


def _mark_blocked(reflector: Reflector, rays: Rays, out: Trace) -> None:
    """Give the status `blocked` to rays that meet an obstacle before what they reflect from, or instead of it."""
    if reflector.obstacle_scene is None:
        return
    # What stands behind a height field cannot be in front of a place that was reached from above.
    skipped = [Status.LOST, Status.INVALID] + ([Status.REFLECTED] if reflector.obstacles_behind else [])
    for asked, some in rays.in_parts(np.flatnonzero(~np.isin(out.status, skipped))):
        origins, units, _ = some.units()
        ahead = reflector.obstacle_scene.first_hits(origins, units).distance
        reached = np.where(out.status[asked] == Status.MISSED, np.inf, out.distances[asked])
        blocked = asked[ahead < reached - OBSTACLE_MARGIN_MM]
        out.status[blocked] = Status.BLOCKED
        out.invalidate(blocked)
