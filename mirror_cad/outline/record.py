"""A mirror's outline: one closed plane curve of segments.

Coordinates are mirror coordinates in millimetres, x to the right and y up as one looks at the reflecting face. An
`Outline` runs counter-clockwise. Segments are exact; only `Outline.polyline` and `Outline.contains` work on straight
edges, and both state how far those may lie from the curve.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from mirror_cad.errors import OutlineError
from mirror_cad.outline.checks import check_simple
from mirror_cad.outline.numbers import (
    FULL_TURN,
    MAXIMUM_EDGES,
    ROUNDING_MM,
    BoolArray,
    Bounds,
    FloatArray,
    Point,
    point_text,
)
from mirror_cad.outline.segments import Arc, Line, Segment, Spline, arc_between

GENERATED_JOIN_TOLERANCE_MM = 1e-6
"""Largest gap between consecutive segments that were computed rather than read from a file."""

CONTAINS_TOLERANCE_MM = 1e-4
"""Chord tolerance of the polygon behind `Outline.contains` and the self-intersection check."""

MINIMUM_SIZE_MM = 1.0
"""An outline must be larger than this both across and upwards: smaller means wrong units or a stray piece."""

MAXIMUM_SIZE_MM = 1e5
"""An outline must be smaller than this both across and upwards: larger means wrong units."""


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A closed, simple, counter-clockwise loop of segments, each starting where the one before ends (mm).

    Build one with `closed_outline`, which joins, orients and checks the segments; this constructor takes them as they
    are.
    """

    segments: tuple[Segment, ...]
    _polygon: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", tuple(self.segments))
        object.__setattr__(self, "_polygon", self.polyline(CONTAINS_TOLERANCE_MM))
        self._polygon.flags.writeable = False

    def bounding_box(self) -> Bounds:
        """(x_min, x_max, y_min, y_max) in mm, exact for lines, arcs and splines."""
        boxes = np.array([segment.bounds() for segment in self.segments])
        low, high = boxes.min(axis=0), boxes.max(axis=0)
        return float(low[0]), float(high[1]), float(low[2]), float(high[3])

    def polyline(self, tolerance_mm: float) -> FloatArray:
        """A counter-clockwise polygon on the outline, every segment end a vertex.

        Parameters
        ----------
        tolerance_mm : float
            No edge is farther from the curve it replaces.

        Returns
        -------
        ndarray
            (n, 2), mm; the first vertex is not repeated.

        Raises
        ------
        OutlineError
            Unless the tolerance is above 0, and where more than `MAXIMUM_EDGES` edges would be needed.
        """
        parts: list[FloatArray] = []
        total = 0
        for segment in self.segments:
            parts.append(segment.samples(tolerance_mm)[:-1])
            total += len(parts[-1])
            if total > MAXIMUM_EDGES:
                raise OutlineError(
                    f"the outline needs more than {MAXIMUM_EDGES} edges at a chord tolerance of {tolerance_mm:g} mm; "
                    "use a larger tolerance or a simpler outline"
                )
        points = np.concatenate(parts)
        return points[(points != np.roll(points, 1, axis=0)).any(axis=1)]

    def area_mm2(self) -> float:
        """Area in mm^2 by Green's theorem, A = 1/2 of the integral of x dy - y dx, segment by segment.

        Exact to rounding for lines, arcs and polynomial splines; rational splines by a 40-point rule on each span.
        """
        about = self.segments[0].start  # near the curve, so that an outline far from the origin keeps its digits
        return math.fsum(segment.swept_area(about) for segment in self.segments)

    def contains(self, x: ArrayLike, y: ArrayLike) -> BoolArray:
        """Whether points lie inside.

        Decided on the polygon with a chord tolerance of 1e-4 mm (`CONTAINS_TOLERANCE_MM`): a point nearer the outline than that
        may fall either way, one farther away never does. Points that are not finite are outside. The cost is a sort of the
        points by y plus, for every edge, a comparison with the points at its height.

        Parameters
        ----------
        x, y : array_like
            mm, of shapes that broadcast.

        Returns
        -------
        ndarray
            Of the common shape.
        """
        xs, ys = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        order = np.argsort(ys, axis=None)
        x_sorted, y_sorted = xs.ravel()[order], ys.ravel()[order]
        start, end = self._polygon, np.roll(self._polygon, -1, axis=0)
        low, high = np.minimum(start[:, 1], end[:, 1]), np.maximum(start[:, 1], end[:, 1])
        # Half-open in y: a vertex belongs to the edge above it only, so that a ray through it counts once.
        first, last = np.searchsorted(y_sorted, low, side="left"), np.searchsorted(y_sorted, high, side="left")
        inside = np.zeros(len(order), dtype=bool)
        for i in np.flatnonzero(last > first):
            here = slice(first[i], last[i])
            (x0, y0), (x1, y1) = start[i], end[i]
            inside[here] ^= x_sorted[here] < x0 + (y_sorted[here] - y0) * ((x1 - x0) / (y1 - y0))
        result = np.empty(len(order), dtype=bool)
        result[order] = inside
        return result.reshape(xs.shape)

    def moved(self, dx: float, dy: float) -> Outline:
        """The outline moved by (dx, dy) mm."""
        return Outline(tuple(segment.moved(dx, dy) for segment in self.segments))

    def mirrored(self) -> Outline:
        """The outline reflected in x = 0, counter-clockwise as well."""
        return Outline(tuple(segment.mirrored().reversed() for segment in reversed(self.segments)))


