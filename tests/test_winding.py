"""Faces that wind, graze and lie side by side: what is known to be on the way is met, and the nearest of it."""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

import raytrace
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.quadric import Quadric
from raytrace.rays import Status
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.quadric import QuadricFace

ORACLE_MM = 1e-6  # the kernel's own intersection is no closer
OFF_MM = 1e-8  # nor are its places closer to the surface: 2e-9 mm was seen


def helicoid(inner_mm: float, outer_mm: float, pitch_mm: float, turns: float) -> object:
    """A screw's flank as CAD programs write it, the ruled face between two helices."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
    from OCP.BRepFill import BRepFill
    from OCP.BRepLib import BRepLib
    from OCP.Geom import Geom_CylindricalSurface
    from OCP.Geom2d import Geom2d_Line
    from OCP.gp import gp_Ax3, gp_Dir2d, gp_Pnt2d

    helices = []
    for radius in (inner_mm, outer_mm):
        line = Geom2d_Line(gp_Pnt2d(0, 0), gp_Dir2d(2 * pi, pitch_mm))
        edge = BRepBuilderAPI_MakeEdge(line, Geom_CylindricalSurface(gp_Ax3(), radius), 0.0,
                                       turns * (4 * pi**2 + pitch_mm**2) ** 0.5).Edge()
        BRepLib.BuildCurves3d_s(edge)
        helices.append(edge)
    return BRepFill.Face_s(*helices)


def written(shapes: list[object], path: Path) -> Path:
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

    writer = STEPControl_Writer()
    for shape in shapes:
        writer.Transfer(shape, STEPControl_AsIs)
    writer.Write(str(path))
    return path


def oracle(path: Path, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Distances of the kernel's own first intersections with every face of the file, NaN for none."""
    from OCP.BRepTools import BRepTools
    from OCP.gp import gp_Dir, gp_Lin, gp_Pnt
    from OCP.IntCurvesFace import IntCurvesFace_ShapeIntersector

    from mirror_cad.occt.step import read_step

    shape = read_step(path).shape
    BRepTools.Clean_s(shape)
    intersector = IntCurvesFace_ShapeIntersector()
    intersector.Load(shape, 1e-9)
    found = np.full(len(origins), np.nan)
    for k, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        intersector.Perform(gp_Lin(gp_Pnt(*map(float, origin)), gp_Dir(*map(float, direction))), 1e-6, 1e6)
        if intersector.IsDone() and intersector.NbPnt():
            found[k] = min(intersector.WParameter(i) for i in range(1, intersector.NbPnt() + 1))
    return found


