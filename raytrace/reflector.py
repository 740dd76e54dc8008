"""A mirror, a STEP face or an STL mesh in, a Reflector out: what `reflect` traces, without any design intent."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from mirror_cad.bspline import BSplineSurface
from mirror_cad.mesh import SurfaceMesh
from raytrace.embree import TriangleScene
from raytrace.errors import TraceError
from raytrace.newton import PADDED_POWERS

if TYPE_CHECKING:
    from mirror_cad.mirror import Mirror
    from mirror_cad.occt.step import StepFile

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

OPTICAL_FACE = "optical face"
# x = u and y = v to this: above what the digits of a STEP file move a pole, below what any trace could see.
IDENTITY_TOLERANCE_MM = 1e-9
START_GRID = 48  # cells a direction of the coarse mesh that Newton starts from
MOST_BINS = 1 << 17  # of the table that finds a span: half a megabyte
TRIM_STRIPS = 2048  # strips a trimming polygon is sorted into: a handful of edges in each
TRIM_CHORD_MM = 1e-5  # of the polygon for a mirror's own outline


@dataclass(frozen=True, eq=False)
class TrimmedSurface:
    """A B-spline surface inside trimming loops (closed polygons in (u, v), even-odd), S_u × S_v times `sign` outward.

    one_sided : whether only the outward side reflects.
    """

    surface: BSplineSurface
    loops: tuple[Array, ...]
    sign: float = 1.0
    one_sided: bool = True

    @cached_property
    def trim_box(self) -> Box:
        """(u_min, u_max, v_min, v_max) of the loops."""
        uv = np.concatenate(self.loops)
        (u_min, v_min), (u_max, v_max) = uv.min(axis=0), uv.max(axis=0)
        return float(u_min), float(u_max), float(v_min), float(v_max)

    @cached_property
    def strips(self) -> tuple[int, NDArray[np.int64], Array, float, float]:
        """The loops' edges sorted into strips of v, as the kernels take them."""
        edges = np.concatenate([np.hstack([loop, np.roll(loop, -1, axis=0)]) for loop in self.loops])
        low, high = float(edges[:, 1].min()), float(edges[:, 1].max())
        inverse = TRIM_STRIPS / (high - low) if high > low else 0.0
        start = np.clip(((np.minimum(edges[:, 1], edges[:, 3]) - low) * inverse).astype(np.int64) - 1, 0, TRIM_STRIPS - 1)
        stop = np.clip(((np.maximum(edges[:, 1], edges[:, 3]) - low) * inverse).astype(np.int64) + 1, 0, TRIM_STRIPS - 1)
        counts = stop - start + 1
        owner = np.repeat(np.arange(len(edges)), counts)
        strip = np.repeat(start, counts) + np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        order = np.argsort(strip, kind="stable")
        first = np.concatenate([[0], np.cumsum(np.bincount(strip, minlength=TRIM_STRIPS))])
        return TRIM_STRIPS, first, np.ascontiguousarray(edges[owner[order]]), low, inverse

    @cached_property
    def start_mesh(self) -> tuple[SurfaceMesh, Array]:
        """A coarse mesh a little beyond the trimmed part, and the (u, v) of its vertices: where Newton starts."""
        u_min, u_max, v_min, v_max = self.trim_box
        domain = self.surface.domain
        beyond_u, beyond_v = 0.02 * (u_max - u_min), 0.02 * (v_max - v_min)
        u = np.linspace(max(u_min - beyond_u, domain[0]), min(u_max + beyond_u, domain[1]), START_GRID + 1)
        v = np.linspace(max(v_min - beyond_v, domain[2]), min(v_max + beyond_v, domain[3]), START_GRID + 1)
        uu, vv = np.meshgrid(u, v, indexing="ij")
        corner = np.arange((START_GRID + 1) ** 2).reshape(START_GRID + 1, -1)[:-1, :-1].ravel()
        row = START_GRID + 1
        faces = np.concatenate([np.stack([corner, corner + row, corner + row + 1], axis=1),
                                np.stack([corner, corner + row + 1, corner + 1], axis=1)])
        uv = np.stack([uu.ravel(), vv.ravel()], axis=1)
        return SurfaceMesh(self.surface.evaluate(uv[:, 0], uv[:, 1]), faces.astype(np.int32)), uv

    @cached_property
    def height_field(self) -> HeightField | None:
        """The surface as z(x, y) where its parameters are x and y themselves and z looks outward; else None."""
        return HeightField.of(self.surface) if self.sign > 0 else None


