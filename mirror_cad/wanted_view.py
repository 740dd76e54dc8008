"""Where the eye's ray through each point of the plane z = 0 is to go after the mirror: views that a surface is made for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.interpolate import NdBSpline

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

SMOOTH_DEGREE = 3  # of a table's interpolation: two continuous derivatives, as a surface's normals have at least


class Tangents(NamedTuple):
    """X = d_x/d_z and Y = d_y/d_z of the wanted direction, with their derivatives by x and y (1/mm); each of one shape."""

    x: Array
    y: Array
    x_by_x: Array
    x_by_y: Array
    y_by_x: Array
    y_by_y: Array


class WantedView(Protocol):
    """A direction for every point of the plane z = 0: (X, Y, 1) to unit length, z towards the driver."""

    def tangents(self, x: Array, y: Array) -> Tangents:
        """X and Y where the eye's ray crosses z = 0 at (x, y), mm, of one shape."""
        ...


@dataclass(frozen=True, slots=True)
class Line:
    """A linear function by its values at two places: what a perspective view is along each axis."""

    low: float
    high: float
    at_low: float
    at_high: float

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Compute the tangent or angle (n,) at places (n,), mm, and its slope, 1/mm."""
        slope = (self.at_high - self.at_low) / (self.high - self.low)
        return self.at_low + slope * (x - self.low), np.full_like(x, slope)


@dataclass(frozen=True, slots=True)
class EqualAngles:
    """The tangent of an angle that is linear in x."""

    angle: Line  # radians

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Compute the tangent or angle (n,) at places (n,), mm, and its slope, 1/mm."""
        angle, slope = self.angle(x)
        tangent = np.tan(angle)
        return tangent, slope * (1.0 + tangent**2)


@dataclass(frozen=True, eq=False)
class SplineAngle:
    """The tangent of an angle that is known at places x and smooth between; straight on beyond them.

    x (n,) mm, rising.   angle (n,) radians.
    """

    x: Array
    angle: Array

    @cached_property
    def _spline(self) -> NdBSpline:
        from scipy.interpolate import make_interp_spline

        found = make_interp_spline(self.x, self.angle, k=min(SMOOTH_DEGREE, len(self.x) - 1))
        return found

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Compute the tangent or angle (n,) at places (n,), mm, and its slope, 1/mm."""
        inside = np.clip(x, self.x[0], self.x[-1])
        slope = self._spline(inside, 1)
        tangent = np.tan(self._spline(inside) + slope * (x - inside))
        return tangent, slope * (1.0 + tangent**2)


@dataclass(frozen=True, slots=True, eq=False)
class StraightVerticals:
    """X a function of x and Y one of y: every vertical line of the world stays one in the mirror's frame.

    With both linear it is a perspective view, in which every straight line stays straight.
    """

    across: Line | EqualAngles | SplineAngle
    upright: Line | EqualAngles | SplineAngle

    def tangents(self, x: Array, y: Array) -> Tangents:
        """Compute the ray that leaves at (x, y), mm, and how it turns over the mirror."""
        across, by_x = self.across(x)
        upright, by_y = self.upright(y)
        none = np.zeros_like(across)
        return Tangents(across, upright, by_x, none, none, by_y)


@dataclass(frozen=True, eq=False)
class TableView:
    """Azimuth and elevation at the nodes of a grid, smooth between and straight on beyond.

    Beyond, with (x₀, y₀) the nearest place of the grid: S + S_x·(x − x₀) + S_y·(y − y₀) + S_xy·(x − x₀)(y − y₀), which has no
    crease anywhere.

    x (m,), y (n,) mm, rising.   azimuth, elevation (m, n) radians.
    """

    x: Array
    y: Array
    azimuth: Array
    elevation: Array

    @cached_property
    def _splines(self) -> NdBSpline:
        from scipy.interpolate import NdBSpline, make_interp_spline

        degrees = [min(SMOOTH_DEGREE, len(axis) - 1) for axis in (self.x, self.y)]
        along = make_interp_spline(self.x, np.stack([self.azimuth, self.elevation], axis=-1), k=degrees[0], axis=0)
        both = make_interp_spline(self.y, along.c, k=degrees[1], axis=1)
        return NdBSpline((along.t, both.t), np.moveaxis(both.c, 0, 1), tuple(degrees))

    def tangents(self, x: Array, y: Array) -> Tangents:
        """Compute the ray that leaves at (x, y), mm, and how it turns over the mirror."""
        inside_x, inside_y = np.clip(x, self.x[0], self.x[-1]), np.clip(y, self.y[0], self.y[-1])
        at = np.stack([inside_x, inside_y], axis=-1)
        spline = self._splines
        beyond_x, beyond_y = (x - inside_x)[..., None], (y - inside_y)[..., None]
        slope_x, slope_y, twist = spline(at, nu=(1, 0)), spline(at, nu=(0, 1)), spline(at, nu=(1, 1))
        by_x, by_y = slope_x + twist * beyond_y, slope_y + twist * beyond_x
        angle = spline(at) + slope_x * beyond_x + by_y * beyond_y
        tangent = np.tan(angle)
        stretch = 1.0 + tangent**2
        by_x, by_y = by_x * stretch, by_y * stretch
        return Tangents(tangent[..., 0], tangent[..., 1], by_x[..., 0], by_y[..., 0], by_x[..., 1], by_y[..., 1])


@dataclass(frozen=True, eq=False)
class WeightMap:
    """How much each place of a mirror counts: known at the nodes of a grid, linear between them, held at its ends beyond.

    x (m,), y (n,) mm, rising.   weight (m, n), none below 0; only their ratios matter.
    """

    x: Array
    y: Array
    weight: Array

    def __call__(self, x: Array, y: Array) -> Array:
        """Compute the weight at places (…), mm, of one shape."""
        from scipy.interpolate import RegularGridInterpolator

        at = np.stack([np.clip(x, self.x[0], self.x[-1]), np.clip(y, self.y[0], self.y[-1])], axis=-1)
        found: Array = RegularGridInterpolator((self.x, self.y), self.weight)(at)
        return found


def wanted_directions(view: WantedView, x: Array, y: Array) -> Array:
    """Compute the wanted unit directions where eye rays cross z = 0 at (x, y).

    Parameters
    ----------
    view : WantedView
    x, y : ndarray
        (…) mm.

    Returns
    -------
    ndarray
        (…, 3).
    """
    found = view.tangents(x, y)
    direction = np.stack([found.x, found.y, np.ones_like(found.x)], axis=-1)
    return direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def on_plane(eye: Array, points: Array) -> tuple[Array, Array]:
    """Compute where rays from an eye through points cross the plane z = 0.

    Parameters
    ----------
    eye : ndarray
        (3,) mm, z above the points.
    points : ndarray
        (…, 3) mm.

    Returns
    -------
    x, y : ndarray
        (…) mm.
    """
    share = eye[2] / (eye[2] - points[..., 2])
    return eye[0] + (points[..., 0] - eye[0]) * share, eye[1] + (points[..., 1] - eye[1]) * share
