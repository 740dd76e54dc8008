"""What OCCT, build123d and cadquery themselves make of point grids, solids and our surfaces: for comparison."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import build123d
import cadquery
import numpy as np
from numpy.typing import NDArray
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
from OCP.BRepTools import BRepTools
from OCP.Geom import Geom_BSplineSurface
from OCP.GeomAbs import GeomAbs_C2
from OCP.GeomAPI import GeomAPI_PointsToBSplineSurface
from OCP.GeomLProp import GeomLProp_SLProps
from OCP.gp import gp_Pnt
from OCP.TColgp import TColgp_Array2OfPnt
from OCP.TopoDS import TopoDS_Solid

from mirror_cad.errors import SurfaceError
from mirror_cad.occt.convert import face_as_bspline, from_geom_surface, to_geom_surface
from mirror_cad.surfaces.bspline import BSplineSurface

Array = NDArray[np.float64]
Route = Callable[[], Any]

RESOLUTION_MM = 1e-9  # below it GeomLProp_SLProps takes a derivative for zero


def occt_interpolation(points: Array) -> Route:
    """GeomAPI_PointsToBSplineSurface.Interpolate through points (m, n, 3): cubic, C²."""
    grid = _point_grid(points)

    def make() -> Geom_BSplineSurface:
        maker = GeomAPI_PointsToBSplineSurface()
        maker.Interpolate(grid)
        return _surface_of(maker)

    return make


def occt_approximation(points: Array, degree_min: int, degree_max: int, tolerance_mm: float) -> Route:
    """GeomAPI_PointsToBSplineSurface.Init near points (m, n, 3): C², degree and tolerance as given."""
    grid = _point_grid(points)

    def make() -> Geom_BSplineSurface:
        maker = GeomAPI_PointsToBSplineSurface()
        maker.Init(grid, degree_min, degree_max, GeomAbs_C2, tolerance_mm)
        return _surface_of(maker)

    return make


def build123d_face(points: Array, **settings: Any) -> Route:
    """build123d's Face.make_surface_from_array_of_points; its defaults where no setting is given."""
    vectors = [[build123d.Vector(*point) for point in row] for row in points.tolist()]
    return lambda: build123d.Face.make_surface_from_array_of_points(vectors, **settings)


def cadquery_face(points: Array, **settings: Any) -> Route:
    """cadquery's Face.makeSplineApprox; its defaults where no setting is given."""
    vectors = [[cadquery.Vector(*point) for point in row] for row in points.tolist()]
    return lambda: cadquery.Face.makeSplineApprox(vectors, **settings)


def as_bspline(made: Any) -> BSplineSurface:
    """What a route made, as our record."""
    return from_geom_surface(made) if isinstance(made, Geom_BSplineSurface) else face_as_bspline(made.wrapped)[0]


def build123d_stl(solid: TopoDS_Solid, path: Path) -> None:
    """build123d's export_stl with its defaults, on a solid that carries no triangles yet."""
    BRepTools.Clean_s(solid)
    build123d.export_stl(build123d.Solid(solid), path)


def cadquery_stl(solid: TopoDS_Solid, path: Path) -> None:
    """cadquery's STL export with its defaults, on a solid that carries no triangles yet."""
    BRepTools.Clean_s(solid)
    cadquery.exporters.export(cadquery.Workplane(obj=cadquery.Solid(solid)), str(path))


def perforated_plate_step(path: Path, holes: int) -> None:
    """Write a plate of 400 mm with `holes` round holes each way as STEP, by cadquery: a file of holes² curved faces and six."""
    side, thickness = 400.0, 3.0
    pitch = side / (holes + 1)
    plate = cadquery.Workplane().box(side, side, thickness).faces(">Z").workplane().rarray(pitch, pitch, holes, holes).hole(
        0.4 * pitch)
    cadquery.exporters.export(plate, str(path))


def tiled_sheet_step(path: Path, tiles: int, poles: int) -> None:
    """Write a convex sheet of 400 mm in `tiles` untrimmed bicubic faces each way, of `poles` poles each way, as STEP."""
    ends = np.linspace(-200.0, 200.0, tiles + 1)
    knots = [np.concatenate([3 * [a], np.linspace(a, b, poles - 2), 3 * [b]]) for a, b in pairwise(ends)]
    middles = [np.mean([each[1 + k:1 + k + poles] for k in range(3)], axis=0) for each in knots]
    faces = []
    for i, j in product(range(tiles), repeat=2):
        x, y = np.meshgrid(middles[i], middles[j], indexing="ij")
        surface = BSplineSurface(3, 3, knots[i], knots[j], np.stack([x, y, -(x * x + y * y) / 2500.0], axis=2))
        faces.append(cadquery.Face(BRepBuilderAPI_MakeFace(to_geom_surface(surface), RESOLUTION_MM).Face()))
    cadquery.exporters.export(cadquery.Workplane(obj=cadquery.Compound.makeCompound(faces)), str(path))


def local_properties(surface: BSplineSurface) -> Callable[[Array, Array], tuple[Array, Array, Array]]:
    """GeomLProp_SLProps on the surface, by a call for each point.

    Returns
    -------
    Callable
        (u, v), each (n,), -> points (n, 3), normals (n, 3) and k1 ≥ k2 (n, 2), 1/mm, convex positive, as ours.
    """
    properties = GeomLProp_SLProps(to_geom_surface(surface), 2, RESOLUTION_MM)

    def evaluate(u: Array, v: Array) -> tuple[Array, Array, Array]:
        points, normals, kappa = np.empty((u.size, 3)), np.empty((u.size, 3)), np.empty((u.size, 2))
        for i, (at_u, at_v) in enumerate(zip(u.tolist(), v.tolist(), strict=True)):
            properties.SetParameters(at_u, at_v)
            points[i] = properties.Value().Coord()
            normals[i] = properties.Normal().Coord()
            kappa[i] = -properties.MinCurvature(), -properties.MaxCurvature()
        return points, normals, kappa

    return evaluate


def _point_grid(points: Array) -> TColgp_Array2OfPnt:
    grid = TColgp_Array2OfPnt(1, points.shape[0], 1, points.shape[1])
    for i, row in enumerate(points.tolist(), start=1):
        for j, point in enumerate(row, start=1):
            grid.SetValue(i, j, gp_Pnt(*point))
    return grid


def _surface_of(maker: GeomAPI_PointsToBSplineSurface) -> Geom_BSplineSurface:
    if not maker.IsDone():
        raise SurfaceError("the kernel did not finish a surface from points")
    return maker.Surface()
