"""The outline of a mirror: one closed plane curve made of lines, circular arcs and B-splines.

Coordinates are mirror coordinates in millimetres, x to the right and y up as one looks at the reflecting face. An
`Outline` runs counter-clockwise. Segments are exact; only `Outline.polyline` and `Outline.contains` work on straight
edges, and both state how far those may lie from the curve.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline

from mirror_cad.errors import OutlineError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Point = tuple[float, float]
Bounds = tuple[float, float, float, float]

GENERATED_JOIN_TOLERANCE_MM = 1e-6
"""Largest gap between consecutive segments that were computed rather than read from a file."""

CONTAINS_TOLERANCE_MM = 1e-4
"""Chord tolerance of the polygon behind `Outline.contains` and the self-intersection check."""

MINIMUM_SIZE_MM = 1.0
"""An outline must be larger than this both across and upwards: smaller means wrong units or a stray piece."""

MAXIMUM_SIZE_MM = 1e5
"""An outline must be smaller than this both across and upwards: larger means wrong units."""

SMALLEST_RADIUS_MM = 1e-2
"""Smallest corner radius of a generated outline: smaller arcs are of the size that files and kernels join away."""

MAXIMUM_EDGES = 300_000
"""Most straight edges one outline may be broken into, so that a malformed one cannot exhaust the memory."""

_MAXIMUM_PAIRS = 4_000_000
_FULL_TURN = 2.0 * math.pi
# Numbers larger than this, and knots and weights more unequal, overflow or lose all digits in what follows.
_LARGEST = 1e12
_CLOSEST = 1e-12
# The largest degree common CAD kernels take.
_MAXIMUM_DEGREE = 25
# A joint of two arcs closer than this is rounding; moving the arcs to close it would only add rounding of its own.
_ROUNDING_MM = 1e-9


def _text(point: Sequence[float]) -> str:
    return f"({point[0]:.6g}, {point[1]:.6g}) mm"


def _finite_point(value: ArrayLike, what: str) -> Point:
    array = np.asarray(value, dtype=float)
    if array.shape != (2,) or not (np.abs(array) <= _LARGEST).all():
        raise OutlineError(f"{what} is {value!r}: it must be two finite numbers up to {_LARGEST:g}, x and y in mm")
    return float(array[0]), float(array[1])


def _check_tolerance(tolerance_mm: float) -> None:
    if not (math.isfinite(tolerance_mm) and tolerance_mm > 0.0):
        raise OutlineError(f"chord tolerance is {tolerance_mm!r} mm: it must be a finite number above 0")


@dataclass(frozen=True, slots=True)
class Line:
    """The straight segment start + s (end - start), s in [0, 1].

    `start` and `end` are (x, y) in mm. Raises `OutlineError` where one of them is not two finite numbers.
    """

    start: Point
    end: Point

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", _finite_point(self.start, "the start of a line"))
        object.__setattr__(self, "end", _finite_point(self.end, "the end of a line"))

    def point(self, s: ArrayLike) -> FloatArray:
        """Points (..., 2) in mm at the parameters `s` (...) in [0, 1]."""
        fraction = np.asarray(s, dtype=float)[..., None]
        return (1.0 - fraction) * np.array(self.start) + fraction * np.array(self.end)

    def reversed(self) -> Line:
        """The same line from its end to its start."""
        return Line(self.end, self.start)

    def moved(self, dx: float, dy: float) -> Line:
        """The line moved by (dx, dy) mm."""
        return Line((self.start[0] + dx, self.start[1] + dy), (self.end[0] + dx, self.end[1] + dy))

    def bounds(self) -> Bounds:
        """(x_min, x_max, y_min, y_max) in mm, exact."""
        (x0, y0), (x1, y1) = self.start, self.end
        return min(x0, x1), max(x0, x1), min(y0, y1), max(y0, y1)

    def samples(self, tolerance_mm: float) -> FloatArray:
        """The two end points (2, 2) in mm; a line has no chord error. Raises `OutlineError` unless tolerance > 0."""
        _check_tolerance(tolerance_mm)
        return np.array([self.start, self.end])

    def swept_area(self, about: Point = (0.0, 0.0)) -> float:
        """Signed area in mm^2 swept by the ray from `about`, 1/2 of the integral of x dy - y dx; exact."""
        x0, y0 = self.start[0] - about[0], self.start[1] - about[1]
        x1, y1 = self.end[0] - about[0], self.end[1] - about[1]
        return 0.5 * (x0 * y1 - x1 * y0)


@dataclass(frozen=True, slots=True)
class Arc:
    """The circular arc centre + radius (cos a, sin a) with a = start_angle + s sweep, s in [0, 1].

    `centre` is (x, y) and `radius_mm` is in mm; the angles are in radians from +x towards +y. `sweep` is positive
    counter-clockwise and at most a full turn either way. Raises `OutlineError` for a number that is not finite, a
    radius that is not above 0 and a sweep that is 0 or more than a full turn.
    """

    centre: Point
    radius_mm: float
    start_angle: float
    sweep: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", _finite_point(self.centre, "the centre of an arc"))
        for name in ("radius_mm", "start_angle", "sweep"):
            value = float(getattr(self, name))
            if not abs(value) <= _LARGEST:
                raise OutlineError(
                    f"{name} of the arc about {_text(self.centre)} is {value!r}: it must be finite, up to {_LARGEST:g}"
                )
            object.__setattr__(self, name, value)
        if self.radius_mm <= 0.0:
            raise OutlineError(f"radius of the arc about {_text(self.centre)} is {self.radius_mm!r} mm, not above 0")
        if self.sweep == 0.0 or abs(self.sweep) > _FULL_TURN * (1.0 + 1e-12):
            raise OutlineError(
                f"sweep of the arc about {_text(self.centre)} is {self.sweep!r} rad: it must not be 0 nor more than a "
                f"full turn ({_FULL_TURN:.6f} rad)"
            )

    @property
    def start(self) -> Point:
        """First point (x, y) in mm."""
        return self._at(self.start_angle)

    @property
    def end(self) -> Point:
        """Last point (x, y) in mm; of a full circle bit for bit the first."""
        return self.start if self.is_full_circle else self._at(self.start_angle + self.sweep)

    @property
    def is_full_circle(self) -> bool:
        """Whether the arc closes on itself."""
        return abs(self.sweep) >= _FULL_TURN * (1.0 - 1e-15)

    def _at(self, angle: float) -> Point:
        return (
            self.centre[0] + self.radius_mm * math.cos(angle),
            self.centre[1] + self.radius_mm * math.sin(angle),
        )

    def point(self, s: ArrayLike) -> FloatArray:
        """Points (..., 2) in mm at the parameters `s` (...) in [0, 1]."""
        angle = self.start_angle + np.asarray(s, dtype=float) * self.sweep
        return np.array(self.centre) + self.radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def reversed(self) -> Arc:
        """The same arc from its end to its start."""
        return Arc(self.centre, self.radius_mm, self.start_angle + self.sweep, -self.sweep)

    def moved(self, dx: float, dy: float) -> Arc:
        """The arc moved by (dx, dy) mm."""
        return Arc((self.centre[0] + dx, self.centre[1] + dy), self.radius_mm, self.start_angle, self.sweep)

    def bounds(self) -> Bounds:
        """(x_min, x_max, y_min, y_max) in mm, exact: the ends and the quadrant points the arc passes."""
        low = min(self.start_angle, self.start_angle + self.sweep)
        high = max(self.start_angle, self.start_angle + self.sweep)
        xs, ys = map(list, zip(self.start, self.end, strict=True))
        quarter = 0.5 * math.pi
        for turn in range(math.ceil(low / quarter), math.floor(high / quarter) + 1):
            # The quadrant point itself, not its cosine: centre + radius is what a caller would compute.
            unit = ((1, 0), (0, 1), (-1, 0), (0, -1))[turn % 4]
            xs.append(self.centre[0] + unit[0] * self.radius_mm)
            ys.append(self.centre[1] + unit[1] * self.radius_mm)
        return min(xs), max(xs), min(ys), max(ys)

    def samples(self, tolerance_mm: float) -> FloatArray:
        """Points (n, 2) in mm on the arc, both ends included, no chord farther than `tolerance_mm` from it.

        A chord over the angle d is r (1 - cos(d/2)) from the arc. Raises `OutlineError` unless tolerance > 0.
        """
        _check_tolerance(tolerance_mm)
        # 1 - cos(d/2) = 2 sin^2(d/4), which keeps its digits for small tolerances.
        step = 4.0 * math.asin(math.sqrt(min(0.5 * tolerance_mm / self.radius_mm, 0.03)))
        count = math.ceil(abs(self.sweep) / step)
        if count > MAXIMUM_EDGES:
            raise OutlineError(
                f"the arc of radius {self.radius_mm:.6g} mm about {_text(self.centre)} needs {count} edges at a chord "
                f"tolerance of {tolerance_mm:g} mm, more than {MAXIMUM_EDGES}; use a larger tolerance"
            )
        points = self.point(np.linspace(0.0, 1.0, count + 1))
        points[0], points[-1] = self.start, self.end
        return points

    def swept_area(self, about: Point = (0.0, 0.0)) -> float:
        """Signed area in mm^2 swept by the ray from `about`, 1/2 of the integral of x dy - y dx; closed form."""
        cx, cy = self.centre[0] - about[0], self.centre[1] - about[1]
        (x0, y0), (x1, y1) = self.start, self.end
        return 0.5 * (self.radius_mm**2 * self.sweep + cx * (y1 - y0) - cy * (x1 - x0))


@dataclass(frozen=True, slots=True, eq=False)
class Spline:
    """The clamped B-spline sum N_i(t) w_i P_i / sum N_i(t) w_i, t running over the knot range as s does over [0, 1].

    degree:  p, from 1 to 25.
    knots:   (n + p + 1,), never decreasing, written out with repetition; the first and the last p + 1 are equal and no
             inner knot is repeated more than p times (the curve is continuous). Knots that differ do so by at least
             1e-12 of the range, which is at least 1e-12.
    poles:   P, (n, 2) in mm, n >= p + 1; the curve starts at the first pole and ends at the last.
    weights: w, (n,), all above 0, the smallest at least 1e-12 of the largest; None for a polynomial spline (all 1).

    Numbers are at most 1e12 in size. The arrays are copied and made read-only. Raises `OutlineError` where one of these
    conditions does not hold.
    """

    degree: int
    knots: FloatArray
    poles: FloatArray
    weights: FloatArray | None = None

    def __post_init__(self) -> None:
        p = self.degree
        knots, poles = np.array(self.knots, dtype=float), np.array(self.poles, dtype=float)
        if int(p) != p or not 1 <= p <= _MAXIMUM_DEGREE:
            raise OutlineError(f"degree of the spline is {p!r}: it must be a whole number from 1 to {_MAXIMUM_DEGREE}")
        if poles.ndim != 2 or poles.shape[1] != 2 or len(poles) < p + 1:
            raise OutlineError(
                f"poles of the spline have shape {poles.shape}: (n, 2) with n >= {p + 1} is needed for degree {p}"
            )
        if knots.shape != (len(poles) + p + 1,):
            raise OutlineError(
                f"the spline has {knots.size} knots: {len(poles)} poles of degree {p} need {len(poles) + p + 1}"
            )
        if not ((np.abs(knots) <= _LARGEST).all() and (np.abs(poles) <= _LARGEST).all()):
            raise OutlineError(f"the spline has a knot or a pole that is not a finite number up to {_LARGEST:g}")
        steps, extent = np.diff(knots), knots[-1] - knots[0]
        if (steps < 0.0).any() or extent < _CLOSEST:
            raise OutlineError(f"knots of the spline must never decrease and must span at least {_CLOSEST:g}")
        if (steps[steps > 0.0] < _CLOSEST * extent).any():
            raise OutlineError(f"knots of the spline that differ must do so by {_CLOSEST:g} of their range or more")
        if knots[0] != knots[p] or knots[-1] != knots[-p - 1]:
            raise OutlineError(f"the spline is not clamped: its first and last {p + 1} knots must be equal")
        if (knots[p + 1 : -1] <= knots[1 : -p - 1]).any():
            raise OutlineError(
                f"the spline is broken: an inner knot is repeated more than {p} times, or an end knot more than {p + 1}"
            )
        weights = None if self.weights is None else np.array(self.weights, dtype=float)
        if weights is not None:
            if weights.shape != (len(poles),) or not (np.isfinite(weights) & (weights > 0.0)).all():
                raise OutlineError(f"weights of the spline must be {len(poles)} finite numbers above 0, one a pole")
            if weights.min() < _CLOSEST * weights.max():
                raise OutlineError(
                    f"weights of the spline range from {weights.min():g} to {weights.max():g}: they must not differ by "
                    f"more than a factor of {1.0 / _CLOSEST:g}"
                )
            weights.flags.writeable = False
        knots.flags.writeable = poles.flags.writeable = False
        object.__setattr__(self, "degree", int(p))
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "poles", poles)
        object.__setattr__(self, "weights", weights)

    @property
    def start(self) -> Point:
        """First pole (x, y) in mm."""
        return float(self.poles[0, 0]), float(self.poles[0, 1])

    @property
    def end(self) -> Point:
        """Last pole (x, y) in mm."""
        return float(self.poles[-1, 0]), float(self.poles[-1, 1])

    def _homogeneous(self, about: Point = (0.0, 0.0)) -> Any:
        """The spline (x w, y w, w), with coordinates counted from `about`."""
        weights = np.ones(len(self.poles)) if self.weights is None else self.weights / self.weights.max()
        columns = np.column_stack([(self.poles - np.array(about)) * weights[:, None], weights])
        return BSpline(self.knots, columns, self.degree)

    def point(self, s: ArrayLike) -> FloatArray:
        """Points (..., 2) in mm at the parameters `s` (...) in [0, 1]."""
        fraction = np.asarray(s, dtype=float)
        values = self._homogeneous()((1.0 - fraction) * self.knots[0] + fraction * self.knots[-1])
        return np.asarray(values[..., :2] / values[..., 2:])

    def reversed(self) -> Spline:
        """The same curve from its end to its start, over the same knot range."""
        knots = (self.knots[0] + self.knots[-1]) - self.knots[::-1]
        # The difference rounds; the repeated end knots must stay equal bit for bit.
        knots[: self.degree + 1], knots[-self.degree - 1 :] = self.knots[0], self.knots[-1]
        return Spline(self.degree, knots, self.poles[::-1], None if self.weights is None else self.weights[::-1])

    def moved(self, dx: float, dy: float) -> Spline:
        """The spline moved by (dx, dy) mm."""
        return Spline(self.degree, self.knots, self.poles + np.array([dx, dy]), self.weights)

    def bounds(self) -> Bounds:
        """(x_min, x_max, y_min, y_max) in mm, exact: the ends of every span and the extrema inside it.

        With the curve (X/W, Y/W) on a span, x is extremal where X' W - X W' = 0, a polynomial whose roots are found.
        """
        curve, breaks = self._homogeneous(), np.unique(self.knots)
        # Each span over u in [-1, 1], as the polynomial through its values at the Chebyshev points.
        nodes = np.cos(np.pi * (np.arange(self.degree + 1) + 0.5) / (self.degree + 1))
        middle, half = 0.5 * (breaks[1:] + breaks[:-1]), 0.5 * np.diff(breaks)
        pieces = np.linalg.solve(np.vander(nodes), curve(middle[:, None] + half[:, None] * nodes))
        at = [breaks]
        for (x, y, w), centre, width in zip(np.moveaxis(pieces, 1, 2), middle, half, strict=True):
            for coordinate in (x, y):
                slope = np.polysub(np.polymul(np.polyder(coordinate), w), np.polymul(coordinate, np.polyder(w)))
                # Rounding instead of a leading zero would put roots far out and cost the others their digits.
                slope[np.abs(slope) < 1e-15 * np.abs(slope).max()] = 0.0
                # Every root, complex ones too: a point too many is still a point of the curve and does no harm, while
                # a double root split into a complex pair by rounding would be missed.
                at.append(centre + width * np.clip(np.roots(slope).real, -1.0, 1.0))
        value = curve(np.concatenate(at))
        values = [self.poles[[0, -1]], value[:, :2] / value[:, 2:]]
        points = np.concatenate(values)
        (x_min, y_min), (x_max, y_max) = points.min(axis=0), points.max(axis=0)
        return float(x_min), float(x_max), float(y_min), float(y_max)

    def samples(self, tolerance_mm: float) -> FloatArray:
        """Points (n, 2) in mm on the curve, both ends included, no chord farther than `tolerance_mm` from it.

        Every knot span starts as p + 1 intervals; an interval is halved while the curve at one of seven points inside
        it is farther than 0.9 of the tolerance from the chord. Raises `OutlineError` unless tolerance > 0.
        """
        _check_tolerance(tolerance_mm)
        curve = self._homogeneous()

        def at(t: FloatArray) -> FloatArray:
            values = curve(t)
            return np.asarray(values[..., :2] / values[..., 2:])

        breaks = np.unique(self.knots)
        inner = breaks[:-1, None] + np.diff(breaks)[:, None] * (np.arange(self.degree + 1) / (self.degree + 1))
        t = np.append(inner.ravel(), breaks[-1])
        found = [t]
        low, high = t[:-1], t[1:]
        total = len(t)
        while len(low):
            points = at(low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, 9))
            chord = points[:, -1] - points[:, 0]
            offset = points[:, 1:-1] - points[:, :1]
            square = np.maximum((chord**2).sum(axis=-1), np.finfo(float).tiny)
            along = np.clip((offset * chord[:, None]).sum(axis=-1) / square[:, None], 0.0, 1.0)
            distance = np.linalg.norm(offset - along[..., None] * chord[:, None], axis=-1)
            # The curve may be a little farther away between the points looked at.
            far = distance.max(axis=1) > 0.9 * tolerance_mm
            middle = 0.5 * (low[far] + high[far])
            total += len(middle)
            if total > MAXIMUM_EDGES:
                raise OutlineError(
                    f"the spline from {_text(self.start)} to {_text(self.end)} needs more than {MAXIMUM_EDGES} edges "
                    f"at a chord tolerance of {tolerance_mm:g} mm; use a larger tolerance"
                )
            found.append(middle)
            low, high = np.concatenate([low[far], middle]), np.concatenate([middle, high[far]])
        result = at(np.sort(np.concatenate(found)))
        result[0], result[-1] = self.start, self.end
        return result

    def swept_area(self, about: Point = (0.0, 0.0)) -> float:
        """Signed area in mm^2 swept by the ray from `about`, 1/2 of the integral of x dy - y dx.

        Gauss-Legendre on every knot span: with p points exact for a polynomial spline of degree p; with 40 points for
        a rational one, where the integrand is (X Y' - Y X') / W^2.
        """
        curve = self._homogeneous(about)
        node, weight = np.polynomial.legendre.leggauss(self.degree if self.weights is None else 40)
        breaks = np.unique(self.knots)
        half = 0.5 * np.diff(breaks)
        t = 0.5 * (breaks[:-1] + breaks[1:])[:, None] + half[:, None] * node
        value, slope = curve(t), curve(t, nu=1)
        integrand = (value[..., 0] * slope[..., 1] - value[..., 1] * slope[..., 0]) / value[..., 2] ** 2
        return 0.5 * float((integrand * weight * half[:, None]).sum())


Segment = Line | Arc | Spline


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
        """Vertices (n, 2) in mm of a counter-clockwise polygon on the outline; the first one is not repeated.

        Every segment end is a vertex, and no edge is farther than `tolerance_mm` from the curve it replaces. Raises
        `OutlineError` unless tolerance > 0, and where more than `MAXIMUM_EDGES` edges would be needed.
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
        """Whether the points (x, y) in mm lie inside; `x` and `y` broadcast, the result has their common shape.

        Decided on the polygon with a chord tolerance of 1e-4 mm (`CONTAINS_TOLERANCE_MM`): a point nearer the outline
        than that may fall either way, one farther away never does. Points that are not finite are outside. The cost
        is a sort of the points by y plus, for every edge, a comparison with the points at its height.
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


def arc_between(start: Point, end: Point, sweep: float) -> Arc:
    """The arc from `start` to `end` (mm) that turns through `sweep` radians, positive counter-clockwise.

    centre = (start + end)/2 + n |end - start| / (2 tan(sweep/2)), n being the chord direction turned left. Raises
    `OutlineError` where the ends coincide or `sweep` is not strictly between 0 and a full turn either way.
    """
    chord = math.dist(start, end)
    if chord == 0.0 or not 0.0 < abs(sweep) < _FULL_TURN:
        raise OutlineError(
            f"no arc runs from {_text(start)} to {_text(end)} with a sweep of {sweep!r} rad: the ends must differ and "
            "the sweep must be between 0 and a full turn"
        )
    height = 0.5 / math.tan(0.5 * sweep)
    dx, dy = end[0] - start[0], end[1] - start[1]
    centre = (0.5 * (start[0] + end[0]) - dy * height, 0.5 * (start[1] + end[1]) + dx * height)
    radius = 0.5 * chord / abs(math.sin(0.5 * sweep))
    return Arc(centre, radius, math.atan2(start[1] - centre[1], start[0] - centre[0]), sweep)


def _arc_moved_to(arc: Arc, start: Point, end: Point) -> Arc:
    """`arc` with its ends moved by less than a join tolerance to `start` and `end`."""
    if abs(arc.sweep) <= math.pi:
        return arc_between(start, end, arc.sweep)
    # Beyond half a turn the chord says little about the radius; the sweep then follows from keeping the middle point,
    # the chord seen from it being half the arc that is left.
    middle = arc.point(0.5)
    to_start, to_end = np.array(start) - middle, np.array(end) - middle
    inscribed = math.atan2(abs(to_start[0] * to_end[1] - to_start[1] * to_end[0]), float(to_start @ to_end))
    return arc_between(start, end, math.copysign(_FULL_TURN - 2.0 * inscribed, arc.sweep))


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
                f"{_text(segments[i].end)} and the start of segment {(i + 1) % count + 1} at "
                f"{_text(following[i].start)}; gaps up to {tolerance_mm:g} mm are closed, so move the ends together"
            )
    if count == 1 and isinstance(segments[0], Arc):
        only = segments[0]
        return [Arc(only.centre, only.radius_mm, only.start_angle, math.copysign(_FULL_TURN, only.sweep))]
    joints: list[Point] = [
        (0.5 * (a.end[0] + b.start[0]), 0.5 * (a.end[1] + b.start[1])) for a, b in zip(segments, following, strict=True)
    ]
    # An arc that meets a line or a spline stays as it is and they move to it, so that no radius is touched without
    # need; where two arcs meet, both move.
    move = [
        gap > _ROUNDING_MM and isinstance(a, Arc) and isinstance(b, Arc)
        for gap, a, b in zip(gaps, segments, following, strict=True)
    ]
    result = list(segments)
    for i, segment in enumerate(segments):
        if isinstance(segment, Arc) and (move[i - 1] or move[i]):
            result[i] = _arc_moved_to(
                segment, joints[i - 1] if move[i - 1] else segment.start, joints[i] if move[i] else segment.end
            )
    for i in range(count):
        here, after = result[i], result[(i + 1) % count]
        if isinstance(here, Arc):
            joints[i] = here.end
        elif isinstance(after, Arc):
            joints[i] = after.start
    joined: list[Segment] = []
    for i, segment in enumerate(result):
        if not isinstance(segment, Arc):
            segment = _with_ends(segment, joints[i - 1], joints[i])
        if not (isinstance(segment, Line) and segment.start == segment.end):
            joined.append(segment)
    return joined


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _check_simple(polygon: FloatArray, source: str) -> None:
    """Raise `OutlineError` where a closed polygon (n, 2) crosses, touches or folds back on itself."""
    origin = polygon[0]
    start = polygon - origin
    end = np.roll(start, -1, axis=0)
    direction, after = end - start, np.roll(end - start, -1, axis=0)
    size = np.hypot(*direction.T) * np.hypot(*after.T)
    fold = (np.abs(_cross(direction, after)) <= 1e-12 * size) & ((direction * after).sum(axis=1) < 0.0)
    if fold.any():
        where = end[np.argmax(fold)] + origin
        raise OutlineError(f"{source}: the outline folds straight back on itself at {_text(where)}; remove the spike")

    # Boxes around runs of 1, 2, 4, ... edges; pairs of runs whose boxes overlap are split until single edges are left.
    levels = [(np.minimum(start, end), np.maximum(start, end))]
    while len(levels[-1][0]) > 1:
        lower, upper = levels[-1]
        if len(lower) % 2:
            lower, upper = np.concatenate([lower, lower[-1:]]), np.concatenate([upper, upper[-1:]])
        levels.append((np.minimum(lower[::2], lower[1::2]), np.maximum(upper[::2], upper[1::2])))
    first = second = np.zeros(1, dtype=np.intp)
    for lower, upper in reversed(levels[:-1]):
        first, second = (
            np.concatenate([2 * first, 2 * first, 2 * first + 1, 2 * first + 1]),
            np.concatenate([2 * second, 2 * second + 1, 2 * second, 2 * second + 1]),
        )
        keep = (first <= second) & (second < len(lower))
        first, second = first[keep], second[keep]
        keep = ((lower[first] <= upper[second]) & (lower[second] <= upper[first])).all(axis=1)
        first, second = first[keep], second[keep]
        if len(first) > _MAXIMUM_PAIRS:
            raise OutlineError(
                f"{source}: the outline is too tangled to check for self-intersection ({len(first)} pairs of its "
                f"{len(start)} edges lie in overlapping boxes); use a simpler outline"
            )
    apart = (second - first > 1) & ~((first == 0) & (second == len(start) - 1))
    first, second = first[apart], second[apart]
    a, b, c, d = start[first], end[first], start[second], end[second]
    # Sides of each edge's line the other edge's ends are on; 0 is touching, and the boxes overlap already.
    c_side, d_side = np.sign(_cross(b - a, c - a)), np.sign(_cross(b - a, d - a))
    a_side, b_side = np.sign(_cross(d - c, a - c)), np.sign(_cross(d - c, b - c))
    hits = np.flatnonzero((c_side * d_side <= 0) & (a_side * b_side <= 0))
    if len(hits):
        hit = hits[np.lexsort((second[hits], first[hits]))[0]]
        along = _cross(b - a, d - c)[hit]
        where = c[hit]
        if along != 0.0:
            where = a[hit] + (b - a)[hit] * (_cross(c - a, d - c)[hit] / along)
        raise OutlineError(
            f"{source}: the outline crosses or touches itself at {_text(where + origin)}; it must be a single simple "
            "loop, so trim the pieces there"
        )


def closed_outline(
    segments: Sequence[Segment], source: str, join_tolerance_mm: float = GENERATED_JOIN_TOLERANCE_MM
) -> Outline:
    """The outline made of `segments`, which must be in order, each starting where the one before ends.

    Gaps up to `join_tolerance_mm` are closed: lines and splines are moved to the arcs they meet, or half-way to each
    other, and two arcs half-way to each other (keeping their sweep, beyond half a turn their middle point). A loop
    that runs clockwise is reversed. `source` names the origin of the segments in messages.

    Raises `OutlineError`, naming the place and the numbers, where there is no segment, a gap is larger, the outline
    is not more than 1 mm and less than 1e5 mm both ways, crosses, touches or folds back on itself (checked on a
    polygon with a chord tolerance of 1e-4 mm), or encloses no area.
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
    _check_simple(outline._polygon, source)
    area = outline.area_mm2()
    if abs(area) <= 1e-9 * width * height:
        raise OutlineError(
            f"{source}: the outline is {width:.6g} mm by {height:.6g} mm but encloses no area ({area:.3g} mm^2)"
        )
    if area < 0.0:
        outline = Outline(tuple(segment.reversed() for segment in reversed(joined)))
    return outline


def truck_outline(width_mm: float, left_height_mm: float, right_height_mm: float, corner_radius_mm: float) -> Outline:
    """The rounded outline of a truck mirror, symmetric about y = 0.

    The quadrilateral has the corners (-width/2, +-left/2) and (+width/2, +-right/2); each is replaced by the arc of
    `corner_radius_mm` tangent to both its sides, which takes r / tan(angle/2) off either side. With radius 0 the
    corners stay sharp. Sides used up by their arcs are left out.

    All in mm. Raises `OutlineError` for a size that is not a finite number above 0, a radius below 0.01 other than 0,
    and a radius that does not fit, naming the corners and the largest radius that does.
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
        if math.dist(side.start, side.end) > _ROUNDING_MM:
            segments.append(side)
    return closed_outline(segments, source)
