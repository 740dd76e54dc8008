"""The report of one mirror, a self-contained report.html, made from its deviation, metrics and manifest."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.deviation import Deviation
from mirror_cad.laws.words import plain
from mirror_studio.build.results import FieldOfView, GlassFigures, Manifest, Metrics
from mirror_studio.report.basis import basis_rows, rounding_rows, sampling_rows
from mirror_studio.report.cut_figures import comb_figure, radius_figure
from mirror_studio.report.fields import LARGEST_PERCENT, DeviationFields, pairs_of
from mirror_studio.report.heading import HANDS, SIGNATURES, contradictions, heading
from mirror_studio.report.histogram import histogram_figure
from mirror_studio.report.maps import deviation_maps, pair_maps
from mirror_studio.report.marked_view import marked_view
from mirror_studio.report.report_data import ReportData
from mirror_studio.report.requirement import Requirement
from mirror_studio.report.rows import actual_in_words, change_rows, probe_rows, requirement_groups
from mirror_studio.report.side_by_side import side_by_side
from mirror_studio.report.specification import specification_rows
from mirror_studio.report.stages import (
    FLOOR_DIGITS,
    Floor,
    chain_links,
    explained_sentences,
    model_sentences,
    numerical_stages,
    spans_in_words,
    stage_rows,
    weakest_sentence,
)
from mirror_studio.report.text import (
    NARROW_SPACE,
    count,
    digits_telling,
    fixed,
    fixed_with_unit,
    given,
    lane_in_words,
    number,
    point_in_words,
    templates,
    with_unit,
)
from mirror_studio.report.verdict_table import view_requirements
from mirror_studio.rules.of_spec import SpecRules
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.measures.registry import registered
from raytrace.scene.reference import Picture
from raytrace.viewing.camera import Frame

if TYPE_CHECKING:
    from mirror_cad.mirror import Mirror
    from mirror_studio.build.wanted import TargetFigures

METHODS = {
    "decoupled": "decoupled: vertical circles of radius Ry hung on the horizontal profile of Rx",
    "faithful": "faithful: the closest to both laws at once, by least squares on the whole shape operator",
    "sphere": "sphere: of the one radius that both laws state, fitted to rounding",
    "view": "from the wanted view, by least squares on the reflected rays; there are no curvature laws",
}
# Measures that have a row of their own in the report.
OWN_ROWS = {"h_fov_section_deg", "h_fov_traced_deg", "v_fov_left_section_deg", "v_fov_left_traced_deg",
            "lane_straightness_percent"}


def write_report(path: Path, mirror: Mirror, deviation: Deviation, metrics: Metrics,
                 manifest: Manifest, driver_view: Picture, findings: ReportData) -> None:
    """Write the report of one mirror: a page without scripts and external requests, readable in print on A4.

    Parameters
    ----------
    path
        Of the file to write.
    mirror, deviation, metrics, manifest
        What the report is about; what `metrics` does not have is left out.
    driver_view
        The driver's picture.
    findings
        What the report finds beyond deviation and metrics.
    """
    pairs = pairs_of(deviation)
    limit, surface, fields = mirror.spec.limits.curvature_percent, mirror.spec.surface, findings.fields
    frame, eye = Frame.around(mirror.box, mirror.spec.view.width_px), ViewingSetup.of(mirror.spec, mirror.box).eye
    across, upright = ([cut for cut in findings.cuts if cut.along == along] for along in ("x", "y"))
    figures = {
        "radii": _uri("image/svg+xml", pair_maps(deviation, mirror.outline, pairs[:2])),
        "powers": _uri("image/svg+xml", pair_maps(deviation, mirror.outline, pairs[2:])),
        "deviation": _uri("image/svg+xml", deviation_maps(deviation, mirror.outline, fields)),
        "histogram": _uri("image/svg+xml", histogram_figure(findings.shares, fields)),
        "across": _uri("image/svg+xml", radius_figure(across, limit)),
        "upright": _uri("image/svg+xml", radius_figure(upright, limit)),
        "combs": _uri("image/svg+xml", comb_figure(findings.cuts)),
        "driver": _uri("image/jpeg", marked_view(driver_view, frame, findings.lane, findings.seen, eye)),
    }
    head = heading(mirror, manifest)
    page = templates().get_template("report.html.j2").render(
        title=f"{head.number or head.spec}: curvature report", head=head, hands=HANDS, signatures=SIGNATURES,
        contradictions=contradictions(mirror), facts=facts(mirror, metrics),
        verdicts=verdicts(mirror, deviation, fields, metrics),
        requirements=requirement_groups(findings.requirements, findings.uncertainty),
        basis=basis_rows(mirror, metrics, findings), sampling=sampling_rows(findings.uncertainty),
        rounding=rounding_rows(deviation, findings.uncertainty),
        probe=probe_rows(findings.probe), changes=change_rows(findings.change), change=findings.change,
        cuts={"across": [cut.name for cut in across], "upright": [cut.name for cut in upright]},
        lane_drawn=findings.lane is not None, tables=[table.name for table in findings.tables(deviation)],
        view=_view(mirror, metrics), figures=figures, fields=fields, limit=limit, bin_width=findings.shares.bin_width,
        as_curvature=[pair.name.removeprefix("1/") for pair in pairs if pair.as_curvature],
        quantities=QUANTITIES, stages=stage_rows(deviation, surface.method), explained=explained_sentences(deviation),
        has_laws=mirror.spec.has_laws,
        model=model_sentences(deviation, surface.method, Floor.found(mirror.faithful), surface.curvature_tolerance_percent),
        stl=deviation.stages.stl, chain=chain_links(deviation), weakest=weakest_sentence(deviation.rays),
        method=surface.method, flat=deviation.percent is None, largest_percent=LARGEST_PERCENT,
        both=side_by_side(metrics.methods, surface.method, mirror.spec.scene.distance_mm),
        making=_making(mirror, metrics),
        files=_sorted_files(mirror.spec.name, manifest.files), versions=manifest.versions,
        notes=manifest.notes or mirror.notes, specification=specification_rows(mirror.spec),
    )
    path.write_text(page, encoding="utf-8")


@dataclass(frozen=True, slots=True)
class Verdict:
    """What was judged, whether it is met (“yes”, “no” or “open”), and why, in words."""

    what: str
    met: str
    head: str
    text: str


def verdicts(mirror: Mirror, deviation: Deviation, fields: DeviationFields,
             metrics: Metrics) -> list[Verdict]:
    """The verdicts in words with their numbers."""
    rows = view_requirements(mirror, metrics)
    second = _part_verdict(mirror, deviation, fields) if metrics.target is None else _target_verdict(metrics.target)
    return [_numerical_verdict(mirror, deviation), second, *([_view_verdict(rows)] if rows else []),
            *([] if metrics.rules is None else [_rules_verdict(metrics.rules)])]


def _rules_verdict(named: SpecRules) -> Verdict:
    """How many lines of the rule that the specification names are missed: no verdict on the mirror."""
    missed = [line.asked.text for line in named.lines if line.verdict == "missed"]
    left = sum(line.verdict == "open" for line in named.lines)
    head = f"{len(missed)} of {len(named.lines)} lines missed" if missed else f"None of {len(named.lines)} lines missed"
    text = "".join(f"Missed: {each}. " for each in missed)
    what = f"{named.rule.rule}, {named.rule.edition}, class {named.class_name}: radii and sizes"
    return Verdict(what, "no" if missed else "open", f"{head}, {left} open" if left else head,
                   f"{text}Fields of vision are those of a mirror on its vehicle (mirror-cad rules). The official text "
                   "decides.")


def _target_verdict(target: TargetFigures) -> Verdict:
    """How near the mirror comes to the view that it is made for."""
    at = f"{point_in_words(target.max_at_mm)}{NARROW_SPACE}mm"
    each = "" if len(target.eyes) == 1 else "; " + ", ".join(
        f"{name} eye {with_unit(one.rms_arcmin, '′')} RMS" for name, one in target.eyes.items())
    settled = ("More spans would gain nothing that an eye sees: this is what no surface can show"
               if target.settled else "More spans, or more steps, would still change this")
    return Verdict("Wanted view", "open", f"Missed by {with_unit(target.rms_arcmin, '′')} RMS",
                   f"At most {with_unit(target.max_arcmin, '′')} at {at}{each}, as traced in the exported file. {settled}.")


def _view_verdict(rows: list[Requirement]) -> Verdict:
    met = all(row.met for row in rows)
    asked: dict[str, list[str]] = {}
    for row in rows:
        if row.limit is not None:
            said = f"{row.name} {actual_in_words(row, sign=False)}"
            asked.setdefault(said, []).append(f"at {row.side} {given(row.limit, row.unit)}")
    text = "; ".join(f"{said} (asked for: {' and '.join(limits)})" for said, limits in asked.items())
    return Verdict("View", "yes" if met else "no", "Within what is asked of field of view and lane" if met else
                   f"Beyond what is asked: {'; '.join(row.name for row in rows if not row.met)}",
                   f"{text[0].upper()}{text[1:]}.")


def _numerical_verdict(mirror: Mirror, deviation: Deviation) -> Verdict:
    asked = mirror.spec.surface
    reached = []
    for name, stage in numerical_stages(deviation):
        off = stage.largest_principal_percent
        curvature = (_beside(off, asked.curvature_tolerance_percent, "%", 2) if off is not None
                     else with_unit(stage.largest_principal_per_m, "/m", 2))
        height = _beside(abs(stage.sag_max_mm), asked.position_tolerance_mm, "mm", 2)
        reached.append(f"{name} {curvature} of curvature and {height} of height")
    return Verdict(
        "Numerical", "yes" if deviation.numerical else "no",
        "Tolerances met" if deviation.numerical else "Tolerances not met",
        f"From the exact {asked.method} surface{_spans_of(mirror)} to the file, at most: {'; '.join(reached)}. Asked: "
        f"{given(asked.curvature_tolerance_percent, '%')} (k1, k2) and {given(asked.position_tolerance_mm, 'mm')} in "
        "each stage.")


def _part_verdict(mirror: Mirror, deviation: Deviation, fields: DeviationFields) -> Verdict:
    total, limit, surface = deviation.total, mirror.spec.limits.curvature_percent, mirror.spec.surface.method.capitalize()
    if deviation.percent is None:
        return Verdict("Part", "open", "No limit asked for" if limit is None else "Limit in percent does not apply",
                       f"{surface} surface of a flat design, whose deviation has no percent: k1 and k2 differ from zero by at "
                       f"most {with_unit(total.largest_principal_per_m, '/m', 2)}.")
    percent = fields.unit == "%"
    worst = "; ".join(f"{key} {_beside(value, limit, '%', 3, True) if percent else with_unit(value, '/m', sign=True)} at "
                      f"{point_in_words(at)}{NARROW_SPACE}mm" for key, (value, at) in fields.worst.items()
                      if key in ("k1", "k2"))
    other = " and ".join(with_unit(one.max_per_m, "/m", sign=True) if percent else
                         _beside(one.max_percent, limit, "%", 3, True) for one in (total.k1, total.k2))
    text = f"{surface} surface, realised against designed curvature at its worst: {worst} ({other})."
    if deviation.part is None or limit is None:
        return Verdict("Part", "open", "No limit asked for", text)
    allowed = f"±{given(limit, '%')}"
    if deviation.part:
        return Verdict("Part", "yes", f"Within the limit of {allowed}", text)
    beyond = np.maximum(np.abs(deviation.percent.k1), np.abs(deviation.percent.k2)) > limit
    share = 100.0 * float(np.average(beyond, weights=deviation.grid.weights))
    return Verdict("Part", "no", f"Beyond the limit of {allowed}",
                   f"{text} {with_unit(share, '%', 2)} of the area lies beyond the limit.")


def _beside(value: float | None, limit: float | None, unit: str, digits: int, sign: bool = False) -> str:
    """A value beside the limit that its size is held to, in digits that show whether it meets it."""
    if limit is not None and value is not None:
        digits = digits_telling(abs(value), limit, abs(value) <= limit, digits)
    return with_unit(value, unit, digits, sign)


def _spans_of(mirror: Mirror) -> str:
    """Of a faithful surface the spans that it was found on: “, on 6 × 5, then 8 × 6 spans of degree 7,”."""
    if mirror.faithful is None:
        return ""
    spans = ", then ".join(spans_in_words(level.spans) for level in mirror.faithful.levels)
    return f", least squares on {spans} spans of degree {mirror.faithful.degree},"


def facts(mirror: Mirror, metrics: Metrics) -> list[tuple[str, str]]:
    """What was asked for: laws, surface, size and eye."""
    spec = mirror.spec
    x_min, x_max, y_min, y_max = mirror.box
    solved = mirror.matched[1] if mirror.matched else None
    above = "centre" if spec.eye.aligned == "centre" else f"{spec.eye.aligned} edge"
    sits = f"{plain(spec.eye.distance_mm)} mm from the centre, in front of the mirror's {above}"
    if metrics.eye_mm:
        sits += f": ({', '.join(fixed(v, 1) for v in metrics.eye_mm)}) mm"
    made_for = [("Wanted view", spec.target.in_words())] if spec.target is not None else [
        ("Horizontal law Rx(x)", spec.horizontal.in_words(solved)), ("Vertical law Ry(x)", spec.vertical.in_words())]
    return [
        *made_for,
        ("Surface", METHODS[spec.surface.method]),
        ("Size", f"{fixed(x_max - x_min, 1)} × {fixed(y_max - y_min, 1)} mm, "
                 f"{plain(spec.glass.thickness_mm)} mm thick"
                 + (f", reflecting from its back through glass of index {plain(spec.glass.index)}"
                    if spec.glass.reflecting == "back" else "")),
        ("Eye", sits),
    ]


@dataclass(frozen=True, slots=True)
class StlWords:
    """What the STL does to rays, in words: by its facets, and with interpolated normals."""

    max: str
    rms: str
    smooth_max: str
    smooth_rms: str
    rays: str


@dataclass(frozen=True, slots=True)
class ViewWords:
    """What the driver sees, in words, for the section of that name."""

    horizontal: tuple[str, str]
    vertical: tuple[str, str]
    lane: tuple[str, str]
    more: list[tuple[str, str, str]]
    lane_y: str
    plane_mm: str
    left_half_mm: str
    stl: StlWords | None
    glass: list[tuple[str, str]]
    rays: list[tuple[str, str]]


def _view(mirror: Mirror, metrics: Metrics) -> ViewWords:
    def degrees(found: FieldOfView) -> tuple[str, str]:
        return fixed_with_unit(found.section, "°", 2), fixed_with_unit(found.traced, "°", 2)

    plane, smooth, lane = metrics.stl_on_plane, metrics.stl_interpolated_on_plane, metrics.lane_straightness_percent
    stl = None if plane.max_mm is None else StlWords(
        with_unit(plane.max_mm, "mm"), with_unit(plane.rms_mm, "mm"), with_unit(smooth.max_mm, "mm"),
        with_unit(smooth.rms_mm, "mm"), count(plane.rays))
    return ViewWords(
        degrees(metrics.h_fov_deg), degrees(metrics.v_fov_left_deg),
        (fixed_with_unit(lane.traced, "%", 1), fixed_with_unit(lane.image, "%", 1)),
        [(one.title, fixed_with_unit(metrics.measures[name], one.unit, one.decimals), one.definition)
         for name, one in registered().items() if name in metrics.measures and name not in OWN_ROWS],
        lane_in_words(mirror.spec.scene.lane.model_dump()), plain(mirror.spec.scene.distance_mm),
        plain(round(0.5 * mirror.left_height_mm, 1)), stl, _glass(metrics.glass),
        [(name.replace("_", " "), count(value)) for name, value in metrics.rays.items()])


def _glass(found: GlassFigures | None) -> list[tuple[str, str]]:
    """What the glass before a reflecting back does to the view; empty without."""
    if found is None:
        return []
    ghost = found.ghost
    mean, largest, through = (None if share is None else 100.0 * share
                              for share in (ghost.front_mean, ghost.front_max, ghost.image_mean))
    at = f" at {point_in_words(ghost.max_at_mm)}{NARROW_SPACE}mm" if ghost.max_at_mm else ""
    return [
        ("ghost beside the image, largest", fixed_with_unit(ghost.max_arcmin, "′", 1) + at),
        ("the same, mean", fixed_with_unit(ghost.mean_arcmin, "′", 1)),
        ("light in the ghost", f"{fixed_with_unit(mean, '%', 1)}, at most {fixed_with_unit(largest, '%', 1)}"),
        ("light in the image", fixed_with_unit(through, "%", 1)),
        ("horizontal field of view, added", fixed_with_unit(found.h_fov_added_deg, "°", 2)),
    ]


def _making(mirror: Mirror, metrics: Metrics) -> list[tuple[str, str]]:
    fit, surface = mirror.fit, mirror.spec.surface
    step = f", step {plain(surface.step_mm)} mm" if surface.step_mm is not None else ""
    rows = [("Method", METHODS[surface.method])]
    if mirror.faithful is not None:
        # The iteration has nothing to do for a plane, and its deviation no percent.
        rows += [(f"Least squares, {spans_in_words(level.spans)} spans of degree {mirror.faithful.degree}",
                  f"shape RMS {with_unit(level.shape_rms_percent, '%', FLOOR_DIGITS)}; {level.unknowns} unknowns, "
                  f"{level.evaluations} evaluations") for level in mirror.faithful.levels]
    if mirror.from_view is not None:
        rows += [(f"Least squares, {spans_in_words(level.spans)} spans of degree {mirror.from_view.degree}",
                  f"missed {with_unit(level.rms_arcmin, '′', FLOOR_DIGITS)} RMS; {level.unknowns} unknowns, "
                  f"{level.steps} steps") for level in mirror.from_view.levels]
    rows += [
        *([("Integration of the profile", f"{surface.integration}{step}")] if mirror.spec.has_laws else []),
        ("Fit", f"{fit.route}, degree {fit.degree}, {fit.spans[0]} × {fit.spans[1]} spans (x × y); "
                f"tolerances {'met' if fit.met else 'not met'}"),
        ("Fit, largest position error", f"{_beside(fit.position_error_mm, surface.position_tolerance_mm, 'mm', 2)} "
                                        f"(asked: {given(surface.position_tolerance_mm, 'mm')})"),
    ]
    if fit.curvature_error_percent is not None:
        off = _beside(fit.curvature_error_percent, surface.curvature_tolerance_percent, "%", 2)
        rows.append(("Fit, largest curvature error", f"{off} at {point_in_words(fit.worst_at_mm)}{NARROW_SPACE}mm, over the "
                     f"whole bounding box (asked: {given(surface.curvature_tolerance_percent, '%')})"))
    if mirror.matched is not None:
        rows.append(("Solved for", f"{mirror.matched[0]} = {number(mirror.matched[1], 6)}"))
    other = "Back" if mirror.spec.glass.reflecting == "front" else "Front"
    if metrics.plate is not None:
        rows += [("Area of the optical face", with_unit(metrics.plate.area_mm2, "mm²", 5)),
                 ("Volume of the plate", with_unit(metrics.plate.volume_mm3, "mm³", 5)),
                 (f"{other} of the plate against the true offset", with_unit(metrics.plate.back_error_mm, "mm", 2))]
    if metrics.files is not None:
        checked, files = metrics.files.step, metrics.files
        rows += [("STEP read back by the kernel, farthest point from the design", with_unit(checked.step_max_mm, "mm", 2)),
                 ("STEP read as plain text (Part 21), farthest point", with_unit(checked.part21_max_mm, "mm", 2)),
                 ("STEP read back, relative change of the volume", number(checked.volume_relative)),
                 ("untrimmed sheet read back, farthest point", with_unit(files.sheet_max_mm, "mm", 2)),
                 ("outline read back from DXF, its box", with_unit(files.outline_box_mm, "mm", 2)),
                 ("points on the 5 mm grid", number(float(files.points)))]
    return rows


def _sorted_files(name: str, files: Mapping[str, str]) -> dict[str, list[tuple[str, str]]]:
    """Names and hashes: what a mirror is made from, and what tells about it."""
    of_part = [f"{name}.step", f"{name}-surface.step", f"{name}.stl", f"{name}-points.csv", "outline.dxf"]
    return {"part": [(file, files[file]) for file in of_part if file in files],
            "other": [(file, digest) for file, digest in files.items() if file not in of_part]}


def _uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64," + base64.b64encode(content).decode("ascii")
