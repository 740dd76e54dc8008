"""What every reflecting surface answers, whatever it is made of: no caller asks which kind it has."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property
from typing import Literal, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirror_cad.mesh import SurfaceMesh
from raytrace.errors import TraceError
from raytrace.kernels.plate_edge import Plate
from raytrace.kernels.sheet import Sheet
from raytrace.rays import Mask, NormalsFrom, Rays, Trace
from raytrace.surfaces.area_samples import AreaSamples
from raytrace.surfaces.differentials import reflected_differentials, traced_differentials
from raytrace.surfaces.rim import Curve, rim_of
from raytrace.surfaces.trimming import Trimming

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

# Radians to either side of a ray, 0.01 mm of a mirror at the driver's distance: rounding gives the differences 1e-11 of their
# size, the third derivative 1e-9 of what changes over a degree.
TURN = 1.5e-5
# How far inside the box's edge a ray is taken, of the mirror's width: an outline's own upper edge is no longer inside it, and
# the sheet goes on beyond. 1e-12 rad of the reflected ray.
EDGE_INSET = 1e-12
CELLS = 16  # a direction, that a face is sampled in: for which way it looks and bulges, not for where its frame is


class RigidMotion(Protocol):
    """Coordinates of a file to those of a mirror: p' = R·(p − o), of a right-hand one with a reflection."""

    @property
    def rotation(self) -> Array:
        """R (3, 3), orthogonal; its determinant is −1 for a right-hand mirror."""

    @property
    def hand(self) -> Literal["left", "right"]:
        """Of the mirror in the file; "right" is reflected."""

    def to_mirror(self, points: Array) -> Array:
        """Points (…, 3), mm, of the file in mirror coordinates."""


