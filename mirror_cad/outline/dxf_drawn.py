"""The entities of a DXF file that a viewer would draw: visible layers, blocks taken apart, damage repaired."""

from __future__ import annotations

import contextlib
import logging
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

from mirror_cad.errors import OutlineError
from mirror_cad.outline.transition import TRANSITION_LAYER

if TYPE_CHECKING:  # ezdxf takes a quarter of a second to be loaded: those who neither read nor write a drawing do without
    from ezdxf.document import Drawing
    from ezdxf.entities import DXFEntity, Insert

_ANNOTATIONS = {
    "TEXT", "MTEXT", "DIMENSION", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION", "POINT", "LEADER", "MULTILEADER",
    "MLEADER", "TOLERANCE", "ATTDEF", "ATTRIB", "VIEWPORT"
}  # fmt: skip
# Drawn, but no curve that could be an outline: endless lines to construct on, fillings, pictures laid under.
_NO_CURVES = {
    "XLINE", "RAY", "HATCH", "MPOLYGON", "IMAGE", "WIPEOUT", "PDFUNDERLAY", "DWFUNDERLAY", "DGNUNDERLAY", "OLE2FRAME",
    "ACAD_TABLE", "LIGHT", "SUN"
}  # fmt: skip
_BLOCK_DEPTH = 32
"""Most blocks inside each other: drawings have a handful, a block that holds itself has no end."""

MAXIMUM_ENTITIES = 200_000
"""Most entities looked at, so that a block that holds blocks in hundreds of copies cannot exhaust the memory."""

_XREF = 4 | 8
"""Flags of a block that stands for another file (external reference, overlaid or not)."""


class Drawn(NamedTuple):
    """An entity in coordinates of the model space, and what to call it in messages."""

    entity: DXFEntity
    label: str


def printable(text: object) -> str:
    """At most 200 characters of a text that came from a damaged file, bytes that are none written as escapes."""
    return str(text)[:200].encode("ascii", "backslashreplace").decode()


