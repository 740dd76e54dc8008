"""One mirror with its deviation, measured figures and manifest in, its self-contained report.html out."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from mirror_cad.deviation import CurvatureDeviation
from mirror_studio.report import maps
from mirror_studio.report.maps import QUANTITIES, DeviationFields
from mirror_studio.report.text import (
    MISSING,
    NARROW_SPACE,
    SMALLEST_PLAIN,
    count,
    fixed,
    fixed_with_unit,
    given,
    lane_in_words,
    law_in_words,
    number,
    place,
    plain,
    templates,
    with_unit,
)

if TYPE_CHECKING:
    from mirror_cad.mirror import Mirror

STAGES = {
    "model": "the exact decoupled surface against the design",
    "integration": "its profile as integrated",
    "fit": "the B-spline",
    "step": "the B-spline as read back from STEP",
    "total": "read back, against the design",
}
NUMERICAL = ("integration", "fit", "step")
STAGE_NAMES = {"integration": "integration", "fit": "fit", "step": "STEP"}
# Wide enough for half a screen at twice its pixels; the picture itself lies beside the report without loss.
PICTURE_WIDTH_PX = 1280
CHECKS = {
    "step_max_mm": "STEP read back by the kernel, farthest point from the design",
    "part21_max_mm": "STEP read as plain text (Part 21), farthest point",
    "volume_relative": "STEP read back, relative change of the volume",
    "sheet_max_mm": "untrimmed sheet read back, farthest point",
    "outline_box_mm": "outline read back from DXF, its box",
    "points": "points on the 5 mm grid",
}
UNITS = {"_mm": "mm", "_mm2": "mm²", "_mm3": "mm³", "_deg": "°", "_percent": "%", "_seconds": "s", "_arcsec": "″"}


def write_report(path: Path, mirror: Mirror, deviation: CurvatureDeviation, metrics: dict[str, Any],
                 manifest: dict[str, Any], driver_view_png: bytes) -> None:
    """Write the report of one mirror: a page without scripts and external requests, readable in print on A4.

    metrics : fields of view in degrees, lane straightness in percent, STL on the plane in mm, rays, eye in mm, plate,
    files; any of them may be missing or None.   manifest : versions, notes and the files' sha256.
    """
    pairs = maps.pairs_of(deviation)
    limit = mirror.spec.limits.curvature_percent
    fields = maps.deviation_fields(deviation, limit)
    sections, section_y_mm = maps.centre_sections(deviation, pairs, fields)
    figures = {
        "radii": _png_uri(maps.pair_maps(deviation, mirror.outline, pairs[:2])),
        "powers": _png_uri(maps.pair_maps(deviation, mirror.outline, pairs[2:])),
        "deviation": _png_uri(maps.deviation_maps(deviation, mirror.outline, fields)),
        "histogram": _svg_uri(maps.deviation_histogram(deviation, fields)),
        "sections": _svg_uri(sections),
        "driver": _photograph_uri(driver_view_png),
    }
    page = templates().get_template("report.html.j2").render(
        title=mirror.spec.name, facts=_facts(mirror, metrics), verdicts=verdicts(mirror, deviation, fields),
        view=_view(mirror, metrics), figures=figures, limit=limit, fields=fields, section_y_mm=section_y_mm,
        as_curvature=[pair.name.removeprefix("1/") for pair in pairs if pair.as_curvature],
        stages=_stage_rows(deviation), quantities=QUANTITIES, model=model_sentences(deviation),
        stl=deviation.stages.get("stl", {}), making=_making(mirror, metrics),
        files=manifest.get("files") or {}, versions=manifest.get("versions") or {},
        notes=manifest.get("notes") or list(mirror.notes), specification=_flat(mirror.spec.model_dump()),
    )
    path.write_text(page, encoding="utf-8")


def verdicts(mirror: Mirror, deviation: CurvatureDeviation, fields: DeviationFields) -> list[dict[str, str]]:
    """The two verdicts in words with their numbers: what was judged, met (“yes”, “no” or “open”), head and text."""
    return [_numerical_verdict(mirror, deviation), _part_verdict(deviation, fields)]


def _numerical_verdict(mirror: Mirror, deviation: CurvatureDeviation) -> dict[str, str]:
    asked = mirror.spec.surface
    reached = []
    for name in NUMERICAL:
        entry = deviation.stages[name]
        off = _largest_of_pair(entry)
        curvature = "" if off is None else f"{with_unit(off, '%', 2)} of curvature and "
        reached.append(f"{STAGE_NAMES[name]} {curvature}{with_unit(abs(entry['sag_max_mm']), 'mm', 2)} of height")
    return {
        "what": "Numerical", "met": "yes" if deviation.numerical else "no",
        "head": "Tolerances met" if deviation.numerical else "Tolerances not met",
        "text": f"At most, {'; '.join(reached)}. Asked: {given(asked.curvature_tolerance_percent, '%')} (k1, k2) "
                f"and {given(asked.position_tolerance_mm, 'mm')} in each stage.",
    }


def _part_verdict(deviation: CurvatureDeviation, fields: DeviationFields) -> dict[str, str]:
    total = deviation.total
    if fields.unit != "%":
        worst = max(abs(total[f"{key}_max_per_m"]) for key in ("k1", "k2"))
        met = "open" if deviation.part is None else "yes" if deviation.part else "no"
        return {"what": "Part", "met": "open" if deviation.part is None else met,
                "head": "No limit asked for" if deviation.part is None else "Limit in percent does not apply",
                "text": f"The design is flat, so its deviation has no percent: k1 and k2 differ from zero by at most "
                        f"{with_unit(worst, '/m', 2)}."}
    both = "; ".join(f"{key} {with_unit(total[f'{key}_max_percent'], '%', sign=True)} at "
                     f"{place(total[f'{key}_max_at_mm'])}{NARROW_SPACE}mm" for key in ("k1", "k2"))
    if deviation.part is None or fields.limit is None:
        return {"what": "Part", "met": "open", "head": "No limit asked for",
                "text": f"Realised against designed curvature at its worst: {both}."}
    limit = f"±{given(fields.limit, '%')}"
    if deviation.part:
        return {"what": "Part", "met": "yes", "head": f"Within the limit of {limit}",
                "text": f"Realised against designed curvature at its worst: {both}."}
    weights = deviation.grid.weights
    beyond = np.maximum(np.abs(fields.values["k1"]), np.abs(fields.values["k2"])) > fields.limit
    share = 100.0 * float(np.average(beyond, weights=weights))
    return {"what": "Part", "met": "no", "head": f"Beyond the limit of {limit}",
            "text": f"Realised against designed curvature at its worst: {both}. "
                    f"{with_unit(share, '%', 2)} of the area lies beyond the limit."}


def model_sentences(deviation: CurvatureDeviation) -> str:
    """How much of the deviation is the decoupled model's own, and how small the rest is."""
    model = _largest_of_pair(deviation.stages["model"])
    if model is None:
        return "The design is flat: the decoupled surface is the plane itself, and the model adds nothing."
    rest = max(_largest_of_pair(deviation.stages[name]) or 0.0 for name in NUMERICAL)
    start = ("The model stage is the unavoidable part. The decoupled construction hangs circles of radius Ry(x) on the "
             "horizontal profile, and such a surface cannot have the designed curvatures everywhere: to first order it "
             "has the twist −y·(Ry′ − z′)/Ry², where the profile has the slope z′ = −tan θ, and its vertical curvature "
             "is cos θ/Ry. Where kx and ky are close, the twist moves k1 and k2 apart by its own size, one up and one "
             "down. No numerics can remove this.")
    if rest == 0.0:
        return f"{start} Here it is up to {with_unit(model, '%')} of k1 or k2, and the other stages add nothing."
    share = f", a share of 1 in {count(float(f'{model / rest:.1e}'))}" if model > 10.0 * rest else ""
    return (f"{start} Here it is up to {with_unit(model, '%')} of k1 or k2; integration, fit and STEP add at most "
            f"{with_unit(rest, '%', 2)} each{share}.")


