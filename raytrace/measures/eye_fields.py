"""A mirror seen by two eyes in, which far directions each, either and both see along the horizon and upright, out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.eye_views import EyeViews, picture_grid
from raytrace.measures.field_of_view import GlassSheets, angle_between, reflected_at
from raytrace.measures.magnification import CREASE, places_over
from raytrace.vehicle import OwnVehicle
from raytrace.view import Sight, View

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]
Interval = tuple[float, float]
Intervals = tuple[Interval, ...]

GRID = 65  # rays a direction over the outline, which show where a circle's image runs: 4 mm apart on the paper's mirror
BETWEEN = 10  # parts of the way between two neighbouring places of an image: where all is seen, the image goes on
SPLIT = 32  # parts of a way on which the last ray is searched for; a round leaves one of them
ROUNDS = 6  # from some 10 mm to 1e-8 mm, or 1e-9°
FIRST_TURN = 1e-2  # radians: the second guess of where an image ends
MOST_TURN = 1.2  # radians off an image's own direction within which it ends
MOST_STEPS = 12
ON_CIRCLE = 1e-12  # radians off its circle at which a direction is on it: some rounding of the trace
TOUCHING = 1e-3  # radians off its circle that no search gets below where there is no root; facets are 0.2° apart and more
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


def eye_fields(views: EyeViews, own: OwnVehicle | None = None) -> EyeFields:
    """The fields of view of both eyes: an eye sees a far direction d where one of its rays leaves the mirror along d.

    The directions of a circle are seen along a curve of the mirror. It is found on a grid of rays; each of its ends, on the
    outline or where the own vehicle begins to hide, is the root of the angle off the circle along the edge of what is
    shown, both by exact rays, to some 1e-9°. Parts of a curve shorter than a cell of the grid may be overlooked; where a
    concave mirror turns the curve back within the outline, it ends at the last ray of the grid.
    Without `own` nothing is hidden.
    """
    x_min, x_max, y_min, y_max = views.middle.box
    place = places_over(views.middle, np.array([0.5 * (x_min + x_max)]), np.array([0.5 * (y_min + y_max)]))
    ahead = views.middle.whole.sight(place).directions[0]
    circles = [_Circle(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))]
    azimuth = None
    if np.isfinite(ahead).all() and np.hypot(ahead[0], ahead[1]) > 0.0:
        level = np.array([ahead[0], ahead[1], 0.0]) / np.hypot(ahead[0], ahead[1])
        circles.append(_Circle(np.array([level[1], -level[0], 0.0]), level))
        azimuth = float(np.degrees(np.arctan2(level[1], level[0])))
    left, right = _seen(views.left, circles, own), _seen(views.right, circles, own)
    fields = [EyeField(a, b) for a, b in zip(left, right, strict=True)]
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


@dataclass(frozen=True, slots=True, eq=False)
class _End:
    """A place (2,) where a circle is seen, and the direction (2,) on the picture plane in which its image goes on and ends.

    own : what may hide it, or None.
    """

    place: Array
    outward: Array
    circle: _Circle
    own: OwnVehicle | None


def _seen(view: View, circles: list[_Circle], own: OwnVehicle | None) -> list[Intervals]:
    """For each circle: the intervals that the mirror shows, and those of them that the own vehicle does not hide."""
    places = picture_grid(view, GRID)
    cell = float(np.linalg.norm(places[1, 1] - places[0, 0]))
    sight = view.sight(places.reshape(-1, 2))
    hiding = (None,) if own is None else (None, own)
    shown = [sight.seen & ~_hidden(sight, vehicle) for vehicle in hiding]
    parts = [_image_ends(view, circle, places, sight.directions, shown[k], vehicle, cell)
             for circle in circles for k, vehicle in enumerate(hiding)]
    angles = iter(np.degrees(_outermost(view, [end for part in parts for end in part], 2.0 * cell)).tolist())
    found = []
    for part in parts:
        of_part = [next(angles) for _ in part]
        pairs = tuple((min(pair), max(pair)) for pair in zip(of_part[::2], of_part[1::2], strict=True))
        found += [union(pairs)] * (3 - len(hiding))
    return found


def _hidden(sight: Sight, own: OwnVehicle | None) -> Mask:
    if own is None:
        return np.zeros(len(sight.seen), dtype=np.bool_)
    return own.hides(sight.points, sight.points + FAR_MM * sight.directions)


def _image_ends(view: View, circle: _Circle, places: Array, directions: Array, shown: Mask, own: OwnVehicle | None, cell: float,
                ) -> list[_End]:
    """The two ends of each connected part of a circle's image on the grid of places (GRID, GRID, 2)."""
    grid, mask = directions.reshape(GRID, GRID, 3), shown.reshape(GRID, GRID)
    off = circle.off(grid)
    crossings = []
    for one, other in (((slice(None), slice(0, -1)), (slice(None), slice(1, None))),
                       ((slice(0, -1), slice(None)), (slice(1, None), slice(None)))):
        with np.errstate(invalid="ignore", divide="ignore"):
            cut = (mask[one] & mask[other] & (off[one] * off[other] <= 0.0) & (off[one] != off[other])
                   & _smooth(grid[one], grid[other]))
            share = (off[one] / (off[one] - off[other]))[cut][:, None]
        crossings.append((1.0 - share) * places[one][cut] + share * places[other][cut])
    image = np.concatenate(crossings)
    found = view.sight(image)
    kept = np.flatnonzero(found.seen & ~_hidden(found, own))
    if kept.size == 0:
        return []
    image = image[kept[np.argsort(circle.angles(found.directions[kept]))]]
    along = (np.arange(BETWEEN + 1) / BETWEEN)[:, None]
    between = view.sight((image[:-1, None] + along * (image[1:, None] - image[:-1, None])).reshape(-1, 2))
    ways = between.directions.reshape(-1, BETWEEN + 1, 3)
    goes_on = (between.seen & ~_hidden(between, own)).reshape(-1, BETWEEN + 1).all(axis=1)
    goes_on &= _smooth(ways[:, :-1], ways[:, 1:]).all(axis=1)
    ends = []
    for part in np.split(np.arange(len(image)), np.flatnonzero(~goes_on) + 1):
        for way in (part, part[::-1]):
            # The image's own direction at its end: from the nearest of its places that is half a cell or more away.
            apart = image[way[0]] - image[way]
            length = np.linalg.norm(apart, axis=1)
            base = int(np.argmax(np.minimum(length, 0.5 * cell)))
            if length[base] > 0.0:
                ends.append(_End(image[way[0]], apart[base] / length[base], circle, own))
    return ends


