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
    """A pinhole and the samples of its picture.

    The ray through a point (column, row) of the picture, counted in pixels from the first one's outer corner, has the direction
    base + column·across + row·down, of any length. Row 0 is at the top.

    Parameters
    ----------
    eye : (3,), mm, the pinhole.
    base, across, down : (3,) each.
    columns, rows : of pixels.
    """

    eye: Array
    base: Array
    across: Array
    down: Array
    columns: int
    rows: int

    def rays_through(self, column: Array, row: Array) -> Array:
        """Directions (…, 3), of any length, through points of the picture: column and row (…), in pixels."""
        return (self.base + np.asarray(column, dtype=np.float64)[..., None] * self.across
                + np.asarray(row, dtype=np.float64)[..., None] * self.down)

    @staticmethod
    def looking_at(eye: Array, target: Array, up: Array, width_rad: float, columns: int, rows: int) -> Camera:
        """Make a camera whose picture's middle looks at a target, in right-handed coordinates, with square pixels.

        Parameters
        ----------
        eye, target : (3,), mm.
        up : (3,), what points upwards in the picture.
        width_rad : the angle between the middles of its left and right side, radians.
        columns, rows : of pixels.

        Returns
        -------
        Camera
        """
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        pixel = 2.0 * np.tan(0.5 * width_rad) / columns
        across, down = pixel * right, pixel * np.cross(forward, right)
        return Camera(eye, forward - 0.5 * columns * across - 0.5 * rows * down, across, down, columns, rows)


@dataclass(frozen=True, slots=True)
class Frame:
    """A picture on the plane z = 0 of the mirror's coordinates, in square pixels; row 0 is at the top.

    Parameters
    ----------
    left, top : x and y of the outer corner of the first pixel, mm.
    pixel : its size, mm.
    columns, rows : of pixels.
    """

    left: float
    top: float
    pixel: float
    columns: int
    rows: int

    @staticmethod
    def around(box: Box, width_px: int) -> Frame:
        """The frame `width_px` wide around a box (x_min, x_max, y_min, y_max), mm, and FRAME_MARGIN of its width beyond."""
        margin = FRAME_MARGIN * (box[1] - box[0])
        pixel = (box[1] - box[0] + 2.0 * margin) / width_px
        rows = round((box[3] - box[2] + 2.0 * margin) / pixel)
        return Frame(box[0] - margin, box[3] + margin, pixel, width_px, rows)

    def place(self, column: Array, row: Array) -> tuple[Array, Array]:
        """(x, y) on the picture plane, mm, of points counted in pixels from the first one's outer corner."""
        return self.left + np.asarray(column) * self.pixel, self.top - np.asarray(row) * self.pixel

    def camera(self, eye: Array) -> Camera:
        """The camera at the eye (3,), mm, whose picture plane this is."""
        size = self.pixel
        return Camera(eye, np.array([self.left - eye[0], self.top - eye[1], -eye[2]]), np.array([size, 0.0, 0.0]),
                      np.array([0.0, -size, 0.0]), self.columns, self.rows)


def rays_through(frame: Frame, eye: Array, column: Array, row: Array) -> Array:
    """Directions (…, 3), of any length, from the eye (3,), mm, through points of the frame: column and row (…), in pixels."""
    return frame.camera(eye).rays_through(column, row)
