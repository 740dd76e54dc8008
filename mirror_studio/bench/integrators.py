"""How exactly and how fast each integrator makes profiles of curvature laws."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline, make_interp_spline

from mirror_cad import laws
from mirror_cad.design_stages import design
from mirror_cad.laws.curvature import CurvatureLaw, Span
from mirror_cad.laws.matched import with_solved
from mirror_cad.profile import Profile, integrate_exactly, integrate_ode, sine_of_tangent_angle
from mirror_cad.spec.file import load_spec
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev
from mirror_studio.bench.measuring import convergence, median_seconds
from mirror_studio.bench.table import Column, Plot, Row, Table

Array = NDArray[np.float64]

STEPS_MM = (10.0, 3.0, 1.0, 0.3, 0.1)
RELATIVE_TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
ABSOLUTE_SHARE = 1e-3  # of the relative tolerance, mm and slope: on a profile of millimetres it then never decides
SOLVER_NODES_MM = 1.0  # where the adaptive solver is asked for its height
SMOOTH_LAW = "0.00125 - 0.00062*tanh((x + 40)/40)"  # 1/mm; radii from 540 to 1590 mm, analytic everywhere
LEVEL_MM = 0.0
HALF_WIDTH_MM = 115.0
# Places at which curvature is compared: their number is prime, so that they meet none of the nodes but the ends.
SAMPLES = 9973
PANELS = 1150  # of the reference quadrature
GAUSS_POINTS = 12  # a panel of 0.2 mm: far beyond rounding

EULER, SEMI_IMPLICIT, RK4 = "explicit Euler (the paper's)", "semi-implicit Euler", "Runge–Kutta 4"
ADAPTIVE, SPLINE, CHEBYSHEV = "adaptive DOP853 (scipy)", "spline quadrature (scipy)", "Chebyshev quadrature (ours)"
MARCHED = {EULER: "euler", SEMI_IMPLICIT: "semi-implicit", RK4: "rk4"}
# In height and in curvature, on a smooth law. The quintic spline through the points is of order 4 in curvature itself.
THEORY = {EULER: (1, 1), SEMI_IMPLICIT: (1, 1), RK4: (4, 4), SPLINE: (6, 5)}


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A law over the mirror's width, with what a right profile would give.

    x, designed : points (n,) and κ there, 1/mm.   heights_at, heights : points (m,) and z there above the right end, mm.
    """

    law: CurvatureLaw
    kappa: PiecewiseChebyshev
    exact: Profile
    x: Array
    designed: Array
    heights_at: Array
    heights: Array

    @staticmethod
    def of(law: CurvatureLaw) -> Case:
        """The case of one law over the width of the benchmark."""
        kappa = law.series(-HALF_WIDTH_MM, HALF_WIDTH_MM)
        x = np.linspace(-HALF_WIDTH_MM, HALF_WIDTH_MM, SAMPLES)
        return Case(law, kappa, chebyshev_quadrature(kappa), x, law.function(x), *reference_heights(law))

    def height_error_mm(self, profile: Profile) -> float:
        """Largest |z − z_exact| when both start at the right end."""
        z = profile.height(self.heights_at)
        return float(np.abs(z - z[-1] - self.heights).max())

    def curvature_error_percent(self, profile: Profile) -> float:
        """Largest |κ_realised/κ − 1|, percent."""
        realised = -profile.bend(self.x) / (1.0 + profile.slope(self.x) ** 2) ** 1.5
        return float(100.0 * np.abs(realised / self.designed - 1.0).max())

    def predicted_percent(self, method: str, step_mm: float) -> float | None:
        """The first-order error in κ of the two Euler rules, percent.

        Explicit: h·max|κ′/κ| = h·max|Rx′|/Rx, since κ is that of one step before. Semi-implicit: h·max 1.5·|tan θ|·κ/cos θ,
        since the slope that the rate was taken at lags half a step behind that of the points.
        """
        if method == EULER:
            return float(100.0 * step_mm * np.abs(self.kappa.derivative()(self.x) / self.designed).max())
        if method == SEMI_IMPLICIT:
            slope = self.exact.slope(self.x)
            return float(100.0 * step_mm * np.abs(1.5 * slope * self.designed * np.hypot(1.0, slope)).max())
        return None


