"""Draw what straight lines of the far world and of the scene look like in the mirrors; SVG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_studio.drive.drawings import LINE, X_LABEL, box_around, height_of, in_lines, mirror_panel, outline_of, said_twice
from mirror_studio.drive.measured import Measured
from mirror_studio.report.drawing import WIDTH, drawing, legend
from mirror_studio.report.map_panel import MapPanel

Array = NDArray[np.float64]

MAX_BESIDE, WIDEST = 4, 0.4  # mirrors in one row; a mirror, of the page's width
LEFT, RIGHT, BELOW, HIGHEST = 62.0, 10.0, 56.0, 560.0  # px: numbers of y, room beside, numbers of x; of a mirror
FAINT, FIFTH = ("#c6ccd1", 0.6), ("#8d979f", 1.0)
LINES = {"horizon": ("#0072b2", 2.0, ""), "lane line": ("#b58900", 2.6, ""), "its chord": ("#b58900", 1.1, "5 3"),
         "column": ("#444c54", 3.2, "")}


def line_drawings(path: Path, mirrors: Sequence[Measured]) -> float:
    """Write what a 1° grid of the far world, the horizon, lane lines and the column look like in each mirror.

    Seen from between the eyes. Returns the drawing's width as a share of the page's, at which its text is as large as that of
    the others.
    """
    columns = min(len(mirrors), MAX_BESIDE)
    share = min(1.0, columns * WIDEST)
    cell = share * WIDTH / columns
    width, top, shown, parts = cell - LEFT - RIGHT, 0.0, set[str](), []
    rims = [outline_of(each.mirror.reflector) for each in mirrors]
    for first in range(0, len(mirrors), columns):
        row = range(first, min(first + columns, len(mirrors)))
        names = [in_lines(mirrors[k].mirror.name) for k in row]
        heights = [height_of(box_around(rims[k]), width, HIGHEST) for k in row]
        top += LINE * max(map(len, names)) + 10.0
        for column, (k, name, height) in enumerate(zip(row, names, heights, strict=True)):
            panel = mirror_panel(column * cell + LEFT, top, width, height, box_around(rims[k]), rims[k], k)
            if not mirrors[k].orientation.twice:
                shown |= _lines(panel, mirrors[k])
            parts.append(panel.svg(name, True, X_LABEL))
            if mirrors[k].orientation.twice:
                parts += said_twice(panel.left + 0.5 * panel.width, top + 0.5 * height)
        top += max(heights) + BELOW
    keys = [(name, colour, thick, 1.0, dash) for name, (colour, thick, dash) in LINES.items() if name in shown]
    parts.append(legend(share * WIDTH - RIGHT, top + 10.0, keys))
    path.write_bytes(drawing(top + 18.0, parts, share * WIDTH))
    return share


def _lines(panel: MapPanel, each: Measured) -> set[str]:
    """The grid, the horizon, the lane line and the column, each in the mirror; returns the names of those that are there."""
    found = each.grid
    nodes = np.where(_spread(found.shown)[..., None], found.on_plane, np.nan)
    # Where they are on the mirror, as its edge is drawn, not where the eye's rays go through the plane z = 0.
    on_mirror = each.mirror.views.middle.untrimmed.trace_points(nodes.reshape(-1, 2)).on_mirror[:, :2].reshape(nodes.shape)
    bundles = (on_mirror, found.elevation_deg), (np.swapaxes(on_mirror, 0, 1), found.azimuth_deg)
    for style, fifth in ((FAINT, False), (FIFTH, True)):
        for lines, degrees in bundles:
            which = (np.round(degrees) % 5 == 0) == fifth
            panel.line(_one_after_another(lines[which]), *style)
    drawn: dict[str, Array] = {}
    horizon = np.flatnonzero(np.abs(found.elevation_deg) < 1e-9)
    if horizon.size:
        drawn["horizon"] = on_mirror[horizon[0]]
    if each.bow is not None:
        drawn["lane line"] = each.bow.image.on_mirror[:, :2]
        drawn["its chord"] = drawn["lane line"][[0, -1]]
    if each.tilt is not None:
        drawn["column"] = each.tilt.image.on_mirror[:, :2]
    for name, line in drawn.items():
        panel.line(line, *LINES[name])
    return set(drawn)


def _one_after_another(lines: Array) -> Array:
    """Lines (n, m, 2) as one, with rows of NaN between."""
    return np.concatenate([lines, np.full((len(lines), 1, 2), np.nan)], axis=1).reshape(-1, 2)


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
