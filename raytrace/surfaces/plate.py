"""A plate that reflects from its back and rays in, how light leaves the plate after two refractions and a reflection out."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import TraceError
from raytrace.reflector import Reflector, TrimmedSurface
from raytrace.surfaces.quadric import TrimmedQuadric
from raytrace.trace import Status, Trace, reflect

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Face = TrimmedSurface | TrimmedQuadric

# Rays inside the glass are started this far before the face they leave, as a share of the faces' size: what they meet is
# found on a coarse mesh first, whose chords may lie behind the start where the glass is thin.
RUN_UP = 0.01


def refract(directions: Array, normals: Array, eta: float) -> tuple[Array, Flags]:
    """Snell's law for rays that meet a face between two media of indices n1 and n2, eta = n1/n2.

    t = η·d + (η·c − √(1 − η² + η²c²))·n with c = −d·n, n turned against the ray; 1 − η² is taken as (1 − η)(1 + η), so that
    η = 1 gives d back at grazing incidence too.
    directions, normals : (n, 3), unit; normals of either sense.
    Returns: unit directions (n, 3), and which rays are totally reflected (n,); the directions of those are NaN.
    Source: Born and Wolf, Principles of Optics, section 1.5.1, in vector form.
    """
    along = np.einsum("ij,ij->i", directions, normals)
    c = eta * np.abs(along)
    squared = (1.0 - eta) * (1.0 + eta) + c * c
    total = squared < 0.0
    root = np.sqrt(np.where(total, np.nan, squared))
    turned = np.where(along > 0.0, root - c, c - root)
    return eta * directions + turned[:, None] * normals, total


def trace_through(front: Face, back: Face, index: float, origins: ArrayLike, directions: ArrayLike, out: Trace | None = None,
                  ) -> Trace:
    """Trace rays into a plate by its front, to its reflecting back, and out by the front, on the surfaces themselves.

    front : its outward side is that of the air.   back : its outward side is that of the glass.   index : of the glass
    against air.   origins, directions, out : as for `reflect`; one eye may be (1, 3).
    Returns a Trace of the ray that leaves: `points` where it leaves the front and `directions` after that; `normals` are
    those of the back where it reflects, towards the glass; `distances` run along the incoming ray to the front.
    Status: MISSED and BEHIND as on the front; BLOCKED where a ray that got in meets no reflecting part of the back, leaves
    elsewhere than by the front (the sides are black), or is totally reflected there. A ray that leaves by one side and
    comes in again by another counts as one that stayed inside.
    Raises: TraceError for an index below 1, and for arrays of other shapes.
    """
    if not 1.0 <= index < np.inf:
        raise TraceError(f"an index of {index:g} is no glass in air: it must be 1 or more")
    way_in, mirror, way_out = _faces(front, back)
    eye = np.asarray(origins)
    entry = reflect(way_in, eye[0] if eye.shape == (1, 3) else eye, directions, out)
    rays = np.asarray(directions, dtype=np.float64)
    inside = np.flatnonzero(entry.status == Status.REFLECTED)
    rays = rays[inside] / np.linalg.norm(rays[inside], axis=1, keepdims=True)
    down, _ = refract(rays, entry.normals[inside], 1.0 / index)
    turning = _from_before(mirror, entry.points[inside], down)
    inside = _still(entry, inside, turning.status)
    met = turning.status == Status.REFLECTED
    leaving = _from_before(way_out, turning.points[met], turning.directions[met])
    after, total = refract(turning.directions[met], leaving.normals, index)
    status = np.where(total, np.int8(Status.BLOCKED), leaving.status)
    entry.points[inside], entry.normals[inside], entry.directions[inside] = leaving.points, turning.normals[met], after
    _still(entry, inside, status)
    return entry


def _still(trace: Trace, index: NDArray[np.intp], status: NDArray[np.int8]) -> NDArray[np.intp]:
    """Those of the rays that go on; the others are blocked, but for those that Newton lost."""
    off = status != Status.REFLECTED
    ended = index[off]
    trace.status[ended] = np.where(status[off] == Status.LOST, Status.LOST, Status.BLOCKED)
    trace.drop(ended)
    return index[~off]


def _from_before(reflector: Reflector, points: Array, directions: Array) -> Trace:
    outline = reflector.outline()
    run_up = RUN_UP * float(np.linalg.norm(outline.max(axis=0) - outline.min(axis=0)))
    return reflect(reflector, points - run_up * directions, directions)


@lru_cache(maxsize=8)
def _faces(front: Face, back: Face) -> tuple[Reflector, Reflector, Reflector]:
    """Front from the air, back, and front from either side, each with the pieces that it is searched in, made once."""
    return tuple(Reflector((face,)) for face in (front, back, replace(front, one_sided=False)))  # type: ignore[return-value]
