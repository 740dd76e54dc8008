"""Draw a field, and lines, over a mirror as a map within its outline, as a part of one SVG."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mirror_studio.report.colours import COLOURS, Stops, indices, palette
from mirror_studio.report.drawing import AXIS, FONT, INK, SMALL, SOFT, nice_ticks, text, tick_texts

Array = NDArray[np.float64]

RIM = "#555555"
TICK = 3.5  # px
FINER = 6  # pixels a cell, where a map has cells without value
TICK_MARGIN = 0.05  # of a map's side: a number nearer to its corner meets the next map's
NAME = 10.0  # px: of the names on contours
UPWARDS = 120.0  # degrees: a name on a line that is nearly upright reads upwards
NAME_SPOTS, NAMES_APART = 25, 45.0  # where on its line a name may stand; px, from which on two do not crowd each other


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
        """A field (nx, ny) of equal cells over the extent, x to the right and y up, on one scale; nothing where it is NaN."""
        known = np.isfinite(values)
        colours = np.ascontiguousarray(indices(_filled(values), low, high).T[::-1])
        transparent = None
        if not known.all():  # the cells' borders as they are, the colours as smooth as where all is known
            transparent = COLOURS - 1
            size = FINER * colours.shape[1], FINER * colours.shape[0]
            unknown = Image.fromarray(np.ascontiguousarray(~known.T[::-1])).resize(size, Image.Resampling.NEAREST)
            picture = Image.fromarray(np.minimum(colours, COLOURS - 2)).resize(size, Image.Resampling.BILINEAR)
            picture.paste(transparent, mask=unknown)
        else:
            picture = Image.fromarray(colours)
        picture.putpalette(palette(stops))
        file = io.BytesIO()
        picture.save(file, "PNG", transparency=transparent)
        self.parts.append(f'<image x="{self.left:.2f}" y="{self.top:.2f}" width="{self.width:.2f}" height="{self.height:.2f}" '
                          'preserveAspectRatio="none" '
                          f'href="data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"/>')

    def contours(self, x: Array, y: Array, values: Array, levels: Sequence[float], width: float,
                 names: Sequence[str] = ()) -> None:
        """Lines of equal value of a field (nx, ny) at places x (nx,) and y (ny,), each with its name on it where it has one."""
        from contourpy import contour_generator

        generator = contour_generator(x, y, np.ma.masked_invalid(values.T))
        named: list[Array] = []
        for k, level in enumerate(levels):
            lines = [np.asarray(line, dtype=np.float64) for line in generator.lines(level)]
            if lines:
                self.parts.append(f'<path d="{"".join(self._path(line) for line in lines)}" stroke="black" '
                                  f'stroke-width="{width:g}" fill="none"/>')
            if lines and names:
                self._name(self.px(max(lines, key=_length)), names[k], named)

    def _name(self, line: Array, name: str, named: list[Array]) -> None:
        """A name along a line (n, 2), px, away from those that are there, which are `named`, and near to the map's middle."""
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        room = 0.5 * (0.56 * NAME * len(name) + NAME)
        if along[-1] < 2.0 * room + NAME:
            return
        at = np.linspace(room, along[-1] - room, NAME_SPOTS)
        spots, before, after = (np.stack([np.interp(at + d, along, line[:, c]) for c in (0, 1)], axis=1)
                                for d in (0.0, -room, room))
        apart = np.linalg.norm(spots[:, None] - np.reshape(named, (-1, 2)), axis=2).min(axis=1, initial=NAMES_APART)
        middle = np.array([self.left + 0.5 * self.width, self.top + 0.5 * self.height])
        best = int(np.argmax(apart - 0.1 * np.linalg.norm(spots - middle, axis=1)))
        named.append(spots[best])
        dx, dy = after[best] - before[best]
        angle = (np.degrees(np.arctan2(dy, dx)) + UPWARDS) % 180.0 - UPWARDS
        a, b = spots[best]
        self.parts.append(f'<g transform="translate({a:.1f} {b:.1f}) rotate({angle:.0f})">'
                          f'{text(0.0, 0.36 * NAME, name, NAME, INK, "middle", halo=True)}</g>')

    def line(self, points: Array, colour: str, width: float, dash: str = "") -> None:
        """Polylines (n, 2), mm, one after the other with rows of NaN between."""
        known = np.isfinite(points).all(axis=1)
        runs = [run for run in np.split(points, np.flatnonzero(np.diff(known)) + 1) if len(run) > 1 and np.isfinite(run).all()]
        more = f' stroke-dasharray="{dash}"' if dash else ""
        self.parts.append(f'<path d="{"".join(self._path(run) for run in runs)}" stroke="{colour}" stroke-width="{width:g}"'
                          f'{more} fill="none" stroke-linejoin="round"/>')

    def ring(self, x: float, y: float) -> None:
        """A ring about a place, seen on any colour."""
        (a, b), = self.px(np.array([[x, y]]))
        self.over += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="4.6" stroke="{colour}" stroke-width="{width:g}" fill="none"/>'
                      for colour, width in (("white", 3.6), ("black", 1.5))]

    def svg(self, title: Iterable[str], y_numbers: bool, x_label: str = "x, mm") -> str:
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
        out.append(text(0.5 * (self.left + right), bottom + 37.0, x_label, FONT, SOFT, "middle"))
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


def _filled(values: Array) -> Array:
    """The field with the value of the nearest known cell, by columns and then by rows, where there is none."""
    result = values
    for _ in range(2):
        known = np.isfinite(result)
        rows = np.arange(len(result))[:, None]
        before = np.maximum.accumulate(np.where(known, rows, -1), axis=0)
        after = np.minimum.accumulate(np.where(known, rows, len(result))[::-1], axis=0)[::-1]
        nearest = np.where((before < 0) | ((after < len(result)) & (after - rows < rows - before)), after, before)
        result = np.take_along_axis(result, np.clip(nearest, 0, len(result) - 1), axis=0).T
    return result


def _length(line: Array) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def _ticks(low: float, high: float, most: int) -> list[float]:
    margin = TICK_MARGIN * (high - low)
    return nice_ticks(low + margin, high - margin, most)
