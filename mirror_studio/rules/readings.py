"""A mirror's shape and a spherometer's leg distance in, the radii that it reads where rules set it out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SpecError
from mirror_studio.rules.radii import Radii
from mirror_studio.rules.shape import MirrorShape, grid_within
from mirror_studio.rules.spherometer import read_surface, reading_error, readings_where_it_stands, stands_at, turned
from raytrace.surfaces.base import box_of_points

Array = NDArray[np.float64]

ARC_SAMPLES = 1025  # of an arc through the centre: the chords between them leave 1e-7 of its length
DIRECTIONS = 4  # in which the least radius is looked for at each sample
ALONG_X, ALONG_Y = np.array([1.0, 0.0]), np.array([0.0, 1.0])


@dataclass(frozen=True, eq=False)
class SpherometerReadings:
    """What a spherometer reads on a mirror; leg_mm : between its outer feet."""

    shape: MirrorShape
    leg_mm: float

    @cached_property
    def main(self) -> SpherometerReadings:
        """Of the main part alone."""
        return self if self.shape.main is self.shape else SpherometerReadings(self.shape.main, self.leg_mm)

    @cached_property
    def at_centre(self) -> Radii:
        """The two readings at the centre."""
        return self._read(self.shape.centre[None], ALONG_X)

    @cached_property
    def at_three_points(self) -> Radii:
        """At 1/3, 1/2 and 2/3 of the upright arc through the centre, or of the level one where that is longer.

        Along it and across (UN Regulation No. 46, Annex 7).
        """
        arcs = [self._arc(axis) for axis in (ALONG_Y, ALONG_X)]
        lengths = [float(length[-1]) for _, length in arcs]
        which = 1 if lengths[1] > lengths[0] else 0
        at_xy, length = arcs[which]
        wanted = length[-1] * np.array([1.0, 1.5, 2.0]) / 3.0
        at = np.stack([np.interp(wanted, length, at_xy[:, k]) for k in (0, 1)], axis=1)
        return self._read(at, (ALONG_Y, ALONG_X)[which])

    @cached_property
    def at_five_places(self) -> Radii:
        """At the centre, and half way from it to the edge on each side; level and upright."""
        x_min, x_max, y_min, y_max = box_of_points(np.concatenate([self._through_centre(axis) for axis in (ALONG_X, ALONG_Y)]))
        x, y = self.shape.centre
        at = np.array([[x, y], [0.5 * (x + x_min), y], [0.5 * (x + x_max), y], [x, 0.5 * (y + y_min)], [x, 0.5 * (y + y_max)]])
        return self._read(at, ALONG_X)

    @cached_property
    def least_radius(self) -> float:
        """The least radius that the spherometer reads where it can stand, in DIRECTIONS directions; hollow ones left out.

        On the aspheric part alone, where a transition line says which that is.
        """
        surface, aspheric = self.shape.reflector.surface, self.shape.aspheric_outline
        stands = stands_at(surface, self.shape.grid if aspheric is None else grid_within(aspheric), ALONG_X)
        found = np.concatenate([readings_where_it_stands(surface, turned(stands, math.pi * k / DIRECTIONS), self.leg_mm)
                                for k in range(DIRECTIONS)])
        return float(found[found > 0.0].min(initial=math.inf))

    @cached_property
    def facets_percent(self) -> float:
        """By how much of a radius facets may spoil a reading, percent.

        Their sag e²/(8R), twice, over the instrument's C²/(8R).
        """
        facet = 0.5 * self.shape.reflector.surface.resolution_mm
        return 200.0 * (facet / self.leg_mm) ** 2

    def dial_error(self, radius_mm: float) -> float:
        """What a dial of 2 µm leaves open of a radius, mm."""
        return reading_error(radius_mm, self.leg_mm)

    def _read(self, at: Array, axis: Array) -> Radii:
        surface = self.shape.reflector.surface
        stands = stands_at(surface, at, axis)
        return Radii(at, np.stack([read_surface(surface, each, self.leg_mm) for each in (stands, turned(stands))], axis=1))

    def _through_centre(self, axis: Array) -> Array:
        """Both ends (2, 2) of the piece of the level or upright line through the centre that the outline holds about it."""
        along = 0 if axis[0] else 1
        centre, a = self.shape.centre, self.shape.outline
        b = np.roll(a, -1, axis=0)
        across = 1 - along
        cut = (a[:, across] <= centre[across]) != (b[:, across] <= centre[across])
        a, b = a[cut], b[cut]
        at = a[:, along] + (centre[across] - a[:, across]) * (b - a)[:, along] / (b - a)[:, across]
        before, after = at[at <= centre[along]], at[at > centre[along]]
        if len(before) % 2 == 0 or len(after) % 2 == 0:
            raise SpecError(f"the middle of the outline's box, ({centre[0]:.1f}, {centre[1]:.1f}) mm, is not on the mirror: "
                            "the rule reads radii along arcs through it")
        ends = np.tile(centre, (2, 1))
        ends[:, along] = before.max(), after.min()
        return ends

    def _arc(self, axis: Array) -> tuple[Array, Array]:
        """Points (m, 2) along an arc through the centre, and how long it is up to each, mm (m,)."""
        ends, surface = self._through_centre(axis), self.shape.reflector.surface
        inset = surface.edge_inset
        at_xy = ends[0] + np.linspace(inset, 1.0 - inset, ARC_SAMPLES)[:, None] * (ends[1] - ends[0])
        points = surface.points_over(at_xy[:, 0].copy(), at_xy[:, 1].copy())
        known = np.isfinite(points).all(axis=1)
        at_xy, points = at_xy[known], points[known]
        return at_xy, np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
