"""Draw maps over mirrors and lines seen in them, as PNG files."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, TwoSlopeNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mirror_studio.drive.measured import Measured, turned_figures
from raytrace.reflector import Reflector
from raytrace.viewing.bezel import edge_loop

Array = NDArray[np.float64]

INK, SOFT, FAINT = "#1d2329", "#5b6670", "#c6ccd1"
LEFT_EYE, RIGHT_EYE = "#0072b2", "#d55e00"  # Okabe and Ito: told apart by all
LANE, COLUMN, HORIZON = "#b58900", "#444c54", "#0072b2"
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b58900", "#56b4e9", "#1d2329")
STYLES: tuple[Any, ...] = ("solid", (0, (5, 2)), (0, (1.5, 1.5)), (0, (7, 2, 1.5, 2)))
DPI = 150
SIZE, SMALL = 9.0, 7.5
LEVELS = 9
PAGE_WIDTH = 11.0  # inches of a drawing as wide as the page
MAX_BESIDE, WIDEST_PANEL = 4, 4.4  # mirrors in one row; inches
# Inches of height for a panel's title and labels, for each further line of the title, and for a row of a legend.
ABOUT_PANEL, TITLE_LINE, LEGEND_ROW = 0.55, 0.16, 0.25
MARGIN_MM = 8.0  # around a mirror in its axes
LEGEND_CHARACTERS, LEGEND_MARK = 150, 8  # of a legend as wide as the page: all, and what a line's sample takes
LONGEST_LINE = 32  # characters of a panel's title


def in_lines(name: str) -> str:
    """A mirror's name in lines that are no longer than a panel is wide."""
    return "\n".join(textwrap.wrap(name, LONGEST_LINE)) or name


def outline_of(reflector: Reflector) -> Array:
    """The mirror's edge in (x, y), closed; mm."""
    points = edge_loop(reflector)[:, :2]
    return np.concatenate([points, points[:1]])


def mirror_axes(axes: Axes, reflector: Reflector, title: str, labels: bool) -> None:
    """Axes over a mirror with its edge, as the driver looks at it."""
    edge = outline_of(reflector)
    axes.plot(edge[:, 0], edge[:, 1], color=INK, linewidth=1.0)
    axes.set_aspect("equal")
    axes.set_xlim(edge[:, 0].min() - MARGIN_MM, edge[:, 0].max() + MARGIN_MM)
    axes.set_ylim(edge[:, 1].min() - MARGIN_MM, edge[:, 1].max() + MARGIN_MM)
    axes.set_title(in_lines(title), fontsize=SIZE, color=INK)
    axes.tick_params(labelsize=SMALL, colors=SOFT, length=2.5)
    for spine in axes.spines.values():
        spine.set_visible(False)
    if labels:
        axes.set_xlabel("x, mm (driver's side →)", fontsize=SMALL, color=SOFT)


def magnification_maps(path: Path, mirrors: Sequence[Measured]) -> None:
    """Horizontal and vertical magnification, their ratio and the binocular disparity.

    A row for each mirror, one scale for all of them in a column.
    """
    columns: Any = (("horizontal magnification", lambda m: m.magnification.magnification.horizontal, "viridis", None),
                    ("vertical magnification", lambda m: m.magnification.magnification.vertical, "viridis", None),
                    ("horizontal over vertical", lambda m: m.magnification.magnification.ratio, "PuOr", 1.0),
                    ("binocular disparity, %", _disparity, "RdBu_r", 0.0))
    figure = Figure(figsize=(PAGE_WIDTH, 0.5 + 3.3 * len(mirrors)), dpi=DPI, layout="constrained")
    grid: Any = figure.subplots(len(mirrors), len(columns), squeeze=False)
    for j, (title, values_of, colours, centre) in enumerate(columns):
        values = [values_of(each) for each in mirrors]
        norm = _scale(values, centre)
        image = None
        for i, (each, field) in enumerate(zip(mirrors, values, strict=True)):
            axes = grid[i, j]
            x, y = (each.magnification.x, each.magnification.y) if j < 3 else (each.disparity.x, each.disparity.y)
            image = axes.pcolormesh(x, y, np.ma.masked_invalid(field), cmap=colormaps[colours], norm=norm, shading="nearest",
                                    rasterized=True)
            if np.isfinite(field).any() and float(np.ptp(field[np.isfinite(field)])) > 1e-3:
                lines = axes.contour(x, y, np.ma.masked_invalid(field), levels=_levels(norm), colors=INK, linewidths=0.5)
                axes.clabel(lines, fontsize=6, fmt="%g")
            mirror_axes(axes, each.mirror.reflector, title if i == 0 else "", labels=i == len(mirrors) - 1)
            if j == 0:
                axes.set_ylabel(in_lines(each.mirror.name), fontsize=SIZE, color=INK)
        if image is not None:
            bar = figure.colorbar(image, ax=grid[:, j], location="bottom", shrink=0.85, aspect=28, pad=0.01)
            bar.ax.tick_params(labelsize=SMALL, colors=SOFT)
    save(figure, path)


