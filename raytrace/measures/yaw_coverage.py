"""What a mirror shows at each of several yaw angles: what a dynamic mirror gains."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import TraceError
from raytrace.measures.asked import NearLane
from raytrace.measures.blind_zone import DIRECT_VIEW, TO_MM, blind_along_each
from raytrace.measures.ground import side_of
from raytrace.reflector import Reflector
from raytrace.viewing.pose import Pose
from raytrace.viewing.vehicle import Eyes, HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.edges import Edges
from raytrace.visibility.orientation import orientation
from raytrace.visibility.ray_function import LEVEL

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class YawCoverage:
    """What a mirror shows at each of n turns about its vertical.

    Azimuth and length are NaN where the mirror shows no horizon, where an eye does not see its face, and where it shows some
    things twice (`raytrace.visibility.orientation`).

    Attributes
    ----------
    turns : (n,), radians, beside the pose's own yaw.
    azimuth_from, azimuth_to : (n,), radians, from and to which the horizon's row shows.
    blind_mm : (n,), mm, the length of the lane's blind zone along its middle.
    endless : (n,), whether that zone goes on where looking ends.
    """

    turns: Array
    azimuth_from: Array
    azimuth_to: Array
    blind_mm: Array
    endless: NDArray[np.bool_]


def yaw_coverage(reflector: Reflector, pose: Pose, eyes: Eyes, host: HostVehicle | None, lane: NearLane, turns: Array,
                 height_mm: float = 0.0, direct_view: float = DIRECT_VIEW) -> YawCoverage:
    """Find what a mirror shows when its yaw is that of the pose plus each of several turns.

    Azimuths are those of level rays that leave the mirror's edge, as the middle between the eyes sees it: 0 straight ahead,
    90° to the mirror's side, 180° straight back; the host vehicle hides nothing. A positive turn turns the mirror's face
    towards the vehicle. The blind zone is that of both eyes, along the lane's middle (`raytrace.measures.blind_zone`).

    Parameters
    ----------
    reflector : the mirror, in its own coordinates.
    pose : where it is on the vehicle, and how it is turned at the turn 0.
    eyes : the ocular points.
    host : what hides; None for nothing.
    lane : beside the host vehicle's.
    turns : (n,), radians.
    height_mm : over the ground, mm, at which the blind zone is looked for.
    direct_view : radians from straight ahead, where direct view ends.

    Returns
    -------
    YawCoverage
    """
    looks: list[tuple[int, tuple[View, View, View]]] = []
    may_fold = True
    for k, turn in enumerate(turns):
        turned = replace(pose, yaw=pose.yaw + float(turn))
        try:
            middle, left, right = (View(reflector, turned, eye) for eye in (eyes.middle, eyes.left, eyes.right))
        except TraceError:
            continue  # an eye is behind the mirror's face
        if may_fold:
            shown = orientation(middle)
            may_fold = shown.converging  # what is nowhere concave does not become so by being turned
            if shown.twice:
                continue
        looks.append((k, (middle, left, right)))
    found, endless = np.full((len(turns), 3), np.nan), np.zeros(len(turns), dtype=np.bool_)
    if not looks:
        return YawCoverage(turns, found[:, 0], found[:, 1], found[:, 2], endless)
    at = np.array([k for k, _ in looks])
    middles, lefts, rights = (Edges.of([views[c] for _, views in looks]) for c in (0, 1, 2))
    of, _, _, level = middles.crossings(LEVEL)
    azimuth = np.mod(np.arctan2(side_of(looks[0][1][0]) * level[:, 1], -level[:, 0]), 2.0 * np.pi)
    for j, k in enumerate(at):
        if (of == j).any():
            found[k, :2] = azimuth[of == j].min(), azimuth[of == j].max()
    blind = blind_along_each(lefts, rights, eyes, host, lane, height_mm, direct_view)
    found[at, 2] = np.bincount(blind.row, blind.high - blind.low, minlength=len(at))
    endless[at[np.unique(blind.row[blind.high >= TO_MM])]] = True
    return YawCoverage(turns, found[:, 0], found[:, 1], found[:, 2], endless)
