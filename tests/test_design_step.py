"""What makes a design quick changes nothing: short cuts are compared with what they stand in for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.polynomial import chebyshev
from scipy.optimize import brentq

from mirror_cad import laws
from mirror_cad.design_stages import design
from mirror_cad.errors import SpecError
from mirror_cad.grid import Grid
from mirror_cad.laws.curvature import Span
from mirror_cad.laws.matching import solve_match
from mirror_cad.profile import integrate_exactly, sine_of_tangent_angle
from mirror_cad.section_fov import STEEPEST_GAUSS, circle_section_fov, rough_section_fov, section_fov, section_fov_of_sine
from mirror_cad.spec.file import load_spec, validate_spec
from mirror_cad.surfaces.differential import rms_norm
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.measures.lane import lane_heights
from tests.conftest import designed, face_of

SPAN = Span(-115.0, 115.0)


@given(st.integers(1, 25), st.integers(0, 2**32 - 1))
def test_series_evaluate_integrate_and_differentiate_as_numpys_do(count: int, seed: int) -> None:
    """Random coefficients of size 1 on two pieces, against numpy.polynomial; rounding grows with k² at the ends."""
    c = np.random.default_rng(seed).normal(size=(2, count))
    ends, x = np.array([-3.0, -1.0, 2.0]), np.linspace(-3.0, 2.0, 101)
    ours = PiecewiseChebyshev(ends, c)
    pieces = [chebyshev.Chebyshev(c[i], domain=ends[i:i + 2]) for i in range(2)]
    wanted = [np.where(x < ends[1], left, right) for left, right in (
        (pieces[0](x), pieces[1](x)), (pieces[0].deriv()(x), pieces[1].deriv()(x)))]
    np.testing.assert_allclose(ours(x), wanted[0], atol=1e-12)
    np.testing.assert_allclose(ours.derivative()(x), wanted[1], atol=1e-10)
    first = pieces[0].integ(lbnd=ends[0])
    second = pieces[1].integ(lbnd=ends[1], k=float(first(ends[1])))
    whole = np.where(x < ends[1], first(x), second(x))
    np.testing.assert_allclose(ours.integral(-3.0)(x), whole, atol=1e-12)


@pytest.mark.parametrize("radius", [120.0, 150.0, 165.0, 300.0, 1250.0, -400.0, 1e9])
def test_section_from_the_sine_alone_is_a_circles(radius: float) -> None:
    """Closed form; steep ones (sin θ up to 0.96) take the whole profile."""
    kappa = laws.Constant(radius_mm=radius).over(SPAN).series(-115.0, 115.0)
    found = section_fov_of_sine(sine_of_tangent_angle(kappa, 0.0), -115.0, 115.0, 762.0)
    assert found == pytest.approx(circle_section_fov(1.0 / radius, 115.0, 762.0), abs=2e-14)


@given(st.floats(200.0, 3000.0), st.floats(200.0, 3000.0), st.floats(0.0, 0.8), st.floats(-100.0, 100.0))
def test_section_from_the_sine_alone_is_the_profiles(right: float, left: float, start: float, level: float) -> None:
    kappa = laws.Zones(right_mm=right, left_mm=left, blend_from=start).over(SPAN).series(-115.0, 115.0)
    sine = sine_of_tangent_angle(kappa, level)
    steepest = float(np.abs(sine(np.linspace(-115.0, 115.0, 2001))).max())
    assume(steepest < 0.999)  # beyond, it is vertical but for rounding
    exact = section_fov(integrate_exactly(sine, kappa), -115.0, 115.0, 762.0)
    # Rounding of the height, some 1e-14 of it, grows with the slope.
    assert section_fov_of_sine(sine, -115.0, 115.0, 762.0) == pytest.approx(exact, abs=1e-13 if steepest < 0.95 else 1e-11)
    x = np.linspace(-115.0, 115.0, 513)
    rough = rough_section_fov(x, kappa(x), level, 762.0)
    assert rough == pytest.approx(exact, abs=1e-4) if np.isfinite(rough) else steepest > 0.99 * STEEPEST_GAUSS


def test_a_profile_that_turns_vertical_has_no_section() -> None:
    kappa = laws.Constant(radius_mm=100.0).over(SPAN).series(-115.0, 115.0)
    assert np.isnan(section_fov_of_sine(sine_of_tangent_angle(kappa, 0.0), -115.0, 115.0, 762.0))
    assert np.isnan(rough_section_fov(np.linspace(-115.0, 115.0, 513), np.full(513, 0.01), 0.0, 762.0))


@given(st.floats(600.0, 3000.0), st.floats(150.0, 590.0), st.floats(300.0, 2500.0), st.booleans())
def test_match_is_the_first_root_that_a_full_search_finds(right: float, left: float, sphere: float, power: bool) -> None:
    """Seventeen exact values and Brent's method between the first two of unlike sign, or the same refusal."""
    kind = laws.Power if power else laws.Zones
    key = "exponent" if power else "blend_from"
    section = kind.model_validate({"law": "power" if power else "zones", "right_mm": right, "left_mm": left, key: "match",
                                   "match": {"sphere_mm": sphere}})
    wanted = circle_section_fov(1.0 / sphere, 115.0, 762.0)

    def miss(value: float) -> float:
        kappa = section.with_parameter(value).over(SPAN).series(-115.0, 115.0)
        sine = sine_of_tangent_angle(kappa, 0.0)
        if np.abs(sine(np.linspace(-115.0, 115.0, 201))).max() >= 1.0:
            return np.nan
        return section_fov(integrate_exactly(sine, kappa), -115.0, 115.0, 762.0) - wanted

    values = np.geomspace(0.02, 50.0, 17) if power else np.linspace(0.0, 0.999, 17)
    misses = [miss(value) for value in values]
    brackets = [i for i in range(16) if misses[i] * misses[i + 1] <= 0]
    if not brackets:
        with pytest.raises(SpecError, match="reaches"):
            solve_match(section, 762.0, SPAN, -115.0, 115.0, 0.0)
        return
    root = brentq(miss, values[brackets[0]], values[brackets[0] + 1], xtol=1e-12)
    found = solve_match(section, 762.0, SPAN, -115.0, 115.0, 0.0)
    assert found
    assert found[0] == key
    assert abs(miss(found[1])) <= 1e-12
    assert found[1] == pytest.approx(root, abs=1e-9 * max(1.0, abs(root)))


