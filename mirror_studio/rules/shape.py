"""What reflects in, its parts, sizes and departure from a sphere out: what of a mirror hangs neither on rule nor instrument."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mirror_studio.rules import sizes
from raytrace.measures.ghost import reflectance
from raytrace.reflector import Reflector
from raytrace.surfaces.base import BoundedFace, box_of_points
from raytrace.surfaces.cut import outboard_of

Array = NDArray[np.float64]

GRID = 9  # samples a direction over the visible surface
GRID_REACH = 0.98  # of the box, from its middle, that these reach
SPHERE_MM = 0.02  # off its best sphere, that a face may be and be one: what the rule files have of a surface
RECTANGLE_MM = 40.0  # high, whatever the class
REFLECTANCE_DEG = 25.0  # of incidence, at which the rules have reflectances measured


@dataclass(frozen=True, eq=False)
class MirrorShape:
    """The visible surface of a mirror, or of the main part of one.

    Attributes
    ----------
    reflector
        In mirror coordinates.
    transition_mm
        x of the upright line beyond which, outboard, the aspheric part lies; None where it is not known.
    """

    reflector: Reflector
    transition_mm: float | None = None

    # --- its parts ----------------------------------------------------------------------------------------------------

    @cached_property
    def main(self) -> MirrorShape:
        """The main part alone: itself, where neither a transition line nor an edge of faces parts it from an aspheric one."""
        if self.transition_mm is None:
            face = self._spherical_face
            return self if face is None else MirrorShape(replace(self.reflector, surface=face))
        return MirrorShape(replace(self.reflector, surface=self.reflector.surface.inboard_of(self.transition_mm)))

    @cached_property
    def aspheric_outline(self) -> Array | None:
        """The polygon (n, 2) around the aspheric part, mm; None where it is not known."""
        if (line := self.transition_mm) is not None:
            return outboard_of(self.outline, line)
        if self._spherical_face is None:
            return None
        others = [face for face in self.reflector.surface.uncoated().bounding_faces if face is not self._spherical_face]
        return others[0].rim[0].points[:, :2] if len(others) == 1 and len(others[0].rim) == 1 else None

    @cached_property
    def _spherical_face(self) -> BoundedFace | None:
        """Of several faces that are no sphere together, the largest that is one by itself: the main part."""
        faces = self.reflector.surface.uncoated().bounding_faces
        if len(faces) < 2 or self.sphere_departure <= SPHERE_MM:
            return None
        found = [face for face in faces if len(face.rim) == 1 and MirrorShape(
            replace(self.reflector, surface=face)).sphere_departure <= SPHERE_MM]
        return max(found, key=lambda face: abs(sizes.area_of(face.rim[0].points[:, :2])), default=None)

    @property
    def aspheric_width(self) -> float | None:
        """The longest level piece of the aspheric part, from the transition line to the edge, mm."""
        if self.aspheric_outline is None:
            return None
        found = sizes.longest_rectangle(self.aspheric_outline, 0.0)
        return 0.0 if found is None else found.width

    # --- its surface --------------------------------------------------------------------------------------------------

    @cached_property
    def outline(self) -> Array:
        """The polygon (n, 2) that bounds the visible surface, mm.

        Raises
        ------
        SpecError
            For a face with holes.
        """
        return sizes.outline_of(self.reflector)

    @cached_property
    def centre(self) -> Array:
        """The middle (2,) of its box."""
        x_min, x_max, y_min, y_max = box_of_points(self.outline)
        return np.array([0.5 * (x_min + x_max), 0.5 * (y_min + y_max)])

    @cached_property
    def grid(self) -> Array:
        """Places (n, 2) over the visible surface."""
        return grid_within(self.outline)

    @cached_property
    def sphere_departure(self) -> float:
        """The largest distance of the visible surface from its best sphere or plane, mm.

        Least squares on a·|p|² + b·p + c = 0, |(a, b, c)| scaled to distances by the gradient 2a·p + b.
        """
        p = self.reflector.surface.points_over(self.grid[:, 0].copy(), self.grid[:, 1].copy())
        p = p[np.isfinite(p).all(axis=1)]
        size = float(np.ptp(p, axis=0).max())
        p = (p - p.mean(axis=0)) / size
        terms = np.concatenate([np.sum(p * p, axis=1, keepdims=True), p, np.ones((len(p), 1))], axis=1)
        best = np.linalg.svd(terms)[2][-1]
        a, *b, _ = best
        off = terms @ best
        return size * float(np.abs(off / np.linalg.norm(2.0 * a * p + np.array(b), axis=1)).max())

    @property
    def centre_point(self) -> Array:
        """The surface's point (3,) over the centre."""
        point: Array = self.reflector.surface.points_over(self.centre[:1].copy(), self.centre[1:].copy())[0]
        return point

    @property
    def front_percent(self) -> float:
        """What the front of the glass reflects by itself at REFLECTANCE_DEG, percent.

        Raises
        ------
        TraceError
            Without glass.
        """
        return 100.0 * float(reflectance(np.cos(np.radians([REFLECTANCE_DEG])), self.reflector.surface.glass.index)[0])

    # --- sizes --------------------------------------------------------------------------------------------------------

    @cached_property
    def rectangle(self) -> sizes.Inscribed | None:
        """The longest level rectangle 40 mm high on the visible surface."""
        return sizes.longest_rectangle(self.outline, RECTANGLE_MM)

    @cached_property
    def segment(self) -> sizes.Inscribed:
        """The longest upright segment on it."""
        return sizes.longest_upright(self.outline)

    @cached_property
    def circle(self) -> float:
        """The largest circle's diameter."""
        return sizes.inscribed_circle(self.outline)

    @cached_property
    def box_sides(self) -> tuple[float, float]:
        """The shorter and the longer side of the outline's box."""
        x_min, x_max, y_min, y_max = box_of_points(self.outline)
        short, long = sorted((x_max - x_min, y_max - y_min))
        return short, long


def grid_within(outline: Array) -> Array:
    """Places (n, 2) of an even grid over a polygon's box that it holds."""
    x_min, x_max, y_min, y_max = box_of_points(outline)
    share = np.linspace(-GRID_REACH, GRID_REACH, GRID)
    middle, half = 0.5 * np.array([x_min + x_max, y_min + y_max]), 0.5 * np.array([x_max - x_min, y_max - y_min])
    at_xy = middle + half * np.stack(np.meshgrid(share, share), axis=2).reshape(-1, 2)
    sides = sizes.Polygon.of(outline)
    return at_xy[[sides.contains(*place) for place in at_xy]]
