"""Rays that cross a height field without meeting it, told by where they leave it: most that a Newton beside its edge leaves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirror_cad.surfaces.bspline import BSplineSurface
from raytrace.kernels.height_field import HeightField
from raytrace.rays import Rays

CLEAR_MM = 1e-6  # over the sheet: what is nearer to it may have met it, but for rounding


def leaves_above(field: HeightField, surface: BSplineSurface, rays: Rays) -> NDArray[np.bool_]:
    """Which rays are known to leave the sheet's rectangle above it, without having met it.

    A ray's height above the sheet, f(t) = o_z + t·d_z − z(o_x + t·d_x, o_y + t·d_y), falls all the way over the rectangle
    where the ray comes down more steeply than the sheet anywhere, d_z² > steepest·(d_x² + d_y²): one that is above the sheet
    where it leaves the rectangle has been above it all the time.

    Parameters
    ----------
    field : z(x, y).
    surface : the same, that tells heights.
    rays : n of them.

    Returns
    -------
    (n,); False also for a ray of which it is not known.
    """
    x_min, x_max, y_min, y_max = surface.domain
    (ox, oy, oz), d = rays.origins.T, rays.directions
    with np.errstate(all="ignore"):
        dx, dy, dz = (d / np.linalg.norm(d, axis=1)[:, None]).T
        t = np.minimum((np.where(dx > 0.0, x_max, x_min) - ox) / dx, (np.where(dy > 0.0, y_max, y_min) - oy) / dy)
        x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
        beside = np.maximum(np.maximum(x_min - x, x - x_max), np.maximum(y_min - y, y - y_max))
        # Clipped by rounding only; a ray that is not over the rectangle even there is left to the search.
        known = np.flatnonzero((beside <= CLEAR_MM) & (dz < 0.0) & (dz * dz > field.steepest * (dx * dx + dy * dy)))
    found = np.zeros(len(rays), dtype=np.bool_)
    if known.size:
        height, _, _ = surface.heights(np.clip(x[known], x_min, x_max), np.clip(y[known], y_min, y_max))
        found[known] = z[known] > height + CLEAR_MM
    return found