def _smooth(one: Array, other: Array) -> Mask:
    """Whether unit directions (…, 3) leave the same face: they part by less than CREASE."""
    result: Mask = np.einsum("...i,...i->...", one, other) > np.cos(CREASE)
    return result


def _outermost(view: View, ends: list[_End], reach: float) -> Array:
    """The angles (n,), radians, at which the images end that go on outward from the ends.

    From each end, what is shown ends on the way at the angle φ off `outward` with the direction d(φ). The angle between d
    and the circle vanishes where the image itself ends: the root by secants from φ = 0.
    """
    if not ends:
        return np.empty(0)
    base, outward = np.array([end.place for end in ends]), np.array([end.outward for end in ends])
    sideways = np.stack([-outward[:, 1], outward[:, 0]], axis=1)
    normal = np.array([end.circle.normal for end in ends])
    own = next((end.own for end in ends if end.own is not None), None)
    clear = np.flatnonzero([end.own is not None for end in ends])

    def last_seen(phi: Array) -> tuple[Array, Array, Mask]:
        way = np.cos(phi)[:, None] * outward + np.sin(phi)[:, None] * sideways
        directions, ended = _last_directions(view, base, way, reach, clear, own)
        return directions, np.einsum("ij,ij->i", directions, normal), ended

    before, now = np.zeros(len(ends)), np.full(len(ends), FIRST_TURN)
    best, off_before, ended = last_seen(before)
    least = np.abs(off_before)
    for _ in range(MOST_STEPS):
        directions, off, ended = last_seen(now)
        better = np.abs(off) < least
        best[better], least[better] = directions[better], np.abs(off[better])
        if (least <= ON_CIRCLE).all():
            break
        with np.errstate(invalid="ignore", divide="ignore"):
            step = np.nan_to_num(off * (now - before) / (off - off_before), nan=0.0, posinf=0.0, neginf=0.0)
        before, off_before = now, off
        now = np.clip(now - step, -MOST_TURN, MOST_TURN)
    # Where the image only touches the edge or turns back before it there is no root, but its last place on the grid is shown.
    without = (least > TOUCHING) | ~ended
    best[without] = view.sight(base[without]).directions
    return np.array([float(end.circle.angles(way)) for end, way in zip(ends, best, strict=True)])


def _last_directions(view: View, base: Array, way: Array, reach: float, clear: Index, own: OwnVehicle | None,
                     ) -> tuple[Array, Mask]:
    """Directions (n, 3) that are shown last on the ways (n, 2) from places (n, 2); on the rows `clear`, that are not hidden
    either. And whether they are (n,): not where all is shown within `reach`."""
    low, high = np.zeros(len(base)), np.full(len(base), reach)
    last, found = np.empty((len(base), 3)), np.ones(len(base), dtype=np.bool_)
    row = np.arange(len(base))
    for _ in range(ROUNDS):
        at = low[:, None] + (high - low)[:, None] * np.arange(SPLIT + 1) / SPLIT
        sight = view.sight((base[:, None] + at[..., None] * way[:, None]).reshape(-1, 2))
        shown, directions = sight.seen.reshape(-1, SPLIT + 1), sight.directions.reshape(-1, SPLIT + 1, 3)
        if own is not None:
            points = sight.points.reshape(-1, SPLIT + 1, 3)[clear]
            shown[clear] &= ~own.hides(points, points + FAR_MM * directions[clear])
        ended = ~shown[:, 1:] | ~_smooth(directions[:, :-1], directions[:, 1:])
        found &= ended.any(axis=1)
        index = np.where(found, np.argmax(ended, axis=1), SPLIT - 1)
        last = directions[row, index]
        low, high = at[row, index], at[row, index + 1]
    return last, found


def _between_edges(view: View) -> float | None:
    """The contract's traced H-FOV: between the rays reflected at the box's edges, y = 0, degrees."""
    x, y = np.array(view.box[:2]), np.zeros(2)
    glass = view.reflector.glass
    if glass is None:
        # An outline's own upper edge is no longer inside it; where nothing goes on beyond, its points are the file's or, of
        # a mesh, float32's, and beside them a solid's rim is met.
        inward = (EDGE_OF_SHEET if view.reflector.only is not None else EDGE_OF_FACE if view.reflector.mesh is None
                  else EDGE_OF_MESH) * (x[1] - x[0])
        out = view.whole.sight(places_over(view, x + [inward, -inward], y)).directions
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
