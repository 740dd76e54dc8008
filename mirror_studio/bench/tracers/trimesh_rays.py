"""trimesh's own ray query, which calls Embree: first triangle of each ray and its normal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_studio.bench.tracers.case import Case, Rays
from mirror_studio.bench.tracers.tracer import Tracer, Work, installed, reflected

TRIMESH = "trimesh.ray, facets"


def tracers(case: Case, triangles: int) -> Iterator[Tracer]:
    """The mesh as trimesh holds it."""
    trimesh = installed("trimesh")
    mesh = case.mesh(triangles)
    yield Tracer(TRIMESH, lambda rays: _facets(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False), rays))


def _facets(mesh: Any, rays: Rays) -> Work:
    origins = np.broadcast_to(rays.origins, rays.directions.shape).copy()

    def work() -> NDArray[Any]:
        triangle, ray = mesh.ray.intersects_id(origins, rays.directions, multiple_hits=False)
        out = np.full(rays.directions.shape, np.nan)
        out[ray] = reflected(rays.directions[ray], mesh.face_normals[triangle])
        return out

    return work
