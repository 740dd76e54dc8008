"""A mirror, a STEP face or an STL mesh in, a Reflector out: what `reflect` traces, without any design intent."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirror_cad.mesh import SurfaceMesh
from mirror_cad.surfaces.bspline import BSplineSurface
from raytrace.embree import TriangleScene
from raytrace.errors import TraceError
from raytrace.surfaces.patches import HeightField, Patches
from raytrace.surfaces.quadric import TrimmedQuadric
from raytrace.surfaces.rim import Curve, rim_of
from raytrace.surfaces.trimming import Trimming

if TYPE_CHECKING:
    from mirror_cad.mirror import Mirror
    from mirror_cad.occt.step import StepFace, StepFile
    from raytrace.placement import Placement
    from raytrace.seating import Place

Array = NDArray[np.float64]

Normals = Literal["facets", "interpolated"]
Colour = tuple[int, int, int]

OPTICAL_FACE = "optical face"
FRONT_FACE = "front face"
GLASS_INDEX = 1.52  # float glass, at the helium d line
START_GRID = 48  # cells a direction of the coarse mesh that Newton starts from
MIN_IN_SPAN = 3
SHELL = 2.0  # times the distance between facets and surface: what is between the places looked at is less than twice as much
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
    def trimming(self) -> Trimming:
        """The loops as the kernels take them."""
        return Trimming.of(self.loops)

    @cached_property
    def height_field(self) -> HeightField | None:
        """The surface as z(x, y) where its parameters are x and y themselves and z looks outward; else None."""
        return HeightField.of(self.surface) if self.sign > 0 else None

    @cached_property
    def patches(self) -> Patches:
        """The surface as polynomials. Raises: TraceError for a degree that the kernels do not take."""
        found = Patches.of(self.surface)
        if found is None:
            raise TraceError(f"a face's B-spline has degree {self.surface.degree_u} × {self.surface.degree_v}; degrees up to "
                             "25 are traced: convert the face")
        return found

    def evaluate(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Points (…, 3), mm, at parameters that may lie beside the sheet by rounding."""
        u_min, u_max, v_min, v_max = self.surface.domain
        return self.surface.evaluate(np.clip(u, u_min, u_max), np.clip(v, v_min, v_max))

    @cached_property
    def rim(self) -> tuple[Curve, ...]:
        """The curves that bound it."""
        return rim_of(self.evaluate, self.loops)

    def outline(self) -> Array:
        """Points (n, 3), mm, of its rim, and of where it bulges beyond that in x or y."""
        return self._outline

    @cached_property
    def _outline(self) -> Array:
        points = np.concatenate([np.empty((0, 3)), *(curve.points for curve in self.rim)])
        if self.height_field is not None:
            return points
        u_min, u_max, v_min, v_max = self.trimming.box
        u, v = (axis.ravel() for axis in np.meshgrid(np.linspace(u_min, u_max, START_GRID + 1),
                                                     np.linspace(v_min, v_max, START_GRID + 1)))
        bulge = self.evaluate(u, v)[self.trimming.contains(u, v)]
        if len(points):
            low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
            bulge = bulge[((bulge[:, :2] < low) | (bulge[:, :2] > high)).any(axis=1)]
        return np.concatenate([points, bulge])

    def untrimmed(self) -> TrimmedSurface:
        """The same face without its trimming: all of the sheet that it was cut from."""
        u_min, u_max, v_min, v_max = self.surface.domain
        return replace(self, loops=(np.array([[u_min, v_min], [u_max, v_min], [u_max, v_max], [u_min, v_max]]),))

    @cached_property
    def start_mesh(self) -> tuple[SurfaceMesh, Array]:
        """Where Newton starts: two coarse meshes, one to either side of the surface by SHELL times what their facets are off
        it where that was looked at, a little beyond its trimmed part; and the (u, v) of their vertices."""
        (u_min, u_max, v_min, v_max), domain = self.trimming.box, self.surface.domain
        beyond_u, beyond_v = 0.02 * (u_max - u_min), 0.02 * (v_max - v_min)
        u = _start_grid(self.surface.knots_u, max(u_min - beyond_u, domain[0]), min(u_max + beyond_u, domain[1]))
        v = _start_grid(self.surface.knots_v, max(v_min - beyond_v, domain[2]), min(v_max + beyond_v, domain[3]))
        d = self.surface.on_grid(u, v)
        # How far the facets are from the surface: at the middles of the cells and of their sides.
        coarse = d["s"][::2, ::2]
        sides = np.concatenate([(0.5 * (coarse[1:] + coarse[:-1]) - d["s"][1::2, ::2]).reshape(-1, 3),
                                (0.5 * (coarse[:, 1:] + coarse[:, :-1]) - d["s"][::2, 1::2]).reshape(-1, 3),
                                (0.5 * (coarse[1:, 1:] + coarse[:-1, :-1]) - d["s"][1::2, 1::2]).reshape(-1, 3)])
        apart = SHELL * float(np.linalg.norm(sides, axis=1).max())
        across = np.cross(d["u"], d["v"])[::2, ::2]
        length = np.linalg.norm(across, axis=2, keepdims=True)
        normal = np.divide(across, length, out=np.zeros_like(across), where=length > 0.0)
        uv = np.stack(np.meshgrid(u[::2], v[::2], indexing="ij"), axis=2).reshape(-1, 2)
        rows, row = len(u[::2]), len(v[::2])
        corner = np.arange(rows * row).reshape(rows, row)[:-1, :-1].ravel()
        faces = np.concatenate([np.stack([corner, corner + row, corner + row + 1], axis=1),
                                np.stack([corner, corner + row + 1, corner + 1], axis=1)]).astype(np.int32)
        shells = np.concatenate([(coarse + side * apart * normal).reshape(-1, 3) for side in (1.0, -1.0)])
        return SurfaceMesh(shells, np.concatenate([faces, faces + np.int32(rows * row)])), np.concatenate([uv, uv])

    @cached_property
    def start_scene(self) -> TriangleScene:
        """The start meshes in Embree, alone: faces side by side share theirs, and one would hide the other."""
        return TriangleScene(self.start_mesh[0].vertices, self.start_mesh[0].faces)


