"""The pieces of an SVG file that a viewer would draw: groups, uses, switches, clips that cut nothing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from mirror_cad.errors import OutlineError
from mirror_cad.outline.numbers import Bounds
from mirror_cad.outline.pieces import Piece
from mirror_cad.outline.segments import Line, Segment
from mirror_cad.outline.svg_shapes import plain_length, shape_segments
from mirror_cad.outline.svg_text import MM_PER_PX, MM_PER_UNIT, Frame, length_and_unit, numbers, transform

_SVG = "{http://www.w3.org/2000/svg}"
_NOT_DRAWN = {
    "defs", "title", "desc", "metadata", "style", "text", "symbol", "marker", "pattern", "clipPath", "mask", "filter",
    "linearGradient", "radialGradient", "view"
}  # fmt: skip
_GEOMETRY_PROPERTIES = {
    "d", "x", "y", "cx", "cy", "r", "rx", "ry", "width", "height", "transform", "translate", "rotate", "scale", "zoom",
    "clip-path", "mask", "display"
}  # fmt: skip

_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_IDENTITY = Frame(1.0, 0.0, 0.0, 1.0, 0.0, 0.0)

MAXIMUM_ELEMENTS = 200_000
"""Most elements looked at, so that uses of uses cannot exhaust the memory."""

_USES = 32
"""Most uses inside each other: drawings have a handful, a use of itself has no end."""

_CLIP_MARGIN = 1e-6
"""Of a clip's size: what reaches no farther beyond it is not cut by it, but drawn to its very edge and rounded."""


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


class _Clip(NamedTuple):
    """What a viewer would cut to: the clip-path as it is named, the user space it is in, and what has it, for messages."""

    text: str
    frame: Frame
    label: str


@dataclass(frozen=True, slots=True)
class _State:
    """What an element inherits.

    Map to the mirror's coordinates, whether it is visible, whether it lies on the layer that is asked for, the clips about
    it, and the ids of the uses that it is in.
    """

    frame: Frame
    visible: bool
    chosen: bool
    clips: tuple[_Clip, ...] = ()
    uses: tuple[str, ...] = ()