def open_dxf(file: Path, notes: list[str]) -> tuple[Drawing, int]:
    """The drawing and the code of its unit; a damaged file is repaired where that can be done, with a note.

    Raises `OutlineError` for a file that is no DXF file or beyond repair.
    """
    import ezdxf

    with _quiet():
        try:
            document = ezdxf.readfile(str(file))
        except Exception as error:
            document = _recovered(file, error, notes)
    # Without a header of its own a document gets ezdxf's, whose unit is the metre: only what the file says counts.
    unit = document.header.get("$INSUNITS", 0) if b"$INSUNITS" in file.read_bytes() else 0
    return document, unit


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Without a handler, logged warnings land on the terminal; what matters of them is said in a note."""
    logger = logging.getLogger("ezdxf")
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


def _recovered(file: Path, fault: Exception, notes: list[str]) -> Drawing:
    from ezdxf import recover

    try:
        document, audit = recover.readfile(str(file))
        lost = len(audit.errors)
        empty = len(document.modelspace()) == 0
    except Exception:
        empty = True
    if empty:
        if isinstance(fault, OSError):
            raise OutlineError(f"{file}: not a DXF file, or it cannot be read ({printable(fault)}); export it again as DXF")
        raise OutlineError(
            f"{file}: damaged DXF file ({type(fault).__name__}: {printable(fault)}); export it again as R2000 or later"
        )
    beyond = f", {lost} fault{'s' * (lost != 1)} beyond repair" if lost else ""
    what = printable(str(fault) or type(fault).__name__)
    notes.append(f"{file.name}: the file is damaged ({what}) and was repaired to be read{beyond}: compare the outline with "
                 "the drawing, and export it again")
    return document


def drawn_entities(document: Drawing, file: Path, layer: str | None, notes: list[str]) -> Iterator[Drawn]:
    """What is drawn in the model space, blocks taken apart, on one layer or on all that are seen.

    Left out, with a note of how many and why: what is on a layer that is off, frozen or never plotted (Defpoints and those
    with the plot flag off), what is invisible itself, a transition line on its layer, and endless lines, fillings and pictures.
    A layer that is asked for counts even where it is hidden. Inside a block the layer 0 is that of the insert; an insert on a
    frozen layer is not drawn with all that is in it.

    Raises `OutlineError` for a layer that does not exist, a block that is missing or stands for another file.
    """
    if layer is not None and layer.casefold() not in _layers_of(document):
        names = ", ".join(sorted(_layers_of(document).values())[:20])
        raise OutlineError(f"{file}: outline.layer = {layer!r}: there is no such layer; the file has {printable(names)}")
    hidden = {} if layer is not None else _hidden_layers(document)
    left_out: Counter[str] = Counter()
    other_layers = 0
    pending: list[tuple[DXFEntity, str, str, tuple[str, ...]]]  # entity, the layer that 0 stands for, label, blocks about it
    pending = [(entity, "0", _label(entity), ()) for entity in reversed(list(document.modelspace()))]
    looked_at = 0
    while pending:
        looked_at += 1
        if looked_at + len(pending) > MAXIMUM_ENTITIES:
            raise OutlineError(f"{file}: more than {MAXIMUM_ENTITIES} entities; export the outline alone")
        entity, around, label, blocks = pending.pop()
        kind = entity.dxftype()
        if kind in _ANNOTATIONS:
            continue
        own = str(entity.dxf.get("layer", "0"))
        own = around if own == "0" and blocks else own
        why = hidden.get(own.casefold())
        if entity.dxf.get("invisible", 0):
            left_out["invisible"] += 1
        elif kind == "INSERT":
            if why == "frozen":
                left_out[f"on the layer {printable(own)!r}, which is frozen"] += 1
                continue
            parts = _taken_apart(cast("Insert", entity), file, label, blocks)
            pending.extend((part, own, f"{_label(part)} in the block {printable(entity.dxf.name)!r}",
                            (*blocks, entity.dxf.name)) for part in reversed(parts))
        elif why is not None:
            left_out[f"on the layer {printable(own)!r}, which is {why}"] += 1
        elif layer is not None and own.casefold() != layer.casefold():
            other_layers += 1
        elif layer is None and own == TRANSITION_LAYER:
            left_out[f"on the layer {own!r}, a line on the mirror and no piece of its outline"] += 1
        elif kind in _NO_CURVES:
            left_out[f"{kind}, which is no piece of an outline"] += 1
        else:
            yield Drawn(entity, label)
    if left_out:
        notes.append(f"{file.name}: left out: {'; '.join(f'{count} {what}' for what, count in sorted(left_out.items()))}")
    if other_layers:
        notes.append(f"{file.name}: left out: {other_layers} on other layers than {layer!r}")


def _label(entity: DXFEntity) -> str:
    handle = entity.dxf.get("handle")
    return printable(entity.dxftype() if handle is None else f"{entity.dxftype()} with handle {handle}")


def _layers_of(document: Drawing) -> dict[str, str]:
    """The names of all layers that are listed or used, by their case-folded names: DXF does not tell cases apart."""
    names = [str(layer.dxf.name) for layer in document.layers]
    names += [str(entity.dxf.get("layer", "0")) for entity in document.entitydb.values() if entity.dxf.is_supported("layer")]
    return {name.casefold(): name for name in names}


def _hidden_layers(document: Drawing) -> dict[str, str]:
    """Why layers are not drawn, by their case-folded names."""
    hidden = {"defpoints": "never plotted"}
    for layer in document.layers:
        why = "frozen" if layer.is_frozen() else "off" if layer.is_off() else None
        if why is None and not layer.dxf.get("plot", 1):
            why = "never plotted"
        if why is not None:
            hidden[str(layer.dxf.name).casefold()] = why
    return hidden


def _taken_apart(insert: Insert, file: Path, label: str, blocks: tuple[str, ...]) -> list[DXFEntity]:
    """The entities of an inserted block, moved, turned and scaled to where it stands."""
    name = insert.dxf.get("name", "")
    block = insert.block()
    if block is None:
        raise OutlineError(f"{file}: {label}: its block {printable(name)!r} is missing; export the file again")
    if block.block is not None and block.block.dxf.get("flags", 0) & _XREF:
        other = printable(block.block.dxf.get("xref_path", "") or name)
        raise OutlineError(f"{file}: {label}: its block {printable(name)!r} stands for another file, {other!r}; bind it")
    if name in blocks or len(blocks) >= _BLOCK_DEPTH:
        raise OutlineError(f"{file}: {label}: its block {printable(name)!r} holds itself; explode it")
    if insert.mcount > MAXIMUM_ENTITIES:
        raise OutlineError(f"{file}: {label}: its block {printable(name)!r} stands there {insert.mcount} times; explode it")
    copies = insert.multi_insert() if insert.mcount > 1 else [insert]
    try:
        skipped: list[str] = []
        parts = [part for copy in copies
                 for part in copy.virtual_entities(skipped_entity_callback=lambda entity, _: skipped.append(entity.dxftype()))]
    except Exception as error:
        raise OutlineError(f"{file}: {label} cannot be exploded ({type(error).__name__}: {printable(error)})") from None
    lost = sorted(kind for kind in set(skipped) if kind not in _ANNOTATIONS | _NO_CURVES)
    if lost:
        raise OutlineError(f"{file}: {label}: {', '.join(lost)} in its block {printable(name)!r} cannot be placed; explode it")
    return parts
