"""Rays aimed at known points of a mirror and their exact reflections; and meshes of it for the peers.

A ray is aimed at a point of the surface, so its hit is known before anything is traced. Points and slopes come from scipy's
splines in float64; nothing of the tracer or of its kernels is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from mirror_cad.mirror import Mirror
from mirror_cad.surfaces.bspline import BSplineSurface
from raytrace.reflector import Reflector
from raytrace.viewing.eye import eye_position

Array = NDArray[np.float64]
ARCSEC = float(np.degrees(1.0) * 3600.0)
MESH_MARGIN_MM = 3.0  # of the peers' meshes beyond the outline's box, so that no ray is lost at their edge


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """origins (n, 3) or one eye (3,), directions (n, 3) unit, exact (n, 3) after reflection.

    `inside` (n,): whether the point that the ray is aimed at lies inside the outline.
    """

    origins: Array
    directions: Array
    exact: Array
    inside: NDArray[np.bool_]

    def errors(self, found: NDArray[np.floating]) -> tuple[float, float, float]:
        """Largest and RMS angle from the exact direction, arc seconds.

        With the share of the rays inside the outline that were not found. Angles by the chord: 3·10⁻⁸ of 1° off at 1″.
        """
        chord = np.linalg.norm(found - self.exact, axis=1)[self.inside]
        hit = np.isfinite(chord)
        angle = 2.0 * np.arcsin(np.minimum(0.5 * chord[hit], 1.0)) * ARCSEC
        if angle.size == 0:
            return np.nan, np.nan, 1.0
        return float(angle.max()), float(np.sqrt(np.mean(angle**2))), float(1.0 - hit.mean())

    def shuffled(self) -> Rays:
        """The same rays in random order."""
        order = np.random.default_rng(1).permutation(len(self.directions))
        return Rays(self.origins, self.directions[order], self.exact[order], self.inside[order])


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """vertices (n, 3), faces (m, 3) int32 and the exact unit normals at the vertices (n, 3)."""

    vertices: Array
    faces: NDArray[np.int32]
    normals: Array


@dataclass(frozen=True, eq=False)
class Case:
    """A designed mirror and the driver's eye."""

    mirror: Mirror

    @cached_property
    def eye(self) -> Array:
        """Where the specification has it, (3,) mm."""
        return eye_position(self.mirror.spec.eye.distance_mm, self.mirror.spec.eye.aligned, self.mirror.box)

    @cached_property
    def reflector(self) -> Reflector:
        """The designed mirror as our tracer takes it."""
        return Reflector.from_mirror(self.mirror)

    def rays(self, count: int) -> Rays:
        """Some `count` rays from the eye to a pixel grid over the outline's box, row by row from the top."""
        x_min, x_max, y_min, y_max = self.mirror.box
        columns = max(2, round(np.sqrt(count * (x_max - x_min) / (y_max - y_min))))
        rows = max(2, round(count / columns))
        x = x_min + (x_max - x_min) * (np.arange(columns) + 0.5) / columns
        y = y_max - (y_max - y_min) * (np.arange(rows) + 0.5) / rows
        vertices, normals = surface_grid(self.mirror.surface, x, y)
        directions = vertices - self.eye
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        dot = np.einsum("ij,ij->i", directions, normals)
        inside = self.mirror.outline.contains(vertices[:, 0], vertices[:, 1])
        return Rays(self.eye, directions, directions - 2.0 * dot[:, None] * normals, inside)

    def mesh(self, triangles: int) -> Mesh:
        """A regular grid of some `triangles` triangles over the outline's box and MESH_MARGIN_MM beyond.

        Its vertices lie on the surface.
        """
        box, domain = self.mirror.box, self.mirror.surface.domain
        low = [max(box[2 * k] - MESH_MARGIN_MM, domain[2 * k]) for k in range(2)]
        high = [min(box[2 * k + 1] + MESH_MARGIN_MM, domain[2 * k + 1]) for k in range(2)]
        cells_x = max(1, round(np.sqrt(0.5 * triangles * (high[0] - low[0]) / (high[1] - low[1]))))
        cells_y = max(1, round(0.5 * triangles / cells_x))
        vertices, normals = surface_grid(self.mirror.surface, np.linspace(low[0], high[0], cells_x + 1),
                                       np.linspace(low[1], high[1], cells_y + 1))
        return Mesh(vertices, grid_faces(cells_x, cells_y), normals)


def surface_grid(surface: BSplineSurface, x: Array, y: Array) -> tuple[Array, Array]:
    """Points and unit normals (n, 3) of a surface with u = x, v = y over y (rows) and x, by scipy's splines."""
    heights = surface.poles[..., 2]
    along_y = BSpline(surface.knots_v, heights.T, surface.degree_v)  # (…, n_u)
    z, z_y = (BSpline(surface.knots_u, values.T, surface.degree_u) for values in (along_y(y), along_y(y, 1)))
    xx, yy = np.meshgrid(x, y)
    vertices = np.stack([xx, yy, z(x).T], axis=-1).reshape(-1, 3)
    normals = np.stack([-z(x, 1).T, -z_y(x).T, np.ones(xx.shape)], axis=-1).reshape(-1, 3)
    return vertices, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def grid_faces(cells_x: int, cells_y: int) -> NDArray[np.int32]:
    """Triangles (m, 3) of a grid whose vertices run along x first, counter-clockwise seen from +z where y rises."""
    corner = np.arange((cells_x + 1) * (cells_y + 1)).reshape(cells_y + 1, -1)[:-1, :-1].ravel()
    above = corner + cells_x + 1
    return np.stack([corner, corner + 1, above + 1, corner, above + 1, above], axis=1).reshape(-1, 3).astype(np.int32)
