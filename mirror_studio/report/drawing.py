"""Draw curves, bands and teeth in the units of their axes, as panels of one SVG.

Some thirty small axes make up the report's curves. Matplotlib takes a second and a half for their ticks; these take a
hundredth.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from html import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Range = tuple[float, float]

WIDTH = 1040.0  # px of every drawing: 100 an inch of the width that the maps have
FONT, SMALL = 12.5, 11.5  # px
FACE = "'Liberation Sans', Arial, Helvetica, 'DejaVu Sans', sans-serif"
INK, SOFT, AXIS, GRID = "#222222", "#444444", "#666666", "#e4e4e4"
TICK = 3.5  # px
TICKS_APART = {"x": 75.0, "y": 26.0}  # px, at least


def nice_ticks(low: float, high: float, most: int) -> list[float]:
    """Multiples of 1, 2 or 5 times a power of ten inside [low, high], at most `most` of them and at least one."""
    span = high - low
    for power in range(math.floor(math.log10(span / max(most, 1))) - 1, 400):
        for factor in (1.0, 2.0, 5.0):
            step = factor * 10.0**power
            first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
            if last - first + 1 <= max(most, 1):
                return [k * step for k in range(first, last + 1)] or [round(0.5 * (low + high) / step) * step]
    return []


def tick_texts(ticks: list[float]) -> list[str]:
    """The ticks' numbers to the digits that tell them apart."""
    step = ticks[1] - ticks[0] if len(ticks) > 1 else abs(ticks[0]) or 1.0
    largest = max(abs(tick) for tick in ticks)
    if largest > 0.0 and not 1e-4 <= largest < 1e7:
        return [f"{tick:.3g}".replace("-", "−") for tick in ticks]
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    return [f"{tick + 0.0:.{decimals}f}".replace("-", "−") if abs(tick) > 1e-9 * step else f"{0.0:.{decimals}f}"
            for tick in ticks]


