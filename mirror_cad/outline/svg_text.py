"""Parse SVG attributes: numbers, lengths, transforms, and the segments of paths."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import numpy as np

from mirror_cad.errors import OutlineError
from mirror_cad.outline.numbers import FULL_TURN, Point
from mirror_cad.outline.pieces import elliptic_arc
from mirror_cad.outline.segments import Line, Segment, Spline

_SPACE = re.compile(r"[ \t\r\n\f]*")
_SEPARATOR = re.compile(r"[ \t\r\n\f]*,?[ \t\r\n\f]*")
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_FLAG = re.compile(r"[01]")
_LENGTH = re.compile(rf"[ \t\r\n\f]*({_NUMBER.pattern})([a-zA-Z%]*)[ \t\r\n\f]*")
_COMMAND = re.compile(r"([MmZzLlHhVvCcSsQqTtAa])([^MmZzLlHhVvCcSsQqTtAa]*)")
_TRANSFORM = re.compile(r"([a-zA-Z]+)[ \t\r\n\f]*\(([^()]*)\)[ \t\r\n\f,]*")
_ARGUMENTS = {"M": 2, "Z": 0, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7}
MM_PER_PX = 25.4 / 96.0
MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "in": 25.4, "px": MM_PER_PX, "pt": 25.4 / 72.0, "pc": 25.4 / 6.0, "q": 0.25}


def numbers(text: str, what: str, flags: tuple[int, ...] = (), period: int = 1) -> list[float]:
    """The numbers in a list separated by white space or commas; those at `flags` modulo `period` are one digit 0 or 1.

    Read one by one, not with one pattern: numbers may follow each other without a separator.
    """
    values: list[float] = []
    match = _SPACE.match(text)
    at = match.end() if match else 0
    end = at
    while at < len(text):
        number = (_FLAG if len(values) % period in flags else _NUMBER).match(text, at)
        if number is None or not math.isfinite(float(number.group())):
            raise OutlineError(f"{what} has something that is not a finite number at {text[at : at + 20]!r}")
        values.append(float(number.group()))
        end = number.end()
        match = _SEPARATOR.match(text, end)
        at = match.end() if match else end
    if text[end:].strip():
        raise OutlineError(f"{what} ends in {text[end:].strip()!r}")
    return values


def length_and_unit(text: str, what: str) -> tuple[float, str]:
    """Number and unit (lower case, '' for none) of a length."""
    match = _LENGTH.fullmatch(text)
    if match is None or not math.isfinite(float(match[1])):
        raise OutlineError(f"{what} is {text!r}, not a length")
    unit = match[2].lower()
    if unit not in ("", "%") and unit not in MM_PER_UNIT:
        raise OutlineError(f"{what} is {text!r}: the unit {match[2]!r} is not supported; use mm, cm, in or px")
    return float(match[1]), unit


class Frame(NamedTuple):
    """Affine map from an element's coordinates to the mirror's: (a x + c y + e, b x + d y + f)."""

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float

    def __matmul__(self, inner: Frame) -> Frame:
        e, f = self.at((inner.e, inner.f))
        return Frame(*self.along((inner.a, inner.b)), *self.along((inner.c, inner.d)), e, f)

    def along(self, vector: Point) -> Point:
        """Map a vector."""
        x, y = vector
        return self.a * x + self.c * y, self.b * x + self.d * y

    def at(self, point: Point) -> Point:
        """Map a point."""
        x, y = self.along(point)
        return x + self.e, y + self.f

    def line(self, start: Point, end: Point) -> Segment:
        """Map the line between two points."""
        return Line(self.at(start), self.at(end))

    def bezier(self, *poles: Point) -> Segment:
        """Map a Bézier curve, as a spline of one span."""
        order = len(poles)
        return Spline(order - 1, np.repeat([0.0, 1.0], order), np.array([self.at(pole) for pole in poles]))

    def ellipse(self, centre: Point, rx: float, ry: float, tilt: float, start: float, sweep: float) -> Segment:
        """Map an elliptic arc: radii, tilt of the first, start and sweep in radians."""
        cos, sin = math.cos(tilt), math.sin(tilt)
        u, v = self.along((rx * cos, rx * sin)), self.along((-ry * sin, ry * cos))
        return elliptic_arc(self.at(centre), u, v, start, sweep)


def transform(text: str) -> Frame:
    """The map of an SVG transform attribute."""
    frame = Frame(1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    at = len(text) - len(text.lstrip())
    while at < len(text):
        match = _TRANSFORM.match(text, at)
        if match is None:
            raise OutlineError(f"transform {text[:80]!r} is not understood at {text[at : at + 20]!r}")
        at = match.end()
        name = match[1]
        values = numbers(match[2], f"transform {name}")
        count = len(values)
        if name == "matrix" and count == 6:
            step = Frame(*values)
        elif name == "translate" and count in (1, 2):
            step = Frame(1.0, 0.0, 0.0, 1.0, values[0], values[1] if count == 2 else 0.0)
        elif name == "scale" and count in (1, 2):
            step = Frame(values[0], 0.0, 0.0, values[-1], 0.0, 0.0)
        elif name == "rotate" and count in (1, 3):
            cos, sin = math.cos(math.radians(values[0])), math.sin(math.radians(values[0]))
            x, y = values[1:] or (0.0, 0.0)
            step = Frame(cos, sin, -sin, cos, x - cos * x + sin * y, y - sin * x - cos * y)
        elif name == "skewX" and count == 1:
            step = Frame(1.0, 0.0, math.tan(math.radians(values[0])), 1.0, 0.0, 0.0)
        elif name == "skewY" and count == 1:
            step = Frame(1.0, math.tan(math.radians(values[0])), 0.0, 1.0, 0.0, 0.0)
        else:
            raise OutlineError(f"transform {name} with {count} numbers is not understood")
        frame = frame @ step
    return frame


def path_segments(data: str, frame: Frame) -> list[Segment]:
    """The segments of SVG path data. Unlike a viewer, which draws up to the first mistake, any mistake is an error."""
    at = len(data) - len(data.lstrip())
    segments: list[Segment] = []
    here: Point = (0.0, 0.0)
    begin = here
    # Where the last control point was, for the smooth commands, and of which kind.
    control, control_kind = here, ""
    if data.strip() and data[at] not in "Mm":
        raise OutlineError(f"path data begins with {data[at]!r} instead of M or m")
    while at < len(data):
        match = _COMMAND.match(data, at)
        if match is None:
            raise OutlineError(f"path data is not understood at {data[at : at + 20]!r}")
        at = match.end()
        letter = match[1]
        kind, relative = letter.upper(), letter.islower()
        count = _ARGUMENTS[kind]
        values = numbers(match[2], f"path command {letter}", (3, 4) if kind == "A" else (), 7)
        if (len(values) % count or not values) if count else values:
            raise OutlineError(f"path command {letter} has {len(values)} numbers, which does not fit its {count}")
        if kind == "Z":
            if here != begin:
                segments.append(frame.line(here, begin))
            here, control_kind = begin, ""
            continue
        for row in (values[i : i + count] for i in range(0, len(values), count)):
            base = here if relative else (0.0, 0.0)
            if kind in "HV":
                end = (base[0] + row[0], here[1]) if kind == "H" else (here[0], base[1] + row[0])
            else:
                end = (base[0] + row[-2], base[1] + row[-1])
            inner = [(base[0] + row[i], base[1] + row[i + 1]) for i in range(0, count - 2, 2)] if kind in "CSQ" else []
            if kind in "ST":
                # The last control point mirrored at the current point, if the last command was of the same family.
                same = control_kind == ("C" if kind == "S" else "Q")
                inner.insert(0, (2.0 * here[0] - control[0], 2.0 * here[1] - control[1]) if same else here)
            control_kind = ""
            if kind == "M":
                begin = end
                kind = "L"  # further pairs are lines
            elif kind == "A":
                segments.extend(_path_arc(frame, here, end, row))
            elif inner:
                segments.append(frame.bezier(here, *inner, end))
                control, control_kind = inner[-1], "C" if kind in "CS" else "Q"
            elif here != end:
                segments.append(frame.line(here, end))
            here = end
    return segments


def _path_arc(frame: Frame, start: Point, end: Point, row: list[float]) -> list[Segment]:
    """An SVG arc from its end points: the centre form of the standard's implementation notes (SVG 1.1, F.6.5)."""
    rx, ry, tilt = abs(row[0]), abs(row[1]), math.radians(row[2])
    if start == end:
        return []
    if rx == 0.0 or ry == 0.0:
        return [frame.line(start, end)]
    cos, sin = math.cos(tilt), math.sin(tilt)
    dx, dy = 0.5 * (start[0] - end[0]), 0.5 * (start[1] - end[1])
    # In units of the radii, along the axes: half the chord, then the centre from its middle.
    px, py = (cos * dx + sin * dy) / rx, (cos * dy - sin * dx) / ry
    square = px * px + py * py
    if square > 1.0:
        # Radii too small to reach are enlarged until they just do.
        root = math.sqrt(square)
        rx, ry, px, py, square = rx * root, ry * root, px / root, py / root, 1.0
    away = math.sqrt(max(0.0, 1.0 / square - 1.0)) * (1.0 if row[3] != row[4] else -1.0)
    qx, qy = away * py, -away * px
    first, last = math.atan2(py - qy, px - qx), math.atan2(-py - qy, -px - qx)
    sweep = (last - first) % FULL_TURN
    if not row[4]:
        sweep -= FULL_TURN
    centre = (
        0.5 * (start[0] + end[0]) + cos * rx * qx - sin * ry * qy,
        0.5 * (start[1] + end[1]) + sin * rx * qx + cos * ry * qy,
    )
    return [frame.ellipse(centre, rx, ry, tilt, first, sweep)]
