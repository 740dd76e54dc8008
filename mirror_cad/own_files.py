"""Recognise a file that `mirror-cad build` wrote, and the hand of its mirror: by what its header says, not by its name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

Hand = Literal["left", "right"]

SYSTEM = "mirror-cad"  # the originating system in the header of our STEP files, and what our STL files begin with
HEADER_BYTES = 8192  # that a STEP header is looked for in: ours has under a thousand

_FILE_NAME = re.compile(r"FILE_NAME\s*\((?P<fields>(?:[^;']|'(?:[^']|'')*')*)\)\s*;")
_DESCRIPTION = re.compile(r"FILE_DESCRIPTION\s*\((?P<fields>(?:[^;']|'(?:[^']|'')*')*)\)\s*;")
_TEXT = re.compile(r"'((?:[^']|'')*)'")
_TRANSITION = re.compile(r"transition line at x = (?P<x>-?\d+(?:\.\d+)?(?:e-?\d+)?) mm")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


def written_by_us(path: Path) -> bool:
    """Whether a STEP or STL file names this program as the one it comes from."""
    return hand_of(path) is not None


def hand_in_words(hand: Hand) -> str:
    """What a header says of the hand."""
    return f"{hand}-hand mirror"


def transition_in_words(x_mm: float) -> str:
    """What a header says of the line where an aspheric part begins, of the left-hand mirror."""
    return f"transition line at x = {x_mm!r} mm"


def transition_of(path: Path) -> float | None:
    """The x of the transition line that a STEP file of ours says its mirror has, mm, of the left-hand mirror.

    None where it says none, and for any other file.
    """
    found = [_TRANSITION.search(each) for each in _said(path) or ()]
    return next((float(each["x"]) for each in found if each), None)


def hand_of(path: Path) -> Hand | None:
    """The hand of a mirror whose STEP or STL file names this program as the one it comes from; None for any other file.

    STEP: originating_system of FILE_NAME (ISO 10303-21, 8.2.3), the last string but one, and the description. A program that
    reads our file and writes it again puts its own name there, and may have moved or reflected the part. STL: the 80 bytes of a
    binary file's header. No other kind of file is written by `build`. A file that does not say is left-handed, as all were
    before they did.
    """
    said = _said(path)
    if said is None:
        return None
    return "right" if any(hand_in_words("right") in each for each in said) else "left"


def _said(path: Path) -> list[str] | None:
    """What the header of a file of ours says of its mirror; None for any other file."""
    kind = path.suffix.lower()
    if kind not in (".step", ".stp", ".stl"):
        return None
    try:
        with path.open("rb") as stream:
            head = stream.read(HEADER_BYTES)
    except OSError:
        return None  # its reader says what is wrong with it
    if kind == ".stl":
        return [head[:80].decode("latin-1")] if head.startswith(SYSTEM.encode() + b",") else None
    text = _COMMENT.sub("", head.decode("latin-1"))
    found, described = _FILE_NAME.search(text), _DESCRIPTION.search(text)
    texts = _TEXT.findall(found["fields"]) if found else []
    if not (len(texts) >= 3 and texts[-2] == SYSTEM):
        return None
    return _TEXT.findall(described["fields"]) if described else []
