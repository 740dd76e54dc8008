"""Measure all that a designer decides by, of a mirror on the vehicle in its scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mirror_cad.design_stages import design
from mirror_studio.drive.mirrors import DrivenMirror
from mirror_studio.drive.world import MM
from mirror_studio.scene_file import SceneFile
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.errors import TraceError
from raytrace.measures.angular_size import AngularSize, sizes_in_use
from raytrace.measures.asked import Asked, Face, NearLane
from raytrace.measures.blind_zone import BlindZone, HiddenCar, blind_zone, blind_zones_in_use, hidden_in_use
from raytrace.measures.column_tilt import Tilt, tilt_in_use
from raytrace.measures.disparity import Disparity, disparity_in_use
from raytrace.measures.eye_fields import EyeFields, extent, eye_fields, fields_in_use
from raytrace.measures.grid_distortion import GridDistortion, distortion_in_use
from raytrace.measures.ground import (
    Ground,
    HorizonMargin,
    SeenWidth,
    aim_in_use,
    nearest_in_use,
    seen_ground,
    seen_widths,
    widths_in_use,
)
from raytrace.measures.in_use import MirrorInUse, OnVehicle
from raytrace.measures.lane import lane_in_use
from raytrace.measures.line_bow import Bow, bow_in_use
from raytrace.measures.magnification import (
    Extent,
    MagnificationExtremes,
    MagnificationMap,
    extremes_in_use,
    map_in_use,
)
from raytrace.measures.registry import Measure
from raytrace.measures.road_straightness import RoadStraightness, line_unmeasured_in_use, straightness_in_use
from raytrace.measures.yaw_coverage import YawCoverage, yaw_coverage
from raytrace.scene.bodies import Body
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.view import box_of
from raytrace.visibility.line_image import Unmeasured
from raytrace.visibility.orientation import Orientation, orientation

Array = NDArray[np.float64]

ORIENTATIONS = {"upright": "upright", "inverted": "upside down and left for right", "reversed": "turned over in one direction",
        "mixed": "some things twice"}
Magnification = Literal["horizontal", "vertical", "ratio"]
MAGNIFICATIONS: tuple[Magnification, ...] = get_args(Magnification)
WIDTH_AT_M = 20.0  # behind the eyes' X = 0, where a mirror that is turned or bent has its seen width followed
TURNS = np.radians(np.arange(-10.0, 10.5, 1.0))  # of the yaw, about the aim


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured of one mirror; see each record for its definition, and `use` for the registered figures.

    plane_straightness_percent : of the paper's lane on the reference plane; None where it is not measured.
    nearest_mm : X of the nearest ground beside the flank that either eye sees, and that both see; NaN where none is.
    """

    mirror: DrivenMirror
    use: MirrorInUse
    asked: Asked
    margin: HorizonMargin
    magnification: MagnificationMap
    magnification_extremes: MagnificationExtremes
    disparity: Disparity
    fields: EyeFields
    grid: GridDistortion
    sizes: tuple[AngularSize, ...]
    bow: Bow | None
    straightness: RoadStraightness | None
    line_unmeasured: Unmeasured | None
    plane_straightness_percent: float | None
    tilt: Tilt | None
    ground: Ground
    widths: tuple[SeenWidth, ...]
    nearest_mm: tuple[float, float]
    blind: tuple[BlindZone, ...]
    hidden: HiddenCar
    coverage: YawCoverage
    orientation: Orientation


def asked_of(scene: SceneFile, bodies: Mapping[str, Body]) -> Asked:
    """What the scene has measured, with the sizes that its named vehicle and column have.

    bodies : the scene's bodies by the name they were given, in their places.
    """
    wanted = scene.measured
    face = None
    if wanted.vehicle is not None:
        low, high = _box(bodies[wanted.vehicle])
        face = Face(float(high[1] - low[1]), float(high[2]), float(0.5 * (low[1] + high[1])))
    upright = None
    if wanted.column is not None:
        low, high = _box(bodies[wanted.column])
        upright = (float(0.5 * (low[0] + high[0])), float(0.5 * (low[1] + high[1])), float(high[2]))
    line_y = MM * wanted.line_y_m if scene.road is not None else None  # without a road there is no line on it
    return Asked(NearLane(MM * wanted.lane_m[0], MM * wanted.lane_m[1]), line_y, face,
                 tuple(MM * one for one in wanted.distances_m), upright, tuple(MM * one for one in wanted.widths_at_m),
                 math.radians(wanted.direct_view_deg), MM * wanted.hidden_height_m)


def in_use(mirror: DrivenMirror, asked: Asked) -> MirrorInUse:
    """A mirror on its vehicle as measures see it, with the eye and the lane that its own specification has beside it."""
    setup = ViewingSetup.of(mirror.spec, box_of(mirror.whole))
    designed = None if mirror.spec is None else mirror.designed or design(mirror.spec)
    return setup.in_use(mirror.whole, designed, OnVehicle(mirror.reflector, mirror.pose, mirror.eyes, mirror.host, asked))