def at_surfaces(reflector: raytrace.Reflector, n: int, seed: int, distance_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Rays from anywhere to places on the surfaces, which each meets after distance_mm or before."""
    rng = np.random.default_rng(seed)
    points = []
    for surface in reflector.surface.bounding_faces:
        u_min, u_max, v_min, v_max = surface.trimming.box
        u, v = rng.uniform(u_min, u_max, 4 * n), rng.uniform(v_min, v_max, 4 * n)
        inside = surface.trimming.contains(u, v)
        points.append(surface.evaluate(u[inside], v[inside])[:n])
    aimed = rng.permutation(np.concatenate(points))[:n]
    rays = rng.normal(size=(len(aimed), 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return aimed - distance_mm * rays, rays


def check(path: Path, n: int, compared: int, seed: int = 0) -> None:
    """Every ray is met where it was aimed or before; and where the kernel meets it, but where it misses what is there."""
    reflector = raytrace.load_reflector(path)
    origins, rays = at_surfaces(reflector, n, seed, 300.0)
    trace = raytrace.reflect(reflector, origins, rays)
    assert trace.counts() == {"reflected": len(rays)}
    assert (trace.distances <= 300.0 + 1e-9).all()
    expected = oracle(path, origins[:compared], rays[:compared])
    # Its places are as far as OFF_MM beside the surface, which along a grazing ray is 1/cos i as much.
    cosine = np.abs(np.einsum("ij,ij->i", trace.normals, rays))[:compared]
    nearer = expected < trace.distances[:compared] - np.maximum(ORACLE_MM, OFF_MM / cosine)
    assert not nearer.any(), (expected[nearer], trace.distances[:compared][nearer])
    # Where the kernel is later, it has passed by a place that does lie on the surface, found there by another way than the
    # tracer's: of flanks close above each other it misses more than one ray in thirty.
    later = np.flatnonzero(~(expected <= trace.distances[:compared] + ORACLE_MM))
    assert len(later) <= 0.3 * compared
    for k in later:
        assert off_surfaces(reflector, trace.points[k]) < ORACLE_MM


def off_surfaces(reflector: raytrace.Reflector, point: np.ndarray) -> float:
    """Distance of a point from the nearest surface: least squares from the nearest of a grid's places."""
    from scipy.optimize import least_squares

    nearest = np.inf
    for surface in reflector.surface.bounding_faces:
        u_min, u_max, v_min, v_max = surface.trimming.box
        u, v = (g.ravel() for g in np.meshgrid(np.linspace(u_min, u_max, 801), np.linspace(v_min, v_max, 21)))
        start = int(np.argmin(np.linalg.norm(surface.evaluate(u, v) - point, axis=1)))
        fit = least_squares(lambda uv, sheet=surface: sheet.evaluate(uv[0], uv[1]) - point, [u[start], v[start]],
                            bounds=([u_min, v_min], [u_max, v_max]), xtol=1e-15, ftol=1e-15, gtol=1e-15)
        nearest = min(nearest, float(np.linalg.norm(fit.fun)))
    return nearest


@pytest.mark.parametrize(("pitch_mm", "turns"), [(20.0, 2), (5.0, 9)])
def test_every_place_of_a_helicoid_is_met(tmp_path: Path, pitch_mm: float, turns: int) -> None:
    check(written([helicoid(10.0, 20.0, pitch_mm, turns)], tmp_path / "screw.step"), 1500, 60)


@pytest.mark.long
@pytest.mark.parametrize("pitch_mm", [20.0, 5.0])
@pytest.mark.parametrize("turns", range(1, 10))
def test_every_place_of_helicoids_of_all_turns_is_met(tmp_path: Path, turns: int, pitch_mm: float) -> None:
    check(written([helicoid(10.0, 20.0, pitch_mm, turns)], tmp_path / "screw.step"), 20_000, 2000, seed=turns)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["plane", "cylinder", "cone", "sphere", "torus", "B-spline"])
