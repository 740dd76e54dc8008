"""The part of a lane that neither the mirror nor direct view shows, for both eyes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.outlines import longest_rectangle
from raytrace.measures.asked import NearLane
from raytrace.measures.in_use import MM_PER_M, MirrorInUse, metres
from raytrace.measures.registry import Measure, register, register_family
from raytrace.viewing.vehicle import Eyes, HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.edges import Edges
from raytrace.visibility.intervals import IntervalSet, combined
from raytrace.visibility.plan import ENDLESS_MM, Axis, Polygon, outlines, visible_intervals, visible_on_each

Array = NDArray[np.float64]

GROUP = "Ground and blind zone"

# Of the two eyes' field of vision to either side of where they look: nearly 190° in all (CIE, International Lighting
# Vocabulary, "field of vision").
DIRECT_VIEW = np.radians(95.0)
FROM_MM, TO_MM = -5_000.0, 60_000.0
# Lines across the lane: every 25 mm where blind zones are, then every 200 mm.
LINES_MM = np.concatenate([np.arange(FROM_MM, -1_000.0, 200.0), np.arange(-1_000.0, 8_000.0, 25.0),
                           np.arange(8_000.0, TO_MM + 1.0, 200.0)])
ASIDE_MM = 25.0  # between the places across the lane at which a car is tried
CAR_LENGTH_MM, CAR_WIDTH_MM = 4_500.0, 1_800.0


@dataclass(frozen=True, slots=True, eq=False)
class BlindZone:
    """The part of a lane that is in no view, at one height over the ground.

    Attributes
    ----------
    height_mm : over the ground, mm.
    middle : (k, 2), mm, the intervals of X along the lane's middle.
    length_mm : of all of these, mm.
    area_mm2 : between the lines looked at, mm².
    outlines : closed polygons (n, 2) of (X, Y), mm.
    endless : whether the zone goes on where looking ends, so that length and area are of what is looked at.
    x_mm : (n,), mm, the lines X = const on which it was found.
    spans : its intervals of Y on them, mm.
    """

    height_mm: float
    middle: Array
    length_mm: float
    area_mm2: float
    outlines: tuple[Polygon, ...]
    endless: bool
    x_mm: Array
    spans: IntervalSet


@dataclass(frozen=True, slots=True)
class HiddenCar:
    """Whether a car of one size hides wholly in the blind zones.

    Attributes
    ----------
    length_mm, width_mm : its size, mm.
    hides : whether it does.
    longest_mm : how long the longest of its width is that does, mm.
    """

    length_mm: float
    width_mm: float
    hides: bool
    longest_mm: float


def blind_zone(left: View, right: View, host: HostVehicle | None, lane: NearLane, height_mm: float = 0.0,
               direct_view: float = DIRECT_VIEW) -> BlindZone:
    """Find the points (X, Y, height) of a lane that neither eye sees in the mirror and that are not in direct view.

    Direct view ends at an azimuth from straight ahead, to either side of the middle of the eyes:

        seen directly:   atan2(|Y − Y_e|, X_e − X) ≤ direct_view

    The vehicle's pillars and doors are not looked at. The default, 95°, is half of the field of vision of two eyes that look
    straight ahead; a driver whose eyes turn by 15° and whose head turns by 45°, which SAE J1050 calls easy, looks as far as
    60°, and what he sees beside that is his to state. The lane is looked at from X = −5 to 60 m. The intervals along its
    middle and the vertices of the outlines are exact; the area is the trapezoidal rule over lines 25 mm apart up to 8 m behind
    the eyes and 0.2 m beyond.

    Parameters
    ----------
    left, right : the mirror as the two eyes see it.
    host : what hides; None for nothing.
    lane : beside the host vehicle's.
    height_mm : over the ground, mm.
    direct_view : radians.

    Returns
    -------
    BlindZone

    References
    ----------
    Platzer, The geometry of automotive rearview mirrors: why blind zones exist and strategies to overcome them, SAE 950601
    (1995), for the idea; here both eyes, the host vehicle and the height of what is to be seen count.
    """
    eye = 0.5 * (left.eye + right.eye)
    spans = _blind(left, right, host, 0, LINES_MM, height_mm, (lane.y_min_mm, lane.y_max_mm), eye, direct_view)
    along = blind_along(left, right, host, lane, height_mm, direct_view)
    width = np.bincount(spans.row, spans.high - spans.low, minlength=len(LINES_MM))
    return BlindZone(height_mm, along.of(0), along.total, float(np.trapezoid(width, LINES_MM)), outlines(spans, LINES_MM),
                     bool(width[-1] > 0.0), LINES_MM, spans)


def blind_along(left: View, right: View, host: HostVehicle | None, lane: NearLane, height_mm: float = 0.0,
                direct_view: float = DIRECT_VIEW) -> IntervalSet:
    """Find the intervals of X along a lane's middle in its blind zone.

    Parameters
    ----------
    left, right, host, lane, height_mm, direct_view : as in `blind_zone`.

    Returns
    -------
    IntervalSet
        All on row 0, mm.
    """
    middle = np.array([0.5 * (lane.y_min_mm + lane.y_max_mm)])
    return _blind(left, right, host, 1, middle, height_mm, (FROM_MM, TO_MM), 0.5 * (left.eye + right.eye), direct_view)


def blind_along_each(left: Edges, right: Edges, eyes: Eyes, host: HostVehicle | None, lane: NearLane, height_mm: float = 0.0,
                     direct_view: float = DIRECT_VIEW) -> IntervalSet:
    """Find the intervals of X along a lane's middle that are in its blind zone for each of several turns of a mirror.

    Parameters
    ----------
    left, right : the edges of what either eye sees reflecting, turn by turn.
    eyes : the ocular points.
    host, lane, height_mm, direct_view : as for `blind_zone`.

    Returns
    -------
    IntervalSet
        mm, on rows numbered as the turns.
    """
    rows, at = np.arange(len(left)), 0.5 * (lane.y_min_mm + lane.y_max_mm)
    whole = IntervalSet(rows, np.full(len(rows), FROM_MM), np.full(len(rows), TO_MM))
    in_left, in_right = (visible_on_each(edges, 1, at, height_mm, host, FROM_MM, TO_MM) for edges in (left, right))
    middle = 0.5 * (eyes.left + eyes.right)
    return combined(lambda whole, a, b, c: whole & ~(a | b | c), whole, in_left, in_right,
                    _direct(1, np.full(len(rows), at), middle, direct_view).clipped(FROM_MM, TO_MM))


def hidden_car(zones: tuple[BlindZone, ...], lane: NearLane, length_mm: float = CAR_LENGTH_MM, width_mm: float = CAR_WIDTH_MM,
               ) -> HiddenCar:
    """Find whether a car, a rectangle along the lane, fits into the blind zones at each of the heights looked at.

    Tried 25 mm apart across the lane. Its length is that of the lines X = const on which its width is blind, with
    the ends between two lines interpolated straight where one end of their intervals moves past it; else at most a line's
    distance too short.

    Parameters
    ----------
    zones : of one lane, at one or more heights.
    lane : that lane.
    length_mm, width_mm : of the car, mm.

    Returns
    -------
    HiddenCar
    """
    first = zones[0]
    spans = first.spans
    for zone in zones[1:]:
        spans = combined(lambda a, b: a & b, spans, zone.spans)
    room = lane.y_max_mm - lane.y_min_mm - width_mm
    longest = 0.0
    if room >= 0.0:
        starts = lane.y_min_mm + np.linspace(0.0, room, int(room / ASIDE_MM) + 2)
        longest = longest_rectangle(spans.row, spans.low, spans.high, first.x_mm, lane.y_min_mm, lane.y_max_mm, starts,
                                    width_mm)
    return HiddenCar(length_mm, width_mm, longest >= length_mm, longest)


def _blind(left: View, right: View, host: HostVehicle | None, axis: Axis, values: Array, height_mm: float,
           ends: tuple[float, float], eye: Array, direct_view: float) -> IntervalSet:
    """The parts of lines X or Y = value, between their ends, that no view shows."""
    low, high = ends
    rows = np.arange(len(values))
    lane = IntervalSet(rows, np.full(len(values), low), np.full(len(values), high))
    in_left, in_right = (visible_intervals(edge_of(view), axis, values, height_mm, host, low, high) for view in (left, right))
    return combined(lambda whole, a, b, c: whole & ~(a | b | c), lane, in_left, in_right,
                    _direct(axis, values, eye, direct_view).clipped(low, high))


def _direct(axis: Axis, values: Array, eye: Array, direct_view: float) -> IntervalSet:
    """The parts of lines X or Y = value that are before the limit of direct view: X ≤ X_e − |Y − Y_e|·cot(limit)."""
    rows, cot = np.arange(len(values)), 1.0 / np.tan(direct_view)
    if axis == 1:
        return IntervalSet(rows, np.full(len(values), -ENDLESS_MM), eye[0] - np.abs(values - eye[1]) * cot)
    aside = (eye[0] - values) / cot
    if cot > 0.0:  # a limit below 90°: between two lines that open forwards
        return IntervalSet(rows, eye[1] - aside, eye[1] + aside).clipped(-ENDLESS_MM, ENDLESS_MM)
    aside = np.maximum(aside, 0.0)
    return IntervalSet(np.repeat(rows, 2), np.stack([np.full(len(values), -ENDLESS_MM), eye[1] + aside], axis=1).ravel(),
                 np.stack([eye[1] - aside, np.full(len(values), ENDLESS_MM)], axis=1).ravel())


# --- as measures of a mirror in use ------------------------------------------------------------


def blind_zones_in_use(use: MirrorInUse) -> tuple[BlindZone, ...]:
    """`blind_zone` on the ground and at the height that the scene asks about."""
    there = use.on_vehicle
    return tuple(blind_zone(there.views.left, there.views.right, there.host, there.asked.lane, height, there.asked.direct_view)
                 for height in (0.0, there.asked.hidden_height))


def hidden_in_use(use: MirrorInUse) -> HiddenCar:
    """`hidden_car` in both zones, of the default size."""
    return hidden_car(use.record(blind_zones_in_use), use.on_vehicle.asked.lane)


@register_family
def blind_zones(use: MirrorInUse) -> tuple[Measure, ...]:
    """Make the measures of length and area of the lane beside that is in no view, on the ground and at the scene's height.

    Parameters
    ----------
    use : the mirror; on no vehicle there are none.

    Returns
    -------
    tuple of Measure
        Two for each height, m and m².
    """
    found = []
    for k, height in enumerate(() if use.vehicle is None else (0.0, use.vehicle.asked.hidden_height)):
        where = f"{height / 1e3:g} m high" if height else "on the ground"
        place = f"_at_{height / 1e3:g}_m".replace(".", "_") if height else ""
        found.append(Measure(
            f"blind_length{place}_m", f"lane beside in no view, {where}, length", "m", 2,
            "length of the middle of the lane beside that is seen neither in the mirror, by either eye, nor before the limit "
            "of direct view",
            partial(_length, k), group=GROUP, better="less", at_least=partial(_endless, k)))
        found.append(Measure(
            f"blind_area{place}_m2", f"lane beside in no view, {where}, area", "m²", 2,
            "area of the lane beside, between its lines, that is seen neither in the mirror, by either eye, nor before the "
            "limit of direct view",
            partial(_area, k), group=GROUP, better="less", at_least=partial(_endless, k)))
    return tuple(found)


def _length(k: int, use: MirrorInUse) -> float | None:
    return metres(use.record(blind_zones_in_use)[k].length_mm)


def _area(k: int, use: MirrorInUse) -> float | None:
    return use.record(blind_zones_in_use)[k].area_mm2 / MM_PER_M**2


def _endless(k: int, use: MirrorInUse) -> bool:
    return use.record(blind_zones_in_use)[k].endless


register(Measure("hidden_car_longest_m", "longest car that hides", "m", 2,
                 "length of the longest car, 1.8 m wide, that is wholly in no view, both on the ground and at the height that "
                 "the scene asks about",
                 lambda use: metres(use.record(hidden_in_use).longest_mm), group=GROUP, better="less"))
