"""A mirror with its deviation and file checks in, every requirement with limit, actual value, margin and place out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, cast

from mirror_cad.deviation import CurvatureDeviation
from mirror_cad.mirror import Mirror
from mirror_studio.report.stages import NUMERICAL, STAGE_NAMES
from mirror_studio.report.tables import Table
from raytrace.measures.registry import registered

Place = tuple[float, float]
Side = Literal["size", "least", "most"]

# Of [limits] and metrics.json: key, which of its figures is meant, name, unit.
VIEW = (("h_fov_deg", "section", "horizontal field of view, section", "°"),
        ("v_fov_left_deg", "section", "vertical field of view at the left edge, section", "°"),
        ("lane_straightness_percent", "traced", "lane straightness, traced", "%"))


@dataclass(frozen=True, slots=True)
class Requirement:
    """One line of the verdict table; limit is None where nothing is asked, actual NaN where it cannot be measured.

    group : "part", "view", "numerical" or "files".   side : whether `limit` holds for the size of `actual`, which may be
    signed, or is the least or the most that it may be.
    """

    group: str
    name: str
    unit: str
    limit: float | None
    actual: float
    place: Place | None = None
    side: Side = "size"

    @property
    def margin(self) -> float | None:
        """What is left of the limit; negative beyond it."""
        if self.limit is None:
            return None
        return self.actual - self.limit if self.side == "least" else self.limit - self.size

    @property
    def size(self) -> float:
        """What is held against the limit: the actual value, or its size."""
        return abs(self.actual) if self.side == "size" else self.actual

    @property
    def met(self) -> bool | None:
        return None if self.margin is None else self.margin >= 0.0


def requirements(mirror: Mirror, deviation: CurvatureDeviation, metrics: Mapping[str, Any]) -> list[Requirement]:
    """Part, view, numerics and files, in this order. Where the design is flat, curvature is in 1/m and has no limit."""
    return [*_of_part(mirror, deviation), *view_requirements(mirror, metrics),
            *_of_numerics(mirror, deviation), *_of_files(mirror, deviation, metrics)]


def verdict_rows_table(rows: list[Requirement]) -> Table:
    """A row a requirement."""
    return Table("verdicts", {
        "group": [row.group for row in rows], "requirement": [row.name for row in rows], "unit": [row.unit for row in rows],
        "side": [row.side for row in rows], "limit": [row.limit for row in rows],
        "actual": [row.actual for row in rows], "margin": [row.margin for row in rows],
        "x_mm": [row.place and row.place[0] for row in rows], "y_mm": [row.place and row.place[1] for row in rows],
        "met": [row.met for row in rows]})


def view_requirements(mirror: Mirror, metrics: Mapping[str, Any]) -> list[Requirement]:
    """What [limits] asks of fields of view and lane: a row for each side that is not free."""
    rows = []
    limits, figures = mirror.spec.limits, metrics.get("measures") or {}
    asked_for = [(getattr(limits, key), (metrics.get(key) or {}).get(kind), name, unit) for key, kind, name, unit in VIEW]
    known = registered() if limits.by_name() else {}
    asked_for += [(asked, figures.get(key), known[key].title, known[key].unit) for key, asked in limits.by_name().items()]
    for asked, actual, name, unit in asked_for:
        for side, limit in zip(("least", "most"), asked or (), strict=False):
            if math.isfinite(limit):
                rows.append(Requirement("view", name, unit, limit, math.nan if actual is None else actual,
                                        side=cast("Side", side)))
    return rows


def as_json(rows: list[Requirement]) -> list[dict[str, Any]]:
    """Requirements as metrics.json has them."""
    return [{"requirement": row.name, "unit": row.unit, "side": row.side, "limit": row.limit, "met": row.met}
            | {key: None if value is None or math.isnan(value) else value
               for key, value in (("actual", row.actual), ("margin", row.margin))} for row in rows]


def _curvature(entry: Mapping[str, Any], key: str, limit_percent: float | None) -> tuple[str, float | None, float, Place]:
    value, place = entry[f"{key}_max_percent"], entry[f"{key}_max_at_mm"]
    if value is None:
        return "1/m", None, float(entry[f"{key}_max_per_m"]), (place[0], place[1])
    return "%", limit_percent, float(value), (place[0], place[1])


def _of_part(mirror: Mirror, deviation: CurvatureDeviation) -> list[Requirement]:
    if not mirror.spec.has_laws:
        return []
    limit = mirror.spec.limits.curvature_percent
    return [Requirement("part", f"{key}, realised against designed", *_curvature(deviation.total, key, limit))
            for key in ("k1", "k2")]


def _of_numerics(mirror: Mirror, deviation: CurvatureDeviation) -> list[Requirement]:
    asked, rows = mirror.spec.surface, []
    for stage in NUMERICAL:
        entry = deviation.stages[stage]
        sized = {key: _curvature(entry, key, asked.curvature_tolerance_percent) for key in ("k1", "k2")}
        worst = max(sized, key=lambda key: abs(sized[key][2]))
        rows += [Requirement("numerical", f"{STAGE_NAMES[stage]}: curvature ({worst})", *sized[worst]),
                 Requirement("numerical", f"{STAGE_NAMES[stage]}: height", "mm", asked.position_tolerance_mm,
                             entry["sag_max_mm"], tuple(entry["sag_max_at_mm"]))]
    return rows


def _of_files(mirror: Mirror, deviation: CurvatureDeviation, metrics: Mapping[str, Any]) -> list[Requirement]:
    from mirror_cad.surfaces.offset import OFFSET_SHARE, OFFSET_TOLERANCE_MM
    from mirror_studio.build.checks import SAME_MM, SAME_VOLUME

    files, plate, stl = metrics.get("files") or {}, metrics.get("plate") or {}, deviation.stages["stl"]
    other = "back" if mirror.spec.glass.reflecting == "front" else "front"
    offset = min(OFFSET_TOLERANCE_MM[other], OFFSET_SHARE * mirror.spec.glass.thickness_mm)
    found = (
        ("STEP read back by the kernel, farthest point", "mm", SAME_MM, files.get("step_max_mm")),
        ("STEP read as plain text (Part 21), farthest point", "mm", SAME_MM, files.get("part21_max_mm")),
        ("STEP, volume read back, relative change", "", SAME_VOLUME, files.get("volume_relative")),
        ("untrimmed sheet read back, farthest point", "mm", SAME_MM, files.get("sheet_max_mm")),
        ("outline read back from DXF, its box", "mm", SAME_MM, files.get("outline_box_mm")),
        ("STL, farthest facet from the surface", "mm", mirror.spec.export.stl_deflection_mm, stl["height_max_mm"]),
        (f"{other} of the plate against the true offset", "mm", offset, plate.get("back_error_mm")),
    )
    return [Requirement("files", name, unit, limit, float(actual)) for name, unit, limit, actual in found if actual is not None]