def test_every_place_of_offset_surfaces_is_met(tmp_path: Path, kind: str) -> None:
    """As the kernel makes B-splines of them, which is what both meet."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace, BRepBuilderAPI_NurbsConvert
    from OCP.Geom import (
        Geom_ConicalSurface,
        Geom_CylindricalSurface,
        Geom_OffsetSurface,
        Geom_Plane,
        Geom_SphericalSurface,
        Geom_ToroidalSurface,
    )
    from OCP.gp import gp_Ax3

    from mirror_cad.occt.convert import to_geom_surface
    from tests.conftest import designed

    basis, bounds = {
        "plane": (Geom_Plane(gp_Ax3()), (0.0, 40.0, 0.0, 30.0)),
        "cylinder": (Geom_CylindricalSurface(gp_Ax3(), 20.0), (0.3, 4.0, 0.0, 30.0)),
        "cone": (Geom_ConicalSurface(gp_Ax3(), 0.4, 20.0), (0.3, 4.0, 0.0, 30.0)),
        "sphere": (Geom_SphericalSurface(gp_Ax3(), 20.0), (0.3, 4.0, -0.5, 1.0)),
        "torus": (Geom_ToroidalSurface(gp_Ax3(), 30.0, 10.0), (0.3, 4.0, 0.2, 5.0)),
        "B-spline": (to_geom_surface(designed("progressive-c").surface), (-100.0, 100.0, -120.0, 120.0))}[kind]
    face = BRepBuilderAPI_MakeFace(Geom_OffsetSurface(basis, 5.0), *bounds, 1e-7).Face()
    check(written([BRepBuilderAPI_NurbsConvert(face, True).Shape()], tmp_path / "offset.step"), 4000, 2000)


@pytest.mark.long
def test_every_place_of_a_bottle_s_thread_is_met(tmp_path: Path) -> None:
    """The thread of the kernel's own tutorial: skins through pairs of arcs of ellipses on two cylinders."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeWire
    from OCP.BRepLib import BRepLib
    from OCP.BRepOffsetAPI import BRepOffsetAPI_ThruSections
    from OCP.GCE2d import GCE2d_MakeSegment
    from OCP.Geom import Geom_CylindricalSurface
    from OCP.Geom2d import Geom2d_Ellipse, Geom2d_TrimmedCurve
    from OCP.gp import gp_Ax2d, gp_Ax3, gp_Dir, gp_Dir2d, gp_Pnt, gp_Pnt2d

    axes = gp_Ax3(gp_Pnt(0, 0, 70), gp_Dir(0, 0, 1))
    frame = gp_Ax2d(gp_Pnt2d(2 * pi, 3.5), gp_Dir2d(2 * pi, 1.75))
    skin = BRepOffsetAPI_ThruSections(True)
    for radius, minor in ((7.5 * 0.99, 0.7), (7.5 * 1.05, 0.175)):
        ellipse = Geom2d_Ellipse(frame, 2 * pi, minor)
        arc = Geom2d_TrimmedCurve(ellipse, 0.0, pi)
        segment = GCE2d_MakeSegment(ellipse.Value(0.0), ellipse.Value(pi)).Value()
        cylinder = Geom_CylindricalSurface(axes, radius)
        wire = BRepBuilderAPI_MakeWire(BRepBuilderAPI_MakeEdge(arc, cylinder).Edge(),
                                       BRepBuilderAPI_MakeEdge(segment, cylinder).Edge()).Wire()
        BRepLib.BuildCurves3d_s(wire)
        skin.AddWire(wire)
    skin.CheckCompatibility(False)
    check(written([skin.Shape()], tmp_path / "thread.step"), 4000, 2000)


def test_the_order_of_faces_changes_nothing(tmp_path: Path) -> None:
    """The two flanks of a thread, one inside the other's turns, and a sheet that is one of them again."""
    from OCP.gp import gp_Trsf, gp_Vec
    from OCP.TopLoc import TopLoc_Location

    shift = gp_Trsf()
    shift.SetTranslation(gp_Vec(0.0, 0.0, 2.5))
    flank = helicoid(10.0, 20.0, 5.0, 3)
    path = written([flank, flank.Moved(TopLoc_Location(shift))], tmp_path / "thread.step")  # type: ignore[attr-defined]
    reflector = raytrace.load_reflector(path)
    origins, rays = at_surfaces(reflector, 3000, 1, 300.0)
    one = raytrace.reflect(reflector, origins, rays)
    other = raytrace.reflect(raytrace.Reflector.of_faces(reflector.surface.bounding_faces[::-1]), origins, rays)
    apart = [raytrace.reflect(raytrace.Reflector(face), origins, rays) for face in reflector.surface.bounding_faces]
    nearest = np.fmin(apart[0].distances, apart[1].distances)
    assert one.counts() == {"reflected": 3000}
    assert np.array_equal(one.distances, other.distances)
    assert np.array_equal(one.distances, nearest)


