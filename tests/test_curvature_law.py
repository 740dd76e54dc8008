"""κ(x) beyond the mirror's edges, and where it breaks: against derivatives and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

import mirror_cad as mc
from mirror_cad.laws.curvature import Break, CurvatureLaw, Span, smooth_extrapolation
from mirror_cad.laws.matching import solve_match
from mirror_cad.profile import sine_of_tangent_angle
from mirror_cad.section_fov import section_fov_of_sine

Array = NDArray[np.float64]
EDGES = (-115.0, 115.0)
LARGEST = 0.01  # 1/mm, what the extrapolation keeps away from


def wave(x: Array, order: int = 0) -> Array:
    """A wave about 1/(1000 mm), and its derivatives."""
    return 1e-3 * (order == 0) + 3e-4 * np.sin(x / 40.0 + 0.5 * np.pi * order) / 40.0**order


@pytest.mark.parametrize("edge", EDGES)
def test_value_slope_and_bend_of_a_law_go_on_beyond_its_edge(edge: float) -> None:
    law = smooth_extrapolation(CurvatureLaw(wave, ()), *EDGES, LARGEST)
    beyond = edge + 0.5 * np.sign(edge) * np.arange(1, 10)  # tanh(d/L) with L = 23 mm: its ninth power is 1e-12 there
    outside = Polynomial.fit(beyond, law.at(beyond), 8)
    for order, relative in ((0, 1e-12), (1, 1e-10), (2, 1e-8)):
        assert outside.deriv(order)(edge) == pytest.approx(wave(np.array(edge), order), rel=relative)
    assert law.at(np.array([edge]))[0] == wave(np.array(edge))
    x = np.linspace(*EDGES, 101)[1:-1]
    assert law.at(x) == pytest.approx(wave(x), rel=1e-12)


@pytest.mark.parametrize(("slope", "bend", "level"), [
    (1e-6, 0.0, 1e-3 + 1e-6 * 23.0),  # gently: level after a tenth of the width
    (4e-4, 0.0, 1e-3 + 0.25 * (LARGEST - 1e-3)),  # steeply: a quarter of the way for the slope,
    (0.0, 4e-5, 1e-3 + 0.25 * (LARGEST - 1e-3)),  # and one for the bend
    (0.0, 0.0, 1e-3),
])
def test_a_law_levels_off_before_half_the_way_to_the_largest_curvature(slope: float, bend: float, level: float) -> None:
    right = EDGES[1]

    def kappa(x: Array) -> Array:
        # Flat up to 1 mm before the right edge, so that the law itself stays small.
        d = np.asarray(x) - right
        return 1e-3 + np.where(d > -1.0, slope * d + 0.5 * bend * d**2, slope * -1.0 + 0.5 * bend)

    law = smooth_extrapolation(CurvatureLaw(kappa, (Break(right - 1.0, 0),)), *EDGES, LARGEST)
    assert law.at(np.array([right + 1e4]))[0] == pytest.approx(level, rel=1e-6)  # second derivatives of a series
    beyond = law.at(right + np.linspace(0.0, 200.0, 2001))
    assert (np.diff(beyond) >= -1e-12).all()


def test_the_law_is_said_to_be_smooth_to_the_second_derivative_at_its_edges() -> None:
    law = smooth_extrapolation(CurvatureLaw(wave, (Break(-115.0, 0), Break(20.0, 1), Break(115.0, -1))), *EDGES, LARGEST)
    assert law.breaks == (Break(-115.0, 2), Break(20.0, 1), Break(115.0, 2))


@pytest.mark.parametrize(("jump", "smoothness"), [(1e-4, -1), (0.0, 0)])
def test_a_break_that_nobody_announced_is_found_and_told_for_a_jump_or_a_kink(jump: float, smoothness: int) -> None:
    at = 31.234567

    def kappa(x: Array) -> Array:
        return 1e-3 + np.where(x < at, 0.0, jump + 1e-6 * (x - at))

    law = CurvatureLaw(kappa, (Break(-50.0, 2),))
    found = law.all_breaks(law.series(*EDGES))
    assert [b.smoothness for b in found] == [2, smoothness]
    assert found[1].x_mm == pytest.approx(at, abs=5e-3)


# --- the laws' own breaks and numbers ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("exponent", "smoothness"), [(0.5, 0), (1.0, 0), (1.5, 1), (2.0, 1), (2.5, 2), (3.0, 2)])
def test_a_power_law_says_how_smooth_it_begins_and_that_it_ends_in_a_kink(exponent: float, smoothness: int) -> None:
    """R = right + (left − right)·t^n, held beyond: at t = 0 derivatives up to the ⌈n⌉ − 1st go on, as its series shows."""
    law = mc.laws.Power(right_mm=1250.0, left_mm=400.0, exponent=exponent).over(Span(*EDGES))
    assert law.breaks == (Break(-115.0, 0), Break(115.0, smoothness))
    shown = dict(law.series(-130.0, 130.0).breakpoints())
    assert shown[-115.0] == 0
    if exponent in (1.0, 2.0):  # of others the series has pieces that crowd at the break
        assert shown[115.0] == smoothness
    even = mc.laws.Power(right_mm=800.0, left_mm=800.0, exponent=exponent).over(Span(*EDGES))
    assert even.breaks == ()


@pytest.mark.parametrize(("make", "low", "high", "low_counts"), [
    (lambda value: mc.laws.Zones(right_mm=1250.0, left_mm=400.0, blend_from=value, blend_to=1.0), 0.0, None, True),
    (lambda value: mc.laws.Power(right_mm=1250.0, left_mm=400.0, exponent=value), 0.0, 50.0, False),
])
def test_a_number_that_may_be_open_may_be_stated_up_to_its_ends(make: object, low: float, high: float | None,
                                                                low_counts: bool) -> None:
    if low_counts:
        make(low)  # type: ignore[operator]
    else:
        with pytest.raises(mc.SpecError, match=f"above {low:g}"):
            make(low)  # type: ignore[operator]
    with pytest.raises(mc.SpecError):
        make(np.nextafter(low, -1.0))  # type: ignore[operator]
    if high is not None:
        make(high)  # type: ignore[operator]
        with pytest.raises(mc.SpecError, match=f"at most {high:g}"):
            make(np.nextafter(high, 99.0))  # type: ignore[operator]


class Spike(mc.laws.Matched):
    """A curvature that is nearly all in a spike narrower than what the rough search looks at, of an open height."""

    title = "spike"
    open_key = "height"

    law: str = "spike"
    height: float | str

    def over(self, span: Span) -> CurvatureLaw:
        return CurvatureLaw(lambda x: 1e-3 + self.parameter * np.exp(-(((x - 20.2) / 0.02) ** 2)), (Break(20.2, 2),))

    def scaled(self, factor: float) -> Spike:
        raise NotImplementedError

    def in_words(self, solved: float | None = None) -> str:
        return "spike"

    def candidates(self) -> Array:
        return np.array([0.0, 0.1, 0.2, 0.3])


@pytest.mark.parametrize("height", [0.05, 0.15, 0.25])
def test_what_the_rough_search_for_an_open_number_cannot_see_is_found_between_any_candidates(height: float) -> None:
    law = Spike(height="match", match=mc.laws.Match(h_fov_deg=45.0))
    kappa = law.with_parameter(height).over(Span(*EDGES)).series(*EDGES)
    wanted = np.degrees(section_fov_of_sine(sine_of_tangent_angle(kappa, 0.0), *EDGES, 762.0))
    law = Spike(height="match", match=mc.laws.Match(h_fov_deg=float(wanted)))
    assert solve_match(law, 762.0, Span(*EDGES), *EDGES, 0.0) == ("height", pytest.approx(height, abs=1e-9))
