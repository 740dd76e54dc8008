"""Fields of view of two eyes: which far directions each, either and both see along the horizon and upright."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mirror_cad.vectors import cross
from raytrace.measures.field_of_view import angle_between
from raytrace.measures.in_use import MirrorInUse
from raytrace.measures.registry import Measure, register
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.edge import Edge
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.image_points import follow_image_points
from raytrace.visibility.occlusion import unhidden
from raytrace.visibility.ray_function import RayFunction

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Interval = tuple[float, float]
Intervals = tuple[Interval, ...]

GRID_SHAPE = 33  # directions of a part that the mirror shows, ends included, between which the vehicle's edges are looked for
FAR_MM = 1e9  # a thousand kilometres: where directions that the host vehicle may hide end

# Of an interval: how far inside a mesh's edge, where no ray may meet a facet, the segment that stands for its end is taken.
INWARD = (1e-6, 1e-5, 1e-4, 1e-3)


@dataclass(frozen=True, slots=True)
class EyeField:
    """What the left and the right eye see along one circle of far directions.

    Attributes
    ----------
    left, right : intervals of angles, degrees, from and to, rising.
    """

    left: Intervals
    right: Intervals

    @property
    def either(self) -> Intervals:
        """The ambinocular field: what one eye sees at least (UN Regulation No. 46, section 12)."""
        return union(self.left + self.right)

    @property
    def both(self) -> Intervals:
        """The binocular field: what both eyes see."""
        shared = ((max(a[0], b[0]), min(a[1], b[1])) for a in self.left for b in self.right)
        return tuple(sorted((low, high) for low, high in shared if low < high))


@dataclass(frozen=True, slots=True)
class EyeFields:
    """What two eyes see in a mirror of what is far away.

    Attributes
    ----------
    horizon : along the horizon, azimuths from straight rearward, positive to the right of the vehicle (+Y).
    horizon_clear : the same without what the host vehicle hides.
    azimuth_deg : the azimuth that is seen from between the eyes in the middle of the mirror's box, degrees; None where the
        mirror has no such middle.
    upright : the elevations at that azimuth; None without one.
    upright_clear : the same without what the host vehicle hides.
    between_edges_deg : of left eye, middle and right eye, degrees: between the rays reflected at the box's two edges, y = 0,
        whatever the pose; None where nothing reflects there.
    """

    horizon: EyeField
    horizon_clear: EyeField
    azimuth_deg: float | None
    upright: EyeField | None
    upright_clear: EyeField | None
    between_edges_deg: tuple[float | None, float | None, float | None]


def union(intervals: Intervals) -> Intervals:
    """The same angles as intervals that do not touch, in their order."""
    merged: list[Interval] = []
    for low, high in sorted(intervals):
        if merged and low <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(high, merged[-1][1]))
        else:
            merged.append((low, high))
    return tuple(merged)


def extent(intervals: Intervals) -> float:
    """The sum of the intervals' lengths, degrees."""
    return sum(high - low for low, high in intervals)


def eye_fields(views: EyeViews, host: HostVehicle | None = None) -> EyeFields:
    """Find the fields of view of both eyes: an eye sees a far direction d where one of its rays leaves the mirror along d.

    The directions of a circle are seen along a curve of the mirror, from where the circle meets the edge of what is shown
    (`raytrace.visibility.edge`) to where it does again: every second part between these directions is seen. Where the host
    vehicle begins to hide is a root along the curve. Both are found on exact rays, to 1e-9° and better where the edge is
    known. It does not hold for a mirror that shows directions twice (`raytrace.visibility.orientation`).

    Parameters
    ----------
    views : of the left eye, of the middle between the eyes, and of the right eye.
    host : what hides; None for nothing.

    Returns
    -------
    EyeFields
    """
    x_min, x_max, y_min, y_max = views.middle.box
    place = views.middle.on_plane_over(np.array([0.5 * (x_min + x_max)]), np.array([0.5 * (y_min + y_max)]))
    ahead = views.middle.untrimmed.trace_points(place).directions[0]
    circles = [_Circle(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))]
    azimuth = None
    if np.isfinite(ahead).all() and np.hypot(ahead[0], ahead[1]) > 0.0:
        level = np.array([ahead[0], ahead[1], 0.0]) / np.hypot(ahead[0], ahead[1])
        circles.append(_Circle(np.array([level[1], -level[0], 0.0]), level))
        azimuth = float(np.degrees(np.arctan2(level[1], level[0])))
    seen = [[_seen(edge_of(view), circle, host) for circle in circles] for view in (views.left, views.right)]
    fields = [EyeField(left[k], right[k]) for left, right in zip(*seen, strict=True) for k in (0, 1)]
    upright, upright_clear = (fields[2], fields[3]) if azimuth is not None else (None, None)
    left_deg, middle_deg, right_deg = (_between_edges(view) for view in (views.left, views.middle, views.right))
    return EyeFields(fields[0], fields[1], azimuth, upright, upright_clear, (left_deg, middle_deg, right_deg))


@dataclass(frozen=True, eq=False)
class _Circle:
    """Directions across a unit normal (3,); angles are counted from `start` (3,) towards normal × start."""

    normal: Array
    start: Array

    @cached_property
    def quarter(self) -> Array:
        """The direction (3,) at 90°."""
        return cross(self.normal, self.start)

    def angles(self, directions: Array) -> Array:
        result: Array = np.arctan2(directions @ self.quarter, directions @ self.start)
        return result

    def directions(self, angles: Array) -> Array:
        result: Array = np.cos(angles)[:, None] * self.start + np.sin(angles)[:, None] * self.quarter
        return result