class _Document:
    """An SVG document as its elements refer to each other."""

    def __init__(self, file: Path, root: ElementTree.Element, physical: bool) -> None:
        self.file, self.root, self.physical = file, root, physical
        self.namespace = _SVG if root.tag.startswith(_SVG) else ""
        self.by_id: dict[str, ElementTree.Element] = {}
        for element in root.iter():
            if (identity := element.get("id")) is not None:
                self.by_id.setdefault(identity, element)
        self.clip_of_class: dict[str, str] = {}
        self.clip_boxes: dict[str, tuple[Bounds, Frame]] = {}
        for style in root.iter(f"{self.namespace}style"):
            self._read_sheet(re.sub(r"/\*.*?\*/", "", "".join(style.itertext()), flags=re.DOTALL))
        self.looked_at = 0

    def _read_sheet(self, sheet: str) -> None:
        """Clips of plain classes, as Illustrator writes them; other geometry is refused."""
        for selector, body in re.findall(r"([^{}]*)\{([^{}]*)\}", sheet):
            properties = _properties(body)
            clip = properties.pop("clip-path", None)
            if clip is not None:
                classes = [re.fullmatch(r"\.([\w-]+)", part.strip()) for part in selector.split(",")]
                if not all(classes):
                    raise OutlineError(f"<style> sets 'clip-path' for {selector.strip()!r}, which is not supported; set it as "
                                       "an attribute")
                self.clip_of_class |= {match[1]: clip for match in classes if match is not None}
            _refuse_css(properties, "<style>")

    def name_of(self, element: ElementTree.Element) -> str | None:
        """The local name of an SVG element; None for comments and elements of other namespaces."""
        if not isinstance(element.tag, str) or not element.tag.startswith(self.namespace):
            return None
        name = element.tag[len(self.namespace):]
        return None if name.startswith("{") else name

    def pieces(self, elements: Iterable[ElementTree.Element], state: _State, layer: str | None) -> Iterator[Piece]:
        """What these elements draw, in document order."""
        pending = [(element, state) for element in reversed(list(elements))]
        while pending:
            element, outer = pending.pop()
            name = self.name_of(element)
            if name is None or name in _NOT_DRAWN:
                continue
            self.looked_at += 1
            if self.looked_at > MAXIMUM_ELEMENTS:
                raise OutlineError(f"more than {MAXIMUM_ELEMENTS} elements; export the outline alone")
            label = _label(element, name)
            css = _properties(element.get("style", ""))
            if "none" in (css.pop("display", "").lower(), element.get("display", "").strip().lower()):
                continue
            inner = self._inner(element, label, css, outer, layer)
            if name in ("g", "a"):
                pending.extend((child, inner) for child in reversed(element))
            elif name == "switch":
                shown = self._shown(element)
                pending.extend([] if shown is None else [(shown, inner)])
            elif name == "use":
                pending.append(self._used(element, label, inner))
            else:
                if not (inner.visible and inner.chosen):
                    continue
                try:
                    segments = shape_segments(element, name, inner.frame, self.physical)
                except OutlineError as error:
                    raise OutlineError(f"{label}: {error}") from None
                if segments:
                    self._check_clips(segments, label, inner)
                    yield from (Piece(segment, label) for segment in segments)

    def _inner(self, element: ElementTree.Element, label: str, css: dict[str, str], outer: _State, layer: str | None) -> _State:
        """The state inside an element, which its own attributes and style change."""
        of_class = [self.clip_of_class[name] for name in element.get("class", "").split() if name in self.clip_of_class]
        clip = css.pop("clip-path", of_class[-1] if of_class else element.get("clip-path", "none")).strip()
        visibility = css.pop("visibility", element.get("visibility", "inherit")).strip().lower()
        if (mask := css.pop("mask", element.get("mask", "none")).strip()) != "none":
            raise OutlineError(f"{label} has a mask, {mask}, which is not supported; cut the curve instead")
        _refuse_css(css, label)
        try:
            frame = outer.frame @ transform(element.get("transform", ""))
        except OutlineError as error:
            raise OutlineError(f"{label}: {error}") from None
        clips = outer.clips
        if clip not in ("none", ""):
            clips = (*clips, _Clip(clip, frame, label))
        visible = outer.visible if visibility == "inherit" else visibility == "visible"
        chosen = outer.chosen or layer in (element.get("id"), element.get(_LABEL))
        return replace(outer, frame=frame, visible=visible, chosen=chosen, clips=clips)

    def _shown(self, switch: ElementTree.Element) -> ElementTree.Element | None:
        """The first element of a switch whose conditions a viewer without extensions meets, in whatever language."""
        for child in switch:
            if self.name_of(child) is not None and not child.get("requiredExtensions", "").strip() \
                    and child.get("systemLanguage", "en") != "":
                return child
        return None

    def _referred(self, element: ElementTree.Element, label: str) -> tuple[str, ElementTree.Element]:
        href = next((element.get(key, "").strip() for key in _HREFS if element.get(key)), "")
        if not href.startswith("#"):
            raise OutlineError(f"{label} uses {href!r}, which is not in this file; copy it in")
        found = self.by_id.get(href[1:])
        if found is None:
            raise OutlineError(f"{label} uses {href!r}, and the file has no element of that id")
        return href[1:], found

    def _used(self, element: ElementTree.Element, label: str, state: _State) -> tuple[ElementTree.Element, _State]:
        """The element that a use draws, and the state it is drawn in: moved by the use's x and y."""
        identity, found = self._referred(element, label)
        if identity in state.uses or len(state.uses) >= _USES:
            raise OutlineError(f"{label} uses itself; copy what it draws instead")
        name = self.name_of(found)
        try:
            x, y = (plain_length(element, key, self.physical) for key in ("x", "y"))
        except OutlineError as error:
            raise OutlineError(f"{label}: {error}") from None
        state = replace(state, frame=state.frame @ Frame(1.0, 0.0, 0.0, 1.0, x, y), uses=(*state.uses, identity))
        if name == "symbol" and found.get("viewBox") is None:
            group = ElementTree.Element(f"{self.namespace}g", {k: v for k, v in found.attrib.items() if k != "id"})
            group.extend(list(found))
            return group, state
        if name in ("symbol", "svg"):
            raise OutlineError(f"{label} uses a <{name}> that is scaled to a view, which is not supported; convert it "
                               "to a path")
        return found, state

    def _check_clips(self, segments: list[Segment], label: str, state: _State) -> None:
        """Raise `OutlineError` where a clip cuts: what lies inside of all of them is drawn as if there were none."""
        for clip in state.clips:
            if clip.text not in self.clip_boxes:
                self.clip_boxes[clip.text] = self._clip_box(clip, state.uses)
            box, own = self.clip_boxes[clip.text]
            f = clip.frame @ own
            turn = np.array([[f.a, f.c], [f.b, f.d]])
            if not abs(np.linalg.det(turn)) > 0.0:
                raise OutlineError(f"{label} is clipped to nothing; delete the clip")
            bounds = np.array([segment.bounds() for segment in segments])
            low, high = bounds.min(axis=0), bounds.max(axis=0)
            corners = np.array([(x, y) for x in (low[0], high[1]) for y in (low[2], high[3])])
            inside = np.linalg.solve(turn, (corners - (f.e, f.f)).T).T
            margin = _CLIP_MARGIN * max(box[1] - box[0], box[3] - box[2])
            if (inside < (box[0] - margin, box[2] - margin)).any() or (inside > (box[1] + margin, box[3] + margin)).any():
                raise OutlineError(f"{label} reaches beyond the clip-path of {clip.label}, which would cut it; delete the clip "
                                   "or cut the curve")

    def _clip_box(self, clip: _Clip, uses: tuple[str, ...]) -> tuple[Bounds, Frame]:
        """(x_min, x_max, y_min, y_max) of a clip that is a rectangle, as an artboard's is, and its own transform."""
        match = re.fullmatch(r"url\(\s*['\"]?#([^'\")]+)['\"]?\s*\)", clip.text)
        found = self.by_id.get(match[1]) if match else None
        if match is None or found is None or self.name_of(found) != "clipPath":
            raise OutlineError(f"{clip.label} has the clip-path {clip.text!r}, which is not in this file; cut the curve "
                               "instead")
        name = f"clip {match[1]}"
        if name in uses:
            raise OutlineError(f"{clip.label} has a clip-path that is clipped by itself; cut the curve instead")
        state = _State(_IDENTITY, True, True, (), (*uses, name))
        sides = [piece.segment for piece in self.pieces(list(found), state, None)]
        ends = np.array([point for side in sides for point in (side.start, side.end)]).reshape(-1, 2)
        if sides and all(isinstance(side, Line) for side in sides) and not found.get("clipPathUnits", "").startswith("object"):
            low, high = ends.min(axis=0), ends.max(axis=0)
            close = _CLIP_MARGIN * float((high - low).max())
            at_low, at_high = np.abs(ends - low) <= close, np.abs(ends - high) <= close
            # All four corners of the box and nothing else, every side along one of the box's: once round, the box itself.
            corners = {(bool(x), bool(y)) for x, y in at_high}
            along = all(min(abs(side.start[i] - side.end[i]) for i in (0, 1)) <= close for side in sides)
            if along and (at_low ^ at_high).all() and len(corners) == 4:
                return ((float(low[0]), float(high[0]), float(low[1]), float(high[1])),
                        transform(found.get("transform", "")))
        raise OutlineError(f"{clip.label} has a clip-path that is no rectangle, which is not supported; cut the curve instead")


