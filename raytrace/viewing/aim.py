"""The yaw and pitch of a mirror at which an eye sees the flank and the horizon where they are wanted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import TraceError
from raytrace.kernels import eye_rays
from raytrace.rays import Status
from raytrace.reflector import Reflector
from raytrace.roots import roots
from raytrace.trace import reflect
from raytrace.viewing.pose import Pose
from raytrace.viewing.view import box_of

Array = NDArray[np.float64]

SOLVED = np.radians(1e-8)  # of the two directions asked for: a hundredth of what an aim is promised to
TILT = 1e-4  # radians: the derivatives by central differences
MAX_STEPS = 30
LONGEST_STEP = np.radians(10.0)
MAX_TURN = np.radians(80.0)  # a mirror turned farther faces the road ahead, or the sky
SPLIT = 65  # places of an interval that is searched for a change of sign


@dataclass(frozen=True, slots=True)
class Aim:
    """What the mirror shows where, as seen by the eye it is aimed for.

    Width and height are those of what reflects, (x, y) on the surface in mirror coordinates.

    Parameters
    ----------
    flank : share of the mirror's width, from its inboard edge outwards, that the host vehicle's flank takes on the row of the
        horizon. The flank ends at the vertical edge at the vehicle's rear.
    horizon : share of the mirror's height, from its lower edge, at which the horizon lies in the middle of the width.
    """

    flank: float
    horizon: float


@dataclass(frozen=True, slots=True)
class RearEdge:
    """The vertical edge at the vehicle's rear that ends its flank.

    Parameters
    ----------
    x_mm, y_mm : where it stands, mm: X rearward, Y to the right.
    """

    x_mm: float
    y_mm: float


def aimed(reflector: Reflector, pose: Pose, eye: Array, edge: RearEdge, wanted: Aim) -> Pose:
    """Turn a mirror so that the eye sees the flank's end and the horizon where they are wanted.

    Two points of the surface, F for the flank and H for the horizon, on one row:
        F = (x_in − flank·width, y_low + horizon·height),   H = (the middle of the width, the same y).
    The eye's ray to F leaves through the rear edge, that to H leaves level. Newton on yaw and pitch with exact rays, from
    where the ray to H leaves straight rearward.

    Parameters
    ----------
    reflector : the mirror, in its own coordinates.
    pose : where it is; its yaw and pitch do not matter.
    eye : (3,), mm, in vehicle coordinates.
    edge : the flank's end.
    wanted : what is to be seen where.

    Returns
    -------
    Pose
        The same with the yaw and pitch that do it, to rounding.

    Raises
    ------
    TraceError
        Where no yaw and pitch is found that does it, where the mirror has no surface at F or H, and for an eye inside of the
        mirror or behind it.
    """
    x_min, x_max, y_min, y_max = box_of(reflector)
    y = y_min + wanted.horizon * (y_max - y_min)
    on_surface = reflector.surface.points_over(np.array([x_max - wanted.flank * (x_max - x_min), 0.5 * (x_min + x_max)]),
                            np.array([y, y]))
    if not np.isfinite(on_surface).all():
        raise TraceError(f"aim: the mirror has no surface at x = {x_max - wanted.flank * (x_max - x_min):.1f} or "
                         f"{0.5 * (x_min + x_max):.1f}, y = {y:.1f} mm, where flank_share = {wanted.flank:g} and "
                         f"horizon_share = {wanted.horizon:g} lie")
    _refuse_eye(pose, eye, on_surface[1], 0.5 * max(x_max - x_min, y_max - y_min))

    def off(turns: Array) -> Array:
        """What is off (m, 2), radians, at turns (m, 2)."""
        turned = [replace(pose, yaw=yaw, pitch=pitch) for yaw, pitch in turns.tolist()]
        beside, rise = _past_edge_and_rise(reflector.untrimmed, turned, eye, edge, on_surface)
        return np.stack([beside[:, 0], rise[:, 1]], axis=1)

    around = TILT * np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    turn = _straight_back(reflector, pose, eye, on_surface[1])
    found = off(turn + around)
    for _ in range(MAX_STEPS):
        now, slopes = found[0], ((found[1::2] - found[2::2]) / (2.0 * TILT)).T
        if not np.isfinite(found).all() or np.linalg.det(slopes) == 0.0:
            break
        step = -np.linalg.solve(slopes, now)
        if np.abs(now).max() <= SOLVED:  # and one step more, to rounding: no figure is to hang on where Newton ends
            return replace(pose, yaw=float(turn[0] + step[0]), pitch=float(turn[1] + step[1]))
        step *= min(1.0, LONGEST_STEP / np.abs(step).max())
        while not np.isfinite((found := off(turn + step + around))[0]).all() and np.abs(step).max() > SOLVED:
            step *= 0.5
        turn = turn + step
        if np.abs(turn).max() > MAX_TURN:
            break
    raise TraceError(f"aim: no yaw and pitch shows the host vehicle's flank on {100 * wanted.flank:g} % of the width with "
                     f"the horizon at {100 * wanted.horizon:g} % of the height: the search ended at yaw "
                     f"{np.degrees(turn[0]):.1f}°, pitch {np.degrees(turn[1]):.1f}°. Check the eye's place, the mirror's "
                     "centre, hand and the vehicle's width")


def _refuse_eye(pose: Pose, eye: Array, place: Array, half_size: float) -> None:
    """Refuse an eye in the mirror, and one that is ahead of it, to which it cannot show what lies behind."""
    back = eye - replace(pose, yaw=0.0, pitch=0.0).to_vehicle(place)
    apart = float(np.linalg.norm(back))
    if apart < half_size:
        raise TraceError(f"aim: the eye is inside the mirror or touches it, {apart:.0f} mm from its middle: check the eye's "
                         "place and the mirror's centre")
    if back[0] <= 0.0:
        raise TraceError(f"aim: the eye is {-back[0]:.0f} mm ahead of the mirror, which can then show it nothing that lies "
                         "behind: the mirror's centre must be ahead of the eyes (a smaller X)")


def shown_aim(reflector: Reflector, pose: Pose, eye: Array, edge: RearEdge) -> Aim:
    """Find where the eye sees the end of the flank and the horizon in a posed mirror.

    Parameters
    ----------
    reflector : the mirror, in its own coordinates.
    pose : where it is on the vehicle, and how it is turned.
    eye : (3,), mm, in vehicle coordinates.
    edge : the flank's end.

    Returns
    -------
    Aim
        NaN for what the mirror does not show.
    """
    x_min, x_max, y_min, y_max = box_of(reflector)

    def at(x: Array | float, y: Array | float) -> tuple[Array, Array]:
        on_surface = reflector.surface.points_over(*np.broadcast_arrays(np.asarray(x, dtype=np.float64), y))
        past, rise = _past_edge_and_rise(reflector.untrimmed, [pose], eye, edge, on_surface)
        return past[0], rise[0]

    row = _root(lambda y: at(0.5 * (x_min + x_max), y)[1], y_min, y_max)
    column = _root(lambda x: at(x, row)[0], x_min, x_max)
    return Aim((x_max - column) / (x_max - x_min), (row - y_min) / (y_max - y_min))


def _past_edge_and_rise(sheet: Reflector, poses: Sequence[Pose], eye: Array, edge: RearEdge, on_surface: Array,
                        ) -> tuple[Array, Array]:
    """How the rays from the eye to points (n, 3) of the surface leave in each of m poses: past the rear edge, in plan, and up.

    Two angles, radians, (m, n), NaN where a ray is not reflected or goes forward.
    """
    m, n = len(poses), len(on_surface)
    rotations, offsets = np.stack([pose.rotation for pose in poses]), np.stack([pose.offset for pose in poses])
    eyes = np.einsum("mji,mj->mi", rotations, eye - offsets)
    graph = sheet.surface.sheet
    if graph is not None and (eyes[:, 2] > graph.field.top).all():
        share = (eyes[:, 2:] / (eyes[:, 2:] - on_surface[:, 2]))[:, :, None]
        through = eyes[:, None, :2] + (on_surface[:, :2] - eyes[:, None, :2]) * share
        status, points, directions, _ = eye_rays.trace(graph, eye_rays.Posed(eyes, rotations, offsets), through.reshape(-1, 2),
                                                 np.repeat(np.arange(m), n))
    else:
        traces = [reflect(sheet, at, np.nan_to_num(on_surface, nan=np.inf) - at) for at in eyes]
        status = np.concatenate([trace.status for trace in traces])
        points, directions = (np.concatenate([to(one) for to, one in pairs]) for pairs in (
            [(pose.to_vehicle, trace.points) for pose, trace in zip(poses, traces, strict=True)],
            [(pose.directions_to_vehicle, trace.directions) for pose, trace in zip(poses, traces, strict=True)]))
    with np.errstate(invalid="ignore"):
        seen = (status == Status.REFLECTED) & (directions[:, 0] > 0.0) & (points[:, 0] < edge.x_mm)
        to_edge = np.arctan2(edge.y_mm - points[:, 1], edge.x_mm - points[:, 0])
        past = np.arctan2(directions[:, 1], directions[:, 0]) - to_edge
        rise = np.arcsin(directions[:, 2])
    return np.where(seen, past, np.nan).reshape(m, n), np.where(seen, rise, np.nan).reshape(m, n)


def _straight_back(reflector: Reflector, pose: Pose, eye: Array, place: Array) -> Array:
    """Yaw and pitch, about, at which the normal at a point (3,) of the surface halves the angle from the eye to rearward."""
    normal = reflect(reflector.uncoated.untrimmed, place + np.array([0.0, 0.0, 10.0]), np.array([[0.0, 0.0, -1.0]])).normals[0]
    if not np.isfinite(normal).all():
        normal = np.array([0.0, 0.0, 1.0])
    to_eye = eye - replace(pose, yaw=0.0, pitch=0.0).to_vehicle(place)
    middle = to_eye / np.linalg.norm(to_eye) + np.array([1.0, 0.0, 0.0])
    inboard = 1.0 if pose.hand == "left" else -1.0  # a positive yaw turns the face towards the vehicle
    yaw = np.arctan2(inboard * middle[1], middle[0]) - np.arctan2(normal[0], normal[2])
    pitch = np.arctan2(middle[2], np.hypot(middle[0], middle[1])) - np.arctan2(normal[1], np.hypot(normal[0], normal[2]))
    return np.array([yaw, pitch])


def _root(function: Callable[[Array], Array], low: float, high: float) -> float:
    """Where a function (n,) -> (n,) changes its sign first between low and high; NaN where it does not."""
    x = np.linspace(low, high, SPLIT)
    values = function(x)
    crossing = np.flatnonzero(values[:-1] * values[1:] <= 0.0)
    if crossing.size == 0:
        return float("nan")
    low, high = x[crossing[0]], x[crossing[0] + 1]
    share = roots(lambda t: function(low + t * (high - low)), values[crossing[:1]], values[crossing[:1] + 1])
    return float(low + share[0] * (high - low))
