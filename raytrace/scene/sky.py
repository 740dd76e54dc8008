"""The sun's place and the air's turbidity in, the clear sky's radiance and the sun's irradiance out, in linear sRGB.

Radiance is in kcd/m² and irradiance in klx a channel: 0.2126·R + 0.7152·G + 0.0722·B is the luminance or illuminance.
World frame: X rearward, Y right, Z up.
Source: Preetham, Shirley and Smits, A practical analytic model for daylight, SIGGRAPH 1999 (its appendix where not said).
What is taken over, and why the sky's level is not: docs/derivations/daylight.md.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from raytrace.errors import SceneError

Array = NDArray[np.float64]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB, IEC 61966-2-1
RGB_FROM_XYZ = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])  # the same
MIN_ELEVATION_DEG = 5.0  # below, the sky is lit by light that went round the earth's edge, which is not in the fit
TURBIDITIES = (2.0, 6.0)  # what the model's skies were simulated for
SUN_RADIUS = np.radians(0.2665)  # of the disc, at the mean distance
LUMENS_PER_WATT = 683.0

# Perez et al. 1993: F = (1 + A·exp(B/cos θ))·(1 + C·exp(D·γ) + E·cos² γ); A … E = slope·T + offset, for Y, x and y.
PEREZ = np.array([
    [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
    [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
    [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
])
# Zenith's x and y: (T², T, 1)·M·(θ³, θ², θ, 1) with θ the sun's distance from the zenith.
ZENITH = np.array([
    [[0.00166, -0.00375, 0.00209, 0.0], [-0.02903, 0.06377, -0.03202, 0.00394], [0.11693, -0.21196, 0.06052, 0.25886]],
    [[0.00275, -0.00610, 0.00317, 0.0], [-0.04214, 0.08970, -0.04153, 0.00516], [0.15346, -0.26756, 0.06670, 0.26688]],
])

# y(x) = −3x² + 2.87x − 0.275 are the phases of daylight (CIE 15); a black body of over 4000 K lies 0.0062 ± 0.0004 below. The
# fit falls up to 0.012 below that at the horizon, which shows as pink: no daylight is there.
BLACK_BODY = np.array([-3.0, 2.87, -0.275 - 0.0062])

WAVELENGTH_UM = np.arange(38) * 0.01 + 0.38
# The sun's radiance outside the air, W/(cm²·µm·sr).
SUN_RADIANCE = np.array([
    1655.9, 1623.37, 2112.75, 2588.82, 2582.91, 2423.23, 2676.05, 2965.83, 3054.54, 3005.75, 3066.37, 2883.04, 2871.21,
    2782.5, 2710.06, 2723.36, 2636.13, 2550.38, 2506.02, 2531.16, 2535.59, 2513.42, 2463.15, 2417.32, 2368.53, 2321.21,
    2282.77, 2233.98, 2197.02, 2152.67, 2109.79, 2072.83, 2024.04, 1987.08, 1942.72, 1907.24, 1862.89, 1825.92])
# Ozone's absorption, 1/cm; the other gases absorb where the eye hardly sees.
OZONE = np.array([
    0, 0, 0, 0, 0, 0, 0, 0.003, 0.006, 0.009, 0.014, 0.021, 0.030, 0.040, 0.048, 0.063, 0.075, 0.085, 0.103, 0.120, 0.120,
    0.115, 0.125, 0.120, 0.105, 0.090, 0.079, 0.067, 0.057, 0.048, 0.036, 0.028, 0.023, 0.018, 0.014, 0.011, 0.010, 0.009])
OZONE_CM = 0.35
# The CIE 1931 observer, 2°.
OBSERVER = np.array([
    [0.0014, 0.0042, 0.0143, 0.0435, 0.1344, 0.2839, 0.3483, 0.3362, 0.2908, 0.1954, 0.0956, 0.0320, 0.0049, 0.0093, 0.0633,
     0.1655, 0.2904, 0.4334, 0.5945, 0.7621, 0.9163, 1.0263, 1.0622, 1.0026, 0.8544, 0.6424, 0.4479, 0.2835, 0.1649, 0.0874,
     0.0468, 0.0227, 0.0114, 0.0058, 0.0029, 0.0014, 0.0007, 0.0003],
    [0.0000, 0.0001, 0.0004, 0.0012, 0.0040, 0.0116, 0.0230, 0.0380, 0.0600, 0.0910, 0.1390, 0.2080, 0.3230, 0.5030, 0.7100,
     0.8620, 0.9540, 0.9950, 0.9950, 0.9520, 0.8700, 0.7570, 0.6310, 0.5030, 0.3810, 0.2650, 0.1750, 0.1070, 0.0610, 0.0320,
     0.0170, 0.0082, 0.0041, 0.0021, 0.0010, 0.0005, 0.0002, 0.0001],
    [0.0065, 0.0201, 0.0679, 0.2074, 0.6456, 1.3856, 1.7471, 1.7721, 1.6692, 1.2876, 0.8130, 0.4652, 0.2720, 0.1582, 0.0782,
     0.0422, 0.0203, 0.0087, 0.0039, 0.0021, 0.0017, 0.0011, 0.0008, 0.0003, 0.0002, 0.0000, 0.0000, 0.0000, 0.0000, 0.0000,
     0.0000, 0.0000, 0.0000, 0.0000, 0.0000, 0.0000, 0.0000, 0.0000],
])

# Wavelengths of the three channels' middles, and how air and haze thin out upwards (the paper's section 4).
CHANNEL_UM = np.array([0.610, 0.550, 0.465])
AIR_SCALE_MM, HAZE_SCALE_MM = 1e6 / 0.1136, 1e6 / 0.8333


def sun_direction(azimuth_deg: float, elevation_deg: float) -> Array:
    """Unit direction towards the sun: azimuth 0 ahead of the vehicle (−X), positive to the right (+Y).

    Raises
    ------
    SceneError
        For angles that are no numbers and for elevations outside MIN_ELEVATION_DEG … 90.
    """
    if not np.isfinite(azimuth_deg):
        raise SceneError(f"the sun's azimuth {azimuth_deg} must be a number of degrees, 0 ahead and 90 to the right")
    if not MIN_ELEVATION_DEG <= elevation_deg <= 90.0:
        raise SceneError(f"the sun's elevation {elevation_deg}° must lie from {MIN_ELEVATION_DEG:g} to 90°: the sky model "
                         "does not hold for a lower sun")
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    return np.array([-np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])


def sun_irradiance(sun: Array, turbidity: float) -> Array:
    """What a face square to the sun gets from its disc, (3,) klx.

    ∫ L(λ)·τ(λ)·(x̄, ȳ, z̄) dλ over the disc's solid angle; τ: Rayleigh, Ångström's haze, ozone.
    """
    mass = _air_mass(sun)
    return _illuminance(_scattered(mass, turbidity) * np.exp(-OZONE * OZONE_CM * mass))


def sky_illuminance(sun: Array, turbidity: float) -> float:
    """What level ground gets from the sky, klx: half of what the beam loses by scattering, the other half goes back up.

    E = (E₀ − E_scattered)·sin h/2.   Within 15 % of the clear sky of IES 1984, 0.8 + 15.5·√(sin h), for T = 2.5 from 10 to 60°.
    """
    lost = _illuminance(np.ones(len(WAVELENGTH_UM))) - _illuminance(_scattered(_air_mass(sun), turbidity))
    return float(0.5 * sun[2] * LUMINANCE @ lost)


def sky_radiance(directions: Array, sun: Array, turbidity: float) -> Array:
    """Radiance (n, 3) kcd/m² of the clear sky in unit directions (n, 3), those below the horizon as at it.

    x and y as published, but y not below a black body's; Y with the published distribution, and the level that gives
    `sky_illuminance` on level ground.

    Raises
    ------
    SceneError
        For a turbidity outside TURBIDITIES.
    """
    if not TURBIDITIES[0] <= turbidity <= TURBIDITIES[1]:
        raise SceneError(f"turbidity {turbidity} must lie from {TURBIDITIES[0]:g} (very clear) to {TURBIDITIES[1]:g} (hazy)")
    across, weights = _level_quadrature()
    mean = float(weights @ _perez(across, sun, turbidity, 0))
    luminance = _perez(directions, sun, turbidity, 0) * (sky_illuminance(sun, turbidity) / mean)
    x, y = (_zenith(sun, turbidity, c) * _perez(directions, sun, turbidity, c + 1) for c in range(2))
    y = np.maximum(y, BLACK_BODY @ np.stack([x * x, x, np.ones_like(x)]))
    xyz = np.stack([x / y, np.ones_like(x), (1.0 - x - y) / y], axis=1) * luminance[:, None]
    result: Array = np.maximum(xyz @ RGB_FROM_XYZ.T, 0.0)
    return result


def air_extinction(turbidity: float) -> Array:
    """Extinction of light along the ground, (3,) 1/mm: the vertical optical depths over the heights that they thin out in.

    Meteorological visibility (Koschmieder 1924) is 3.912 over it: 28 km for T = 2.5.
    """
    haze, air = _depths(CHANNEL_UM, turbidity)
    result: Array = haze / HAZE_SCALE_MM + air / AIR_SCALE_MM
    return result


def _depths(um: NDArray[np.floating[Any]], turbidity: float) -> tuple[Array, Array]:
    """Vertical optical depth of haze (Ångström) and of air (Rayleigh)."""
    wave = np.asarray(um, dtype=np.float64)
    return (0.04608 * turbidity - 0.04586) * wave**-1.3, 0.008735 * wave**-4.08


def _scattered(mass: float, turbidity: float) -> Array:
    haze, air = _depths(WAVELENGTH_UM, turbidity)
    result: Array = np.exp(-mass * (haze + air))
    return result


def _air_mass(sun: Array) -> float:
    """Kasten 1966."""
    zenith_deg = float(np.degrees(np.arccos(min(sun[2], 1.0))))
    return float(1.0 / (sun[2] + 0.15 * (93.885 - zenith_deg) ** -1.253))


def _illuminance(transmittance: Array) -> Array:
    """Linear sRGB of the sun's disc through air, klx."""
    per_nm = SUN_RADIANCE * transmittance * 1e4 * 1e-3  # W/(m²·nm·sr)
    xyz = OBSERVER @ per_nm * 10.0 * LUMENS_PER_WATT * 1e-3 * np.pi * np.sin(SUN_RADIUS) ** 2
    result: Array = np.maximum(RGB_FROM_XYZ @ xyz, 0.0)  # a sun redder than sRGB's red has a blue below 0
    return result