def test_rays_that_graze_are_met_up_to_where_they_touch() -> None:
    """A quarter of a cylinder of 50 mm along z, as a rational B-spline: rays across it at a height of 50 − h."""
    root = np.sqrt(0.5)
    arc = np.array([[-1.0, 0.0], [-1.0, 1.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]) * 50.0
    poles = np.stack([np.column_stack([arc, np.full(5, z)]) for z in (-40.0, 40.0)], axis=1)
    weights = np.array([1.0, root, 1.0, root, 1.0])[:, None] * np.ones(2)
    surface = BSplineSurface(2, 1, np.array([0, 0, 0, 1, 1, 2, 2, 2.0]), np.array([0, 0, 1, 1.0]), poles, weights)
    square = np.array([[0.0, 0], [2, 0], [2, 1], [0, 1]])
    reflector = raytrace.Reflector(BSplineFace(surface, (square,), one_sided=False))
    below = np.concatenate([np.geomspace(1e-12, 1.0, 200), [-1e-11, -1e-9, -1e-3]])
    for lean in (0.0, 0.3):  # the direction's share along the cylinder
        rays = np.tile([1.0, 0.0, lean], (len(below), 1))
        origins = np.column_stack([np.full(len(below), -70.0), 50.0 - below, np.full(len(below), -70.0 * lean)])
        trace = raytrace.reflect(reflector, origins, rays)
        assert (trace.status[:200] == Status.REFLECTED).all()
        assert (trace.status[200:] == Status.MISSED).all()
        first = -np.sqrt(below[:200] * (100.0 - below[:200]))
        # Rounding of 50 mm, 1e-14, moves the place along the ray by its square root.
        assert (np.abs(trace.points[:200, 0] - first) <= np.minimum(1e-12 * 50.0 / np.abs(first), 2e-6)).all()


def test_a_ray_in_a_flat_face_misses_and_one_in_a_straight_line_of_a_curved_face_ends() -> None:
    """A square, and the saddle 5·u·v mm over it: the ray runs in the saddle's line y = 2, a hair beside it, and across."""
    knots = np.array([0, 0, 1, 1.0])
    corners = np.array([[[0.0, 0, 0], [0, 10, 0]], [[10, 0, 0], [10, 10, 0]]])
    lifted = corners + np.array([[[0.0, 0, 0], [0, 0, 0]], [[0, 0, 0], [0, 0, 5]]])
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    flat, saddle = (raytrace.Reflector(BSplineFace(BSplineSurface(1, 1, knots, knots, poles), (square,), sign=-1.0,
                                                   one_sided=False)) for poles in (corners, lifted))
    assert raytrace.reflect(flat, np.array([-5.0, 2.0, 0.0]), np.array([[1.0, 0.0, 0.0]])).counts() == {"missed": 1}
    line = np.array([1.0, 0.0, 0.1])
    inside = raytrace.reflect(saddle, np.array([-5.0, 2.0, -0.5]), line[None])
    assert inside.status[0] in (Status.LOST, Status.REFLECTED)  # never missed: it meets the face all along
    # z = 0.05·x·y with y = 2 + h·(x − 5): 0.1·x + 0.05·h·x·(x − 5) = 0.1·x at x = 0 and at x = 5, and at x = 0 it enters.
    for h in (1e-3, 1e-6):
        turned = raytrace.reflect(saddle, np.array([2.0, 2.0 - 3.0 * h, 0.2]), np.array([[1.0, h, 0.1]]))
        assert turned.counts() == {"reflected": 1}
        assert np.abs(turned.points[0] - [5.0, 2.0, 0.5]).max() < 1e-12 / h


def test_a_tree_of_quadrics_gives_what_each_alone_gives() -> None:
    rng = np.random.default_rng(6)
    faces = []
    for k in range(40):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        kind: Literal["plane", "sphere", "cylinder"] = ("plane", "sphere", "cylinder")[k % 3]  # type: ignore[assignment]
        low, high = np.sort(rng.uniform(-pi, pi, 2)), np.sort(rng.uniform(-1.5, 1.5, 2))
        u, v = (low, high) if kind == "sphere" else (low, 20.0 * high) if kind == "cylinder" else (10.0 * low, 10.0 * high)
        loop = np.array([[u[0], v[0]], [u[1], v[0]], [u[1], v[1]], [u[0], v[1]]])
        quadric = Quadric(kind, rng.uniform(-60, 60, 3), axes, 0.0 if kind == "plane" else rng.uniform(5, 30))
        faces.append(QuadricFace(quadric, (loop,), float(rng.choice([-1.0, 1.0])), bool(rng.integers(2))))
    origins = rng.uniform(-100, 100, (4000, 3))
    rays = rng.uniform(-60, 60, (4000, 3)) - origins
    rays[:300] = np.eye(3)[rng.integers(0, 3, 300)]
    together = raytrace.reflect(raytrace.Reflector.of_faces(tuple(faces)), origins, rays)
    apart = [raytrace.reflect(raytrace.Reflector(face), origins, rays) for face in faces]
    distances = np.array([trace.distances for trace in apart])
    first = np.argmin(np.where(np.isnan(distances), np.inf, distances), axis=0)
    assert (together.status == Status.REFLECTED).sum() > 500
    for name in ("status", "distances", "points", "normals"):
        expected = np.array([getattr(trace, name) for trace in apart])[first, np.arange(4000)]
        assert np.array_equal(getattr(together, name), expected, equal_nan=True), name


def test_trimming_polygons_stay_within_their_share_of_arcs_and_splines() -> None:
    """Against the kernel's own evaluation, between the polygon's points, of pcurves of a plane of 100 × 40 mm."""
    from OCP.BRepAdaptor import BRepAdaptor_Curve2d
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace
    from OCP.Geom import Geom_Plane
    from OCP.Geom2d import Geom2d_BezierCurve, Geom2d_BSplineCurve, Geom2d_Circle, Geom2d_Ellipse
    from OCP.gp import gp_Ax3, gp_Ax22d, gp_Dir2d, gp_Pnt2d
    from OCP.TColgp import TColgp_Array1OfPnt2d
    from OCP.TColStd import TColStd_Array1OfInteger, TColStd_Array1OfReal

    from mirror_cad.occt.pcurves import LOOP_CHORD, polyline

    rng = np.random.default_rng(2)

    def poles(n: int) -> TColgp_Array1OfPnt2d:
        array = TColgp_Array1OfPnt2d(1, n)
        for i in range(1, n + 1):
            array.SetValue(i, gp_Pnt2d(float(rng.uniform(0, 100)), float(rng.uniform(0, 40))))
        return array

    def reals(values: list[float]) -> TColStd_Array1OfReal:
        array = TColStd_Array1OfReal(1, len(values))
        for i, value in enumerate(values, start=1):
            array.SetValue(i, value)
        return array

    times = TColStd_Array1OfInteger(1, 4)
    for i, count in enumerate((4, 1, 3, 4), start=1):  # smooth at 0.3, with a corner at 0.8
        times.SetValue(i, count)
    frame = gp_Ax22d(gp_Pnt2d(50, 20), gp_Dir2d(0.8, 0.6), gp_Dir2d(0.6, -0.8))
    knots = reals([0.0, 0.3, 0.8, 1.0])
    curves = [Geom2d_Circle(frame, 15.0), Geom2d_Ellipse(frame, 19.0, 2.0), Geom2d_BezierCurve(poles(6)),
              Geom2d_BSplineCurve(poles(8), knots, times, 3),
              Geom2d_BSplineCurve(poles(8), reals([1.0, 5.0, 0.2, 1.0, 1.0, 3.0, 0.5, 1.0]), knots, times, 3)]
    plane = Geom_Plane(gp_Ax3())
    face = BRepBuilderAPI_MakeFace(plane, 0.0, 100.0, 0.0, 40.0, 1e-7).Face()
    scale = np.array([100.0, 40.0])
    for curve in curves:
        first, last = curve.FirstParameter(), curve.LastParameter()
        adaptor = BRepAdaptor_Curve2d(BRepBuilderAPI_MakeEdge(curve, plane, first, first + 0.9 * (last - first)).Edge(), face)
        uv = polyline(adaptor, scale) / scale
        t = rng.uniform(adaptor.FirstParameter(), adaptor.LastParameter(), 2000)
        on = np.array([adaptor.Value(float(value)).Coord() for value in t]) / scale
        way = np.diff(uv, axis=0)
        for point in on[:400]:
            along = np.clip(((point - uv[:-1]) * way).sum(axis=1) / (way**2).sum(axis=1), 0.0, 1.0)
            off = np.linalg.norm(uv[:-1] + along[:, None] * way - point, axis=1).min()
            assert off <= 1.2 * LOOP_CHORD  # what lies between the places looked at
        for value, point in ((adaptor.FirstParameter(), uv[0]), (adaptor.LastParameter(), uv[-1])):
            assert np.abs(np.array(adaptor.Value(value).Coord()) / scale - point).max() < 1e-14
