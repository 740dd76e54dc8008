"""Embree through embreex as a script would call it: float32, facet or interpolated normals, chunks over two threads."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from mirror_studio.bench.tracers.case import Case, Mesh, Rays
from mirror_studio.bench.tracers.tracer import CORES, Tracer, Work, reflected

FACETS, INTERPOLATED = "Embree, facets", "Embree, interpolated normals"
CHUNK = 50_000


def tracers(case: Case, triangles: int) -> Iterator[Tracer]:
    """Facet normals, and the exact normals of the vertices interpolated over each triangle."""
    mesh = case.mesh(triangles)
    yield Tracer(FACETS, lambda rays: embree(mesh, rays, interpolated=False))
    yield Tracer(INTERPOLATED, lambda rays: embree(mesh, rays, interpolated=True))


def embree(mesh: Mesh, rays: Rays, interpolated: bool) -> Work:
    """One scene, committed; rays as float32 arrays, whole output, reflection by numpy."""
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, mesh.vertices.astype(np.float32), mesh.faces)  # the scene holds it from here on
    directions = rays.directions.astype(np.float32)
    origins = np.broadcast_to(rays.origins, directions.shape).astype(np.float32)
    corners = mesh.vertices[mesh.faces]
    facets = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facets = (facets / np.linalg.norm(facets, axis=1, keepdims=True)).astype(np.float32)
    smooth = mesh.normals[mesh.faces].astype(np.float32)  # of the three corners of each triangle
    out = np.empty(directions.shape, dtype=np.float32)
    scene.run(origins[:1], directions[:1])  # commits it, before threads share it
    pool = ThreadPoolExecutor(CORES)

    def chunk(start: int) -> None:
        part = slice(start, start + CHUNK)
        answer = scene.run(origins[part], directions[part], output=True)
        triangle = answer["primID"]
        if interpolated:
            u, v = answer["u"][:, None], answer["v"][:, None]
            three = smooth[triangle]
            normals = (1.0 - u - v) * three[:, 0] + u * three[:, 1] + v * three[:, 2]
            normals /= np.sqrt(np.einsum("ij,ij->i", normals, normals))[:, None]
        else:
            normals = facets[triangle]
        out[part] = reflected(directions[part], normals)
        out[part][triangle < 0] = np.nan

    def work() -> NDArray[Any]:
        if len(directions) <= CHUNK:
            chunk(0)
            return out
        list(pool.map(chunk, range(0, len(directions), CHUNK)))
        return out

    return work
