"""Draw fields over the mirror as maps within its outline, as PNG."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from mirror_cad.deviation import QUANTITIES, Deviation
from mirror_cad.laws.words import plain
from mirror_cad.outline import Outline
from mirror_studio.report.fields import DeviationFields, Pair
from mirror_studio.report.text import with_unit

Array = NDArray[np.float64]

DPI = 150
WIDTH_IN = 10.4
# Blue to orange through a light grey, which colour-blind people can tell apart: the studio's own.
BLUE_ORANGE = ["#1c3f84", "#2f69ad", "#6ba0cf", "#b4cfe4", "#efefec", "#f3cfa0", "#e79c4c", "#c4691c", "#8a3f08"]
DIVERGING = LinearSegmentedColormap.from_list("blue-orange", BLUE_ORANGE)
TICK_ROOM = 0.09  # of a scale: what a number needs of its height
DESIGNED, REALISED, LIMIT = "#a9c4de", "#1f3f66", "#b35806"
UNIT_OF_VALUE = {"%": "%", "1/m": "/m"}
STYLE: dict[str, Any] = {
    "font.size": 9.0, "axes.titlesize": 9.5, "axes.linewidth": 0.6, "axes.edgecolor": "#666666",
    "xtick.color": "#444444", "ytick.color": "#444444", "axes.labelcolor": "#444444", "text.color": "#222222",
    "xtick.major.width": 0.6, "ytick.major.width": 0.6, "legend.frameon": False, "svg.hashsalt": "mirror-cad",
}


def pair_maps(deviation: Deviation, outline: Outline, pairs: list[Pair]) -> bytes:
    """Designed beside realised, each pair on its own one scale; PNG."""
    frame = _Frame.of(deviation, outline)
    widths = [1.0, 1.0, 0.06, 0.42] * len(pairs)
    with matplotlib.rc_context(STYLE):
        figure, row = _row_of_maps(frame, widths[:-1])
        for i, pair in enumerate(pairs):
            left, right, bar, *gap = row[4 * i: 4 * i + 4]
            radii, (low, high) = pair.unit == "mm", pair.scale()
            if radii:  # by curvature, as the eye sees a radius and as the studio draws it
                low, high = sorted((1e3 / low, 1e3 / high))
            for axes, values, which in ((left, pair.designed, "designed"), (right, pair.realised, "realised")):
                drawn = frame.draw(axes, 1e3 / values if radii else values, "viridis", low, high)
                axes.set_title(f"{pair.name} {which}", loc="left")
            right.tick_params(left=False, labelleft=False)
            _colour_bar(figure, drawn, bar, f"{pair.name}, {pair.unit}")
            if radii:
                ticks = radius_ticks(*pair.scale())
                bar.set_yticks([1e3 / tick for tick in ticks], labels=[plain(tick) for tick in ticks])
                bar.minorticks_off()
            for empty in gap:
                empty.remove()
        row[0].set_ylabel("y, mm")
        return _png(figure)


def deviation_maps(deviation: Deviation, outline: Outline, fields: DeviationFields) -> bytes:
    """The five deviations on one scale about zero, worst points ringed, the limit as contours on k1 and k2; PNG."""
    frame = _Frame.of(deviation, outline)
    scale = fields.scale
    with matplotlib.rc_context(STYLE):
        figure, row = _row_of_maps(frame, [1.0] * len(QUANTITIES) + [0.06], two_line_titles=True)
        for key, axes in zip(QUANTITIES, row, strict=False):
            drawn = frame.draw(axes, fields.values[key], DIVERGING, -scale, scale)
            if fields.limit is not None and not fields.limit_is_far and key in ("k1", "k2"):
                frame.contour(axes, fields.values[key], [-fields.limit, fields.limit])
            worst, at = fields.worst[key]
            if worst != 0.0:
                for colour, width in (("white", 2.6), ("black", 1.1)):
                    axes.plot(*at, "o", ms=7, mfc="none", mec=colour, mew=width, clip_on=False)
            axes.set_title(f"{key}\nworst {with_unit(worst, UNIT_OF_VALUE[fields.unit], sign=True)}", loc="left")
            if key != QUANTITIES[0]:
                axes.tick_params(left=False, labelleft=False)
        row[0].set_ylabel("y, mm")
        bar = row[len(QUANTITIES)]
        _colour_bar(figure, drawn, bar, f"deviation, {fields.unit}")
        if fields.limit is not None and not fields.limit_is_far:
            # Numbers beside the limit would lie under its name.
            bar.set_yticks([tick for tick in bar.get_yticks()
                            if abs(tick) <= scale and abs(abs(tick) - fields.limit) > 0.12 * scale])
            bar.yaxis.labelpad = 14.0
            for limit in (-fields.limit, fields.limit):
                bar.axhline(limit, color="black", lw=1.2)
                bar.annotate(" limit", (1.0, limit), xycoords=("axes fraction", "data"), va="center", fontsize=8.0,
                             bbox={"fc": "white", "ec": "none", "pad": 0.6})
        return _png(figure)


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """How a map lies on its axes: the grid, its edges and the outline that cuts it."""

    deviation: Deviation
    extent: tuple[float, float, float, float]
    rim: Array

    @staticmethod
    def of(deviation: Deviation, outline: Outline) -> _Frame:
        return _Frame(deviation, outline.bounding_box(), outline.polyline(0.05))

    def draw(self, axes: Axes, values: Array, colours: str | Colormap, low: float, high: float) -> AxesImage:
        drawn = axes.imshow(self._beyond_the_rim(values).T, origin="lower", extent=self.extent, cmap=colours,
                            norm=Normalize(low, high), interpolation="bilinear", aspect="equal")
        drawn.set_clip_path(Polygon(self.rim.tolist(), closed=True, transform=axes.transData))
        axes.add_patch(Polygon(self.rim.tolist(), closed=True, fill=False, ec="#555555", lw=0.7, clip_on=False))
        for side in axes.spines.values():
            side.set_visible(False)
        x_min, x_max, y_min, y_max = self.extent
        axes.set_xticks(_ticks(x_min, x_max, 3))
        axes.set_yticks(_ticks(y_min, y_max, 7 if y_max - y_min > 0.8 * (x_max - x_min) else 3))
        axes.tick_params(labelsize=8.0, length=2.5)
        axes.set_xlabel("x, mm")
        return drawn

    def contour(self, axes: Axes, values: Array, levels: list[float]) -> None:
        grid = self.deviation.grid
        if not levels[0] < float(values.max()) or not levels[-1] > float(values.min()):
            return
        lines = axes.contour(grid.cells_x, grid.cells_y, self._beyond_the_rim(values).T, levels, colors="black",
                             linewidths=1.1, linestyles="solid")
        lines.set_clip_path(Polygon(self.rim.tolist(), closed=True, transform=axes.transData))

    def _beyond_the_rim(self, values: Array) -> Array:
        """The map continued by three cells, so that the outline and not the cells' staircase cuts it."""
        rectangle = self.deviation.grid.as_map(values)
        for _ in range(3):
            padded = np.pad(rectangle, 1, constant_values=np.nan)
            around = np.stack([padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]])
            known = np.isfinite(around)
            number_known = known.sum(axis=0)
            mean = np.where(known, around, 0.0).sum(axis=0) / np.maximum(number_known, 1)
            rectangle = np.where(np.isnan(rectangle) & (number_known > 0), mean, rectangle)
        return rectangle


