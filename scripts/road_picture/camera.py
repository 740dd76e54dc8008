"""The camera: pixels or points of the picture plane go in, plane coordinates, sight lines and ground points come out.

The picture lies on a vertical plane ``PLANE_DISTANCE`` = 8200 mm behind the camera.  On it, X points to the right
as the driver looks at the mirror and Y points up.  It covers X = -6800 ... +2200 mm and Y = -5400 ... +5400 mm.  It is
stored as a rear-facing camera takes it, so the LEFT edge of the file is X = +2200 and its RIGHT edge is X = -6800;
the first row is the top.  A driver sees it flipped left to right in the mirror.  A second, coarser picture of the same
scene reaches beyond it, for mirrors that look past its edges.

The camera is a pinhole with a shifted lens, ``CAMERA_HEIGHT`` = 2500 mm above a flat, straight road.  The vanishing
point of the road is X_v = +2200, Y_v = +3720, which is also the height of the horizon.  A world point at lateral
offset a (to the left of the camera), height g above the ground and distance Z behind the camera is seen at

    X = X_v - D * a / Z,        Y = Y_v - D * (h - g) / Z.

World coordinates in this package are metres in the order (a, g, Z): to the picture's right, up, away from the
camera.  Traffic drives towards the camera.  The truck that carries the camera is neither drawn nor casts a shadow.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .maths import Array, cosine_directions

# --- picture plane [mm] -------------------------------------------------------------------------------------------
PLANE_DISTANCE = 8200.0
X_VANISH, Y_VANISH = 2200.0, 3720.0

CAMERA_HEIGHT = 2.5  # [m]
SUPERSAMPLING = 3  # samples per pixel and direction


@dataclass(frozen=True)
class Window:
    """A part of the picture plane and the size of its pixels [mm]; ``left`` is that of the stored file, the larger X."""

    left: float
    right: float
    top: float
    bottom: float
    pixel: float

    @property
    def columns(self) -> int:
        """Pixels across."""
        return round((self.left - self.right) / self.pixel)

    @property
    def rows(self) -> int:
        """Pixels from top to bottom."""
        return round((self.top - self.bottom) / self.pixel)

    def pixel_centres(self, first_row: int, rows: int) -> tuple[Array, Array]:
        """Plane coordinates X and Y [mm] of all pixels in a band of rows, row by row."""
        row, column = np.meshgrid(np.arange(first_row, first_row + rows), np.arange(self.columns), indexing="ij")
        return self.left - (column.ravel() + 0.5) * self.pixel, self.top - (row.ravel() + 0.5) * self.pixel


ROAD = Window(2200.0, -6800.0, 5400.0, -5400.0, 4.0)
# What the road goes on to: with some room, all that the presets' mirrors see.  Beyond X = +3200 the scene has no roadside.
BEYOND = Window(3200.0, -9000.0, 6800.0, -6800.0, 8.0)


def sight_lines(x: Array, y: Array) -> Array:
    """World directions (n, 3) from the camera through plane coordinates [mm]; their third component is 1."""
    return np.stack([(X_VANISH - x) / PLANE_DISTANCE, (y - Y_VANISH) / PLANE_DISTANCE, np.ones_like(x)], axis=1)


def ground_points(x: Array, y: Array) -> tuple[Array, Array]:
    """World a and Z [m] of the ground seen at plane coordinates [mm] below the horizon."""
    z = CAMERA_HEIGHT * PLANE_DISTANCE / (Y_VANISH - y)
    return (X_VANISH - x) / PLANE_DISTANCE * z, z


def sample_pattern() -> Iterator[tuple[float, float, tuple[float, float]]]:
    """Sample offsets in a pixel [pixels], each with its own point of the sun's disc."""
    disc = cosine_directions(SUPERSAMPLING**2)[:, :2]
    for number in range(SUPERSAMPLING**2):
        row, column_index = divmod(number, SUPERSAMPLING)
        dx, dy = ((i + 0.5) / SUPERSAMPLING - 0.5 for i in (column_index, row))
        yield dx, dy, (float(disc[number, 0]), float(disc[number, 1]))
