"""A B-spline face: rays are met by Newton on the surface itself, in float64."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from mirror_cad.surfaces.bspline import BSplineSurface
from raytrace.errors import TraceError
from raytrace.kernels import height_field, height_field_search, order, parametric
from raytrace.kernels.blocks import Results
from raytrace.kernels.first_hit import first_hits
from raytrace.kernels.height_field import HeightField
from raytrace.kernels.order import SortingGrid
from raytrace.kernels.outcomes import LOST
from raytrace.kernels.parametric import Patches
from raytrace.kernels.pieces import Pieces
from raytrace.kernels.sheet import Sheet, surface_points
from raytrace.parallel import parallel_for
from raytrace.rays import Rays, Status, Trace
from raytrace.surfaces.base import BoundedFace, RigidMotion, grid_points, no_inset, no_transition, with_trimming_of
from raytrace.surfaces.cut import inboard_of
from raytrace.surfaces.differentials import curvature_tensors
from raytrace.surfaces.inset import moved_inwards
from raytrace.surfaces.pieces import pieces_of
from raytrace.surfaces.polynomials import height_field_of, is_graph, patches_of
from raytrace.surfaces.trimming import Trimming

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

OUTLINE_GRID = 48  # cells a direction in which a face is looked at for whether it bulges beyond its rim
# Of a sheet's size, 2e-6 mm: what of a rim lies at its very end is looked at so far inside, where rays meet it.
END_INSET_SHARE = 1e-8
# Of the parameters of a point that lies on the face: a grid to start from, and Newton's steps from there.
START_CELLS, MAX_STEPS = 32, 12
ON_FACE = 1e-9  # of a sheet's size, 2e-7 mm: a point that is farther from it is not on it


@dataclass(frozen=True, eq=False)
class BSplineFace(BoundedFace):
    """A B-spline surface inside trimming loops.

    Parameters
    ----------
    surface : S(u, v).
    loops : closed polygons (n, 2) in (u, v), the first point not repeated; inside is by the even-odd rule.
    sign : S_u × S_v times sign is outward.
    one_sided : whether only the outward side reflects.
    """

    surface: BSplineSurface
    loops: tuple[Array, ...]
    sign: float = 1.0
    one_sided: bool = True

    # --- what it is, as the kernels take it ---------------------------------------------------------------------------

    @cached_property
    def trimming(self) -> Trimming:
        """The loops as the kernels take them."""
        return Trimming.of(self.loops)

    @cached_property
    def height_field(self) -> HeightField | None:
        """The surface as z(x, y) where its parameters are x and y themselves and z looks outward; else None."""
        return height_field_of(self.surface) if self.sign > 0 else None

    @cached_property
    def sheet(self) -> Sheet | None:  # type: ignore[override]  # worked out once
        """Itself as one sheet z(x, y), with its trimming; None where it is none."""
        field = self.height_field
        return None if field is None else Sheet(field, self.trimming.strips, self.one_sided)

    @cached_property
    def sorting_grid(self) -> SortingGrid | None:
        """Where rays go on it, as they are sorted by; None where it is no sheet."""
        field = self.height_field
        if field is not None:
            c, middle = field.cells, 0.5 * (field.top + field.bottom)
            maps = np.array([[0.0, 0.0, 1.0, -middle], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
        elif len(self.patches.sheet):
            c, s, centre = self.patches.cells, self.patches.sheet, self.patches.centre
            maps = np.array([[*s[:3], -s[:3] @ centre], [s[4] - s[5:8] @ centre, *s[5:8]], [s[8] - s[9:] @ centre, *s[9:]]])
        else:
            return None
        return SortingGrid(maps[0], maps[1], maps[2], c.ends_u, c.ends_v, c.lookup_u, c.lookup_v, c.bins_u, c.bins_v)

    @cached_property
    def is_graph(self) -> bool:
        """Whether it is z(x, y) over its own parameters, whichever side is outward, with creases or without."""
        return is_graph(self.surface)

    @cached_property
    def patches(self) -> Patches:
        """The surface as polynomials.

        Raises
        ------
        TraceError
            For a degree that the kernels do not take.
        """
        found = patches_of(self.surface)
        if found is None:
            raise TraceError(f"a face's B-spline has degree {self.surface.degree_u} × {self.surface.degree_v}; degrees up to "
                             "25 are traced: convert the face")
        return found

    def evaluate(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Points (…, 3), mm, at parameters that may lie beside the sheet by rounding."""
        sheet = self.sheet
        if sheet is not None:  # its cells are some times as fast
            at_u, at_v = np.broadcast_arrays(np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64))
            return surface_points(sheet, np.stack([at_u.ravel(), at_v.ravel()], axis=1))[:, :3].reshape(*at_u.shape, 3)
        u_min, u_max, v_min, v_max = self.surface.domain
        return self.surface.evaluate(np.clip(u, u_min, u_max), np.clip(v, v_min, v_max))

    def outline(self) -> Array:
        """Points (n, 3), mm, of its rim, and of where it bulges beyond that in x or y."""
        return self._outline

    @cached_property
    def box(self) -> Box:
        """That of its loops, where x and y are the parameters: the rim between their points need not be worked out."""
        if self.height_field is None:
            return super().box
        x, y = np.concatenate(self.loops).T
        return float(x.min()), float(x.max()), float(y.min()), float(y.max())

    @cached_property
    def _outline(self) -> Array:
        points = np.concatenate([np.empty((0, 3)), *(curve.points for curve in self.rim)])
        if self.height_field is not None:
            return points
        u_min, u_max, v_min, v_max = self.trimming.box
        u, v = (axis.ravel() for axis in np.meshgrid(np.linspace(u_min, u_max, OUTLINE_GRID + 1),
                                                     np.linspace(v_min, v_max, OUTLINE_GRID + 1)))
        bulge = self.evaluate(u, v)[self.trimming.contains(u, v)]
        if len(points):
            low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
            bulge = bulge[((bulge[:, :2] < low) | (bulge[:, :2] > high)).any(axis=1)]
        return np.concatenate([points, bulge])

    def untrimmed(self) -> BSplineFace:
        """The same face without its trimming: all of the sheet that it was cut from."""
        return self._untrimmed

    @cached_property
    def _untrimmed(self) -> BSplineFace:
        u_min, u_max, v_min, v_max = self.surface.domain
        found = replace(self, loops=(np.array([[u_min, v_min], [u_max, v_min], [u_max, v_max], [u_min, v_max]]),))
        vars(found)["height_field"] = self.height_field  # of the same surface
        return found

    @cached_property
    def pieces(self) -> Pieces:
        """What a search goes through.

        Raises
        ------
        TraceError
            For a degree that the kernels do not take.
        """
        return pieces_of((self,))

    # --- tracing ------------------------------------------------------------------------------------------------------

    def first_hits(self, rays: Rays, out: Trace) -> None:
        """Without a search where a ray can meet it only once; what that leaves, with one. See `OpticalSurface`."""
        field, strips = self.height_field, self.trimming.strips
        if field is not None:
            run_kernel(partial(height_field.hits, field, strips), rays, out, self.sorting_grid)
        elif len(self.patches.sheet):
            run_kernel(partial(parametric.hits, self.patches, strips, self.sign, self.one_sided), rays, out, self.sorting_grid)
        else:
            out.status[:] = LOST
        for part, some in rays.in_parts(out.rows_of(Status.LOST)):
            out.scatter(part, self._search(some))

    def _search(self, rays: Rays) -> Trace:
        """The first place that each ray meets, wherever it comes from."""
        found = Trace.empty(len(rays))
        field = self.height_field
        if field is not None:
            run_kernel(partial(height_field_search.first_hits, field, self.trimming.strips, self.one_sided), rays, found)
            return found
        search_pieces(self.pieces, rays, found)
        return found

    def moved(self, motion: RigidMotion) -> BSplineFace:
        """By its poles; of a right-hand mirror with u run backwards too: S_u × S_v stays on its side, and u = x so."""
        s = self.surface
        poles = motion.to_mirror(s.poles)
        if motion.hand == "right":
            return replace(self, surface=replace(s, poles=poles).u_reversed(),
                           loops=tuple(loop * [-1.0, 1.0] for loop in self.loops))
        again = replace(self, surface=BSplineSurface(s.degree_u, s.degree_v, s.knots_u, s.knots_v, poles, s.weights))
        return with_trimming_of(self, again)

    def two_sided(self) -> BSplineFace:
        """The same face, reflecting on both sides."""
        return replace(self, one_sided=False)

    # --- what is asked of any optical surface -------------------------------------------------------------------------

    @property
    def domain(self) -> Box:
        """Of a graph the whole sheet's, else that of its rim."""
        return self.surface.domain if self.is_graph else super().domain

    @property
    def parameter_limits(self) -> tuple[Array, Array]:
        """The least and the greatest (u, v) at which rays meet the sheet."""
        u_min, u_max, v_min, v_max = self.surface.domain
        low, high = np.array([u_min, v_min]), np.array([u_max, v_max])
        return low + END_INSET_SHARE * (high - low), high - END_INSET_SHARE * (high - low)

    def inset(self, margin_mm: float) -> BSplineFace:
        """With the loop moved inwards; only of a height field with one loop."""
        if self.height_field is None or len(self.loops) != 1:
            raise no_inset(margin_mm)
        return replace(self, loops=(moved_inwards(self.loops[0], margin_mm),))

    def inboard_of(self, x: float) -> BSplineFace:
        """With the loop cut at x; only of a graph with one loop."""
        if not self.is_graph or len(self.loops) != 1:
            raise no_transition(x)
        return replace(self, loops=(inboard_of(self.loops[0], x),))

    def is_above(self, points: Array, margin_mm: float) -> bool:
        """By the sheet's height over the points; not known but of a height field."""
        if self.height_field is None:
            return False
        x, y, z = points.T
        u_min, u_max, v_min, v_max = self.surface.domain
        if x.min() < u_min or x.max() > u_max or y.min() < v_min or y.max() > v_max:
            return False
        return bool((z <= self.surface.evaluate(x, y)[:, 2] + margin_mm).all())

    def prepared(self) -> BSplineFace:
        """With its loops sorted."""
        _ = self.trimming
        return self

    def points_over(self, x: Array, y: Array) -> Array:
        """Of a sheet z(x, y) from its own height; else as any surface's."""
        if self.sheet is None:
            return super().points_over(x, y)
        points = surface_points(self.sheet, np.stack([x, y], axis=1))[:, :3]
        u_min, u_max, v_min, v_max = self.surface.domain
        points[~((x >= u_min) & (x <= u_max) & (y >= v_min) & (y <= v_max))] = np.nan
        return points

    def eye_rays(self, eye: Array, x: Array, y: Array) -> Array:
        """Of a graph from its own height; else as any surface's."""
        return self.surface.evaluate(x, y) - eye if self.is_graph else super().eye_rays(eye, x, y)

    def reflected_at(self, eye: Array, x: Array, y: Array) -> tuple[Array, Array]:
        """Of a graph from its own height and slopes, without a trace; else as any surface's."""
        if not self.is_graph:
            return super().reflected_at(eye, x, y)
        return reflected_from_graph(eye, x, y, *self.surface.heights(x, y))  # u = x, v = y: height and slopes say it all

    def curvature_tensors(self, points: Array, normals: Array) -> Array:
        """From the surface's second derivatives."""
        field = self.height_field
        if field is not None:
            found = np.empty((len(points), 3, 3))
            height_field.tensors(field.cells, points, normals, found)
            return found
        u, v = points[:, :2].T if self.is_graph else self.parameters_of(points).T
        u_min, u_max, v_min, v_max = self.surface.domain
        known = np.isfinite(u) & np.isfinite(v)
        d = self.surface.derivatives(*(np.where(known, np.clip(at, low, high), low)
                                       for at, low, high in ((u, u_min, u_max), (v, v_min, v_max))))
        found = curvature_tensors(normals, d["u"], d["v"], d["uu"], d["uv"], d["vv"])
        found[~known] = np.nan
        return found

    def parameters_of(self, points: Array) -> Array:
        """Find the parameters of points on the sheet, by Gauss–Newton on S(u, v) − P from the nearest of a grid.

        Parameters
        ----------
        points : (n, 3), mm.

        Returns
        -------
        (u, v), (n, 2); NaN where none is found whose point is that one.
        """
        tree, starts, size = self._starts
        (u_min, u_max, v_min, v_max), n = self.surface.domain, len(points)
        found = np.full((n, 2), np.nan)
        going = np.flatnonzero(np.isfinite(points).all(axis=1))
        at = starts[tree.query(points[going])[1]]
        for _ in range(MAX_STEPS):
            d = self.surface.derivatives(*at.T)
            off = points[going] - d["s"]
            done = np.linalg.norm(off, axis=1) <= ON_FACE * size
            found[going[done]] = at[done]
            e, f, g = (np.einsum("ij,ij->i", d[a], d[b]) for a, b in ("uu", "uv", "vv"))
            p, q = (np.einsum("ij,ij->i", off, d[a]) for a in "uv")
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.stack([g * p - f * q, e * q - f * p], axis=1) / (e * g - f * f)[:, None]
            found[going[done]] += step[done]  # once more: to rounding
            kept = ~done & np.isfinite(step).all(axis=1)
            going, at = going[kept], np.clip(at[kept] + step[kept], [u_min, v_min], [u_max, v_max])
            if going.size == 0:
                break
        return found

    @cached_property
    def _starts(self) -> tuple[cKDTree, Array, float]:
        """Points of a grid in a tree, their parameters (m, 2), and the sheet's size, mm."""
        u_min, u_max, v_min, v_max = self.surface.domain
        u, v = np.linspace(u_min, u_max, START_CELLS + 1), np.linspace(v_min, v_max, START_CELLS + 1)
        points = self.surface.on_grid(u, v, order=0)["s"].reshape(-1, 3)
        parameters = np.stack([at.ravel() for at in np.meshgrid(u, v, indexing="ij")], axis=1)
        return cKDTree(points), parameters, float(np.linalg.norm(np.ptp(points, axis=0)))

    def reflected_on_grid(self, eye: Array, x: Array, y: Array) -> tuple[Array, Array]:
        """Of a graph from heights and slopes on the grid; else as any surface's."""
        at_x, at_y = grid_points(x, y)
        if not self.is_graph:
            return super().reflected_on_grid(eye, x, y)
        d = self.surface.on_grid(x, y, component=2)
        return reflected_from_graph(eye, at_x, at_y, *(d[key].ravel() for key in ("s", "u", "v")))


