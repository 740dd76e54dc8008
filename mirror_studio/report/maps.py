"""A CurvatureDeviation and its outline in, the report's figures out: maps as PNG, curves as SVG."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from mirror_cad.designed import FLOOR
from mirror_cad.deviation import CurvatureDeviation
from mirror_cad.differential import principal_curvatures_of
from mirror_cad.grid import Grid
from mirror_cad.outline import Outline
from mirror_studio.report.text import given, with_unit

Array = NDArray[np.float64]

DPI = 150
WIDTH_IN = 10.4
# A radius beyond this is as good as flat, and would leave the colours of a scale in mm to one end.
LARGEST_RADIUS_MM = 1e5
# Differences below these are the last digits of float64: a scale finer than this would paint them as structure.
LEAST_SPREAD = 1e-6  # of the values' size
LEAST_CURVATURE_PER_M = 1e-6
LEAST_PERCENT = 1e-6
BINS = 81  # of the histogram: odd, so that one is centred on zero
# A limit this many times beyond the largest deviation is named beside the scale: on it, the maps would be blank.
FAR_LIMIT = 3.0
# Beyond this a deviation is larger than the curvature it is a percent of, as where a law passes through zero: one line of
# such places would set the scale of all maps.
LARGEST_PERCENT = 100.0
SAME_SIZE = 1e-6  # relative: values that rounding alone tells apart, as a mirror that is symmetric in y has them

MARGINS = {"left": 0.07, "right": 0.98, "wspace": 0.19}  # fitting them to the labels would take longer than drawing
DESIGNED, REALISED, LIMIT = "#a9c4de", "#1f3f66", "#b35806"
UNIT_OF_VALUE = {"%": "%", "1/m": "/m"}
QUANTITIES = ("k1", "k2", "kx", "ky", "twist")
LINES = {"k1": ("#0072b2", "-"), "k2": ("#d55e00", "-"), "kx": ("#0072b2", "-"), "ky": ("#d55e00", "-"),
         "twist": ("#595959", "--")}
STYLE: dict[str, Any] = {
    "font.size": 9.0, "axes.titlesize": 9.5, "axes.linewidth": 0.6, "axes.edgecolor": "#666666",
    "xtick.color": "#444444", "ytick.color": "#444444", "axes.labelcolor": "#444444", "text.color": "#222222",
    "xtick.major.width": 0.6, "ytick.major.width": 0.6, "legend.frameon": False, "svg.hashsalt": "mirror-cad",
}


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """One quantity at the grid, designed and realised; `as_curvature` where a radius cannot be drawn."""

    name: str
    unit: str
    designed: Array
    realised: Array
    as_curvature: bool = False

    def scale(self) -> tuple[float, float]:
        """The one scale of both, in `unit`."""
        low = float(min(self.designed.min(), self.realised.min()))
        high = float(max(self.designed.max(), self.realised.max()))
        least = LEAST_CURVATURE_PER_M if self.unit == "1/m" else LEAST_SPREAD * max(abs(low), abs(high))
        return _widened(low, high, least)


@dataclass(frozen=True, slots=True, eq=False)
class DeviationFields:
    """Realised minus designed at the grid, in `unit`: percent, or 1/m for a plane and where percent mean nothing.

    worst : of each quantity the value largest in size, in `unit`, and its place in mm.
    limit : ± percent that k1 and k2 may have, None without one and in 1/m.   scale : the one scale of all, ± in `unit`.
    """

    values: dict[str, Array]
    unit: str
    worst: dict[str, tuple[float, tuple[float, float]]]
    limit: float | None

    @property
    def largest(self) -> float:
        return max(float(np.abs(field).max()) for field in self.values.values())

    @property
    def scale(self) -> float:
        least = LEAST_PERCENT if self.unit == "%" else LEAST_CURVATURE_PER_M
        largest = max(self.largest, least)
        return largest if self.limit is None or self.limit_is_far else max(largest, 1.1 * self.limit)

    @property
    def bin_width(self) -> float:
        """Of the histogram, in `unit`."""
        return 2.0 * self.scale / BINS

    @property
    def limit_is_far(self) -> bool:
        """Whether the limit lies too far outside the deviations to be drawn on their scale."""
        return self.limit is not None and self.limit > FAR_LIMIT * self.largest


def pairs_of(deviation: CurvatureDeviation) -> list[Pair]:
    """Rx, Ry (mm; as curvature, 1/m, where they are flat or change sign), Km and Ka of eq. 1 (1/m), at the grid."""
    designed, realised = deviation.designed, deviation.realised
    power = [[0.5e3 * (w.w11 + w.w22), 0.5e3 * (w.w11 - w.w22)] for w in (designed, realised)]
    return [_radius_pair("Rx", designed.w11, realised.w11), _radius_pair("Ry", designed.w22, realised.w22),
            Pair("Km", "1/m", power[0][0], power[1][0]), Pair("Ka", "1/m", power[0][1], power[1][1])]


def deviation_fields(deviation: CurvatureDeviation, limit_percent: float | None) -> DeviationFields:
    """The deviations the report draws, and where each is worst."""
    values, unit, limit = deviation.percent, "%", limit_percent
    if values is None or max(float(np.abs(field).max()) for field in values.values()) > LARGEST_PERCENT:
        after, before = (principal_curvatures_of(w) for w in (deviation.realised, deviation.designed))
        kx, ky, twist = (a - b for a, b in zip(deviation.realised, deviation.designed, strict=True))
        per_mm = {"k1": after[0] - before[0], "k2": after[1] - before[1], "kx": kx, "ky": ky, "twist": twist}
        values, unit, limit = {key: 1e3 * field for key, field in per_mm.items()}, "1/m", None
    return DeviationFields(values, unit, {key: _worst(field, deviation.grid) for key, field in values.items()}, limit)


def _worst(field: Array, grid: Grid) -> tuple[float, tuple[float, float]]:
    """The value largest in size and its place; of places that rounding alone tells apart the upper, as in deviation.json."""
    size = np.abs(field)
    ties = np.flatnonzero(size >= size.max() * (1.0 - SAME_SIZE))
    at = int(ties[np.argmax(grid.y[ties])])
    return float(field[at]), (float(grid.x[at]), float(grid.y[at]))


def pair_maps(deviation: CurvatureDeviation, outline: Outline, pairs: list[Pair]) -> bytes:
    """Designed beside realised, each pair on its own one scale; PNG."""
    frame = _Frame.of(deviation, outline)
    widths = [1.0, 1.0, 0.06, 0.42] * len(pairs)
    with matplotlib.rc_context(STYLE):
        figure, row = _row_of_maps(frame, widths[:-1])
        for i, pair in enumerate(pairs):
            left, right, bar, *gap = row[4 * i: 4 * i + 4]
            for axes, values, which in ((left, pair.designed, "designed"), (right, pair.realised, "realised")):
                drawn = frame.draw(axes, values, "viridis", *pair.scale())
                axes.set_title(f"{pair.name} {which}", loc="left")
            right.tick_params(left=False, labelleft=False)
            _colour_bar(figure, drawn, bar, f"{pair.name}, {pair.unit}")
            for empty in gap:
                empty.remove()
        row[0].set_ylabel("y, mm")
        return _png(figure)


def deviation_maps(deviation: CurvatureDeviation, outline: Outline, fields: DeviationFields) -> bytes:
    """The five deviations on one scale about zero, worst places ringed, the limit as contours on k1 and k2; PNG."""
    frame = _Frame.of(deviation, outline)
    scale = fields.scale
    with matplotlib.rc_context(STYLE):
        figure, row = _row_of_maps(frame, [1.0] * len(QUANTITIES) + [0.06], two_line_titles=True)
        for key, axes in zip(QUANTITIES, row, strict=False):
            drawn = frame.draw(axes, fields.values[key], "RdBu_r", -scale, scale)
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


def deviation_histogram(deviation: CurvatureDeviation, fields: DeviationFields) -> bytes:
    """Share of the mirror's area over deviation: k1 and k2 with the limit, and kx, ky, twist; SVG."""
    weights = deviation.grid.weights
    edges = np.linspace(-fields.scale, fields.scale, BINS + 1)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, 2.6))
        both = figure.subplots(1, 2, sharex=True, gridspec_kw={**MARGINS, "bottom": 0.17, "top": 0.98})
        for axes, keys in zip(both, (("k1", "k2"), ("kx", "ky", "twist")), strict=True):
            for key in keys:
                share, _ = np.histogram(fields.values[key], edges, weights=weights)
                colour, dash = LINES[key]
                axes.stairs(100.0 * share / weights.sum(), edges, color=colour, ls=dash, lw=1.3, label=key)
            axes.set_xlim(-fields.scale, fields.scale)
            axes.set_ylim(bottom=0.0)
            axes.set_xlabel(f"realised − designed, {fields.unit}")
            axes.legend(loc="upper right")
            _calm(axes)
        both[0].set_ylabel("share of area, %")
        _limit_lines(both[0], fields, both[0].axvline)
        return _svg(figure)


