"""An SVG file in, the pieces drawn in it out."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

from mirror_cad.errors import OutlineError
from mirror_cad.outline_numbers import FULL_TURN
from mirror_cad.outline_pieces import Piece
from mirror_cad.outline_segments import Segment
from mirror_cad.outline_svg_text import (
    MM_PER_PX,
    MM_PER_UNIT,
    Frame,
    length_and_unit,
    numbers,
    path_segments,
    transform,
)

_SVG = "{http://www.w3.org/2000/svg}"
_NOT_DRAWN = {
    "defs", "title", "desc", "metadata", "style", "text", "symbol", "marker", "pattern", "clipPath", "mask", "filter",
    "linearGradient", "radialGradient", "view"
}  # fmt: skip
_GEOMETRY_PROPERTIES = {
    "d", "x", "y", "cx", "cy", "r", "rx", "ry", "width", "height", "transform", "translate", "rotate", "scale", "zoom",
    "clip-path", "mask", "display"
}  # fmt: skip


def _document_frame(root: ElementTree.Element) -> tuple[Frame, bool]:
    """The map of the outermost svg element and whether the document has a physical size."""
    if root.get("transform") is not None:
        raise OutlineError("a transform on the svg element itself is not supported; put it on a group")
    sizes: dict[str, tuple[float, str]] = {}
    for name in ("width", "height"):
        text = root.get(name, "auto").strip()
        if text != "auto":
            value, unit = length_and_unit(text, name)
            if unit != "%":  # of a window nobody knows: no size
                if value <= 0.0:
                    raise OutlineError(f"{name} of the svg element is {text!r}: it must be above 0")
                sizes[name] = (value, unit)
    box = None
    if "viewBox" in root.attrib:
        box = numbers(root.attrib["viewBox"], "viewBox")
        if len(box) != 4 or not (box[2] > 0.0 and box[3] > 0.0):
            raise OutlineError(
                f"viewBox is {root.attrib['viewBox']!r}: it must be four numbers, the width and height above 0"
            )
    spans = {"width": box[2], "height": box[3]} if box else {}
    physical = {name: value * MM_PER_UNIT[unit] for name, (value, unit) in sizes.items() if unit}
    if not physical:
        for name, (value, _) in sizes.items():
            if box and abs(value - spans[name]) > 1e-9 * value:
                raise OutlineError(
                    f"{name} is {value:g} without a unit but the viewBox spans {spans[name]:g}: the size of a unit is "
                    f'not clear; write {name}="{value:g}mm" (or the unit that is meant)'
                )
        return Frame(1.0, 0.0, 0.0, -1.0, 0.0, 0.0), False
    if len(physical) != len(sizes):
        raise OutlineError("width and height of the svg element must both have a unit or both have none")
    if box is None:
        return Frame(MM_PER_PX, 0.0, 0.0, -MM_PER_PX, 0.0, 0.0), True
    scales = [physical[name] / spans[name] for name in physical]
    words = root.get("preserveAspectRatio", "xMidYMid").split()
    known = re.fullmatch(r"none|x(Min|Mid|Max)Y(Min|Mid|Max)", words[0]) if words else None
    if known is None or words[1:] not in ([], ["meet"], ["slice"]):
        raise OutlineError(f"preserveAspectRatio is {' '.join(words)!r}, which SVG does not know")
    if words[0] != "none":
        scales = [max(scales) if words[1:] == ["slice"] else min(scales)]
    return Frame(scales[0], 0.0, 0.0, -scales[-1], 0.0, 0.0), True


def _svg_root(file: Path) -> ElementTree.Element:
    data = file.read_bytes()

    def refuse(name: str, *_: Any) -> None:
        raise OutlineError(
            f"{file}: the document type declares the entity {name!r}; entities are not expanded, so save as plain SVG"
        )

    guard = expat.ParserCreate()
    guard.EntityDeclHandler = refuse
    try:
        guard.Parse(data, True)
        root = ElementTree.fromstring(data)
    except (expat.ExpatError, ElementTree.ParseError, LookupError, ValueError) as error:
        raise OutlineError(f"{file}: not an SVG file, or damaged ({error}); export it again as plain SVG") from None
    if root.tag not in ("svg", _SVG + "svg"):
        raise OutlineError(f"{file}: the outermost element is <{root.tag}>, not <svg>; export it again as plain SVG")
    return root


def svg_pieces(file: Path) -> Iterator[Piece]:
    """The pieces drawn in an SVG file, in mm; `mirror_cad.outline_files.read_outline` says what counts."""
    root = _svg_root(file)
    try:
        frame, physical = _document_frame(root)
    except OutlineError as error:
        raise OutlineError(f"{file}: {error}") from None
    namespace = _SVG if root.tag.startswith(_SVG) else ""
    pending = [(child, frame) for child in reversed(root)]
    for style in root.iter(f"{namespace}style"):
        sheet = re.sub(r"/\*.*?\*/", "", "".join(style.itertext()), flags=re.DOTALL)
        _refuse_css(re.findall(r"[{;]\s*([a-zA-Z-]+)\s*:", sheet), f"{file}: <style>")
    while pending:
        element, outer = pending.pop()
        if not isinstance(element.tag, str) or not element.tag.startswith(namespace):
            continue
        name = element.tag[len(namespace) :]
        if name.startswith("{") or name in _NOT_DRAWN:
            continue
        identity = element.get("id")
        label = f"<{name}>" if identity is None else f"<{name} id={identity!r}>"
        style_text = element.get("style", "")
        css = {key.strip(): value.strip() for key, _, value in (part.partition(":") for part in style_text.split(";"))}
        if "none" in (css.pop("display", "").lower(), element.get("display", "").strip().lower()):
            continue
        _refuse_css(css, f"{file}: {label}")
        for key in ("clip-path", "mask"):
            if element.get(key, "none").strip() != "none":
                raise OutlineError(f"{file}: {label} has a {key}, which is not supported; cut the curve instead")
        try:
            inner = outer @ transform(element.get("transform", ""))
            if name in ("g", "a"):
                pending.extend((child, inner) for child in reversed(element))
                continue
            segments = _svg_segments(element, name, inner, physical)
        except OutlineError as error:
            raise OutlineError(f"{file}: {label}: {error}") from None
        yield from (Piece(segment, label) for segment in segments)


def _refuse_css(properties: Iterable[str], where: str) -> None:
    for name in properties:
        if name.lower() in _GEOMETRY_PROPERTIES:
            raise OutlineError(f"{where} sets {name!r} by CSS, which is not supported; set it as an attribute")


def _svg_segments(element: ElementTree.Element, name: str, frame: Frame, physical: bool) -> list[Segment]:
    def length(key: str, default: float | None = 0.0) -> float | None:
        text = element.get(key)
        if text is None or (default is None and text.strip() == "auto"):
            return default
        value, unit = length_and_unit(text, key)
        if unit in ("", "px"):
            return value
        if unit == "%" or not physical:
            raise OutlineError(f"{key} is {text!r}: write it in user units, as a number without a unit")
        return value * MM_PER_UNIT[unit] / MM_PER_PX

    def number(key: str) -> float:
        return length(key) or 0.0

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
        rx = number("r") if name == "circle" else length("rx", None)
        ry = number("r") if name == "circle" else length("ry", None)
        rx, ry = (ry if rx is None else rx) or 0.0, (rx if ry is None else ry) or 0.0
        _check_sizes(rx, ry)
        return [frame.ellipse(centre, rx, ry, 0.0, 0.0, FULL_TURN)] if rx and ry else []
    if name == "rect":
        x, y, width, height = number("x"), number("y"), number("width"), number("height")
        rx, ry = length("rx", None), length("ry", None)
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
