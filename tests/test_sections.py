"""Vertical circles hung on a profile: where they end, and where they change too fast to meet."""

from __future__ import annotations

import numpy as np
import pytest

from mirror_cad.errors import ProfileError
from mirror_cad.profile import STEEPEST_SINE
from mirror_cad.sections import check_circles, check_steps, existing_half_height
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev, approximate

HALF = 150.0


def vertical(at: float, width: float, step: float = 1e-3) -> PiecewiseChebyshev:
    """κ_y from 1e-3 up by a step in a smooth ramp of a width about a place, with breaks where the ramp begins and ends."""
    low, high = at - 0.5 * width, at + 0.5 * width

    def kappa(x: np.ndarray) -> np.ndarray:
        u = np.clip((x - low) / width, 0.0, 1.0)
        return 1e-3 + step * u * u * (3.0 - 2.0 * u)

    return approximate(kappa, [-115.0, low, high, 115.0])


SMALL = vertical(30.0, 20.0, 5e-3)  # to a radius of 166.7 mm at the right


@pytest.mark.parametrize("at", [-80.0, 0.0, 35.0, 90.0])
def test_a_law_that_changes_too_fast_is_refused_where_it_does_and_with_its_slope(at: float) -> None:
    """z_x = −κ′·y²/(w(1 + w)), κ′ = 1.5·step/width at the ramp's middle."""
    width = 1.0
    with pytest.raises(ProfileError) as caught:
        check_steps(vertical(at, width), [], -115.0, 115.0, HALF)
    words = str(caught.value)
    x = float(words.split("x = ")[1].split(" mm")[0])
    angle = float(words.split("stand at ")[1].split("°")[0])
    assert abs(x - at) < 0.1 * width
    w = np.sqrt(1.0 - (1.5e-3 * HALF) ** 2)
    assert angle == pytest.approx(np.degrees(np.arctan(1.5e-3 / width * HALF**2 / (w * (1.0 + w)))), abs=0.1)
    check_steps(vertical(at, 10.0), [], -115.0, 115.0, HALF)  # ten times as wide it is as steep as 60°
    # What lies beside the mirror does not count.
    check_steps(vertical(90.0, width), [], -115.0, 80.0, HALF)


def test_a_jump_inside_is_refused_and_one_at_the_edge_is_not() -> None:
    smooth = vertical(0.0, 40.0)
    with pytest.raises(ProfileError, match=r"jumps at x = 12\.50 mm"):
        check_steps(smooth, [-115.0, 12.5], -115.0, 115.0, HALF)
    check_steps(smooth, [-115.0, 115.0], -115.0, 115.0, HALF)


def test_circles_reach_the_edge_or_are_refused_with_the_smallest_radius() -> None:
    check_circles(SMALL, -115.0, 115.0, 166.0)
    with pytest.raises(ProfileError, match=r"radius 166\.7 mm at x = (4\d|[5-9]\d|1\d\d)\.\d mm .* half-height 167\.0 mm"):
        check_circles(SMALL, -115.0, 115.0, 167.0)


def test_of_the_height_as_much_exists_as_the_smallest_circle_reaches_below_its_steepest() -> None:
    assert existing_half_height(SMALL, -115.0, 115.0, 300.0) == pytest.approx(STEEPEST_SINE / 6e-3, rel=1e-9)
    assert existing_half_height(SMALL, -115.0, 115.0, 164.0) == 164.0
