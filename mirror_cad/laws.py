"""The spec's two laws in, curvature laws over x out, with the one shape parameter solved that `match` leaves open."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.optimize import brentq

from mirror_cad import curvature
from mirror_cad.curvature import CurvatureLaw, Span
from mirror_cad.errors import SpecError
from mirror_cad.profile import circle_section_fov, rough_section_fov, section_fov_of_sine, sine_of_tangent_angle
from mirror_cad.spec_laws import (
    AnyHorizontal,
    ConstantLaw,
    ExpressionLaw,
    HorizontalPower,
    HorizontalZones,
    LinearLaw,
    PowerLaw,
    TableLaw,
    ZonesLaw,
)
from mirror_cad.spec_section import Section

# The parameter is solved until the field of view is right to about 1e-10 degrees, far below any tolerance on it.
MATCH_PRECISION = 1e-12
# Where to look for it is found by the trapezoidal rule on so many places; on a law that makes sense it errs by far less
# than ROUGH, radians, and what it cannot tell is worked out exactly.
ROUGH_PLACES, ROUGH = 513, 2e-3
ROUGH_ROOT = 1e-4  # of the parameter: secant steps go on from there
SECANT_STEPS = 12  # three or four serve


def law_from(section: Section, span: Span, parameter: float | None = None) -> CurvatureLaw:
    """The curvature law of [horizontal] or [vertical]; `parameter` stands in for a "match"."""
    match section:
        case ConstantLaw():
            return curvature.constant(section.radius_mm)
        case LinearLaw():
            return curvature.linear(section.right_mm, section.left_mm, span)
        case PowerLaw():
            exponent = section.exponent if parameter is None else parameter
            return curvature.power(section.right_mm, section.left_mm, exponent, span)
        case ZonesLaw():
            start = section.blend_from if parameter is None else parameter
            return curvature.zones(section.right_mm, section.left_mm, start, section.blend_to, section.blend, span)
        case TableLaw():
            return curvature.table(section.x_mm, section.curvature)
        case ExpressionLaw():
            formula, of = section.formula
            return curvature.expression(formula, span, of)
    raise AssertionError(f"unknown law {section!r}")


def solve_match(section: AnyHorizontal, eye_distance_mm: float, span: Span, x_min: float, x_max: float, level_mm: float,
                ) -> tuple[str, float] | None:
    """The key that is "match" in [horizontal] and the value that gives the asked section H-FOV; None without one.

    Raises: SpecError with the range that can be reached where the asked value lies outside it.
    """
    if not isinstance(section, HorizontalPower | HorizontalZones) or section.match is None:
        return None
    match = section.match
    half, distance = 0.5 * (x_max - x_min), eye_distance_mm
    if match.sphere_mm is not None:
        if match.sphere_mm <= half:
            raise SpecError(f"horizontal.match.sphere_mm = {match.sphere_mm:g}: a sphere wider than the mirror has a "
                            f"radius above its half-width, {half:g} mm")
        wanted = circle_section_fov(1.0 / match.sphere_mm, half, distance)
    else:
        wanted = np.radians(match.h_fov_deg or 0.0)
    if isinstance(section, HorizontalPower):
        key, values = "exponent", np.geomspace(0.02, 50.0, 17).tolist()
    else:
        key, values = "blend_from", np.linspace(0.0, section.blend_to - 1e-3, 17).tolist()

    @cache
    def miss(value: float) -> float:
        kappa = law_from(section, span, value).series(x_min, x_max)
        return section_fov_of_sine(sine_of_tangent_angle(kappa, level_mm), x_min, x_max, distance) - wanted

    x = np.linspace(x_min, x_max, ROUGH_PLACES)

    @cache
    def roughly(value: float) -> float:
        return rough_section_fov(x, law_from(section, span, value).function(x), level_mm, distance) - wanted

    for low, high in itertools.pairwise(values):
        sure = min(abs(roughly(low)), abs(roughly(high))) > ROUGH
        if sure and roughly(low) * roughly(high) > 0:
            continue
        root = _root(miss, roughly, low, high) if sure or miss(low) * miss(high) <= 0 else None
        if root is not None:
            return key, root
    misses = np.array([miss(value) for value in values])
    for i in range(len(values) - 1):
        if misses[i] * misses[i + 1] <= 0:
            return key, float(brentq(miss, values[i], values[i + 1], xtol=MATCH_PRECISION, rtol=1e-14))
    reached = np.degrees(misses[np.isfinite(misses)] + wanted)
    between = f"{reached.min():.2f}° to {reached.max():.2f}°" if reached.size else "no field of view at all"
    raise SpecError(f"horizontal.match: no {key} gives a section H-FOV of {np.degrees(wanted):.2f}°; this law with "
                    f"right_mm = {section.right_mm:g} and left_mm = {section.left_mm:g} reaches {between}")


def _root(miss: Callable[[float], float], roughly: Callable[[float], float], low: float, high: float) -> float | None:
    """The root of `miss` between low and high: secant steps from the rough function's root, or Brent's method; None where
    there is none after all."""
    if roughly(low) * roughly(high) < 0:
        before = float(brentq(roughly, low, high, xtol=ROUGH_ROOT))
        step = 1e-3 * (low - high)
        slope = (roughly(before + step) - roughly(before)) / step
        for _ in range(SECANT_STEPS):
            after = before - miss(before) / slope if slope else low
            if not low < after < high:
                break
            if abs(after - before) <= MATCH_PRECISION:
                return after
            slope = (miss(after) - miss(before)) / (after - before)
            before = after
    if not miss(low) * miss(high) <= 0:
        return None
    return float(brentq(miss, low, high, xtol=MATCH_PRECISION, rtol=1e-14))
