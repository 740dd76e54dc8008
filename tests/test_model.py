"""The closed forms of docs/derivations: against the surfaces themselves, and the documents' tables against the bench's."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mirror_cad import laws
from mirror_cad.laws.curvature import CurvatureLaw, Span
from mirror_cad.profile import Profile, integrate_exactly, integrate_ode, sine_of_tangent_angle
from mirror_cad.sections import DecoupledSag
from mirror_cad.surfaces.differential import ShapeOperator, principal_curvatures_of, shape_operator, shape_operator_of_sag
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev
from mirror_studio.bench import model
from mirror_studio.bench.table import Table

Array = NDArray[np.float64]

SPAN = Span(-115.0, 115.0)
X, Y = (grid.ravel() for grid in np.meshgrid(np.linspace(-114.0, 114.0, 39), np.linspace(-160.0, 160.0, 41)))


def constant(radius: float) -> CurvatureLaw:
    return laws.Constant(radius_mm=radius).over(SPAN)


def linear(right: float, left: float) -> CurvatureLaw:
    return laws.Linear(right_mm=right, left_mm=left).over(SPAN)


def formula(curvature: str) -> CurvatureLaw:
    return laws.Expression(curvature=curvature).over(SPAN)


PROGRESSIVE = laws.Zones(right_mm=1250.0, left_mm=400.0, blend_from=0.5865).over(SPAN)
DOCUMENTS = Path(__file__).parents[1] / "docs" / "derivations"
# Of the largest curvature; both sides are some thirty operations on the same series. Seen over 300 random laws: 1.2e-15.
ROUNDING = 1e-14
# Ry′ comes from the derivative of a law's series: coefficients good to 1e-16 of κ_y, times 25²/115 mm, times Ry² is 1e-12.
RATE_ROUNDING = 1e-11
COMPARED_PERCENT = 1e-6  # figures of the tables smaller than this are rounding


def series_of(law: CurvatureLaw, scale: float = 1.0) -> PiecewiseChebyshev:
    series = law.series(-115.0, 115.0)
    return PiecewiseChebyshev(series.breaks, series.coefficients / scale)


def profile_of(kappa: PiecewiseChebyshev, level_mm: float = 0.0) -> Profile:
    return integrate_exactly(sine_of_tangent_angle(kappa, level_mm), kappa)


def surface(horizontal: PiecewiseChebyshev, vertical: PiecewiseChebyshev,
            level_mm: float = 0.0) -> tuple[model.Sections, ShapeOperator]:
    """The sections at X, and the shape operator of the decoupled surface at (X, Y)."""
    profile = profile_of(horizontal, level_mm)
    return (model.sections_at(profile, horizontal, vertical, X),
            shape_operator_of_sag(DecoupledSag(profile, vertical).derivatives(X, Y)))


def largest(values: Array) -> float:
    return float(np.abs(values).max())


# --- the decoupled surface -------------------------------------------------------------------------------------------


@settings(max_examples=25)
@given(st.floats(-2.5e-3, 2.5e-3), st.floats(-1e-5, 1e-5), st.floats(-4e-3, 4e-3), st.floats(-1e-5, 1e-5),
       st.floats(-115.0, 115.0))
def test_closed_form_is_the_shape_operator_of_any_decoupled_surface(
        k1: float, k1_x: float, k2: float, k2_x: float, level_mm: float) -> None:
    """Convex, concave, flat and sign-changing laws, level anywhere."""
    horizontal = series_of(formula(f"{k1!r} + {k1_x!r}*x + 0.0002*sin(x/30)"))
    vertical = series_of(formula(f"{k2!r} + {k2_x!r}*x + 0.0002*sin(x/40)"))
    at, realised = surface(horizontal, vertical, level_mm)
    closed = model.exact_shape(at, Y)
    size = max(largest(component) for component in realised)
    for ours, exact in zip(closed, realised, strict=True):
        assert largest(ours - exact) <= ROUNDING * size


@pytest.mark.parametrize(("horizontal", "vertical", "orders"), [
    # κ, κ_y′ and κ_y″ fall with 1/λ, and so does the slope. The twist's first term κ_y′·y is of first order and misses a term
    # of relative second order; without it the tilt's, of third order, is what the remainder is measured from.
    (PROGRESSIVE, linear(1250.0, 1150.0), {"w12": 3, "w22": 5, "w11": 5}),
    (constant(950.0), constant(950.0), {"w12": 5, "w22": 5, "w11": 5}),
], ids=["progressive", "sphere"])
def test_leading_terms_miss_only_the_next_order_of_the_slopes(
        horizontal: CurvatureLaw, vertical: CurvatureLaw, orders: dict[str, int]) -> None:
    remainders: dict[str, list[float]] = {key: [] for key in orders}
    for scale in (2.0, 4.0):  # both radii doubled
        at, realised = surface(series_of(horizontal, scale), series_of(vertical, scale))
        designed = ShapeOperator(at.kappa_x, at.kappa_y, np.zeros_like(X))
        predicted = model.leading_terms(at, Y)
        for key in orders:
            left = getattr(realised, key) - getattr(designed, key) - getattr(predicted, key)
            remainders[key].append(float(np.sqrt(np.mean(left**2))))
    for key, order in orders.items():
        # The orders beyond fall by another four between the two scales: a few percent of one doubling.
        assert np.log2(remainders[key][0] / remainders[key][1]) == pytest.approx(order, abs=0.1), key


def test_twist_is_short_of_its_first_order_by_the_square_of_the_normals_sine() -> None:
    """W12 = −y·(Ry′ + tan θ)/Ry²·cos²ψ exactly, with sin ψ = N·x."""
    horizontal, vertical = series_of(PROGRESSIVE), series_of(linear(1150.0, 1050.0))
    profile = profile_of(horizontal)
    d = DecoupledSag(profile, vertical).derivatives(X, Y)
    radius, radius_slope = 1150.0 + (1050.0 - 1150.0) * SPAN.t(X), 100.0 / 230.0
    first_order = -Y * (radius_slope + np.tan(profile.tangent_angle(X))) / radius**2
    cosine_squared = 1.0 - d.zx**2 / (1.0 + d.zx**2 + d.zy**2)
    assert largest(shape_operator_of_sag(d).w12 - first_order * cosine_squared) <= RATE_ROUNDING * largest(first_order)


def test_vertical_curvature_on_the_profile_is_low_by_the_cosine_of_its_tangent_angle() -> None:
    """Meusnier: the circle of radius Ry lies in x = const, the normal section is turned from it by θ."""
    horizontal, vertical = series_of(PROGRESSIVE), series_of(linear(1250.0, 1350.0))
    profile = profile_of(horizontal)
    w22 = shape_operator_of_sag(DecoupledSag(profile, vertical).derivatives(X, np.zeros_like(X))).w22
    assert largest(w22 / vertical(X) - np.cos(profile.tangent_angle(X))) <= ROUNDING


def test_equal_constant_radii_are_no_sphere_and_corrected_circles_make_them_one() -> None:
    kappa = series_of(constant(950.0))
    _, plain = surface(kappa, kappa)
    k1, k2 = principal_curvatures_of(plain)
    assert (950.0 * (k1 - k2)).max() > 0.03
    circles = model.circles_of_normal_curvature(profile_of(kappa), kappa, kappa)
    _, corrected = surface(kappa, circles)
    k1, k2 = principal_curvatures_of(corrected)
    # κ_y/cos θ is a series here, and W11 takes its second derivative: 1e-16·25⁴ over the half width squared, times y².
    assert largest(950.0 * np.stack([k1, k2]) - 1.0) <= 1e-10


# --- pairs of laws that one surface can hold -------------------------------------------------------------------------


def symmetric_surfaces() -> list[DecoupledSag]:
    pairs = [(PROGRESSIVE, linear(1250.0, 1150.0), 0.0),
             (linear(600.0, 900.0), formula("0.0008 + 0.000002*x"), -50.0)]
    return [DecoupledSag(profile_of(series_of(first), level), series_of(second)) for first, second, level in pairs]


@pytest.mark.parametrize("sag", symmetric_surfaces())
@pytest.mark.parametrize("quartic", [0.0, 3e-9])
def test_twist_grows_across_the_level_line_as_the_second_codazzi_equation_says(sag: DecoupledSag, quartic: float) -> None:
    """Of any surface symmetric in y: only its two curvatures along y = 0 enter. The quartic makes it no decoupled one."""
    x, y = np.linspace(-114.0, 114.0, 77), 1e-4
    d = sag.derivatives(x, np.full_like(x, y))
    bump = quartic * np.sin(x / 40.0)
    twist = shape_operator_of_sag(d._replace(
        z=d.z + bump * y**4, zx=d.zx + quartic * np.cos(x / 40.0) / 40.0 * y**4, zxx=d.zxx - bump / 1600.0 * y**4,
        zy=d.zy + 4.0 * bump * y**3, zyy=d.zyy + 12.0 * bump * y**2,
        zxy=d.zxy + 4.0 * quartic * np.cos(x / 40.0) / 40.0 * y**3)).w12
    slope, bend, first = sag.profile.slope(x), sag.profile.bend(x), sag.vertical.derivative()
    cosine = 1.0 / np.hypot(1.0, slope)
    k1 = -bend * cosine**3
    k2, k2_x = cosine * sag.vertical(x), cosine * first(x) - cosine**3 * slope * bend * sag.vertical(x)
    gradient = model.twist_gradient(model.Sections(-slope, k1, k2, k2_x, np.zeros_like(x)))
    # The next power is the third: (κ_y·y)² ≈ 1e-14 of the first, and the quartic's 4·3e-9/40·y² against some 3e-7 1e-11.
    assert largest(twist / y - gradient) <= 1e-9 * largest(gradient)


@pytest.mark.parametrize(("law", "axis_depth_mm", "level_mm"), [
    (PROGRESSIVE, 1250.0, 0.0), (PROGRESSIVE, 800.0, 115.0), (constant(400.0), 1250.0, 0.0),
    (constant(950.0), 950.0, 0.0), (formula("0.001*sin(x/40)"), 700.0, -30.0),
], ids=["progressive", "level at its right edge", "torus", "sphere", "sign-changing"])
def test_surface_of_revolution_holds_its_compatible_pair(law: CurvatureLaw, axis_depth_mm: float, level_mm: float) -> None:
    horizontal = series_of(law)
    profile = profile_of(horizontal, level_mm)
    vertical = model.compatible_vertical(profile, horizontal, axis_depth_mm)
    at = model.sections_at(profile, horizontal, vertical, X)
    designed, weights = ShapeOperator(at.kappa_x, at.kappa_y, np.zeros_like(X)), np.ones_like(X)

    def shape_rms(w: ShapeOperator) -> float:
        difference = ShapeOperator(*(a - b for a, b in zip(w, designed, strict=True)))
        return model.shape_rms_percent(difference, designed, weights)

    # Evaluated on its own parameters: nothing but the rounding of some ten operations.
    assert shape_rms(shape_operator(model.revolved(profile, axis_depth_mm, X, Y))) <= 1e-11
    # As height field through series of 1/r, whose second derivative costs digits.
    circles = model.circles_of_normal_curvature(profile, horizontal, vertical)
    assert shape_rms(shape_operator_of_sag(DecoupledSag(profile, circles).derivatives(X, Y))) <= 1e-8
    # The decoupled surface of the same pair, circles of radius Ry in x = const, does not hold it.
    assert shape_rms(shape_operator_of_sag(DecoupledSag(profile, vertical).derivatives(X, Y))) > 0.3
    assert largest(model.compatibility_defect(at)) <= RATE_ROUNDING


def test_torus_in_closed_form() -> None:
    """Rx constant: Ry = Rx + (r0 − Rx)/cos θ with sin θ = x/Rx."""
    horizontal = series_of(constant(400.0))
    vertical = model.compatible_vertical(profile_of(horizontal), horizontal, 1250.0)
    assert largest(1.0 / vertical(X) - (400.0 + 850.0 / np.sqrt(1.0 - (X / 400.0) ** 2))) <= 1e-9  # 1e-12 of Ry


def test_pairs_that_no_surface_holds_have_a_defect() -> None:
    """Ry constant beside another Rx: δ = −tan θ·(Ry/Rx − 1), zero for a sphere wherever it is level."""
    for level_mm in (0.0, 115.0):
        horizontal, vertical = series_of(constant(950.0)), series_of(constant(1250.0))
        profile = profile_of(horizontal, level_mm)
        mixed = model.compatibility_defect(model.sections_at(profile, horizontal, vertical, X))
        assert largest(mixed + np.tan(profile.tangent_angle(X)) * (1250.0 / 950.0 - 1.0)) <= RATE_ROUNDING
        sphere = model.compatibility_defect(model.sections_at(profile, horizontal, horizontal, X))
        assert largest(sphere) <= RATE_ROUNDING


# --- marching rules --------------------------------------------------------------------------------------------------

MARCHED = formula("0.0013*exp(-x/150)")  # smooth: no break limits the order


def curvature_error(method: str, step_mm: float, x: Array) -> Array:
    kappa = series_of(MARCHED)
    marched = integrate_ode(kappa, profile_of(kappa), method, step_mm)
    result: Array = -marched.bend(x) / (1.0 + marched.slope(x) ** 2) ** 1.5 / kappa(x) - 1.0
    return result


@pytest.mark.parametrize(("method", "late"), [("euler", 1.0), ("semi-implicit", 0.0)])
def test_euler_rules_miss_the_curvature_by_the_derived_first_order(method: str, late: float) -> None:
    """h·κ′/κ from κ taken one step late (explicit only), and 3/2·h·κ·tan θ/cos θ from the slope taken half a step late."""
    x = np.linspace(-100.0, 100.0, 201)
    kappa = series_of(MARCHED)
    exact = profile_of(kappa)
    theta = exact.tangent_angle(x)
    per_mm = late * kappa.derivative()(x) / kappa(x) + 1.5 * kappa(x) * np.tan(theta) / np.cos(theta)
    left = [largest(curvature_error(method, step, x) - step * per_mm) for step in (1.0, 0.5)]
    assert np.log2(left[0] / left[1]) == pytest.approx(2.0, abs=0.1)  # what the formula leaves out is of second order
    assert left[0] < 0.01 * largest(per_mm)
    # And the whole profile is turned by half a step of bend where the march starts.
    start, step = np.array([115.0]), 0.25
    turned = integrate_ode(kappa, exact, method, step).slope(start) - exact.slope(start)
    bend = kappa(start) * np.hypot(1.0, exact.slope(start)) ** 3
    assert turned == pytest.approx((0.5 - late) * step * bend, rel=step * 0.01)  # the next order: h·κ′/κ and less


def test_runge_kutta_misses_the_curvature_by_the_fourth_order() -> None:
    x = np.linspace(-50.0, 50.0, 201)  # the spline's ends, of another order, die out in some ten steps
    errors = [largest(curvature_error("rk4", step, x)) for step in (8.0, 4.0)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.4)


def test_runge_kutta_falls_to_the_second_order_where_the_law_has_but_one_derivative() -> None:
    kappa = series_of(PROGRESSIVE)
    x = np.linspace(-110.0, 110.0, 4001)
    errors = []
    for step in (4.0, 0.125):
        marched = integrate_ode(kappa, profile_of(kappa), "rk4", step)
        errors.append(largest(-marched.bend(x) / (1.0 + marched.slope(x) ** 2) ** 1.5 / kappa(x) - 1.0))
    # Where in its step the break falls changes the constant: five halvings average that out.
    assert np.log2(errors[0] / errors[1]) / 5.0 == pytest.approx(2.0, abs=0.3)


# --- the documents ---------------------------------------------------------------------------------------------------


@cache
def bench_tables() -> dict[str, Table]:
    return {table.name: table for table in model.tables()}


def test_every_row_of_the_tables_has_every_column() -> None:
    for table in bench_tables().values():
        for row in table.rows:
            assert set(row) == {column.key for column in table.columns}
            assert all(isinstance(value, str) or np.isfinite(value) for value in row.values())


@pytest.mark.parametrize("document", sorted(DOCUMENTS.glob("*.md")), ids=lambda path: path.stem)
def test_tables_in_the_derivations_are_those_of_the_bench(document: Path) -> None:
    """After `<!-- bench: NAME -->` stands a part of the table NAME; a row is found by its texts."""
    for name, header, body in re.findall(r"<!-- bench: (\S+) -->\n\n(\|.+\|)\n\|[-|: ]+\|\n((?:\|.+\|\n)+)",
                                         document.read_text(encoding="utf-8")):
        table = bench_tables()[name]
        keys = {column.title: column.key for column in table.columns}
        shown = [keys[title.strip()] for title in header.strip("|").split("|")]
        for line in body.splitlines():
            cells = dict(zip(shown, (cell.strip() for cell in line.strip("|").split("|")), strict=True))
            texts = {key: cell for key, cell in cells.items() if isinstance(table.rows[0][key], str)}
            rows = [row for row in table.rows if all(str(row[key]) == text for key, text in texts.items())]
            assert len(rows) == 1, line
            for key in shown:
                if key not in texts and not isinstance(rows[0][key], str):
                    assert_shows(cells[key], rows[0][key], f"{document.name}, {name}, {key}: {line}")


def assert_shows(cell: str, value: float, where: str) -> None:
    """The printed figure is the value to half a unit of its last digit, and a little for other machines' rounding."""
    text = cell.replace("−", "-")
    decimals = len(text.partition(".")[2])
    assert abs(float(text) - value) <= 0.51 * 10.0**-decimals + COMPARED_PERCENT, where
