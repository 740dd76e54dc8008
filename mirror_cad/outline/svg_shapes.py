"""The segments of a shape element of an SVG file, in mirror coordinates."""

from __future__ import annotations

import math
from itertools import pairwise
from xml.etree import ElementTree

from mirror_cad.errors import OutlineError
from mirror_cad.outline.numbers import FULL_TURN
from mirror_cad.outline.segments import Segment
from mirror_cad.outline.svg_text import MM_PER_PX, MM_PER_UNIT, Frame, length_and_unit, numbers, path_segments


def plain_length(element: ElementTree.Element, key: str, physical: bool) -> float:
    """A length in user units, 0 where there is none. Raises `OutlineError` for one whose unit says nothing here."""
    return _length(element, key, physical, 0.0) or 0.0


def _length(element: ElementTree.Element, key: str, physical: bool, default: float | None) -> float | None:
    text = element.get(key)
    if text is None or (default is None and text.strip() == "auto"):
        return default
    value, unit = length_and_unit(text, key)
    if unit in ("", "px"):
        return value
    if unit == "%" or not physical:
        raise OutlineError(f"{key} is {text!r}: write it in user units, as a number without a unit")
    return value * MM_PER_UNIT[unit] / MM_PER_PX


def shape_segments(element: ElementTree.Element, name: str, frame: Frame, physical: bool) -> list[Segment]:
    """The segments of a path, line, polyline, polygon, circle, ellipse or rect.

    `frame` maps the element's coordinates to the mirror's; `physical` says whether its document has a size, so that lengths
    with units are true. Raises `OutlineError` for any other element and for attributes that say nothing.
    """
    def length(key: str) -> float | None:
        return _length(element, key, physical, None)

    def number(key: str) -> float:
        return plain_length(element, key, physical)

    if name == "path":
        return path_segments(element.get("d", ""), frame)
    if name == "line":
        return [frame.line((number("x1"), number("y1")), (number("x2"), number("y2")))]
    if name in ("polyline", "polygon"):
        values = numbers(element.get("points", ""), "points")
        if len(values) % 2:
            raise OutlineError(f"points has {len(values)} numbers, an x without a y")
        points = list(zip(values[::2], values[1::2], strict=True))
        if name == "polygon":
            points = points + points[:1]
        return [frame.line(a, b) for a, b in pairwise(points)]
    if name in ("circle", "ellipse"):
        centre = (number("cx"), number("cy"))
        rx = number("r") if name == "circle" else length("rx")
        ry = number("r") if name == "circle" else length("ry")
        rx, ry = (ry if rx is None else rx) or 0.0, (rx if ry is None else ry) or 0.0
        _check_sizes(rx, ry)
        return [frame.ellipse(centre, rx, ry, 0.0, 0.0, FULL_TURN)] if rx and ry else []
    if name == "rect":
        x, y, width, height = number("x"), number("y"), number("width"), number("height")
        rx, ry = length("rx"), length("ry")
        rx, ry = (ry if rx is None else rx) or 0.0, (rx if ry is None else ry) or 0.0
        _check_sizes(width, height, rx, ry)
        if not (width and height):
            return []
        rx, ry = min(rx, 0.5 * width), min(ry, 0.5 * height)
        if not (rx and ry):
            corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)]
            return [frame.line(a, b) for a, b in pairwise(corners)]
        left, right, top, bottom = x + rx, x + width - rx, y + ry, y + height - ry
        quarter = 0.5 * math.pi
        segments: list[Segment] = []
        for centre, first, side in (
            ((right, top), -quarter, ((x + width, top), (x + width, bottom))),
            ((right, bottom), 0.0, ((right, y + height), (left, y + height))),
            ((left, bottom), quarter, ((x, bottom), (x, top))),
            ((left, top), 2.0 * quarter, ((left, y), (right, y))),
        ):
            segments.append(frame.ellipse(centre, rx, ry, 0.0, first, quarter))
            segments.append(frame.line(*side))
        return segments
    raise OutlineError("this element is not supported in an outline; convert it to a path or delete it")


def _check_sizes(*sizes: float) -> None:
    if min(sizes) < 0.0:
        raise OutlineError(f"a width, height or radius is {min(sizes):g}: it must not be negative")
