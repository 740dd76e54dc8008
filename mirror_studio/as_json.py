"""JSON of the records that the files of a mirror hold: the one place that knows the keys of the contract."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from mirror_studio.json_types import Json, JsonObject

if TYPE_CHECKING:
    from mirror_cad.deviation import Deviation
    from mirror_cad.mirror import Mirror
    from mirror_cad.stage_deviation import StageDeviation
    from mirror_cad.surfaces.faithful import Faithful
    from mirror_studio.build.results import (
        FieldOfView,
        FileChecks,
        GlassFigures,
        LaneFigures,
        Manifest,
        MethodComparison,
        MethodFigures,
        Metrics,
        OnPlane,
        PaperRow,
        TraceMetrics,
    )
    from mirror_studio.build.wanted import TargetFigures
    from mirror_studio.report.requirement import Requirement
    from raytrace.placement import Placement

CURVATURES = ("k1", "k2", "kx", "ky", "twist", "shape")


def deviation_as_json(deviation: Deviation, target: TargetFigures | None = None) -> JsonObject:
    """The content of deviation.json.

    A mirror without laws has no model to deviate from them, and no total, but what it misses of the view that it was made for.
    """
    stages = deviation.stages
    content: dict[str, Json] = {
        "stages": {**{name: stage_as_json(getattr(stages, name)) for name in ("model", "integration", "fit", "step")},
                   "stl": dataclasses.asdict(stages.stl)},
        "total": stage_as_json(deviation.total),
        "verdicts": {"numerical": deviation.numerical, "part": deviation.part}}
    if not deviation.of_laws:
        content["stages"] = {**{name: stage_as_json(getattr(stages, name)) for name in ("integration", "fit", "step")},
                             "stl": dataclasses.asdict(stages.stl), "model": None}
        content["total"] = None
    return content if target is None else content | {"target": dataclasses.asdict(target)}


def stage_as_json(stage: StageDeviation) -> dict[str, Json]:
    """One entry of deviation.json: k1_max_percent … slope_max_at_mm."""
    content: dict[str, Json] = {}
    for name in CURVATURES:
        content |= {f"{name}_{key}": value for key, value in dataclasses.asdict(getattr(stage, name)).items()}
    return content | {"sag_max_mm": stage.sag_max_mm, "sag_max_at_mm": stage.sag_max_at_mm,
                      "slope_max_arcsec": stage.slope_max_arcsec, "slope_max_at_mm": stage.slope_max_at_mm}


def metrics_as_json(metrics: Metrics) -> JsonObject:
    """The content of metrics.json; what was not measured is null, and glass and limits are left out where there are none."""
    explained, chain = metrics.explained, metrics.ray_deviation
    content: dict[str, Json] = {
        "h_fov_deg": field_as_json(metrics.h_fov_deg),
        "v_fov_left_deg": field_as_json(metrics.v_fov_left_deg),
        "lane_straightness_percent": lane_as_json(metrics.lane_straightness_percent),
        "stl_on_plane_mm": _on_plane(metrics.stl_on_plane),
        "stl_interpolated_on_plane_mm": _on_plane(metrics.stl_interpolated_on_plane),
        "measures": dict(metrics.measures),
        "error_budget": {"explained": None if explained is None else dataclasses.asdict(explained),
                         "chain_arcmin": None if chain is None else dataclasses.asdict(chain)},
        "methods": None if metrics.methods is None else comparison_as_json(metrics.methods),
        "rays": dict(metrics.rays),
        "eye_mm": metrics.eye_mm,
        "plate": None if metrics.plate is None else dataclasses.asdict(metrics.plate),
        "files": None if metrics.files is None else _files(metrics.files),
    }
    if metrics.glass is not None:
        content["glass"] = _glass(metrics.glass)
    if metrics.target is not None:
        content["target"] = dataclasses.asdict(metrics.target)
        del content["methods"]
    if metrics.limits:
        content["limits"] = requirements_as_json(metrics.limits)
    if metrics.rules is not None:
        rule = metrics.rules.rule
        content["rules"] = {"rule": rule.rule, "edition": rule.edition, "class": metrics.rules.class_name,
                            "lines": [line.as_json() for line in metrics.rules.lines]}
    return content


def trace_metrics_as_json(metrics: TraceMetrics) -> JsonObject:
    """The content of metrics.json of a traced file."""
    return {"h_fov_deg": {"traced": metrics.h_fov_deg},
            "lane_straightness_percent": lane_as_json(metrics.lane_straightness_percent),
            "rays": dict(metrics.rays), "normals_from": metrics.normals_from,
            "eye_mm": metrics.eye_mm, "box_mm": metrics.box_mm, "placement": placement_as_json(metrics.placement)}


def placement_as_json(placement: Placement) -> JsonObject:
    """Where a mirror is in its file."""
    origin, normal, up = ([float(v) for v in vector] for vector in (placement.origin_mm, placement.normal, placement.up))
    frame: dict[str, Json] = {"origin_mm": origin, "normal": normal, "up": up, "from": placement.source}
    return frame if placement.hand == "left" else frame | {"hand": placement.hand}


def manifest_as_json(mirror: Mirror, manifest: Manifest) -> JsonObject:
    """The content of manifest.json."""
    from mirror_studio.build.checks import SAME_MM

    spec, fit = mirror.spec, mirror.fit
    return {
        "schema": 1,
        "spec": manifest.spec,
        "versions": dict(manifest.versions),
        "tolerances": {"position_mm": spec.surface.position_tolerance_mm,
                       "curvature_percent": spec.surface.curvature_tolerance_percent,
                       "stl_deflection_mm": spec.export.stl_deflection_mm, "back_mm": 1e-3, "read_back_mm": SAME_MM},
        "fit": {"route": fit.route, "degree": fit.degree, "spans": fit.spans,
                "position_error_mm": fit.position_error_mm, "curvature_error_percent": fit.curvature_error_percent,
                "worst_at_mm": fit.worst_at_mm, "met": fit.met},
        "faithful": floor_as_json(mirror.faithful),
        "matched": {mirror.matched[0]: mirror.matched[1]} if mirror.matched else None,
        "notes": manifest.notes,
        "files": dict(manifest.files),
    }


def field_as_json(found: FieldOfView) -> JsonObject:
    """A field of view as metrics.json has it."""
    return {"section": found.section, "traced": found.traced}


def lane_as_json(found: LaneFigures) -> JsonObject:
    """The lane's straightness as metrics.json has it."""
    return {"traced": found.traced, "image": found.image}