def _arc_moved_to(arc: Arc, start: Point, end: Point) -> Arc:
    """`arc` with its ends moved by less than a join tolerance to `start` and `end`."""
    if abs(arc.sweep) <= math.pi:
        return arc_between(start, end, arc.sweep)
    # Beyond half a turn the chord says little about the radius; the sweep then follows from keeping the middle point,
    # the chord seen from it being half the arc that is left.
    middle = arc.point(0.5)
    to_start, to_end = np.array(start) - middle, np.array(end) - middle
    inscribed = math.atan2(abs(to_start[0] * to_end[1] - to_start[1] * to_end[0]), float(to_start @ to_end))
    return arc_between(start, end, math.copysign(FULL_TURN - 2.0 * inscribed, arc.sweep))


def _with_ends(segment: Line | Spline, start: Point, end: Point) -> Line | Spline:
    if segment.start == start and segment.end == end:
        return segment
    if isinstance(segment, Line):
        return Line(start, end)
    poles = segment.poles.copy()
    poles[0], poles[-1] = start, end
    return Spline(segment.degree, segment.knots, poles, segment.weights)


def _joined(segments: Sequence[Segment], source: str, tolerance_mm: float) -> list[Segment]:
    """The segments with every end at the start of the next, after checking that the gaps are within tolerance."""
    count = len(segments)
    following = [*segments[1:], segments[0]]
    gaps = [math.dist(a.end, b.start) for a, b in zip(segments, following, strict=True)]
    for i, gap in enumerate(gaps):
        if not gap <= tolerance_mm:
            raise OutlineError(
                f"{source}: the outline is open, with a gap of {gap:.6g} mm between the end of segment {i + 1} at "
                f"{point_text(segments[i].end)} and the start of segment {(i + 1) % count + 1} at "
                f"{point_text(following[i].start)}; gaps up to {tolerance_mm:g} mm are closed, so move the ends together"
            )
    if count == 1 and isinstance(segments[0], Arc):
        only = segments[0]
        return [Arc(only.centre, only.radius_mm, only.start_angle, math.copysign(FULL_TURN, only.sweep))]
    vertices: list[Point] = [
        (0.5 * (a.end[0] + b.start[0]), 0.5 * (a.end[1] + b.start[1])) for a, b in zip(segments, following, strict=True)
    ]
    # An arc that meets a line or a spline stays as it is and they move to it, so that no radius is touched without
    # need; where two arcs meet, both move.
    move = [
        gap > ROUNDING_MM and isinstance(a, Arc) and isinstance(b, Arc)
        for gap, a, b in zip(gaps, segments, following, strict=True)
    ]
    result = list(segments)
    for i, segment in enumerate(segments):
        if isinstance(segment, Arc) and (move[i - 1] or move[i]):
            result[i] = _arc_moved_to(
                segment, vertices[i - 1] if move[i - 1] else segment.start, vertices[i] if move[i] else segment.end
            )
    for i in range(count):
        here, after = result[i], result[(i + 1) % count]
        if isinstance(here, Arc):
            vertices[i] = here.end
        elif isinstance(after, Arc):
            vertices[i] = after.start
    joined: list[Segment] = []
    for i, segment in enumerate(result):
        if not isinstance(segment, Arc):
            segment = _with_ends(segment, vertices[i - 1], vertices[i])
        if not (isinstance(segment, Line) and segment.start == segment.end):
            joined.append(segment)
    return joined


def closed_outline(
    segments: Sequence[Segment], source: str, join_tolerance_mm: float = GENERATED_JOIN_TOLERANCE_MM
) -> Outline:
    """The outline made of segments in order, each starting where the one before ends.

    Gaps are closed: lines and splines are moved to the arcs they meet, or half-way to each other, and two arcs half-way to each
    other (keeping their sweep, beyond half a turn their middle point). A loop that runs clockwise is reversed.

    Parameters
    ----------
    segments : sequence of Line, Arc and Spline
        In mm.
    source : str
        The origin of the segments, for messages.
    join_tolerance_mm : float
        The widest gap that is closed.

    Raises
    ------
    OutlineError
        Naming the point and the numbers, where there is no segment, a gap is larger, the outline is not more than 1 mm and less
        than 1e5 mm along x and y, crosses, touches or folds back on itself (checked on a polygon with a chord tolerance of
        1e-4 mm), or encloses no area.
    """
    if not segments:
        raise OutlineError(f"{source}: the outline has no segments; draw one closed loop")
    joined = _joined(segments, source, join_tolerance_mm)
    if not joined:
        raise OutlineError(f"{source}: all segments of the outline have no length; draw one closed loop")
    boxes = np.array([segment.bounds() for segment in joined])
    width = float(boxes[:, 1].max() - boxes[:, 0].min())
    height = float(boxes[:, 3].max() - boxes[:, 2].min())
    for name, size in (("wide", width), ("high", height)):
        if not MINIMUM_SIZE_MM < size < MAXIMUM_SIZE_MM:
            raise OutlineError(
                f"{source}: the outline is {size:.6g} mm {name}, but must be more than {MINIMUM_SIZE_MM:g} mm and less "
                f"than {MAXIMUM_SIZE_MM:g} mm; check its units"
            )
    try:
        outline = Outline(tuple(joined))
    except OutlineError as error:
        raise OutlineError(f"{source}: {error}") from None
    check_simple(outline._polygon, source)
    area = outline.area_mm2()
    if abs(area) <= 1e-9 * width * height:
        raise OutlineError(
            f"{source}: the outline is {width:.6g} mm by {height:.6g} mm but encloses no area ({area:.3g} mm^2)"
        )
    if area < 0.0:
        outline = Outline(tuple(segment.reversed() for segment in reversed(joined)))
    return outline
