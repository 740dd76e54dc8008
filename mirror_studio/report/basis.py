"""What a deviation was judged on and how far its figures may be off, in words and table cells."""

from __future__ import annotations

from mirror_cad.curvature_fields import QUANTITIES
from mirror_cad.deviation import Deviation
from mirror_cad.mirror import Mirror
from mirror_studio.build.results import Metrics
from mirror_studio.report.report_data import ReportData
from mirror_studio.report.stages import numerical_stages
from mirror_studio.report.text import count, fixed, number, with_unit
from mirror_studio.report.uncertainty import Uncertainty

SAMPLING_DIGITS = 5  # the grid and its refinement differ in the fourth or later


def basis_rows(mirror: Mirror, metrics: Metrics, findings: ReportData) -> list[tuple[str, str]]:
    """Evaluated area, what realised and designed are, grid, averages, signs and percent."""
    found = findings.uncertainty
    (nx, ny), (inside, edge) = found.cells, found.points
    x_min, x_max, y_min, y_max = mirror.box
    whole = with_unit(metrics.plate and metrics.plate.area_mm2, "mm²", 6)
    return [
        ("Evaluated area", f"the whole optical face inside its outline, rounded corners and edge included: "
                           f"{with_unit(mirror.outline.area_mm2(), 'mm²', 6)} as seen along z"
                           + (f", {whole} on the face" if metrics.plate else "")),
        ("Realised", f"the face named “optical face” in {mirror.spec.name}.step, as read back from that file"),
        ("Designed", "the pair of curvatures 1/Rx(x) and 1/Ry(x) of the two laws, without twist" if mirror.spec.has_laws else
                     "no law: what is drawn as designed are the curvatures kx and ky that the surface has along y = 0, held at "
                     "every height; a deviation from it is no fault"),
        ("Grid", f"{nx} × {ny} cells over the outline's box, {fixed((x_max - x_min) / nx, 2)} × "
                 f"{fixed((y_max - y_min) / ny, 2)} mm each: {count(inside)} cell middles inside the outline "
                 f"and {count(edge)} points on the outline itself"),
        ("Largest and RMS", "largest values over all points; RMS and shares of area over the cell middles, by equal area in "
                            "(x, y)"),
        ("Signs", "convex positive; deviation = realised − designed; k1 ≥ k2 are the principal curvatures, kx and ky those of "
                  "the normal sections along x and y, twist the mixed one; shape is all of the shape operator, the size of "
                  "(kx, ky, twist) together"),
        ("Percent", "of the designed value at the point, of 1 % of the RMS designed curvature where that is larger; twist "
                    "and shape of that RMS"),
    ]


def sampling_rows(found: Uncertainty) -> list[tuple[str, list[str]]]:
    """The largest deviation of each quantity on the grid and on the refined one, and what the refinement changed."""
    unit = "%" if found.unit == "%" else "/m"
    (nx, ny), (fx, fy) = found.cells, found.finer_cells
    coarse, fine = ([found.largest[key][k] for key in QUANTITIES] for k in (0, 1))
    return [(f"largest in size on the grid, {nx} × {ny} cells", [with_unit(value, unit, SAMPLING_DIGITS) for value in coarse]),
            (f"on the refined grid, {fx} × {fy} cells", [with_unit(value, unit, SAMPLING_DIGITS) for value in fine]),
            ("what the refinement changed", [with_unit(b - a, unit, 2, sign=True) for a, b in zip(coarse, fine, strict=True)])]


def rounding_rows(deviation: Deviation, found: Uncertainty) -> list[tuple[str, str, str]]:
    """Every other source of numerical uncertainty: what, how large, and where it enters."""
    rows = [("Grid, its refinement", _sampled(found), "comes on top: a maximum between the points"),
            ("Rounding, two formulas of the realised curvature", with_unit(found.rounding_per_m, "/m", 2), "comes on top")]
    if found.quadrature_mm is not None:
        percent = found.quadrature_percent
        curvature = "" if percent is None else f", {with_unit(percent, '%', 2)} of curvature"
        rows.append(("Quadrature of the exact profile, against Gauss's rule",
                     f"{with_unit(found.quadrature_mm, 'mm', 2)}{curvature}",
                     "enters heights and slopes; curvatures are held against the laws themselves"))
    for name, stage in numerical_stages(deviation):
        off, per_m = stage.largest_principal_percent, stage.largest_principal_per_m
        rows.append((f"{name[0].upper()}{name[1:]}, largest of k1 and k2",
                     f"{with_unit(off, '%', 2) if off is not None else with_unit(per_m, '/m', 2)}, "
                     f"{with_unit(abs(stage.sag_max_mm), 'mm', 2)}", "is part of the deviation shown, not beside it"))
    return rows


def _sampled(found: Uncertainty) -> str:
    unit = "%" if found.unit == "%" else "/m"
    worst = max(("k1", "k2"), key=found.missed)
    missed = found.missed(worst)
    return f"{number(missed, 2)} {unit} ({worst})" if missed else f"0 {unit}: the refined grid finds nothing larger"
