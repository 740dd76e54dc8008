"""How far the image of a vertical line leans."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.ground import side_of
from raytrace.measures.in_use import MirrorInUse
from raytrace.measures.line_bow import ARCMIN
from raytrace.measures.registry import Measure, register
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.line_image import UP, LineImage, StraightLine, column, line_images

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Tilt:
    """How a vertical line's image leans; above 0 where its top leans towards the vehicle.

    Attributes
    ----------
    arcmin : in the mirror, arc minutes.
    flat_arcmin : in a flat mirror that touches this one where it shows the middle of the image, arc minutes.
    by_curvature_arcmin : what the mirror's curvature adds, arc minutes: the difference of the two.
    image : what was measured.
    """

    arcmin: float
    flat_arcmin: float
    by_curvature_arcmin: float
    image: LineImage


def column_tilt(view: View, line: StraightLine, host: HostVehicle | None = None) -> Tilt | None:
    """Measure the angle between a vertical line's image and the vertical, of the largest part that is seen.

    With a and b the unit directions in which the eye sees the lower and upper end of the image and m = (a + b)/|a + b|:

        tilt = the angle, about m, from the vertical plane through m to the plane of a and b

    Upright on the picture plane of a camera that looks along m with its own up is not upright for a mirror that is pitched:
    a flat one leans verticals too. So the same is said of the flat mirror that is tangent where the mirror shows what is seen
    at the middle: its image of the same two points of the line.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    line : a vertical one, its start below.
    host : what hides; None for nothing.

    Returns
    -------
    Tilt
        None where nothing of the line is seen.
    """
    images = line_images(view, line, host)
    if not images or len(images[0].along_mm) < 2:
        return None
    image = images[0]
    middle = image.on_plane[0] + 0.5 * (image.on_plane[-1] - image.on_plane[0])
    traced = view.untrimmed.trace_points(np.array([middle]))
    ray = view.towards(middle)
    normal = traced.directions[0] - ray
    normal /= np.linalg.norm(normal)
    ends = line.at(image.along_mm[[0, -1]])
    behind = ends - 2.0 * ((ends - traced.points[0]) @ normal)[:, None] * normal - view.eye
    behind /= np.linalg.norm(behind, axis=1, keepdims=True)
    inboard = -side_of(view)
    tilt, flat = (float(inboard * ARCMIN * _lean(*two)) for two in (image.directions[[0, -1]], behind))
    return Tilt(tilt, flat, tilt - flat, image)


def _lean(low: Array, high: Array) -> float:
    """How far the great circle from one direction to another leans to the right of the vertical at its middle, radians."""
    middle = (low + high) / np.linalg.norm(low + high)
    right = np.cross(middle, UP)
    right /= np.linalg.norm(right)
    return float(np.arctan2((high - low) @ right, (high - low) @ np.cross(right, middle)))


def tilt_in_use(use: MirrorInUse) -> Tilt | None:
    """`column_tilt` of the column that the scene asks about; None without one, or where it is not shown."""
    there = use.on_vehicle
    place = there.asked.column
    return None if place is None else column_tilt(there.views.middle, column(*place), there.host)


def _of_tilt(use: MirrorInUse, name: str) -> float | None:
    found = use.record(tilt_in_use)
    return None if found is None else float(getattr(found, name))


register(Measure("column_tilt_arcmin", "column tilt", "′", 1,
                 "angle at the eye by which the image of an upright column leans to the right",
                 lambda use: _of_tilt(use, "arcmin"), group="Straightness", better="less"))
register(Measure("column_tilt_by_curvature_arcmin", "column tilt by the mirror's curvature", "′", 1,
                 "angle by which the image of an upright column leans to the right, less that in a flat mirror that touches "
                 "this one where the column is seen",
                 lambda use: _of_tilt(use, "by_curvature_arcmin"), group="Straightness", better="less"))
