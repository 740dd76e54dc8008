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
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


def written_by_us(path: Path) -> bool:
    """Whether a STEP or STL file names this program as the one it comes from."""
    return hand_of(path) is not None


def hand_in_words(hand: Hand) -> str:
    """What a header says of the hand."""
    return f"{hand}-hand mirror"


def hand_of(path: Path) -> Hand | None:
    """The hand of a mirror whose STEP or STL file names this program as the one it comes from; None for any other file.

    STEP: originating_system of FILE_NAME (ISO 10303-21, 8.2.3), the last string but one, and the description. A program that
    reads our file and writes it again puts its own name there, and may have moved or reflected the part. STL: the 80 bytes of a
    binary file's header. No other kind of file is written by `build`. A file that does not say is left-handed, as all were
    before they did.
    """
    kind = path.suffix.lower()
    if kind not in (".step", ".stp", ".stl"):
        return None
    try:
        with path.open("rb") as stream:
            head = stream.read(HEADER_BYTES)
    except OSError:
        return None  # its reader says what is wrong with it
    if kind == ".stl":
        if not head.startswith(SYSTEM.encode() + b","):
            return None
        said = [head[:80].decode("latin-1")]
    else:
        text = _COMMENT.sub("", head.decode("latin-1"))
        found, described = _FILE_NAME.search(text), _DESCRIPTION.search(text)
        texts = _TEXT.findall(found["fields"]) if found else []
        if not (len(texts) >= 3 and texts[-2] == SYSTEM):
            return None
        said = _TEXT.findall(described["fields"]) if described else []
    return "right" if any(hand_in_words("right") in each for each in said) else "left"