def _perez(directions: Array, sun: Array, turbidity: float, channel: int) -> Array:
    """The distribution over its value at the zenith."""
    a, b, c, d, e = PEREZ[channel] @ np.array([turbidity, 1.0])
    up = np.maximum(directions[:, 2], 1e-4)  # exp(b/cos θ) is its limit by then, as b < 0
    cosine = np.clip(directions @ sun, -1.0, 1.0)
    here = (1.0 + a * np.exp(b / up)) * (1.0 + c * np.exp(d * np.arccos(cosine)) + e * cosine**2)
    zenith = (1.0 + a * np.exp(b)) * (1.0 + c * np.exp(d * np.arccos(min(sun[2], 1.0))) + e * sun[2] ** 2)
    result: Array = here / zenith
    return result


def _zenith(sun: Array, turbidity: float, coordinate: int) -> float:
    theta = np.arccos(min(sun[2], 1.0))
    return float(np.array([turbidity**2, turbidity, 1.0]) @ ZENITH[coordinate] @ np.array([theta**3, theta**2, theta, 1.0]))


def _level_quadrature() -> tuple[Array, Array]:
    """Directions over the upper half space and weights that sum f to ∫ f·cos θ dω: Gauss in sin² θ, even in azimuth."""
    nodes, weights = np.polynomial.legendre.leggauss(96)
    square = 0.5 * (nodes + 1.0)
    azimuth = (np.arange(192) + 0.5) * (2.0 * np.pi / 192)
    sine, turn = (g.ravel() for g in np.meshgrid(np.sqrt(square), azimuth, indexing="ij"))
    directions = np.stack([sine * np.cos(turn), sine * np.sin(turn), np.sqrt(1.0 - sine**2)], axis=1)
    return directions, np.repeat(weights, 192) * (0.5 * np.pi / 192)
