"""Draw the scale of a map's colours, beside it or below it, as parts of one SVG."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mirror_studio.report.colours import Stops
from mirror_studio.report.drawing import AXIS, FONT, INK, SMALL, SOFT, TICK, Range, nice_ticks, text, tick_texts

NUMBER_ROOM = 26.0  # px of height that a number beside a scale needs
LYING_ROOM = 48.0  # px of width that a number below one needs


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
        out = [_box(self.left, self.top, self.width, self.height, self.stops, f"b{self.number}", 'x1="0" y1="1" x2="0" y2="0"'),
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


def lying_bar(left: float, top: float, width: float, height: float, ends: Range, stops: Stops, number: int) -> str:
    """A scale with its colours from the left and its numbers below."""
    bottom, ticks = top + height, nice_ticks(*ends, max(2, int(width / LYING_ROOM)))
    at = [left + width * (tick - ends[0]) / (ends[1] - ends[0]) for tick in ticks]
    return "\n".join([_box(left, top, width, height, stops, f"b{number}", ""),
                      f'<path d="{" ".join(f"M{a:.1f} {bottom:.1f}v{TICK:g}" for a in at)}" stroke="{AXIS}" fill="none"/>',
                      *(text(a, bottom + 16.0, words, SMALL, SOFT, "middle")
                        for a, words in zip(at, tick_texts(ticks), strict=True))])


def _box(left: float, top: float, width: float, height: float, stops: Stops, name: str, direction: str) -> str:
    """The colours; `direction` : of the gradient, from the left to the right where nothing is said."""
    colours = [f'<stop offset="{k / (len(stops) - 1):.4f}" stop-color="{stop}"/>' for k, stop in enumerate(stops)]
    return "\n".join([f'<linearGradient id="{name}" {direction}>', *colours, "</linearGradient>",
                      f'<rect x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" height="{height:.1f}" fill="url(#{name})" '
                      f'stroke="{AXIS}" stroke-width="0.8"/>'])
