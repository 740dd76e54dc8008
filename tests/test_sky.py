"""The clear sky and its sun: against figures of daylight's standards, and the model's own laws."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from raytrace.errors import SceneError
from raytrace.scene import sky
from raytrace.scene.sky import LUMINANCE, air_extinction, sky_illuminance, sky_radiance, sun_direction, sun_irradiance
from tests.meshes import unit

SUNS_DEG = (10.0, 20.0, 30.0, 45.0, 60.0)
XYZ_FROM_RGB = np.linalg.inv(sky.RGB_FROM_XYZ)


def ies_direct(elevation_deg: float) -> float:
    """Illuminance of a face square to the sun of a clear day, klx: 127.5·exp(−0.21·m).

    Source: IES Recommended practice for the calculation of daylight availability, J. IES 13 (1984) 381.
    """
    return float(127.5 * np.exp(-0.21 / np.sin(np.radians(elevation_deg))))


def ies_clear_sky(elevation_deg: float) -> float:
    """Illuminance of level ground from a clear sky, klx; the same source."""
    return float(0.8 + 15.5 * np.sqrt(np.sin(np.radians(elevation_deg))))


def at(elevation_deg: float, azimuth_deg: float) -> np.ndarray:
    return sun_direction(azimuth_deg, elevation_deg)


def chromaticity(rgb: np.ndarray) -> np.ndarray:
    xyz = rgb @ XYZ_FROM_RGB.T
    return xyz[..., :2] / xyz.sum(axis=-1, keepdims=True)


def test_the_sun_stands_ahead_at_azimuth_0_and_to_the_right_at_90() -> None:
    assert sun_direction(0.0, 30.0) == pytest.approx([-np.sqrt(0.75), 0.0, 0.5])
    assert sun_direction(90.0, 30.0) == pytest.approx([0.0, np.sqrt(0.75), 0.5])
    assert sun_direction(123.0, 90.0) == pytest.approx([0.0, 0.0, 1.0])


def test_outside_the_air_the_sun_gives_what_standards_say() -> None:
    """Between the IES's 127.5 klx and the 133 klx of newer spectra."""
    assert 127.5 <= LUMINANCE @ sky._illuminance(np.ones(len(sky.WAVELENGTH_UM))) <= 133.0


@pytest.mark.parametrize("elevation", SUNS_DEG)
def test_the_direct_sun_of_a_very_clear_day_is_the_ies_s(elevation: float) -> None:
    assert LUMINANCE @ sun_irradiance(at(elevation, 0.0), 2.0) == pytest.approx(ies_direct(elevation), rel=0.06)


def test_at_45_degrees_a_clear_sun_gives_80_to_100_klx_and_the_sky_10_to_20() -> None:
    for turbidity in (2.0, 2.5, 3.0):
        assert 80.0 < LUMINANCE @ sun_irradiance(at(45.0, 0.0), turbidity) < 100.0
        assert 10.0 < sky_illuminance(at(45.0, 0.0), turbidity) < 20.0


@pytest.mark.parametrize("elevation", SUNS_DEG)
def test_a_clear_sky_gives_level_ground_what_the_ies_says(elevation: float) -> None:
    """Half of the scattered light comes down: within 15 % of what was measured."""
    assert sky_illuminance(at(elevation, 0.0), 2.5) == pytest.approx(ies_clear_sky(elevation), rel=0.15)


@pytest.mark.parametrize("turbidity", [2.0, 2.5, 4.0, 6.0])
@pytest.mark.parametrize("elevation", [5.0, 35.0, 90.0])
def test_the_radiance_sums_to_the_illuminance_of_level_ground(turbidity: float, elevation: float) -> None:
    """By the midpoint rule, in other coordinates than the model's own quadrature."""
    height, turn = np.meshgrid((np.arange(300) + 0.5) * (0.5 * np.pi / 300), (np.arange(360) + 0.5) * (2.0 * np.pi / 360))
    level = np.cos(height)
    directions = np.stack([level * np.cos(turn), level * np.sin(turn), np.sin(height)], axis=-1).reshape(-1, 3)
    weights = (level * np.sin(height)).ravel() * (0.5 * np.pi / 300) * (2.0 * np.pi / 360)
    sun = at(elevation, 70.0)
    found = weights @ sky_radiance(directions, sun, turbidity) @ LUMINANCE
    assert found == pytest.approx(sky_illuminance(sun, turbidity), rel=1e-3)


def test_the_luminance_over_the_zenith_s_is_perez_s() -> None:
    """Worked out by hand for T = 3, sun at 45°: A = −0.9269, B = −0.6387, C = 5.257, D = −2.2153, E = 0.1693."""
    sun = at(45.0, 0.0)
    directions = np.array([at(90.0, 0.0), at(45.0, 0.0), at(30.0, 180.0), at(20.0, 90.0)])
    luminance = sky_radiance(directions, sun, 3.0) @ LUMINANCE

    def perez(theta: float, gamma: float) -> float:
        return float((1.0 - 0.9269 * np.exp(-0.6387 / np.cos(theta)))
                     * (1.0 + 5.257 * np.exp(-2.2153 * gamma) + 0.1693 * np.cos(gamma) ** 2))

    right = float(np.arccos(np.sin(np.radians(45.0)) * np.sin(np.radians(20.0))))
    expected = [perez(0.0, np.radians(45.0)), perez(np.radians(45.0), 0.0), perez(np.radians(60.0), np.radians(105.0)),
                perez(np.radians(70.0), right)]
    assert luminance / luminance[0] == pytest.approx(np.array(expected) / expected[0], rel=1e-3)


