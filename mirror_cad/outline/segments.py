"""The segments of an outline: lines and circular arcs; splines have a module to themselves.

All segments have the same methods. They are exact; only `samples` works on straight edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mirror_cad.errors import OutlineError
from mirror_cad.outline.numbers import (
    FULL_TURN,
    LARGEST,
    MAXIMUM_EDGES,
    Bounds,
    FloatArray,
    Point,
    check_tolerance,
    finite_point,
    point_text,
)
from mirror_cad.outline.spline import Spline

__all__ = ["Arc", "Line", "Segment", "Spline", "arc_between"]


@dataclass(frozen=True, slots=True)
class Line:
    """The straight segment start + s (end - start), s in [0, 1].

    Attributes
    ----------
    start, end : tuple
        (x, y), mm.

    Raises
    ------
    OutlineError
        Where one of them is not two finite numbers.
    """

    start: Point
    end: Point

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", finite_point(self.start, "the start of a line"))
        object.__setattr__(self, "end", finite_point(self.end, "the end of a line"))

    def point(self, s: ArrayLike) -> FloatArray:
        """Points of the segment.

        Parameters
        ----------
        s : array_like
            In [0, 1], any shape.

        Returns
        -------
        ndarray
            (..., 2), mm.
        """
        fraction = np.asarray(s, dtype=float)[..., None]
        return (1.0 - fraction) * np.array(self.start) + fraction * np.array(self.end)

    def reversed(self) -> Line:
        """The same line from its end to its start."""
        return Line(self.end, self.start)

    def moved(self, dx: float, dy: float) -> Line:
        """The line moved by (dx, dy).

        Parameters
        ----------
        dx, dy : float
            mm.
        """
        return Line((self.start[0] + dx, self.start[1] + dy), (self.end[0] + dx, self.end[1] + dy))

    def mirrored(self) -> Line:
        """The line reflected in x = 0."""
        return Line((-self.start[0], self.start[1]), (-self.end[0], self.end[1]))

    def bounds(self) -> Bounds:
        """(x_min, x_max, y_min, y_max) in mm, exact."""
        (x0, y0), (x1, y1) = self.start, self.end
        return min(x0, x1), max(x0, x1), min(y0, y1), max(y0, y1)

    def samples(self, tolerance_mm: float) -> FloatArray:
        """The two end points; a line has no chord error.

        Parameters
        ----------
        tolerance_mm : float
            Above 0.

        Returns
        -------
        ndarray
            (2, 2), mm.

        Raises
        ------
        OutlineError
            Unless the tolerance is above 0.
        """
        check_tolerance(tolerance_mm)
        return np.array([self.start, self.end])

    def swept_area(self, about: Point = (0.0, 0.0)) -> float:
        """Signed area swept by the ray from a point, 1/2 of the integral of x dy - y dx, mm^2; exact.

        Parameters
        ----------
        about : tuple
            (x, y), mm.
        """
        x0, y0 = self.start[0] - about[0], self.start[1] - about[1]
        x1, y1 = self.end[0] - about[0], self.end[1] - about[1]
        return 0.5 * (x0 * y1 - x1 * y0)


@dataclass(frozen=True, slots=True)
class Arc:
    """The circular arc centre + radius (cos a, sin a) with a = start_angle + s sweep, s in [0, 1].

    Attributes
    ----------
    centre : tuple
        (x, y), mm.
    radius_mm : float
        Above 0.
    start_angle : float
        From +x towards +y, radians.
    sweep : float
        Radians, positive counter-clockwise, at most a full turn in either sense.

    Raises
    ------
    OutlineError
        For a number that is not finite, a radius that is not above 0 and a sweep that is 0 or more than a full turn.
    """

    centre: Point
    radius_mm: float
    start_angle: float
    sweep: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", finite_point(self.centre, "the centre of an arc"))
        for name in ("radius_mm", "start_angle", "sweep"):
            value = float(getattr(self, name))
            if not abs(value) <= LARGEST:
                raise OutlineError(
                    f"{name} of the arc about {point_text(self.centre)} is {value!r}: it must be finite, up to {LARGEST:g}"
                )
            object.__setattr__(self, name, value)
        if self.radius_mm <= 0.0:
            raise OutlineError(f"radius of the arc about {point_text(self.centre)} is {self.radius_mm!r} mm, not above 0")
        if self.sweep == 0.0 or abs(self.sweep) > FULL_TURN * (1.0 + 1e-12):
            raise OutlineError(
                f"sweep of the arc about {point_text(self.centre)} is {self.sweep!r} rad: it must not be 0 nor more than a "
                f"full turn ({FULL_TURN:.6f} rad)"
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
        return abs(self.sweep) >= FULL_TURN * (1.0 - 1e-15)

    def _at(self, angle: float) -> Point:
        return (
            self.centre[0] + self.radius_mm * math.cos(angle),
            self.centre[1] + self.radius_mm * math.sin(angle),
        )

    def point(self, s: ArrayLike) -> FloatArray:
        """Points of the segment.

        Parameters
        ----------
        s : array_like
            In [0, 1], any shape.

        Returns
        -------
        ndarray
            (..., 2), mm.
        """
        angle = self.start_angle + np.asarray(s, dtype=float) * self.sweep
        return np.array(self.centre) + self.radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def reversed(self) -> Arc:
        """The same arc from its end to its start."""
        return Arc(self.centre, self.radius_mm, self.start_angle + self.sweep, -self.sweep)

    def moved(self, dx: float, dy: float) -> Arc:
        """The arc moved by (dx, dy).

        Parameters
        ----------
        dx, dy : float
            mm.
        """
        return Arc((self.centre[0] + dx, self.centre[1] + dy), self.radius_mm, self.start_angle, self.sweep)

    def mirrored(self) -> Arc:
        """The arc reflected in x = 0."""
        return Arc((-self.centre[0], self.centre[1]), self.radius_mm, math.pi - self.start_angle, -self.sweep)

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
        """Points on the arc, both ends included: a chord over the angle d is r (1 - cos(d/2)) from the arc.

        Parameters
        ----------
        tolerance_mm : float
            No chord is farther from the arc.

        Returns
        -------
        ndarray
            (n, 2), mm.

        Raises
        ------
        OutlineError
            Unless the tolerance is above 0.
        """
        check_tolerance(tolerance_mm)
        # 1 - cos(d/2) = 2 sin^2(d/4), which keeps its digits for small tolerances.
        step = 4.0 * math.asin(math.sqrt(min(0.5 * tolerance_mm / self.radius_mm, 0.03)))
        count = math.ceil(abs(self.sweep) / step)
        if count > MAXIMUM_EDGES:
            raise OutlineError(
                f"the arc of radius {self.radius_mm:.6g} mm about {point_text(self.centre)} needs {count} edges at a chord "
                f"tolerance of {tolerance_mm:g} mm, more than {MAXIMUM_EDGES}; use a larger tolerance"
            )
        points = self.point(np.linspace(0.0, 1.0, count + 1))
        points[0], points[-1] = self.start, self.end
        return points

    def swept_area(self, about: Point = (0.0, 0.0)) -> float:
        """Signed area swept by the ray from a point, 1/2 of the integral of x dy - y dx, mm^2; closed form.

        Parameters
        ----------
        about : tuple
            (x, y), mm.
        """
        cx, cy = self.centre[0] - about[0], self.centre[1] - about[1]
        (x0, y0), (x1, y1) = self.start, self.end
        return 0.5 * (self.radius_mm**2 * self.sweep + cx * (y1 - y0) - cy * (x1 - x0))


Segment = Line | Arc | Spline


def arc_between(start: Point, end: Point, sweep: float) -> Arc:
    """The arc from `start` to `end` that turns through `sweep`.

    centre = (start + end)/2 + n |end - start| / (2 tan(sweep/2)), n being the chord direction turned left.

    Parameters
    ----------
    start, end : tuple
        (x, y), mm.
    sweep : float
        Radians, positive counter-clockwise.

    Raises
    ------
    OutlineError
        Where the ends coincide or `sweep` is not strictly between 0 and a full turn in either sense.
    """
    chord = math.dist(start, end)
    if chord == 0.0 or not 0.0 < abs(sweep) < FULL_TURN:
        raise OutlineError(
            f"no arc runs from {point_text(start)} to {point_text(end)} with a sweep of {sweep!r} rad: the ends must differ "
            "and the sweep must be between 0 and a full turn"
        )
    height = 0.5 / math.tan(0.5 * sweep)
    dx, dy = end[0] - start[0], end[1] - start[1]
    centre = (0.5 * (start[0] + end[0]) - dy * height, 0.5 * (start[1] + end[1]) + dx * height)
    radius = 0.5 * chord / abs(math.sin(0.5 * sweep))
    return Arc(centre, radius, math.atan2(start[1] - centre[1], start[0] - centre[0]), sweep)
