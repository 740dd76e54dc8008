"""Solve the one number of a law that "match" leaves open, for a section field of view."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.optimize import brentq

from mirror_cad.errors import SpecError
from mirror_cad.laws.base import Law
from mirror_cad.laws.curvature import Span
from mirror_cad.laws.matched import Matched
from mirror_cad.profile import sine_of_tangent_angle
from mirror_cad.section_fov import circle_section_fov, rough_section_fov, section_fov_of_sine

# The parameter is solved until the field of view is right to about 1e-10 degrees, far below any tolerance on it.
MATCH_PRECISION = 1e-12
# Where to look for it is found by the trapezoidal rule on so many samples; on a law that makes sense it errs by far less
# than ROUGH, radians, and what it cannot tell is worked out exactly.
ROUGH_SAMPLES, ROUGH = 513, 2e-3
ROUGH_ROOT = 1e-4  # of the parameter: secant steps go on from there
SECANT_STEPS = 12  # three or four serve


def solve_match(law: Law, eye_distance_mm: float, span: Span, x_min: float, x_max: float, level_mm: float,
                ) -> tuple[str, float] | None:
    """Solve the open number of a horizontal law so that its section H-FOV is the asked one.

    Parameters
    ----------
    law : Law
    eye_distance_mm : float
        From the mirror's centre, on the axis of the section.
    span : Span
        Where t is 0 and 1.
    x_min, x_max, level_mm : float
        The mirror's edges, and where its profile is level, mm.

    Returns
    -------
    tuple or None
        The key and its value; None for a law in which nothing is open.

    Raises
    ------
    SpecError
        With the range that can be reached where the asked value lies outside it.
    """
    if not isinstance(law, Matched) or law.match is None:
        return None
    match = law.match
    half, distance = 0.5 * (x_max - x_min), eye_distance_mm
    if match.sphere_mm is not None:
        if match.sphere_mm <= half:
            raise SpecError(f"horizontal.match.sphere_mm = {match.sphere_mm:g}: a sphere wider than the mirror has a "
                            f"radius above its half-width, {half:g} mm")
        wanted = circle_section_fov(1.0 / match.sphere_mm, half, distance)
    else:
        wanted = np.radians(match.h_fov_deg or 0.0)
    key, values = law.open_key, law.candidates().tolist()

    @cache
    def miss(value: float) -> float:
        kappa = law.with_parameter(value).over(span).series(x_min, x_max)
        return section_fov_of_sine(sine_of_tangent_angle(kappa, level_mm), x_min, x_max, distance) - wanted

    x = np.linspace(x_min, x_max, ROUGH_SAMPLES)

    @cache
    def roughly(value: float) -> float:
        return rough_section_fov(x, law.with_parameter(value).over(span).at(x), level_mm, distance) - wanted

    for low, high in itertools.pairwise(values):
        decided = min(abs(roughly(low)), abs(roughly(high))) > ROUGH
        if decided and roughly(low) * roughly(high) > 0:
            continue
        root = _root(miss, roughly, low, high) if decided or miss(low) * miss(high) <= 0 else None
        if root is not None:
            return key, root
    misses = np.array([miss(value) for value in values])
    for i in range(len(values) - 1):
        if misses[i] * misses[i + 1] <= 0:
            return key, float(brentq(miss, values[i], values[i + 1], xtol=MATCH_PRECISION, rtol=1e-14))
    reached = np.degrees(misses[np.isfinite(misses)] + wanted)
    between = f"{reached.min():.2f}° to {reached.max():.2f}°" if reached.size else "no field of view at all"
    raise SpecError(f"horizontal.match: no {key} gives a section H-FOV of {np.degrees(wanted):.2f}°; this law "
                    f"({law.in_words()}) reaches {between}")


def _root(miss: Callable[[float], float], roughly: Callable[[float], float], low: float, high: float) -> float | None:
    """The root of `miss` between low and high, or None where there is none after all.

    By secant steps from the rough function's root, or by Brent's method.
    """
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