def _seen(edge: Edge, circle: _Circle, host: HostVehicle | None) -> tuple[Intervals, Intervals]:
    """The intervals of a circle that the mirror shows, and those of them that the host vehicle does not hide."""
    if len(edge.on_plane) == 0:
        return (), ()
    _, on_plane, traced = edge.crossings(RayFunction.of(direction=circle.normal))
    # Counted from the middle of what is shown, so that no interval runs over ±180° but one of what shows that too.
    ahead = edge.middle
    middle = float(circle.angles(ahead[None])[0])
    angle = np.mod(circle.angles(traced.directions) - middle + np.pi, 2.0 * np.pi) - np.pi + middle
    if edge.shows_more_than_half:
        behind, shown = edge.image_points(circle.directions(np.array([middle + np.pi])), at_infinity=True)
        if shown[0]:
            angle = np.concatenate([angle, [middle - np.pi, middle + np.pi]])
            on_plane = np.concatenate([on_plane, behind, behind])
    if len(on_plane) == 0:
        return (), ()
    order = np.argsort(angle)
    low, high = order[::2], order[1::2]
    bare = _intervals(angle[low], angle[high])
    if host is None:
        return bare, bare
    parts = [_unhidden(edge.view, circle, host, angle[[i, j]], on_plane[[i, j]]) for i, j in zip(low, high, strict=True)]
    return bare, _intervals(*np.concatenate(parts, axis=1))


def _unhidden(view: View, circle: _Circle, host: HostVehicle, ends: Array, at: Array) -> Array:
    """The parts (2, k) of an interval of a circle that the vehicle does not hide; its ends (2,) are seen at places (2, 2)."""
    def segments(angle: Array, starts: Array) -> tuple[Array, Array, Array]:
        """Places that show directions (n,), where their rays leave the mirror, and how far these reach."""
        wanted = circle.directions(angle)
        on_plane, points = follow_image_points(view, starts, wanted, at_infinity=True)
        return on_plane, points, points + FAR_MM * wanted

    share = np.linspace(0.0, 1.0, GRID_SHAPE)
    angle = ends[0] + (ends[1] - ends[0]) * share
    on_plane, starts, stops = segments(angle, at[0] + share[:, None] * (at[1] - at[0]))
    for end in (0, -1):
        for inward in INWARD:
            if np.isfinite(starts[end]).all():
                break
            near = np.array([abs(share[end] - inward)])
            beside = segments(ends[0] + (ends[1] - ends[0]) * near, at[0] + near[:, None] * (at[1] - at[0]))
            on_plane[end], starts[end], stops[end] = (each[0] for each in beside)
    known = np.isfinite(starts).all(axis=1)  # not where a mesh ends beside a place
    angle, on_plane, starts, stops = angle[known], on_plane[known], starts[known], stops[known]

    def rays(cell: Index, share: Array) -> tuple[Array, Array]:
        _, start, stop = segments(angle[cell] + share * (angle[cell + 1] - angle[cell]),
                                  on_plane[cell] + share[:, None] * (on_plane[cell + 1] - on_plane[cell]))
        return start, stop

    found = unhidden(host, np.zeros(len(angle), dtype=np.intp), angle, (starts, stops), rays)
    return np.stack([found.low, found.high])


def _intervals(low: Array, high: Array) -> Intervals:
    """Angles in radians as intervals of degrees."""
    return union(tuple(zip(np.degrees(low).tolist(), np.degrees(high).tolist(), strict=True)))


def _between_edges(view: View) -> float | None:
    """The contract's traced H-FOV: between the rays reflected at the box's edges, y = 0, degrees."""
    x, y = np.array(view.box[:2]), np.zeros(2)
    surface = view.reflector.surface
    inward = surface.edge_inset * (x[1] - x[0])
    _, out = surface.reflected_at(view.eye_in_mirror, x + [inward, -inward], y)
    return float(np.degrees(angle_between(out[0], out[1]))) if np.isfinite(out).all() else None


def fields_in_use(use: MirrorInUse) -> EyeFields:
    """`eye_fields` of a mirror in use."""
    return eye_fields(use.on_vehicle.views, use.on_vehicle.host)


def _upright(use: MirrorInUse) -> float | None:
    field = use.record(fields_in_use).upright_clear
    return None if field is None else extent(field.either)


register(Measure("h_fov_between_edges_deg", "between the edges", "°", 2,
                 "angle between the rays reflected at the mirror's two edges, y = 0, for an eye between the two",
                 lambda use: use.record(fields_in_use).between_edges_deg[1], group="Field of view", better="more"))
register(Measure("horizon_left_deg", "horizon, left eye", "°", 2,
                 "azimuths of the horizon that the left eye sees beside the host vehicle",
                 lambda use: extent(use.record(fields_in_use).horizon_clear.left), group="Field of view", better="more"))
register(Measure("horizon_right_deg", "horizon, right eye", "°", 2,
                 "azimuths of the horizon that the right eye sees beside the host vehicle",
                 lambda use: extent(use.record(fields_in_use).horizon_clear.right), group="Field of view", better="more"))
register(Measure("horizon_either_deg", "horizon, either eye (ambinocular)", "°", 2,
                 "azimuths of the horizon that at least one eye sees beside the host vehicle",
                 lambda use: extent(use.record(fields_in_use).horizon_clear.either), group="Field of view", better="more"))
register(Measure("horizon_both_deg", "horizon, both eyes (binocular)", "°", 2,
                 "azimuths of the horizon that both eyes see beside the host vehicle",
                 lambda use: extent(use.record(fields_in_use).horizon_clear.both), group="Field of view", better="more"))
register(Measure("upright_either_deg", "upright, either eye", "°", 2,
                 "elevations shown at the azimuth of the mirror's middle, beside the host vehicle", _upright,
                 group="Field of view", better="more"))
