"""The unit of measured coordinates, told from the size and the curvature that a mirror of this design has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirror_cad.made.nominal import Nominal

Array = NDArray[np.float64]

UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inches": 25.4, "µm": 1e-3}  # in mm
LARGEST = 1.35  # of the design's size: what points of a mirror may reach over
SMALLEST = 0.02
CURVED = 1e-3  # of its size: a larger sag tells a radius
FEW = 20_000  # points that tell both
NEAR = 1.6  # factor within which a radius is the design's


def likely_unit(nominal: Nominal, points: Array) -> str | None:
    """The unit in which points have the size and the radius of the design, "mm" where that serves; None where none does.

    Parameters
    ----------
    nominal : Nominal
        The design.
    points : ndarray
        (n, 3), in an unknown unit.
    """
    size, radius = _size_and_radius(points)
    x_min, x_max, y_min, y_max = nominal.box
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(x_min, x_max, 21), np.linspace(y_min, y_max, 21)))
    kept = nominal.outline.contains(x, y)
    x, y = x[kept], y[kept]
    wanted_size, wanted_radius = _size_and_radius(np.stack([x, y, nominal.heights(x, y)[0]], axis=1))
    fitting = []
    for unit, factor in UNITS.items():
        if not SMALLEST <= factor * size / wanted_size <= LARGEST:
            continue
        if radius is None or wanted_radius is None:
            fitting.append((abs(np.log(factor * size / wanted_size)), unit))
        elif (off := abs(np.log(factor * radius / wanted_radius))) <= np.log(NEAR):
            fitting.append((off, unit))
    names = [unit for _, unit in sorted(fitting)]
    if radius is None and SMALLEST * 10.0 <= size / wanted_size <= LARGEST:
        return "mm"
    return "mm" if "mm" in names and (radius is not None) else names[0] if names else None


def _size_and_radius(points: Array) -> tuple[float, float | None]:
    """What points reach over, without far outliers, and the radius of the sphere through them; None where they are flat."""
    points = points[:: max(1, len(points) // FEW)]
    middle = np.median(points, axis=0)
    reach = np.linalg.norm(points - middle, axis=1)
    kept = points[reach <= 3.0 * np.median(reach)]
    size = float(2.0 * np.linalg.norm(kept - middle, axis=1).max())
    if not size > 0.0:
        return 0.0, None
    p = (kept - middle) / size
    weights = np.ones(len(p))
    radius, sag = None, 0.0
    for _ in range(8):
        terms = np.concatenate([2.0 * p, np.ones((len(p), 1))], axis=1)
        square = (p * p).sum(axis=1)
        root = np.sqrt(weights)[:, None]
        solved = np.linalg.lstsq(terms * root, square * root[:, 0], rcond=1e-12)[0]
        inside = float(solved[3] + solved[:3] @ solved[:3])
        if not inside > 0.0:
            return size, None
        radius = float(np.sqrt(inside))
        off = np.linalg.norm(p - solved[:3], axis=1) - radius
        weights = np.clip(1.0 - (off / max(6.0 * 1.4826 * float(np.median(np.abs(off))), 1e-9)) ** 2, 0.0, None) ** 2
        sag = 1.0 / (8.0 * radius)
    return size, size * radius if radius is not None and sag > CURVED else None