def _largest_of_pair(entry: Mapping[str, Any]) -> float | None:
    found = [abs(entry[f"{key}_max_percent"]) for key in ("k1", "k2") if entry.get(f"{key}_max_percent") is not None]
    return max(found) if found else None


def _stage_rows(deviation: CurvatureDeviation) -> list[dict[str, Any]]:
    rows = []
    for name, what in STAGES.items():
        entry = deviation.total if name == "total" else deviation.stages[name]
        cells = []
        for key in QUANTITIES:
            nothing = entry[f"{key}_max_per_m"] == 0.0
            cells.append({
                "max": with_unit(entry[f"{key}_max_percent"], "%", sign=True),
                "rms": with_unit(entry[f"{key}_rms_percent"], "%"),
                "per_m": with_unit(entry[f"{key}_max_per_m"], "/m", sign=True),
                "place": MISSING if nothing else place(entry[f"{key}_max_at_mm"]),
            })
        # The model stage is what height and slope are measured from.
        against = name != "model"
        rows.append({
            "name": STAGE_NAMES.get(name, name), "what": what, "cells": cells,
            "shape": with_unit(entry.get("shape_rms_percent"), "%"),
            "sag": with_unit(entry.get("sag_max_mm"), "mm", sign=True) if against else MISSING,
            "slope": with_unit(entry.get("slope_max_arcsec"), "″") if against else MISSING,
        })
    return rows


