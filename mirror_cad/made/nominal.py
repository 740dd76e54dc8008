"""The surface that a made mirror is compared with, as heights over (x, y) inside an outline."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SurfaceError
from mirror_cad.outline import Outline
from mirror_cad.sections import SagDerivatives
from mirror_cad.surfaces.bspline import BSplineSurface

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

RIM_CHORD_MM = 0.01  # far below what a footprint is placed to
FOOT_SETTLED = 1e-16  # of the size squared: 1.6e-11 mm² leave 1e-14 mm of a distance
FOOT_STEPS = 4  # of the foot of a perpendicular: each leaves (distance·curvature) of the error


class Feet(NamedTuple):
    """Perpendiculars to a surface: signed distances (n,) mm, positive in front, and unit normals (n, 3) at their feet."""

    distance: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class Nominal:
    """A height field z(x, y) and the outline that it is cut to, in mirror coordinates.

    Attributes
    ----------
    surface : BSplineSurface
        u = x, v = y, mm.
    outline : Outline
        Closed, mm.
    """

    surface: BSplineSurface
    outline: Outline

    def __post_init__(self) -> None:
        if not self.surface.is_height_field:
            raise SurfaceError("a measured mirror is compared with heights over (x, y), and this surface has none")

    @cached_property
    def box(self) -> Box:
        """(x_min, x_max, y_min, y_max) of the outline, mm."""
        return self.outline.bounding_box()

    @cached_property
    def rim(self) -> Array:
        """A polygon (m, 2) on the outline, mm."""
        return self.outline.polyline(RIM_CHORD_MM)

    @property
    def size_mm(self) -> float:
        """The diagonal of the outline's box."""
        return float(np.hypot(self.box[1] - self.box[0], self.box[3] - self.box[2]))

    def outside_by(self, x: Array, y: Array) -> tuple[Array, Array]:
        """How far points lie outside the outline.

        Parameters
        ----------
        x, y : ndarray
            (n,), mm.

        Returns
        -------
        distance : ndarray
            (n,), mm, 0 inside.
        outwards : ndarray
            (n, 2), unit, from the nearest point of the outline; zero inside.
        """
        distance, outwards = np.zeros(x.size), np.zeros((x.size, 2))
        beyond = np.flatnonzero(~self.outline.contains(x, y))
        a, side = self.rim, np.roll(self.rim, -1, axis=0) - self.rim
        for part in np.array_split(beyond, max(1, beyond.size // 2000)):
            p = np.stack([x[part], y[part]], axis=1)[:, None] - a
            share = np.clip((p * side).sum(axis=2) / np.maximum((side * side).sum(axis=1), 1e-300), 0.0, 1.0)
            away = p - share[..., None] * side
            length = np.hypot(away[..., 0], away[..., 1])
            nearest = np.argmin(length, axis=1)
            rows = np.arange(part.size)
            distance[part] = length[rows, nearest]
            outwards[part] = away[rows, nearest] / np.maximum(distance[part], 1e-300)[:, None]
        return distance, outwards

    def heights(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """z, z_x, z_y; beyond the sheet along its tangents.

        Parameters
        ----------
        x, y : ndarray
            (n,), mm.
        """
        x_min, x_max, y_min, y_max = self.surface.domain
        xs, ys = np.clip(x, x_min, x_max), np.clip(y, y_min, y_max)
        z, zx, zy = self.surface.heights(xs, ys)
        return z + zx * (x - xs) + zy * (y - ys), zx, zy

    def derivatives(self, x: Array, y: Array) -> SagDerivatives:
        """z and its derivatives to the second order at points of the sheet.

        Parameters
        ----------
        x, y : ndarray
            (n,), mm.
        """
        d = self.surface.derivatives(x, y)
        return SagDerivatives(*(d[key][..., 2] for key in ("s", "u", "v", "uu", "uv", "vv")))

    def feet(self, points: Array) -> Feet:
        """Perpendiculars from points to the sheet.

        Parameters
        ----------
        points : ndarray
            (n, 3), mm.
        """
        distance, normal = np.empty(len(points)), np.empty((len(points), 3))
        rows, at = np.arange(len(points)), points[:, :2].copy()
        for _ in range(FOOT_STEPS):
            of = points[rows]
            z, zx, zy = self.heights(at[:, 0], at[:, 1])
            n = np.stack([-zx, -zy, np.ones_like(zx)], axis=1)
            n /= np.linalg.norm(n, axis=1, keepdims=True)
            off = np.stack([of[:, 0] - at[:, 0], of[:, 1] - at[:, 1], of[:, 2] - z], axis=1)
            along: Array = np.einsum("ij,ij->i", off, n)
            distance[rows], normal[rows] = along, n
            # Towards the foot as the touching plane has it. What is left of the way counts in the distance by its square.
            slip = off - along[:, None] * n
            far = np.einsum("ij,ij->i", slip, slip) > FOOT_SETTLED * self.size_mm**2
            if not far.any():
                break
            at, rows = at[far] + slip[far, :2], rows[far]
        return Feet(distance, normal)
