"""What a specification says of its outline file, and what was found in the file beside the curve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from mirror_cad.outline.record import Outline

Loop = Literal["only", "outermost"]

FILE_JOIN_TOLERANCE_MM = 1e-3
"""Ends of pieces in a file that are this close are one point: the rounding of files, and never worth a word."""

JOIN_MM = 0.1
"""Loose ends this close are joined unless a specification says otherwise, and that is said: as far as drawings of parts
this large are seen to be off, and below what a rim is cut to."""

LARGEST_JOIN_MM = 1.0
"""Most that a specification may ask to have joined: a wider gap is a missing piece."""


@dataclass(frozen=True, slots=True)
class FileOptions:
    """How an outline file is read.

    Attributes
    ----------
    layer
        What counts is drawn on this layer of a DXF file, or inside the element of an SVG file with this id or Inkscape label,
        even where that is hidden; None takes whatever is drawn.
    join_mm
        Loose ends up to this far apart, in mm, are joined and a note says so; at least 1e-3.
    loop
        "only" refuses a file with several closed loops; "outermost" takes the one that holds all others.
    """

    layer: str | None = None
    join_mm: float = JOIN_MM
    loop: Loop = "only"


AS_DRAWN = FileOptions()
"""Whatever is drawn, as one closed loop."""


@dataclass(frozen=True, slots=True, eq=False)
class OutlineFile:
    """An outline as a file had it, and notes (sentences) on what was left out, joined or repaired to have it."""

    outline: Outline
    notes: tuple[str, ...]