def svg_pieces(file: Path, layer: str | None, notes: list[str]) -> Iterator[Piece]:
    """The pieces drawn in an SVG file, in mm; `mirror_cad.outline.files.read_outline` says what counts."""
    root = _svg_root(file)
    try:
        frame, physical = _document_frame(root)
        document = _Document(file, root, physical)
        if layer is not None and not any(layer in (each.get("id"), each.get(_LABEL)) for each in root.iter()):
            labels = sorted({name for each in root.iter() if (name := each.get(_LABEL) or each.get("id"))})[:20]
            raise OutlineError(f"outline.layer = {layer!r}: no element has that id or Inkscape label; the file has "
                               f"{', '.join(labels) or 'none'}")
        yield from document.pieces(list(root), _State(frame, True, layer is None), layer)
    except OutlineError as error:
        raise OutlineError(f"{file}: {error}") from None


def _label(element: ElementTree.Element, name: str) -> str:
    identity = element.get("id")
    return f"<{name}>" if identity is None else f"<{name} id={identity!r}>"


def _properties(text: str) -> dict[str, str]:
    """The declarations of a style attribute or of a rule's body."""
    return {key.strip(): value.strip() for key, _, value in (part.partition(":") for part in text.split(";")) if key.strip()}


def _refuse_css(properties: Iterable[str], where: str) -> None:
    for name in properties:
        if name.lower() in _GEOMETRY_PROPERTIES:
            raise OutlineError(f"{where} sets {name!r} by CSS, which is not supported; set it as an attribute")
