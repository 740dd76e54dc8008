"""The lane's bow: how far the image of a straight line of the world bends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.ground import side_of
from raytrace.measures.in_use import MirrorInUse
from raytrace.measures.registry import Measure, register
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.line_image import SAMPLES, UP, LineImage, LineView, StraightLine, line_images, road_line

Array = NDArray[np.float64]

ARCMIN = np.degrees(1.0) * 60.0
MIN_SAMPLES = 5
UPRIGHT = np.sqrt(0.5)  # the sine of a line's slope from which it is rather upright


@dataclass(frozen=True, slots=True, eq=False)
class Bow:
    """The largest angle between a line's image and the great circle through the image's ends, as the eye sees it.

    Attributes
    ----------
    arcmin : arc minutes, signed; above 0 where the image passes above the great circle, or, for a line that is rather upright
        than level, on the vehicle's side of it.
    along_mm : of the line's point there, mm from its start.
    place : (2,), mm, where it is seen on the picture plane.
    extent_arcmin : between the image's ends, arc minutes.
    image : what was measured.
    """

    arcmin: float
    along_mm: float
    place: Array
    extent_arcmin: float
    image: LineImage


def line_bow(view: View, line: StraightLine, host: HostVehicle | None = None, samples: int = SAMPLES) -> Bow | None:
    """Measure how far the image of a straight line bends, of the largest part that is seen.

    With e(s) the unit direction in which the eye sees the line's point s, a and b those of the image's ends, and
    n = ±(a × b)/|a × b|, upwards or inboard:

        bow = asin(e·n) where that is largest

    A straight line seen directly or in a plane mirror has bow 0: all of it lies in one plane with the eye, or with the eye's
    own image. The largest of the samples is refined by a parabola through it and its neighbours.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    line : of the world.
    host : what hides; None for nothing.
    samples : of the line's image.

    Returns
    -------
    Bow
        None where fewer than MIN_SAMPLES samples of the line are seen.

    References
    ----------
    docs/derivations/straight-lines.md
    """
    images = line_images(view, line, host, samples)
    if not images or len(images[0].along_mm) < MIN_SAMPLES:
        return None
    image = images[0]
    normal = _normal(image, UP if abs(line.direction @ UP) < UPRIGHT else np.array([0.0, -side_of(view), 0.0]))
    bow = np.arcsin(np.clip(image.directions @ normal, -1.0, 1.0))
    k = int(np.clip(np.argmax(np.abs(bow)), 1, len(bow) - 2))
    seen = LineView.of(view, line)
    angle = seen.angle(image.along_mm)
    top = _top(angle[k - 1:k + 2], bow[k - 1:k + 2])
    place, _ = seen.image_points(np.array([top]))
    refined = float(np.arcsin(view.towards(place)[0] @ normal))
    if not abs(refined) >= abs(bow[k]):  # on the line itself, where all are rounding
        refined, top, place = float(bow[k]), float(angle[k]), image.on_plane[k:k + 1]
    return Bow(float(ARCMIN * refined), float(seen.along(np.array([top]))[0]), place[0], float(ARCMIN * image.extent), image)


def _normal(image: LineImage, side: Array) -> Array:
    """The unit normal (3,) of the plane of the eye and the image's two ends, on one side."""
    normal = np.cross(image.directions[0], image.directions[-1])
    normal /= np.linalg.norm(normal)
    return -normal if normal @ side < 0.0 else normal


def _top(x: Array, y: Array) -> float:
    """Where the parabola through three points has its top; the middle one where they lie in a row."""
    left, right = (y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1])
    if left == right:
        return float(x[1])
    top = 0.5 * (x[0] + x[1]) - left * 0.5 * (x[2] - x[0]) / (right - left)
    return float(np.clip(top, x[0], x[2]))


def bow_in_use(use: MirrorInUse) -> Bow | None:
    """`line_bow` of the lane line that the scene asks about; None without one, or where the mirror shows none of it."""
    there = use.on_vehicle
    line = there.asked.line_y
    return None if line is None else line_bow(there.views.middle, road_line(line), there.host)


def _bow(use: MirrorInUse) -> float | None:
    found = use.record(bow_in_use)
    return None if found is None else found.arcmin


register(Measure("lane_bow_arcmin", "lane bow", "′", 1,
                 "largest angle between the image of the lane line on the road and the great circle through its ends, positive "
                 "upwards", _bow, group="Straightness", better="less"))
