"""Every requirement on a mirror with its limit, actual value, margin and point."""

from __future__ import annotations

import math

from mirror_cad.deviation import Deviation
from mirror_cad.mirror import Mirror
from mirror_cad.stage_deviation import QuantityDeviation
from mirror_studio.build.results import Metrics
from mirror_studio.report.requirement import Point, Requirement, Side
from mirror_studio.report.stages import numerical_stages
from mirror_studio.report.tables import Table
from mirror_studio.rules.of_spec import SpecRules
from raytrace.measures.registry import registered

ENDS: tuple[Side, Side] = ("least", "most")


def requirements(mirror: Mirror, deviation: Deviation, metrics: Metrics) -> list[Requirement]:
    """Part, view, rules, numerics and files, in this order. Where the design is flat, curvature is in 1/m without limit."""
    return [*_of_part(mirror, deviation), *view_requirements(mirror, metrics), *rule_requirements(metrics.rules),
            *_of_numerics(mirror, deviation), *_of_files(mirror, deviation, metrics)]


def verdict_rows_table(rows: list[Requirement]) -> Table:
    """A row a requirement."""
    return Table("verdicts", {
        "group": [row.group for row in rows], "requirement": [row.name for row in rows], "unit": [row.unit for row in rows],
        "side": [row.side for row in rows], "limit": [row.limit for row in rows],
        "actual": [row.actual for row in rows], "margin": [row.margin for row in rows],
        "x_mm": [row.point and row.point[0] for row in rows], "y_mm": [row.point and row.point[1] for row in rows],
        "met": [row.met for row in rows]})


def view_requirements(mirror: Mirror, metrics: Metrics) -> list[Requirement]:
    """What [limits] asks of fields of view and lane: a row for each side that is not free."""
    rows = []
    limits, figures = mirror.spec.limits, metrics.measures
    asked_for: list[tuple[tuple[float, float] | None, float | None, str, str]] = [
        (limits.h_fov_deg, metrics.h_fov_deg.section, "horizontal field of view, section", "°"),
        (limits.v_fov_left_deg, metrics.v_fov_left_deg.section, "vertical field of view at the left edge, section", "°"),
        (limits.lane_straightness_percent, metrics.lane_straightness_percent.traced, "lane straightness, traced", "%")]
    known = registered() if limits.by_name() else {}
    asked_for += [(asked, figures.get(key), known[key].title, known[key].unit) for key, asked in limits.by_name().items()]
    for asked, actual, name, unit in asked_for:
        for side, limit in zip(ENDS, asked or (), strict=False):
            if math.isfinite(limit):
                rows.append(Requirement("view", name, unit, limit, math.nan if actual is None else actual, side=side))
    return rows


def rule_requirements(named: SpecRules | None) -> list[Requirement]:
    """The lines of the rule of the road that the specification names: a row for each end of a limit."""
    if named is None:
        return []
    rows = []
    for line in named.lines:
        asked = line.asked
        name = f"{named.rule.rule} {named.class_name}, {asked.paragraph}: {asked.text}"
        flat = line.value is None and line.verdict != "open"  # no other value has no end
        if line.limit[0] == math.inf:  # flat is asked for: as curvature that has an end
            rows.append(Requirement("rules", name, "1/m", 0.0, 0.0 if flat else 1e3 / (line.value or math.nan),
                                    ruled=line.verdict))
            continue
        actual = math.inf if flat else math.nan if line.value is None else line.value
        unit = "" if asked.unit == "1" else asked.unit
        # A least value of 0 asks for nothing.
        rows += [Requirement("rules", name, unit, end, actual, side=side, ruled=line.verdict)
                 for side, end in zip(ENDS, line.limit, strict=True) if math.isfinite(end) and (side, end) != ("least", 0.0)]
    return rows


def _curvature(found: QuantityDeviation, limit_percent: float | None) -> tuple[str, float | None, float, Point]:
    if found.max_percent is None:
        return "1/m", None, found.max_per_m, found.max_at_mm
    return "%", limit_percent, found.max_percent, found.max_at_mm


def _of_part(mirror: Mirror, deviation: Deviation) -> list[Requirement]:
    if not mirror.spec.has_laws:
        return []
    limit, total = mirror.spec.limits.curvature_percent, deviation.total
    return [Requirement("part", f"{key}, realised against designed", *_curvature(found, limit))
            for key, found in (("k1", total.k1), ("k2", total.k2))]


def _of_numerics(mirror: Mirror, deviation: Deviation) -> list[Requirement]:
    asked, rows = mirror.spec.surface, []
    for name, stage in numerical_stages(deviation):
        sized = {key: _curvature(found, asked.curvature_tolerance_percent)
                 for key, found in (("k1", stage.k1), ("k2", stage.k2))}
        worst = max(sized, key=lambda key: abs(sized[key][2]))
        rows += [Requirement("numerical", f"{name}: curvature ({worst})", *sized[worst]),
                 Requirement("numerical", f"{name}: height", "mm", asked.position_tolerance_mm,
                             stage.sag_max_mm, stage.sag_max_at_mm)]
    return rows


def _of_files(mirror: Mirror, deviation: Deviation, metrics: Metrics) -> list[Requirement]:
    from mirror_cad.surfaces.offset import OFFSET_SHARE, OFFSET_TOLERANCE_MM
    from mirror_studio.build.checks import SAME_MM, SAME_VOLUME

    other = "back" if mirror.spec.glass.reflecting == "front" else "front"
    offset = min(OFFSET_TOLERANCE_MM[other], OFFSET_SHARE * mirror.spec.glass.thickness_mm)
    found: list[tuple[str, str, float, float | None]] = []
    if metrics.files is not None:
        step = metrics.files.step
        found += [
            ("STEP read back by the kernel, farthest point", "mm", SAME_MM, step.step_max_mm),
            ("STEP read as plain text (Part 21), farthest point", "mm", SAME_MM, step.part21_max_mm),
            ("STEP, volume read back, relative change", "", SAME_VOLUME, step.volume_relative),
            ("untrimmed sheet read back, farthest point", "mm", SAME_MM, metrics.files.sheet_max_mm),
            ("outline read back from DXF, its box", "mm", SAME_MM, metrics.files.outline_box_mm)]
    found.append(("STL, farthest facet from the surface", "mm", mirror.spec.export.stl_deflection_mm,
                  deviation.stages.stl.height_max_mm))
    if metrics.plate is not None:
        found.append((f"{other} of the plate against the true offset", "mm", offset, metrics.plate.back_error_mm))
    return [Requirement("files", name, unit, limit, actual) for name, unit, limit, actual in found if actual is not None]
