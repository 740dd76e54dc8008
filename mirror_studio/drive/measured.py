"""Measure all that a designer decides by, of a mirror on the vehicle in its scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_cad.mirror import design
from mirror_cad.spec import Eye, SceneSpec
from mirror_studio.drive.mirrors import DrivenMirror
from mirror_studio.drive.world import MM
from mirror_studio.scene_file import SceneFile
from raytrace.errors import TraceError
from raytrace.measures.angular_size import AngularSize, Face, sizes_in_use
from raytrace.measures.blind_zone import BlindZone, HiddenCar, NearLane, blind_zone
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
from raytrace.measures.hiding import blind_zones_in_use, hidden_in_use
from raytrace.measures.in_use import Asked, MirrorInUse, OnVehicle
from raytrace.measures.lane import Lane, lane_in_use
from raytrace.measures.line_bow import Bow, bow_in_use
from raytrace.measures.magnification import (
    Extent,
    MagnificationExtremes,
    MagnificationMap,
    extremes_in_use,
    map_in_use,
)
from raytrace.measures.registry import Measure, measures_of
from raytrace.measures.road_straightness import RoadStraightness, line_unmeasured_in_use, straightness_in_use
from raytrace.measures.yaw_coverage import YawCoverage, yaw_coverage
from raytrace.scene.bodies import Body
from raytrace.viewing.eye import eye_position
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.pose import Pose
from raytrace.viewing.view import View, box_of
from raytrace.visibility.line_image import Unmeasured
from raytrace.visibility.orientation import Orientation, orientation

Array = NDArray[np.float64]

WAYS = {"upright": "upright", "inverted": "upside down and left for right", "reversed": "turned over in one direction",
        "mixed": "some things twice"}
LOCAL = ("aim", "image", "magnification", "turned")  # these hold where things are shown twice
ASKED_AT = ("distance_m", "at_m", "height_m")  # what a figure of a list is measured at
TURNS = np.radians(np.arange(-10.0, 10.5, 1.0))  # of the yaw, about the aim


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured of one mirror; see each record for its definition, and `use` for the registered figures."""

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
    plane_straightness: float | None
    tilt: Tilt | None
    ground: Ground
    widths: tuple[SeenWidth, ...]
    nearest: tuple[float, float]
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
    whole = mirror.whole
    box = box_of(whole)
    seat, scene = (mirror.spec.eye, mirror.spec.scene) if mirror.spec is not None else (Eye(), SceneSpec())
    view = View(whole, Pose.identity(), eye_position(seat.distance_mm, seat.aligned, box))
    lane = Lane(scene.lane.x0_mm, scene.lane.y0_mm, scene.lane.slope, scene.distance_mm)
    vehicle = OnVehicle(mirror.reflector, mirror.pose, mirror.eyes, mirror.own, asked)
    if mirror.spec is None:
        return MirrorInUse(view, lane, vehicle=vehicle)
    designed = design(mirror.spec)
    horizontal, vertical = (math.degrees(angle) for angle in designed.section_fields_of_view())
    return MirrorInUse(view, lane, None, designed.left_height_mm, (horizontal, vertical), vehicle)


def measure(mirror: DrivenMirror, asked: Asked) -> Measured:
    """All measures of a mirror."""
    use = in_use(mirror, asked)
    views = mirror.views
    return Measured(
        mirror, use, asked, use.record(aim_in_use), use.record(map_in_use),
        use.record(extremes_in_use), use.record(disparity_in_use),
        use.record(fields_in_use), use.record(distortion_in_use), use.record(sizes_in_use), use.record(bow_in_use),
        use.record(straightness_in_use), use.record(line_unmeasured_in_use), use.record(lane_in_use).percent,
        use.record(tilt_in_use),
        seen_ground(views.left, views.right, mirror.own), use.record(widths_in_use), use.record(nearest_in_use),
        use.record(blind_zones_in_use), use.record(hidden_in_use),
        yaw_coverage(mirror.reflector, mirror.pose, mirror.eyes, mirror.own, asked.lane, TURNS, 0.0, asked.direct_view),
        shown_round(views))


