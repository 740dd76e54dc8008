"""Draw what the mirrors show while they are turned about their upright axes; SVG."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirror_studio.drive.measured import Measured, turned_figures
from mirror_studio.report.drawing import SMALL, SOFT, WIDTH, Panel, Range, drawing, legend

Array = NDArray[np.float64]

PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b58900", "#56b4e9", "#1d2329")
DASHES = "", "7 3", "2 2", "9 3 2 3"
LEFT, RIGHT, APART, TOP, HEIGHT, BELOW, ROW = 42.0, 12.0, 58.0, 26.0, 250.0, 58.0, 20.0  # px
TITLES = "azimuths on the horizon's row, ° from straight rearward (+ to the right)", \
    "length of the lane beside that is in no view, m (▲ and more)"
X_LABEL = "yaw beside the aim, ° (+ turns the face towards the vehicle)"
Key = tuple[str, str, float, float, str]


def turned_drawing(path: Path, mirrors: Sequence[Measured]) -> None:
    """Write what the horizon's row shows, and how long the lane beside is in no view, while the mirrors are turned."""
    width = 0.5 * (WIDTH - LEFT - APART - RIGHT)
    found = [turned_figures(each) for each in mirrors]
    yaw = _range([each.yaw_deg for each in found], 0.05)
    shown = Panel(LEFT, TOP, width, HEIGHT, yaw,
                  _range([angles for each in found for angles in (each.azimuth_from_deg, each.azimuth_to_deg)], 0.05))
    length = Panel(LEFT + width + APART, TOP, width, HEIGHT, yaw,
                   _range([np.append(each.blind_length_m, 0.0) for each in found], 0.08))
    keys: list[Key] = []
    for each, turned, colour, dash in zip(mirrors, found, cycle(PALETTE), cycle(DASHES), strict=False):  # alike: on each other
        both = np.isfinite(turned.azimuth_from_deg) & np.isfinite(turned.azimuth_to_deg)
        low, high = (np.where(both, angles, np.nan) for angles in (turned.azimuth_from_deg, turned.azimuth_to_deg))
        shown.band(turned.yaw_deg, low, high, colour, 0.10)
        for edge in (low, high):
            shown.line(turned.yaw_deg, edge, colour, 1.8, dash)
        length.line(turned.yaw_deg, turned.blind_length_m, colour, 2.0, dash)
        endless = turned.blind_endless & np.isfinite(turned.blind_length_m)
        length.triangles(turned.yaw_deg[endless], turned.blind_length_m[endless], colour)
        keys.append((each.mirror.name, colour, 2.0, 1.0, dash))
    for panel in (shown, length):
        panel.upright(0.0, SOFT, 0.9)
    parts = [panel.svg(k, title, X_LABEL) for k, (panel, title) in enumerate(zip((shown, length), TITLES, strict=True))]
    base = TOP + HEIGHT + BELOW
    for row in _rows(keys):
        parts.append(legend(WIDTH - RIGHT, base, row))
        base += ROW
    path.write_bytes(drawing(base - ROW + 8.0, parts))


def _range(values: Sequence[Array], margin: float) -> Range:
    """From the least to the largest of what is finite, with a margin of that; 0 to 1 of nothing."""
    known = np.concatenate(values)
    known = known[np.isfinite(known)]
    if known.size == 0:
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    room = margin * (high - low) or 0.5
    return low - room, high + room


def _rows(keys: Sequence[Key]) -> list[list[Key]]:
    """Keys in rows that are no wider than the drawing."""
    longest = max(len(key[0]) for key in keys)
    count = max(1, int((WIDTH - RIGHT) / (0.53 * SMALL * longest + 44.0)))
    return [list(islice(keys, first, first + count)) for first in range(0, len(keys), count)]
