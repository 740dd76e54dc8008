"""A mirror seen by two eyes in, which far directions each, either and both see along the horizon and upright, out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.field_of_view import GlassSheets, angle_between, reflected_at
from raytrace.measures.grazing import unhidden
from raytrace.measures.magnification import places_over
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.edge import Edge, edge_of
from raytrace.visibility.plan import brought

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Interval = tuple[float, float]
Intervals = tuple[Interval, ...]

GRID_SHAPE = 33  # directions of a part that the mirror shows, ends included, between which the vehicle's edges are looked for
# How far inside an edge its ray is taken, of the mirror's width: 1e-12 rad of the reflected ray, 1e-7, 1e-5.
EDGE_OF_SHEET, EDGE_OF_FACE, EDGE_OF_MESH = 1e-12, 1e-7, 1e-5
FAR_MM = 1e9  # a thousand kilometres: where directions that the own vehicle may hide end


@dataclass(frozen=True, slots=True)
class EyeField:
    """Angles in degrees, from and to, that the left and the right eye see along one circle of far directions."""

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

    horizon : along the horizon, azimuths from straight rearward, positive to the right of the vehicle (+Y).
    upright : elevations at the azimuth `azimuth_deg`, which is seen from between the eyes in the middle of the mirror's
    box; None where the mirror has no such middle.   horizon_clear, upright_clear : the same without what the own vehicle
    hides.   between_edges_deg : the contract's traced H-FOV of left eye, middle and right eye: between the rays reflected at
    the box's two edges, y = 0, whatever the pose; None where nothing reflects there.
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


def eye_fields(views: EyeViews, own: HostVehicle | None = None) -> EyeFields:
    """The fields of view of both eyes: an eye sees a far direction d where one of its rays leaves the mirror along d.

    The directions of a circle are seen along a curve of the mirror, from where the circle meets the edge of what is shown
    (`raytrace.visibility.edge`) to where it does again: every second part between these directions is seen. Where the own
    vehicle begins to hide is a root along the curve. Both are found on exact rays, to 1e-9° and better where the edge is
    known. Without `own` nothing is hidden. It does not hold for a mirror that shows directions
    twice (`raytrace.visibility.orientation`).
    """
    x_min, x_max, y_min, y_max = views.middle.box
    place = places_over(views.middle, np.array([0.5 * (x_min + x_max)]), np.array([0.5 * (y_min + y_max)]))
    ahead = views.middle.whole.trace(place).directions[0]
    circles = [_Circle(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))]
    azimuth = None
    if np.isfinite(ahead).all() and np.hypot(ahead[0], ahead[1]) > 0.0:
        level = np.array([ahead[0], ahead[1], 0.0]) / np.hypot(ahead[0], ahead[1])
        circles.append(_Circle(np.array([level[1], -level[0], 0.0]), level))
        azimuth = float(np.degrees(np.arctan2(level[1], level[0])))
    seen = [[_seen(edge_of(view), circle, own) for circle in circles] for view in (views.left, views.right)]
    fields = [EyeField(left[k], right[k]) for left, right in zip(*seen, strict=True) for k in (0, 1)]
    upright, upright_clear = (fields[2], fields[3]) if azimuth is not None else (None, None)
    left_deg, middle_deg, right_deg = (_between_edges(view) for view in (views.left, views.middle, views.right))
    return EyeFields(fields[0], fields[1], azimuth, upright, upright_clear, (left_deg, middle_deg, right_deg))


@dataclass(frozen=True, slots=True, eq=False)
class _Circle:
    """Directions across a unit normal (3,); angles are counted from `start` (3,) towards normal × start."""

    normal: Array
    start: Array

    def off(self, directions: Array) -> Array:
        return directions @ self.normal

    def angles(self, directions: Array) -> Array:
        result: Array = np.arctan2(directions @ np.cross(self.normal, self.start), directions @ self.start)
        return result

    def directions(self, angles: Array) -> Array:
        result: Array = (np.cos(angles)[:, None] * self.start
                         + np.sin(angles)[:, None] * np.cross(self.normal, self.start))
        return result


def _seen(edge: Edge, circle: _Circle, own: HostVehicle | None) -> tuple[Intervals, Intervals]:
    """The intervals of a circle that the mirror shows, and those of them that the own vehicle does not hide."""
    if len(edge.places) == 0:
        return (), ()
    _, places, sight = edge.crossings(lambda points, directions: circle.off(directions))
    # Counted from the middle of what is shown, so that no interval runs over ±180° but one of what shows that too.
    ahead = edge.middle()
    middle = float(circle.angles(ahead[None])[0])
    angle = np.mod(circle.angles(sight.directions) - middle + np.pi, 2.0 * np.pi) - np.pi + middle
    if edge.shows_more_than_half(ahead):
        behind, shown = edge.find(circle.directions(np.array([middle + np.pi])), at_infinity=True)
        if shown[0]:
            angle = np.concatenate([angle, [middle - np.pi, middle + np.pi]])
            places = np.concatenate([places, behind, behind])
    if len(places) == 0:
        return (), ()
    order = np.argsort(angle)
    low, high = order[::2], order[1::2]
    bare = _intervals(angle[low], angle[high])
    if own is None:
        return bare, bare
    parts = [_unhidden(edge.view, circle, own, angle[[i, j]], places[[i, j]]) for i, j in zip(low, high, strict=True)]
    return bare, _intervals(*np.concatenate(parts, axis=1))


def _unhidden(view: View, circle: _Circle, own: HostVehicle, ends: Array, at: Array) -> Array:
    """The parts (2, k) of an interval of a circle that the vehicle does not hide; its ends (2,) are seen at places (2, 2)."""
    def segments(angle: Array, starts: Array) -> tuple[Array, Array, Array]:
        """Places that show directions (n,), where their rays leave the mirror, and how far these reach."""
        ways = circle.directions(angle)
        places, points = brought(view, starts, ways, at_infinity=True)
        return places, points, points + FAR_MM * ways

    share = np.linspace(0.0, 1.0, GRID_SHAPE)
    angle = ends[0] + (ends[1] - ends[0]) * share
    places, starts, stops = segments(angle, at[0] + share[:, None] * (at[1] - at[0]))
    known = np.isfinite(starts).all(axis=1)  # not where a mesh ends beside a place
    angle, places, starts, stops = angle[known], places[known], starts[known], stops[known]

    def rays(cell: Index, share: Array) -> tuple[Array, Array]:
        _, start, stop = segments(angle[cell] + share * (angle[cell + 1] - angle[cell]),
                                  places[cell] + share[:, None] * (places[cell + 1] - places[cell]))
        return start, stop

    found = unhidden(own, np.zeros(len(angle), dtype=np.intp), angle, (starts, stops), rays)
    return np.stack([found.low, found.high])


def _intervals(low: Array, high: Array) -> Intervals:
    """Angles in radians as intervals of degrees."""
    return union(tuple(zip(np.degrees(low).tolist(), np.degrees(high).tolist(), strict=True)))


def _between_edges(view: View) -> float | None:
    """The contract's traced H-FOV: between the rays reflected at the box's edges, y = 0, degrees."""
    x, y = np.array(view.box[:2]), np.zeros(2)
    glass = view.reflector.glass
    if glass is None:
        # An outline's own upper edge is no longer inside it; where nothing goes on beyond, its points are the file's or, of
        # a mesh, float32's, and beside them a solid's rim is met.
        inward = (EDGE_OF_SHEET if view.reflector.only is not None else EDGE_OF_FACE if view.reflector.mesh is None
                  else EDGE_OF_MESH) * (x[1] - x[0])
        out = view.whole.trace(places_over(view, x + [inward, -inward], y)).directions
    else:
        sheets = GlassSheets.before(view.reflector)
        if sheets is None:
            return None
        back = sheets.back.surface
        u_min, u_max, v_min, v_max = back.domain
        if not (u_min <= x[0] and x[1] <= u_max and v_min <= 0.0 <= v_max):
            return None
        if np.abs(back.evaluate(x, y)[:, :2] - np.stack([x, y], axis=1)).max() > 1e-6:
            return None
        _, out = reflected_at(sheets, view.eye_in_mirror, x, y)
    return float(np.degrees(angle_between(out[0], out[1]))) if np.isfinite(out).all() else None
