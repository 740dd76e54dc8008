"""Several faces as one optical surface: of what a ray meets, the nearest counts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.pieces import Pieces
from raytrace.kernels.quadrics import Quadrics
from raytrace.rays import Mask, Rays, Trace
from raytrace.surfaces.area_samples import AreaSamples
from raytrace.surfaces.base import BoundedFace, OpticalSurface, RigidMotion
from raytrace.surfaces.bspline import BSplineFace, search_pieces
from raytrace.surfaces.pieces import pieces_of
from raytrace.surfaces.quadric import FEW, QuadricFace, first_of_quadrics, quadrics_of

Array = NDArray[np.float64]
Face = BSplineFace | QuadricFace


@dataclass(frozen=True, eq=False)
class FaceSet(OpticalSurface):
    """Faces of either kind that reflect side by side, or one before the other.

    Parameters
    ----------
    splines, quadrics : the faces.
    """

    splines: tuple[BSplineFace, ...]
    quadrics: tuple[QuadricFace, ...]

    @staticmethod
    def of(faces: tuple[Face, ...]) -> FaceSet:
        """Sort faces by kind: quadrics are met first, in closed form, and what they give ends the search on B-splines early."""
        return FaceSet(tuple(face for face in faces if isinstance(face, BSplineFace)),
                       tuple(face for face in faces if isinstance(face, QuadricFace)))

    @property
    def faces(self) -> tuple[Face, ...]:
        """All of them."""
        return (*self.splines, *self.quadrics)

    @cached_property
    def pieces(self) -> Pieces:
        """What a search of the B-splines goes through.

        Raises
        ------
        TraceError
            For a degree that the kernels do not take.
        """
        return pieces_of(self.splines)

    @cached_property
    def quadric_tree(self) -> Quadrics | None:
        """The quadrics in a tree; None for a few, which are looked at one by one."""
        return quadrics_of(self.quadrics) if len(self.quadrics) > FEW else None

    def first_hits(self, rays: Rays, out: Trace) -> None:
        """Quadrics in closed form, then what the B-splines give that is nearer. See `OpticalSurface`."""
        if not self.splines:
            first_of_quadrics(self.quadrics, self.quadric_tree, rays, out)
            return
        for part, some in rays.in_parts(np.arange(len(rays))):
            found = Trace.empty(len(some))
            if self.quadrics:
                first_of_quadrics(self.quadrics, self.quadric_tree, some, found)
            search_pieces(self.pieces, some, found, begun=bool(self.quadrics))
            out.scatter(part, found)

    def moved(self, motion: RigidMotion) -> FaceSet:
        """Face by face."""
        return FaceSet(tuple(face.moved(motion) for face in self.splines), tuple(face.moved(motion) for face in self.quadrics))

    @property
    def looks_outward(self) -> bool:
        """Whether all of its faces are one-sided."""
        return all(face.one_sided for face in self.faces)

    def area_samples(self) -> AreaSamples:
        """Those of its faces, which are numbered in the order of `faces`."""
        parts = [face.area_samples() for face in self.faces]
        return AreaSamples(np.concatenate([part.points for part in parts]), np.concatenate([part.areas for part in parts]),
                           np.repeat(np.arange(len(parts)), [len(part.points) for part in parts]))

    def one_side(self, samples: AreaSamples, side: Mask) -> tuple[OpticalSurface, Array]:
        """The faces that have samples on the side."""
        faces = tuple(self.faces[k].two_sided() for k in np.unique(samples.owner[side]))
        points = [curve.points for face in faces for curve in face.rim]
        return faces[0] if len(faces) == 1 else FaceSet.of(faces), np.concatenate([*points, samples.points[side]])

    @property
    def bounding_faces(self) -> tuple[BoundedFace, ...]:
        """All of its faces."""
        return self.faces

    def outline(self) -> Array:
        """Points (n, 3), mm, of its faces' outlines."""
        return self._outline

    @cached_property
    def _outline(self) -> Array:
        return np.concatenate([face.outline() for face in self.faces])

    def prepared(self) -> FaceSet:
        """With its faces prepared."""
        for face in self.faces:
            face.prepared()
        return self
