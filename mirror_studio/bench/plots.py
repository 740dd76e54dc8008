"""Plot a table as curves on logarithmic axes, as PNG."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from mirror_studio.bench.table import Plot, Table
from mirror_studio.report.figure_style import DPI, STYLE, WIDTH_IN

PANELS_A_ROW = 3
PANEL_HEIGHT_IN, LEGEND_LINE_IN, LEGEND_COLUMNS = 2.75, 0.22, 4
# Okabe and Ito's colours without the yellow, which is too faint for a line, and a mark for each: told apart in grey too.
COLOURS: tuple[str, ...] = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#595959", "#000000")
MARKS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">")
NARROW_DECADES = 1.8  # an axis of less holds no two powers of ten to speak of: 1, 2 and 5 are marked too


def figure_of(table: Table) -> bytes | None:
    """The plots of a table side by side, with one legend; None where it has none."""
    plots = [plot for plot in table.plots if _drawn(table, plot)]
    if not plots:
        return None
    series = list(dict.fromkeys(str(row.get(plot.series)) for plot in plots if plot.series for row in table.rows))
    legend = len(series) > 1
    beside = legend and len(plots) == 1
    lines = -(-len(series) // LEGEND_COLUMNS) if legend and not beside else 0
    across = min(PANELS_A_ROW, len(plots))
    down = -(-len(plots) // across)
    below = LEGEND_LINE_IN * lines + (0.15 if lines else 0.0)
    height = PANEL_HEIGHT_IN * down + below
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, height))
        axes = figure.subplots(down, across, squeeze=False, gridspec_kw={
            "left": 0.075, "right": 0.65 if len(plots) == 1 else 0.985, "wspace": 0.3, "hspace": 0.5,
            "bottom": (below + 0.48) / height, "top": 1.0 - 0.28 / height}).ravel()
        for plot, one in zip(plots, axes, strict=False):
            _draw(one, table, plot, series)
        for unused in axes[len(plots):]:
            unused.remove()
        if legend:
            handles = [Line2D([], [], label=name, **_look(i)) for i, name in enumerate(series)]
            place = {"loc": "center left", "bbox_to_anchor": (0.67, 0.5)} if beside else {"loc": "lower center"}
            figure.legend(handles=handles, ncols=1 if beside else min(LEGEND_COLUMNS, len(series)), fontsize=8.5,
                          handlelength=2.4, columnspacing=1.8, **place)
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=DPI, metadata={"Software": None})
        return file.getvalue()


def _draw(axes: Axes, table: Table, plot: Plot, series: Sequence[str]) -> None:
    for i, name in enumerate(series if plot.series else [""]):
        rows = [row for row in table.rows if plot.series is None or str(row.get(plot.series)) == name]
        points = [(row[plot.x], row[plot.y]) for row in rows if _positive(row.get(plot.x)) and _positive(row.get(plot.y))]
        look = _look(i)
        if points:
            axes.plot(*np.array(points, dtype=np.float64).T, ms=4.5, **look)
        elif len(rows) == 1 and _positive(rows[0].get(plot.y)):
            axes.axhline(rows[0][plot.y], color=look["color"], lw=1.3, ls=(0, (5, 2)))  # it has no step: a level for all
    axes.set_xscale("log")
    axes.set_yscale("log")
    titles = {column.key: column.title for column in table.columns}
    axes.set_xlabel(titles[plot.x])
    axes.set_ylabel(titles[plot.y])
    axes.set_title(plot.title, loc="left")
    for axis in (axes.xaxis, axes.yaxis):
        low, high = axis.get_view_interval()
        if np.log10(high / low) > NARROW_DECADES:
            axis.set_major_locator(LogLocator(10.0, numticks=7))
        else:
            axis.set_major_locator(LogLocator(10.0, subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e4e4e4", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8.5, which="both")


def _drawn(table: Table, plot: Plot) -> bool:
    return any(_positive(row.get(plot.x)) and _positive(row.get(plot.y)) for row in table.rows)


def _look(i: int) -> dict[str, Any]:
    return {"color": COLOURS[i % len(COLOURS)], "marker": MARKS[i % len(MARKS)], "lw": 1.3,
            "ls": "-" if i < len(COLOURS) else "--"}


def _positive(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and bool(0.0 < value < np.inf)
