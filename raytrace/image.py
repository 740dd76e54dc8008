"""The driver's picture of what a reflector shows of a scene."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.blocks import at
from raytrace.kernels.compiled import compiled
from raytrace.parallel import parallel_for
from raytrace.rays import Status, Trace
from raytrace.reflector import Reflector
from raytrace.scene.reference import Picture, landed
from raytrace.trace import reflect
from raytrace.viewing.camera import Camera

Array = NDArray[np.float64]

SAMPLES = 4  # a direction, in the pixels that need more than one
# Difference to a neighbour from which a pixel gets them, in values of 255: a step that a smooth picture may have.
CONTRAST = 10


class Scene(Protocol):
    """What the rays of a picture can land on."""

    def add_colours(self, trace: Trace, eye: Array, rays: Array, sums: Array, samples: int) -> None:
        """Add the colour that each ray sees to sums, `samples` rays in a row to one of them; called from several threads.

        Parameters
        ----------
        trace : of the n rays in the mirror.
        eye : (3,), mm.
        rays : (n, 3), of any length, in which the rays left the eye: for those that are not reflected.
        sums : (n // samples, 3), float64, what is added to.
        samples : a pixel.
        """

    def to_display(self, means: Array) -> Picture:
        """The bytes (n, 3) that show mean colours (n, 3)."""


def photograph(reflector: Reflector | None, camera: Camera, scene: Scene, progress: Callable[[float], None] | None = None,
               samples: int = SAMPLES, contrast: int = CONTRAST) -> tuple[Picture, dict[str, int]]:
    """Take the picture of a mirror, or of the scene alone, with a camera.

    One ray through the middle of every pixel; where that shows a contrast to a neighbour, a regular grid of rays, averaged. The
    mirror is cut to its outline by the rays themselves. The picture does not depend on the number of threads.

    Parameters
    ----------
    reflector : what is looked into; None for the scene alone.
    camera : the eye and the pixels, in the reflector's coordinates.
    scene : what the rays land on.
    progress : called with the share that is done; what it raises ends the work.
    samples : a direction, of pixels that need more than one.
    contrast : the difference to a neighbour from which a pixel needs more, in values of 255.

    Returns
    -------
    picture : (rows, columns, 3), uint8.
    counts : how many rays had which status, by name.
    """
    if reflector is not None and reflector.obstacles_behind:
        # They stand in no reflected ray's way, and which ray misses how is not asked.
        reflector = replace(reflector, obstacles=None)
    picture = np.empty((camera.rows, camera.columns, 3), dtype=np.uint8)
    report = progress or (lambda share: None)
    counts = _render(reflector, camera, scene, _in_bands(camera.rows, camera.columns), 1, picture,
                     lambda share: report(share / samples))
    if samples > 1:
        again = np.flatnonzero(_contrasts(picture, contrast))
        counts += _render(reflector, camera, scene, again, samples, picture,
                          lambda share: report((1.0 + (samples - 1) * share) / samples))
    report(1.0)
    return picture, {name: counts[name] for name in sorted(counts)}


def _render(reflector: Reflector | None, camera: Camera, scene: Scene, pixels: NDArray[np.intp], samples: int, picture: Picture,
            report: Callable[[float], None]) -> Counter[str]:
    """Trace and colour some pixels, samples² rays each."""
    inner = (np.arange(samples) + 0.5) / samples
    per_pixel = samples * samples
    colours = picture.reshape(-1)
    counts: Counter[str] = Counter()
    lock, thread = threading.Lock(), threading.local()

    def work(start: int, stop: int) -> None:
        rays = (stop - start) * per_pixel
        if getattr(thread, "rays", 0) != rays:  # a thread's arrays serve for all of its runs
            thread.rays, thread.trace, thread.directions = rays, Trace.empty(rays), np.empty((rays, 3))
            thread.sums = np.empty((stop - start, 3))
        _directions(pixels[start:stop], camera.columns, camera.base, camera.across, camera.down, inner, thread.directions)
        if reflector is None:
            thread.trace.status[:] = Status.MISSED
            trace = thread.trace
        else:
            trace = reflect(reflector, camera.eye, thread.directions, out=thread.trace)
        thread.sums[:] = 0.0
        scene.add_colours(trace, camera.eye, thread.directions, thread.sums, per_pixel)
        thread.sums *= 1.0 / per_pixel
        _place(scene.to_display(thread.sums).ravel(), pixels[start:stop], colours)
        with lock:
            counts.update(trace.counts())

    parallel_for(work, len(pixels), max(1, RAYS_AT_ONCE // per_pixel), lambda done: report(done / len(pixels)), RUNS)
    return counts


RAYS_AT_ONCE = 16_384  # rays, results and colours of a run: two megabytes, near a core
RUNS = 4  # are what their number is a multiple of: each costs a lit world half a millisecond beside its rays
BAND = 4  # rows: 16 rays in a row, which a kernel takes at once, then are a square, and mostly on one cell of the surface


@lru_cache(maxsize=4)
def _in_bands(rows: int, columns: int) -> NDArray[np.intp]:
    """All pixels, in bands of a few rows, column by column in each."""
    pixels = np.arange(rows * columns).reshape(rows, columns)
    order = np.concatenate([pixels[row:row + BAND].T.ravel() for row in range(0, rows, BAND)])
    return order


@compiled(nogil=True)
def _directions(pixels: NDArray[np.intp], columns: int, base: Array, across: Array, down: Array, inner: Array,
                directions: Array) -> None:
    """Rays through the samples of pixels, row by row in each."""
    n = 0
    row = column = before = 0
    for pixel in pixels:
        step = pixel - before
        if step == columns:  # a division for each pixel would take as long as the rest
            row += 1
        elif 0 <= step < columns - column:
            column += step
        else:
            row, column = pixel // columns, pixel % columns
        before = pixel
        for a in inner:
            for b in inner:
                for c in range(3):
                    directions[n, c] = base[c] + (column + b) * across[c] + (row + a) * down[c]
                n += 1


@compiled(nogil=True)
def _place(shown: NDArray[np.uint8], pixels: NDArray[np.intp], colours: NDArray[np.uint8]) -> None:
    """Bytes of some pixels, flat, to where they belong among those of all."""
    for i in range(len(pixels)):
        n, k = at(3 * i), at(3 * pixels[i])
        colours[k], colours[k + 1], colours[k + 2] = shown[n], shown[n + 1], shown[n + 2]


def _contrasts(picture: Picture, least: int) -> NDArray[np.bool_]:
    """Pixels that differ from one beside, above or below by so much or more."""
    found = np.zeros(picture.shape[:2], dtype=np.bool_)
    _mark_contrasts(picture, least, found)
    return found


@compiled(nogil=True)
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
    """Where the reflected rays meet the plane z = z_mm, (n, 3), mm; NaN for rays that do not."""
    return landed(trace.points, trace.directions, z_mm)
