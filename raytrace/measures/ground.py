"""The ground that a mirror shows two eyes beside the host vehicle, in plan."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.in_use import MirrorInUse, finite, metres
from raytrace.measures.registry import Measure, register, register_family
from raytrace.viewing.aim import Aim, shown_aim
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import Mask, View, box_of
from raytrace.visibility.edge import Edge
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.intervals import IntervalSet, intersection, union
from raytrace.visibility.plan import Polygon, outlines, visible_intervals
from raytrace.visibility.ray_function import LEVEL, RayFunction

Array = NDArray[np.float64]

WIDTHS_AT_MM = (4_000.0, 10_000.0, 20_000.0, 30_000.0)  # 4, 20 and 30 m are where UN Regulation 46 asks for a width
BESIDE_MM = 100.0  # the middle of a strip of 0.2 m beside the flank
FINE_MM, FINE_UP_TO_MM = 100.0, 5_000.0  # lines of the outlines: near the vehicle they bend
TIP_MM = 1e-3  # from an outline's tip to its first line
TOUCHING_MM = 1e-3  # what begins this near to the flank's plane begins at it


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A grid of points of the ground.

    Parameters
    ----------
    x_mm, y_mm : (r,) and (c,), mm, rising and even, two or more of each.
    """

    x_mm: Array
    y_mm: Array

    @staticmethod
    def beside(side: float, cell_mm: float = 400.0) -> Plan:
        """The middles of cells over 0 ≤ X ≤ 60 m and, for the left side, −25 ≤ Y ≤ 3 m, for the right its reflection.

        Parameters
        ----------
        side : −1 for left, 1 for right.
        cell_mm : the side of a cell, mm.

        Returns
        -------
        Plan
        """
        y = np.arange(-25_000.0 + 0.5 * cell_mm, 3_000.0, cell_mm)
        return Plan(np.arange(0.5 * cell_mm, 60_000.0, cell_mm), y if side < 0.0 else -y[::-1])