def test_what_is_kept_between_designs_does_not_change_them() -> None:
    """A design after another with the same outline and one law the same is bit for bit what it is alone."""
    spec = load_spec("progressive-c")
    raw = spec.model_dump(mode="python", exclude_none=True)
    raw["vertical"]["left_mm"] = 1375.0
    other = validate_spec(raw)
    design(spec)
    warm = design(other)
    import mirror_cad.design_stages as module

    for kept in (module._truck_outline, module._solved, module._law, module._extrapolated, module._series, Grid.over):
        kept.cache_clear()
    cold = design(other)
    np.testing.assert_array_equal(warm.surface.poles, cold.surface.poles)
    assert warm.matched == cold.matched


def test_rms_of_the_laws_is_that_over_all_cells() -> None:
    mirror = designed("progressive-c")
    grid = Grid.over(mirror.outline)
    everywhere = rms_norm(mirror.curvature.shape(grid.x), grid.weights)
    assert mirror.curvature.rms(mirror.outline) == pytest.approx(everywhere, rel=1e-13)


def test_lane_heights_are_roots_one_by_one() -> None:
    mirror = designed("progressive-c")
    setting = ViewingSetup.of(mirror.spec, mirror.box)
    x = np.array([115.0, 40.0, -115.0])
    y_min, y_max = mirror.surface.domain[2:]
    face = face_of(mirror)
    found = lane_heights(face, setting.eye, setting.lane, x, y_min, y_max)
    for at, height in zip(x, found, strict=True):
        alone = brentq(lambda y, at=at: float(setting.lane.above(*face.reflected_at(
            setting.eye, np.array([at]), np.array([y])))[0]), height - 3.0, height + 3.0, xtol=1e-11)
        assert height == pytest.approx(alone, abs=1e-9)
    far = lane_heights(face, setting.eye, type(setting.lane)(0.0, 1e7, 0.0, setting.plane_z_mm), x, y_min, y_max)
    assert np.isnan(far).all()


def test_reflection_on_a_grid_is_that_at_its_places() -> None:
    mirror = designed("progressive-c")
    eye, x, y = np.array([115.0, 0.0, 753.0]), np.array([100.0, -20.0]), np.array([-50.0, 3.0, 120.0])
    face = face_of(mirror)
    points, directions = face.reflected_on_grid(eye, x, y)
    one, other = face.reflected_at(eye, np.repeat(x, 3), np.tile(y, 2))
    np.testing.assert_allclose(points, one, atol=1e-11)
    np.testing.assert_allclose(directions, other, atol=1e-14)
