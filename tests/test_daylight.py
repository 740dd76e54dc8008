"""Daylight as kernels have it: the table of the sky, irradiance by harmonics, the sun's disc, exposure and tone curve."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from raytrace.scene import shading
from raytrace.scene.daylight import GRAY, WHITE, Daylight, tone_curve
from raytrace.scene.materials import linear
from raytrace.scene.sky import LUMINANCE, SUN_RADIUS, sky_radiance, sun_direction
from tests.meshes import unit


def seen(daylight: Daylight, directions: np.ndarray, spread: float = 1e-4, disc: bool = False) -> np.ndarray:
    """Radiance of sky and ground."""
    out = np.empty(directions.shape)
    shading.surroundings(directions, np.full(len(directions), spread), shading.Light.of(daylight), disc, out)
    return out


def half_space(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions over the upper half space and their solid angles, by the midpoint rule in sin h."""
    azimuth = (np.arange(columns) + 0.5) * 2.0 * np.pi / columns
    up, turn = (g.ravel() for g in np.meshgrid((np.arange(rows) + 0.5) / rows, azimuth))
    level = np.sqrt(1.0 - up**2)
    return np.stack([level * np.cos(turn), level * np.sin(turn), up], axis=1), np.full(up.size, 2.0 * np.pi / up.size)


@pytest.mark.parametrize(("elevation", "turbidity"), [(5.0, 2.0), (40.0, 2.5), (90.0, 6.0)])
def test_the_tabulated_sky_is_the_model_s(elevation: float, turbidity: float) -> None:
    """Within 1.5 % where the sun's glow has its cusp, 0.7 % beyond 5° from it (on the octahedron's edges), 0.02 % as a mean."""
    sun = sun_direction(33.0, elevation)
    directions = unit(np.random.default_rng(1).normal(size=(50_000, 3)) * [1.0, 1.0, 0.4])
    directions[:, 2] = np.abs(directions[:, 2])
    directions[:2000] = unit(sun + 0.05 * np.random.default_rng(2).normal(size=(2000, 3)))
    directions[:, 2] = np.abs(directions[:, 2])
    found = seen(Daylight.clear(33.0, elevation, turbidity), directions)
    exact = sky_radiance(directions, sun, turbidity)
    off = np.abs((found - exact) @ LUMINANCE) / (exact @ LUMINANCE)
    assert off.max() < 0.015
    assert off[directions @ sun < np.cos(np.radians(5.0))].max() < 7e-3
    assert off[2000:].mean() < 2e-4


@pytest.mark.parametrize(("elevation", "turbidity", "most"), [(20.0, 2.5, 0.03), (35.0, 2.5, 0.02), (50.0, 2.5, 0.01),
                                                             (90.0, 4.0, 0.01), (35.0, 6.0, 0.02), (5.0, 2.0, 0.06)])
def test_irradiance_by_harmonics_is_that_of_the_whole_sphere(elevation: float, turbidity: float, most: float) -> None:
    """Against a sum over 40,000 directions; `most` of the mean over all normals."""
    daylight = Daylight.clear(30.0, elevation, turbidity)
    upper, weights = half_space(100, 200)
    normals = unit(np.random.default_rng(3).normal(size=(300, 3)))
    light = sky_radiance(upper, daylight.sun, turbidity)
    exact = (np.maximum(normals @ upper.T, 0.0) * weights) @ light
    exact += ((np.maximum(normals @ (upper * [1.0, 1.0, -1.0]).T, 0.0) * weights).sum(axis=1))[:, None] * daylight.below
    off = np.abs((daylight.irradiance(normals) - exact) @ LUMINANCE) / (exact @ LUMINANCE).mean()
    assert off.max() < most


def test_under_an_even_sky_over_a_white_ground_every_face_gets_pi_times_its_radiance() -> None:
    """Closed form: what level ground gets is π·L, and it sends L back."""
    daylight = Daylight.under(lambda d: np.full(d.shape, 2.5), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), ground=(1.0, 1.0, 1.0))
    assert daylight.below == pytest.approx(np.full(3, 2.5), rel=1e-12)
    normals = unit(np.random.default_rng(4).normal(size=(100, 3)))
    assert daylight.irradiance(normals) == pytest.approx(np.full((100, 3), 2.5 * np.pi), rel=1e-6)
    assert seen(daylight, normals) == pytest.approx(np.full((100, 3), 2.5), rel=1e-6)


