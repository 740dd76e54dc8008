"""What each method of making a B-spline surface of a preset's exact sag costs and misses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mirror_cad.design_stages import design
from mirror_cad.grid import Grid
from mirror_cad.mirror import Mirror
from mirror_cad.occt import peers
from mirror_cad.sections import SagDerivatives
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import load_spec, validate_spec
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import collocate_height
from mirror_cad.surfaces.differential import ShapeOperator, shape_operator, shape_operator_of_sag
from mirror_cad.surfaces.fit import curvature_percent
from mirror_studio.bench.integrators import SMOOTH_LAW
from mirror_studio.bench.measuring import convergence, median_seconds
from mirror_studio.bench.table import Column, Plot, Row, Table
from mirror_studio.report.text import given

Array = NDArray[np.float64]

DEGREES = (3, 5, 7)
SPANS = ((8, 4), (16, 8), (32, 16), (64, 32), (128, 64))
INTERPOLATED = (50, 72, 73, 100)
MAX_INTERPOLATED = 72  # points a direction; with more the kernel's interpolation has a dent
MIN_APPROXIMATED = 50  # points a direction; with fewer a tight approximation swings between them
PLAIN, TIGHT = (3, 8, 1e-3), (5, 8, 1e-6)  # degrees and tolerance (mm) of the kernel's approximation
TIGHT_FACE_MM = 1e-5
NEWTON_STEPS, FOUND_MM = 20, 1e-9  # where a folded surface has no such point, the search ends here
THINNED = 7  # of the cells inside the outline every seventh, and all places on it: 9,000, skewed, for errors that are smooth
SHEET_SAMPLES = (211, 311)  # of a surface's whole extent, for dents beyond the mirror


@dataclass(frozen=True, slots=True, eq=False)
class Judge:
    """The exact mirror at the places x, y (n,) where surfaces are compared with it."""

    mirror: Mirror
    x: Array
    y: Array
    exact: SagDerivatives
    shape: ShapeOperator
    reference_curvature: Array

    @staticmethod
    def of(mirror: Mirror) -> Judge:
        """What judges surfaces of this mirror."""
        grid = Grid.over(mirror.outline)
        used = grid.weights == 0.0
        used[::THINNED] = True
        x, y = grid.x[used], grid.y[used]
        exact = mirror.exact.derivatives(x, y)
        return Judge(mirror, x, y, exact, shape_operator_of_sag(exact),
                     mirror.curvature.reference_curvature(x, mirror.curvature.rms(mirror.outline)))

    def errors(self, surface: BSplineSurface) -> Row:
        """Largest errors over the trimmed mirror, in height (mm) and principal curvature (percent); and over the sheet."""
        d = at_points(surface, self.x, self.y)
        percent = curvature_percent(shape_operator(d), self.shape, self.reference_curvature)
        u_min, u_max, v_min, v_max = surface.domain
        over = surface.on_grid(np.linspace(u_min, u_max, SHEET_SAMPLES[0]), np.linspace(v_min, v_max, SHEET_SAMPLES[1]))["s"]
        x_min, x_max, y_min, y_max = self.mirror.surface.domain
        z = self.mirror.exact.height(np.clip(over[..., 0], x_min, x_max), np.clip(over[..., 1], y_min, y_max))
        return {"poles": surface.poles.shape[0] * surface.poles.shape[1],
                "span_mm": float(np.diff(np.unique(surface.knots_u)).max()) * (x_max - x_min) / (u_max - u_min),
                "height_mm": float(np.abs(d["s"][..., 2] - self.exact.z).max()),
                "curvature_percent": None if percent is None else float(percent.max()),
                "sheet_mm": float(np.abs(over[..., 2] - z).max())}


def at_points(surface: BSplineSurface, x: Array, y: Array) -> dict[str, Array]:
    """`derivatives` at the parameters whose point has these (x, y).

    Newton, from where they would be were they linear in (x, y). For a surface with u = x, v = y that is where it begins.
    """
    u_min, u_max, v_min, v_max = surface.domain
    (x0, y0, _), (x1, y1, _) = surface.evaluate([u_min, u_max], [v_min, v_max])
    u = np.clip(u_min + (u_max - u_min) * (x - x0) / (x1 - x0), u_min, u_max)
    v = np.clip(v_min + (v_max - v_min) * (y - y0) / (y1 - y0), v_min, v_max)
    for _ in range(NEWTON_STEPS):
        d = surface.derivatives(u, v)
        off_x, off_y = d["s"][..., 0] - x, d["s"][..., 1] - y
        if max(np.abs(off_x).max(), np.abs(off_y).max()) < FOUND_MM:
            break
        xu, xv, yu, yv = d["u"][..., 0], d["v"][..., 0], d["u"][..., 1], d["v"][..., 1]
        determinant = xu * yv - xv * yu
        u = np.clip(u - (yv * off_x - xv * off_y) / determinant, u_min, u_max)
        v = np.clip(v - (xu * off_y - yu * off_x) / determinant, v_min, v_max)
    return d


def tables() -> tuple[Table, ...]:
    """Each route's error, time and size; and the orders of collocation."""
    spec = load_spec("progressive-c")
    judge = Judge.of(design(spec))
    smooth = validate_spec({"name": "smooth", "horizontal": {"law": "expression", "curvature": SMOOTH_LAW},
                            "vertical": {"law": "constant", "radius_mm": 1250.0}})
    collocated = list(_collocated(spec, judge))
    rows = [*collocated, _automatic(spec, judge), *_foreign(judge)]
    text = ("Collocation of degree 3, 5 and 7 on given spans, and on those the program chooses for 10⁻⁵ mm and 0.01 %, beside "
            "the surfaces that OCCT, build123d and cadquery make of n² exact points of the same sheet. Errors "
            "are the largest over the trimmed mirror and off the nodes, against the exact sag; where a route's parameters "
            "are not x and y, at the parameters of the same (x, y). Ours are timed with the evaluation of the sag, the "
            "automatic choice with its search and its measuring, the others from points at hand. OCCT's interpolation of 73 "
            "points a direction or more has wrong end tangents: a dent between nodes that are all hit, largest beyond the "
            "mirror. Its approximation of 25 points to 10⁻⁶ mm has more freedom than points.")
    routes = Table("surfaces", "Surfaces from the sag of progressive-c", text, (
        Column("route", "route"), Column("setting", "setting"), Column("poles", "poles"), Column("span_mm", "largest span, mm"),
        Column("time_ms", "time, ms"), Column("height_mm", "height error, mm"), Column("curvature_percent", "κ error, %"),
        Column("sheet_mm", "height error of the whole sheet, mm")), tuple(rows), (
        Plot("time_ms", "curvature_percent", "route", "κ error over time"),
        Plot("poles", "curvature_percent", "route", "κ error over poles"),
        Plot("span_mm", "curvature_percent", "route", "κ error over span")))
    measured = {"progressive-c": collocated, "smooth": list(_collocated(smooth, Judge.of(design(smooth))))}
    return routes, _orders(measured)


