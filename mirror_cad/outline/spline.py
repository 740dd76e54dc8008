"""Degree, knots, poles and weights in, a clamped B-spline curve out, with its bounds, its samples and the area it sweeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mirror_cad.errors import OutlineError
from mirror_cad.outline.numbers import (
    LARGEST,
    MAXIMUM_EDGES,
    Bounds,
    FloatArray,
    Point,
    check_tolerance,
    point_text,
)

# Knots and weights more unequal than this overflow or lose all digits in what follows.
_CLOSEST = 1e-12
# The largest degree common CAD kernels take.
_MAXIMUM_DEGREE = 25


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
        if not ((np.abs(knots) <= LARGEST).all() and (np.abs(poles) <= LARGEST).all()):
            raise OutlineError(f"the spline has a knot or a pole that is not a finite number up to {LARGEST:g}")
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
        from scipy.interpolate import BSpline  # a fifth of a second, which a specification alone does not need

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
        check_tolerance(tolerance_mm)
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
                    f"the spline from {point_text(self.start)} to {point_text(self.end)} needs more than {MAXIMUM_EDGES} edges "
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