@dataclass(frozen=True, slots=True, eq=False)
class HeightField:
    """A sheet z(x, y) as polynomials in x − x_i and y − y_j on each cell, highest powers first.

    powers : degree + 1 in both directions, padded with zeros.   coefficients : flat, of (x spans, y spans, powers, powers).
    ends_x, ends_y : ends of the spans, then inf.   lookup_x, lookup_y : the span at the start of each of many uniform
    bins, none of which holds two ends.   top : largest z.
    """

    powers: int
    coefficients: Array
    ends_x: Array
    ends_y: Array
    lookup_x: NDArray[np.int32]
    lookup_y: NDArray[np.int32]
    top: float

    @staticmethod
    def of(surface: BSplineSurface) -> HeightField | None:
        if surface.weights is not None:
            return None
        from mirror_cad.bspline import greville_abscissae

        x, y = surface.poles[..., 0], surface.poles[..., 1]
        off = max(np.abs(x - greville_abscissae(surface.knots_u, surface.degree_u)[:, None]).max(),
                  np.abs(y - greville_abscissae(surface.knots_v, surface.degree_v)).max())
        if off > IDENTITY_TOLERANCE_MM:
            return None
        along_x = _power_form(surface.knots_u, surface.poles[..., 2], surface.degree_u)  # (x spans, p + 1, n_v)
        both = _power_form(surface.knots_v, np.moveaxis(along_x, 2, 0), surface.degree_v)  # (y spans, q + 1, x spans, p + 1)
        coefficients = both.transpose(2, 0, 3, 1)
        powers = next((n for n in PADDED_POWERS if n >= max(coefficients.shape[2:])), None)
        lookups = [_lookup(np.unique(knots)) for knots in (surface.knots_u, surface.knots_v)]
        if powers is None or lookups[0] is None or lookups[1] is None:
            return None
        pad = [(0, 0), (0, 0), *((powers - n, 0) for n in coefficients.shape[2:])]
        ends_x, ends_y = (np.append(np.unique(knots), np.inf) for knots in (surface.knots_u, surface.knots_v))
        return HeightField(powers, np.pad(coefficients, pad).ravel(), ends_x, ends_y, lookups[0], lookups[1],
                           float(surface.poles[..., 2].max()))


def _power_form(knots: Array, poles: Array, degree: int) -> Array:
    """Powers of (t − t_i) on each span, highest first, from the Taylor series at its start: (spans, degree + 1, …)."""
    spline = BSpline(knots, poles, degree)
    starts = np.unique(knots)[:-1]
    terms = [spline(starts, nu=m) / math.factorial(m) for m in range(1, degree + 1)]
    return np.stack([spline(starts), *terms][::-1], axis=1)


def _lookup(ends: Array) -> NDArray[np.int32] | None:
    """The span that holds the start of each bin; None where spans are too narrow for a table of bins."""
    bins = int(np.ceil((ends[-1] - ends[0]) / np.diff(ends).min() * 1.001)) + 1
    if bins > MOST_BINS:
        return None
    starts = ends[0] + (ends[-1] - ends[0]) * np.arange(bins) / bins
    return np.clip(np.searchsorted(ends, starts, side="right") - 1, 0, len(ends) - 2).astype(np.int32)


