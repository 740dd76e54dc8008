"""The mirror's edge: one closed plane curve of lines, arcs and splines, drawn by sizes or read from a file."""

from mirror_cad.outline.record import (
    CONTAINS_TOLERANCE_MM,
    GENERATED_JOIN_TOLERANCE_MM,
    MAXIMUM_SIZE_MM,
    MINIMUM_SIZE_MM,
    Outline,
    closed_outline,
)
from mirror_cad.outline.segments import Arc, Line, Segment, Spline, arc_between
from mirror_cad.outline.truck import SMALLEST_RADIUS_MM, truck_outline

__all__ = [
    "CONTAINS_TOLERANCE_MM",
    "GENERATED_JOIN_TOLERANCE_MM",
    "MAXIMUM_SIZE_MM",
    "MINIMUM_SIZE_MM",
    "SMALLEST_RADIUS_MM",
    "Arc",
    "Line",
    "Outline",
    "Segment",
    "Spline",
    "arc_between",
    "closed_outline",
    "truck_outline",
]