def shown_round(views: EyeViews) -> Orientation:
    """Which way round the mirror shows things, from between the eyes; `twice` if it shows any of them twice to an eye."""
    middle = orientation(views.middle)
    return replace(middle, twice=middle.twice or (middle.converging and any(orientation(view).twice
                                                                           for view in (views.left, views.right))))


def main_figures(mirror: DrivenMirror, asked: Asked) -> dict[str, float | bool | None]:
    """The figures whose changes are worth following while a mirror is turned or bent.

    None for what it does not show. blind_endless : whether the blind zone goes on where looking ends.
    """
    found: dict[str, float | bool | None] = dict.fromkeys(
        ("horizon_either_deg", "flank_share", "horizon_share", "width_at_20_m", "blind_length_m", "blind_endless"))
    try:
        views = mirror.views
    except TraceError:  # turned away from an eye
        return found
    aim = mirror.shown()
    found |= {"flank_share": _number(aim.flank), "horizon_share": _number(aim.horizon)}
    if shown_round(views).twice:
        return found
    blind = blind_zone(views.left, views.right, mirror.own, asked.lane, 0.0, asked.direct_view)
    width = seen_widths(views.left, views.right, mirror.own, (20_000.0,))[0]
    return found | {"horizon_either_deg": extent(eye_fields(views, mirror.own).horizon_clear.either),
                    "width_at_20_m": width.either_mm / MM, "blind_length_m": blind.length_mm / MM,
                    "blind_endless": blind.endless}


def figures(measured: Measured) -> dict[str, Any]:
    """Every figure, as measures.json holds it: a number, a list of numbers, or null for what the mirror does not show.

    Of a mirror that shows some things twice, all that is bounded by its edge or found by the inverse ray is null: it would be
    told wrongly (`raytrace.visibility.orientation`).
    """
    found = _figures(measured)
    if measured.orientation.twice:
        found |= {key: _unmeasured(value) for key, value in found.items() if key not in LOCAL}
    return found | {"measures": {name: value_of(measured, one) for name, one in measures_of(measured.use).items()}}


def value_of(measured: Measured, measure: Measure) -> float | None:
    """A registered figure of a mirror; None for what it does not show, and for what would be told wrongly of it."""
    if measured.orientation.twice and not measure.local:
        return None
    return measure.value(measured.use)


def _unmeasured(value: Any) -> Any:
    """The same keys with null for every figure, but for the places at which it is asked for."""
    if isinstance(value, dict):
        return {key: one if key in ASKED_AT else _unmeasured(one) for key, one in value.items()}
    return [_unmeasured(one) for one in value] if isinstance(value, list) and value and isinstance(value[0], dict) else None


def _figures(measured: Measured) -> dict[str, Any]:
    size, grid, bow, tilt = measured.magnification.magnification, measured.grid, measured.bow, measured.tilt
    row, column_of = (int(np.argmin(np.abs(axis))) for axis in (measured.magnification.y, measured.magnification.x))
    disparity_ = measured.disparity
    return {
        "aim": _aim(measured),
        "image": {"way": WAYS[measured.orientation.way], "twice": measured.orientation.twice},
        "field_deg": _fields(measured.fields),
        "magnification": {name: _spread(values, row, column_of, getattr(measured.magnification_extremes, name))
                          for name, values in (("horizontal", size.horizontal), ("vertical", size.vertical),
                                               ("ratio", size.ratio))},
        "disparity": {"max_percent": disparity_.max_percent, "max_at_mm": disparity_.max_at_mm,
                      "max_rate_percent_per_mm": disparity_.max_rate_percent_per_mm,
                      "max_rate_at_mm": disparity_.max_rate_at_mm},
        "angular_size": [{"distance_m": one.distance_mm / MM, **{
            f"{way}_arcmin": _size(getattr(one, way)) for way in ("mirror", "flat", "direct")}} for one in measured.sizes],
        "lane_line": {"bow_arcmin": bow and bow.arcmin, "extent_arcmin": bow and bow.extent_arcmin,
                      "straightness_percent": measured.straightness and measured.straightness.percent,
                      "reference_plane_percent": measured.plane_straightness,
                      "unmeasured": measured.line_unmeasured},
        "column": {"tilt_arcmin": tilt and tilt.arcmin, "flat_tilt_arcmin": tilt and tilt.flat_arcmin,
                   "own_tilt_arcmin": tilt and tilt.own_arcmin},
        "grid": {"rms_arcmin": grid.rms_arcmin, "max_arcmin": grid.max_arcmin, "max_at_deg": grid.max_at_deg,
                 "rms_percent": grid.rms_percent, "max_percent": grid.max_percent, "nodes": int(grid.shown.sum())},
        "ground": {"seen_width_m": [{"at_m": one.x_mm / MM, "either": one.either_mm / MM, "both": one.both_mm / MM}
                                    for one in measured.widths],
                   "nearest_at_flank_m": {"either": _metres(measured.nearest[0]), "both": _metres(measured.nearest[1])}},
        "blind_zone": _blind(measured),
        "turned": turned_figures(measured),
    }


