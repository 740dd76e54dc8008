"""Fit a B-spline surface to sag on a regular grid by the kernel's own interpolation or approximation."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from OCP.GeomAbs import GeomAbs_C2
from OCP.GeomAPI import GeomAPI_PointsToBSplineSurface
from OCP.TColStd import TColStd_Array2OfReal

from mirror_cad.errors import SurfaceError
from mirror_cad.occt.convert import from_geom_surface
from mirror_cad.surfaces.fit import Fit, FitTask, measure

# With 73 or more points a direction OCCT 7.8 and 7.9 get the end tangents of an interpolation wrong: a dent between the
# nodes with every node hit and IsDone() true. 72 is the most that is safe.
MAX_POINTS = 72


def fit_by_kernel(task: FitTask, route: str) -> Fit:
    """GeomAPI_PointsToBSplineSurface through (or near) MAX_POINTS² heights, on u = x, v = y.

    route : "occt-interpolate" (cubic, C²) or "occt-approximate" (degree up to 8, C², to the position tolerance).
    The error is measured off the nodes like any other fit's, since the kernel's IsDone() sees neither NaN nor dents.

    Raises
    ------
    SurfaceError
        For a point set that is not finite, or a kernel that gives up or strays.
    """
    start = time.perf_counter()
    x_min, x_max, y_min, y_max = task.domain
    n = MAX_POINTS
    x, y = np.linspace(x_min, x_max, n), np.linspace(y_min, y_max, n)
    z = task.sag.height(x[:, None], y)
    if not np.isfinite(z).all():
        i, j = np.argwhere(~np.isfinite(z))[0]
        raise SurfaceError(f"the point set is not finite at (x, y) = ({x[i]:.3f}, {y[j]:.3f}) mm")
    heights = TColStd_Array2OfReal(1, n, 1, n)
    for i in range(n):
        for j in range(n):
            heights.SetValue(i + 1, j + 1, float(z[i, j]))
    maker = GeomAPI_PointsToBSplineSurface()
    grid = (heights, x_min, (x_max - x_min) / (n - 1), y_min, (y_max - y_min) / (n - 1))
    try:
        if route == "occt-interpolate":
            maker.Interpolate(*grid)
        else:
            maker.Init(*grid, 3, 8, GeomAbs_C2, task.position_tolerance_mm)
        done = maker.IsDone()
    except Exception as error:
        raise SurfaceError(f"the kernel's {route} failed on {n} × {n} points: {error}") from None
    if not done:
        raise SurfaceError(f"the kernel's {route} did not finish on {n} × {n} points: use fit = \"collocation\"")
    surface = from_geom_surface(maker.Surface())
    return replace(measure(task, surface, route), seconds=time.perf_counter() - start)