def centre_sections(deviation: CurvatureDeviation, pairs: list[Pair], fields: DeviationFields) -> tuple[bytes, float]:
    """Rx and Ry along the grid's row nearest y = 0, designed and realised, and their deviation; SVG and that y, mm."""
    grid = deviation.grid
    row = int(np.argmin(np.abs(grid.cells_y)))
    rms = float(np.sqrt(np.average(deviation.designed.w11**2 + deviation.designed.w22**2, weights=grid.weights)))

    def along(values: Array) -> Array:
        return grid.as_map(values)[:, row]

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, 4.4))
        axes = figure.subplots(2, 2, sharex=True, height_ratios=[1.7, 1.0],
                               gridspec_kw={**MARGINS, "bottom": 0.1, "top": 0.95, "hspace": 0.15})
        for column, (pair, key) in enumerate(zip(pairs[:2], ("kx", "ky"), strict=True)):
            upper, lower = axes[0, column], axes[1, column]
            designed, realised = along(pair.designed), along(pair.realised)
            shown = [designed, realised]
            upper.plot(grid.cells_x, designed, color=DESIGNED, lw=4.5, label="designed", solid_capstyle="butt")
            upper.plot(grid.cells_x, realised, color=REALISED, lw=1.2, label="realised")
            if fields.limit is not None:
                kappa = along(deviation.designed.w11 if key == "kx" else deviation.designed.w22)
                allowed = fields.limit / 100.0 * np.maximum(np.abs(kappa), FLOOR * rms)
                band = _limit_band(kappa, allowed, pair.unit == "mm")
                if band is not None:
                    upper.fill_between(grid.cells_x, *band, color=LIMIT, alpha=0.16, lw=0,
                                       label=f"±{given(fields.limit, '%')} of curvature")
                    if not fields.limit_is_far:
                        shown += list(band)
            least = LEAST_CURVATURE_PER_M if pair.unit == "1/m" else 2e-3 * float(np.nanmax(np.abs(realised)))
            low, high = _widened(float(np.nanmin(shown)), float(np.nanmax(shown)), least)
            upper.set_ylim(low - 0.12 * (high - low), high + 0.22 * (high - low))
            upper.set_ylabel(f"{pair.name}, {pair.unit}")
            upper.legend(loc="best", fontsize=8.5)
            lower.axhline(0.0, color="#999999", lw=0.6)
            off = along(fields.values[key])
            lower.plot(grid.cells_x, off, color=REALISED, lw=1.2)
            span = max(1.15 * float(np.nanmax(np.abs(off))),
                       LEAST_PERCENT if fields.unit == "%" else LEAST_CURVATURE_PER_M)
            if fields.limit is not None and fields.limit <= FAR_LIMIT * span:
                span = max(span, 1.15 * fields.limit)
                for limit in (-fields.limit, fields.limit):
                    lower.axhline(limit, color=LIMIT, lw=1.0, ls=(0, (4, 2)))
            lower.set_ylim(-span, span)
            lower.set_ylabel(f"Δ{key}, {fields.unit}")
            lower.set_xlabel("x, mm")
            for one in (upper, lower):
                one.set_xlim(grid.cells_x[0], grid.cells_x[-1])
                one.yaxis.set_label_coords(-0.135, 0.5)
                one.ticklabel_format(axis="y", useOffset=False)
                _calm(one)
        return _svg(figure), float(grid.cells_y[row])


