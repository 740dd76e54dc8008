"""Our own tracer: Newton on the B-spline in float64."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mirror_cad.mirror import Mirror
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_studio.bench.tracers.case import Case, Rays
from mirror_studio.bench.tracers.tracer import Tracer, Work
from raytrace.rays import Trace
from raytrace.reflector import TRIM_CHORD_MM, Reflector
from raytrace.surfaces.bspline import BSplineFace
from raytrace.trace import reflect

HEIGHT_FIELD, FRESH, SHUFFLED, PARAMETRIC = ("ours", "ours, an origin a ray, fresh arrays", "ours, random order",
                                             "ours, parametric kernel")
# Parameters are mm times this: a surface with u = x and v = y would go through the height-field kernel.
PARAMETER_SCALE = 0.01


def tracers(case: Case) -> Iterator[Tracer]:
    """The height-field kernel in three uses, and the parametric one on the same surface."""
    yield Tracer(HEIGHT_FIELD, lambda rays: reused(case.reflector, rays))
    yield Tracer(FRESH, lambda rays: _fresh(case.reflector, rays))
    yield Tracer(SHUFFLED, lambda rays: reused(case.reflector, rays))
    general = parametric(case.mirror)
    yield Tracer(PARAMETRIC, lambda rays: reused(general, rays))


def reused(reflector: Reflector, rays: Rays) -> Work:
    """reflect() into arrays that are there already."""
    out = Trace.empty(len(rays.directions))

    def work() -> NDArray[np.float64]:
        return reflect(reflector, rays.origins, rays.directions, out=out).directions

    return work


def _fresh(reflector: Reflector, rays: Rays) -> Work:
    origins = np.broadcast_to(rays.origins, rays.directions.shape).copy()
    return lambda: reflect(reflector, origins, rays.directions).directions


def parametric(mirror: Mirror) -> Reflector:
    """The mirror's surface with other parameters, for the kernel that takes any."""
    face = mirror.surface
    surface = BSplineSurface(face.degree_u, face.degree_v, PARAMETER_SCALE * face.knots_u, PARAMETER_SCALE * face.knots_v,
                             face.poles.copy())
    return Reflector(BSplineFace(surface, (PARAMETER_SCALE * mirror.outline.polyline(TRIM_CHORD_MM),)))
