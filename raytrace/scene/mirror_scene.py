"""A lit world, a mirror's pose and what it reflects of the light in; a scene that pictures are taken of out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from raytrace.rays import Trace
from raytrace.viewing.pose import Pose

if TYPE_CHECKING:
    from raytrace.scene.lit_world import LitWorld

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Cones:
    """How much wider a ray's cone leaves the mirror than it came.

    Parameters
    ----------
    box : (x_min, x_max, y_min, y_max), mm, of mirror coordinates.
    factor : (n, m), on a grid over the box, x the first index; linear between, held beyond.
    """

    box: Box
    factor: Array


class Lit(Protocol):
    """What rays see light in."""

    def radiance(self, origins: Array, directions: Array, spread: Array) -> Array:
        """As `LitWorld.radiance`."""


@dataclass(frozen=True, slots=True, eq=False)
class MirrorScene:
    """The world around a vehicle, as its driver sees it in a mirror and directly beside it.

    Rays that the mirror reflects see `world` from where they leave it, dimmed by its reflectance. The others see `beside` from
    the eye: the same world with the mirror's housing, and without the vehicle that the driver sits in.

    Parameters
    ----------
    world, beside : in vehicle coordinates.
    pose : of the mirror on the vehicle.
    reflectance : of the mirror, 0 … 1.
    spread : half the angle between the rays of neighbouring samples, radians: what a ray stands for.
    cones : how much wider a reflected ray's is.
    """

    world: LitWorld
    beside: Lit
    pose: Pose
    reflectance: float
    spread: float
    cones: Cones

    def add_colours(self, trace: Trace, eye: Array, rays: Array, sums: Array, samples: int) -> None:
        """Add the radiance that each ray sees to sums, as `raytrace.image.Scene.add_colours` has it."""
        n = len(rays)
        origins, outgoing, spread = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
        _onward(trace.status, trace.points, trace.directions, eye, rays, self.pose.rotation, self.pose.offset,
                self.spread / np.sqrt(samples), np.array(self.cones.box), self.cones.factor, origins, outgoing, spread)
        for world, share, which in ((self.world, self.reflectance, np.flatnonzero(trace.status == 0)),
                                    (self.beside, 1.0, np.flatnonzero(trace.status != 0))):
            if which.size:
                _add(which, world.radiance(origins[which], outgoing[which], spread[which]), share, sums, samples)

    def to_display(self, means: Array) -> NDArray[np.uint8]:
        """Exposed and developed: see `Daylight.display`."""
        return self.world.daylight.display(means)


@njit(cache=True, nogil=True, error_model="numpy")
def _onward(status, points, directions, eye, rays, rotation, offset, spread, box, factor, origins, outgoing, spreads):
    """Where each ray goes on from, and whither, in vehicle coordinates."""
    nx, ny = factor.shape
    p, d = np.empty(3), np.empty(3)
    for n in range(len(status)):
        if status[n] == 0:
            for c in range(3):
                p[c], d[c] = points[n, c], directions[n, c]
            u = min(max((p[0] - box[0]) / (box[1] - box[0]), 0.0), 1.0) * (nx - 1)
            v = min(max((p[1] - box[2]) / (box[3] - box[2]), 0.0), 1.0) * (ny - 1)
            i, j = min(int(u), nx - 2), min(int(v), ny - 2)
            a, b = u - i, v - j
            spreads[n] = spread * ((1.0 - a) * ((1.0 - b) * factor[i, j] + b * factor[i, j + 1])
                                   + a * ((1.0 - b) * factor[i + 1, j] + b * factor[i + 1, j + 1]))
        else:
            length = np.sqrt(rays[n, 0] ** 2 + rays[n, 1] ** 2 + rays[n, 2] ** 2)
            for c in range(3):
                p[c], d[c] = eye[c], rays[n, c] / length
            spreads[n] = spread
        for c in range(3):
            origins[n, c] = offset[c] + rotation[c, 0] * p[0] + rotation[c, 1] * p[1] + rotation[c, 2] * p[2]
            outgoing[n, c] = rotation[c, 0] * d[0] + rotation[c, 1] * d[1] + rotation[c, 2] * d[2]


@njit(cache=True, nogil=True)
def _add(which, radiance, share, sums, samples):
    for k in range(len(which)):
        for c in range(3):
            sums[which[k] // samples, c] += share * radiance[k, c]
