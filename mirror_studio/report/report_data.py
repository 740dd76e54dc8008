"""What the report finds in a mirror beyond deviation and metrics: records, and tables of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mirror_cad.curvature_fields import differences, in_percent
from mirror_cad.deviation import Deviation
from mirror_cad.mirror import Mirror
from mirror_cad.reflection import reflected_surface
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import normals, principal_curvatures_of, rms_norm, shape_operator
from mirror_studio.as_json import metrics_as_json
from mirror_studio.build.results import Manifest, Metrics
from mirror_studio.json_types import Json
from mirror_studio.report.cuts import Cut, cuts, cuts_table
from mirror_studio.report.fields import DeviationFields, deviation_fields
from mirror_studio.report.heading import heading
from mirror_studio.report.histogram import Histogram, histogram
from mirror_studio.report.marked_view import LaneImage, lane_image
from mirror_studio.report.probe import Probe, probe
from mirror_studio.report.requirement import Requirement
from mirror_studio.report.stages import stages_table
from mirror_studio.report.step_change import StepChange, step_change
from mirror_studio.report.tables import Table, write_tables
from mirror_studio.report.uncertainty import Uncertainty, uncertainty
from mirror_studio.report.verdict_table import requirements, verdict_rows_table
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.reflector import TRIM_CHORD_MM
from raytrace.surfaces.base import OpticalSurface
from raytrace.surfaces.bspline import BSplineFace


@dataclass(frozen=True, slots=True, eq=False)
class ReportData:
    """What the report finds in a mirror beyond deviation and metrics.

    Attributes
    ----------
    fields, shares
        Deviations as drawn, and by area.
    measures
        Every number of metrics.json under its keys.
    uncertainty, requirements, probe, cuts, change
        As their modules have them.
    lane
        The lane's image, None where it does not cross the mirror.
    maps
        Columns over the grid of points.
    seen
        What the eye looks at.
    """

    fields: DeviationFields
    shares: Histogram
    measures: Table
    uncertainty: Uncertainty
    requirements: list[Requirement]
    probe: Probe
    cuts: list[Cut]
    change: StepChange
    lane: LaneImage | None
    maps: Table
    seen: OpticalSurface

    def tables(self, deviation: Deviation) -> list[Table]:
        """All that is written as CSV and JSON, in the report's order."""
        found = [verdict_rows_table(self.requirements), self.uncertainty.table(), self.maps, self.shares.table(),
                 cuts_table(self.cuts), stages_table(deviation), self.change.table(), self.probe.table(), self.measures]
        return found if self.lane is None else [*found, self.lane.table()]


def find(mirror: Mirror, deviation: Deviation, read_back: BSplineSurface, metrics: Metrics,
         areas_mm2: tuple[float, float] | None = None, seen: OpticalSurface | None = None) -> ReportData:
    """Of a mirror whose optical face reads back as `read_back`, in the frame of the design.

    areas_mm2 : of the optical face as written and as read back, by the kernel; None without it.
    seen : what the eye looks at; without it, the face itself.
    """
    setup = ViewingSetup.of(mirror.spec, mirror.box)
    seen = seen or BSplineFace(read_back, (mirror.outline.polyline(TRIM_CHORD_MM),))
    fields = deviation_fields(deviation, mirror.spec.limits.curvature_percent)
    rms = rms_norm(deviation.designed, deviation.grid.weights)
    made = mirror.as_made
    in_file = reflected_surface(read_back) if made.reflected else read_back  # what CAD shows to who checks it by hand
    straightness = metrics.lane_straightness_percent.traced
    return ReportData(
        fields, histogram(deviation, fields), _measures(metrics), uncertainty(mirror, deviation, read_back, fields),
        requirements(mirror, deviation, metrics), probe(in_file, made.outline), cuts(mirror, read_back, rms, fields.unit),
        step_change(mirror, deviation, read_back, areas_mm2), lane_image(seen, setup.eye, setup.lane, mirror.box, straightness),
        _maps(mirror, read_back, rms), seen)


def write_findings(folder: Path, mirror: Mirror, deviation: Deviation, findings: ReportData,
                   manifest: Manifest) -> None:
    """Write NAME-report.json and a NAME-TABLE.csv for each of its tables beside the mirror's other files."""
    measured, change = findings.uncertainty, findings.change
    viewed = [row for row in findings.requirements if row.group == "view"]
    head = {"head": dataclasses.asdict(heading(mirror, manifest)), "file": f"{mirror.spec.name}.step", "face": "optical face",
            "verdicts": {"numerical": deviation.numerical, "part": deviation.part,
                         "view": all(row.met for row in viewed) if viewed else None},
            "basis": {"area_mm2": mirror.outline.area_mm2(), "cells": list(measured.cells), "places_inside": measured.points[0],
                      "places_on_edge": measured.points[1], "refined_cells": list(measured.finer_cells),
                      "refined_places_inside": measured.finer[0], "refined_places_on_edge": measured.finer[1],
                      "rounding_per_m": measured.rounding_per_m, "quadrature_mm": measured.quadrature_mm,
                      "quadrature_percent": measured.quadrature_percent},
            "step": {"poles_moved_mm": change.poles_mm, "knots_moved_mm": change.knots_mm}}
    write_tables(folder, mirror.spec.name, findings.tables(deviation), head)


def _measures(metrics: Metrics) -> Table:
    def leaves(entry: Json, key: str) -> Iterator[tuple[str, float | None]]:
        if isinstance(entry, Mapping):
            for name, value in entry.items():
                yield from leaves(value, f"{key}.{name}" if key else name)
        elif isinstance(entry, Sequence) and not isinstance(entry, str):
            for number, value in enumerate(entry):
                yield from leaves(value, f"{key}.{number}")
        elif entry is None or (isinstance(entry, int | float) and not isinstance(entry, bool)):
            yield key, entry

    found = list(leaves(metrics_as_json(metrics), ""))
    return Table("measures", {"measure": [key for key, _ in found], "value": [value for _, value in found]})


def _maps(mirror: Mirror, surface: BSplineSurface, rms: float) -> Table:
    """Designed and realised curvature, and the deviation, at the points of NAME-points.csv."""
    points = mirror.grid_points()
    x, y = points[:, 0], points[:, 1]
    d = surface.derivatives(x, y)
    realised, designed = shape_operator(d), mirror.curvature.shape(x)
    k1, k2 = principal_curvatures_of(realised)
    columns = {"x_mm": x, "y_mm": y, "z_mm": d["s"][:, 2]}
    columns |= dict(zip(("nx", "ny", "nz"), normals(d["u"], d["v"]).T, strict=True))
    columns |= {"kx_designed_per_m": 1e3 * designed.w11, "ky_designed_per_m": 1e3 * designed.w22,
                "kx_realised_per_m": 1e3 * realised.w11, "ky_realised_per_m": 1e3 * realised.w22,
                "twist_realised_per_m": 1e3 * realised.w12, "k1_realised_per_m": 1e3 * k1, "k2_realised_per_m": 1e3 * k2,
                "Km_realised_per_m": 0.5e3 * (realised.w11 + realised.w22),
                "Ka_realised_per_m": 0.5e3 * (realised.w11 - realised.w22)}
    per_mm = differences(realised, designed)
    columns |= {f"{key}_deviation_per_m": 1e3 * value for key, value in per_mm._asdict().items()}
    if rms > 0.0:
        percent = in_percent(per_mm, designed, rms)
        columns |= {f"{key}_deviation_percent": value for key, value in percent._asdict().items()}
    return Table("maps", columns)
