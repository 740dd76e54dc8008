"""Draw fields over the mirror as maps within its outline, as SVG.

Matplotlib takes a second of processor time for these three figures, half of it to be loaded; these take a fifteenth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.deviation import Deviation
from mirror_cad.grid import Grid
from mirror_cad.laws.words import plain
from mirror_cad.outline import Outline
from mirror_studio.report.colour_bar import ColourBar
from mirror_studio.report.colours import BLUE_ORANGE, VIRIDIS
from mirror_studio.report.drawing import WIDTH, drawing, nice_ticks, tick_texts
from mirror_studio.report.fields import DeviationFields, Pair
from mirror_studio.report.map_panel import MapPanel
from mirror_studio.report.text import with_unit

Array = NDArray[np.float64]

TICK_ROOM = 0.09  # of a scale: what a number needs of its height
DESIGNED, REALISED, LIMIT = "#a9c4de", "#1f3f66", "#b35806"
UNIT_OF_VALUE = {"%": "%", "1/m": "/m"}
LEFT, APART, BELOW, TITLE_LINE = 62.0, 14.0, 44.0, 15.0  # px: numbers of y, between maps, numbers of x, a title's line
BAR, BAR_ROOM = 13.0, 84.0  # px: a scale's width, and with its numbers and label
LOWEST, HIGHEST = 80.0, 600.0  # px: of a scale, of a map
BEYOND = 3  # cells


def pair_maps(deviation: Deviation, outline: Outline, pairs: list[Pair]) -> bytes:
    """Designed beside realised, each pair on its own one scale; SVG."""
    frame = _Frame.of(deviation, outline)
    width, height = frame.size((WIDTH - LEFT - len(pairs) * (2.0 * APART + BAR_ROOM)) / (2 * len(pairs)))
    left, top, parts = LEFT, 2.0 * TITLE_LINE, []
    for i, pair in enumerate(pairs):
        radii, (low, high) = pair.unit == "mm", pair.scale()
        if radii:  # by curvature, as the eye sees a radius and as the studio draws it
            low, high = sorted((1e3 / low, 1e3 / high))
        for k, (values, which) in enumerate(((pair.designed, "designed"), (pair.realised, "realised"))):
            panel = frame.panel(left, top, width, height, 2 * i + k)
            panel.image(frame.field(1e3 / values if radii else values), low, high, VIRIDIS)
            parts.append(panel.svg([f"{pair.name} {which}"], y_numbers=i == k == 0))
            left += width + APART
        bar = ColourBar(left, top, BAR, max(height, LOWEST), (low, high), VIRIDIS, i)
        ticks, words = bar.ticks(), tick_texts(bar.ticks())
        if radii:
            of_radius = radius_ticks(*pair.scale())
            ticks, words = [1e3 / tick for tick in of_radius], [plain(tick) for tick in of_radius]
        parts.append(bar.svg(f"{pair.name}, {pair.unit}", ticks, words))
        left += BAR_ROOM
    return drawing(top + max(height, LOWEST) + BELOW, parts)


def deviation_maps(deviation: Deviation, outline: Outline, fields: DeviationFields) -> bytes:
    """The five deviations on one scale about zero, worst points ringed, the limit as contours on k1 and k2; SVG."""
    frame = _Frame.of(deviation, outline)
    scale, number = fields.scale, len(QUANTITIES)
    width, height = frame.size((WIDTH - LEFT - number * APART - BAR_ROOM) / number)
    top, parts = 3.0 * TITLE_LINE, []
    limit = None if fields.limit is None or fields.limit_is_far else fields.limit
    for k, key in enumerate(QUANTITIES):
        panel, values = frame.panel(LEFT + k * (width + APART), top, width, height, k), frame.field(fields.values[key])
        panel.image(values, -scale, scale, BLUE_ORANGE)
        if limit is not None and key in ("k1", "k2"):
            panel.contours(deviation.grid.cells_x, deviation.grid.cells_y, values, (-limit, limit), 1.6)
        worst, at = fields.worst[key]
        if worst != 0.0:
            panel.ring(*at)
        title = key, f"worst {with_unit(worst, UNIT_OF_VALUE[fields.unit], sign=True)}"
        parts.append(panel.svg(title, y_numbers=k == 0))
    bar = ColourBar(LEFT + number * (width + APART), top, BAR, max(height, LOWEST), (-scale, scale), BLUE_ORANGE, 0)
    # Numbers beside the limit would lie under its name.
    told = [(tick, words) for tick, words in zip(bar.ticks(), tick_texts(bar.ticks()), strict=True)
            if limit is None or abs(abs(tick) - limit) > 0.12 * scale]
    parts.append(bar.svg(f"deviation, {fields.unit}", [tick for tick, _ in told], [words for _, words in told],
                         [] if limit is None else [(-limit, "limit"), (limit, "limit")]))
    return drawing(top + max(height, LOWEST) + BELOW, parts)


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """How a map lies within the outline: the grid, its edges, the outline that cuts it, and the cells just beyond.

    Attributes
    ----------
    rings : tuple
        Of (cells, neighbours, known): the flat index (m,) of the cells of one ring beyond the outline, of the four beside
        each (m, 4), and which of these have a value by then.
    """

    grid: Grid
    extent: tuple[float, float, float, float]
    rim: Array
    rings: tuple[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]], ...]

    @staticmethod
    def of(deviation: Deviation, outline: Outline) -> _Frame:
        grid = deviation.grid
        return _Frame(grid, outline.bounding_box(), outline.polyline(0.05), tuple(_rings(grid.inside)))

    def size(self, width: float) -> tuple[float, float]:
        """Width and height, px, of a map that may be so wide."""
        x_min, x_max, y_min, y_max = self.extent
        per_width = (y_max - y_min) / (x_max - x_min)
        height = min(width * per_width, HIGHEST)
        return height / per_width, height

    def panel(self, left: float, top: float, width: float, height: float, number: int) -> MapPanel:
        return MapPanel(left, top, width, height, self.extent, self.rim, number)

    def field(self, values: Array) -> Array:
        """Values at the grid as a rectangle, continued by BEYOND cells: the outline cuts it and not the cells' staircase."""
        rectangle = self.grid.as_map(values)
        flat = rectangle.ravel()
        for cells, neighbours, known in self.rings:
            flat[cells] = np.where(known, flat[neighbours], 0.0).sum(axis=1) / known.sum(axis=1)
        return flat.reshape(rectangle.shape)


