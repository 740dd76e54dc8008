"""Places on the ground in, its colour there out: asphalt with lane lines between its edges, a verge beyond, no triangles.

Lines are where they are said to be, filtered over what a ray covers; all else is noise in world coordinates whose octaves
fade as a ray covers more of their waves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numba import njit
from numpy.typing import NDArray

from raytrace.errors import SceneError

Array = NDArray[np.float64]
LineColour = Literal["white", "yellow"]

# Reflectances, linear sRGB: white and yellow marking, used; grass and what else is beside a road. Asphalt's and its dust
# are relative.
PAINT = ((0.56, 0.56, 0.54), (0.52, 0.33, 0.045))
GREEN, STRAW, GRAVEL = (0.046, 0.070, 0.021), (0.118, 0.108, 0.046), (0.185, 0.170, 0.145)
ASPHALT, DUST = (1.02, 1.0, 0.955), (0.15, 0.11, 0.04)
LANE_MM = (2400.0, 5000.0)  # apart, two lines have a lane between them, with wheel tracks
MIN_SHARE = 0.004  # of a surface's light: a wave that is left less than this is left out
MIN_EXTENT_MM = 0.01  # what a ray covers at least: an edge has no width, the division needs one


@dataclass(frozen=True, slots=True)
class LaneLine:
    """A line along X, painted from y_mm − width_mm/2 to y_mm + width_mm/2.

    Parameters
    ----------
    y_mm, width_mm : mm.
    colour : "white" or "yellow".
    dash_mm : painted length of every period, mm; None for a solid line.
    period_mm, start_mm : of the dashes, mm, the first one from X = start_mm on.

    Raises
    ------
    SceneError
        For a width, dash or colour that is none.
    """

    y_mm: float
    width_mm: float = 150.0
    colour: LineColour = "white"
    dash_mm: float | None = None
    period_mm: float = 12_000.0
    start_mm: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite([self.y_mm, self.start_mm]).all() and 0.0 < self.width_mm < np.inf):
            raise SceneError(f"a lane line at y = {self.y_mm} mm needs a width above 0, not {self.width_mm} mm")
        if self.dash_mm is not None and not 0.0 < self.dash_mm < self.period_mm < np.inf:
            raise SceneError(f"the lane line at y = {self.y_mm:g} mm: dashes of {self.dash_mm:g} mm must be shorter than their "
                             f"period, {self.period_mm:g} mm")
        if self.colour not in get_args(LineColour):
            raise SceneError(f"the lane line at y = {self.y_mm:g} mm: colour {self.colour!r} is none of "
                             f"{', '.join(get_args(LineColour))}")


@dataclass(frozen=True)
class Road:
    """Asphalt all along X on the ground Z = 0, with gravel and grass beyond.

    Parameters
    ----------
    y_min_mm, y_max_mm : the asphalt's edges, mm, in order.
    lines : painted on it.

    Raises
    ------
    SceneError
        For edges that are not in order.
    """

    y_min_mm: float
    y_max_mm: float
    lines: tuple[LaneLine, ...] = ()

    def __post_init__(self) -> None:
        if not (np.isfinite([self.y_min_mm, self.y_max_mm]).all() and self.y_min_mm < self.y_max_mm):
            raise SceneError(f"a road's edges must be in order, not {self.y_min_mm} and {self.y_max_mm} mm")

    @cached_property
    def line_table(self) -> Array:
        """(k, 6): middle, half width, painted length (0: solid), period, start, and which colour."""
        return np.array([(line.y_mm, 0.5 * line.width_mm, line.dash_mm or 0.0, line.period_mm, line.start_mm,
                          get_args(LineColour).index(line.colour)) for line in self.lines]).reshape(-1, 6)

    @cached_property
    def lane_table(self) -> Array:
        """(k, 2): middle and half width of the lanes, between lines or a line and the edge."""
        sides = np.unique([self.y_min_mm, *(line.y_mm for line in self.lines), self.y_max_mm])
        wide = (np.diff(sides) >= LANE_MM[0]) & (np.diff(sides) <= LANE_MM[1])
        return np.stack([0.5 * (sides[1:] + sides[:-1]), 0.5 * np.diff(sides)], axis=1)[wide]

    def line_share(self, points: Array, extent: Array) -> Array:
        """Share of the box that each ray covers which is painted.

        Parameters
        ----------
        points : (n, ≥ 2), X and Y, mm.
        extent : (n, 2), half the box along X and Y, mm.

        Returns
        -------
        (n,), 0 … 1.
        """
        result = np.empty(len(points))
        _line_shares(points, extent, self.line_table, result)
        return result

    def colours(self, points: Array, extent: Array, out: Array) -> None:
        """Write the ground's diffuse reflectance, linear sRGB.

        Parameters
        ----------
        points, extent : as in `line_share`.
        out : (n, 3), what is written.
        """
        _colours(points, extent, np.array([self.y_min_mm, self.y_max_mm]), self.line_table, self.lane_table, out)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba's are
def _overlap(middle: float, half: float, low: float, high: float) -> float:
    """Share of middle ± half that lies between low and high."""
    half = max(half, MIN_EXTENT_MM)
    return max(min(middle + half, high) - max(middle - half, low), 0.0) / (2.0 * half)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _painted(x: float, dash: float, period: float) -> float:
    """Painted length from 0 to x of dashes that begin at multiples of the period."""
    count = np.floor(x / period)
    return count * dash + min(x - count * period, dash)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _line_share(x: float, y: float, ex: float, ey: float, lines: Array, k: int) -> float:
    if abs(y - lines[k, 0]) > lines[k, 1] + ey + MIN_EXTENT_MM:
        return 0.0
    share = _overlap(y, ey, lines[k, 0] - lines[k, 1], lines[k, 0] + lines[k, 1])
    if share > 0.0 and lines[k, 2] > 0.0:
        half, dash, period = max(ex, MIN_EXTENT_MM), lines[k, 2], lines[k, 3]
        x -= lines[k, 4]
        share *= (_painted(x + half, dash, period) - _painted(x - half, dash, period)) / (2.0 * half)
    return share


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _line_shares(points: Array, extent: Array, lines: Array, out: Array) -> None:
    for n in range(points.shape[0]):
        out[n] = 0.0
        for k in range(lines.shape[0]):
            out[n] += _line_share(points[n, 0], points[n, 1], extent[n, 0], extent[n, 1], lines, k)
        out[n] = min(out[n], 1.0)


# Odd multipliers of 64 bits (as signed numbers), whose products overflow into well mixed upper bits.
ALONG, ACROSS, SEED, MIX = -7046029254386353131, -4417276706812531889, 1609587929392839161, -4658895280553007687
LOW_24 = 0xFFFFFF


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _mixed(h: int) -> float:
    h = (h ^ (h >> 29)) * MIX
    return float((h >> 40) & LOW_24)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _random(i: int, j: int, seed: int) -> float:
    """A number in 0 … 1 for each lattice place."""
    return _mixed(i * ALONG + j * ACROSS + seed * SEED) / (LOW_24 + 1.0)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _noise(x: float, y: float, seed: int) -> float:
    """Value noise, −1 … 1, with waves of length 1."""
    i, j = np.floor(x), np.floor(y)
    a, b = x - i, y - j
    a, b = a * a * (3.0 - 2.0 * a), b * b * (3.0 - 2.0 * b)
    h = int(i) * ALONG + int(j) * ACROSS + seed * SEED
    near, far = _mixed(h), _mixed(h + ALONG)
    beside, over = _mixed(h + ACROSS), _mixed(h + ALONG + ACROSS)
    low = near + a * (far - near)
    return (low + b * (beside + a * (over - beside) - low)) * (2.0 / (LOW_24 + 1.0)) - 1.0


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _wave(share: float, x: float, y: float, ex: float, ey: float, length: float, width: float, seed: int) -> float:
    """Noise up to ±share with waves of `length` along X and `width` along Y, as the mean over the box has it.

    The standard deviation of a mean over k waves falls with √k. 0 where that leaves less than MIN_SHARE.
    """
    fade = (1.0 + 2.0 * ex / length) * (1.0 + 2.0 * ey / width)
    if fade * MIN_SHARE * MIN_SHARE > share * share:
        return 0.0
    return share * _noise(x / length, y / width, seed) / np.sqrt(fade)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _asphalt(x: float, y: float, ex: float, ey: float, lanes: Array, lines: Array) -> float:
    """Reflectance of worn asphalt."""
    # Stones; then what is unevenly mixed, and dust.
    tone = 1.0 + _wave(0.30, x, y, ex, ey, 6.0, 6.0, 11) + _wave(0.24, x, y, ex, ey, 12.6, 12.6, 12) \
        + _wave(0.18, x, y, ex, ey, 26.5, 26.5, 13) \
        + _wave(0.055, x, y, ex, ey, 210.0, 130.0, 21) + _wave(0.055, x, y, ex, ey, 850.0, 530.0, 22) \
        + _wave(0.055, x, y, ex, ey, 3500.0, 2200.0, 23) + _wave(0.055, x, y, ex, ey, 14_400.0, 9000.0, 24)
    tone += _wave(0.06, x, y, ex, ey, 16_000.0, 230.0, 31) + _wave(0.05, x, y, ex, ey, 70_000.0, 900.0, 32)
    seal = 0.0
    for k in range(lanes.shape[0]):
        across = y - lanes[k, 0]
        if abs(across) > lanes[k, 1]:
            continue
        # Polished by tyres, darkened between them by oil.
        track = (abs(across) - 780.0 - 90.0 * _noise(x / 90_000.0, float(k), 41)) / 300.0
        tone += 0.085 * np.exp(-track * track) * (1.0 + _wave(0.5, x, y, ex, ey, 25_000.0, 400.0, 42))
        oil = across / 260.0
        tone -= 0.075 * np.exp(-oil * oil)
        # Laid in pieces, each a little lighter or darker.
        tone += 0.10 * (_random(int(np.floor(x / 173_000.0 + 0.37 * k)), k, 43) - 0.5)
        # Repaired here and there: a rectangle with a sealed rim.
        cell = int(np.floor(x / 41_000.0))
        if _random(cell, k, 51) < 0.30:
            inside, rim = _patch(x, across, ex, ey, cell, k, lanes[k, 1])
            tone *= 1.0 - inside * (0.22 - 0.30 * _random(cell, k, 56))
            seal = max(seal, 0.7 * rim)
    for k in range(lines.shape[0]):  # the joint between two lanes' layers, beside the line
        joint = y - lines[k, 0] - lines[k, 1] - 70.0
        if abs(joint) < 60.0 + ey:
            part = min(max(2.0 * _noise(x / 21_000.0, float(k), 61) + 0.5, 0.0), 1.0)
            wander = _wave(14.0, x, y, ex, 0.0, 900.0, 1e9, 62)
            seal = max(seal, 0.8 * part * _overlap(joint - wander, ey, -9.0, 9.0))
    cell = int(np.floor(x / 27_000.0))  # cracks from edge to edge
    if _random(cell, 0, 71) < 0.55:
        at = 27_000.0 * cell + 4000.0 + 19_000.0 * _random(cell, 0, 72)
        if abs(x - at) < 400.0 + ex:
            at += 90.0 * _noise(y / 700.0, float(cell), 73) + 35.0 * _noise(y / 160.0, float(cell), 74)
            seal = max(seal, 0.75 * _overlap(x, ex, at - 11.0, at + 11.0))
    return max(0.118 * tone * (1.0 - 0.55 * seal), 0.01)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _patch(x: float, across: float, ex: float, ey: float, cell: int, lane: int, half_lane: float) -> tuple[float, float]:
    """Shares of the box inside a repaired rectangle and on its rim."""
    length = 1500.0 + 6000.0 * _random(cell, lane, 52)
    width = min(900.0 + 2100.0 * _random(cell, lane, 53), 1.8 * half_lane)
    middle = 41_000.0 * cell + 10_000.0 + 21_000.0 * _random(cell, lane, 54)
    side = (2.0 * _random(cell, lane, 55) - 1.0) * (half_lane - 0.5 * width)
    inside = _overlap(x, ex, middle - 0.5 * length, middle + 0.5 * length) \
        * _overlap(across, ey, side - 0.5 * width, side + 0.5 * width)
    whole = _overlap(x, ex, middle - 0.5 * length - 25.0, middle + 0.5 * length + 25.0) \
        * _overlap(across, ey, side - 0.5 * width - 25.0, side + 0.5 * width + 25.0)
    return inside, whole - inside


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _verge(x: float, y: float, ex: float, ey: float, away: float, out: Array) -> None:
    """Gravel beside the asphalt, then mown grass, then fields."""
    tone = 1.0 + _wave(0.42, x, y, ex, ey, 22.0, 22.0, 81) + _wave(0.34, x, y, ex, ey, 81.0, 81.0, 82) \
        + _wave(0.26, x, y, ex, ey, 300.0, 300.0, 83) + _wave(0.18, x, y, ex, ey, 1100.0, 1100.0, 84)
    dry = 0.40 + _wave(0.45, x, y, ex, ey, 2600.0, 1700.0, 91) + _wave(0.40, x, y, ex, ey, 19_000.0, 9000.0, 92)
    bare = 0.0
    if away < 600.0:
        bare = min(max(1.2 - (away + _wave(120.0, x, y, ex, ey, 900.0, 300.0, 93)) / 320.0, 0.0), 1.0)
    field = min(max((away - 26_000.0) / 4000.0, 0.0), 1.0)
    if field > 0.0:
        strip = int(np.floor(y / 61_000.0))
        piece = int(np.floor((x + 90_000.0 * _random(strip, 0, 94)) / 150_000.0))
        dry += field * (1.3 * _random(piece, strip, 95) - 0.65)
    dry = min(max(dry, 0.0), 1.0)
    tone = max(tone, 0.3)
    for c in range(3):
        grass = GREEN[c] + dry * (STRAW[c] - GREEN[c])
        out[c] = tone * (grass + bare * (GRAVEL[c] - grass))


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _colours(points: Array, extent: Array, edges: Array, lines: Array, lanes: Array, out: Array) -> None:
    for n in range(points.shape[0]):
        x, y, ex, ey = points[n, 0], points[n, 1], extent[n, 0], extent[n, 1]
        ragged = 0.0
        near = min(abs(y - edges[0]), abs(y - edges[1]))
        if near < 150.0 + ey:
            ragged = _wave(45.0, x, y, ex, 0.0, 350.0, 1e9, 1) + _wave(60.0, x, y, ex, 0.0, 4000.0, 1e9, 2)
        on_road = _overlap(y, ey, edges[0] + ragged, edges[1] + ragged)
        out[n, 0] = out[n, 1] = out[n, 2] = 0.0
        if on_road < 1.0:
            _verge(x, y, ex, ey, max(edges[0] - y, y - edges[1]), out[n])
        if on_road > 0.0:
            gray = _asphalt(x, y, ex, ey, lanes, lines)
            dust = np.exp(-near / 250.0) if near < 2000.0 else 0.0
            for c in range(3):
                out[n, c] += on_road * (gray * ASPHALT[c] * (1.0 + dust * DUST[c]) - out[n, c])
        for k in range(lines.shape[0]):
            share = _line_share(x, y, ex, ey, lines, k)
            if share > 0.0:
                worn = _wave(0.5, x, y, ex, ey, 9.0, 9.0, 101) + _wave(0.5, x, y, ex, ey, 31.0, 31.0, 102) \
                    + _wave(0.6, x, y, ex, ey, 700.0, 160.0, 103)
                share *= 1.0 - min(max(0.55 * (worn - 0.35), 0.0) + 0.05, 0.8)
                dirt = 1.0 - 0.10 * max(worn + 0.3, 0.0) + _wave(0.06, x, y, ex, ey, 5000.0, 300.0, 104)
                colour = int(lines[k, 5])
                for c in range(3):
                    out[n, c] += share * (PAINT[colour][c] * dirt - out[n, c])
