"""Reflector, eye and scene in, the driver's picture out."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from raytrace.parallel import in_runs
from raytrace.reflector import Reflector
from raytrace.scene.reference import Picture
from raytrace.trace import Trace, reflect

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

FRAME_MARGIN = 0.05  # of the mirror's width, on every side
SAMPLES = 4  # a direction, in the pixels that need more than one
# Difference to a neighbour from which a pixel gets them, in values of 255: a step that a smooth picture may have.
CONTRAST = 10
BACKGROUND = np.array([246.0, 246.0, 244.0])


class Scene(Protocol):
    """What reflected rays can land on."""

    def add_colours(self, trace: Trace, background: Array, sums: Array, samples: int) -> None:
        """Add the colour each ray sees to `sums`, (n // samples, 3) float64: `samples` rays in a row make one sum.

        Rays that are not reflected see the background (3,). Called from several threads at once.
        """


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


def driver_view(reflector: Reflector, eye: Array, scene: Scene, frame: Frame,
                progress: Callable[[float], None] | None = None, samples: int = SAMPLES) -> tuple[Picture, dict[str, int]]:
    """What the eye sees in the mirror, (rows, columns, 3) uint8, and how many rays had which status.

    A pinhole at the eye. One ray through the middle of every pixel; where that shows a difference of CONTRAST or more to
    a neighbour, samples² rays on a regular grid, averaged. The mirror is cut to its outline by the rays themselves.
    The picture does not depend on the number of threads. `progress` is called with the share that is done; what it raises
    ends the work.
    """
    if reflector.obstacles_behind:  # they stand in no reflected ray's way, and which ray misses how is not asked
        reflector = replace(reflector, obstacles=None)
    picture = np.empty((frame.rows, frame.columns, 3), dtype=np.uint8)
    n = frame.rows * frame.columns
    report = progress or (lambda share: None)
    counts = _render(reflector, eye, scene, frame, np.arange(n), 1, picture, lambda share: report(share / samples))
    if samples > 1:
        again = np.flatnonzero(_contrasts(picture))
        counts += _render(reflector, eye, scene, frame, again, samples, picture,
                          lambda share: report((1.0 + (samples - 1) * share) / samples))
    report(1.0)
    return picture, {name: counts[name] for name in sorted(counts)}


def _render(reflector: Reflector, eye: Array, scene: Scene, frame: Frame, pixels: NDArray[np.intp], samples: int,
            picture: Picture, report: Callable[[float], None]) -> Counter[str]:
    """Trace and colour some pixels, samples² rays each."""
    inner = (np.arange(samples) + 0.5) / samples
    per_pixel = samples * samples
    colours = picture.reshape(-1, 3)
    counts: Counter[str] = Counter()
    lock, own = threading.Lock(), threading.local()

    def work(start: int, stop: int) -> None:
        rays = (stop - start) * per_pixel
        if getattr(own, "rays", 0) != rays:  # a thread's arrays serve for all of its runs
            own.rays, own.trace, own.directions = rays, Trace.empty(rays), np.empty((rays, 3))
            own.sums = np.empty((stop - start, 3))
        _directions(pixels[start:stop], frame.columns, frame.left, frame.top, frame.pixel, eye, inner, own.directions)
        trace = reflect(reflector, eye, own.directions, out=own.trace)
        own.sums[:] = 0.0
        scene.add_colours(trace, BACKGROUND, own.sums, per_pixel)
        _store(own.sums, 1.0 / per_pixel, pixels[start:stop], colours)
        with lock:
            counts.update(trace.counts())

    in_runs(work, len(pixels), max(1, RAYS_AT_ONCE // per_pixel), lambda done: report(done / len(pixels)))
    return counts


RAYS_AT_ONCE = 16_384  # rays, results and colours of a run: two megabytes, near a core


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]  # numba's are
def _directions(pixels: NDArray[np.intp], columns: int, left: float, top: float, size: float, eye: Array, inner: Array,
                directions: Array) -> None:
    """Rays through the samples of pixels, which are in rising order, row by row in each."""
    n = 0
    row = column = before = 0
    for pixel in pixels:
        column += pixel - before
        if column >= columns:  # a division for each pixel would take as long as the rest
            row, column = pixel // columns, pixel % columns
        before = pixel
        for a in inner:
            for b in inner:
                directions[n, 0] = left + (column + b) * size - eye[0]
                directions[n, 1] = top - (row + a) * size - eye[1]
                directions[n, 2] = -eye[2]
                n += 1


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _store(sums: Array, scale: float, pixels: NDArray[np.intp], colours: Picture) -> None:
    for i in range(len(pixels)):
        for c in range(3):
            colours[pixels[i], c] = np.uint8(np.rint(sums[i, c] * scale))


def _contrasts(picture: Picture) -> NDArray[np.bool_]:
    """Pixels that differ from one beside, above or below by CONTRAST or more."""
    found = np.zeros(picture.shape[:2], dtype=np.bool_)
    _mark_contrasts(picture, CONTRAST, found)
    return found


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _mark_contrasts(picture: Picture, least: int, found: NDArray[np.bool_]) -> None:
    rows, columns = found.shape
    for i in range(rows):
        for j in range(columns):
            for di, dj in ((0, 1), (1, 0)):
                k, m = i + di, j + dj
                if k < rows and m < columns:
                    for c in range(3):
                        if abs(np.int64(picture[i, j, c]) - np.int64(picture[k, m, c])) >= least:
                            found[i, j] = found[k, m] = True


def landing_points(trace: Trace, z_mm: float) -> Array:
    """Where the reflected rays meet the plane z = z_mm, (n, 3); NaN for rays that do not."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (z_mm - trace.points[:, 2]) / trace.directions[:, 2]
    result: Array = trace.points + np.where(t > 0.0, t, np.nan)[:, None] * trace.directions
    return result
