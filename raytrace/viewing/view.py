"""A mirror on a vehicle seen from one ocular point: what it shows where."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import TraceError
from raytrace.kernels import eye_rays
from raytrace.kernels.sheet import surface_points
from raytrace.rays import Status
from raytrace.reflector import Reflector
from raytrace.surfaces.base import Box
from raytrace.trace import reflect
from raytrace.viewing.eye import EYE_DISTANCE_MM, eye_position
from raytrace.viewing.pose import Pose

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

THICKNESS = 10.0  # mm behind the face that count as inside the mirror
ONE_BY_ONE = 128  # rays up to which a sheet's are traced one by one: handing out blocks costs as much as that
GLASS_STEPS = 3  # from where a ray leaves the glass to what it is seen over: each leaves some hundredth
EYE_CLEARANCE = 1e-6  # mm in front of the mirror's foremost point


@dataclass(frozen=True, slots=True, eq=False)
class TracedRays:
    """What n rays from the ocular point meet. In the view's coordinates, mm; rows of rays that are not reflected are NaN.

    Attributes
    ----------
    status : (n,), what became of each ray, see `Status`.
    points : (n, 3), mm, where it leaves the mirror.
    directions : (n, 3), unit, in which it does.
    on_mirror : (n, 3), mm, the same points in mirror coordinates.
    """

    status: NDArray[np.int8]
    points: Array
    directions: Array
    on_mirror: Array

    @property
    def seen(self) -> Mask:
        """Whether the mirror reflects each ray, (n,)."""
        result: Mask = self.status == Status.REFLECTED
        return result

    def __repr__(self) -> str:
        kinds, counts = np.unique(self.status, return_counts=True)
        told = ", ".join(f"{count} {Status(kind).name.lower()}" for kind, count in zip(kinds, counts, strict=True))
        return f"<TracedRays: {len(self.status)} rays{', ' * bool(told)}{told}>"


@dataclass(frozen=True, eq=False)
class View:
    """A reflector in its pose, seen from one ocular point.

    Rays from the eye are told by the points (…, 2) at which they meet the picture plane, the mirror's own z = 0, in mm.

    Parameters
    ----------
    reflector : what is looked into.
    pose : where it is, and how it is turned; without one it stays in its own coordinates, as in the paper.
    eye : the ocular point (3,), mm, in the coordinates that the pose leads to; without one the paper's, 762 mm from the centre
        of the mirror's surface, over its right edge.

    Raises
    ------
    TraceError
        For an eye that no point of the mirror faces.
    TypeError
        For anything but a reflector.
    """

    reflector: Reflector
    pose: Pose = field(default_factory=Pose.identity)
    eye: Array = None  # type: ignore[assignment]  # set by __post_init__ where none is given

    def __post_init__(self) -> None:
        if not isinstance(self.reflector, Reflector):
            raise TypeError(f"a View takes a Reflector, not {type(self.reflector).__name__}: load_reflector(…) reads one from "
                            "a file, Reflector.from_mirror(…) takes a designed mirror")
        if self.eye is None:
            object.__setattr__(self, "eye", self.pose.to_vehicle(eye_position(EYE_DISTANCE_MM, "right", self.box)))
        else:
            object.__setattr__(self, "eye", np.asarray(self.eye, dtype=np.float64))
        sheet = self.reflector.surface.sheet
        if sheet is not None and self.eye_in_mirror[2] > max(sheet.field.top, 0.0) + EYE_CLEARANCE:
            return  # above all of the sheet, and so above what was cut from it, whose rim need not be worked out
        highest = float(self.reflector.bounds[1][2])
        if not self.eye_in_mirror[2] > max(highest, 0.0) + EYE_CLEARANCE:
            x, y, z = self.eye_in_mirror
            box = self.box
            lowest = float(self.reflector.bounds[0][2]) - THICKNESS
            inside = box[0] < x < box[1] and box[2] < y < box[3] and z > lowest
            what = "is inside the mirror" if inside else "is behind the face of the mirror, which is turned away from it"
            raise TraceError(f"the eye {what}: in mirror coordinates it is at ({x:.0f}, {y:.0f}, {z:.0f}) mm, and z must be "
                             f"above {max(highest, 0.0):.0f} mm: check the eye's place, the mirror's centre, yaw and pitch")

    def __repr__(self) -> str:
        x, y, z = self.eye
        return f"<View of {self.reflector!r}, {self.pose!r}, eye at ({x:.1f}, {y:.1f}, {z:.1f}) mm>"

    @cached_property
    def eye_in_mirror(self) -> Array:
        """The ocular point in mirror coordinates, (3,)."""
        return self.pose.to_mirror(self.eye)

    @cached_property
    def posed(self) -> eye_rays.Posed:
        """The eye and the pose, as the kernels take them."""
        return eye_rays.Posed(self.eye_in_mirror[None], self.pose.rotation[None], self.pose.offset[None])

    @cached_property
    def box(self) -> Box:
        """(x_min, x_max, y_min, y_max) of what reflects, in mirror coordinates."""
        return box_of(self.reflector)

    @cached_property
    def untrimmed(self) -> View:
        """The same view of the sheet that the mirror was cut from, where it is known, and with nothing before it."""
        return replace(self, reflector=self.reflector.untrimmed)

    @cached_property
    def interpolated(self) -> View:
        """The same view of the smooth surface that the mirror stands for: a facet by itself is flat and magnifies nothing."""
        return replace(self, reflector=self.reflector.interpolated)

    def trace(self, x: ArrayLike, y: ArrayLike) -> TracedRays:
        """Trace the eye's rays through points of the picture plane z = 0.

        Parameters
        ----------
        x, y : mm, of any shapes that go together; the rays are numbered as their values are in memory. Not of the surface: the
            eye looks past its edge at them, and `trace_over` takes (x, y) of the surface.

        Returns
        -------
        TracedRays
            Of as many rays, in a row; a ray that the mirror does not reflect has NaN and a status that says why.
        """
        at_x, at_y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        return self.trace_points(np.stack([at_x.ravel(), at_y.ravel()], axis=1))

    def trace_points(self, on_plane: Array) -> TracedRays:
        """Trace the eye's rays through points (n, 2) of the picture plane, mm."""
        sheet = self.reflector.surface.sheet if len(on_plane) <= ONE_BY_ONE and self.reflector.obstacles is None else None
        if sheet is not None:
            return TracedRays(*eye_rays.trace(sheet, self.posed, on_plane))
        rays = np.concatenate([on_plane, np.zeros((len(on_plane), 1))], axis=1) - self.eye_in_mirror
        trace = reflect(self.reflector, self.eye_in_mirror, rays)
        return TracedRays(trace.status, self.pose.to_vehicle(trace.points),
                          self.pose.directions_to_vehicle(trace.directions), trace.points)

    def surface_under(self, on_plane: Array) -> Array:
        """Find where on what reflects, without glass before it, the eye looks through points of the picture plane.

        `on_plane_over` the other way round, on the whole sheet. With glass, by three steps of a fixed point.

        Parameters
        ----------
        on_plane : (n, 2), mm, of the picture plane.

        Returns
        -------
        (n, 2), (x, y) in mm; NaN where the sheet reflects nothing.
        """
        at: Array = self.untrimmed.trace_points(on_plane).on_mirror[:, :2].copy()
        if self.reflector.surface.refracts:  # rays leave by the front, beside where they are reflected
            for _ in range(GLASS_STEPS):
                off = on_plane - self.on_plane_over(*at.T)
                at += np.where(np.isfinite(off), off, 0.0)
        return at

    def trace_over(self, x: Array, y: Array) -> tuple[Array, TracedRays]:
        """Trace the eye's rays to what reflects at (x, y), on the whole sheet that the mirror was cut from.

        Parameters
        ----------
        x, y : (n,), mm, on the surface.

        Returns
        -------
        on_plane : (n, 2), mm, as `on_plane_over` finds them.
        traced : the rays there.
        """
        sheet = self.untrimmed.reflector.surface.sheet
        if sheet is None:
            on_plane = self.on_plane_over(x, y)
            return on_plane, self.untrimmed.trace_points(on_plane)
        # Where the rays meet the sheet is known: nothing is searched.
        at = np.stack([x, y], axis=1)
        surface = surface_points(sheet, at)
        on_sheet = (surface[:, :2] == at).all(axis=1)
        direct = eye_rays.rays_to(sheet, self.posed, surface[on_sheet])
        if direct is None:
            on_plane = self.on_plane_over(x, y)
            return on_plane, self.untrimmed.trace_points(on_plane)
        if on_sheet.all():
            return direct[0], TracedRays(np.zeros(len(at), dtype=np.int8), *direct[1:], surface[:, :3])
        status = np.where(on_sheet, Status.REFLECTED, Status.MISSED).astype(np.int8)
        on_plane, points, directions, on_mirror = (np.full((len(at), c), np.nan) for c in (2, 3, 3, 3))
        on_plane[on_sheet], points[on_sheet], directions[on_sheet] = direct
        on_mirror[on_sheet] = surface[on_sheet, :3]
        return on_plane, TracedRays(status, points, directions, on_mirror)

    def towards(self, on_plane: Array) -> Array:
        """Compute where things are seen: unit directions in vehicle coordinates from the eye to points of the picture plane.

        Parameters
        ----------
        on_plane : (…, 2), mm.

        Returns
        -------
        (…, 3).
        """
        rays = np.concatenate([on_plane, np.zeros((*on_plane.shape[:-1], 1))], axis=-1) - self.eye_in_mirror
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        return self.pose.directions_to_vehicle(rays)

    def on_plane_of(self, points: Array) -> Array:
        """Project points on the mirror to the picture plane, along the eye's rays.

        Parameters
        ----------
        points : (…, 3), mm, in mirror coordinates.

        Returns
        -------
        (…, 2), mm.
        """
        eye = self.eye_in_mirror
        result: Array = eye[:2] + (points[..., :2] - eye[:2]) * (eye[2] / (eye[2] - points[..., 2]))[..., None]
        return result

    def on_plane_over(self, x: Array, y: Array) -> Array:
        """Find where on the picture plane the eye looks at what reflects at (x, y), without glass before it.

        Parameters
        ----------
        x, y : (n,), mm, on the surface.

        Returns
        -------
        (n, 2), mm; NaN where nothing reflects, neither inside the outline nor on the sheet beyond.
        """
        return self.on_plane_of(self.reflector.surface.points_over(x, y))


def box_of(reflector: Reflector) -> Box:
    """(x_min, x_max, y_min, y_max) of what reflects, mm."""
    return reflector.surface.box


def mirror_grid(view: View, columns: int, rows: int) -> tuple[Array, Array, Array]:
    """Divide the mirror's box into equal cells.

    Parameters
    ----------
    view : the mirror as the eye sees it.   columns, rows : of cells.

    Returns
    -------
    x, y : (columns,) and (rows,), mm, of the cells' middles.
    on_plane : (rows, columns, 2), mm, of the picture plane, through which the eye looks at them; NaN where there is no surface.
    """
    x_min, x_max, y_min, y_max = view.box
    x = x_min + (np.arange(columns) + 0.5) * (x_max - x_min) / columns
    y = y_min + (np.arange(rows) + 0.5) * (y_max - y_min) / rows
    at_x, at_y = np.meshgrid(x, y)
    return x, y, view.on_plane_over(at_x.ravel(), at_y.ravel()).reshape(rows, columns, 2)
