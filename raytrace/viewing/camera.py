"""Rays from an eye through the samples of its picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

FRAME_MARGIN = 0.05  # of the mirror's width, on every side


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole at the eye (3,), mm. The ray through a place (column, row), counted in pixels from the first one's outer
    corner, has the direction base + column·across + row·down, (3,) each, of any length. Row 0 is at the top.
    """

    eye: Array
    base: Array
    across: Array
    down: Array
    columns: int
    rows: int

    def rays_through(self, column: Array, row: Array) -> Array:
        """Directions (…, 3), of any length, through places of the picture."""
        return (self.base + np.asarray(column, dtype=np.float64)[..., None] * self.across
                + np.asarray(row, dtype=np.float64)[..., None] * self.down)

    @staticmethod
    def looking_at(eye: Array, target: Array, up: Array, width_rad: float, columns: int, rows: int) -> Camera:
        """A camera whose picture's middle looks at the target; `up` (3,) points upwards in the picture, and the angle
        between the middles of its left and right side is width_rad. In right-handed coordinates.
        """
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        pixel = 2.0 * np.tan(0.5 * width_rad) / columns
        across, down = pixel * right, pixel * np.cross(forward, right)
        return Camera(eye, forward - 0.5 * columns * across - 0.5 * rows * down, across, down, columns, rows)


@dataclass(frozen=True, slots=True)
class Frame:
    """The picture plane z = 0: the mirror's box with FRAME_MARGIN of its width on every side, in square pixels.

    left, top : the outer corner of the first pixel, mm.   pixel : its size, mm.   Row 0 is at the top.
    """

    left: float
    top: float
    pixel: float
    columns: int
    rows: int

    @staticmethod
    def around(box: Box, width_px: int) -> Frame:
        margin = FRAME_MARGIN * (box[1] - box[0])
        pixel = (box[1] - box[0] + 2.0 * margin) / width_px
        rows = round((box[3] - box[2] + 2.0 * margin) / pixel)
        return Frame(box[0] - margin, box[3] + margin, pixel, width_px, rows)

    def place(self, column: Array, row: Array) -> tuple[Array, Array]:
        """(x, y) on the picture plane, mm, of places counted in pixels from the first one's outer corner."""
        return self.left + np.asarray(column) * self.pixel, self.top - np.asarray(row) * self.pixel

    def camera(self, eye: Array) -> Camera:
        """The camera at the eye (3,) whose picture plane this is."""
        size = self.pixel
        return Camera(eye, np.array([self.left - eye[0], self.top - eye[1], -eye[2]]), np.array([size, 0.0, 0.0]),
                      np.array([0.0, -size, 0.0]), self.columns, self.rows)


def rays_through(frame: Frame, eye: Array, column: Array, row: Array) -> Array:
    """Directions (n, 3), of any length, from the eye through places of the frame."""
    return frame.camera(eye).rays_through(column, row)
