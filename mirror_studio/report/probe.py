"""25 points of the optical face with normals and radii, to check by hand in CAD."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_cad.outline import Outline
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import normals, principal_curvatures_of, shape_operator
from mirror_studio.report.tables import Table

Array = NDArray[np.float64]

ACROSS = np.array([-0.8, -0.4, 0.0, 0.4, 0.8])  # of the half-width, and of half the height there: well inside
# Coordinates are typed in by hand: no finer than this share of the mirror's smaller side, rounded down to a power of ten.
COARSENESS = 1.0 / 200.0
CHORD_SAMPLES = 2001  # at which a column is looked at for where the outline crosses it
# Principal curvatures closer than this share of the larger have no direction that a reader could check.
UMBILIC = 1e-6
FLAT_PER_MM = 1e-9  # a radius of 1000 km


@dataclass(frozen=True, slots=True, eq=False)
class Probe:
    """Points on the optical face, row by row from the top left.

    points, normals : (n, 3), mm and unit, towards the driver.   curvatures : (n, 2), k1 ≥ k2, 1/mm, convex positive.
    directions : (n, 3), unit, of k1 in the tangent plane, with x ≥ 0; NaN at an umbilic.
    """

    points: Array
    normals: Array
    curvatures: Array
    directions: Array

    @property
    def radii(self) -> Array:
        """R1 = 1/k1 and R2 = 1/k2, (n, 2) mm; inf where it is flat."""
        flat = np.abs(self.curvatures) < FLAT_PER_MM
        return np.where(flat, np.inf, 1.0 / np.where(flat, 1.0, self.curvatures))

    @property
    def angles_deg(self) -> Array:
        """Of k1's direction as the driver sees it, from x towards y, −90 to 90; NaN at an umbilic."""
        return np.degrees(np.arctan2(self.directions[:, 1], self.directions[:, 0]))

    def table(self) -> Table:
        """A row a point."""
        columns: dict[str, NDArray[Any]] = {"point": np.arange(1, len(self.points) + 1)}
        for names, values in ((("x_mm", "y_mm", "z_mm"), self.points), (("nx", "ny", "nz"), self.normals),
                              (("R1_mm", "R2_mm"), self.radii), (("k1_per_mm", "k2_per_mm"), self.curvatures),
                              (("R1_direction_x", "R1_direction_y", "R1_direction_z"), self.directions)):
            columns |= dict(zip(names, values.T, strict=True))
        return Table("probe", columns | {"R1_direction_deg": self.angles_deg})


def probe(surface: BSplineSurface, outline: Outline) -> Probe:
    """5 × 5 points over the outline, of a surface with u = x, v = y.

    Columns at ACROSS of the half-width; in each, rows at ACROSS of half of its longest stretch inside the outline.
    Directions: tan 2φ = 2·W12/(W11 − W22) in the frame of `ShapeOperator`.
    """
    x_min, x_max, y_min, y_max = outline.bounding_box()
    step = 10.0 ** np.floor(np.log10(COARSENESS * min(x_max - x_min, y_max - y_min)))
    columns = np.round((0.5 * (x_min + x_max) + 0.5 * (x_max - x_min) * ACROSS) / step) * step
    low, high = _longest_stretches(outline, columns, y_min, y_max)
    rows = np.round((0.5 * (low + high) + 0.5 * (high - low) * ACROSS[::-1, None]) / step) * step
    x, y = np.broadcast_to(columns, rows.shape).ravel(), rows.ravel()
    d = surface.derivatives(x, y)
    w, normal = shape_operator(d), normals(d["u"], d["v"])
    e2 = np.stack([np.zeros(len(x)), normal[:, 2], -normal[:, 1]], axis=1)
    e2 /= np.linalg.norm(e2, axis=1, keepdims=True)
    phi = 0.5 * np.arctan2(2.0 * w.w12, w.w11 - w.w22)[:, None]
    direction = np.cos(phi) * np.cross(e2, normal) + np.sin(phi) * e2
    direction *= np.where(direction[:, :1] < 0.0, -1.0, 1.0)
    k1, k2 = principal_curvatures_of(w)
    direction[k1 - k2 <= UMBILIC * np.maximum(np.abs(k1), np.abs(k2)) + FLAT_PER_MM * UMBILIC] = np.nan
    # The face gives back x and y but for rounding, which a reader of a table would take for something.
    points = np.stack([x + 0.0, y + 0.0, d["s"][:, 2]], axis=1)
    return Probe(points, normal, np.stack([k1, k2], axis=1), direction)


def _longest_stretches(outline: Outline, x: Array, y_min: float, y_max: float) -> tuple[Array, Array]:
    """The longest interval of y that lies inside the outline at each x: its ends, (n,) each."""
    y = np.linspace(y_min, y_max, CHORD_SAMPLES)
    ends = []
    for inside in outline.contains(x[:, None], y):
        padded = np.concatenate([[False], inside, [False]])
        starts, stops = np.flatnonzero(~padded[:-1] & padded[1:]), np.flatnonzero(padded[:-1] & ~padded[1:]) - 1
        longest = int(np.argmax(stops - starts))
        ends.append((y[starts[longest]], y[stops[longest]]))
    low, high = np.array(ends).T
    return low, high