def line_drawings(path: Path, mirrors: Sequence[Measured]) -> float:
    """What a 1° grid of the far world, the horizon, lane lines and the column look like in each mirror.

    Seen from between the eyes. Returns the picture's width as a share of the page's, at which its text is as large as that of
    the others.
    """
    columns, rows = min(len(mirrors), MAX_BESIDE), 1 + (len(mirrors) - 1) // MAX_BESIDE
    width = min(WIDEST_PANEL, PAGE_WIDTH / columns)
    titles = max(in_lines(each.mirror.name).count("\n") for each in mirrors)
    panel = width * _aspect(mirrors) + ABOUT_PANEL + TITLE_LINE * titles
    figure = Figure(figsize=(columns * width, rows * panel + LEGEND_ROW * (1 if columns > 1 else 2)), dpi=DPI,
                    layout="constrained")
    grid: Any = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.ravel()[len(mirrors):]:
        axes.set_axis_off()
    for axes, each in zip(grid.ravel(), mirrors, strict=False):
        mirror_axes(axes, each.mirror.reflector, each.mirror.name, labels=axes in grid[-1])
        if each.orientation.twice:
            said_twice(axes)
            continue
        _lines(axes, each)
        edge = outline_of(each.mirror.reflector)
        axes.fill(np.concatenate([edge[:, 0], _around(axes)[:, 0]]), np.concatenate([edge[:, 1], _around(axes)[:, 1]]),
                  color="white", zorder=3, linewidth=0)
        axes.plot(edge[:, 0], edge[:, 1], color=INK, linewidth=1.2, zorder=4)
    handles = {label: handle for axes in grid.ravel() for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4 if columns > 1 else 2, fontsize=SMALL,
                  frameon=False)
    save(figure, path)
    return columns * width / PAGE_WIDTH


def _aspect(mirrors: Sequence[Measured]) -> float:
    """Height over width of the axes that hold every one of the mirrors without a gap."""
    sizes = [np.ptp(outline_of(each.mirror.reflector), axis=0) + 2.0 * MARGIN_MM for each in mirrors]
    return max(float(size[1] / size[0]) for size in sizes)


def _lines(axes: Axes, each: Measured) -> None:
    """The grid, the horizon, the lane line and the column, each in the mirror."""
    found = each.grid
    nodes = np.where(_spread(found.shown)[..., None], found.on_plane, np.nan)
    # Where they are on the mirror, as its edge is drawn, not where the eye's rays go through the plane z = 0.
    on_mirror = each.mirror.views.middle.untrimmed.trace_points(nodes.reshape(-1, 2)).on_mirror[:, :2].reshape(nodes.shape)
    for lines, degrees in ((on_mirror, found.elevation_deg), (np.swapaxes(on_mirror, 0, 1), found.azimuth_deg)):
        for line, angle in zip(lines, degrees, strict=True):
            fifth = round(float(angle)) % 5 == 0
            axes.plot(line[:, 0], line[:, 1], color=FAINT if not fifth else "#8d979f", linewidth=0.35 if not fifth else 0.7)
    horizon = np.flatnonzero(np.abs(found.elevation_deg) < 1e-9)
    if horizon.size:
        axes.plot(*on_mirror[horizon[0]].T, color=HORIZON, linewidth=1.4, label="horizon")
    if each.bow is not None:
        line = each.bow.image.on_mirror[:, :2]
        axes.plot(*line.T, color=LANE, linewidth=1.8, label="lane line")
        axes.plot(*line[[0, -1]].T, color=LANE, linewidth=0.7, linestyle=(0, (4, 3)), label="its chord")
    if each.tilt is not None:
        axes.plot(*each.tilt.image.on_mirror[:, :2].T, color=COLUMN, linewidth=2.2, label="column")


