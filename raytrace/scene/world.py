"""Coloured triangles under one sun in, what reflected rays see of them out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from raytrace.embree import TriangleScene
from raytrace.errors import SceneError
from raytrace.rays import Trace
from raytrace.scene.reference import BACKGROUND, Picture, rounded

Array = NDArray[np.float64]

AMBIENT = 0.4  # of a face's colour where the sun does not reach; the sun, square on, adds the rest
HORIZON, ZENITH = (222.0, 230.0, 238.0), (92.0, 140.0, 205.0)  # the sky's colours
UNIT_TOLERANCE = 1e-9  # of the sun's direction: far above rounding, far below a shade of 1/255


@dataclass(frozen=True, eq=False)
class TriangleWorld:
    """Triangles of one colour each before a sky.

    vertices (n, 3) mm.   faces (m, 3) int32, counter-clockwise seen from outside.   colours (m, 3) uint8.
    sun : unit direction towards it (3,), or None for an unlit world, where each face shows its own colour.
    A face with unit normal n shows colour·(a + (1 − a)·max(n·l, 0)), a = AMBIENT, from both sides; nothing casts a shadow.
    The sky goes from `horizon` to `zenith` in proportion to max(d_y, 0) of the ray's unit direction d.
    Raises: SceneError for arrays of other shapes, vertices or colours that are no such numbers, and a sun that is no unit
    direction.
    """

    vertices: Array
    faces: NDArray[np.int32]
    colours: NDArray[np.uint8]
    sun: tuple[float, float, float] | None = None
    horizon: tuple[float, float, float] = HORIZON
    zenith: tuple[float, float, float] = ZENITH

    def __post_init__(self) -> None:
        if self.colours.shape != self.faces.shape or self.colours.dtype != np.uint8:
            raise SceneError(f"a world of {len(self.faces)} triangles needs uint8 colours of shape ({len(self.faces)}, 3), not "
                             f"{self.colours.dtype} of {self.colours.shape}")
        if self.sun is not None and not abs(np.linalg.norm(self.sun) - 1.0) < UNIT_TOLERANCE:
            raise SceneError(f"the sun's direction {self.sun} must have length 1, it has {np.linalg.norm(self.sun):g}")
        try:
            self.scene  # noqa: B018  embree's own checks of vertices and faces
        except ValueError as error:
            raise SceneError(f"a world's triangles: {error}") from None

    @cached_property
    def scene(self) -> TriangleScene:
        """The triangles in Embree."""
        return TriangleScene(self.vertices, self.faces)

    @cached_property
    def shown(self) -> NDArray[np.float32]:
        """The colour that each face shows, (m, 3), and the sky's two at its end: (m + 2, 3)."""
        colours = self.colours.astype(np.float32)
        if self.sun is not None:
            a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
            normals = np.cross(b - a, c - a)
            length = np.linalg.norm(normals, axis=1)
            facing = np.divide(normals @ np.array(self.sun), length, out=np.zeros(len(normals)), where=length > 0.0)
            colours *= (AMBIENT + (1.0 - AMBIENT) * np.maximum(facing, 0.0))[:, None].astype(np.float32)
        return np.concatenate([colours, np.array([self.horizon, self.zenith], dtype=np.float32)])

    def add_colours(self, trace: Trace, eye: Array, rays: Array, sums: Array, samples: int) -> None:
        """Add the colour each ray sees to `sums`, (n // samples, 3) float64: `samples` rays in a row make one sum.

        Rays that are not reflected see BACKGROUND and are not sent into the world.
        """
        going, origins, directions = _reflected(trace.status, trace.points, trace.directions)
        triangles = self.scene.first_triangles(origins, directions)
        _add_colours(going, triangles, directions, len(trace.status), self.shown, BACKGROUND, sums, samples)

    def to_display(self, means: Array) -> Picture:
        """The nearest bytes."""
        return rounded(means)


# On one thread each, and without the interpreter's lock: a few percent of the rays' own time, and callers may have threads.
@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]  # numba's are
def _reflected(status: NDArray[np.int8], points: Array, directions: Array) -> tuple[NDArray[np.int64], Array, Array]:
    """Indices, points and directions of the rays that were reflected."""
    going = np.flatnonzero(status == 0)
    origins, onward = np.empty((going.size, 3)), np.empty((going.size, 3))
    for i in range(going.size):
        for c in range(3):
            origins[i, c] = points[going[i], c]
            onward[i, c] = directions[going[i], c]
    return going, origins, onward


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _add_colours(going: NDArray[np.int64], triangles: NDArray[np.int32], onward: Array, rays: int, shown: NDArray[np.float32],
                 background: Array, sums: Array, samples: int) -> None:
    horizon, zenith = shown.shape[0] - 2, shown.shape[0] - 1
    i = 0  # of the next ray that was sent
    for n in range(rays):
        pixel = n // samples
        if i == going.size or going[i] != n:
            for c in range(3):
                sums[pixel, c] += background[c]
            continue
        if triangles[i] >= 0:
            for c in range(3):
                sums[pixel, c] += shown[triangles[i], c]
        else:
            up = max(onward[i, 1], 0.0)
            for c in range(3):
                sums[pixel, c] += (1.0 - up) * shown[horizon, c] + up * shown[zenith, c]
        i += 1
