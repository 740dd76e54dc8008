"""The rounded quadrilateral of a truck mirror."""

from __future__ import annotations

import math

from mirror_cad.errors import OutlineError
from mirror_cad.outline.numbers import ROUNDING_MM
from mirror_cad.outline.record import Outline, closed_outline
from mirror_cad.outline.segments import Arc, Line, Segment

SMALLEST_RADIUS_MM = 1e-2
"""Smallest corner radius of a generated outline: smaller arcs are of the size that files and kernels join away."""


def truck_outline(width_mm: float, left_height_mm: float, right_height_mm: float, corner_radius_mm: float) -> Outline:
    """The rounded outline of a truck mirror, symmetric about y = 0.

    The quadrilateral has the corners (-width/2, +-left/2) and (+width/2, +-right/2); each is replaced by the arc tangent to
    both its sides, which takes r / tan(angle/2) off either side. With radius 0 the corners stay sharp. Sides used up by their
    arcs are left out.

    Parameters
    ----------
    width_mm, left_height_mm, right_height_mm : float
        Above 0.
    corner_radius_mm : float
        r, 0 or at least 0.01.

    Raises
    ------
    OutlineError
        For a size that is not a finite number above 0, a radius below 0.01 other than 0, and a radius that does not fit, naming
        the corners and the largest radius that does.
    """
    source = "truck outline"
    for name, value in (
        ("width_mm", width_mm), ("left_height_mm", left_height_mm), ("right_height_mm", right_height_mm)
    ):  # fmt: skip
        if not (math.isfinite(value) and value > 0.0):
            raise OutlineError(f"{source}: {name} is {value!r} mm: it must be a finite number above 0")
    if not (corner_radius_mm == 0.0 or SMALLEST_RADIUS_MM <= corner_radius_mm < math.inf):
        raise OutlineError(
            f"{source}: corner_radius_mm is {corner_radius_mm!r} mm: it must be 0 for sharp corners, or finite and at "
            f"least {SMALLEST_RADIUS_MM:g}"
        )
    x, left, right = 0.5 * width_mm, 0.5 * left_height_mm, 0.5 * right_height_mm
    # Counter-clockwise from the lower left; side i runs from corner i to corner i + 1.
    corners = [(-x, -left), (x, -right), (x, right), (-x, left)]
    if corner_radius_mm == 0.0:
        return closed_outline([Line(corners[i], corners[(i + 1) % 4]) for i in range(4)], source)

    tilt = math.atan2(left - right, width_mm)  # of the lower side, positive where it rises to the right
    left_turn, right_turn = 0.5 * math.pi + tilt, 0.5 * math.pi - tilt
    # A corner's arc turns by pi - angle, so the side it takes off is r / tan(angle/2) = r tan(turn/2).
    left_take, right_take = math.tan(0.5 * left_turn), math.tan(0.5 * right_turn)
    sides = [
        (left_height_mm / (2.0 * left_take), "both left corners"),
        (right_height_mm / (2.0 * right_take), "both right corners"),
        (math.hypot(width_mm, left - right) / (left_take + right_take), "the left and right corners of a long side"),
    ]
    largest, where = min(sides)
    if corner_radius_mm > largest * (1.0 + 1e-12):
        raise OutlineError(
            f"{source}: corner_radius_mm {corner_radius_mm:.6g} does not fit at {where} of {width_mm:.6g} mm by "
            f"{left_height_mm:.6g} mm (left) and {right_height_mm:.6g} mm (right); the largest radius that fits is "
            f"{largest:.6g} mm"
        )
    take = (left_take * corner_radius_mm, right_take * corner_radius_mm)
    radius = corner_radius_mm
    lower = 1.5 * math.pi + tilt  # direction of the lower side's outward normal
    arcs = [
        Arc((-x + radius, -left + take[0]), radius, math.pi, left_turn),
        Arc((x - radius, -right + take[1]), radius, lower, right_turn),
        Arc((x - radius, right - take[1]), radius, 0.0, right_turn),
        Arc((-x + radius, left - take[0]), radius, 0.5 * math.pi - tilt, left_turn),
    ]
    segments: list[Segment] = []
    for i, arc in enumerate(arcs):
        segments.append(arc)
        side = Line(arc.end, arcs[(i + 1) % 4].start)
        if math.dist(side.start, side.end) > ROUNDING_MM:
            segments.append(side)
    return closed_outline(segments, source)
