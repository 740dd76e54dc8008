"""A triangle mesh: rays are met on its facets, with the facets' normals or those between their corners."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mirror_cad.mesh import SurfaceMesh
from raytrace.embree import TriangleScene
from raytrace.kernels.mesh_normals import corner_normals, interpolated_normals
from raytrace.rays import Mask, NormalsFrom, Rays, Status, Trace
from raytrace.surfaces.area_samples import AreaSamples
from raytrace.surfaces.base import OpticalSurface, RigidMotion
from raytrace.surfaces.differentials import traced_differentials

Array = NDArray[np.float64]
Normals = Literal["facets", "interpolated"]

FACETS = 2.0  # sides of its facets that are told apart: within a facet the normals' slope is that of noise
TILT = 2e-3  # of the mirror's width: how far beside a ray those are that a facet's derivatives are made of
WIDEST_SPAN = 0.05  # of the mirror's width, where facets are large because the mirror is flat
# How far inside the box's edge a ray is taken, of the mirror's width: its points are float32's, and a solid's rim is beside.
EDGE_INSET = 1e-5


@dataclass(frozen=True, eq=False)
class MeshSurface(OpticalSurface):
    """Facets that reflect on both sides.

    Parameters
    ----------
    mesh : the facets.
    normals : "facets", their own normals, or "interpolated", those between their vertices.
    """

    mesh: SurfaceMesh
    normals: Normals = "facets"

    @cached_property
    def scene(self) -> TriangleScene:
        """The facets in Embree."""
        return TriangleScene(self.mesh.vertices, self.mesh.faces)

    @cached_property
    def facet_normals(self) -> Array:
        """Unit normals of the facets, (m, 3)."""
        return self.mesh.facet_normals()

    @cached_property
    def corner_normals(self) -> Array:
        """Normals at the facets' corners, (m, 3, 3)."""
        return corner_normals(self.mesh)

    def first_hits(self, rays: Rays, out: Trace) -> None:
        """The point is Embree's facet, met in float64. See `OpticalSurface`."""
        for part, some in rays.in_parts(np.arange(len(rays))):
            out.scatter(part, self._hits(some))

    def _hits(self, rays: Rays) -> Trace:
        origins, units, valid = rays.units()
        found = Trace.empty(len(rays))
        hits = self.scene.first_hits(origins, units)
        if self.normals == "facets":
            normals = self.facet_normals[np.maximum(hits.triangle, 0)]
        else:
            normals = interpolated_normals(self.corner_normals, hits.triangle, hits.u, hits.v)
        along = np.einsum("ij,ij->i", units, normals)
        normals = np.where(along[:, None] > 0.0, -normals, normals)
        found.status[:] = np.where((hits.triangle >= 0) & np.any(normals != 0.0, axis=1), Status.REFLECTED, Status.MISSED)
        found.status[~valid] = Status.INVALID
        found.distances[:] = hits.distance
        with np.errstate(invalid="ignore"):
            found.points[:] = origins + hits.distance[:, None] * units
        found.normals[:] = normals
        found.directions[:] = units + 2.0 * np.abs(along)[:, None] * normals
        found.invalidate(np.flatnonzero(found.status != Status.REFLECTED))
        return found

    @property
    def normals_from(self) -> NormalsFrom:
        """What normals are those of: the facets, or interpolated between their vertices."""
        return self.normals

    @property
    def facets(self) -> SurfaceMesh:
        """The mesh."""
        return self.mesh

    @property
    def triangle_count(self) -> int:
        """How many facets it is made of."""
        return len(self.mesh.faces)

    @cached_property
    def resolution_mm(self) -> float:
        """FACETS sides of the facets, of the mean area."""
        a, b, c = (self.mesh.vertices[self.mesh.faces[:, k]] for k in range(3))
        area = float(np.mean(np.linalg.norm(np.cross(b - a, c - a), axis=1)))  # of two facets: a square's side is its root
        x_min, x_max, _, _ = self.domain
        return min(FACETS * float(np.sqrt(area)), WIDEST_SPAN * (x_max - x_min))

    @property
    def edge_inset(self) -> float:
        """EDGE_INSET: its points are float32's."""
        return EDGE_INSET

    def outline(self) -> Array:
        """Its vertices (n, 3), mm."""
        return self.mesh.vertices

    def moved(self, motion: RigidMotion) -> MeshSurface:
        """By its vertices; a right-hand mirror's facets are wound the other way."""
        facets = self.mesh.faces if motion.hand == "left" else np.ascontiguousarray(self.mesh.faces[:, ::-1])
        return replace(self, mesh=SurfaceMesh(motion.to_mirror(self.mesh.vertices), facets))

    def area_samples(self) -> AreaSamples:
        """Of every facet."""
        corners = self.mesh.vertices[self.mesh.faces]
        areas = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return AreaSamples(corners.mean(axis=1), areas, np.arange(len(corners)))

    @property
    def is_loose(self) -> bool:
        """Not where every edge has as many facets on it as make a body: an even number."""
        faces = self.mesh.faces
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        codes = edges[:, 0].astype(np.int64) * len(self.mesh.vertices) + edges[:, 1]
        counts = np.unique(codes, return_counts=True)[1]
        return not bool((counts % 2 == 0).all())

    def one_side(self, samples: AreaSamples, side: Mask) -> tuple[OpticalSurface, Array]:
        """The facets on that side, wound as the samples are turned, with interpolated normals."""
        turned = np.einsum("ni,ni->n", samples.areas, self.area_samples().areas) < 0.0
        facets = np.where(turned[:, None], self.mesh.faces[:, ::-1], self.mesh.faces)
        mesh = SurfaceMesh(self.mesh.vertices, facets[side])
        return MeshSurface(mesh, "interpolated"), mesh.vertices[np.unique(mesh.faces)]

    def interpolated(self) -> MeshSurface:
        """The smooth surface that its vertices lie on."""
        return self if self.normals == "interpolated" else self._interpolated

    @cached_property
    def _interpolated(self) -> MeshSurface:
        found = replace(self, normals="interpolated")
        found.__dict__["scene"] = self.scene  # the facets are the same
        return found

    def ray_differentials(self, eye: Array, rays: Array, turns: Array, points: Array, directions: Array) -> tuple[Array, Array]:
        """By exact rays beside.

        With interpolated normals `resolution_mm` apart and of the fourth order, since what is between vertices is right in the
        mean only; with its facets', a part of its width, as far as a Newton step has to see.
        """
        smooth = self.normals == "interpolated"
        x_min, x_max, _, _ = self.domain
        apart = self.resolution_mm if smooth else TILT * (x_max - x_min)
        return traced_differentials(self._traced_from(eye), rays, turns, points, directions,
                                    apart / float(np.linalg.norm(eye)), smooth)
