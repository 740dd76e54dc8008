"""batoid's bicubic surface on a regular grid of heights: float64, its own Newton."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_studio.bench.tracers.case import Case, Rays, surface_grid
from mirror_studio.bench.tracers.tracer import CORES, Tracer, Work, installed

BICUBIC = "batoid, bicubic, 5 mm grid"
GRID_MM = 5.0


def tracers(case: Case) -> Iterator[Tracer]:
    """The sheet as heights and exact slopes on a grid."""
    batoid = installed("batoid")
    batoid.global_vars._batoid_max_threads = CORES  # its default is what OMP_NUM_THREADS was when it was imported
    x_min, x_max, y_min, y_max = case.mirror.surface.domain
    x, y = (np.linspace(low, high, round((high - low) / GRID_MM) + 1) for low, high in ((x_min, x_max), (y_min, y_max)))
    points, normals = surface_grid(case.mirror.surface, x, y)
    z, slope_x, slope_y = (a.reshape(len(y), len(x)) for a in (points[:, 2], -normals[:, 0] / normals[:, 2],
                                                              -normals[:, 1] / normals[:, 2]))
    surface = batoid.Bicubic(x, y, z, slope_x, slope_y)
    yield Tracer(BICUBIC, lambda rays: _bicubic(batoid, surface, rays))


def _bicubic(batoid: Any, surface: Any, rays: Rays) -> Work:
    x, y, z = (np.full(len(rays.directions), value) for value in rays.origins)

    def work() -> NDArray[Any]:
        moving = batoid.RayVector(x, y, z, *rays.directions.T)
        batoid.reflect(surface, moving)
        out: NDArray[Any] = moving.v
        out[moving.failed] = np.nan
        return out

    return work
