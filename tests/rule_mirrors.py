"""Mirrors of known shape for the rules' tests: caps of spheres, cylinders and tori, planes, in mirror coordinates, mm."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirror_cad.surfaces.collocation import collocate_height, knot_vector
from mirror_cad.surfaces.quadric import Quadric
from mirror_studio.rules.measuring import RuleQuantities
from mirror_studio.rules.schema import load_rule
from raytrace.reflector import Reflector
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.quadric import QuadricFace

Array = NDArray[np.float64]

TOWARDS_Z = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # u = v = 0 looks along z
MARGIN = 25.0  # of a spline's sheet beyond its rectangle, mm


def rectangle(width: float, height: float) -> Array:
    x, y = 0.5 * width, 0.5 * height
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])


def plane(width: float = 180.0, height: float = 120.0) -> Reflector:
    return Reflector(QuadricFace(Quadric("plane", np.zeros(3), np.eye(3), 0.0), (rectangle(width, height),)))


def sphere(radius: float, width: float = 180.0, height: float = 120.0) -> Reflector:
    """A cap between two meridians and two parallels."""
    loop = rectangle(width, height) / radius
    return Reflector(QuadricFace(Quadric("sphere", np.array([0.0, 0.0, -radius]), TOWARDS_Z, radius), (loop,)))


def cylinder(radius: float, width: float = 180.0, height: float = 120.0) -> Reflector:
    """About an axis along y."""
    loop = rectangle(width, height) / [radius, 1.0]
    return Reflector(QuadricFace(Quadric("cylinder", np.array([0.0, 0.0, -radius]), TOWARDS_Z, radius), (loop,)))


def torus(equator: float, tube: float, width: float = 180.0, height: float = 120.0) -> Reflector:
    """The outer part of a torus about an axis along y, as a spline right to 1e-10 mm: level sections through y = 0 are circles
    of radius `equator`, upright ones in planes through the axis circles of radius `tube`."""

    def sag(x: Array, y: Array) -> Array:
        return np.sqrt((equator - tube + np.sqrt(tube**2 - y**2)) ** 2 - x**2) - equator

    knots_x, knots_y = (knot_vector(np.linspace(-half, half, 9), (), 9) for half in
                        (0.5 * width + MARGIN, 0.5 * height + MARGIN))
    return Reflector(BSplineFace(collocate_height(sag, knots_x, knots_y, 9), (rectangle(width, height),)))


def measured(reflector: Reflector, rule: str = "R46", leg_mm: float = 38.1) -> RuleQuantities:
    return RuleQuantities.of(reflector, load_rule(rule), leg_mm)
