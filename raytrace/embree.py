"""Triangles and rays in, first hits out: the only module that imports embreex, and the only one in float32."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

Array = NDArray[np.float64]

CHUNK = 50_000  # rays a call: embreex releases the interpreter lock, so chunks run on all cores


class Hits(NamedTuple):
    """First hits of n rays: distance along the (unit) direction, inf for none; triangle, −1 for none; and the
    barycentric u, v of P = (1 − u − v)·v0 + u·v1 + v·v2."""

    distance: Array
    triangle: NDArray[np.int32]
    u: Array
    v: Array


class TriangleScene:
    """One mesh, committed once. Rays are cast in coordinates about the mesh's centre and start just before it, so that
    float32 costs about 1e-7 of the mesh's size wherever the mesh or the eye is."""

    def __init__(self, vertices: Array, faces: NDArray[np.int32]) -> None:
        vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        faces = np.ascontiguousarray(faces, dtype=np.int32)
        # embreex checks none of this, and reads or writes out of bounds where it fails.
        if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) == 0 or not np.isfinite(vertices).all():
            raise ValueError(f"vertices must be finite and of shape (n, 3), not {vertices.shape}")
        if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
            raise ValueError(f"faces must be of shape (m, 3), not {faces.shape}")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise ValueError(f"faces name vertices up to {faces.max()}, there are {len(vertices)}")
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        self._centre = 0.5 * (low + high)
        self._radius = float(np.linalg.norm(high - low)) * 0.5 + 1e-6
        self._scene = EmbreeScene(robust=True)
        self._mesh = TriangleMesh(self._scene, (vertices - self._centre).astype(np.float32), faces)
        # The first run commits the scene: do it here, before threads share it.
        self._run(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]))

    def first_hits(self, origins: Array, directions: Array) -> Hits:
        """First hits of rays with unit directions (n, 3) from origins (n, 3) or (3,); both finite float64."""
        n = len(directions)
        origins = np.broadcast_to(origins, directions.shape)
        out = Hits(np.empty(n), np.empty(n, dtype=np.int32), np.empty(n), np.empty(n))

        def work(start: int) -> None:
            part = slice(start, min(start + CHUNK, n))
            distance, triangle, u, v = self._run(origins[part], directions[part])
            out.distance[part], out.triangle[part], out.u[part], out.v[part] = distance, triangle, u, v

        starts = range(0, n, CHUNK)
        if len(starts) <= 1:
            for start in starts:
                work(start)
        else:
            with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
                list(pool.map(work, starts))
        return out

    def _run(self, origins: Array, directions: Array) -> tuple[Array, NDArray[np.int32], Array, Array]:
        local = origins - self._centre
        # To the sphere around the mesh, in float64: the float32 distance is then never longer than the mesh.
        ahead = np.maximum(-np.einsum("ij,ij->i", local, directions) - self._radius, 0.0)
        local = local + ahead[:, None] * directions
        answer = self._scene.run(np.ascontiguousarray(local, dtype=np.float32),
                                 np.ascontiguousarray(directions, dtype=np.float32), output=True)
        triangle = answer["primID"].astype(np.int32)
        hit = triangle >= 0
        distance = np.where(hit, answer["tfar"].astype(np.float64) + ahead, np.inf)
        return distance, triangle, answer["u"].astype(np.float64), answer["v"].astype(np.float64)