def radius_ticks(low: float, high: float) -> list[float]:
    """Round radii, mm, from `low` to `high` of one sign, as many as have room on a scale that is even in curvature."""
    found: list[float] = []
    span = abs(1.0 / low - 1.0 / high)
    for most in (3, 5, 9, 17, 33):  # the roundest first
        for tick in MaxNLocator(most, steps=[1, 2, 5, 10]).tick_values(low, high):
            if low <= tick <= high and all(abs(1.0 / tick - 1.0 / other) >= TICK_ROOM * span for other in found):
                found.append(float(tick))
    return sorted(found)


def _ticks(low: float, high: float, most: int) -> Array:
    """Ticks far enough from the map's sides that their numbers do not meet the next map's."""
    margin = 0.05 * (high - low)
    ticks: Array = np.asarray(MaxNLocator(most, steps=[1, 2, 5, 10]).tick_values(low + margin, high - margin))
    return ticks[(ticks >= low + margin) & (ticks <= high - margin)]


def _row_of_maps(frame: _Frame, widths: list[float], two_line_titles: bool = False) -> tuple[Figure, list[Axes]]:
    """A figure as high as maps of this outline need to be, with one row of axes of these relative widths."""
    x_min, x_max, y_min, y_max = frame.extent
    left, right, space = 0.055, 0.935, 0.1
    mean = sum(widths) / len(widths)
    map_width = WIDTH_IN * (right - left) / (sum(widths) + space * mean * (len(widths) - 1))
    map_height = float(np.clip(map_width * (y_max - y_min) / (x_max - x_min), 0.8, 6.0))
    above, below = (0.55 if two_line_titles else 0.34), 0.5
    height = map_height + above + below
    figure = Figure(figsize=(WIDTH_IN, height))
    grid = figure.add_gridspec(1, len(widths), width_ratios=widths, left=left, right=right, wspace=space,
                               bottom=below / height, top=1.0 - above / height)
    return figure, [figure.add_subplot(grid[0, i]) for i in range(len(widths))]


def _colour_bar(figure: Figure, drawn: AxesImage, bar: Axes, label: str) -> None:
    figure.colorbar(drawn, cax=bar)
    bar.set_ylabel(label, fontsize=8.5)
    bar.tick_params(labelsize=8.0, length=2.5)
    bar.ticklabel_format(axis="y", useOffset=False)


def _png(figure: Figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DPI, metadata={"Software": None})
    return file.getvalue()