def measure(mirror: DrivenMirror, asked: Asked) -> Measured:
    """All measures of a mirror."""
    use = in_use(mirror, asked)
    views = mirror.views
    return Measured(
        mirror=mirror, use=use, asked=asked,
        margin=use.record(aim_in_use),
        magnification=use.record(map_in_use),
        magnification_extremes=use.record(extremes_in_use),
        disparity=use.record(disparity_in_use),
        fields=use.record(fields_in_use),
        grid=use.record(distortion_in_use),
        sizes=use.record(sizes_in_use),
        bow=use.record(bow_in_use),
        straightness=use.record(straightness_in_use),
        line_unmeasured=use.record(line_unmeasured_in_use),
        plane_straightness_percent=use.record(lane_in_use).percent,
        tilt=use.record(tilt_in_use),
        ground=seen_ground(views.left, views.right, mirror.host),
        widths=use.record(widths_in_use),
        nearest_mm=use.record(nearest_in_use),
        blind=use.record(blind_zones_in_use),
        hidden=use.record(hidden_in_use),
        coverage=yaw_coverage(mirror.reflector, mirror.pose, mirror.eyes, mirror.host, asked.lane, TURNS,
                              direct_view=asked.direct_view),
        orientation=shown_round(views))


def shown_round(views: EyeViews) -> Orientation:
    """Which way round the mirror shows things, from between the eyes; `twice` if it shows any of them twice to an eye."""
    middle = orientation(views.middle)
    return replace(middle, twice=middle.twice or (middle.converging and any(orientation(view).twice
                                                                           for view in (views.left, views.right))))


@dataclass(frozen=True, slots=True)
class MainFigures:
    """The figures whose changes are worth following while a mirror is turned or bent; None for what it does not show.

    Attributes
    ----------
    horizon_either_deg
        Horizon seen by either eye, degrees.
    flank_share, horizon_share
        Where flank and horizon lie, of width and height.
    width_at_20_m
        Ground seen 20 m behind by either eye, m.
    blind_length_m
        Length of the lane beside that is in no view, m.
    blind_endless
        Whether that goes on where looking ends.
    """

    horizon_either_deg: float | None = None
    flank_share: float | None = None
    horizon_share: float | None = None
    width_at_20_m: float | None = None
    blind_length_m: float | None = None
    blind_endless: bool | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TurnedFigures:
    """What a mirror shows while it is turned about its aim, (n,) each, NaN for what it does not show.

    Attributes
    ----------
    yaw_deg
        Beside the aim, degrees.
    azimuth_from_deg, azimuth_to_deg
        From straight rearward, positive to the vehicle's right, as those of the fields are, degrees.
    blind_length_m, blind_endless
        Length of the lane beside that is in no view, m, and whether it goes on where looking ends.
    """

    yaw_deg: Array
    azimuth_from_deg: Array
    azimuth_to_deg: Array
    blind_length_m: Array
    blind_endless: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class MagnificationSpread:
    """A magnification in the middle of the mirror, and from the least to the largest over what is seen."""

    middle: float | None = None
    least: float | None = None
    largest: float | None = None


def main_figures(mirror: DrivenMirror, asked: Asked) -> MainFigures:
    """Measure what a mirror shows as it is turned or bent; nothing of one that is turned away from an eye."""
    try:
        views = mirror.views
    except TraceError:  # turned away from an eye
        return MainFigures()
    aim = mirror.shown()
    found = MainFigures(flank_share=_number(aim.flank), horizon_share=_number(aim.horizon))
    if shown_round(views).twice:
        return found
    blind = blind_zone(views.left, views.right, mirror.host, asked.lane, 0.0, asked.direct_view)
    width = seen_widths(views.left, views.right, mirror.host, (MM * WIDTH_AT_M,))[0]
    return replace(found, horizon_either_deg=extent(eye_fields(views, mirror.host).horizon_clear.either),
                   width_at_20_m=width.either_mm / MM, blind_length_m=blind.length_mm / MM, blind_endless=blind.endless)


def value_of(measured: Measured, measure: Measure) -> float | None:
    """A registered figure of a mirror; None for what it does not show, and for what would be told wrongly of it."""
    if measured.orientation.twice and not measure.local:
        return None
    return measure.value(measured.use)


def spread_of(measured: Measured, name: Magnification) -> MagnificationSpread:
    """How a magnification spreads over the mirror."""
    found: Extent | None = getattr(measured.magnification_extremes, name)
    if found is None:
        return MagnificationSpread()
    row, column = (int(np.argmin(np.abs(axis))) for axis in (measured.magnification.y, measured.magnification.x))
    values: Array = getattr(measured.magnification.magnification, name)
    return MagnificationSpread(_number(float(values[row, column])), found.least, found.largest)


def turned_figures(measured: Measured) -> TurnedFigures:
    """What a mirror shows while it is turned about its aim."""
    turned = measured.coverage
    side = -1.0 if measured.mirror.pose.hand == "left" else 1.0
    return TurnedFigures(np.degrees(turned.turns).round(9), side * (180.0 - np.degrees(turned.azimuth_from)),
                         side * (180.0 - np.degrees(turned.azimuth_to)), turned.blind_mm / MM, turned.endless)


def _box(body: Body) -> tuple[Array, Array]:
    return body.vertices.min(axis=0), body.vertices.max(axis=0)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
