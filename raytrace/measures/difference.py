"""How far apart two reflectors send the same rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.vectors import lengths
from raytrace.image import landing_points
from raytrace.rays import Status
from raytrace.reflector import Reflector
from raytrace.trace import reflect

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

GRID = (241, 353)  # rays: about one a square millimetre of mirror
ARCMIN = np.degrees(1.0) * 60.0


@dataclass(frozen=True, slots=True)
class ReflectedDifference:
    """How far apart two reflectors send the rays that both reflect; None without one that lands on the plane.

    Attributes
    ----------
    rays : how many were compared.
    turn_max_arcmin, turn_rms_arcmin : largest and RMS angle between the two reflected rays, arc minutes.
    plane_max_mm, plane_rms_mm : largest and RMS distance between the points in which they meet the plane, mm.
    """

    rays: int
    turn_max_arcmin: float | None = None
    turn_rms_arcmin: float | None = None
    plane_max_mm: float | None = None
    plane_rms_mm: float | None = None


def reflected_difference(a: Reflector, b: Reflector, eye: Array, z_mm: float, box: Box) -> ReflectedDifference:
    """Compare what two reflectors do to the same rays, from the eye through a grid of points of the plane z = 0.

    The angle between unit directions d_a and d_b is 2·asin(|d_a − d_b|/2), which keeps the digits of small ones.

    Parameters
    ----------
    a, b : the reflectors, in mirror coordinates.
    eye : (3,), mm.
    z_mm : of the plane z = z_mm that the rays land on, mm.
    box : (x_min, x_max, y_min, y_max) of the grid of 241 × 353 points, mm.

    Returns
    -------
    ReflectedDifference
        Over the rays that both reflect towards the plane.
    """
    x, y = np.meshgrid(np.linspace(box[0], box[1], GRID[0]), np.linspace(box[2], box[3], GRID[1]))
    directions = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) - eye
    traces = [reflect(reflector, eye, directions) for reflector in (a, b)]
    both = (traces[0].status == Status.REFLECTED) & (traces[1].status == Status.REFLECTED)
    apart = lengths(np.subtract(*(landing_points(trace, z_mm)[both] for trace in traces)))
    lands = np.isfinite(apart)
    if not lands.any():
        return ReflectedDifference(0)
    # 2·asin(|a − b|/2) keeps the digits of small angles.
    chord = lengths(traces[0].directions[both][lands] - traces[1].directions[both][lands])
    turn = 2.0 * np.arcsin(0.5 * np.minimum(chord, 2.0)) * ARCMIN
    return ReflectedDifference(int(lands.sum()), float(turn.max()), _rms(turn), float(apart[lands].max()), _rms(apart[lands]))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
