"""What the closest surface reaches and costs over its spans, beside the decoupled one."""

from __future__ import annotations

import statistics
from collections.abc import Iterator

import numpy as np

from mirror_cad.design_stages import design
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import load_spec, validate_spec
from mirror_cad.surfaces.faithful import FaithfulLevel
from mirror_studio.as_json import method_as_json
from mirror_studio.bench.table import Column, Plot, Row, Table
from mirror_studio.build.methods import compare_methods, with_method

# Mirror, degree, spans over its box. The finest are a mirror's own measure of where its deviation stops falling.
COARSE, FINE = ((4, 3), (6, 4), (8, 6), (12, 8)), ((18, 12),)
STUDIES = (("progressive-a", 7, COARSE), ("progressive-b", 7, COARSE), ("progressive-c", 7, COARSE + FINE),
           ("progressive-c", 5, COARSE + FINE), ("sphere-950", 7, COARSE), ("sphere-950", 5, COARSE), ("torus", 7, COARSE))
RUNS, BUDGET_S = 3, 1.0  # a solution that takes longer is timed once
TORUS_MM = (900.0, 400.0)  # the circle's radius, and how far its centre lies from the axis


def tables() -> tuple[Table, ...]:
    """The floor over the spans, and the two methods side by side."""
    specs = {name: torus() if name == "torus" else load_spec(name) for name, *_ in STUDIES}
    rows = [row for name, degree, spans in STUDIES for row in _levels(name, specs[name], degree, spans)]
    largest = [row for row in rows if row["mirror"] == "progressive-c" and row["degree"] == 7]
    unknowns, time_ms = (np.log([row[key] for row in largest]) for key in ("unknowns", "time_ms"))
    growth = float(np.polyfit(unknowns, time_ms, 1)[0])
    floor = Table(
        "faithful-floor", "The closest surface over its spans",
        "RMS deviation of the whole shape operator from diag(1/Rx, 1/Ry) over the trimmed mirror. For free laws it stops "
        "falling: that is the laws' own floor. For the sphere and the torus, whose laws a surface has, it goes on to "
        "rounding. Spans are those over the mirror's box, those made for the sheet around it come on top; the time is the "
        "median of three solutions from the decoupled surface, of one where it takes above a second. Here it grew with the "
        f"unknowns to the power {growth:.1f}, over all spans of progressive-c in degree 7.",
        (Column("mirror", "mirror"), Column("degree", "degree"), Column("spans", "spans"), Column("unknowns", "unknowns"),
         Column("evaluations", "evaluations"), Column("time_ms", "time, ms"), Column("shape", "shape RMS, %", 6)),
        tuple(rows), (Plot("unknowns", "shape", "study", "Shape RMS over unknowns"),
                      Plot("unknowns", "time_ms", "study", "Time over unknowns")))
    methods = Table(
        "faithful-methods", "Decoupled and faithful side by side",
        "The same laws by both methods: RMS deviations over the trimmed mirror in percent, what the driver sees, and how far "
        "the faithful surface lies from the decoupled one: with point and normal at the origin held, and after a rigid "
        "motion has been fitted.",
        (Column("mirror", "mirror"), Column("method", "method"), Column("shape_rms_percent", "shape RMS, %"),
         Column("k1_rms_percent", "k1, %"), Column("k2_rms_percent", "k2, %"), Column("kx_rms_percent", "kx, %"),
         Column("ky_rms_percent", "ky, %"), Column("twist_rms_percent", "twist, %"), Column("h_fov_deg", "H-FOV, °", 4),
         Column("v_fov_left_deg", "V-FOV left, °", 4), Column("lane_straightness_percent", "lane, %"),
         Column("sag_max_mm", "height moved, mm"), Column("sag_best_fit_max_mm", "after best fit, mm"),
         Column("ray_max_arcmin", "ray turned, ′")),
        tuple(row for name, spec in specs.items() for row in _side_by_side(name, spec)))
    return floor, methods


def torus() -> MirrorSpec:
    """A specification whose laws a torus has: Rx = a, Ry = a + c/cos θ with sin θ = x/a."""
    a, c = TORUS_MM
    return validate_spec({"name": "torus", "horizontal": {"law": "constant", "radius_mm": a},
                          "vertical": {"law": "expression", "radius": f"{a:g} + {c:g}/sqrt(1 - (x/{a:g})**2)"}})


def _levels(name: str, spec: MirrorSpec, degree: int, all_spans: tuple[tuple[int, int], ...]) -> Iterator[Row]:
    surface = with_method(spec, "faithful").surface
    for spans in all_spans:
        asked = spec.model_copy(update={"surface": surface.model_copy(update={"degree": degree, "spans": spans})})
        levels: list[FaithfulLevel] = []
        while len(levels) < RUNS and sum(level.seconds for level in levels) < BUDGET_S:
            found = design(asked).faithful
            levels += found.levels if found is not None else ()
        yield {"mirror": name, "degree": degree, "study": f"{name}, degree {degree}", "spans": f"{spans[0]} × {spans[1]}",
               "unknowns": levels[0].unknowns, "evaluations": levels[0].evaluations,
               "shape": levels[0].shape_rms_percent, "time_ms": 1e3 * statistics.median(level.seconds for level in levels)}


def _side_by_side(name: str, spec: MirrorSpec) -> Iterator[Row]:
    mirror = design(spec)
    both = compare_methods(mirror)
    change = both.change
    yield {"mirror": name, "method": "decoupled", **method_as_json(both.decoupled)}
    yield {"mirror": name, "method": "faithful", **method_as_json(both.faithful), "sag_max_mm": change.sag_max_mm,
           "sag_best_fit_max_mm": change.sag_best_fit_max_mm, "ray_max_arcmin": change.ray_max_arcmin}
