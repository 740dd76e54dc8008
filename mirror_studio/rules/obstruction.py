"""Flat pieces of a vehicle before and behind a mirror, pillars, headrests and windows: the share of a field that they hide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_studio.rules.ground import RequiredGround
from raytrace.surfaces.trimming import Trimming
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.image_points import image_points

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LINES, PLACES = 160, 80  # across the road, and on each of them: a share is right to some thousandths
FLAT_MM = 5.0  # by which the corners of a piece may be off one plane
UPRIGHT_POWER = 3.0  # of 1/X: what an area of ground far away has of an upright plane across the road
FARTHEST_MM = 1e6  # of a field that goes on to the horizon, projected on such a plane: beyond lies a ten-thousandth of it


@dataclass(frozen=True, eq=False)
class Piece:
    """A flat piece of the vehicle: its corners (n, 3), mm, in order."""

    name: str
    corners: Array

    def meets(self, starts: Array, ends: Array) -> Mask:
        """Whether segments between points (n, 3) pass through it; no for rows that are not numbers."""
        middle = self.corners.mean(axis=0)
        axes = np.linalg.svd(self.corners - middle)[2]
        on_plane = (self.corners - middle) @ axes[:2].T
        before, after = (starts - middle) @ axes[2], (ends - middle) @ axes[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = before / (before - after)
            at = (starts + share[:, None] * (ends - starts) - middle) @ axes[:2].T
        found = np.isfinite(at).all(axis=1) & (share > 0.0) & (share < 1.0)
        found[found] = Trimming.of((on_plane,)).contains(at[found, 0].copy(), at[found, 1].copy())
        return found

    @property
    def off_plane_mm(self) -> float:
        """How far its corners are off one plane."""
        about = self.corners - self.corners.mean(axis=0)
        return float(np.abs(about @ np.linalg.svd(about)[2][2]).max())


@dataclass(frozen=True, eq=False)
class VehicleBody:
    """What of the vehicle hides.

    opaque : pieces that hide from eye to mirror and from mirror to ground.   windows : by which alone rays get out of the
    vehicle's box; without any, a mirror outside has the box in its way, and one inside no body.
    """

    opaque: tuple[Piece, ...] = ()
    windows: tuple[Piece, ...] = ()
    inside: bool = False

    @property
    def plain(self) -> bool:
        """Whether it is the vehicle's box alone."""
        return not self.opaque and not self.windows and not self.inside

    def hides(self, host: HostVehicle, eye: Array, mirror: Array, ground: Array) -> Mask:
        """Whether it stands between the eye (3,) and points of the mirror (n, 3), or between these and points (n, 3)."""
        eyes = np.broadcast_to(eye, mirror.shape)
        found = np.zeros(len(mirror), dtype=np.bool_)
        for piece in self.opaque:
            found |= piece.meets(eyes, mirror) | piece.meets(mirror, ground)
        if self.windows or not self.inside:
            through = np.zeros(len(mirror), dtype=np.bool_)
            for piece in self.windows:
                through |= piece.meets(mirror, ground)
            found |= host.hides(mirror, ground) & ~through
        return found


def obstructed_share(left: View, right: View, required: RequiredGround, host: HostVehicle, body: VehicleBody, upright: bool,
                     up_to_mm: float) -> float:
    """Compute the share of a field that either eye would see in the mirror but for the body, on an even grid of its ground.

    Parameters
    ----------
    left, right : the mirror as the eyes see it.
    required : the field.
    host, body : the vehicle's box, and its pieces.
    upright : whether areas are those of the field projected on an upright plane across the road, from the mirror's place, as
        UN R46 has it of class I; without it those of the ground itself.
    up_to_mm : along the road, of a field that goes on to the horizon; projected, all of it counts.
    """
    first, last = float(required.x[0]), float(required.x[-1])
    if required.endless:
        last = FARTHEST_MM if upright else first + up_to_mm
    from_mirror = float(left.pose.offset[0])
    near = max(first - from_mirror, 1.0)
    shares = (np.arange(LINES) + 0.5) / LINES
    if upright and near > 1.0:  # evenly on the plane: 1/X runs evenly
        x = from_mirror + 1.0 / (1.0 / near + shares * (1.0 / (last - from_mirror) - 1.0 / near))
        wide = (x - from_mirror) ** 2  # dX of an even step of 1/X
        weight = wide / (x - from_mirror) ** UPRIGHT_POWER
    else:
        x, weight = first + shares * (last - first), np.ones(LINES)
    order = np.argsort(x)
    x, weight = x[order], weight[order]
    spans = required.between(x)
    y = spans.low[:, None] + (spans.high - spans.low)[:, None] * (np.arange(PLACES) + 0.5) / PLACES
    areas = np.repeat(weight[spans.row] * (spans.high - spans.low) / PLACES, PLACES)
    points = np.stack([np.repeat(x[spans.row], PLACES), y.ravel(), np.zeros(y.size)], axis=1)
    free, clear = np.zeros(len(points), dtype=np.bool_), np.zeros(len(points), dtype=np.bool_)
    for view in (left, right):
        places, shown = image_points(view, points)
        seen = view.trace_points(places[shown])
        free |= shown
        eye = view.pose.to_vehicle(view.eye_in_mirror)
        clear[shown] |= ~body.hides(host, eye, seen.points, points[shown])
    return float(areas[free & ~clear].sum() / areas.sum())