class GlassPlate(Protocol):
    """Glass before a reflecting back, as its ghost and its light are reckoned from."""

    @property
    def index(self) -> float:
        """Of the glass against air, 1 or more."""

    def front_at(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Points (n, 3) of the front, mm, and its unit normals (n, 3) towards the air, at its parameters u, v (n,)."""

    def first_hits(self, rays: Rays, out: Trace) -> None:
        """As `OpticalSurface.first_hits`, through the glass."""

    def untrimmed(self) -> GlassPlate:
        """The whole of both sheets."""

    def uncoated(self) -> OpticalSurface:
        """The back alone."""


class OpticalSurface(ABC):
    """A surface that reflects, in the coordinates of its mirror, mm: z towards the driver.

    One B-spline, one quadric, several faces, a mesh, or a plate of glass that reflects from its back. A new kind has to say
    where rays first meet it and between which points it lies; all else follows from these, and is said again where it is
    known better.
    """

    @abstractmethod
    def first_hits(self, rays: Rays, out: Trace) -> None:
        """Find where each ray first meets the surface, and where it goes from there.

        Parameters
        ----------
        rays : n rays, in the surface's coordinates.
        out : what is written; its arrays have room for n rays.
        """

    @abstractmethod
    def outline(self) -> Array:
        """Points (n, 3), mm, between which it lies in x and y."""

    @cached_property
    def box(self) -> Box:
        """(x_min, x_max, y_min, y_max) of its outline, mm."""
        x, y, _ = self.outline().T
        return float(x.min()), float(x.max()), float(y.min()), float(y.max())

    @abstractmethod
    def moved(self, motion: RigidMotion) -> Self:
        """The same surface in other coordinates, exact but for rounding."""

    # --- which way it looks -------------------------------------------------------------------------------------------

    @abstractmethod
    def area_samples(self) -> AreaSamples:
        """Where it is and which way it looks, evenly enough to tell its side and size by."""

    @property
    def looks_outward(self) -> bool:
        """Whether it is known to reflect on its outward side alone."""
        return False

    @property
    def is_loose(self) -> bool:
        """Whether it is a sheet of facets, each of which may be turned either way."""
        return False

    @abstractmethod
    def one_side(self, samples: AreaSamples, side: Mask) -> tuple[OpticalSurface, Array]:
        """Take the part of it that some of its samples are of, reflecting on both sides.

        Parameters
        ----------
        samples : those of `area_samples`, some of which may have been turned.
        side : (n,), which are meant.

        Returns
        -------
        surface : that part.
        points : (m, 3), mm, of its rim and facets.
        """

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
    def glass(self) -> GlassPlate:
        """The glass before it and its reflecting back.

        Raises
        ------
        TraceError
            For what reflects from its front.
        """
        raise TraceError("this mirror reflects from its front: it has no glass that light goes through")

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

    @property
    def sheet(self) -> Sheet | None:
        """Itself as one sheet z(x, y) of which rays of an eye are found without a search; None for what is none."""
        return None

    @property
    def plate(self) -> Plate | None:
        """Itself as a plate of glass, of whose rays it is told where they pass its sheets; None for what is none."""
        return None

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
        """Cut a margin along its edge away, in (x, y).

        Parameters
        ----------
        margin_mm : mm, all around.

        Raises
        ------
        TraceError
            Where that cannot be cut.
        """
        raise no_inset(margin_mm)

    def inboard_of(self, x: float) -> OpticalSurface:
        """The part with larger x than that of a transition line, in (x, y). Raises: TraceError where that cannot be cut."""
        raise no_transition(x)

    # --- rays by where they are reflected -----------------------------------------------------------------------------

    def points_over(self, x: Array, y: Array) -> Array:
        """Find points of the reflecting surface, without glass before it.

        Of a surface that was cut from a sheet, those of the whole sheet: where a ray down from above all of it meets it.

        Parameters
        ----------
        x, y : (n,), mm.

        Returns
        -------
        (n, 3), mm; NaN where it has none.
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
        """Find the directions in which an eye sees what is reflected at points of its sheet.

        Parameters
        ----------
        eye : (3,), mm.
        x, y : (n,), mm, of the points.

        Returns
        -------
        (n, 3), of any length; NaN where nothing is.
        """
        return self.points_over(x, y) - eye

    def reflected_at(self, eye: Array, x: Array, y: Array) -> tuple[Array, Array]:
        """Find where the rays from an eye leave it that are reflected at points of its sheet, and in which directions.

        Parameters
        ----------
        eye : (3,), mm.
        x, y : (n,), mm, of the points.

        Returns
        -------
        points, directions : (n, 3), mm and unit; NaN where none is.
        """
        found = Trace.empty(len(x))
        self.untrimmed().first_hits(Rays(eye[None], np.ascontiguousarray(self.eye_rays(eye, x, y))), found)
        return found.points, found.directions

    def reflected_on_grid(self, eye: Array, x: Array, y: Array) -> tuple[Array, Array]:
        """`reflected_at` on the grid of x (m,) and y (n,), mm: (m·n, 3) each, y running first."""
        return self.reflected_at(eye, *grid_points(x, y))

    # --- how rays leave it when the eye turns --------------------------------------------------------------------------

    def curvature_tensors(self, points: Array, normals: Array) -> Array:
        """Compute the derivative N of the unit normal along its sheet: dn = N·dP, the shape operator as a tensor in space.

        Parameters
        ----------
        points : (n, 3), mm, where rays met its sheet.   normals : (n, 3), unit, there; N changes its sign with them.

        Returns
        -------
        (n, 3, 3), 1/mm; NaN where it is not known in closed form.
        """
        return np.full((len(points), 3, 3), np.nan)

    def ray_differentials(self, eye: Array, rays: Array, turns: Array, points: Array, directions: Array) -> tuple[Array, Array]:
        """Differentiate where rays from the eye leave its sheet, and their directions then, by changes of the eye's rays.

        In closed form where the shape operator is known, else by exact rays TURN beside.

        Parameters
        ----------
        eye : (3,), mm.   rays : (n, 3), unit.   turns : (n, k, 3), changes of the rays, across them.
        points : (n, 3), mm, where the rays leave.   directions : (n, 3), unit, then.

        Returns
        -------
        Derivatives of points, mm, and of directions, (n, k, 3) each; NaN where nothing beside is reflected.
        """
        by_points, by_directions = reflected_differentials(eye, rays, turns, points, directions, self.curvature_tensors)
        left = np.flatnonzero(~np.isfinite(by_directions).all(axis=(1, 2)) & np.isfinite(directions).all(axis=1))
        if left.size:
            by_points[left], by_directions[left] = traced_differentials(
                self._traced_from(eye), rays[left], turns[left], points[left], directions[left], TURN, False)
        return by_points, by_directions

    def _traced_from(self, eye: Array) -> Callable[[Array], tuple[Array, Array]]:
        """Points and directions in which rays (m, 3) from the eye leave its sheet; NaN where they do not."""
        sheet = self.untrimmed()

        def trace(rays: Array) -> tuple[Array, Array]:
            found = Trace.empty(len(rays))
            sheet.first_hits(Rays(eye[None], np.ascontiguousarray(rays)), found)
            return found.points, found.directions

        return trace

    # --- what it costs ------------------------------------------------------------------------------------------------

    @property
    def facets(self) -> SurfaceMesh | None:
        """The facets that it is made of, for a script to look at: None for all but a mesh."""
        return None

    @property
    def triangle_count(self) -> int:
        """How many facets it is made of: 0 for all but a mesh."""
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

    loops: tuple[Array, ...]
    sign: float
    one_sided: bool

    @property
    @abstractmethod
    def trimming(self) -> Trimming:
        """Its loops as the kernels take them."""

    @cached_property
    def rim(self) -> tuple[Curve, ...]:
        """The curves that bound it."""
        return rim_of(self.evaluate, self.loops)

    @property
    def bounding_faces(self) -> tuple[BoundedFace, ...]:
        """Itself."""
        return (self,)

    @property
    def extends(self) -> bool:
        """It does: its sheet is known."""
        return True

    @property
    def edge_inset(self) -> float:
        """EDGE_INSET: the sheet goes on beyond."""
        return EDGE_INSET

    @property
    def looks_outward(self) -> bool:
        """Whether it is one-sided."""
        return self.one_sided

    @abstractmethod
    def two_sided(self) -> BoundedFace:
        """The same face, reflecting on both sides."""

    def area_samples(self) -> AreaSamples:
        """Middles of the cells of a grid in (u, v) that lie inside the loops, or of all where none does."""
        u_min, u_max, v_min, v_max = self.trimming.box
        u, v = np.linspace(u_min, u_max, CELLS + 1), np.linspace(v_min, v_max, CELLS + 1)
        s = self.evaluate(u[:, None], v[None, :])
        at_u, at_v = (each.ravel() for each in np.meshgrid(0.5 * (u[1:] + u[:-1]), 0.5 * (v[1:] + v[:-1]), indexing="ij"))
        areas = 0.5 * self.sign * np.cross(s[1:, 1:] - s[:-1, :-1], s[:-1, 1:] - s[1:, :-1]).reshape(-1, 3)
        inside = self.trimming.contains(at_u, at_v)
        if not inside.any():
            inside[:] = True
        return AreaSamples(self.evaluate(at_u[inside], at_v[inside]), areas[inside], np.zeros(int(inside.sum()), dtype=np.intp))

    def one_side(self, samples: AreaSamples, side: Mask) -> tuple[OpticalSurface, Array]:
        """All of it, with the points of its rim."""
        return self.two_sided(), np.concatenate([*(curve.points for curve in self.rim), samples.points[side]])


Face = TypeVar("Face", bound=BoundedFace)


def with_trimming_of(face: BoundedFace, again: Face) -> Face:
    """The second face, with what the first has made of the loops that both have: sorting them takes as long as reading."""
    if "trimming" in vars(face):
        vars(again)["trimming"] = face.trimming
    return again


def no_inset(margin_mm: float) -> TraceError:
    """What is said where a bezel's edge cannot be cut."""
    return TraceError(f"a bezel over {margin_mm:g} mm of the edge needs a mirror that is one B-spline with u = x, v = y and "
                      "one outline, as this program makes them: leave bezel_over_m at 0 for this file")


def no_transition(x: float) -> TraceError:
    """What is said where a mirror cannot be cut along a transition line."""
    return TraceError(f"a transition line at x = {x:g} mm needs a mirror that is one B-spline with u = x, v = y and one "
                      "outline, as this program makes them: of another file no main part can be told from an aspheric one")


def box_of_points(points: Array) -> Box:
    """(x_min, x_max, y_min, y_max) of points (n, 3)."""
    return (float(points[:, 0].min()), float(points[:, 0].max()), float(points[:, 1].min()), float(points[:, 1].max()))


def grid_points(x: Array, y: Array) -> tuple[Array, Array]:
    """X and y (m·n,) of the grid of x (m,) and y (n,), y running first."""
    return np.repeat(x, len(y)), np.tile(y, len(x))