def _aim(measured: Measured) -> dict[str, Any]:
    pose, margin = measured.mirror.pose, measured.margin
    return {"yaw_deg": math.degrees(pose.yaw), "pitch_deg": math.degrees(pose.pitch),
            "flank_share": _number(measured.margin.aim.flank), "horizon_share": _number(measured.margin.aim.horizon),
            "above_horizon_share": _number(margin.height), "above_horizon_deg": _number(math.degrees(margin.angle)),
            "horizon_whole": margin.whole}


def _fields(fields: EyeFields) -> dict[str, Any]:
    eyes = ("left", "right", "either", "both")
    return {"between_edges": fields.between_edges_deg[1],
            **{f"horizon_{eye}": extent(getattr(fields.horizon_clear, eye)) for eye in eyes},
            "upright_either": None if fields.upright_clear is None else extent(fields.upright_clear.either),
            "azimuths": {eye: [list(one) for one in getattr(fields.horizon_clear, eye)] for eye in eyes}}


def _size(seen: tuple[float, float] | None) -> dict[str, float] | None:
    return None if seen is None else {"width": float(seen[0]), "height": float(seen[1])}


def _blind(measured: Measured) -> dict[str, Any]:
    zones = [{"height_m": zone.height_mm / MM, "length_m": zone.length_mm / MM, "area_m2": zone.area_mm2 / MM**2,
              "along_middle_m": (zone.middle / MM).tolist(), "endless": zone.endless} for zone in measured.blind]
    return {"at": zones, "longest_hidden_car_m": measured.hidden.longest_mm / MM, "hides_a_car": measured.hidden.hides}


def turned_figures(measured: Measured) -> dict[str, Any]:
    """What a mirror shows while it is turned about its aim.

    Azimuths from straight rearward, positive to the vehicle's right, as those of the fields are.
    """
    turned = measured.coverage
    side = -1.0 if measured.mirror.pose.hand == "left" else 1.0
    return {"yaw_deg": np.degrees(turned.turns).round(9).tolist(),
            "azimuth_from_deg": _numbers(side * (180.0 - np.degrees(turned.azimuth_from))),
            "azimuth_to_deg": _numbers(side * (180.0 - np.degrees(turned.azimuth_to))),
            "blind_length_m": _numbers(turned.blind_mm / MM), "blind_endless": turned.endless.tolist()}


def _spread(values: Array, row: int, column_of: int, extent_: Extent | None) -> dict[str, Any]:
    """In the middle, and from the least to the largest over what is seen."""
    if extent_ is None:
        return {"middle": None, "least": None, "largest": None}
    return {"middle": _number(float(values[row, column_of])), "least": extent_.least, "largest": extent_.largest}


def _box(body: Body) -> tuple[Array, Array]:
    return body.vertices.min(axis=0), body.vertices.max(axis=0)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _metres(value: float) -> float | None:
    return _number(value / MM)


def _numbers(values: Array) -> list[float | None]:
    return [_number(value) for value in values.tolist()]
