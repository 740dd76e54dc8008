"""Draw a field over a mirror as a map within its outline, with its scale beside it, as parts of one SVG."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mirror_studio.report.colours import Stops, indices, palette
from mirror_studio.report.drawing import AXIS, FONT, INK, SMALL, SOFT, Range, nice_ticks, text, tick_texts

Array = NDArray[np.float64]

RIM = "#555555"
TICK = 3.5  # px
NUMBER_ROOM = 26.0  # px of height that a number beside a scale needs
TICK_MARGIN = 0.05  # of a map's side: a number nearer to its corner meets the next map's


@dataclass(eq=False)
class MapPanel:
    """One map: its box in px from the drawing's upper left corner, the same in mm, and the outline that cuts it.

    Attributes
    ----------
    left, top, width, height
        px; as wide to high as the extent.
    extent
        (x_min, x_max, y_min, y_max), mm.
    rim
        (n, 2), mm: a closed polygon.
    number
        Tells its clip from those of the drawing's other panels.
    """

    left: float
    top: float
    width: float
    height: float
    extent: tuple[float, float, float, float]
    rim: Array
    number: int
    parts: list[str] = field(default_factory=list)
    over: list[str] = field(default_factory=list)  # what the rim does not cut

    def image(self, values: Array, low: float, high: float, stops: Stops) -> None:
        """A field (nx, ny) of equal cells over the extent, x to the right and y up, on one scale."""
        picture = Image.fromarray(np.ascontiguousarray(indices(values, low, high).T[::-1]), mode="P")
        picture.putpalette(palette(stops))
        file = io.BytesIO()
        picture.save(file, "PNG")
        self.parts.append(f'<image x="{self.left:.2f}" y="{self.top:.2f}" width="{self.width:.2f}" height="{self.height:.2f}" '
                          'preserveAspectRatio="none" '
                          f'href="data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"/>')

    def contours(self, x: Array, y: Array, values: Array, levels: Sequence[float], width: float) -> None:
        """Lines of equal value of a field (nx, ny) at places x (nx,) and y (ny,)."""
        from contourpy import contour_generator

        generator = contour_generator(x, y, np.ma.masked_invalid(values.T))
        for level in levels:
            lines = "".join(self._path(np.asarray(line, dtype=np.float64)) for line in generator.lines(level))
            if lines:
                self.parts.append(f'<path d="{lines}" stroke="black" stroke-width="{width:g}" fill="none"/>')

    def ring(self, x: float, y: float) -> None:
        """A ring about a place, seen on any colour."""
        (a, b), = self.px(np.array([[x, y]]))
        self.over += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="4.6" stroke="{colour}" stroke-width="{width:g}" fill="none"/>'
                      for colour, width in (("white", 3.6), ("black", 1.5))]

    def svg(self, title: Iterable[str], y_numbers: bool) -> str:
        """The map within its outline, with axes in mm and a title of one or more lines."""
        right, bottom = self.left + self.width, self.top + self.height
        x_min, x_max, y_min, y_max = self.extent
        x_ticks, y_ticks = _ticks(x_min, x_max, 3), _ticks(y_min, y_max, 7 if y_max - y_min > 0.8 * (x_max - x_min) else 3)
        x_at = self.px(np.array([[tick, y_min] for tick in x_ticks]))[:, 0]
        y_at = self.px(np.array([[x_min, tick] for tick in y_ticks]))[:, 1]
        marks = [f"M{at:.1f} {bottom + 4.0:.1f}v{TICK:g}" for at in x_at]
        out = [f'<clipPath id="m{self.number}"><path d="{self._path(self.rim)}Z"/></clipPath>',
               f'<g clip-path="url(#m{self.number})">', *self.parts, "</g>",
               f'<path d="{self._path(self.rim)}Z" stroke="{RIM}" fill="none"/>', *self.over]
        out += [text(at, bottom + 20.0, words, SMALL, SOFT, "middle")
                for at, words in zip(x_at, tick_texts(x_ticks), strict=True)]
        out.append(text(0.5 * (self.left + right), bottom + 37.0, "x, mm", FONT, SOFT, "middle"))
        if y_numbers:
            marks += [f"M{self.left - 4.0:.1f} {at:.1f}h-{TICK:g}" for at in y_at]
            out += [text(self.left - 10.0, at + 4.0, words, SMALL, SOFT, "end")
                    for at, words in zip(y_at, tick_texts(y_ticks), strict=True)]
            out.append(text(self.left - 44.0, 0.5 * (self.top + bottom), "y, mm", FONT, SOFT, "middle", upright=True))
        out.append(f'<path d="{" ".join(marks)}" stroke="{AXIS}" fill="none"/>')
        lines = list(title)
        out += [text(self.left, self.top - 8.0 - 15.0 * (len(lines) - 1 - k), line, FONT, INK) for k, line in enumerate(lines)]
        return "\n".join(out)

    def px(self, points: Array) -> Array:
        """Points (n, 2), mm, in px of the drawing."""
        x_min, x_max, y_min, y_max = self.extent
        points = np.reshape(points, (-1, 2))
        return np.stack([self.left + self.width * (points[:, 0] - x_min) / (x_max - x_min),
                         self.top + self.height * (y_max - points[:, 1]) / (y_max - y_min)], axis=1)

    def _path(self, points: Array) -> str:
        return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in self.px(points))


@dataclass(frozen=True, slots=True)
class ColourBar:
    """An upright scale: its box in px, what its ends stand for, and its colours from below."""

    left: float
    top: float
    width: float
    height: float
    ends: Range
    stops: Stops
    number: int

    def y(self, value: float) -> float:
        """Where a value stands, px."""
        low, high = self.ends
        return self.top + self.height * (high - value) / (high - low)

    def ticks(self) -> list[float]:
        """Round values between the ends, as many as have room."""
        return nice_ticks(*self.ends, max(2, int(self.height / NUMBER_ROOM)))

    def svg(self, label: str, ticks: Sequence[float], words: Sequence[str], marks: Iterable[tuple[float, str]] = ()) -> str:
        """The scale with numbers at `ticks`, a label, and further values marked across it by name."""
        right, bottom = self.left + self.width, self.top + self.height
        stops = [f'<stop offset="{k / (len(self.stops) - 1):.4f}" stop-color="{stop}"/>' for k, stop in enumerate(self.stops)]
        out = [f'<linearGradient id="b{self.number}" x1="0" y1="1" x2="0" y2="0">', *stops, "</linearGradient>",
               f'<rect x="{self.left:.1f}" y="{self.top:.1f}" width="{self.width:.1f}" height="{self.height:.1f}" '
               f'fill="url(#b{self.number})" stroke="{AXIS}" stroke-width="0.8"/>',
               f'<path d="{" ".join(f"M{right:.1f} {self.y(tick):.1f}h{TICK:g}" for tick in ticks)}" stroke="{AXIS}" '
               'fill="none"/>']
        out += [text(right + 7.0, self.y(tick) + 4.0, word, SMALL, SOFT) for tick, word in zip(ticks, words, strict=True)]
        for value, name in marks:
            at = self.y(value)
            out.append(f'<path d="M{self.left:.1f} {at:.1f}H{right + TICK:.1f}" stroke="black" stroke-width="1.6"/>')
            out.append(text(right + 7.0, at + 4.0, name, SMALL, INK))
        longest = max([len(word) for word in words] + [len(name) for _, name in marks], default=0)
        out.append(text(right + 22.0 + 0.56 * SMALL * longest, 0.5 * (self.top + bottom), label, FONT, SOFT, "middle",
                        upright=True))
        return "\n".join(out)


def _ticks(low: float, high: float, most: int) -> list[float]:
    margin = TICK_MARGIN * (high - low)
    return nice_ticks(low + margin, high - margin, most)