def said_twice(axes: Axes) -> None:
    """In place of what is not measured."""
    axes.text(0.5, 0.5, "some things are shown twice:\nnot measured", transform=axes.transAxes, fontsize=SIZE, color=INK,
              ha="center", va="center", zorder=9)


def _disparity(each: Measured) -> Array:
    return np.full_like(each.disparity.percent, np.nan) if each.orientation.twice else each.disparity.percent


def _around(axes: Axes) -> Array:
    """The corners of the axes' box, the other way round than an outline, so that what lies between is filled."""
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    return np.array([[x0, y0], [x0, y1], [x1, y1], [x1, y0], [x0, y0]])


def _spread(shown: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Nodes that are shown, and those beside them: lines are drawn up to the edge."""
    found = shown.copy()
    for axis in (0, 1):
        for shift in (1, -1):
            moved = np.roll(shown, shift, axis=axis)
            edge = [slice(None), slice(None)]
            edge[axis] = slice(0, 1) if shift == 1 else slice(-1, None)
            moved[tuple(edge)] = False
            found |= moved
    return found


def _scale(fields: Sequence[Array], centre: float | None) -> Normalize:
    """One scale for fields; about a value that has no colour, if there is one."""
    known = np.concatenate([field[np.isfinite(field)] for field in fields])
    if known.size == 0:
        return Normalize(0.0, 1.0)
    low, high = float(known.min()), float(known.max())
    if centre is None:
        return Normalize(low if high - low > 1e-6 else low - 0.5, high if high - low > 1e-6 else high + 0.5)
    reach = max(high - centre, centre - low, 1e-3)
    return TwoSlopeNorm(centre, centre - reach, centre + reach)


def _levels(norm: Normalize) -> Array:
    low, high = float(norm.vmin or 0.0), float(norm.vmax or 1.0)
    rough = (high - low) / LEVELS
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= rough)
    levels: Array = np.arange(np.ceil(low / step), np.floor(high / step) + 1.0) * step
    return levels


def turned_drawing(path: Path, mirrors: Sequence[Measured]) -> None:
    """What the horizon's row shows, and how long the lane beside is in no view, while the mirrors are turned."""
    names = [each.mirror.name for each in mirrors]
    columns = max(1, min(len(names), int(LEGEND_CHARACTERS / (max(map(len, names)) + LEGEND_MARK))))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(PAGE_WIDTH, 3.15 + LEGEND_ROW * rows), dpi=DPI, layout="constrained")
    grid: Any = figure.subplots(1, 2)
    for k, each in enumerate(mirrors):
        colour, style = PALETTE[k % len(PALETTE)], STYLES[k % len(STYLES)]  # mirrors alike lie on each other
        turned = turned_figures(each)
        yaw, low, high = turned.yaw_deg, turned.azimuth_from_deg, turned.azimuth_to_deg
        grid[0].fill_between(yaw, low, high, color=colour, alpha=0.10, linewidth=0)
        for edge in (low, high):
            grid[0].plot(yaw, edge, color=colour, linewidth=1.4, linestyle=style,
                         label=each.mirror.name if edge is low else None)
        length, endless = turned.blind_length_m, turned.blind_endless
        grid[1].plot(yaw, length, color=colour, linewidth=1.6, linestyle=style)
        grid[1].plot(yaw[endless], length[endless], color=colour, linestyle="none", marker="^", markersize=6)
    for axes, title in zip(grid, ("azimuths shown on the horizon's row, ° from straight rearward (+ to the right)",
                                  "length of the lane beside that is in no view, m (▲ and more)"), strict=True):
        axes.set_title(title, fontsize=SIZE, color=INK, loc="left")
        axes.set_xlabel("yaw beside the aim, ° (+ turns the face towards the vehicle)", fontsize=SMALL, color=SOFT)
        axes.tick_params(labelsize=SMALL, colors=SOFT, length=2.5)
        axes.grid(color="#e8ebed", linewidth=0.6)
        axes.axvline(0.0, color=SOFT, linewidth=0.7)
        for spine in axes.spines.values():
            spine.set_color(FAINT)
    figure.legend(loc="outside lower center", ncols=columns, fontsize=SMALL, frameon=False)
    save(figure, path)


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG."""
    figure.savefig(path, dpi=DPI, metadata={"Software": None})
