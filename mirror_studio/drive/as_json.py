"""JSON of what was measured of mirrors on a vehicle: the content of measures.json."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mirror_studio.as_json import placement_as_json
from mirror_studio.drive.measured import (
    MAGNIFICATIONS,
    ORIENTATIONS,
    MainFigures,
    Measured,
    TurnedFigures,
    spread_of,
    turned_figures,
    value_of,
)
from mirror_studio.drive.world import MM
from mirror_studio.json_types import Json, JsonObject
from raytrace.measures.eye_fields import EyeFields, extent
from raytrace.measures.registry import measures_of

Array = NDArray[np.float64]

LOCAL = ("aim", "image", "magnification", "turned")  # these hold where things are shown twice
ASKED_AT = ("distance_m", "at_m", "height_m")  # what a figure of a list is measured at


def driven_as_json(measured: Measured, changes: Mapping[str, MainFigures], rays: Mapping[str, int]) -> JsonObject:
    """All that measures.json holds of a mirror.

    Parameters
    ----------
    measured
        Its figures.
    changes
        What its main figures become, by what was changed.
    rays
        How many rays of its picture had which status.
    """
    return {**figures_as_json(measured), "sensitivity": {name: dataclasses.asdict(one) for name, one in changes.items()},
            "rays": dict(rays), "placement": placement_as_json(measured.mirror.placement)}


def figures_as_json(measured: Measured) -> dict[str, Json]:
    """Every figure: a number, a list of numbers, or null for what the mirror does not show.

    Of a mirror that shows some things twice, all that is bounded by its edge or found by the inverse ray is null: it would be
    told wrongly (`raytrace.visibility.orientation`).
    """
    found = _figures(measured)
    if measured.orientation.twice:
        found |= {key: _unmeasured(value) for key, value in found.items() if key not in LOCAL}
    return found | {"measures": {name: value_of(measured, one) for name, one in measures_of(measured.use).items()}}


def _unmeasured(value: Json) -> Json:
    """The same keys with null for every figure, but for the places at which it is asked for."""
    if isinstance(value, dict):
        return {key: one if key in ASKED_AT else _unmeasured(one) for key, one in value.items()}
    return [_unmeasured(one) for one in value] if isinstance(value, list) and value and isinstance(value[0], dict) else None


def _figures(measured: Measured) -> dict[str, Json]:
    grid, bow, tilt = measured.grid, measured.bow, measured.tilt
    disparity_ = measured.disparity
    return {
        "aim": _aim(measured),
        "image": {"way": ORIENTATIONS[measured.orientation.sense], "twice": measured.orientation.twice},
        "field_deg": _fields(measured.fields),
        "magnification": {name: dataclasses.asdict(spread_of(measured, name)) for name in MAGNIFICATIONS},
        "disparity": {"max_percent": disparity_.max_percent, "max_at_mm": disparity_.max_at_mm,
                      "max_rate_percent_per_mm": disparity_.max_rate_percent_per_mm,
                      "max_rate_at_mm": disparity_.max_rate_at_mm},
        "angular_size": [{"distance_m": one.distance_mm / MM, **{
            f"{kind}_arcmin": _size(getattr(one, kind)) for kind in ("mirror", "flat", "direct")}} for one in measured.sizes],
        "lane_line": {"bow_arcmin": None if bow is None else bow.arcmin,
                      "extent_arcmin": None if bow is None else bow.extent_arcmin,
                      "straightness_percent": None if measured.straightness is None else measured.straightness.percent,
                      "reference_plane_percent": measured.plane_straightness_percent,
                      "unmeasured": measured.line_unmeasured},
        "column": {"tilt_arcmin": None if tilt is None else tilt.arcmin,
                   "flat_tilt_arcmin": None if tilt is None else tilt.flat_arcmin,
                   "own_tilt_arcmin": None if tilt is None else tilt.by_curvature_arcmin},
        "grid": {"rms_arcmin": grid.rms_arcmin, "max_arcmin": grid.max_arcmin, "max_at_deg": grid.max_at_deg,
                 "rms_percent": grid.rms_percent, "max_percent": grid.max_percent, "nodes": int(grid.shown.sum())},
        "ground": {"seen_width_m": [{"at_m": one.x_mm / MM, "either": one.either_mm / MM, "both": one.both_mm / MM}
                                    for one in measured.widths],
                   "nearest_at_flank_m": {"either": _metres(measured.nearest_mm[0]), "both": _metres(measured.nearest_mm[1])}},
        "blind_zone": _blind(measured),
        "turned": _turned(turned_figures(measured)),
    }


def _aim(measured: Measured) -> dict[str, Json]:
    pose, margin = measured.mirror.pose, measured.margin
    return {"yaw_deg": math.degrees(pose.yaw), "pitch_deg": math.degrees(pose.pitch),
            "flank_share": _number(measured.margin.aim.flank), "horizon_share": _number(measured.margin.aim.horizon),
            "above_horizon_share": _number(margin.height), "above_horizon_deg": _number(math.degrees(margin.angle)),
            "horizon_whole": margin.whole}


def _fields(fields: EyeFields) -> dict[str, Json]:
    eyes = ("left", "right", "either", "both")
    return {"between_edges": fields.between_edges_deg[1],
            **{f"horizon_{eye}": extent(getattr(fields.horizon_clear, eye)) for eye in eyes},
            "upright_either": None if fields.upright_clear is None else extent(fields.upright_clear.either),
            "azimuths": {eye: [list(one) for one in getattr(fields.horizon_clear, eye)] for eye in eyes}}


def _size(seen: tuple[float, float] | None) -> JsonObject | None:
    return None if seen is None else {"width": float(seen[0]), "height": float(seen[1])}


def _blind(measured: Measured) -> dict[str, Json]:
    zones = [{"height_m": zone.height_mm / MM, "length_m": zone.length_mm / MM, "area_m2": zone.area_mm2 / MM**2,
              "along_middle_m": (zone.middle / MM).tolist(), "endless": zone.endless} for zone in measured.blind]
    return {"at": zones, "longest_hidden_car_m": measured.hidden.longest_mm / MM, "hides_a_car": measured.hidden.hides}


def _turned(turned: TurnedFigures) -> JsonObject:
    return {"yaw_deg": turned.yaw_deg.tolist(), "azimuth_from_deg": _numbers(turned.azimuth_from_deg),
            "azimuth_to_deg": _numbers(turned.azimuth_to_deg), "blind_length_m": _numbers(turned.blind_length_m),
            "blind_endless": turned.blind_endless.tolist()}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _metres(value: float) -> float | None:
    return _number(value / MM)


def _numbers(values: Array) -> list[float | None]:
    return [_number(value) for value in values.tolist()]