def _collocated(spec: MirrorSpec, judge: Judge) -> Iterator[Row]:
    for degree in DEGREES:
        for spans in SPANS:
            fixed = spec.model_copy(update={"surface": spec.surface.model_copy(update={"degree": degree, "spans": spans})})
            fit = design(fixed).fit
            knots = fit.surface.knots_u, fit.surface.knots_v
            yield {"route": f"collocation, degree {degree}", "setting": f"{fit.spans[0]} × {fit.spans[1]} spans",
                   "degree": degree,
                   "time_ms": 1e3 * median_seconds(partial(collocate_height, judge.mirror.exact.height, *knots, degree)),
                   **judge.errors(fit.surface)}


def _automatic(spec: MirrorSpec, judge: Judge) -> Row:
    fits = [design(spec).fit for _ in range(3)]
    fit = fits[0]
    return {"route": "collocation, automatic", "setting": f"degree {fit.degree}, {fit.spans[0]} × {fit.spans[1]} spans",
            "time_ms": 1e3 * sorted(one.seconds for one in fits)[1], **judge.errors(fit.surface)}


def _foreign(judge: Judge) -> Iterator[Row]:
    def points(n: int) -> Array:
        x_min, x_max, y_min, y_max = judge.mirror.surface.domain
        x, y = np.meshgrid(np.linspace(x_min, x_max, n), np.linspace(y_min, y_max, n), indexing="ij")
        return np.stack([x, y, judge.mirror.exact.height(x, y)], axis=2)

    routes: list[tuple[str, str, peers.Route]] = []
    for n in INTERPOLATED:
        name = "OCCT interpolation" + (", too many points" if n > MAX_INTERPOLATED else "")
        routes.append((name, f"{n}²", peers.occt_interpolation(points(n))))
    for n, (lowest, highest, tolerance_mm) in ((50, PLAIN), (50, TIGHT), (100, TIGHT), (25, TIGHT)):
        name = "OCCT approximation" + (", too few points" if n < MIN_APPROXIMATED else "")
        routes.append((name, f"{n}², degree {lowest}–{highest}, {given(tolerance_mm, 'mm')}",
                       peers.occt_approximation(points(n), lowest, highest, tolerance_mm)))
    tight = given(TIGHT_FACE_MM, "mm")
    for library, make_face in (("build123d", peers.build123d_face), ("cadquery", peers.cadquery_face)):
        routes += [(library, "50², defaults", make_face(points(50))),
                   (library, f"50², {tight}", make_face(points(50), tol=TIGHT_FACE_MM)),
                   (library, f"100², {tight}", make_face(points(100), tol=TIGHT_FACE_MM))]
    for route, setting, make in routes:
        yield {"route": route, "setting": setting, "time_ms": 1e3 * median_seconds(make),
               **judge.errors(peers.as_bspline(make()))}


def _orders(measured: dict[str, list[Row]]) -> Table:
    rows = []
    for law, collocated in measured.items():
        for degree in DEGREES:
            of_degree = [row for row in collocated if row["degree"] == degree]
            spans = [row["span_mm"] for row in of_degree]
            height = convergence(spans, [row["height_mm"] for row in of_degree])
            curvature = convergence(spans, [row["curvature_percent"] for row in of_degree])
            rows.append({"degree": degree, "law": law, "height_order": height.order, "height_theory": degree + 1,
                         "height_floor": height.floor, "curvature_order": curvature.order, "curvature_theory": degree - 1,
                         "curvature_floor": curvature.floor})
    text = ("Observed: the slope of log error over the log of the largest span in x, with half as many spans in y, through "
            "the finest that lie above the floor. In theory degree + 1 in height and degree − 1 in curvature, on any law, "
            "since knots stand at its breaks with the multiplicity that they ask for; degree 7 has not settled to its order on "
            "these spans. Floor: the error at which finer spans no longer help, rounding of z over the square of "
            "the span; without one, none was met.")
    columns = (Column("degree", "degree"), Column("law", "law"), Column("height_order", "order in height, observed"),
               Column("height_theory", "theory"), Column("height_floor", "floor, mm"),
               Column("curvature_order", "order in κ, observed"), Column("curvature_theory", "theory"),
               Column("curvature_floor", "floor, %"))
    return Table("surface-orders", "Collocation: observed order of convergence", text, columns, tuple(rows))