def _start_grid(knots: Array, low: float, high: float) -> Array:
    """Twice START_GRID cells or more between low and high, with ends at the knots and as many in every span."""
    ends = np.concatenate([[low], np.unique(knots[(knots > low) & (knots < high)]), [high]])
    parts = max(-(-START_GRID // (len(ends) - 1)), MIN_IN_SPAN)
    inner = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(2 * parts) / (2 * parts)
    return np.append(inner.ravel(), high)


@dataclass(frozen=True, slots=True, eq=False)
class Glass:
    """What light goes through before and after it is reflected: the plate's front face, outward side to the air, and the
    refractive index of the glass against air, from 1 on."""

    front: TrimmedSurface | TrimmedQuadric
    index: float


@dataclass(frozen=True, eq=False)
class Reflector:
    """What reflects, and what only stands in the way. Coordinates are the file's, or the mirror's where it was seated; mm.

    surfaces : traced in float64 on the B-spline, plane, sphere or cylinder itself; the nearest that a ray meets counts.
    mesh : traced as facets; `normals` says whether with their own normals or with those interpolated between vertices.
    obstacles : faces that block and do not reflect (the back and sides of a plate).
    glass : what stands before a surface that reflects from behind glass.
    placement : where the coordinates are in those of the file, where it is known.
    A reflector has surfaces or a mesh, not both.
    """

    surfaces: tuple[TrimmedSurface | TrimmedQuadric, ...] = ()
    mesh: SurfaceMesh | None = None
    normals: Normals = "facets"
    obstacles: SurfaceMesh | None = None
    glass: Glass | None = None
    placement: Placement | None = None

    @staticmethod
    def from_mirror(mirror: Mirror) -> Reflector:
        """The optical face of a designed mirror, inside its outline, with the glass before one that reflects from the back."""
        loops, glass = (mirror.outline.polyline(TRIM_CHORD_MM),), mirror.spec.glass
        front = Glass(TrimmedSurface(mirror.front, loops), glass.index) if glass.reflecting == "back" else None
        return Reflector((TrimmedSurface(mirror.surface, loops),), glass=front)

    @cached_property
    def splines(self) -> tuple[TrimmedSurface, ...]:
        """Those of the surfaces that are B-splines."""
        return tuple(surface for surface in self.surfaces if isinstance(surface, TrimmedSurface))

    @cached_property
    def quadrics(self) -> tuple[TrimmedQuadric, ...]:
        """Those of the surfaces that are planes, spheres and cylinders."""
        return tuple(surface for surface in self.surfaces if isinstance(surface, TrimmedQuadric))

    @property
    def only(self) -> TrimmedSurface | None:
        """The surface, where there is one alone and it is a B-spline."""
        return self.splines[0] if len(self.surfaces) == len(self.splines) == 1 else None

    @cached_property
    def sheet(self) -> Reflector:
        """The sheet that a single face was cut from, with the whole front where there is glass, and nothing in the way; of
        several faces, or a mesh, what reflects."""
        if len(self.surfaces) != 1:
            return replace(self, obstacles=None)
        glass = None if self.glass is None else replace(self.glass, front=self.glass.front.untrimmed())
        return Reflector((self.surfaces[0].untrimmed(),), glass=glass)

    @cached_property
    def uncoated(self) -> Reflector:
        """The same without glass before it."""
        return self.sheet if self.glass is None else replace(self.sheet, glass=None)

    @cached_property
    def mesh_scene(self) -> TriangleScene:
        """The mesh in Embree."""
        assert self.mesh is not None  # asked for only where there is a mesh
        return TriangleScene(self.mesh.vertices, self.mesh.faces)

    @cached_property
    def facet_normals(self) -> Array:
        """Unit normals of the mesh's facets, (m, 3)."""
        assert self.mesh is not None  # asked for only where there is a mesh
        return self.mesh.facet_normals()

    @cached_property
    def corner_normals(self) -> Array:
        """Normals of the mesh at its facets' corners, (m, 3, 3)."""
        from raytrace.kernels.mesh_normals import corner_normals

        assert self.mesh is not None  # asked for only where there is a mesh
        return corner_normals(self.mesh)

    @cached_property
    def obstacle_scene(self) -> TriangleScene | None:
        """The obstacles in Embree."""
        return TriangleScene(self.obstacles.vertices, self.obstacles.faces) if self.obstacles is not None else None

    @cached_property
    def obstacles_behind(self) -> bool:
        """Whether every obstacle lies under a single height field, in its column and no higher than its mesh error."""
        if self.only is None or self.only.height_field is None or self.obstacles is None:
            return False
        x, y, z = self.obstacles.vertices.T
        u_min, u_max, v_min, v_max = self.only.surface.domain
        if x.min() < u_min or x.max() > u_max or y.min() < v_min or y.max() > v_max:
            return False
        return bool((z <= self.only.surface.evaluate(x, y)[:, 2] + OBSTACLE_DEFLECTION_MM).all())

    def outline(self) -> Array:
        """Points (n, 3) mm of what reflects: its vertices or the edges of its faces."""
        if self.mesh is not None:
            return self.mesh.vertices
        return np.concatenate([surface.outline() for surface in self.surfaces])


def load_reflector(path: str | Path, face: str | int | Colour | None = None, normals: Normals = "facets",
                   index: float = GLASS_INDEX, place: Place = "file") -> Reflector:
    """Read a reflector from a STEP file (.step, .stp) or a mesh (.stl, .obj, .ply, .off, .gltf, .glb, .3mf).

    In a STEP file the faces named "optical face" reflect, on their outer side, and every other face is an obstacle;
    without such a name every face reflects, on both sides. `face` chooses otherwise: the faces of another name, the face of a
    number (1 is the first of the file), or the faces of a colour (red, green, blue, 0 to 255); these reflect on both sides,
    and the others are obstacles. With a "front face" beside the optical one, light goes through
    glass of refractive index `index`. Planes, spheres and cylinders are traced as such, other surfaces as the B-splines
    that they are or that are the same surface. A mesh reflects on both sides, from its facets or, with
    normals = "interpolated", as the smooth surface its vertices lie on.

    `place` says in which coordinates: "file", those of the file, in which a script shoots its rays; "face", mirror coordinates
    by the face's own frame (`raytrace.seating` has the rules); a `raytrace.Placement`, mirror coordinates as it states them;
    "auto", as the commands have it: "file" for a file that `mirror-cad build` wrote, "face" for any other. The placement that
    was taken is `reflector.placement`.
    Raises: FileError for a file that cannot be read or holds no face; TraceError for another kind of file, or where no face
    is the chosen one.
    """
    from mirror_cad.own_files import written_by_us
    from raytrace.seating import seated

    return seated(_as_filed(Path(path), face, normals, index), written_by_us(Path(path)), place)


def _as_filed(path: Path, face: str | int | Colour | None, normals: Normals, index: float) -> Reflector:
    """`load_reflector` in the coordinates of the file."""
    kind = path.suffix.lower()
    if not 1.0 <= index < float("inf"):
        raise TraceError(f"an index of {index:g} is no glass in air: it must be 1 or more")
    if normals not in get_args(Normals):
        raise TraceError(f"normals = {normals!r}: a mesh is traced with normals = \"facets\" or \"interpolated\"")
    if kind in (".step", ".stp"):
        from mirror_cad.occt.step import read_step

        file = read_step(path)
        return reflector_of(file, index) if face is None else _chosen(file, path, face)
    if face is not None:
        raise TraceError(f"{path}: a mesh has no faces to choose from; face = {face!r} is for STEP files")
    if kind == ".stl":
        from mirror_cad.occt.tessellate import read_stl

        return Reflector(mesh=read_stl(path), normals=normals)
    from raytrace.mesh_files import MESH_KINDS, read_mesh

    if kind not in MESH_KINDS:
        raise TraceError(f"{path}: a reflector is read from .step, .stp, .stl, {', '.join(MESH_KINDS)}, not from "
                         f"{kind or 'a file without ending'!r}")
    return Reflector(mesh=read_mesh(path), normals=normals)


def reflector_of(file: StepFile, index: float = GLASS_INDEX) -> Reflector:
    """`load_reflector` for a STEP file that has been read already."""
    from mirror_cad.occt.tessellate import face_mesh, triangulate

    named = any(face.name == OPTICAL_FACE for face in file.faces)
    fronts = [face for face in file.faces if face.name == FRONT_FACE] if named else []
    surfaces, obstacles = [], []
    for face in file.faces:
        if not named or face.name == OPTICAL_FACE:
            surfaces.append(_trimmed(face, one_sided=named))
        elif face not in fronts:
            triangulate(face.raw, OBSTACLE_DEFLECTION_MM, straight=True)
            obstacles.append(face_mesh(face.raw))
    if not fronts:
        return Reflector(tuple(surfaces), obstacles=_joined(obstacles))
    if len(fronts) != 1 or len(surfaces) != 1:
        raise TraceError(f"glass is traced through one {FRONT_FACE!r} and one {OPTICAL_FACE!r}; the file has "
                         f"{len(fronts)} and {len(surfaces)}")
    # The reflecting side of the back is that of the glass, the file's inner one.
    back = replace(surfaces[0], sign=-surfaces[0].sign)
    return Reflector((back,), obstacles=_joined(obstacles), glass=Glass(_trimmed(fronts[0], one_sided=True), index))


def _chosen(file: StepFile, path: Path, face: str | int | Colour) -> Reflector:
    """The reflector in which the faces of a name, a number or a colour reflect."""
    from mirror_cad.occt.tessellate import face_mesh, triangulate

    if isinstance(face, bool) or not isinstance(face, str | int | np.integer | tuple | list):
        raise TraceError(f"face = {face!r}: a name, a number from 1 on, or a colour (red, green, blue), 0 to 255, chooses a "
                         "face")
    if isinstance(face, str):
        wanted = [k for k, each in enumerate(file.faces) if each.name == face]
        there = "names: " + (", ".join(sorted({repr(each.name) for each in file.faces if each.name})) or "none")
    elif isinstance(face, int | np.integer):
        wanted = [face - 1] if 1 <= face <= len(file.faces) else []
        there = f"numbers: 1 to {len(file.faces)}"
    else:
        from mirror_cad.occt.step import face_colours

        colours = face_colours(path)
        if len(colours) != len(file.faces):
            raise TraceError(f"{path}: the kernel has colours for {len(colours)} of {len(file.faces)} faces: choose the face "
                             "by its number")
        wanted = [k for k, colour in enumerate(colours) if colour == tuple(face)]
        there = "colours: " + (", ".join(str(colour) for colour in sorted({c for c in colours if c is not None})) or "none")
    if not wanted:
        raise TraceError(f"{path}: no face is {face!r}; the file has {there}")
    obstacles = []
    for each in (each for k, each in enumerate(file.faces) if k not in wanted):
        triangulate(each.raw, OBSTACLE_DEFLECTION_MM, straight=True)
        obstacles.append(face_mesh(each.raw))
    return Reflector(tuple(_trimmed(file.faces[k], one_sided=False) for k in wanted), obstacles=_joined(obstacles))


def _trimmed(face: StepFace, one_sided: bool) -> TrimmedSurface | TrimmedQuadric:
    from mirror_cad.occt.convert import face_loops, is_reversed

    quadric = face.quadric
    if quadric is not None:
        return TrimmedQuadric(quadric, face_loops(face.raw), -1.0 if is_reversed(face.raw) else 1.0, one_sided)
    return TrimmedSurface(face.surface, face_loops(face.face), -1.0 if is_reversed(face.face) else 1.0, one_sided)


# Obstacles only say whether something is in the way: a tenth of a millimetre is far less than a pupil.
OBSTACLE_DEFLECTION_MM = 0.1


def _joined(meshes: list[SurfaceMesh]) -> SurfaceMesh | None:
    if not meshes:
        return None
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return SurfaceMesh(np.concatenate([mesh.vertices for mesh in meshes]),
                       np.concatenate([mesh.faces + o for mesh, o in zip(meshes, offsets, strict=False)]).astype(np.int32))
