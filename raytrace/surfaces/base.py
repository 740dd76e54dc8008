"""What every reflecting surface answers, whatever it is made of: no caller asks which kind it has."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import TraceError
from raytrace.rays import NormalsFrom, Rays, Trace
from raytrace.surfaces.rim import Curve

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]


class OpticalSurface(ABC):
    """A surface that reflects, in the coordinates of its mirror, mm: z towards the driver.

    One B-spline, one quadric, several faces, a mesh, or a plate of glass that reflects from its back. A new kind has to say
    where rays first meet it and between which points it lies; all else follows from these, and is said again where it is
    known better.
    """

    @abstractmethod
    def first_hits(self, rays: Rays, out: Trace) -> None:
        """Write where each ray first meets it, and where it goes from there, into `out`, whose arrays have room for it."""

    @abstractmethod
    def outline(self) -> Array:
        """Points (n, 3), mm, between which it lies in x and y."""

    # --- how well it is known -----------------------------------------------------------------------------------------

    @property
    def normals_from(self) -> NormalsFrom:
        """What normals are those of: the surface itself, a mesh's facets, or those interpolated between its vertices."""
        return "surface"

    @property
    def refracts(self) -> bool:
        """Whether light goes through glass before it."""
        return False

    @property
    def resolution_mm(self) -> float:
        """What lies closer together than this is not told apart by normals: 0 for all but a mesh."""
        return 0.0

    @property
    def edge_inset(self) -> float:
        """How far inside its box's edge, as a share of the width, rays are sure to meet it.

        1e-7 is what the digits of a file leave open: where nothing goes on beyond the edge, its points are the file's.
        """
        return 1e-7

    @property
    def domain(self) -> Box:
        """(x_min, x_max, y_min, y_max), mm, over which `reflected_at` may be asked."""
        return box_of_points(self.outline())

    # --- its edge -----------------------------------------------------------------------------------------------------

    @property
    def rim(self) -> tuple[Curve, ...]:
        """The curves that bound it; () where they are not known one by one."""
        return ()

    @property
    def bounding_faces(self) -> tuple[BoundedFace, ...]:
        """The faces of which the rim of one may be the edge of what an eye sees; () where the edge has to be looked for."""
        return ()

    @property
    def extends(self) -> bool:
        """Whether `untrimmed` goes on beyond the outline."""
        return False

    def is_above(self, points: Array, margin_mm: float) -> bool:
        """Whether all points (n, 3) are known to lie below it, in its own column and no higher than the margin."""
        return False

    # --- other surfaces that it leads to ------------------------------------------------------------------------------

    def untrimmed(self) -> OpticalSurface:
        """The sheet that it was cut from; itself, where that is not known."""
        return self

    def uncoated(self) -> OpticalSurface:
        """The reflecting surface without glass before it."""
        return self

    def interpolated(self) -> OpticalSurface:
        """The smooth surface it stands for: of a mesh the one that its vertices lie on."""
        return self

    def inset(self, margin_mm: float) -> OpticalSurface:
        """The surface without the margin along its edge, in (x, y). Raises: TraceError where that cannot be cut."""
        raise no_inset(margin_mm)

    # --- rays by where they are reflected -----------------------------------------------------------------------------

    def points_over(self, x: Array, y: Array) -> Array:
        """Points (n, 3), mm, of the reflecting surface at (x, y), without glass before it; NaN where it has none.

        Of a surface that was cut from a sheet, those of the whole sheet: where a ray down from above all of it meets it.
        """
        outline = self.outline()
        # From above all that reflects: facets and bulges are higher than the outline by less than its size.
        above = outline[:, 2].max() + np.linalg.norm(outline.max(axis=0) - outline.min(axis=0))
        down = np.zeros((len(x), 3))
        down[:, 2] = -1.0
        found = Trace.empty(len(x))
        self.uncoated().untrimmed().first_hits(Rays(np.stack([x, y, np.full(len(x), above)], axis=1), down), found)
        return found.points

    def eye_rays(self, eye: Array, x: Array, y: Array) -> Array:
        """Directions (n, 3), of any length, in which the eye (3,) sees what is reflected at (x, y) of its sheet; NaN where
        nothing is."""
        return self.points_over(x, y) - eye

    def reflected_at(self, eye: Array, x: Array, y: Array) -> tuple[Array, Array]:
        """Points (n, 3) where the rays from the eye that are reflected at (x, y) of its sheet leave it, and their unit
        directions (n, 3) then; NaN where none is."""
        found = Trace.empty(len(x))
        self.untrimmed().first_hits(Rays(eye[None], np.ascontiguousarray(self.eye_rays(eye, x, y))), found)
        return found.points, found.directions

    def reflected_on_grid(self, eye: Array, x: Array, y: Array) -> tuple[Array, Array]:
        """`reflected_at` on the grid of x (m,) and y (n,): (m·n, 3) each, y running first."""
        return self.reflected_at(eye, *grid_points(x, y))

    # --- what it costs ------------------------------------------------------------------------------------------------

    @property
    def triangle_count(self) -> int:
        """Facets that it is made of: 0 for all but a mesh."""
        return 0

    def prepared(self) -> Self:
        """Itself, with what tracing needs of it made now: in the process that reads it, say."""
        return self


class BoundedFace(OpticalSurface):
    """A face S(u, v) cut from a sheet, whose rim is known piece by piece in its parameters."""

    @abstractmethod
    def evaluate(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Points (…, 3), mm."""

    @property
    @abstractmethod
    def parameter_limits(self) -> tuple[Array, Array]:
        """The least and the greatest (u, v) at which rays meet the surface, (2,) each."""

    @property
    def bounding_faces(self) -> tuple[BoundedFace, ...]:
        return (self,)

    @property
    def extends(self) -> bool:
        return True


def no_inset(margin_mm: float) -> TraceError:
    """What is said where a bezel's edge cannot be cut."""
    return TraceError(f"a bezel over {margin_mm:g} mm of the edge needs a mirror that is one B-spline with u = x, v = y and "
                      "one outline, as this program makes them: leave bezel_over_m at 0 for this file")


def box_of_points(points: Array) -> Box:
    """(x_min, x_max, y_min, y_max) of points (n, 3)."""
    return (float(points[:, 0].min()), float(points[:, 0].max()), float(points[:, 1].min()), float(points[:, 1].max()))


def grid_points(x: Array, y: Array) -> tuple[Array, Array]:
    """x and y (m·n,) of the grid of x (m,) and y (n,), y running first."""
    return np.repeat(x, len(y)), np.tile(y, len(x))