@dataclass(eq=False)
class Panel:
    """One pair of axes: its box in px from the drawing's upper left corner, what its ends stand for, and what is drawn."""

    left: float
    top: float
    width: float
    height: float
    x: Range
    y: Range
    parts: list[str] = field(default_factory=list)

    def line(self, x: ArrayLike, y: ArrayLike, colour: str, width: float = 1.4, dash: str = "", opacity: float = 1.0) -> None:
        """A polyline, broken where a coordinate is not finite."""
        runs = " ".join("M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in run) for run in self._runs(x, y))
        self._path(runs, colour, width, dash, opacity)

    def band(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str, opacity: float) -> None:
        """The area between two curves over x."""
        for lower, upper in zip(self._runs(x, low), self._runs(x, high), strict=True):
            around = "L".join(f"{a:.1f} {b:.1f}" for a, b in np.concatenate([lower, upper[::-1]]))
            self.parts.append(f'<path d="M{around}Z" fill="{colour}" fill-opacity="{opacity:g}"/>')

    def area(self, x: ArrayLike, y: ArrayLike, colour: str, opacity: float = 1.0, edge: str = "none",
             width: float = 1.0) -> None:
        """A filled polygon, with an edge where one is named."""
        around = "L".join(f"{a:.1f} {b:.1f}" for run in self._runs(x, y) for a, b in run)
        self.parts.append(f'<path d="M{around}Z" fill="{colour}" fill-opacity="{opacity:g}" stroke="{edge}" '
                          f'stroke-width="{width:g}"/>')

    def triangles(self, x: ArrayLike, y: ArrayLike, colour: str, size: float = 4.5) -> None:
        """A triangle that points up at each place; `size` : half its width, px."""
        places = zip(*self.px(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)), strict=True)
        marks = " ".join(f"M{a:.1f} {b - size:.1f}l{size:g} {2.0 * size:g}h-{2.0 * size:g}Z" for a, b in places)
        self.parts.append(f'<path d="{marks}" fill="{colour}"/>')

    def stairs(self, edges: Array, values: Array, colour: str, width: float = 1.8, dash: str = "") -> None:
        """Values between edges, from and to zero."""
        self.line(np.repeat(edges, 2), np.concatenate([[0.0], np.repeat(values, 2), [0.0]]), colour, width, dash)

    def segments(self, starts: Array, ends: Array, colour: str, width: float) -> None:
        """Straight pieces between points (n, 2)."""
        a, b = (np.stack(self.px(*ends_.T), axis=1) for ends_ in (starts, ends))
        self._path(" ".join(f"M{p[0]:.1f} {p[1]:.1f}L{q[0]:.1f} {q[1]:.1f}" for p, q in zip(a, b, strict=True)),
                   colour, width, "", 1.0)

    def level(self, y: float, colour: str, width: float = 1.0, dash: str = "") -> None:
        """A line across at y."""
        self.line(self.x, (y, y), colour, width, dash)

    def upright(self, x: float, colour: str, width: float = 1.0, dash: str = "") -> None:
        """A line upright at x."""
        self.line((x, x), self.y, colour, width, dash)

    def svg(self, number: int, title: str = "", x_label: str = "", y_label: str = "", x_numbers: bool = True,
            y_numbers: bool = True, note: str = "", grid: bool = True) -> str:
        """The panel with its axes and texts.   number : tells its clip from the others'.   note : at the upper right."""
        left, top, right, bottom = self.left, self.top, self.left + self.width, self.top + self.height
        x_ticks = nice_ticks(*self.x, int(self.width / TICKS_APART["x"]))
        y_ticks = nice_ticks(*self.y, max(2, int(self.height / TICKS_APART["y"])))
        x_at, _ = self.px(np.array(x_ticks), np.full(len(x_ticks), self.y[0]))
        _, y_at = self.px(np.full(len(y_ticks), self.x[0]), np.array(y_ticks))
        rules = [f"M{at:.1f} {top:.1f}V{bottom:.1f}" for at in x_at] + [f"M{left:.1f} {at:.1f}H{right:.1f}" for at in y_at]
        marks = [f"M{at:.1f} {bottom:.1f}v{TICK:g}" for at in x_at] + [f"M{left:.1f} {at:.1f}h-{TICK:g}" for at in y_at]
        out = [f'<clipPath id="c{number}"><rect x="{left:.1f}" y="{top - 1:.1f}" width="{self.width:.1f}" '
               f'height="{self.height + 2:.1f}"/></clipPath>',
               f'<path d="{" ".join(rules if grid else [])}" stroke="{GRID}" fill="none"/>',
               f'<g clip-path="url(#c{number})">', *self.parts, "</g>",
               f'<path d="M{left:.1f} {top:.1f}V{bottom:.1f}H{right:.1f} {" ".join(marks)}" stroke="{AXIS}" fill="none"/>']
        if x_numbers:
            out += [text(at, bottom + 16.0, number, SMALL, SOFT, "middle")
                    for at, number in zip(x_at, tick_texts(x_ticks), strict=True)]
        if y_numbers:
            out += [text(left - 6.0, at + 4.0, number, SMALL, SOFT, "end")
                    for at, number in zip(y_at, tick_texts(y_ticks), strict=True)]
        if x_label:
            out.append(text(0.5 * (left + right), bottom + 33.0, x_label, FONT, SOFT, "middle"))
        if y_label:
            out.append(text(left - 64.0, 0.5 * (top + bottom), y_label, FONT, SOFT, "middle", upright=True))
        if title:
            out.append(text(left, top - 7.0, title, FONT, INK))
        if note:
            out.append(text(right, top - 7.0, note, SMALL, SOFT, "end"))
        return "\n".join(out)

    def px(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Where points lie, in px of the drawing."""
        (x0, x1), (y0, y1) = self.x, self.y
        return self.left + self.width * (x - x0) / (x1 - x0), self.top + self.height * (y1 - y) / (y1 - y0)

    def _runs(self, x: ArrayLike, y: ArrayLike) -> list[Array]:
        pixels = np.stack(self.px(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)), axis=1)
        # Far outside the panel all is one: renderers keep coordinates in few digits.
        pixels = np.clip(pixels, -1e4, 1e4)
        finite = np.isfinite(pixels).all(axis=1)
        return [run for run in np.split(pixels, np.flatnonzero(np.diff(finite)) + 1) if len(run) > 1 and np.isfinite(run).all()]

    def _path(self, d: str, colour: str, width: float, dash: str, opacity: float) -> None:
        more = (f' stroke-dasharray="{dash}"' if dash else "") + (f' stroke-opacity="{opacity:g}"' if opacity != 1.0 else "")
        self.parts.append(f'<path d="{d}" stroke="{colour}" stroke-width="{width:g}"{more} fill="none" '
                          'stroke-linejoin="round"/>')


def text(x: float, y: float, words: str, size: float = FONT, colour: str = INK, anchor: str = "start",
         upright: bool = False, halo: bool = False) -> str:
    """A line of text whose base begins, has its middle or ends at (x, y).   halo : to be read on any colour."""
    more = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if upright else ""
    more += ' stroke="white" stroke-opacity="0.8" stroke-width="3" paint-order="stroke" stroke-linejoin="round"' if halo else ""
    return (f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" fill="{colour}" text-anchor="{anchor}"{more}>'
            f"{escape(words)}</text>")


def legend(right: float, base: float, entries: Iterable[tuple[str, str, float, float, str]]) -> str:
    """A row of keys that ends at `right`: words, colour, width, opacity and dash of each, in order."""
    out: list[str] = []
    for words, colour, width, opacity, dash in reversed(list(entries)):
        right -= 0.53 * SMALL * len(words)
        out.append(text(right, base, words, SMALL, INK))
        more = f' stroke-dasharray="{dash}"' if dash else ""
        out.append(f'<path d="M{right - 28.0:.1f} {base - 4.0:.1f}h22" stroke="{colour}" stroke-width="{width:g}" '
                   f'stroke-opacity="{opacity:g}"{more}/>')
        right -= 44.0
    return "\n".join(out)


def drawing(height: float, parts: Iterable[str], width: float = WIDTH) -> bytes:
    """The SVG file of parts that were placed on width × height px."""
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}" '
            f'font-family="{FACE}">\n' + "\n".join(parts) + "\n</svg>\n").encode()
