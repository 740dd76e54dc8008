"""Convert B-spline records and outline segments to OCCT geometry, and back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray
from OCP.BRepAdaptor import BRepAdaptor_Curve2d, BRepAdaptor_Surface
from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert
from OCP.BRepTools import BRepTools, BRepTools_WireExplorer
from OCP.Geom import Geom_BSplineSurface
from OCP.Geom2d import Geom2d_BSplineCurve, Geom2d_Circle, Geom2d_Curve, Geom2d_Line, Geom2d_TrimmedCurve
from OCP.GeomAbs import GeomAbs_BSplineSurface, GeomAbs_Cylinder, GeomAbs_Plane, GeomAbs_Sphere
from OCP.gp import gp_Ax22d, gp_Dir2d, gp_Pnt, gp_Pnt2d
from OCP.TColgp import TColgp_Array1OfPnt2d, TColgp_Array2OfPnt
from OCP.TColStd import TColStd_Array1OfInteger, TColStd_Array1OfReal, TColStd_Array2OfReal
from OCP.TopAbs import TopAbs_REVERSED, TopAbs_WIRE
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS, TopoDS_Face

from mirror_cad.errors import SurfaceError
from mirror_cad.occt.pcurves import polyline
from mirror_cad.surfaces.quadric import Quadric

if TYPE_CHECKING:  # they bring numba along, which the child process that reads files does without
    from mirror_cad.outline import Arc, Line, Spline
    from mirror_cad.surfaces.bspline import BSplineSurface

Array = NDArray[np.float64]
BSplineArrays = tuple[int, int, Array, Array, Array, Array | None]


class BSplineRecord(Protocol):
    """What the kernel is told of a B-spline surface: a BSplineSurface, or its arrays under the same names."""

    @property
    def degree_u(self) -> int:
        """Along u."""

    @property
    def degree_v(self) -> int:
        """Along v."""

    @property
    def knots_u(self) -> Array:
        """With repetition."""

    @property
    def knots_v(self) -> Array:
        """With repetition."""

    @property
    def poles(self) -> Array:
        """(n_u, n_v, 3), mm."""

    @property
    def weights(self) -> Array | None:
        """(n_u, n_v); None where they are one."""

    @property
    def domain(self) -> tuple[float, float, float, float]:
        """(u_min, u_max, v_min, v_max)."""


def to_geom_surface(surface: BSplineRecord) -> Geom_BSplineSurface:
    """The same surface as a kernel object: same degree, knots, poles and weights."""
    nu, nv = surface.poles.shape[:2]
    poles = TColgp_Array2OfPnt(1, nu, 1, nv)
    for i in range(nu):
        for j in range(nv):
            x, y, z = surface.poles[i, j]
            poles.SetValue(i + 1, j + 1, gp_Pnt(float(x), float(y), float(z)))
    knots_u, times_u = _knots_and_multiplicities(surface.knots_u)
    knots_v, times_v = _knots_and_multiplicities(surface.knots_v)
    if surface.weights is None:
        return Geom_BSplineSurface(poles, knots_u, knots_v, times_u, times_v, surface.degree_u, surface.degree_v)
    weights = TColStd_Array2OfReal(1, nu, 1, nv)
    for i in range(nu):
        for j in range(nv):
            weights.SetValue(i + 1, j + 1, float(surface.weights[i, j]))
    return Geom_BSplineSurface(poles, weights, knots_u, knots_v, times_u, times_v, surface.degree_u, surface.degree_v)


def from_geom_surface(geom: Geom_BSplineSurface) -> BSplineSurface:
    """A kernel B-spline surface as our record; a periodic one is cut open first."""
    from mirror_cad.surfaces.bspline import BSplineSurface

    return BSplineSurface(*bspline_arrays(geom))


def bspline_arrays(geom: Geom_BSplineSurface) -> BSplineArrays:
    """What a BSplineSurface is made from: degrees, knots with repetition, poles (n_u, n_v, 3), and weights or None."""
    if geom.IsUPeriodic() or geom.IsVPeriodic():
        geom = Geom_BSplineSurface.DownCast(geom.Copy()) if hasattr(Geom_BSplineSurface, "DownCast") else geom.Copy()
        if geom.IsUPeriodic():
            geom.SetUNotPeriodic()
        if geom.IsVPeriodic():
            geom.SetVNotPeriodic()
    nu, nv = geom.NbUPoles(), geom.NbVPoles()
    places = [(i, j) for i in range(1, nu + 1) for j in range(1, nv + 1)]
    poles = np.array([geom.Pole(*place).Coord() for place in places]).reshape(nu, nv, 3)
    rational = geom.IsURational() or geom.IsVRational()
    weights = np.array([geom.Weight(*place) for place in places]).reshape(nu, nv) if rational else None
    return (
        geom.UDegree(), geom.VDegree(),
        np.repeat([geom.UKnot(i + 1) for i in range(geom.NbUKnots())],
                  [geom.UMultiplicity(i + 1) for i in range(geom.NbUKnots())]),
        np.repeat([geom.VKnot(i + 1) for i in range(geom.NbVKnots())],
                  [geom.VMultiplicity(i + 1) for i in range(geom.NbVKnots())]),
        poles, weights)


def face_as_bspline(face: TopoDS_Face) -> tuple[BSplineSurface, TopoDS_Face]:
    """The surface under a face in world coordinates, as a B-spline, and the face that lies on exactly that surface.

    Planes, cylinders, spheres and the like become rational B-splines that are the same surface. Where the face
    `is_reversed`, S_u × S_v points into the material.

    Raises
    ------
    SurfaceError
        Where the kernel cannot convert the surface.
    """
    geom, converted = as_geom_bspline(face)
    return from_geom_surface(geom), converted


def as_geom_bspline(face: TopoDS_Face) -> tuple[Geom_BSplineSurface, TopoDS_Face]:
    """`face_as_bspline` as a kernel object."""
    converted, adaptor = face, BRepAdaptor_Surface(face, False)
    # What is a B-spline already is not converted, which costs the kernel as much as all else.
    if adaptor.GetType() != GeomAbs_BSplineSurface or adaptor.IsUPeriodic() or adaptor.IsVPeriodic():
        converted = TopoDS.Face_s(BRepBuilderAPI_NurbsConvert(face, True).Shape())
        adaptor = BRepAdaptor_Surface(converted, False)
    try:
        geom = adaptor.BSpline()  # where the face's location puts it
    except Exception as error:
        raise SurfaceError(f"a face's surface cannot be turned into a B-spline: {error}") from None
    return geom, converted


def face_as_quadric(face: TopoDS_Face) -> Quadric | None:
    """The plane, sphere or cylinder under a face, in world coordinates and its own parameters; None for other surfaces."""
    adaptor = BRepAdaptor_Surface(face, False)
    kind = {GeomAbs_Plane: "plane", GeomAbs_Sphere: "sphere", GeomAbs_Cylinder: "cylinder"}.get(adaptor.GetType())
    if kind is None:
        return None
    element = {"plane": adaptor.Plane, "sphere": adaptor.Sphere, "cylinder": adaptor.Cylinder}[kind]()
    position = element.Position()
    axes = np.array([axis.Coord() for axis in (position.XDirection(), position.YDirection(), position.Direction())])
    radius = 0.0 if kind == "plane" else float(element.Radius())
    return Quadric(kind, np.array(position.Location().Coord()), axes, radius)  # type: ignore[arg-type]


def is_reversed(face: TopoDS_Face) -> bool:
    """Whether the face's outer side is opposite to its surface's normal."""
    return bool(face.Orientation() == TopAbs_REVERSED)


def face_loops(face: TopoDS_Face) -> tuple[Array, ...]:
    """The wires of a face as closed polygons in its surface's (u, v), (n, 2) each, the first point not repeated.

    A closed face without edges, a whole sphere, has the rectangle of its parameters.
    """
    u_min, u_max, v_min, v_max = BRepTools.UVBounds_s(face)
    scale = np.array([max(u_max - u_min, 1e-300), max(v_max - v_min, 1e-300)])  # radians and mm may stand side by side
    loops = []
    wires = TopExp_Explorer(face, TopAbs_WIRE)
    while wires.More():
        points: list[Array] = []
        edges = BRepTools_WireExplorer(TopoDS.Wire_s(wires.Current()), face)
        while edges.More():
            uv = polyline(BRepAdaptor_Curve2d(edges.Current(), face), scale)
            points.append(uv[::-1][:-1] if edges.Current().Orientation() == TopAbs_REVERSED else uv[:-1])
            edges.Next()
        if points:
            loops.append(np.concatenate(points))
        wires.Next()
    if not loops:
        loops.append(np.array([[u_min, v_min], [u_max, v_min], [u_max, v_max], [u_min, v_max]]))
    return tuple(loops)


def to_pcurve(segment: Line | Arc | Spline) -> Geom2d_Curve:
    """An outline segment as a curve in the parameter plane (u, v) = (x, y), bounded."""
    from mirror_cad.outline import Arc, Line

    if isinstance(segment, Line):
        (x0, y0), (x1, y1) = np.asarray(segment.start, float), np.asarray(segment.end, float)
        length = float(np.hypot(x1 - x0, y1 - y0))
        line = Geom2d_Line(gp_Pnt2d(float(x0), float(y0)), gp_Dir2d(float(x1 - x0), float(y1 - y0)))
        return Geom2d_TrimmedCurve(line, 0.0, length)
    if isinstance(segment, Arc):
        # A clockwise arc runs on a circle whose own sense is clockwise, so that its parameter rises along it.
        turn = 1.0 if segment.sweep > 0 else -1.0
        axes = gp_Ax22d(gp_Pnt2d(float(segment.centre[0]), float(segment.centre[1])),
                        gp_Dir2d(float(np.cos(segment.start_angle)), float(np.sin(segment.start_angle))),
                        gp_Dir2d(float(-turn * np.sin(segment.start_angle)), float(turn * np.cos(segment.start_angle))))
        return Geom2d_TrimmedCurve(Geom2d_Circle(axes, float(segment.radius_mm)), 0.0, float(abs(segment.sweep)))
    knots, times = _knots_and_multiplicities(np.asarray(segment.knots, float))
    poles = TColgp_Array1OfPnt2d(1, len(segment.poles))
    for i, (x, y) in enumerate(segment.poles, start=1):
        poles.SetValue(i, gp_Pnt2d(float(x), float(y)))
    if segment.weights is None:
        return Geom2d_BSplineCurve(poles, knots, times, segment.degree)
    weights = TColStd_Array1OfReal(1, len(segment.poles))
    for i, w in enumerate(segment.weights, start=1):
        weights.SetValue(i, float(w))
    return Geom2d_BSplineCurve(poles, weights, knots, times, segment.degree)


def _knots_and_multiplicities(flat: Array) -> tuple[TColStd_Array1OfReal, TColStd_Array1OfInteger]:
    values, counts = np.unique(flat, return_counts=True)
    knots, times = TColStd_Array1OfReal(1, len(values)), TColStd_Array1OfInteger(1, len(values))
    for i, (value, count) in enumerate(zip(values, counts, strict=True), start=1):
        knots.SetValue(i, float(value))
        times.SetValue(i, int(count))
    return knots, times