def tables() -> tuple[Table, ...]:
    """Errors and times on the paper's law and on a smooth one, and the orders that they show."""
    spec = load_spec("progressive-c")
    matched = design(spec).matched
    span = Span(-HALF_WIDTH_MM, HALF_WIDTH_MM)
    paper = Case.of(with_solved(spec.horizontal, matched).over(span))
    smooth = Case.of(laws.Expression(curvature=SMOOTH_LAW).over(span))
    compared = ("Each method starts at the right end with the exact height and slope and goes to the left end, 230 mm, in "
                "equal steps; the marched points are joined by the interpolating quintic spline, and curvature is that of the "
                "curve they give, between the nodes. The height is compared with nested Gauss–Legendre quadrature of the law "
                "itself. κ(x) is given to all as the same series; DOP853 is asked for z every "
                f"{SOLVER_NODES_MM:g} mm. Predicted: explicit Euler realises κ one step late, h·max|Rx′|/Rx; semi-implicit "
                "Euler realises it on time with a slope half a step late, h·max 1.5·|tan θ|·κ/cos θ. ")
    first = Table(
        "integrators", "Integrators on the profile of progressive-c",
        compared + "The law's second derivative jumps at x = −19.9 mm, where its blend begins.",
        COLUMNS, tuple(_rows(paper)), PLOTS)
    second = Table(
        "integrators-smooth", "Integrators on a smooth law",
        f"The same on κ = {SMOOTH_LAW} per mm, which has no break: here the methods show the orders that they have in theory.",
        COLUMNS, tuple(_rows(smooth)), PLOTS)
    return first, second, _orders({"progressive-c": first, "smooth": second})


COLUMNS = (
    Column("method", "method"), Column("step_mm", "step h, mm"), Column("rtol", "rtol"), Column("steps", "steps"),
    Column("time_ms", "time, ms"), Column("height_mm", "height error, mm"), Column("curvature_percent", "κ error, %"),
    Column("predicted_percent", "predicted κ error, %"),
)
PLOTS = (
    Plot("step_mm", "curvature_percent", "method", "κ error over step"),
    Plot("step_mm", "height_mm", "method", "Height error over step"),
    Plot("time_ms", "curvature_percent", "method", "κ error over time"),
)


def _rows(case: Case) -> Iterator[Row]:
    for method, options, work in _methods(case):
        profile = work()
        step = options.get("step_mm")
        yield {"method": method, **options, "steps": profile.steps, "time_ms": 1e3 * median_seconds(work),
               "height_mm": case.height_error_mm(profile), "curvature_percent": case.curvature_error_percent(profile),
               "predicted_percent": None if step is None else case.predicted_percent(method, step)}


def _methods(case: Case) -> Iterator[tuple[str, dict[str, float], Callable[[], Profile]]]:
    kappa, exact = case.kappa, case.exact
    steps = [equal_step(h) for h in STEPS_MM]
    for method, rule in MARCHED.items():
        for h in steps:
            yield method, {"step_mm": h}, partial(integrate_ode, kappa, exact, rule, h)
    for h in steps:
        yield SPLINE, {"step_mm": h}, partial(spline_quadrature, kappa, exact, h)
    for rtol in RELATIVE_TOLERANCES:
        yield ADAPTIVE, {"rtol": rtol}, partial(adaptive, kappa, exact, rtol)
    yield CHEBYSHEV, {}, partial(chebyshev_quadrature, kappa)


def equal_step(step_mm: float) -> float:
    """The step nearest to the one asked for that fills the width: a shorter last step is a kink in Euler's points."""
    width = 2.0 * HALF_WIDTH_MM
    return width / round(width / step_mm)


def chebyshev_quadrature(kappa: PiecewiseChebyshev) -> Profile:
    """Ours, with slope and bend taken from the height's own series, so that its curvature is realised and not copied."""
    profile = integrate_exactly(sine_of_tangent_angle(kappa, LEVEL_MM), kappa)
    height = profile.height
    assert isinstance(height, PiecewiseChebyshev)
    slope = height.derivative()
    return Profile(height, slope, slope.derivative(), profile.x_min, profile.x_max, profile.method, profile.steps)


def spline_quadrature(kappa: PiecewiseChebyshev, exact: Profile, step_mm: float) -> Profile:
    """sin θ and z as antiderivatives of quintic splines through κ and tan θ on nodes of step h."""
    x = np.linspace(exact.x_min, exact.x_max, round((exact.x_max - exact.x_min) / step_mm) + 1)
    integral = make_interp_spline(x, kappa(x), k=5).antiderivative()
    start = exact.slope(x[-1:])
    sine = integral(x) - integral(x[-1]) - start / np.hypot(1.0, start)
    slope: BSpline = make_interp_spline(x, -sine / np.sqrt((1.0 - sine) * (1.0 + sine)), k=5)
    return Profile(slope.antiderivative(), slope, slope.derivative(), exact.x_min, exact.x_max, "spline", len(x) - 1)


