"""Reflector, eye and scene in, the driver's picture out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.reflector import Reflector
from raytrace.scene.reference import Picture, ReferencePlane
from raytrace.trace import Trace, reflect

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

FRAME_MARGIN = 0.05  # of the mirror's width, on every side
SAMPLES = 2  # a direction and pixel
BAND_RAYS = 600_000  # traced at once: some 60 MB of rays and results
BACKGROUND = np.array([246.0, 246.0, 244.0])


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


def rays_through(frame: Frame, eye: Array, column: Array, row: Array) -> Array:
    """Directions (n, 3), of any length, from the eye through places of the frame."""
    x, y = frame.place(column, row)
    return np.stack([x - eye[0], y - eye[1], np.full(x.shape, -eye[2])], axis=-1)


def driver_view(reflector: Reflector, eye: Array, scene: ReferencePlane, frame: Frame,
                progress: Callable[[float], None] | None = None) -> tuple[Picture, dict[str, int]]:
    """What the eye sees in the mirror, (rows, columns, 3) uint8, and how many rays had which status.

    A pinhole at the eye, SAMPLES² rays a pixel on a regular grid, averaged; the mirror is cut to its outline by the rays
    themselves. `progress` is called with the share that is done.
    """
    picture = np.empty((frame.rows, frame.columns, 3), dtype=np.uint8)
    per_pixel = SAMPLES * SAMPLES
    band = max(1, BAND_RAYS // (frame.columns * per_pixel))
    inner = (np.arange(SAMPLES) + 0.5) / SAMPLES
    counts: dict[str, int] = {}
    trace = None
    for first in range(0, frame.rows, band):
        rows = min(band, frame.rows - first)
        # Order: row, column, sample in y, sample in x: one pixel's rays in a row.
        x, y = frame.place(np.arange(frame.columns)[:, None, None] + inner,
                           (first + np.arange(rows))[:, None, None, None] + inner[:, None])
        directions = np.empty((rows, frame.columns, SAMPLES, SAMPLES, 3))
        directions[..., 0], directions[..., 1], directions[..., 2] = x - eye[0], y - eye[1], -eye[2]
        n = rows * frame.columns * per_pixel
        reusable = trace is not None and len(trace.status) == n
        trace = reflect(reflector, eye, directions.reshape(n, 3), out=trace if reusable else None)
        for name, count in trace.counts().items():
            counts[name] = counts.get(name, 0) + count
        sums = np.zeros((rows * frame.columns, 3))
        scene.add_colours(trace, BACKGROUND, sums, per_pixel)
        picture[first:first + rows] = np.rint(sums / per_pixel).astype(np.uint8).reshape(rows, frame.columns, 3)
        if progress is not None:
            progress((first + rows) / frame.rows)
    return picture, counts


def landing_points(trace: Trace, z_mm: float) -> Array:
    """Where the reflected rays meet the plane z = z_mm, (n, 3); NaN for rays that do not."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (z_mm - trace.points[:, 2]) / trace.directions[:, 2]
    result: Array = trace.points + np.where(t > 0.0, t, np.nan)[:, None] * trace.directions
    return result