def _facts(mirror: Mirror, metrics: Mapping[str, Any]) -> list[tuple[str, str]]:
    spec = mirror.spec
    x_min, x_max, y_min, y_max = mirror.box
    solved = mirror.matched[1] if mirror.matched else None
    eye = metrics.get("eye_mm")
    above = "centre" if spec.eye.aligned == "centre" else f"{spec.eye.aligned} edge"
    sits = f"{plain(spec.eye.distance_mm)} mm from the centre, in front of the mirror's {above}"
    if eye:
        sits += f": ({', '.join(fixed(v, 1) for v in eye)}) mm"
    return [
        ("Horizontal law Rx(x)", law_in_words(spec.horizontal.model_dump(), solved)),
        ("Vertical law Ry(x)", law_in_words(spec.vertical.model_dump())),
        ("Size", f"{fixed(x_max - x_min, 1)} × {fixed(y_max - y_min, 1)} mm, "
                 f"{plain(spec.glass.thickness_mm)} mm thick"),
        ("Eye", sits),
    ]


def _view(mirror: Mirror, metrics: Mapping[str, Any]) -> dict[str, Any]:
    def pair(key: str, names: tuple[str, str]) -> list[str]:
        values = metrics.get(key) or {}
        unit, decimals = ("%", 1) if key.endswith("percent") else ("°", 2)
        return [fixed_with_unit(values.get(name), unit, decimals) for name in names]

    plane = metrics.get("stl_on_plane_mm") or {}
    rays = metrics.get("rays") or {}
    return {
        "horizontal": pair("h_fov_deg", ("section", "traced")),
        "vertical": pair("v_fov_left_deg", ("section", "traced")),
        "lane": pair("lane_straightness_percent", ("traced", "image")),
        "lane_y": lane_in_words(mirror.spec.scene.lane.model_dump()), "plane_mm": plain(mirror.spec.scene.distance_mm),
        "left_half_mm": plain(round(0.5 * mirror.left_height_mm, 1)),
        "stl": {"max": with_unit(plane.get("max"), "mm"), "rms": with_unit(plane.get("rms"), "mm"),
                "rays": count(plane.get("rays"))} if plane.get("max") is not None else None,
        "rays": [(name.replace("_", " "), count(value)) for name, value in rays.items() if value is not None],
    }


