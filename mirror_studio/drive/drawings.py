"""What the drawings of a scene's mirrors have in common: colours, names in lines, and a mirror's place in a drawing."""

from __future__ import annotations

import textwrap

import numpy as np
from numpy.typing import NDArray

from mirror_studio.report.drawing import FONT, INK, text
from mirror_studio.report.map_panel import MapPanel
from raytrace.reflector import Reflector
from raytrace.viewing.bezel import edge_loop

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

LEFT_EYE, RIGHT_EYE = "#0072b2", "#d55e00"  # Okabe and Ito: told apart by all
THINNED = 1e-4  # of the mirror's size: less than a tenth of a pixel
LONGEST_LINE = 32  # characters of a panel's title
X_LABEL = "x, mm (driver's side →)"
TWICE = "some things are shown twice:", "not measured"
LINE = 15.0  # px, of text


def in_lines(name: str) -> list[str]:
    """A mirror's name in lines that are no longer than a panel is wide."""
    return textwrap.wrap(name, LONGEST_LINE) or [name]


def outline_of(reflector: Reflector) -> Array:
    """The mirror's edge in (x, y), a ring (n, 2) of no more points than are seen; mm."""
    ring = edge_loop(reflector)[:, :2]
    return thinned(ring, THINNED * float(np.ptp(ring, axis=0).max()))


def thinned(ring: Array, tolerance: float) -> Array:
    """The points of a ring (n, 2) from whose polygon none of the others is farther than a tolerance.

    References
    ----------
    Douglas and Peucker, Cartographica 10 (1973), 112
    """
    closed = np.concatenate([ring, ring[:1]])
    far = int(np.argmax(np.linalg.norm(ring - ring[0], axis=1)))
    kept, pieces = {0, far}, [(0, far), (far, len(ring))]
    while pieces:
        first, last = pieces.pop()
        between, chord = closed[first + 1:last] - closed[first], closed[last] - closed[first]
        if len(between) == 0:
            continue
        share = np.clip(between @ chord / max(float(chord @ chord), 1e-300), 0.0, 1.0)
        away = np.linalg.norm(between - share[:, None] * chord, axis=1)
        if away.max() > tolerance:
            worst = first + 1 + int(np.argmax(away))
            kept.add(worst)
            pieces += [(first, worst), (worst, last)]
    return ring[sorted(kept)]


def box_around(points: Array) -> Box:
    """x_min, x_max, y_min, y_max of points (n, 2)."""
    (x_min, y_min), (x_max, y_max) = points.min(axis=0), points.max(axis=0)
    return float(x_min), float(x_max), float(y_min), float(y_max)


def height_of(box: Box, width: float, highest: float) -> float:
    """How high, px, a box of mm may be drawn where it may be so wide and so high."""
    return min(width * (box[3] - box[2]) / (box[1] - box[0]), highest)


def mirror_panel(left: float, top: float, width: float, height: float, box: Box, rim: Array, number: int) -> MapPanel:
    """A mirror as the driver looks at it, as high as said, in the middle of the width."""
    wide = height * (box[1] - box[0]) / (box[3] - box[2])
    return MapPanel(left + 0.5 * (width - wide), top, wide, height, box, rim, number)


def said_twice(x: float, y: float) -> list[str]:
    """In place of what is not measured, about a point in px."""
    return [text(x, y + (k - 0.3) * LINE, line, FONT, INK, "middle", halo=True) for k, line in enumerate(TWICE)]