@dataclass(frozen=True, slots=True, eq=False)
class SeenGround:
    """What of a plan one eye or two together see.

    Attributes
    ----------
    mask : (r, c), of the plan's points.
    outlines : closed polygons (n, 2) of (X, Y), mm.
    """

    mask: Mask
    outlines: tuple[Polygon, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The ground (X, Y, 0) that the two eyes see in a mirror.

    Attributes
    ----------
    plan : whose points were decided.
    left, right : what each eye sees.
    either : what one or the other sees, the ambinocular field.
    both : what one and the other see, the binocular field.
    """

    plan: Plan
    left: SeenGround
    right: SeenGround
    either: SeenGround
    both: SeenGround


@dataclass(frozen=True, slots=True, eq=False)
class SeenWidth:
    """The ground that is seen across the road, at one distance behind the ocular points.

    Attributes
    ----------
    x_mm : that distance, mm.
    either, both : (k, 2), mm, the intervals of Y seen by either eye, and by both.
    either_mm, both_mm : how wide that is outward of the plane of the flank, mm, from that plane on and without a gap; 0 where
        the ground beside it is not seen.
    """

    x_mm: float
    either: Array
    both: Array
    either_mm: float
    both_mm: float


@dataclass(frozen=True, slots=True)
class HorizonMargin:
    """How the horizon lies in the mirror, for one eye; NaN and False where the middle does not show the horizon.

    Attributes
    ----------
    height : the share of the mirror's height, in the middle of its width, that is above the horizon.
    angle : how far above the horizon the mirror shows there, radians: the elevation of the ray at the upper edge.
    whole : whether the horizon's row runs through the mirror from one side to the other: it crosses the edge twice, each time
        where this is steeper than 45°.
    aim : the flank's share of the width and the horizon's place in the height as an aim asks for them (`shown_aim`).
    """

    height: float
    angle: float
    whole: bool
    aim: Aim


def seen_ground(left: View, right: View, host: HostVehicle | None = None, plan: Plan | None = None) -> Ground:
    """Find the points of the ground that a mirror shows the left and the right eye, and the host vehicle does not hide.

    A point (X, Y, 0) is seen by an eye if the ray from the eye that the mirror reflects through it meets the mirror inside
    its outline, and the segment from there to the point does not pass the vehicle's box. Nothing else is looked at: no pillar
    or window before the mirror, no other vehicle. The plan's points are decided exactly; exact are also the vertices of
    the outlines, which lie on lines X = const through those points, every 0.1 m up to 5 m, and at their tips.

    Parameters
    ----------
    left, right : the mirror as the two eyes see it.
    host : what hides; None for nothing.
    plan : the points; by default those beside the vehicle on the mirror's side.

    Returns
    -------
    Ground

    References
    ----------
    UN Regulation 46, paragraph 12, for the terms (ambinocular vision, ocular points 65 mm apart).
    """
    plan = plan or Plan.beside(side_of(left))
    (x_low, x_high), (y_low, y_high) = _bounds(plan.x_mm), _bounds(plan.y_mm)
    edges = edge_of(left), edge_of(right)
    x = np.unique(np.concatenate([plan.x_mm, _lines(edges, host, x_low, x_high)]))
    cells = np.searchsorted(x, plan.x_mm)
    seen = [visible_intervals(edge, 0, x, 0.0, host, y_low, y_high) for edge in edges]

    def of(spans: IntervalSet) -> SeenGround:
        return SeenGround(spans.mask(len(x), plan.y_mm)[cells], outlines(spans, x))

    return Ground(plan, of(seen[0]), of(seen[1]), of(union(*seen)), of(intersection(*seen)))


def seen_widths(left: View, right: View, host: HostVehicle, at_mm: tuple[float, ...] = WIDTHS_AT_MM) -> tuple[SeenWidth, ...]:
    """Find where across the road the ground is seen at distances behind the ocular points, without what the vehicle hides.

    Exact: an end is where a ray through the mirror's edge, or one that touches the vehicle, meets the ground.

    Parameters
    ----------
    left, right : the mirror as the two eyes see it.
    host : what hides, and whose flank the width counts from.
    at_mm : the distances X, mm.

    Returns
    -------
    tuple of SeenWidth
        One for each distance, rising.

    References
    ----------
    UN Regulation 46, paragraph 15.2.4, asks for such widths outward of the plane through the flank, ambinocular.
    """
    x = np.array(sorted(at_mm))
    seen = [visible_intervals(edge_of(view), 0, x, 0.0, host) for view in (left, right)]
    either, both = union(*seen), intersection(*seen)
    side = side_of(left)
    return tuple(SeenWidth(float(value), either.of(row), both.of(row), _from_flank(either.of(row), host, side),
                           _from_flank(both.of(row), host, side)) for row, value in enumerate(x))


def nearest_at_flank(left: View, right: View, host: HostVehicle, beside_mm: float = BESIDE_MM) -> tuple[float, float]:
    """Find the smallest X at which the ground beside the flank is seen.

    Parameters
    ----------
    left, right : the mirror as the two eyes see it.
    host : what hides, and whose flank it is.
    beside_mm : how far outward of the flank's plane the line on the ground runs that is looked at, mm.

    Returns
    -------
    either, both : by either eye, and by both, mm; NaN where it is not seen.
    """
    y = np.array([side_of(left) * (host.half_width_mm + beside_mm)])
    seen = [visible_intervals(edge_of(view), 1, y, 0.0, host) for view in (left, right)]
    either, both = union(*seen), intersection(*seen)
    return (float(either.low[0]) if len(either.low) else np.nan), (float(both.low[0]) if len(both.low) else np.nan)


def horizon_margin(view: View, host: HostVehicle) -> HorizonMargin:
    """Find how the horizon and the end of the flank lie in the mirror as an eye sees it.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    host : whose flank it is.

    Returns
    -------
    HorizonMargin
    """
    edge = edge_of(view)
    aim = shown_aim(view.reflector, view.pose, view.eye, host.rear_edge(view.pose.hand))
    x_min, x_max, y_min, y_max = box_of(view.reflector)
    middle, across = 0.5 * (x_min + x_max), view.pose.rotation[:, 0]
    _, _, ends = edge.crossings(RayFunction.of(-middle - float(view.pose.offset @ across), point=across))
    k, _, _ = edge.crossings(LEVEL)
    along = np.abs(edge.on_plane[edge.following[k]] - edge.on_plane[k])
    sides = bool((along[:, 1] > along[:, 0]).all())
    if len(ends.points) < 2 or not np.isfinite(aim.horizon):
        return HorizonMargin(np.nan, np.nan, False, aim)
    height = view.pose.to_mirror(ends.points)[:, 1]
    top, bottom = int(np.argmax(height)), int(np.argmin(height))
    row = y_min + aim.horizon * (y_max - y_min)
    if not height[bottom] < row < height[top]:
        return HorizonMargin(np.nan, np.nan, False, aim)
    return HorizonMargin(float((height[top] - row) / (height[top] - height[bottom])),
                         float(np.arcsin(ends.directions[top, 2])), len(k) == 2 and sides, aim)


def side_of(view: View) -> float:
    """−1 for a left-hand mirror, beside which Y is negative, and 1 for a right-hand one."""
    return -1.0 if view.pose.hand == "left" else 1.0


def _bounds(centres: Array) -> tuple[float, float]:
    """From the first cell's start to the last one's end."""
    half = 0.5 * (centres[-1] - centres[0]) / (len(centres) - 1)
    return float(centres[0] - half), float(centres[-1] + half)


def _lines(edges: tuple[Edge, ...], host: HostVehicle | None, low: float, high: float) -> Array:
    """Lines X = const that outlines need beside the cells': closer ones near by, both ends, the vehicle's, and the tips."""
    lines = [np.arange(low, min(high, FINE_UP_TO_MM), FINE_MM), np.array([low, high])]
    if host is not None:
        lines.append(np.array([host.front_mm, host.rear_mm]))
    for edge in edges:
        with np.errstate(divide="ignore", invalid="ignore"):
            x = edge.points[:, 0] - edge.points[:, 2] * edge.directions[:, 0] / edge.directions[:, 2]
        x = np.where(edge.directions[:, 2] < 0.0, x, np.nan)
        after = x[edge.following]
        before = np.empty_like(x)
        before[edge.following] = x
        lines += [x[(x < after) & (x <= before)] + TIP_MM, x[(x > after) & (x >= before)] - TIP_MM]
    every = np.concatenate(lines)
    return every[(every >= low) & (every <= high)]


def _from_flank(intervals: Array, host: HostVehicle, side: float) -> float:
    """How far outward of the flank's plane an interval of Y (k, 2) reaches that begins at it or before, mm."""
    outward = np.sort(side * intervals, axis=1) - host.half_width_mm
    first = outward[(outward[:, 0] <= TOUCHING_MM) & (outward[:, 1] > 0.0)]
    return float(first[0, 1]) if len(first) else 0.0


def aim_in_use(use: MirrorInUse) -> HorizonMargin:
    """`horizon_margin` of a mirror in use, from between the eyes."""
    return horizon_margin(use.on_vehicle.views.middle, use.on_vehicle.host)


def nearest_in_use(use: MirrorInUse) -> tuple[float, float]:
    """`nearest_at_flank` of a mirror in use."""
    there = use.on_vehicle
    return nearest_at_flank(there.views.left, there.views.right, there.host)


def widths_in_use(use: MirrorInUse) -> tuple[SeenWidth, ...]:
    """`seen_widths` of a mirror in use, at the distances that its scene asks about."""
    there = use.on_vehicle
    return seen_widths(there.views.left, there.views.right, there.host, there.asked.widths_at)


register(Measure("yaw_deg", "yaw", "°", 2,
                 "turn of the mirror about the vertical, from facing straight rearward towards the vehicle",
                 lambda use: float(np.degrees(use.on_vehicle.pose.yaw)), group="Aim", local=True))
register(Measure("pitch_deg", "pitch", "°", 2, "turn of the mirror about its own horizontal axis, upwards, after the yaw",
                 lambda use: float(np.degrees(use.on_vehicle.pose.pitch)), group="Aim", local=True))
register(Measure("flank_share", "host vehicle's flank", "of width", 3,
                 "share of the width, from the inboard edge, that the host vehicle's flank takes on the row of the horizon, "
                 "from between the eyes", lambda use: finite(use.record(aim_in_use).aim.flank), group="Aim", local=True))
register(Measure("horizon_share", "horizon", "of height", 3,
                 "share of the height, from the lower edge, at which the horizon lies in the middle of the width",
                 lambda use: finite(use.record(aim_in_use).aim.horizon), group="Aim", local=True))
register(Measure("above_horizon_deg", "shown above the horizon", "°", 2,
                 "elevation of the ray at the upper edge, in the middle of the width",
                 lambda use: finite(np.degrees(use.record(aim_in_use).angle)), group="Aim", local=True))


@register_family
def ground_widths(use: MirrorInUse) -> tuple[Measure, ...]:
    """Make the measures of the width of the ground seen, at each distance that the scene asks about.

    Parameters
    ----------
    use : the mirror; on no vehicle there are none.

    Returns
    -------
    tuple of Measure
        Two for each distance, m: by either eye and by both.
    """
    found = []
    for k, at in enumerate(() if use.vehicle is None else use.vehicle.asked.widths_at):
        for eyes, word in (("either", "by either eye"), ("both", "by both")):
            found.append(Measure(
                f"ground_width_{_distance(at)}_{eyes}_m", f"ground seen {at / 1e3:g} m behind the eyes, {word}", "m", 2,
                "width of the ground seen outward of the plane of the flank, without a gap",
                partial(_width, k, eyes),
                group="Ground and blind zone", better="more"))
    return tuple(found)


def _width(k: int, eyes: str, use: MirrorInUse) -> float | None:
    return metres(getattr(use.record(widths_in_use)[k], f"{eyes}_mm"))


def _distance(at_mm: float) -> str:
    return f"{at_mm / 1e3:g}".replace(".", "_") + "_m"


register(Measure("ground_nearest_m", "nearest ground beside the flank", "m", 2,
                 "smallest distance behind the eyes at which the ground 0.1 m beside the flank is seen by either eye",
                 lambda use: metres(use.record(nearest_in_use)[0]), group="Ground and blind zone", better="less"))