def reflected_from_graph(eye: Array, x: Array, y: Array, z: Array, z_x: Array, z_y: Array) -> tuple[Array, Array]:
    """Reflect rays from an eye at points of a graph z(x, y).

    d' = d − 2(d·n)n,   n = (−z_x, −z_y, 1)/√(1 + z_x² + z_y²).

    Parameters
    ----------
    eye : (3,), mm.
    x, y, z, z_x, z_y : (n,), mm, of the points, and the slopes there.

    Returns
    -------
    points, directions : (n, 3), mm and unit.
    """
    points = np.stack([x, y, z], axis=1)
    normal = np.stack([-z_x, -z_y, np.ones_like(z)], axis=1) / np.sqrt(1.0 + z_x * z_x + z_y * z_y)[:, None]
    ray = points - eye
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    return points, ray - 2.0 * np.einsum("ij,ij->i", ray, normal)[:, None] * normal


def search_pieces(pieces: Pieces, rays: Rays, found: Trace, begun: bool = False) -> None:
    """Find the first point that each ray meets of B-splines, by a search that needs no point to start from.

    Parameters
    ----------
    pieces : of the B-splines.
    rays : n rays.
    found : what is written.
    begun : whether `found` holds what has been met of other surfaces, which stays where it is nearer; else results are new.
    """
    _, units, valid = rays.units()
    if not begun:
        found.status[:] = np.where(valid, Status.MISSED, Status.INVALID)
        found.invalidate(np.arange(len(rays)))
    first_hits(pieces, rays.origins.ravel(), units.ravel(), valid, found.flat)


def run_kernel(kernel: Callable[[Array, Array, Results], None], rays: Rays, out: Trace, grid: SortingGrid | None = None,
               ) -> None:
    """Run a kernel on all cores: of each run of rays it gets the origins, the directions and the results, flat.

    grid : where rays go on the sheet: the kernel gets those that lie apart sorted by that.
    """
    origins, directions, results = rays.origins.ravel(), rays.directions.ravel(), out.flat
    if len(rays) < order.LEAST:  # one run, and too few to be sorted
        kernel(origins, directions, results)
        return

    def work(i: int, j: int) -> None:
        o, d, found = origins if origins.size == 3 else origins[3 * i:3 * j], directions[3 * i:3 * j], results.of_rays(i, j)
        if grid is not None and j - i >= order.LEAST:
            room = order.room(j - i)
            if order.scattered(grid, o, d, room.places):
                n = j - i
                order.gather(grid, o, d, room)
                kernel(o if o.size == 3 else room.origins[:3 * n], room.directions[:3 * n], room.results.of_rays(0, n))
                order.put_back(room, n, found)
                return
        kernel(o, d, found)

    parallel_for(work, len(rays))
