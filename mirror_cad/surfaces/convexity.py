"""Whether a wanted view asks for a convex mirror, and whether a surface is one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SpecError, SurfaceError
from mirror_cad.grid import Grid
from mirror_cad.outline import Outline
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.from_view import wanted_slopes
from mirror_cad.wanted_view import WantedView

Array = NDArray[np.float64]


def check_convex(view: WantedView, eyes: Sequence[Array], outline: Outline, keys: str) -> None:
    """Raise SpecError where the normals that a view asks for turn the way of a hollow or saddle-shaped sheet.

    Convex means that the symmetric part of the wanted slopes' derivatives is negative definite over the mirror.
    """
    grid = Grid.over(outline)
    x, y = grid.x[grid.weights > 0.0], grid.y[grid.weights > 0.0]
    step = 1e-3 * (grid.cells_x[-1] - grid.cells_x[0])
    for eye in eyes:
        (a, b), (c, d) = ((
            (after - before) / (2.0 * step) for before, after in zip(
                wanted_slopes(view, eye, np.stack([x - dx, y - dy, np.zeros_like(x)], axis=-1)),
                wanted_slopes(view, eye, np.stack([x + dx, y + dy, np.zeros_like(x)], axis=-1)), strict=True))
            for dx, dy in ((step, 0.0), (0.0, step)))
        twist = 0.5 * (b + c)
        largest = 0.5 * (a + d) + np.hypot(0.5 * (a - d), twist)
        worst = int(np.argmax(largest))
        if largest[worst] >= 0.0:
            raise SpecError(f"{keys}: at ({x[worst]:.1f}, {y[worst]:.1f}) mm this view asks for a mirror that is not convex "
                            f"(its normals close up by {1e3 * largest[worst]:.3g} per m), and target.convex = true; let "
                            "azimuth and elevation rise faster there, or leave convex out")


def check_convex_surface(surface: BSplineSurface, outline: Outline) -> None:
    """Raise SurfaceError where a surface is not convex inside an outline."""
    grid = Grid.over(outline)
    least = surface.principal_curvatures(grid.x, grid.y)[:, 1]
    worst = int(np.argmin(least))
    if least[worst] <= 0.0:
        raise SurfaceError(f"the mirror that comes nearest to [target] is not convex at ({grid.x[worst]:.1f}, "
                           f"{grid.y[worst]:.1f}) mm: its smaller curvature there is {1e3 * least[worst]:.3g} per m, and "
                           "target.convex = true")
