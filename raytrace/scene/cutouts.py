"""Triangles that cover only part of what is behind them: what rays meet behind cut-out places, and how much a place covers.

A leaf card is a rectangle whose picture says where there is a leaf; a window lets part of the light through.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from raytrace.embree import Hits, TriangleScene
from raytrace.scene.materials import Material
from raytrace.scene.shading import Mesh

Array = NDArray[np.float64]

# Cut-out layers one behind the other that a ray passes, and blended ones that are seen through; a tree's crown has some ten.
MAX_PASSED, MAX_BLENDED = 64, 8
# The sun's disc is hidden by what covers at least this much: shadows are all or nothing.
SHADOW_FROM = 0.5
# A ray that has covered less than this of what is behind sees the rest: 1/255 would not show.
MIN_SEEN = 1.0 / 512.0


@dataclass(frozen=True, eq=False)
class Cutouts:
    """The triangles of materials that do not cover all.

    whole (k,) : which materials do.   cutoff (k,) : the least cover that stops a ray; 0 for those that are blended.
    colours (n, 4) : of the mesh's vertices, if any.   lift : mm behind a triangle at which the ray goes on.
    """

    materials: Sequence[Material]
    mesh: Mesh
    colours: Array | None
    lift: float
    whole: NDArray[np.bool_]
    cutoff: Array
    blended: NDArray[np.bool_]

    @staticmethod
    def of(materials: Sequence[Material], mesh: Mesh, colours: Array | None, lift: float) -> Cutouts | None:
        """None where all materials cover all."""
        whole = np.array([material.whole for material in materials], dtype=np.bool_)
        if whole.all():
            return None
        cutoff = np.array([material.cutoff or 0.0 for material in materials])
        return Cutouts(materials, mesh, colours, lift, whole, cutoff,
                       np.array([not material.whole and material.cutoff is None for material in materials]))

    @cached_property
    def _opacity(self) -> Array:
        return np.array([material.opacity for material in self.materials])

    def cover(self, triangle: NDArray[np.int32], u: Array, v: Array) -> Array:
        """The share (n,) of what is behind that places on triangles cover."""
        material = self.mesh.material[triangle]
        share = self._opacity[material]
        corners = self.mesh.faces[triangle]
        weights = np.stack([1.0 - u - v, u, v], axis=1)
        if self.colours is not None:
            share = share * np.clip(np.einsum("nk,nk->n", weights, self.colours[corners, 3]), 0.0, 1.0)
        for m in np.unique(material):
            picture = self.materials[m].cover
            if picture is not None:
                rows = np.flatnonzero(material == m)
                share[rows] *= _bilinear(picture, np.einsum("nk,nkc->nc", weights[rows], self.mesh.uv[corners[rows]]))
        return share

    def first_hits(self, scene: TriangleScene, origins: Array, directions: Array, beyond: Array | None = None) -> Hits:
        """As `TriangleScene.first_hits`, of the places that are not cut out; beyond (n,) : from so far along the rays."""
        starts = np.broadcast_to(origins, directions.shape)
        hits = (scene.first_hits(origins, directions) if beyond is None
                else _behind(scene, starts, directions, beyond))
        self._pass(scene, starts, directions, hits, self.cutoff)
        return hits

    def occluded(self, scene: TriangleScene, origins: Array, directions: Array) -> NDArray[np.bool_]:
        """As `TriangleScene.occluded`, by what covers half or more, or is not cut out."""
        found = scene.occluded(origins, directions)
        rows = np.flatnonzero(found)
        if len(rows):
            hits = scene.first_hits(origins[rows], directions[rows])
            # Blended triangles that cover less than half cast no shadow.
            self._pass(scene, origins[rows], directions[rows], hits, np.where(self.blended, SHADOW_FROM, self.cutoff))
            found[rows] = hits.triangle >= 0
        return found

    def _pass(self, scene: TriangleScene, starts: Array, directions: Array, hits: Hits, cutoff: Array) -> None:
        """Take the rays of hits that are cut out on to what is behind, in place."""
        rows = np.flatnonzero(hits.triangle >= 0)
        for layer in range(MAX_PASSED):
            rows = rows[~self.whole[self.mesh.material[hits.triangle[rows]]]]
            if len(rows) == 0:
                return
            triangle = hits.triangle[rows]
            rows = rows[self.cover(triangle, hits.u[rows], hits.v[rows]) < cutoff[self.mesh.material[triangle]]]
            # Further with each layer: along a triangle that is nearly edge on, a step off it is long.
            after = _behind(scene, starts[rows], directions[rows], hits.distance[rows] + self.lift * 2.0**min(layer // 4, 12))
            hits.distance[rows], hits.triangle[rows], hits.u[rows], hits.v[rows] = after
            rows = rows[after.triangle >= 0]


def _behind(scene: TriangleScene, origins: Array, directions: Array, beyond: Array) -> Hits:
    """First hits from so far along the rays on, with distances from their origins."""
    hits = scene.first_hits(origins + beyond[:, None] * directions, directions)
    return hits._replace(distance=hits.distance + beyond)


def _bilinear(picture: NDArray[np.uint8], uv: Array) -> Array:
    """Values 0 … 1 of a picture that repeats, linear between its elements; 1 where uv is NaN."""
    rows, columns = picture.shape
    known = np.asarray(np.isfinite(uv).all(axis=1))
    at = np.where(known[:, None], uv, 0.0)
    row, column = (at[:, 1] - np.floor(at[:, 1])) * rows - 0.5, (at[:, 0] - np.floor(at[:, 0])) * columns - 0.5
    i, j = np.floor(row), np.floor(column)
    a, b = row - i, column - j
    i0, j0 = i.astype(int) % rows, j.astype(int) % columns
    i1, j1 = (i0 + 1) % rows, (j0 + 1) % columns
    above = (1.0 - b) * picture[i0, j0] + b * picture[i0, j1]
    below = (1.0 - b) * picture[i1, j0] + b * picture[i1, j1]
    return np.where(known, ((1.0 - a) * above + a * below) / 255.0, 1.0)
