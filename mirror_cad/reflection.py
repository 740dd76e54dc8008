"""A surface, mesh or points of a left-hand mirror in, those of the right-hand one out, and back: reflected in x = 0."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mirror_cad.mesh import SurfaceMesh
from mirror_cad.surfaces.bspline import BSplineSurface

Array = NDArray[np.float64]

SIDEWAYS = np.array([-1.0, 1.0, 1.0])


def reflected_surface(surface: BSplineSurface) -> BSplineSurface:
    """S′(u, v) = M·S(−u, v) with M = diag(−1, 1, 1): u = x stays so, and S_u × S_v points to the same side."""
    return replace(surface, poles=SIDEWAYS * surface.poles).u_reversed()


def reflected_mesh(mesh: SurfaceMesh) -> SurfaceMesh:
    """The facets reflected, each run round the other way, so that its normal points to the same side."""
    return SurfaceMesh(SIDEWAYS * mesh.vertices, np.ascontiguousarray(mesh.faces[:, ::-1]))


def reflected_points(points: Array) -> Array:
    """Rows x, y, z, nx, ny, nz (n, 6) reflected, in the order of a grid again: by y, then by x."""
    result = np.hstack([SIDEWAYS * points[:, :3], SIDEWAYS * points[:, 3:]])
    return result[np.lexsort((result[:, 0], result[:, 1]))]
