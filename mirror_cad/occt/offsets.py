"""Replace the surface of a face that the kernel has no true B-spline for by a quadric or a B-spline over all of the face.

What the kernel's own conversion makes of an offset surface may end before the face does, or fail. Here an offset of a plane,
cylinder or sphere becomes the one that it is; any other surface a B-spline through its own points, in its own parameters,
whose error is measured between them.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Curve2d, BRepAdaptor_Surface
from OCP.BRepTools import BRepTools
from OCP.Geom import (
    Geom_CylindricalSurface,
    Geom_OffsetSurface,
    Geom_Plane,
    Geom_RectangularTrimmedSurface,
    Geom_SphericalSurface,
)
from OCP.GeomAbs import GeomAbs_C3
from OCP.TColStd import TColStd_Array1OfReal
from OCP.TopAbs import TopAbs_EDGE
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS, TopoDS_Face

from mirror_cad.errors import SurfaceError
from mirror_cad.occt.convert import BSplineArrays
from mirror_cad.surfaces.quadric import Quadric

Array = NDArray[np.float64]

DEGREE = 7  # of the B-spline: its error falls with the eighth power of its spans
FIT_TOLERANCE_MM = 1e-7  # a tenth of what a met point may be off
SAME_MM = 1e-9  # of a quadric and the offset surface that it is: rounding
MAX_SPANS = 128  # a direction; tried up to
STRAY_MM = 0.01  # between an edge in space and in parameters: what other programs call the same point
EDGE_SAMPLES = 33  # of an edge
EDGE_CHORDS = 1024  # of an edge: a circle of 150 mm is within 0.001 mm of them
QUADRIC_SAMPLES = 7  # a direction: a quadric that agrees at 49 points with another one is that one


def offset_as_quadric(face: TopoDS_Face) -> Quadric | None:
    """The plane, cylinder or sphere that an offset surface is, in its own parameters; None for another surface."""
    surface = BRep_Tool.Surface_s(face)
    while isinstance(surface, Geom_RectangularTrimmedSurface):
        surface = surface.BasisSurface()
    if not isinstance(surface, Geom_OffsetSurface):
        return None
    basis, offset = surface.BasisSurface(), float(surface.Offset())
    while isinstance(basis, Geom_RectangularTrimmedSurface):
        basis = basis.BasisSurface()
    if not isinstance(basis, Geom_Plane | Geom_CylindricalSurface | Geom_SphericalSurface):
        return None
    position = basis.Position()
    axes = np.array([axis.Coord() for axis in (position.XDirection(), position.YDirection(), position.Direction())])
    centre = np.array(position.Location().Coord())
    out = offset * float(np.sign(np.linalg.det(axes)))  # S_u × S_v of a left-handed frame looks inward
    if isinstance(basis, Geom_Plane):
        quadric = Quadric("plane", centre + out * axes[2], axes, 0.0)
    else:
        radius = float(basis.Radius()) + out
        if radius == 0.0:
            raise SurfaceError(f"a face's surface is {abs(offset):g} mm off one of that radius: it has shrunk to its centre")
        if radius < 0.0:  # through the centre, to the other side
            axes = axes * (np.array([[-1.0], [-1.0], [1.0]]) if isinstance(basis, Geom_CylindricalSurface) else -1.0)
        quadric = Quadric("sphere" if isinstance(basis, Geom_SphericalSurface) else "cylinder", centre, axes, abs(radius))
    transform = face.Location().Transformation()
    moved = np.array([[transform.Value(i, j) for j in range(1, 5)] for i in range(1, 4)])
    scale = float(transform.ScaleFactor())
    quadric = Quadric(quadric.kind, moved[:, :3] @ quadric.centre + moved[:, 3], quadric.axes @ moved[:, :3].T / scale,
                      abs(scale) * quadric.radius_mm)
    u, v, value, _ = _sampler(face)
    samples = np.linspace(u[0], u[-1], QUADRIC_SAMPLES), np.linspace(v[0], v[-1], QUADRIC_SAMPLES)
    off = np.abs(quadric.evaluate(*np.meshgrid(*samples, indexing="ij")) - value(*samples)).max()
    return quadric if off <= SAME_MM * (1.0 + abs(quadric.centre).max() + quadric.radius_mm) else None


def fitted_bspline(face: TopoDS_Face) -> BSplineArrays:
    """Degrees, knots and poles of a B-spline in the face's own parameters, over all that its edges reach.

    Raises
    ------
    SurfaceError
        Where MAX_SPANS do not bring it within FIT_TOLERANCE_MM.
    """
    ends_u, ends_v, value, scale = _sampler(face)
    parts, best = 1, np.inf
    while max(len(ends_u), len(ends_v)) * parts <= 2 * MAX_SPANS:
        knots_u, knots_v = _knots(ends_u, parts), _knots(ends_v, parts)
        u, v = _greville(knots_u), _greville(knots_v)
        poles = _interpolated(knots_v, v, np.moveaxis(_interpolated(knots_u, u, value(u, v)), 1, 0))
        poles = np.ascontiguousarray(np.moveaxis(poles, 1, 0))
        between_u, between_v = 0.5 * (u[1:] + u[:-1]), 0.5 * (v[1:] + v[:-1])
        fitted = _evaluated(knots_u, between_u, knots_v, between_v, poles)
        best = float(np.linalg.norm(fitted - value(between_u, between_v), axis=-1).max())
        if best <= FIT_TOLERANCE_MM:
            return DEGREE, DEGREE, knots_u, knots_v, poles, None
        parts *= 2
    raise SurfaceError(f"a face's surface, {scale:.3g} mm across, cannot be turned into a B-spline within "
                       f"{FIT_TOLERANCE_MM:g} mm (the best is {best:.2g} mm off): export it as a B-spline")


def refuse_stray_edges(face: TopoDS_Face) -> None:
    """Refuse a face whose edges, as curves in its surface's parameters, are not its edges in space.

    The kernel works them out by itself where a file has none, and on offset surfaces that turn fully about it fails.

    Raises
    ------
    SurfaceError
        With how far they are apart.
    """
    surface, worst = BRepAdaptor_Surface(face, False), 0.0
    edges = TopExp_Explorer(face, TopAbs_EDGE)
    while edges.More():
        edge = TopoDS.Edge_s(edges.Current())
        if not BRep_Tool.Degenerated_s(edge):
            flat, space = BRepAdaptor_Curve2d(edge, face), BRepAdaptor_Curve(edge)
            in_plane = [flat.Value(float(t)) for t in np.linspace(flat.FirstParameter(), flat.LastParameter(), EDGE_SAMPLES)]
            on_surface = np.array([surface.Value(uv.X(), uv.Y()).Coord() for uv in in_plane])
            chords = np.array([space.Value(float(t)).Coord()
                               for t in np.linspace(space.FirstParameter(), space.LastParameter(), EDGE_CHORDS + 1)])
            worst = max(worst, float(_distance(on_surface, chords).max()))  # the two may run at different speeds
        edges.Next()
    if worst > STRAY_MM:
        raise SurfaceError(f"the kernel finds the edges of a face on an offset surface {worst:.2g} mm off the surface: "
                           "export it as a B-spline, or cut it into parts that do not close")


def _distance(points: Array, polyline: Array) -> Array:
    """Of each point from a polyline."""
    start, along = polyline[:-1], np.diff(polyline, axis=0)
    square = np.maximum(np.einsum("ij,ij->i", along, along), np.finfo(np.float64).tiny)
    share = np.clip(np.einsum("nij,ij->ni", points[:, None] - start, along) / square, 0.0, 1.0)
    result: Array = np.linalg.norm(points[:, None] - start - share[..., None] * along, axis=2).min(axis=1)
    return result


def _sampler(face: TopoDS_Face) -> tuple[Array, Array, Callable[[Array, Array], Array], float]:
    """Ends of the smooth pieces of a face's surface in u and in v, its points over a grid of (u, v), and its size in mm."""
    adaptor = BRepAdaptor_Surface(face, False)
    u_min, u_max, v_min, v_max = BRepTools.UVBounds_s(face)
    inner_u = TColStd_Array1OfReal(1, adaptor.NbUIntervals(GeomAbs_C3) + 1)
    adaptor.UIntervals(inner_u, GeomAbs_C3)
    inner_v = TColStd_Array1OfReal(1, adaptor.NbVIntervals(GeomAbs_C3) + 1)
    adaptor.VIntervals(inner_v, GeomAbs_C3)

    def value(u: Array, v: Array) -> Array:
        return np.array([[adaptor.Value(float(a), float(b)).Coord() for b in v] for a in u])

    ends = []
    for low, high, inner in ((u_min, u_max, inner_u), (v_min, v_max, inner_v)):
        room = 1e-9 * (high - low)
        ends.append(np.array([low, *(end for end in inner if low + room < end < high - room), high]))
    corners = value(ends[0][[0, -1]], ends[1][[0, -1]]).reshape(-1, 3)
    return ends[0], ends[1], value, float(np.ptp(corners, axis=0).max())


