"""What an eye looks into: a surface that reflects, and what only stands in the way."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mirror_cad.mesh import SurfaceMesh
from raytrace.embree import TriangleScene
from raytrace.surfaces.base import GlassPlate, OpticalSurface
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.faces import Face, FaceSet
from raytrace.surfaces.mesh import MeshSurface, Normals
from raytrace.surfaces.plate import Plate

if TYPE_CHECKING:
    from mirror_cad.mirror import Mirror
    from mirror_cad.surfaces.bspline import BSplineSurface
    from raytrace.placement import Placement

Array = NDArray[np.float64]

TRIM_CHORD_MM = 1e-5  # of the polygon for a mirror's own outline
# Obstacles only say whether something is in the way: a tenth of a millimetre is far less than a pupil.
OBSTACLE_DEFLECTION_MM = 0.1


@dataclass(frozen=True, eq=False)
class Reflector:
    """What reflects, and what only stands in the way, in the coordinates of its file, or of the mirror where it was seated; mm.

    Parameters
    ----------
    surface : what reflects, of whatever kind.
    obstacles : what blocks and does not reflect (the back and sides of a plate).
    placement : where its coordinates are in those of the file that it was read from, where that is known.
    """

    surface: OpticalSurface
    obstacles: SurfaceMesh | None = None
    placement: Placement | None = None

    def __repr__(self) -> str:
        low, high = self.bounds
        width, height = (high - low)[:2]
        return f"<Reflector: {type(self.surface).__name__}, {width:.4g} × {height:.4g} mm>"

    @staticmethod
    def from_mirror(mirror: Mirror, front: BSplineSurface | None = None) -> Reflector:
        """The optical face of a designed mirror, inside its outline, with the glass before one that reflects from the back.

        front : of that glass, where it is not the mirror's own.
        """
        loops, glass = (mirror.outline.polyline(TRIM_CHORD_MM),), mirror.spec.glass
        face = BSplineFace(mirror.surface, loops)
        if glass.reflecting == "back":
            return Reflector(Plate(BSplineFace(mirror.front if front is None else front, loops), face, glass.index))
        return Reflector(face)

    @staticmethod
    def of_faces(faces: tuple[Face, ...], obstacles: SurfaceMesh | None = None) -> Reflector:
        """One face, or several of which the nearest that a ray meets counts."""
        return Reflector(faces[0] if len(faces) == 1 else FaceSet.of(faces), obstacles)

    @staticmethod
    def of_mesh(mesh: SurfaceMesh, normals: Normals = "facets") -> Reflector:
        """Facets, with their own normals or with those interpolated between their vertices."""
        return Reflector(MeshSurface(mesh, normals))

    @property
    def mesh(self) -> SurfaceMesh | None:
        """The facets of what was read from a mesh, for scripts; None where surfaces reflect."""
        return self.surface.facets

    @cached_property
    def untrimmed(self) -> Reflector:
        """The sheet that a single face was cut from, with the whole front where there is glass, and nothing in the way.

        Of several faces, or a mesh, what reflects.
        """
        return Reflector(self.surface.untrimmed())

    @cached_property
    def uncoated(self) -> Reflector:
        """The reflecting surface alone, as if there were no glass before it, with what stands in the way."""
        return replace(self, surface=self.surface.uncoated())

    @property
    def glass(self) -> GlassPlate:
        """The glass and its reflecting back.

        Raises
        ------
        TraceError
            For what reflects from its front.
        """
        return self.surface.glass

    def moved(self, placement: Placement) -> Reflector:
        """Bring the reflector of a file to mirror coordinates, with what stands in the way, and note the placement.

        Parameters, loops and facets stay, but for the sense of a right-hand mirror's, so the motion is exact but for rounding.

        Parameters
        ----------
        placement : of the mirror in the coordinates of its file.

        Returns
        -------
        Reflector
        """
        if placement.is_identity:
            return replace(self, placement=placement)
        obstacles = self.obstacles
        if obstacles is not None:
            facets = obstacles.faces if placement.hand == "left" else np.ascontiguousarray(obstacles.faces[:, ::-1])
            obstacles = SurfaceMesh(placement.to_mirror(obstacles.vertices), facets)
        return Reflector(self.surface.moved(placement), obstacles, placement)

    @cached_property
    def interpolated(self) -> Reflector:
        """The smooth surface that it stands for; see `OpticalSurface.interpolated`."""
        return replace(self, surface=self.surface.interpolated())

    @cached_property
    def obstacle_scene(self) -> TriangleScene | None:
        """The obstacles in Embree."""
        return TriangleScene(self.obstacles.vertices, self.obstacles.faces) if self.obstacles is not None else None

    @cached_property
    def obstacles_behind(self) -> bool:
        """Whether every obstacle is known to lie under the surface, no higher than its own mesh error."""
        return self.obstacles is not None and self.surface.is_above(self.obstacles.vertices, OBSTACLE_DEFLECTION_MM)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """The lowest and the highest coordinates of its outline, (3,) each, mm."""
        points = self.outline()
        return points.min(axis=0), points.max(axis=0)

    def outline(self) -> Array:
        """Points (n, 3) mm of what reflects: its vertices or the edges of its faces."""
        return self.surface.outline()
