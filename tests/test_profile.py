"""The profile: exact integrals against closed forms, and the paper's Euler against them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import mirror_cad
from mirror_cad import laws
from mirror_cad.laws.curvature import Span
from mirror_cad.laws.matching import ROUGH_SAMPLES
from mirror_cad.profile import Profile, integrate_exactly, integrate_ode, sine_of_tangent_angle
from mirror_cad.section_fov import circle_section_fov, rough_section_fov, section_fov, section_fov_of_sine
from mirror_cad.surfaces.piecewise import approximate
from tests.conftest import constant, spec_of

SPAN = Span(-115.0, 115.0)
X = np.linspace(-129.0, 129.0, 1001)


def exact(law: laws.CurvatureLaw) -> Profile:
    kappa = law.series(-130.0, 130.0)
    return integrate_exactly(sine_of_tangent_angle(kappa, 0.0), kappa)


@pytest.mark.parametrize("radius", [131.0, 400.0, 950.0, 1e6, -700.0])
def test_constant_law_gives_the_circle(radius: float) -> None:
    # z = −κx²/(1 + √(1 − κ²x²)) loses no digits; 1e-12 mm is the promise, and some 20 units of rounding of 100 mm.
    kappa = 1.0 / radius
    circle = -kappa * X**2 / (1.0 + np.sqrt(1.0 - (kappa * X) ** 2))
    assert np.abs(exact(laws.Constant(radius_mm=radius).over(SPAN)).height(X) - circle).max() < 1e-12


def test_flat_law_gives_the_plane() -> None:
    assert np.abs(exact(laws.Constant(radius_mm=np.inf).over(SPAN)).height(X)).max() == 0.0


def test_clothoid_in_closed_form() -> None:
    """κ linear in arc length: with θ = a·s²/2, x and z are the Fresnel integrals."""
    from scipy.special import fresnel

    a = 2e-5  # 1/mm²
    s = np.linspace(0.0, 120.0, 200)
    scale = np.sqrt(np.pi / a)
    fresnel_s, fresnel_c = fresnel(s / scale)
    x, z = scale * fresnel_c, -scale * fresnel_s

    def kappa_of_x(at: np.ndarray) -> np.ndarray:
        arc = np.abs(at)
        for _ in range(50):  # Newton for s(x) on x = scale·C(s/scale), whose derivative is cos θ
            arc = arc - (scale * fresnel(arc / scale)[1] - np.abs(at)) / np.cos(0.5 * a * arc**2)
        return a * arc

    law = laws.CurvatureLaw(kappa_of_x, (laws.Break(0.0, 0),))
    kappa = law.series(-10.0, float(x[-1]))
    profile = integrate_exactly(sine_of_tangent_angle(kappa, 0.0), kappa)
    assert np.abs(profile.height(x) - z).max() < 1e-12


def test_progressive_profile_agrees_with_an_independent_ode_solver() -> None:
    law = laws.Zones(right_mm=1250.0, left_mm=400.0, blend_from=0.5865).over(SPAN)

    def rates(x: float, y: np.ndarray) -> list[float]:
        return [y[1], -float(law.function(np.array([x]))[0]) * (1.0 + y[1] ** 2) ** 1.5]

    solved = solve_ivp(rates, [0.0, -115.0], [0.0, 0.0], method="DOP853", rtol=1e-13, atol=1e-15, max_step=2.0)
    # 1e-12 of 10 mm is what that solver's own tolerance leaves.
    assert abs(solved.y[0, -1] - float(exact(law).height(np.array([-115.0]))[0])) < 2e-12


@pytest.mark.parametrize(("method", "order"), [("euler", 1), ("rk4", 4)])
def test_march_converges_with_its_order(method: str, order: int) -> None:
    law = laws.Expression(curvature="0.001*exp(-x/120)").over(SPAN)  # smooth: no break limits the order
    kappa = law.series(-114.0, 114.0)
    reference = integrate_exactly(sine_of_tangent_angle(kappa, 0.0), kappa)
    errors = []
    for step in (16.0, 8.0):
        marched = integrate_ode(kappa, reference, method, step)
        at = np.linspace(-110.0, 110.0, 301)
        errors.append(np.abs(marched.height(at) - reference.height(at)).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25)


def test_euler_curvature_error_is_h_times_relative_slope_of_curvature() -> None:
    law = laws.Linear(right_mm=1250.0, left_mm=400.0).over(SPAN)
    kappa = law.series(-114.9, 114.9)
    marched = integrate_ode(kappa, exact(law), "euler", 0.5)
    at = np.linspace(-100.0, 100.0, 201)
    realised = -marched.bend(at) / (1.0 + marched.slope(at) ** 2) ** 1.5
    designed = kappa(at)
    # To the left of the step's start, κ is that of up to one step to the right: between 0 and h·|κ'|/κ, on average half.
    # The spline takes the second difference at the middle of its three points, hence one whole step.
    predicted = -0.5 * kappa.derivative()(at) / designed * -1.0
    assert np.abs((realised / designed - 1.0) - predicted).max() < 0.1 * np.abs(predicted).max()


def test_section_field_of_view_of_a_circle_is_the_closed_form() -> None:
    for radius in (400.0, 950.0, 1250.0, -900.0):
        measured = section_fov(exact(laws.Constant(radius_mm=radius).over(SPAN)), -115.0, 115.0, 762.0)
        assert measured == pytest.approx(circle_section_fov(1.0 / radius, 115.0, 762.0), abs=1e-14)


@pytest.mark.parametrize("level", [-115.0, 0.0, 40.0])
def test_the_rough_field_of_view_is_that_of_the_section_to_what_the_search_relies_on(level: float) -> None:
    """Level anywhere; far better than ROUGH, by the second order of its step."""
    x = np.linspace(-115.0, 115.0, ROUGH_SAMPLES)
    for law in (laws.Constant(radius_mm=700.0), laws.Linear(right_mm=1250.0, left_mm=500.0),
                laws.Zones(right_mm=1250.0, left_mm=400.0, blend_from=0.59)):
        kappa = law.over(SPAN)
        sine = sine_of_tangent_angle(kappa.series(-115.0, 115.0), level)
        wanted = section_fov(integrate_exactly(sine, kappa.series(-115.0, 115.0)), -115.0, 115.0, 762.0)
        assert section_fov_of_sine(sine, -115.0, 115.0, 762.0) == pytest.approx(wanted, abs=1e-12)
        assert rough_section_fov(x, kappa.at(x), level, 762.0) == pytest.approx(wanted, abs=1e-5)
        assert rough_section_fov(x[::2], kappa.at(x[::2]), level, 762.0) == pytest.approx(wanted, abs=4e-5)
    assert np.isnan(rough_section_fov(x, np.full_like(x, 1.0 / 120.0), level, 762.0))


def test_mirror_of_linear_curvature_widens_the_view_by_width_times_curvatures() -> None:
    """An eye at infinity and κ linear along x: the widening is 2·(θ_r − θ_l) with sin θ = ∫κ dx, about W·(κ1 + κ2)."""
    law = laws.Expression(curvature="0.0012 - 0.000001*x").over(SPAN)
    profile = exact(law)
    measured = section_fov(profile, -115.0, 115.0, 1e12)
    sine = [0.0012 * x - 0.0000005 * x * x for x in (115.0, -115.0)]
    assert measured == pytest.approx(2.0 * (np.arcsin(sine[0]) - np.arcsin(sine[1])), abs=1e-9)


@given(st.floats(-2e-3, 2e-3), st.floats(-1e-5, 1e-5), st.floats(-3.0, 3.0))
def test_realised_curvature_of_any_smooth_profile_is_the_law(k0: float, k1: float, phase: float) -> None:
    law = laws.Expression(curvature=f"{k0!r} + {k1!r}*x + 0.0003*sin(x/30 + {phase!r})").over(SPAN)
    kappa = law.series(-130.0, 130.0)
    profile = integrate_exactly(sine_of_tangent_angle(kappa, 0.0), kappa)
    realised = -profile.bend(X) / (1.0 + profile.slope(X) ** 2) ** 1.5
    assert np.abs(realised - law.function(X)).max() < 1e-15 + 1e-11 * np.abs(law.function(X)).max()


def test_series_finds_kinks_that_a_formula_hides() -> None:
    law = laws.Expression(curvature="max(0.001, 0.001 + 0.00001*(x - 20.5))").over(SPAN)
    kappa = law.series(-130.0, 130.0)
    assert any(abs(b.x_mm - 20.5) < 1e-3 for b in law.all_breaks(kappa))
    assert np.abs(kappa(X) - law.function(X)).max() < 1e-12


def test_series_of_rounding_noise_ends() -> None:
    noisy = approximate(lambda x: 1e-3 + 1e-16 * np.sin(1e6 * x) + (x + 1e5 - 1e5 - x), [-100.0, 100.0])
    at = np.linspace(-100.0, 100.0, 999)
    assert np.abs(noisy(at) - 1e-3).max() < 1e-10  # the noise itself is 2e-11


def test_matched_shape_parameters_of_the_paper() -> None:
    assert mirror_cad.design(mirror_cad.load_spec("progressive-c")).matched == ("blend_from", pytest.approx(0.5865, abs=1e-3))
    power = {"law": "power", "right_mm": 1250.0, "left_mm": 400.0, "exponent": "match", "match": {"sphere_mm": 950.0}}
    assert mirror_cad.design(spec_of(power, constant(1250.0))).matched == ("exponent", pytest.approx(2.8995, abs=1e-3))
    linear = {"law": "zones", "right_mm": 1250.0, "left_mm": 400.0, "blend_from": "match", "blend": "linear",
              "match": {"h_fov_deg": 44.822248439}}
    assert mirror_cad.design(spec_of(linear, constant(1250.0))).matched == ("blend_from", pytest.approx(0.535, abs=1e-3))


def test_impossible_profiles_are_refused_with_place_and_numbers() -> None:
    with pytest.raises(mirror_cad.ProfileError, match=r"turns vertical at x = -100\.\d mm of -115\.0 mm .*1\.00"):
        mirror_cad.design(spec_of(constant(100.0), constant(1250.0)))
    with pytest.raises(mirror_cad.ProfileError, match=r"160\.0 mm .* half-height 163\.\d mm"):
        mirror_cad.design(spec_of(constant(1250.0), constant(160.0)))


def test_as_few_and_as_many_steps_are_taken_as_the_message_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eight steps over the whole sheet, 0.26 m of it, are the fewest; the most, here 40, are too."""
    monkeypatch.setattr("mirror_cad.profile.LONGEST_MARCH", 40)
    kappa = laws.Constant(radius_mm=1000.0).over(SPAN).series(-130.0, 130.0)
    circle = integrate_exactly(sine_of_tangent_angle(kappa, 0.0), kappa)
    for step, count in ((260.0 / 8, 8), (260.0 / 40, 40)):
        assert integrate_ode(kappa, circle, "rk4", step).steps == count
    for step, count in ((260.0 / 7, 7), (260.0 / 41, 41)):
        with pytest.raises(mirror_cad.ProfileError, match=rf"gives {count} steps .* choose it between 6\.5 and 32\.5 mm"):
            integrate_ode(kappa, circle, "rk4", step)


def test_match_without_a_solution_names_the_range_that_can_be_reached() -> None:
    law = {"law": "zones", "right_mm": 1250.0, "left_mm": 400.0, "blend_from": "match", "match": {"h_fov_deg": 90.0}}
    with pytest.raises(mirror_cad.SpecError, match=r"90\.00°.*reaches 38\.\d\d° to 54\.\d\d°"):
        mirror_cad.design(spec_of(law, constant(1250.0)))