def test_an_even_sky_over_black_ground_lights_a_tilted_face_by_its_cosine() -> None:
    """Closed form: E = π·L·(1 + cos β)/2, which harmonics of order 2 give without an error."""
    daylight = Daylight.under(lambda d: np.full(d.shape, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), ground=(0.0, 0.0, 0.0))
    tilt = np.linspace(0.0, np.pi, 19)
    normals = np.stack([np.sin(tilt), np.zeros(19), np.cos(tilt)], axis=1)
    expected = np.pi * 0.5 * (1.0 + np.cos(tilt))
    assert daylight.irradiance(normals)[:, 1] == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("spread", [1e-4, 1e-3, 4e-3])
def test_the_sun_s_disc_gives_its_irradiance_at_any_softness(spread: float) -> None:
    daylight = Daylight.clear(40.0, 35.0, 2.5)
    place = (np.arange(400) + 0.5) / 200.0 - 1.0
    a, b = (2.2 * SUN_RADIUS * g.ravel() for g in np.meshgrid(place, place))
    right = unit(np.cross(daylight.sun, [0.0, 0.0, 1.0]))
    directions = unit(daylight.sun + a[:, None] * right + b[:, None] * np.cross(right, daylight.sun))
    disc = seen(daylight, directions, spread, True) - seen(daylight, directions, spread, False)
    assert disc.sum(axis=0) * (2.2 * SUN_RADIUS / 200.0) ** 2 == pytest.approx(daylight.sun_irradiance, rel=2e-3)
    assert (disc[np.hypot(a, b) > 2.0 * SUN_RADIUS] == 0.0).all()


@pytest.mark.parametrize("elevation", [5.0, 40.0, 90.0])
@pytest.mark.parametrize("ev", [-1.0, 0.0, 1.5])
def test_a_gray_card_on_the_ground_is_gray_in_the_picture(elevation: float, ev: float) -> None:
    """18 % under sun and sky become 0.18·2^ev of white, in all channels, to the rounding of a value."""
    daylight = Daylight.clear(10.0, elevation, 2.5, ev=ev)
    card = GRAY * daylight.below / np.array([0.115, 0.125, 0.095])  # the ground's mean reflectance gives `below`
    wanted = 255.0 * (1.055 * (0.18 * 2.0**ev) ** (1.0 / 2.4) - 0.055)
    assert (np.abs(daylight.display(card) - wanted) <= 0.5).all()
    level = daylight.irradiance([[0.0, 0.0, 1.0]])[0] + daylight.sun[2] * daylight.sun_irradiance
    assert GRAY / np.pi * level == pytest.approx(card, rel=0.05)


@given(st.floats(0.0, 100.0), st.floats(0.0, 100.0))
def test_the_tone_curve_rises(a: float, b: float) -> None:
    low, high = sorted((a, b))
    assert tone_curve(low) <= tone_curve(high)


def test_the_tone_curve_keeps_the_dark_and_reaches_white_where_it_says() -> None:
    assert tone_curve(1e-6) == pytest.approx(1e-6, rel=1e-5)
    assert tone_curve(WHITE) == pytest.approx(1.0)


def test_display_values_are_srgb_s_and_stay_within_a_byte() -> None:
    daylight = Daylight.under(lambda d: np.full(d.shape, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    x = np.concatenate([[0.0, 1e-4], np.geomspace(1e-3, WHITE, 500), [50.0, 1e9]])
    gray = x[:, None] / daylight.scale
    values = daylight.display(gray)
    assert values.dtype == np.uint8
    assert (np.diff(values.astype(int), axis=0) >= 0).all()
    assert (values[-3:] == 255).all()
    assert (values[0] == 0).all()
    wanted = np.minimum(tone_curve(x), 1.0)
    assert np.abs(linear(values)[:, 0] - wanted).max() < 0.005  # half a step where steps are widest
    assert daylight.display(gray.reshape(8, -1, 3)).shape == (8, len(x) // 8, 3)


def test_a_bright_colour_pales_and_keeps_its_luminance() -> None:
    daylight = Daylight.under(lambda d: np.full(d.shape, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    orange = np.array([[1.0, 0.35, 0.05]]) / daylight.scale
    strengths = np.geomspace(0.01, 50.0, 60)
    shown = linear(daylight.display(strengths[:, None] * orange))
    luminance = strengths * float(LUMINANCE @ [1.0, 0.35, 0.05])
    wanted = np.minimum(tone_curve(luminance), 1.0)
    assert np.abs(shown @ LUMINANCE - wanted).max() < 0.005
    assert (np.diff(shown, axis=0) >= 0.0).all()
    assert (shown[-1] == 1.0).all()
