"""Recognise a file that `mirror-cad build` wrote: by what its header says, not by its name."""

from __future__ import annotations

import re
from pathlib import Path

SYSTEM = "mirror-cad"  # the originating system in the header of our STEP files, and what our STL files begin with
HEADER_BYTES = 8192  # that a STEP header is looked for in: ours has under a thousand

_FILE_NAME = re.compile(r"FILE_NAME\s*\((?P<fields>(?:[^;']|'(?:[^']|'')*')*)\)\s*;")
_TEXT = re.compile(r"'((?:[^']|'')*)'")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


def written_by_us(path: Path) -> bool:
    """Whether a STEP or STL file names this program as the one it comes from.

    STEP: originating_system of FILE_NAME (ISO 10303-21, 8.2.3), the last string but one. A program that reads our file and
    writes it again puts its own name there, and may have moved the part. STL: the 80 bytes of a binary file's header. No other
    kind of file is written by `build`.
    """
    kind = path.suffix.lower()
    if kind not in (".step", ".stp", ".stl"):
        return False
    try:
        with path.open("rb") as stream:
            head = stream.read(HEADER_BYTES)
    except OSError:
        return False  # its reader says what is wrong with it
    if kind == ".stl":
        return head.startswith(SYSTEM.encode() + b",")
    found = _FILE_NAME.search(_COMMENT.sub("", head.decode("latin-1")))
    texts = _TEXT.findall(found["fields"]) if found else []
    return len(texts) >= 3 and texts[-2] == SYSTEM