@dataclass(frozen=True, eq=False)
class Reflector:
    """What reflects, and what only stands in the way. Coordinates are the file's, in mm.

    surfaces : traced in float64 on the B-spline itself.   mesh : traced as facets with facet normals, float32 hits.
    obstacles : faces that block and do not reflect (the back and sides of a plate).
    A reflector has surfaces or a mesh, not both.
    """

    surfaces: tuple[TrimmedSurface, ...] = ()
    mesh: SurfaceMesh | None = None
    obstacles: SurfaceMesh | None = None

    @staticmethod
    def from_mirror(mirror: Mirror) -> Reflector:
        """The optical face of a designed mirror, inside its outline."""
        return Reflector((TrimmedSurface(mirror.surface, (mirror.outline.polyline(TRIM_CHORD_MM),)),))

    @cached_property
    def mesh_scene(self) -> TriangleScene:
        """The mesh in Embree, or the start meshes of all surfaces in one scene."""
        if self.mesh is not None:
            return TriangleScene(self.mesh.vertices, self.mesh.faces)
        meshes = [surface.start_mesh[0] for surface in self.surfaces]
        offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        return TriangleScene(np.concatenate([mesh.vertices for mesh in meshes]),
                             np.concatenate([mesh.faces + o for mesh, o in zip(meshes, offsets, strict=False)]))

    @cached_property
    def obstacle_scene(self) -> TriangleScene | None:
        """The obstacles in Embree."""
        return TriangleScene(self.obstacles.vertices, self.obstacles.faces) if self.obstacles is not None else None

    @cached_property
    def obstacles_behind(self) -> bool:
        """Whether every obstacle lies under a single height field, in its column and no higher than its mesh error."""
        field = self.surfaces[0].height_field if len(self.surfaces) == 1 else None
        if field is None or self.obstacles is None:
            return False
        x, y, z = self.obstacles.vertices.T
        u_min, u_max, v_min, v_max = self.surfaces[0].surface.domain
        if x.min() < u_min or x.max() > u_max or y.min() < v_min or y.max() > v_max:
            return False
        return bool((z <= self.surfaces[0].surface.evaluate(x, y)[:, 2] + OBSTACLE_DEFLECTION_MM).all())


def load_reflector(path: str | Path) -> Reflector:
    """Read a reflector from a STEP file (.step, .stp) or an STL mesh (.stl).

    In a STEP file the faces named "optical face" reflect, on their outer side, and every other face is an obstacle;
    without such a name every face reflects, on both sides. An STL mesh reflects from its facets, on both sides.
    Raises: FileError for a file that cannot be read or holds no face; TraceError for another kind of file.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind == ".stl":
        from mirror_cad.occt.tessellate import read_stl

        return Reflector(mesh=read_stl(path))
    if kind not in (".step", ".stp"):
        raise TraceError(f"{path}: a reflector is read from .step, .stp or .stl, not from {kind or 'a file without ending'!r}")
    from mirror_cad.occt.step import read_step

    return reflector_of(read_step(path))


def reflector_of(file: StepFile) -> Reflector:
    """`load_reflector` for a STEP file that has been read already."""
    from mirror_cad.occt.convert import face_loops, is_reversed
    from mirror_cad.occt.tessellate import face_mesh, triangulate

    named = any(face.name == OPTICAL_FACE for face in file.faces)
    surfaces, obstacles = [], []
    for face in file.faces:
        if not named or face.name == OPTICAL_FACE:
            sign = -1.0 if is_reversed(face.face) else 1.0
            surfaces.append(TrimmedSurface(face.surface, face_loops(face.face), sign, one_sided=named))
        else:
            triangulate(face.raw, OBSTACLE_DEFLECTION_MM, straight=True)
            obstacles.append(face_mesh(face.raw))
    return Reflector(tuple(surfaces), obstacles=_joined(obstacles))


# Obstacles only say whether something is in the way: a tenth of a millimetre is far less than a pupil.
OBSTACLE_DEFLECTION_MM = 0.1


def _joined(meshes: list[SurfaceMesh]) -> SurfaceMesh | None:
    if not meshes:
        return None
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return SurfaceMesh(np.concatenate([mesh.vertices for mesh in meshes]),
                       np.concatenate([mesh.faces + o for mesh, o in zip(meshes, offsets, strict=False)]).astype(np.int32))