def test_the_zenith_has_the_published_chromaticity() -> None:
    """The paper's two cubics in θ, written out for T = 3 and a sun at 40°."""
    theta, turbidity = np.radians(50.0), 3.0
    x = turbidity**2 * (0.00166 * theta**3 - 0.00375 * theta**2 + 0.00209 * theta) \
        + turbidity * (-0.02903 * theta**3 + 0.06377 * theta**2 - 0.03202 * theta + 0.00394) \
        + (0.11693 * theta**3 - 0.21196 * theta**2 + 0.06052 * theta + 0.25886)
    y = turbidity**2 * (0.00275 * theta**3 - 0.00610 * theta**2 + 0.00317 * theta) \
        + turbidity * (-0.04214 * theta**3 + 0.08970 * theta**2 - 0.04153 * theta + 0.00516) \
        + (0.15346 * theta**3 - 0.26756 * theta**2 + 0.06670 * theta + 0.26688)
    found = chromaticity(sky_radiance(np.array([[0.0, 0.0, 1.0]]), at(40.0, 0.0), turbidity))[0]
    assert found == pytest.approx([x, y], abs=1e-4)


@given(st.floats(5.0, 90.0), st.floats(-400.0, 400.0), st.floats(2.0, 6.0), st.integers(0, 2**31))
def test_any_sky_is_finite_positive_and_even_about_the_sun_s_bearing(elevation: float, azimuth: float, turbidity: float,
                                                                     seed: int) -> None:
    directions = unit(np.random.default_rng(seed).normal(size=(50, 3)))
    sun = sun_direction(azimuth, elevation)
    found = sky_radiance(directions, sun, turbidity)
    assert np.isfinite(found).all()
    assert (found >= 0.0).all()
    assert (found @ LUMINANCE > 0.05).all()
    across = np.array([np.sin(np.radians(azimuth)), np.cos(np.radians(azimuth)), 0.0])
    other = directions - 2.0 * (directions @ across)[:, None] * across
    assert sky_radiance(other, sun, turbidity) == pytest.approx(found, rel=1e-6, abs=1e-9)


def test_no_part_of_a_sky_is_more_purple_than_a_black_body() -> None:
    directions = np.array([at(h, a) for h in (5.0, 10.0, 40.0, 90.0) for a in (0.0, 60.0, 120.0, 180.0)])
    for turbidity in (2.0, 4.0):
        x, y = chromaticity(sky_radiance(directions, at(35.0, 0.0), turbidity)).T
        assert (y >= -3.0 * x * x + 2.87 * x - 0.275 - 0.007).all()


def test_the_sun_gets_warmer_and_weaker_as_it_sinks_and_in_haze() -> None:
    low_to_high = [sun_irradiance(at(h, 0.0), 2.5) for h in (5.0, 10.0, 20.0, 40.0, 90.0)]
    clear_to_hazy = [sun_irradiance(at(30.0, 0.0), t) for t in (2.0, 3.0, 4.0, 6.0)]
    for suns in (low_to_high[::-1], clear_to_hazy):
        red_over_blue = [s[0] / s[2] for s in suns]
        assert red_over_blue == sorted(red_over_blue)
        assert all((a > b).all() for a, b in pairwise(suns))


def test_the_zenith_is_blue_and_the_horizon_paler() -> None:
    zenith, horizon = sky_radiance(np.array([[0.0, 0, 1], [1.0, 0, 0]]), at(40.0, 0.0), 2.5)
    assert zenith[2] / zenith[0] > 2.5
    assert 0.7 < horizon[2] / horizon[0] < 1.3


def test_a_clear_day_lets_one_see_some_30_km_and_haze_shortens_that() -> None:
    visibility_km = [3.912e-6 / air_extinction(t) for t in (2.0, 2.5, 4.0, 6.0)]
    assert visibility_km[1][1] == pytest.approx(28.5, abs=1.0)
    assert all((a > b).all() for a, b in pairwise(visibility_km))
    assert (np.diff(visibility_km[1]) < 0.0).all()  # blue is scattered first


@pytest.mark.parametrize(("azimuth", "elevation", "message"), [
    (0.0, 4.9, "elevation 4.9° must lie from 5 to 90°"), (0.0, 90.1, "elevation 90.1°"), (0.0, float("nan"), "elevation nan°"),
    (float("inf"), 30.0, "azimuth inf must be a number"),
])
def test_a_sun_that_the_model_does_not_hold_for_is_refused(azimuth: float, elevation: float, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        sun_direction(azimuth, elevation)


@pytest.mark.parametrize("turbidity", [1.9, 6.1, float("nan")])
def test_a_turbidity_outside_the_model_is_refused(turbidity: float) -> None:
    with pytest.raises(SceneError, match=r"turbidity .* must lie from 2 \(very clear\) to 6 \(hazy\)"):
        sky_radiance(np.array([[0.0, 0.0, 1.0]]), at(30.0, 0.0), turbidity)
