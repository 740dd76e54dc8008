"""Sections of specifications for the hard cases, each law worked out again where it is no constant."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from mirror_studio.bench.hard.sheets import Array

Spec = dict[str, Any]

FLAT = math.inf


def constant(radius_mm: float) -> Spec:
    """A law of one radius."""
    return {"law": "constant", "radius_mm": radius_mm}


def kappa(formula: str) -> Spec:
    """A law by a formula of curvature."""
    return {"law": "expression", "curvature": formula}


def linear(right_mm: float, left_mm: float) -> Spec:
    """A linear law."""
    return {"law": "linear", "right_mm": right_mm, "left_mm": left_mm}


def zones(right_mm: float, left_mm: float, start: float, end: float) -> Spec:
    """A law of zones, blended smoothly from start to end in t."""
    return {"law": "zones", "right_mm": right_mm, "left_mm": left_mm, "blend_from": start, "blend_to": end}


def spec(horizontal: Spec, vertical: Spec, **sections: Spec) -> Spec:
    """A specification of two laws and other sections."""
    return {"horizontal": horizontal, "vertical": vertical, **sections}


def rectangle(width_mm: float, height_mm: float, corner_mm: float = 0.0) -> dict[str, Spec]:
    """An outline of four sides, as sections of a specification."""
    return {"outline": {"width_mm": width_mm, "left_height_mm": height_mm, "right_height_mm": height_mm,
                        "corner_radius_mm": corner_mm},
            "blank": {"width_mm": 1.1 * width_mm, "height_mm": 1.1 * height_mm}}


def scaled(width_mm: float) -> dict[str, Spec]:
    """The standard truck mirror at another size, margin and all."""
    k = width_mm / 230.0
    return {"outline": {"width_mm": width_mm, "left_height_mm": 270.0 * k, "right_height_mm": 340.0 * k,
                        "corner_radius_mm": 40.0 * k},
            "blank": {"width_mm": 250.0 * k, "height_mm": 380.0 * k}, "export": {"surface_margin_mm": 15.0 * k}}


def t_of(x: Array) -> Array:
    """The laws' parameter: 0 at the right edge of the standard outline, 1 at its left."""
    return (115.0 - x) / 230.0


def zones_law(right_mm: float, left_mm: float, start: float, end: float) -> Callable[[Array], Array]:
    """κ of what `zones` spells: R = right + (left − right)·u²(3 − 2u), u from 0 to 1 over the blend."""

    def law(x: Array) -> Array:
        u = np.clip((t_of(x) - start) / (end - start), 0.0, 1.0)
        return 1.0 / (right_mm + (left_mm - right_mm) * (u * u * (3.0 - 2.0 * u)))

    return law


ZONES, ZONES_LAW, ZONES_BREAKS = zones(1250.0, 400.0, 0.5, 1.0), zones_law(1250.0, 400.0, 0.5, 1.0), (0.0,)


def table(x: Array, radius: Array) -> tuple[Spec, CubicSpline]:
    """A table law and the spline that it is defined as."""
    return {"law": "table", "x_mm": x.tolist(), "radius_mm": radius.tolist()}, CubicSpline(x, 1.0 / radius)


def noisy(share: float) -> tuple[Spec, CubicSpline]:
    """A table with a row a mm, each off at random by a share of its radius."""
    x = np.arange(-115.0, 116.0)
    return table(x, (1000.0 + x) * (1.0 + share * np.random.default_rng(7).standard_normal(x.size)))


def polygon(count: int) -> Array:
    """Corners of an outline, on an ellipse."""
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.stack([110.0 * np.cos(angle), 150.0 * np.sin(angle)], axis=1)


STAR = np.array([(0.0, 150.0), (30.0, 40.0), (110.0, 30.0), (45.0, -30.0), (80.0, -140.0), (0.0, -70.0), (-80.0, -140.0),
                 (-45.0, -30.0), (-110.0, 30.0), (-30.0, 40.0)])
SQUARE = np.array([(-80.0, -80.0), (80.0, -80.0), (80.0, 80.0), (-80.0, 80.0)])
SPIKE = np.array([(-80.0, -80.0), (80.0, -80.0), (80.0, 0.0), (80.0005, 0.0005), (80.0, 80.0), (-80.0, 80.0)])