def adaptive(kappa: PiecewiseChebyshev, exact: Profile, rtol: float) -> Profile:
    """g' = −κ·(1 + g²)^(3/2), z' = g by scipy's DOP853; its heights joined by the interpolating quintic spline."""
    nodes = np.linspace(exact.x_max, exact.x_min, round((exact.x_max - exact.x_min) / SOLVER_NODES_MM) + 1)
    start = [float(exact.height(nodes[:1])[0]), float(exact.slope(nodes[:1])[0])]

    def rates(x: float, y: Array) -> tuple[float, float]:
        return y[1], -float(kappa(x)) * (1.0 + y[1] * y[1]) ** 1.5

    solved = solve_ivp(rates, (nodes[0], nodes[-1]), start, "DOP853", nodes, rtol=rtol, atol=ABSOLUTE_SHARE * rtol)
    height: BSpline = make_interp_spline(nodes[::-1], solved.y[0][::-1], k=5)
    # Twelve evaluations a step, and a thirteenth to begin with.
    return Profile(height, height.derivative(1), height.derivative(2), exact.x_min, exact.x_max, "DOP853", solved.nfev // 12)


def reference_heights(law: CurvatureLaw) -> tuple[Array, Array]:
    """Places x (m,) and z(x) − z(right end), mm, by Gauss–Legendre quadrature of κ within that of tan θ, panel by panel.

    It shares nothing with the package's own integration but the law.
    """
    inner = [b.x_mm for b in law.breaks if abs(b.x_mm) < HALF_WIDTH_MM]
    ends = np.unique(np.concatenate([np.linspace(-HALF_WIDTH_MM, HALF_WIDTH_MM, PANELS + 1), inner, [LEVEL_MM]]))
    nodes, weights = leggauss(GAUSS_POINTS)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    width = np.diff(ends)
    gained = width * (law.function(ends[:-1, None] + width[:, None] * nodes) @ weights)
    at_ends = np.concatenate([[0.0], np.cumsum(gained.astype(np.longdouble))])
    at_ends -= at_ends[np.searchsorted(ends, LEVEL_MM)]
    # sin θ at every node: from the panel's start by a rule of its own on [start, node].
    part = width[:, None] * nodes
    inside = ends[:-1, None, None] + part[..., None] * nodes
    sine = at_ends[:-1, None].astype(np.float64) + part * (law.function(inside) @ weights)
    fallen = width * (-sine / np.sqrt((1.0 - sine) * (1.0 + sine)) @ weights)
    z = np.concatenate([[0.0], np.cumsum(fallen.astype(np.longdouble))])
    return ends, (z - z[-1]).astype(np.float64)


def _orders(measured: dict[str, Table]) -> Table:
    rows: list[Row] = []
    for law, table in measured.items():
        for method in (*MARCHED, SPLINE, ADAPTIVE, CHEBYSHEV):
            of_method = [row for row in table.rows if row["method"] == method]
            row: Row = {"method": method, "law": law}
            for i, key in enumerate(("height_mm", "curvature_percent")):
                errors = [one[key] for one in of_method]
                if method in THEORY:
                    found = convergence([one["step_mm"] for one in of_method], errors)
                    row |= {f"{key}_order": found.order, f"{key}_theory": THEORY[method][i], f"{key}_floor": found.floor}
                else:
                    row |= {f"{key}_order": None, f"{key}_theory": None, f"{key}_floor": min(errors)}
            rows.append(row)
    text = ("Observed: the slope of log error over log step, through the finest steps that lie above the floor. Floor: the "
            "error at which a smaller step (or tolerance) no longer helps; without one, none was met. On progressive-c the "
            "jump in the law's second derivative limits what crosses it: the step that holds it is of lower order, by how "
            "much depends on where in the step it falls, and the quintic spline through the points is of order 2 there. "
            "Semi-implicit Euler realises κ on time, but its slope lags half a step: first order again, with about a "
            "thirtieth of the explicit rule's error in curvature. At 10 mm the law's own change, of second order, outweighs "
            "that, so that the error falls faster at first.")
    columns = (
        Column("method", "method"), Column("law", "law"),
        Column("height_mm_order", "order in height, observed"), Column("height_mm_theory", "theory"),
        Column("height_mm_floor", "floor, mm"), Column("curvature_percent_order", "order in κ, observed"),
        Column("curvature_percent_theory", "theory"), Column("curvature_percent_floor", "floor, %"))
    return Table("integrator-orders", "Integrators: observed order of convergence", text, columns, tuple(rows))