def _knots(ends: Array, parts: int) -> Array:
    """Clamped knots with `parts` spans a smooth piece; at the ends of pieces the curve is continuous only."""
    inner = [np.linspace(a, b, parts + 1)[1:-1] for a, b in pairwise(ends)]
    joined = [np.repeat(end, DEGREE) for end in ends[1:-1]]
    rows = [inner[0]] + [each for pair in zip(joined, inner[1:], strict=True) for each in pair]
    return np.concatenate([np.repeat(ends[0], DEGREE + 1), *rows, np.repeat(ends[-1], DEGREE + 1)])


def _greville(knots: Array) -> Array:
    count = len(knots) - DEGREE - 1
    return np.array([knots[i + 1:i + DEGREE + 1].mean() for i in range(count)]).clip(knots[0], knots[-1])


def _interpolated(knots: Array, at: Array, values: Array) -> Array:
    from scipy.interpolate import make_interp_spline

    poles: Array = make_interp_spline(at, values, DEGREE, knots).c
    return poles


def _evaluated(knots_u: Array, u: Array, knots_v: Array, v: Array, poles: Array) -> Array:
    from scipy.interpolate import BSpline

    rows = BSpline(knots_u, poles, DEGREE)(u)
    result: Array = np.moveaxis(BSpline(knots_v, np.moveaxis(rows, 1, 0), DEGREE)(v), 1, 0)
    return result
