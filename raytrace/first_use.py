"""What a first picture needs compiled, in two parts that two processes can compile side by side; numba's cache keeps both.

A first build of a mirror spends two thirds of its compiling on the one kernel that meets a sheet, and nearly all the rest on
the mesh and the picture. Each is called here with next to nothing to do.
"""

from __future__ import annotations

import numpy as np

from raytrace.kernels import height_field
from raytrace.kernels.compiled import is_kept

POWERS = 6  # of degree 5, which designed surfaces have


def is_first() -> bool:
    """Whether this machine has never met a sheet of degree 5 with these sources."""
    return not is_kept(height_field._KERNELS[POWERS])


def compile_sheet() -> None:
    """Meet a sheet with no rays."""
    from raytrace.kernels.cells import Cells
    from raytrace.kernels.trimming import Strips
    from raytrace.rays import Trace

    ends, none = np.array([0.0, 1.0, np.inf]), np.zeros(0)
    lookup = np.zeros(1, dtype=np.int32)
    cells = Cells(POWERS, none, ends, ends, none, none, lookup, lookup, 1.0, 1.0)
    strips = Strips(np.zeros(2, dtype=np.int64), np.zeros((0, 4)), 0.0, 1.0, np.zeros((1, 2)))
    height_field.hits(height_field.HeightField(cells, 1.0, 0.0, -1.0, 0.0, 0.0), strips, np.zeros(3), none, Trace.empty(0).flat)


def compile_picture() -> None:
    """Trim a square, look whether rays lie apart, and take a picture in two facets, then in the smooth surface through them."""
    from mirror_cad.mesh import SurfaceMesh
    from raytrace.image import photograph
    from raytrace.kernels import order
    from raytrace.kernels.blocks import BLOCK
    from raytrace.reflector import Reflector
    from raytrace.scene.reference import ReferencePlane
    from raytrace.surfaces.trimming import Trimming
    from raytrace.viewing.camera import Frame

    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    Trimming.of((corners,))
    ends, lookup, plane = np.array([0.0, 1.0, np.inf]), np.zeros(1, dtype=np.int32), np.array([0.0, 0.0, 1.0, 0.0])
    rays = np.tile([0.0, 0.0, -1.0], order.SAMPLED * BLOCK)
    grid = order.SortingGrid(plane, plane, plane, ends, ends, lookup, lookup, 1.0, 1.0)
    order.scattered(grid, np.array([0.0, 0.0, 1.0]), rays, np.empty(2 * len(rays)))
    mesh = Reflector.of_mesh(SurfaceMesh(np.column_stack([corners, np.zeros(4)]),
                                         np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)))
    camera = Frame.around((-1.0, 1.0, -1.0, 1.0), 4).camera(np.array([0.0, 0.0, 10.0]))
    scene = ReferencePlane(np.zeros((2, 2, 3), dtype=np.uint8), 10.0, 1.0, (0.0, 0.0))
    for reflector in (mesh, mesh.interpolated):
        photograph(reflector, camera, scene)