def _radius_pair(name: str, designed: Array, realised: Array) -> Pair:
    both = np.concatenate([designed, realised])
    one_sign = bool((both > 0.0).all() or (both < 0.0).all())
    if one_sign and float(np.abs(both).min()) * LARGEST_RADIUS_MM >= 1.0:
        return Pair(name, "mm", 1.0 / designed, 1.0 / realised)
    return Pair(f"1/{name}", "1/m", 1e3 * designed, 1e3 * realised, as_curvature=True)


def _limit_band(kappa: Array, allowed: Array, as_radius: bool) -> tuple[Array, Array] | None:
    low, high = kappa - allowed, kappa + allowed
    if not as_radius:
        return 1e3 * low, 1e3 * high
    # A limit of 100 % and more lets the curvature through zero, where the radius has no band.
    return None if bool((low * high <= 0.0).any()) else (1.0 / low, 1.0 / high)


def _limit_lines(axes: Axes, fields: DeviationFields, line: Callable[..., Any]) -> None:
    if fields.limit is None or fields.limit_is_far:
        return
    for limit in (-fields.limit, fields.limit):
        line(limit, color=LIMIT, lw=1.0, ls=(0, (4, 2)))
    axes.annotate(f" limit {given(fields.limit, '%')}", (fields.limit, 0.55), xycoords=("data", "axes fraction"),
                  color=LIMIT, fontsize=8.5, rotation=90, ha="right", va="center")


def _widened(low: float, high: float, least: float) -> tuple[float, float]:
    if high - low >= least:
        return low, high
    middle = 0.5 * (low + high)
    return middle - 0.5 * least, middle + 0.5 * least


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """How a map lies on its axes: the grid, its edges and the outline that cuts it."""

    deviation: CurvatureDeviation
    extent: tuple[float, float, float, float]
    rim: Array

    @staticmethod
    def of(deviation: CurvatureDeviation, outline: Outline) -> _Frame:
        return _Frame(deviation, outline.bounding_box(), outline.polyline(0.05))

    def draw(self, axes: Axes, values: Array, colours: str, low: float, high: float) -> AxesImage:
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


def _calm(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e4e4e4", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8.5)


def _png(figure: Figure) -> bytes:
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DPI, metadata={"Software": None})
    return file.getvalue()


def _svg(figure: Figure) -> bytes:
    file = io.BytesIO()
    # Without dates and names the same mirror gives the same page.
    figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    return file.getvalue()
