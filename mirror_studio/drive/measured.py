"""A mirror on the vehicle in its scene in, all that a designer decides by out: records to draw, and figures as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_cad.spec import Eye, SceneSpec
from mirror_studio.drive.mirrors import DrivenMirror
from mirror_studio.drive.world import MM
from mirror_studio.scene_file import SceneFile
from raytrace.errors import TraceError
from raytrace.measures.angular_size import AngularSize, Face, angular_sizes
from raytrace.measures.blind_zone import BlindZone, HiddenCar, NearLane, blind_zone, hidden_car
from raytrace.measures.column_tilt import Tilt, column_tilt
from raytrace.measures.disparity import Disparity, disparity
from raytrace.measures.eye_fields import EyeFields, extent, eye_fields
from raytrace.measures.field_of_view import GlassSheets
from raytrace.measures.grid_distortion import GridDistortion, grid_distortion
from raytrace.measures.ground import (
    Ground,
    HorizonMargin,
    SeenWidth,
    horizon_margin,
    nearest_at_flank,
    seen_ground,
    seen_widths,
)
from raytrace.measures.lane import StraightLane, lane_straightness
from raytrace.measures.line_bow import MIN_SAMPLES, Bow, line_bow
from raytrace.measures.magnification import (
    Extent,
    MagnificationExtremes,
    MagnificationMap,
    magnification_extremes,
    magnification_map,
)
from raytrace.measures.road_straightness import RoadStraightness, road_straightness
from raytrace.measures.yaw_coverage import YawCoverage, yaw_coverage
from raytrace.scene.bodies import Body
from raytrace.viewing.eye import eye_position
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import View, box_of
from raytrace.visibility.line_image import StraightLine, Unmeasured, column, road_line, why_unmeasured
from raytrace.visibility.orientation import Orientation, orientation

Array = NDArray[np.float64]

WAYS = {"upright": "upright", "inverted": "upside down and left for right", "reversed": "turned over in one direction",
        "mixed": "some things twice"}
LOCAL = ("aim", "image", "magnification", "turned")  # these hold where things are shown twice
ASKED_AT = ("distance_m", "at_m", "height_m")  # what a figure of a list is measured at
TURNS = np.radians(np.arange(-10.0, 10.5, 1.0))  # of the yaw, about the aim


@dataclass(frozen=True, slots=True)
class Subject:
    """What a scene's measures are of, mm: the lane beside, its line, the fronts of one vehicle at some distances, a column."""

    lane: NearLane
    line_y: float | None
    face: Face | None
    distances: tuple[float, ...]
    column: tuple[float, float, float] | None
    widths_at: tuple[float, ...]
    direct_view: float
    hidden_height: float


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured of one mirror; see each record for its definition."""

    mirror: DrivenMirror
    subject: Subject
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


def subject_of(scene: SceneFile, bodies: Mapping[str, Body]) -> Subject:
    """What the scene has measured, with the sizes that its named vehicle and column have.

    bodies : the scene's bodies by the name they were given, in their places.
    """
    asked = scene.measured
    face = None
    if asked.vehicle is not None:
        low, high = _box(bodies[asked.vehicle])
        face = Face(float(high[1] - low[1]), float(high[2]), float(0.5 * (low[1] + high[1])))
    upright = None
    if asked.column is not None:
        low, high = _box(bodies[asked.column])
        upright = (float(0.5 * (low[0] + high[0])), float(0.5 * (low[1] + high[1])), float(high[2]))
    line_y = MM * asked.line_y_m if scene.road is not None else None  # without a road there is no line on it
    return Subject(NearLane(MM * asked.lane_m[0], MM * asked.lane_m[1]), line_y, face,
                   tuple(MM * one for one in asked.distances_m), upright, tuple(MM * one for one in asked.widths_at_m),
                   math.radians(asked.direct_view_deg), MM * asked.hidden_height_m)


def measure(mirror: DrivenMirror, subject: Subject) -> Measured:
    """All measures of a mirror."""
    views, own = mirror.views, mirror.own
    middle, left, right = views.middle, views.left, views.right
    line = None if subject.line_y is None else road_line(subject.line_y)
    bow, straightness = (line_bow(middle, line, own), road_straightness(middle, line, own)) if line else (None, None)
    blind = tuple(blind_zone(left, right, own, subject.lane, height, subject.direct_view)
                  for height in (0.0, subject.hidden_height))
    return Measured(
        mirror, subject, horizon_margin(middle, own), magnification_map(middle), magnification_extremes(middle),
        disparity(views),
        eye_fields(views, own), grid_distortion(middle),
        angular_sizes(middle, subject.face, subject.distances, own) if subject.face else (),
        bow, straightness, _line_unmeasured(middle, line, own, bow, straightness),
        plane_straightness(mirror),
        column_tilt(middle, column(*subject.column), own) if subject.column else None,
        seen_ground(left, right, own), seen_widths(left, right, own, subject.widths_at), nearest_at_flank(left, right, own),
        blind, hidden_car(blind, subject.lane),
        yaw_coverage(mirror.reflector, mirror.pose, mirror.eyes, own, subject.lane, TURNS, 0.0, subject.direct_view),
        shown_round(views))


def _line_unmeasured(view: View, line: StraightLine | None, own: HostVehicle, bow: Bow | None,
                     straightness: RoadStraightness | None) -> Unmeasured | None:
    """Why a figure of the lane line is missing; None where none is, or where there is no line."""
    if line is None or (bow is not None and straightness is not None):
        return None
    return why_unmeasured(view, line, own, MIN_SAMPLES) or "level or upright at its far end"


def shown_round(views: EyeViews) -> Orientation:
    """Which way round the mirror shows things, from between the eyes; `twice` if it shows any of them twice to an eye."""
    middle = orientation(views.middle)
    return replace(middle, twice=middle.twice or (middle.converging and any(orientation(view).twice
                                                                           for view in (views.left, views.right))))


def plane_straightness(mirror: DrivenMirror) -> float | None:
    """The paper's lane straightness, percent: of the lane on the reference plane, with the eye where the mirror's
    specification has it and the mirror not turned. None for a mirror that is no single sheet z(x, y), and for one in which
    the lane does not cross both edges."""
    only, sheets = mirror.whole.only, GlassSheets.before(mirror.whole)
    if only is None or only.height_field is None or (mirror.whole.glass is not None and sheets is None):
        return None
    box = box_of(mirror.whole)
    seat, scene = (mirror.spec.eye, mirror.spec.scene) if mirror.spec is not None else (Eye(), SceneSpec())
    eye = eye_position(seat.distance_mm, seat.aligned, box)
    lane = StraightLane(scene.lane.x0_mm, scene.lane.y0_mm, scene.lane.slope, float(eye[2]) + scene.distance_mm)
    return lane_straightness(sheets or only.surface, eye, lane, box)


def main_figures(mirror: DrivenMirror, subject: Subject) -> dict[str, float | bool | None]:
    """The figures whose changes are worth following while a mirror is turned or bent; None for what it does not show.
    blind_endless : whether the blind zone goes on where looking ends."""
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
    blind = blind_zone(views.left, views.right, mirror.own, subject.lane, 0.0, subject.direct_view)
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
    return found


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
    """What a mirror shows while it is turned about its aim. Azimuths from straight rearward, positive to the vehicle's right,
    as those of the fields are."""
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