def _rings(inside: NDArray[np.bool_]) -> list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]]:
    """The BEYOND rings of cells beyond the outline, from the inside out: see `_Frame.rings`."""
    known, rings = inside.copy(), []
    rows, columns = inside.shape
    for _ in range(BEYOND):
        padded = np.pad(known, 1)
        beside = padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2] | padded[1:-1, 2:]
        i, j = np.nonzero(beside & ~known)
        around = np.stack([i - 1, i + 1, i, i]), np.stack([j, j, j - 1, j + 1])
        there = (around[0] >= 0) & (around[0] < rows) & (around[1] >= 0) & (around[1] < columns)
        a, b = np.clip(around[0], 0, rows - 1), np.clip(around[1], 0, columns - 1)
        rings.append((i * columns + j, (a * columns + b).T, (there & known[a, b]).T))
        known[i, j] = True
    return rings


def radius_ticks(low: float, high: float) -> list[float]:
    """Round radii, mm, from `low` to `high` of one sign, as many as have room on a scale that is even in curvature."""
    found: list[float] = []
    span = abs(1.0 / low - 1.0 / high)
    for most in (4, 6, 10, 18, 34):  # the roundest first
        for tick in nice_ticks(low, high, most):
            if low <= tick <= high and all(abs(1.0 / tick - 1.0 / other) >= TICK_ROOM * span for other in found):
                found.append(tick)
    return sorted(found)
