"""What a scene has measured: the lane beside, a following vehicle, a line, a column, and how far is looked."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class NearLane:
    """A lane beside the host vehicle's: y_min_mm ≤ Y ≤ y_max_mm, in vehicle coordinates."""

    y_min_mm: float
    y_max_mm: float


@dataclass(frozen=True, slots=True)
class Face:
    """The front of a following vehicle: an upright rectangle that stands on the ground, across the road.

    Parameters
    ----------
    width_mm, height_mm : its size, mm.
    y_mm : Y of its middle, mm, to the right of the host vehicle's median plane.
    """

    width_mm: float
    height_mm: float
    y_mm: float


@dataclass(frozen=True, slots=True)
class Asked:
    """What a scene has measured.

    Parameters
    ----------
    lane : beside the host vehicle's.
    line_y : Y of that lane's line, mm; None where no line is asked about.
    face : the front of one vehicle; None where none is.
    distances : X at which the front is looked at, mm.
    column : X, Y and height of an upright line, mm; None where none is asked about.
    widths_at : X at which the width of the ground counts, mm.
    direct_view : the azimuth, radians, from straight ahead, at which direct view ends.
    hidden_height : mm over the ground, of what may hide in the lane beside.
    """

    lane: NearLane
    line_y: float | None
    face: Face | None
    distances: tuple[float, ...]
    column: tuple[float, float, float] | None
    widths_at: tuple[float, ...]
    direct_view: float
    hidden_height: float
