"""A mirror on a vehicle and one ocular point in; what it shows where, and where it shows a point of the world, out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from raytrace.errors import TraceError
from raytrace.rays import Status
from raytrace.reflector import Reflector
from raytrace.surfaces.base import Box
from raytrace.trace import reflect
from raytrace.viewing.eye import EYE_DISTANCE_MM, eye_position
from raytrace.viewing.pose import Pose

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Newton is done when the reflected ray passes its target by less: far above rounding, and 2e-5″.
PASSES_BY = 1e-10
MAX_STEPS = 40
TILT = 2e-3  # of the mirror's width: the differences that Newton's derivatives are made of
LONGEST_STEP = 0.25  # of the mirror's width
START_GRID = 33
BEYOND = 0.1  # of the box, on every side: what Newton may start from beside the mirror
STARTS_AT_ONCE = 4_000  # targets: 35 MB of distances to all starts
THICKNESS = 10.0  # mm behind the face that count as inside the mirror
EYE_CLEARANCE = 1e-6  # mm in front of the mirror's foremost point


@dataclass(frozen=True, slots=True, eq=False)
class TracedRays:
    """What n rays from the ocular point meet. In the view's coordinates, mm; rows of rays that are not reflected are NaN.

    status (n,) : what became of each ray, see `Status`.   points, directions (n, 3) : where it leaves the mirror, and in
    which direction.   on_mirror (n, 3) : the same points in mirror coordinates.
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

    Places (…, 2) are those of the picture plane, the mirror's own z = 0, through which the eye's rays go, in mm.

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
    """

    reflector: Reflector
    pose: Pose = field(default_factory=Pose.identity)
    eye: Array = None  # type: ignore[assignment]  # set by __post_init__ where none is given

    def __post_init__(self) -> None:
        if self.eye is None:
            object.__setattr__(self, "eye", self.pose.to_vehicle(eye_position(EYE_DISTANCE_MM, "right", self.box)))
        else:
            object.__setattr__(self, "eye", np.asarray(self.eye, dtype=np.float64))
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
        """What the eye's rays through points of the picture plane z = 0 meet.

        Parameters
        ----------
        x, y : mm, of any shapes that go together; the rays are numbered as their values are in memory.
        """
        at_x, at_y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        return self.trace_places(np.stack([at_x.ravel(), at_y.ravel()], axis=1))

    def trace_places(self, places: Array) -> TracedRays:
        """`trace` through places (n, 2)."""
        rays = np.concatenate([places, np.zeros((len(places), 1))], axis=1) - self.eye_in_mirror
        trace = reflect(self.reflector, self.eye_in_mirror, rays)
        return TracedRays(trace.status, self.pose.to_vehicle(trace.points),
                          self.pose.directions_to_vehicle(trace.directions), trace.points)

    def towards(self, places: Array) -> Array:
        """Unit directions (…, 3) from the eye to places (…, 2), in vehicle coordinates: where things are seen."""
        rays = np.concatenate([places, np.zeros((*places.shape[:-1], 1))], axis=-1) - self.eye_in_mirror
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        return self.pose.directions_to_vehicle(rays)

    def places_of(self, points: Array) -> Array:
        """Places (…, 2) through which the eye sees points (…, 3) on the mirror, in mirror coordinates."""
        eye = self.eye_in_mirror
        result: Array = eye[:2] + (points[..., :2] - eye[:2]) * (eye[2] / (eye[2] - points[..., 2]))[..., None]
        return result

    def places_over(self, x: Array, y: Array) -> Array:
        """Places (n, 2) through which the eye looks at what reflects at (x, y), without glass before it; NaN where nothing
        does, neither inside the outline nor on the sheet beyond."""
        return self.places_of(self.reflector.surface.points_over(x, y))

    @cached_property
    def _starts(self) -> tuple[Array, TracedRays]:
        x_min, x_max, y_min, y_max = self.box
        more_x, more_y = BEYOND * (x_max - x_min), BEYOND * (y_max - y_min)
        x, y = np.meshgrid(np.linspace(x_min - more_x, x_max + more_x, START_GRID),
                           np.linspace(y_min - more_y, y_max + more_y, START_GRID))
        places = self.places_of(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1))
        sight = self.untrimmed.trace_places(places)
        seen = sight.seen
        return places[seen], TracedRays(sight.status[seen], sight.points[seen], sight.directions[seen], sight.on_mirror[seen])

    def find(self, targets: Array, at_infinity: bool = False) -> tuple[Array, Mask]:
        """Where the mirror shows points (n, 3) of the world, or directions (n, 3) of infinitely far ones.

        The place of the picture plane whose reflected ray passes through the target, by Newton on that ray, from the
        nearest of a grid of rays. Where a concave mirror shows a point more than once, one of them.
        Returns: places (n, 2), NaN where the sheet shows it nowhere; and (n,) whether it is shown inside the outline.
        What stands between mirror and target is not looked at.
        """
        places = np.full((len(targets), 2), np.nan)
        if len(targets) == 0:
            return places, np.zeros(0, dtype=np.bool_)
        if len(self._starts[0]) == 0:
            return places, np.zeros(len(targets), dtype=np.bool_)
        wanted = targets / np.linalg.norm(targets, axis=1, keepdims=True) if at_infinity else targets
        places = self.nearest(wanted, at_infinity)
        found = self._newton(places, wanted, at_infinity)
        places[~found] = np.nan
        shown = np.zeros(len(targets), dtype=np.bool_)
        index = np.flatnonzero(found)
        shown[index] = self.trace_places(places[index]).seen
        return places, shown

    def nearest(self, wanted: Array, at_infinity: bool = False) -> Array:
        """The places (n, 2), of a grid over the mirror, whose rays pass nearest to points (n, 3), or leave most nearly along
        unit directions (n, 3): where Newton starts. NaN where the mirror reflects none."""
        places = np.full((len(wanted), 2), np.nan)
        starts, first = self._starts
        for begin in range(0, len(wanted) if len(starts) else 0, STARTS_AT_ONCE):
            part = wanted[begin:begin + STARTS_AT_ONCE]
            # Not by BLAS: its threads would spin beside those that trace.
            alike = np.einsum("ij,kj->ik", part, first.directions) if at_infinity else _alike(part, first)
            places[begin:begin + STARTS_AT_ONCE] = starts[np.argmax(alike, axis=1)]
        return places

    def _newton(self, places: Array, wanted: Array, at_infinity: bool) -> Mask:
        """Move places until their rays pass through what is wanted; returns where they do."""
        size = self.box[1] - self.box[0]
        step = TILT * size
        shifts = np.array([[0.0, 0.0], [step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]])
        found = np.zeros(len(places), dtype=np.bool_)
        going = np.arange(len(places))
        best = np.full(len(places), np.inf)
        kept, last = places.copy(), np.zeros_like(places)
        for _ in range(MAX_STEPS):
            n = len(going)
            if n == 0:
                break
            asked = (places[going, None] + shifts).reshape(-1, 2)
            missed = self._misses(asked, np.repeat(wanted[going], 5, axis=0), at_infinity).reshape(n, 5, 2)
            now = np.linalg.norm(missed[:, 0], axis=1)
            better = now < best[going]  # not where it is NaN
            best[going[better]] = now[better]
            kept[going[better]] = places[going[better]]
            found[going] = best[going] <= PASSES_BY
            a, b = (_slope(missed[:, 0], missed[:, k], missed[:, k + 1], step) for k in (1, 3))
            with np.errstate(divide="ignore", invalid="ignore"):
                determinant = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
                move = -np.stack([missed[:, 0, 0] * b[:, 1] - missed[:, 0, 1] * b[:, 0],
                                  a[:, 0] * missed[:, 0, 1] - a[:, 1] * missed[:, 0, 0]], axis=1) / determinant[:, None]
                move *= np.minimum(1.0, LONGEST_STEP * size / np.linalg.norm(move, axis=1))[:, None]
            good = better & np.isfinite(move).all(axis=1)
            last[going] = np.where(good[:, None], move, 0.5 * last[going])  # not better: half the step before, from there
            places[going] = kept[going] + last[going]
            going = going[~found[going] & (np.linalg.norm(last[going], axis=1) > 1e-12 * size)]
        places[:] = kept
        return found

    def _misses(self, places: Array, wanted: Array, at_infinity: bool) -> Array:
        """By what angles, about, the rays through places pass their targets: (n, 2), NaN where they are not reflected."""
        sight = self.untrimmed.trace_places(places)
        towards = wanted if at_infinity else wanted - sight.points
        with np.errstate(invalid="ignore"):
            towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
            # Two directions across the target's, from an axis that is the same for all rays to one target.
            far = wanted if at_infinity else wanted - self.eye
            side = np.cross(towards, np.eye(3)[np.argmin(np.abs(far), axis=1)])
            side /= np.linalg.norm(side, axis=1, keepdims=True)
            up = np.cross(towards, side)
            result = np.stack([np.einsum("ij,ij->i", sight.directions, side), np.einsum("ij,ij->i", sight.directions, up)],
                              axis=1)
            result[np.einsum("ij,ij->i", sight.directions, towards) <= 0.0] = np.nan
        return result


def _slope(here: Array, after: Array, before: Array, step: float) -> Array:
    """Derivatives (n, 2) by central differences, or to the one side on which there is a value."""
    slope = (after - before) / (2.0 * step)
    slope = np.where(np.isfinite(slope), slope, (after - here) / step)
    return np.where(np.isfinite(slope), slope, (here - before) / step)


def box_of(reflector: Reflector) -> Box:
    """(x_min, x_max, y_min, y_max) of what reflects, mm."""
    low, high = reflector.bounds
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _alike(points: Array, first: TracedRays) -> Array:
    """Cosines (n, m) between the rays that start and what each point is seen at from where they start."""
    apart = points[:, None, :] - first.points[None, :, :]
    length = np.sqrt(np.einsum("ijk,ijk->ij", apart, apart))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(np.einsum("ijk,jk->ij", apart, first.directions) / length, nan=-1.0)
