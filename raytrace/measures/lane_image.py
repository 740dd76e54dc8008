"""Lane straightness by image analysis: the yellow line found in the driver's picture, as the paper measured it."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray

from raytrace.rays import Status
from raytrace.reflector import Reflector
from raytrace.scene.reference import Picture
from raytrace.trace import reflect
from raytrace.viewing.camera import Frame, rays_through

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

YELLOWNESS = 45.0  # min(R, G) − B from which a pixel counts as yellow: half of a line of one pixel's width
LARGEST_STEP = 3.0  # pixels that the line may move between columns beyond its own slope
COVERAGE = 0.8  # of the mirror's width on which the line must have been found
# A cubic over a quarter of the width: longer, and it misses the bend of the presets; shorter, and pixels show in the tangent.
EDGE_SHARE = 0.25
DEGREE = 3
OUTLIER = 4.0  # standard deviations beyond which a column (a car over the line) is left out


def lane_straightness_in_picture(picture: Picture, frame: Frame, reflector: Reflector, eye: Array, box: Box) -> float | None:
    """Measure lane straightness in the rendered picture: of the uppermost yellow line, column by column.

    Each column's line is the centre of gravity of yellowness in its run; the pixel is taken back to the mirror point
    (x, y); a cubic near each edge gives the heights there and the tangent at the right one. What it approximates is
    `raytrace.measures.lane.lane_straightness_percent`.

    Parameters
    ----------
    picture : (rows, columns, 3), of the driver's view.
    frame : the picture plane that it was taken on.
    reflector : in mirror coordinates.
    eye : (3,), mm.
    box : (x_min, x_max, y_min, y_max) of the mirror, mm.

    Returns
    -------
    Percent; None where no yellow line crosses the picture.
    """
    columns, rows = _uppermost_yellow_line(picture, frame, box)
    if len(columns) < COVERAGE * (box[1] - box[0]) / frame.pixel:
        return None
    trace = reflect(reflector, eye, rays_through(frame, eye, columns + 0.5, rows + 0.5))
    on_mirror = trace.status == Status.REFLECTED
    x, y = trace.points[on_mirror, 0], trace.points[on_mirror, 1]
    width = box[1] - box[0]
    right, left = _smooth_near(x, y, box[1], width), _smooth_near(x, y, box[0], width)
    if right is None or left is None:
        return None
    tangent_traverse = -float(right.deriv()(box[1])) * width
    if tangent_traverse == 0.0:
        return None
    return 100.0 * (abs(float(left(box[0]) - right(box[1]))) - abs(tangent_traverse)) / abs(tangent_traverse)


def _smooth_near(x: Array, y: Array, edge: float, width: float) -> Chebyshev | None:
    """A cubic through the line's part near an edge, without the columns where something stands over the line."""
    near = np.abs(x - edge) <= EDGE_SHARE * width
    x, y = x[near], y[near]
    for _ in range(5):
        if len(x) < 0.5 * EDGE_SHARE * len(near) * COVERAGE:
            return None
        line = Chebyshev.fit(x, y, DEGREE)
        off = np.abs(line(x) - y)
        keep = off <= OUTLIER * max(float(np.sqrt(np.mean(off**2))), 1e-6)
        if keep.all():
            break
        x, y = x[keep], y[keep]
    return line


def _uppermost_yellow_line(picture: Picture, frame: Frame, box: Box) -> tuple[Array, Array]:
    """Columns and sub-pixel rows of the uppermost yellow line, followed both ways from the middle of the mirror."""
    first = max(int(np.ceil((box[0] - frame.left) / frame.pixel)), 0)
    last = min(int((box[1] - frame.left) / frame.pixel), frame.columns)
    values = picture[:, first:last]
    runs = _runs(np.minimum(values[..., 0], values[..., 1]).astype(np.int16) - values[..., 2])
    found: dict[int, float] = {}
    starts = [i for i in np.argsort(np.abs(np.arange(len(runs)) - len(runs) // 2)) if len(runs[i])]
    if not starts:
        return np.empty(0), np.empty(0)
    start = int(starts[0])
    for step in (1, -1):
        row, slope, missed = float(runs[start][0]), 0.0, 0
        i = start
        while 0 <= i < len(runs):
            expected = row + slope * (missed + 1)
            near = runs[i][np.abs(runs[i] - expected) <= LARGEST_STEP * (missed + 1)] if len(runs[i]) else runs[i]
            if len(near):
                following = float(near[np.argmin(np.abs(near - expected))])
                if i != start:
                    slope = 0.7 * slope + 0.3 * (following - row) / (missed + 1)
                row, missed = following, 0
                found[i] = row
            else:
                missed += 1
            i += step
    order = sorted(found)
    return np.array(order, dtype=np.float64) + first, np.array([found[i] for i in order])


def _runs(yellowness: NDArray[np.int16]) -> list[Array]:
    """Centres of gravity of the yellow runs of each column (rows, columns), from the top; in pixels, of pixel centres."""
    rows, columns = yellowness.shape
    flat = np.zeros((columns, rows + 2), dtype=np.int16)  # column by column, none yellow at their ends
    flat[:, 1:-1] = yellowness.T
    edges = np.flatnonzero(np.diff((flat > YELLOWNESS).ravel()))
    # The half-covered pixels on either side belong to the line too: an edge lies after the pixel of its number.
    starts, stops = edges[::2], edges[1::2] + 2
    if not len(starts):
        return [np.empty(0)] * columns
    lengths = stops - starts
    offsets = np.cumsum(lengths) - lengths
    at = np.repeat(starts - offsets, lengths) + np.arange(int(lengths.sum()))
    weights = np.maximum(flat.ravel()[at], 0).astype(np.float64)
    column = starts // (rows + 2)
    centres = np.add.reduceat(weights * (at % (rows + 2) - 1), offsets) / np.add.reduceat(weights, offsets)
    return np.split(centres, np.searchsorted(column, np.arange(1, columns)))
