"""Points of a surface in, the radii that a three-point spherometer of some leg distance reads there out.

The instrument stands on two outer feet, C apart, and a dial in the middle between them tells how far the surface is from the
line through them: the sagitta H. It is held in the plane of the surface's normal at the dial, and upright where both feet are
equally far from the dial's tip. Through the three points goes one circle, 1/R = 8H/(C² + 4H²) (SAE J1246: R = C²/(8H) + H/2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import MirrorError
from raytrace.rays import Rays, Trace
from raytrace.surfaces.base import OpticalSurface

Array = NDArray[np.float64]

# Heights (n, m) of the surface above the planes that touch it at n points, at m distances each along a direction, mm.
Heights = Callable[[Array], Array]

FEET_SHARE = 1e-15  # of the leg distance: the feet are found, to rounding
MAX_STEPS = 200  # each leaves (C/2R)² of the error: 0.4 of it on the tightest curve that any rule has, and far less on mirrors
# A dial's sagitta, mm, below which the surface counts as flat: rounding of coordinates of a metre leaves 1e-13, and no dial
# that is made tells a thousandth of this.
FLAT_MM = 1e-10
DIAL_MM = 0.002  # what a usual dial is read to
LIFT = 1.0  # of the leg distance: from how far above the touching plane rays go down to the surface


class ReadingError(MirrorError):
    """A place where the instrument cannot stand."""


@dataclass(frozen=True, slots=True, eq=False)
class Stands:
    """n places of the instrument.

    Points and unit normals (n, 3), and unit directions (n, 3) across them that its feet lie along.
    """

    points: Array
    normals: Array
    directions: Array


def readings(heights: Heights, count: int, leg_mm: float) -> Array:
    """Compute what the spherometer reads.

    Parameters
    ----------
    heights : heights of the surface above the touching planes, at distances (count, 2) along the directions, mm.
    count : of places.
    leg_mm : C, between the outer feet.

    Returns
    -------
    Radii (count,), mm: positive where convex, negative where hollow, inf where flat; NaN where a foot has no surface.

    References
    ----------
    SAE J1246; UN Regulation No. 46, Annex 7.
    """
    reach = np.full(count, 0.5 * leg_mm)  # of the feet from the dial's tip
    along = np.tile([-0.5 * leg_mm, 0.5 * leg_mm], (count, 1))
    height = heights(along)
    for _ in range(MAX_STEPS):
        apart = np.hypot(along[:, 1] - along[:, 0], height[:, 1] - height[:, 0])
        # Both feet at one distance from the tip, and that such that they are C apart.
        reach = reach * leg_mm / apart
        change = reach[:, None] / np.hypot(along, height)
        along = along * change
        height = heights(along)
        if not (np.abs(change - 1.0) > FEET_SHARE).any():
            break
    apart = np.hypot(along[:, 1] - along[:, 0], height[:, 1] - height[:, 0])
    middle = along.mean(axis=1), height.mean(axis=1)
    sagitta = -np.sign(middle[1]) * np.hypot(*middle)
    with np.errstate(divide="ignore"):
        return np.where(np.abs(sagitta) > FLAT_MM, radius_of(apart, sagitta), np.where(np.isnan(sagitta), np.nan, np.inf))


def radius_of(chord_mm: Array | float, sagitta_mm: Array | float) -> Array:
    """R = C²/(8H) + H/2, the radius of a circle by a chord and its sagitta, mm (SAE J1246)."""
    with np.errstate(divide="ignore"):
        result: Array = np.asarray(chord_mm) ** 2 / (8.0 * np.asarray(sagitta_mm)) + 0.5 * np.asarray(sagitta_mm)
    return result


def reading_error(radius_mm: float, chord_mm: float, dial_mm: float = DIAL_MM) -> float:
    """By how much a dial's error changes the radius read, mm: |dR/dH|·δ = |½ − C²/(8H²)|·δ; inf for a flat surface."""
    if not np.isfinite(radius_mm):
        return float("inf")
    r = abs(radius_mm)
    if chord_mm >= 2.0 * r:
        raise ReadingError(f"a spherometer whose feet are {chord_mm:g} mm apart cannot stand on a radius of {r:g} mm: give a "
                           "shorter --leg-mm")
    sagitta = 0.25 * chord_mm**2 / (r + np.sqrt(r * r - 0.25 * chord_mm**2))
    return float(abs(0.5 - chord_mm**2 / (8.0 * sagitta**2)) * dial_mm)


def stands_at(surface: OpticalSurface, places: Array, axis: Array) -> Stands:
    """Stands at places (n, 2) in (x, y) of a surface, with the feet along the curve whose plane holds z and an axis of (x, y).

    Raises
    ------
    ReadingError
        Where there is no surface.
    """
    down = np.tile([0.0, 0.0, -1.0], (len(places), 1))
    points = surface.points_over(places[:, 0].copy(), places[:, 1].copy())
    found = Trace.empty(len(places))
    lift = 1.0  # mm: a ray that starts on the surface does not meet it
    _sheet(surface).first_hits(Rays(np.nan_to_num(points) - lift * down, down), found)
    lost = ~np.isfinite(found.normals).all(axis=1)
    if lost.any():
        x, y = places[np.argmax(lost)]
        raise ReadingError(f"the mirror has no surface at x = {x:.1f}, y = {y:.1f} mm, where the rule has its radius read")
    # Along the curve: across the normal, in the plane of z and the axis.
    across = np.cross([0.0, 0.0, 1.0], [axis[0], axis[1], 0.0])
    directions = np.cross(across, found.normals)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Stands(found.points, found.normals, directions)


def turned(stands: Stands, angle: float = 0.5 * np.pi) -> Stands:
    """The same places, the feet turned about the normals by an angle, radians."""
    beside = np.cross(stands.normals, stands.directions)
    return Stands(stands.points, stands.normals, np.cos(angle) * stands.directions + np.sin(angle) * beside)


def read_surface(surface: OpticalSurface, stands: Stands, leg_mm: float) -> Array:
    """Compute what the spherometer reads on a surface itself, by rays along the normals at the dial; radii (n,), mm.

    Raises
    ------
    ReadingError
        Where a foot stands beside the surface.
    """
    found = readings_where_it_stands(surface, stands, leg_mm)
    if np.isnan(found).any():
        x, y, _ = stands.points[np.argmax(np.isnan(found))]
        raise ReadingError(f"at x = {x:.1f}, y = {y:.1f} mm a foot of the spherometer, {leg_mm:g} mm from the other, stands "
                           "beside the surface: give a shorter --leg-mm")
    return found


def readings_where_it_stands(surface: OpticalSurface, stands: Stands, leg_mm: float) -> Array:
    """`read_surface`, NaN where a foot stands beside the surface."""
    sheet, lift, n = _sheet(surface), LIFT * leg_mm, len(stands.points)
    foot = np.repeat(stands.points, 2, axis=0)
    normal, direction = np.repeat(stands.normals, 2, axis=0), np.repeat(stands.directions, 2, axis=0)

    def heights(along: Array) -> Array:
        origins = foot + np.nan_to_num(along).reshape(-1, 1) * direction + lift * normal
        found = Trace.empty(2 * n)
        sheet.first_hits(Rays(origins, -normal), found)
        result: Array = np.einsum("ij,ij->i", found.points - foot, normal).reshape(n, 2)
        return result

    return readings(heights, n, leg_mm)


def _sheet(surface: OpticalSurface) -> OpticalSurface:
    return surface.uncoated().untrimmed()
