"""Straightness of the image of a line on the road, reckoned as the paper reckons its lane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.in_use import MirrorInUse
from raytrace.measures.lane import END_DERIVATIVE, LEVEL_SHARE
from raytrace.measures.line_bow import MIN_SAMPLES as MIN_OF_BOW
from raytrace.measures.line_bow import bow_in_use
from raytrace.measures.registry import Measure, register
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.line_image import LineImage, LineView, StraightLine, Unmeasured, line_images, road_line, why_unmeasured

Array = NDArray[np.float64]

# Of what is seen of the line, as an angle: the step of the tangent's differences. Their error is of its fourth power; that of
# the places is 1e-10 radians of a ray.
STEP_SHARE = 5e-3
MIN_SAMPLES = 5


@dataclass(frozen=True, slots=True, eq=False)
class RoadStraightness:
    """How a line's image bends between its two ends, in mirror coordinates (x, y) on the surface.

    Attributes
    ----------
    percent : (|Δy_curve| − |Δy_line|)/|Δy_line|.
    far, near : (2,), mm, where the image begins and ends.
    tangent_y : mm, the height of the far end's tangent above the near end's x.
    image : what was measured.
    """

    percent: float
    far: Array
    near: Array
    tangent_y: float
    image: LineImage


def road_straightness(view: View, line: StraightLine, host: HostVehicle | None = None) -> RoadStraightness | None:
    """(|Δy_curve| − |Δy_line|)/|Δy_line| in percent for a straight line on the road.

    As `raytrace.measures.lane` has it for the reference plane, but between the ends of what the mirror shows of the line:
    from the far one, the vanishing point where the mirror shows it, to the near one, where the image leaves the mirror (or
    the vehicle hides it, or the line ends). Δy_curve is the image's rise between them; Δy_line that of the image's tangent at
    the far end, over the same x. The far end takes the place of the paper's right edge: there the lane comes into the picture
    in both, and the driver looks there. The near end takes the place of the left edge, which a line on the road need not reach.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    line : of the road.
    host : what hides; None for nothing.

    Returns
    -------
    RoadStraightness
        None where the line is not seen, or its image is level or upright at the far end.

    References
    ----------
    docs/derivations/straight-lines.md says why the figures differ from the reference plane's.
    """
    images = line_images(view, line, host)
    if not images or len(images[0].along_mm) < MIN_SAMPLES:
        return None
    image = images[0]
    seen = LineView.of(view, line)
    near, far = seen.angle(image.along_mm[[0, -1]])
    angle = far - STEP_SHARE * (far - near) * np.arange(5)
    on_plane, _ = seen.image_points(angle)
    at = seen.edge.view.trace_points(on_plane).on_mirror[:, :2]
    at[0] = image.on_mirror[-1, :2]
    by_angle = END_DERIVATIVE / 12.0 @ at
    across, rise = image.on_mirror[0, :2] - image.on_mirror[-1, :2]
    width = view.box[1] - view.box[0]
    if not np.isfinite(at).all() or abs(by_angle[0]) < LEVEL_SHARE * abs(by_angle[1]) or abs(across) < LEVEL_SHARE * width:
        return None
    straight = float(by_angle[1] / by_angle[0] * across)
    if abs(straight) < LEVEL_SHARE * width:
        return None
    return RoadStraightness(100.0 * (abs(float(rise)) - abs(straight)) / abs(straight), image.on_mirror[-1, :2],
                            image.on_mirror[0, :2], float(image.on_mirror[-1, 1]) + straight, image)


def straightness_in_use(use: MirrorInUse) -> RoadStraightness | None:
    """`road_straightness` of the lane line that the scene asks about; None without one, or where too little of it is shown."""
    there = use.on_vehicle
    line = there.asked.line_y
    return None if line is None else road_straightness(there.views.middle, road_line(line), there.host)


def line_unmeasured_in_use(use: MirrorInUse) -> Unmeasured | None:
    """Why a figure of the lane line is missing; None where none is, or where there is no line."""
    there = use.on_vehicle
    line = there.asked.line_y
    if line is None or (use.record(bow_in_use) is not None and use.record(straightness_in_use) is not None):
        return None
    found = why_unmeasured(there.views.middle, road_line(line), there.host, MIN_OF_BOW)
    return found or "level or upright at its far end"


def _percent(use: MirrorInUse) -> float | None:
    found = use.record(straightness_in_use)
    return None if found is None else found.percent


register(Measure("lane_straightness_road_percent", "lane straightness on the road", "%", 1,
                 "(|Δy_curve| − |Δy_line|)/|Δy_line| of the image of a line on the road between its two ends, the line being "
                 "the image's tangent at the far one", _percent, group="Straightness", better="less"))