def comparison_as_json(methods: MethodComparison) -> JsonObject:
    """Both methods side by side as metrics.json has them."""
    return {"decoupled": method_as_json(methods.decoupled), "faithful": method_as_json(methods.faithful),
            "change": dataclasses.asdict(methods.change), "floor": floor_as_json(methods.floor)}


def method_as_json(found: MethodFigures) -> dict[str, Json]:
    """One method's figures as metrics.json has them."""
    entry = stage_as_json(found.deviation)
    content = {f"{name}_{kind}_percent": entry[f"{name}_{kind}_percent"] for name in CURVATURES for kind in ("max", "rms")}
    return content | {"h_fov_deg": found.h_fov_deg, "v_fov_left_deg": found.v_fov_left_deg,
                      "lane_straightness_percent": found.lane_straightness_percent}


def floor_as_json(faithful: Faithful | None) -> JsonObject | None:
    """How the faithful surface's deviation fell with its spans, and whether it settled."""
    if faithful is None:
        return None
    return {"settled": faithful.settled, "degree": faithful.degree,
            "levels": [{"spans": level.spans, "unknowns": level.unknowns, "evaluations": level.evaluations,
                        "shape_rms_percent": level.shape_rms_percent} for level in faithful.levels]}


def requirements_as_json(rows: Sequence[Requirement]) -> list[JsonObject]:
    """Requirements as metrics.json has them; an actual value that could not be measured is null."""
    return [{"requirement": row.name, "unit": row.unit, "side": row.side, "limit": row.limit, "met": row.met}
            | {key: None if value is None or math.isnan(value) else value
               for key, value in (("actual", row.actual), ("margin", row.margin))} for row in rows]


def table1_as_json(table: Mapping[str, PaperRow]) -> JsonObject:
    """The content of table1.json."""
    return {name: dataclasses.asdict(row) for name, row in table.items()}


def _on_plane(found: OnPlane) -> JsonObject:
    return {"max": found.max_mm, "rms": found.rms_mm, "rays": found.rays}


def _files(found: FileChecks) -> JsonObject:
    return {**found.step._asdict(), "sheet_max_mm": found.sheet_max_mm, "outline_box_mm": found.outline_box_mm,
            "points": float(found.points)}


def _glass(found: GlassFigures) -> JsonObject:
    ghost = found.ghost
    return {"reflecting": found.reflecting, "index": found.index,
            "ghost_arcmin": {"max": ghost.max_arcmin, "max_at_mm": ghost.max_at_mm, "mean": ghost.mean_arcmin,
                             "rays": ghost.rays},
            "front_reflectance": {"mean": ghost.front_mean, "max": ghost.front_max},
            "image_reflectance": {"mean": ghost.image_mean},
            "h_fov_added_deg": found.h_fov_added_deg}