def _making(mirror: Mirror, metrics: Mapping[str, Any]) -> list[tuple[str, str]]:
    fit, surface = mirror.fit, mirror.spec.surface
    step = f", step {plain(surface.step_mm)} mm" if surface.step_mm is not None else ""
    rows = [
        ("Integration of the profile", f"{surface.integration}{step}"),
        ("Fit", f"{fit.route}, degree {fit.degree}, {fit.spans[0]} × {fit.spans[1]} spans (x × y), "
                f"in {with_unit(fit.seconds, 's', 2)}; tolerances {'met' if fit.met else 'not met'}"),
        ("Fit, largest position error", f"{with_unit(fit.position_error_mm, 'mm', 2)} "
                                        f"(asked: {given(surface.position_tolerance_mm, 'mm')})"),
    ]
    if fit.curvature_error_percent is not None:
        rows.append(("Fit, largest curvature error", f"{with_unit(fit.curvature_error_percent, '%', 2)} at "
                     f"{place(fit.worst_at_mm)}{NARROW_SPACE}mm, over the whole bounding box "
                     f"(asked: {given(surface.curvature_tolerance_percent, '%')})"))
    if mirror.matched is not None:
        rows.append(("Solved for", f"{mirror.matched[0]} = {number(mirror.matched[1], 6)}"))
    plate = metrics.get("plate") or {}
    rows += [(label, with_unit(plate[key], unit, digits)) for key, label, unit, digits in (
        ("area_mm2", "Area of the optical face", "mm²", 5), ("volume_mm3", "Volume of the plate", "mm³", 5),
        ("back_error_mm", "Back of the plate against the true offset", "mm", 2)) if plate.get(key) is not None]
    rows += [(CHECKS.get(key, key.replace("_", " ")), _measured(key, value))
             for key, value in (metrics.get("files") or {}).items() if value is not None]
    return rows


def _measured(key: str, value: Any) -> str:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return str(value)
    unit = next((unit for suffix, unit in UNITS.items() if key.endswith(suffix)), "")
    return with_unit(value, unit, 2) if unit else number(value)


def _flat(section: Mapping[str, Any], before: str = "") -> list[tuple[str, str]]:
    """Keys and values of a specification, as `horizontal.law` and “zones”; what is not set is left out."""
    rows: list[tuple[str, str]] = []
    for key, value in sorted(section.items(), key=lambda item: item[0] != "law"):
        if isinstance(value, Mapping):
            rows += _flat(value, f"{before}{key}.")
        elif isinstance(value, tuple | list) and len(value) > 8:
            rows.append((before + key, f"{len(value)} values, {_value(value[0])} to {_value(value[-1])}"))
        elif value is not None:
            rows.append((before + key, _value(value)))
    return rows


def _value(value: Any) -> str:
    if isinstance(value, tuple | list):
        return ", ".join(_value(each) for each in value)
    if isinstance(value, float):
        return plain(value).replace("inf", "∞") if value == 0.0 or abs(value) >= SMALLEST_PLAIN else number(value)
    return str(value)


def _png_uri(picture: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(picture).decode("ascii")


def _svg_uri(drawing: bytes) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(drawing).decode("ascii")


def _photograph_uri(png: bytes) -> str:
    """The driver's view as JPEG: a tenth of the PNG's bytes, and nothing in it that a reader measures."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    if picture.width > PICTURE_WIDTH_PX:
        picture = picture.resize((PICTURE_WIDTH_PX, round(picture.height * PICTURE_WIDTH_PX / picture.width)),
                                 Image.Resampling.LANCZOS)
    file = io.BytesIO()
    picture.save(file, "JPEG", quality=88, subsampling=0)
    return "data:image/jpeg;base64," + base64.b64encode(file.getvalue()).decode("ascii")
