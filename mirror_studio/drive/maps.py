"""Draw how large the mirrors show things, and how unlike to the two eyes, as maps over them; SVG."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_studio.drive.drawings import LINE, X_LABEL, Box, height_of, mirror_panel, outline_of
from mirror_studio.drive.measured import Measured
from mirror_studio.report.colour_bar import lying_bar
from mirror_studio.report.colours import BLUE_ORANGE, VIRIDIS, Stops
from mirror_studio.report.drawing import FONT, INK, WIDTH, drawing, nice_ticks, text, tick_texts

Array = NDArray[np.float64]

LEFT, RIGHT, APART = 62.0, 14.0, 20.0  # px: the numbers of y, half a number of a scale's end, between maps
BELOW, BETWEEN = 46.0, 18.0  # px: the numbers of x, between rows
HIGHEST = 420.0  # px, of a map
BAR = 12.0  # px, of a scale
LEVELS = 9  # lines of equal value between the ends of a scale, at most
EVEN = 1e-3  # of a field: a smaller spread has no lines
MIN_SPREAD, MIN_REACH = 1e-6, 1e-3  # of a scale: what is less is widened to 1, or to so much on either side
BEYOND = 2  # cells over the edge that a field is continued by, so that the edge cuts it and not the cells' staircase


@dataclass(frozen=True, slots=True)
class _Column:
    """A quantity of all mirrors: x, y and values (rows, columns) of one, its colours, and the value that has none, if any."""

    title: str
    field: Callable[[Measured], tuple[Array, Array, Array]]
    stops: Stops
    centre: float | None = None


def magnification_maps(path: Path, mirrors: Sequence[Measured]) -> None:
    """Write horizontal and vertical magnification, their ratio and the binocular disparity.

    A row for each mirror, one scale for all of them in a column.
    """
    columns = (_Column("horizontal magnification", _magnification("horizontal"), VIRIDIS),
               _Column("vertical magnification", _magnification("vertical"), VIRIDIS),
               _Column("horizontal over vertical", _magnification("ratio"), BLUE_ORANGE, 1.0),
               _Column("binocular disparity, %", _disparity, BLUE_ORANGE, 0.0))
    fields = [[column.field(each) for column in columns] for each in mirrors]
    scales = [_scale([row[j][2] for row in fields], column.centre) for j, column in enumerate(columns)]
    width = (WIDTH - LEFT - RIGHT - (len(columns) - 1) * APART) / len(columns)
    parts, top = [], 0.0
    for each, row in zip(mirrors, fields, strict=True):
        rim = outline_of(each.mirror.reflector)
        top += 2.0 * LINE + 8.0
        parts.append(text(0.0, top - LINE - 12.0, each.mirror.name, FONT, INK))
        height = height_of(_cells(*row[0][:2]), width, HIGHEST)
        for j, (column, scale, (x, y, values)) in enumerate(zip(columns, scales, row, strict=True)):
            panel = mirror_panel(LEFT + j * (width + APART), top, width, height, _cells(x, y), rim, len(parts))
            known = values[np.isfinite(values)]
            shown = _continued(values, ~_contains(rim, x, y)).T
            panel.image(shown, *scale, column.stops)
            if known.size and float(np.ptp(known)) > EVEN:
                levels = nice_ticks(*scale, LEVELS)
                panel.contours(x, y, shown, levels, 0.7, tick_texts(levels))
            parts.append(panel.svg([column.title], j == 0, X_LABEL))
        top += height + BELOW + BETWEEN
    parts += [lying_bar(LEFT + j * (width + APART), top - 6.0, width, BAR, scale, column.stops, j)
              for j, (column, scale) in enumerate(zip(columns, scales, strict=True))]
    path.write_bytes(drawing(top + BAR + 20.0, parts))


def _magnification(name: str) -> Callable[[Measured], tuple[Array, Array, Array]]:
    def field(each: Measured) -> tuple[Array, Array, Array]:
        found = each.magnification
        return found.x, found.y, getattr(found.magnification, name)

    return field


def _disparity(each: Measured) -> tuple[Array, Array, Array]:
    found = each.disparity
    return found.x, found.y, np.full_like(found.percent, np.nan) if each.orientation.twice else found.percent


def _cells(x: Array, y: Array) -> Box:
    """The box of equal cells about x and y, mm."""
    half_x, half_y = 0.5 * (x[1] - x[0]), 0.5 * (y[1] - y[0])
    return float(x[0] - half_x), float(x[-1] + half_x), float(y[0] - half_y), float(y[-1] + half_y)


def _scale(fields: Sequence[Array], centre: float | None) -> tuple[float, float]:
    """One scale for fields; about a value that has no colour, if there is one."""
    known = np.concatenate([field[np.isfinite(field)] for field in fields])
    if known.size == 0:
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    if centre is not None:
        reach = max(high - centre, centre - low, MIN_REACH)
        return centre - reach, centre + reach
    return (low, high) if high - low > MIN_SPREAD else (low - 0.5, high + 0.5)


def _contains(rim: Array, x: Array, y: Array) -> NDArray[np.bool_]:
    """Whether the places (rows, columns) lie inside a ring: an odd number of its edges is to their right."""
    result = np.zeros((len(y), len(x)), dtype=np.bool_)
    for (x0, y0), (x1, y1) in zip(rim, np.roll(rim, -1, axis=0), strict=True):
        rows = (y >= min(y0, y1)) & (y < max(y0, y1))
        if rows.any():
            result[rows] ^= x < (x0 + (y[rows] - y0) * ((x1 - x0) / (y1 - y0)))[:, None]
    return result


def _continued(values: Array, beyond: NDArray[np.bool_]) -> Array:
    """Values with the means of their neighbours where they are NaN and `beyond` the mirror, BEYOND cells far."""
    result = values.copy()
    for _ in range(BEYOND):
        wide = np.pad(result, 1, constant_values=np.nan)
        beside = np.stack([wide[:-2, 1:-1], wide[2:, 1:-1], wide[1:-1, :-2], wide[1:-1, 2:]])
        known = np.isfinite(beside)
        count = known.sum(axis=0)
        mean = np.where(known, beside, 0.0).sum(axis=0) / np.maximum(count, 1)
        result = np.where(np.isnan(result) & beyond & (count > 0), mean, result)
    return result
