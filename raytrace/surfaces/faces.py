"""Several faces as one optical surface: of what a ray meets, the nearest counts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from raytrace.rays import Rays, Status, Trace
from raytrace.surfaces.base import BoundedFace, OpticalSurface
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.quadric import QuadricFace, first_of_quadrics

Array = NDArray[np.float64]
Face = BSplineFace | QuadricFace


@dataclass(frozen=True, eq=False)
class FaceSet(OpticalSurface):
    """Faces of either kind that reflect side by side, or one before the other."""

    splines: tuple[BSplineFace, ...]
    quadrics: tuple[QuadricFace, ...]

    @staticmethod
    def of(faces: tuple[Face, ...]) -> FaceSet:
        """Sorted by kind: quadrics are met first, in closed form, and what they give ends the search on B-splines early."""
        return FaceSet(tuple(face for face in faces if isinstance(face, BSplineFace)),
                       tuple(face for face in faces if isinstance(face, QuadricFace)))

    @property
    def faces(self) -> tuple[Face, ...]:
        """All of them."""
        return (*self.splines, *self.quadrics)

    def first_hits(self, rays: Rays, out: Trace) -> None:
        """Quadrics in closed form, then what each B-spline gives that is nearer. See `OpticalSurface`."""
        if not self.splines:
            first_of_quadrics(self.quadrics, rays, out)
            return
        for part, some in rays.in_parts(np.arange(len(rays))):
            out.scatter(part, self._search(some))

    def _search(self, rays: Rays) -> Trace:
        found = Trace.empty(len(rays))
        origins, units, valid = rays.units()
        if self.quadrics:
            first_of_quadrics(self.quadrics, rays, found)
        else:
            found.status[:] = np.where(valid, Status.MISSED, Status.INVALID)
            found.invalidate(np.arange(len(rays)))
        for face in self.splines:
            face.meet_nearer(origins, units, np.flatnonzero(valid), found)
        return found

    @property
    def bounding_faces(self) -> tuple[BoundedFace, ...]:
        return self.faces

    def outline(self) -> Array:
        return self._outline

    @cached_property
    def _outline(self) -> Array:
        return np.concatenate([face.outline() for face in self.faces])

    def prepared(self) -> FaceSet:
        for face in self.faces:
            face.prepared()
        return self
