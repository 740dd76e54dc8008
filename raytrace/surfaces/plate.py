"""A plate of glass that reflects from its back: rays refracted in, reflected and refracted out again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from mirror_cad.surfaces.differential import normals
from raytrace.errors import TraceError
from raytrace.kernels import glass, plate_edge, plate_entry
from raytrace.kernels.glass import Sheets
from raytrace.kernels.order import SortingGrid
from raytrace.rays import Index, Mask, Rays, Status, Trace
from raytrace.surfaces.area_samples import AreaSamples
from raytrace.surfaces.base import Box, OpticalSurface, RigidMotion, no_inset, no_transition
from raytrace.surfaces.bspline import BSplineFace, run_kernel
from raytrace.surfaces.faces import Face
from raytrace.surfaces.rim import Curve

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Rays inside the glass that are taken face by face are started this far before the face they leave, as a share of the size
# of the back's domain: what they meet lies behind the start, however thin the glass and whatever rounding does.
RUN_UP = 0.01
BESIDE_MM = 0.1  # beside the front's outline, which is known by points: nothing of the front is there
MAX_STEPS = 12  # of Newton for the path through the glass: from the place right above, four or five serve
# The path is found when a step moves its place on the front by less: rounding of coordinates of some 100 mm.
STEP_MM = 1e-11


def refract(directions: Array, normals: Array, eta: float) -> tuple[Array, Flags]:
    """Refract rays that meet a face between two media of indices n1 and n2, by Snell's law.

    t = η·d + (η·c − √(1 − η² + η²c²))·n with c = −d·n, n turned against the ray; 1 − η² is taken as (1 − η)(1 + η), so that
    η = 1 gives d back at grazing incidence too.

    Parameters
    ----------
    directions, normals : d and n, (n, 3), unit; normals of either sense.
    eta : η = n1/n2.

    Returns
    -------
    directions : (n, 3), unit; NaN for rays that are totally reflected.
    total : (n,), which rays are.

    References
    ----------
    Born and Wolf, Principles of Optics, section 1.5.1, in vector form.
    """
    along = np.einsum("ij,ij->i", directions, normals)
    c = eta * np.abs(along)
    squared = (1.0 - eta) * (1.0 + eta) + c * c
    total = squared < 0.0
    root = np.sqrt(np.where(total, np.nan, squared))
    turned = np.where(along > 0.0, root - c, c - root)
    return eta * directions + turned[:, None] * normals, total


@dataclass(frozen=True, eq=False)
class Plate(OpticalSurface):
    """Two faces with glass between them, of which the back reflects.

    Parameters
    ----------
    front : its outward side is that of the air.
    back : its outward side is that of the glass.
    index : of the glass against air, 1 or more.

    Raises
    ------
    TraceError
        For an index below 1.
    """

    front: Face
    back: Face
    index: float

    def __post_init__(self) -> None:
        if not 1.0 <= self.index < np.inf:
            raise TraceError(f"an index of {self.index:g} is no glass in air: it must be 1 or more")

    def first_hits(self, rays: Rays, out: Trace) -> None:
        """Into the plate by its front, to its reflecting back, and out by the front, on the surfaces themselves.

        Of the ray that leaves: `points` where it leaves the front and `directions` after that; `normals` are those of the
        back where it reflects, towards the glass; `distances` run along the incoming ray to the front.
        Status: MISSED and BEHIND as on the front; BLOCKED where a ray that got in meets no reflecting part of the back,
        leaves elsewhere than by the front (the sides are black), or is totally reflected there. A ray that leaves by one
        side and comes in again by another counts as one that stayed inside.
        """
        sheets = self._sheets
        if sheets is None:
            self.face_by_face(rays, out)
            return
        run_kernel(partial(glass.hits, sheets), rays, out, self._grid)
        for part, some in rays.in_parts(out.rows_of(Status.LOST)):
            found = Trace.empty(len(some))
            self.face_by_face(some, found)
            out.scatter(part, found)

    @cached_property
    def _sheets(self) -> Sheets | None:
        """The plate as one kernel takes it; None where its faces are not a sheet S(u, v) before a sheet z(x, y)."""
        front, back = self.front, self.back
        if not (isinstance(front, BSplineFace) and isinstance(back, BSplineFace)) or back.height_field is None \
                or front.surface.weights is not None or not len(front.patches.sheet) \
                or front.patches.cells.powers != back.height_field.cells.powers:
            return None
        return Sheets(front.patches, front.trimming.strips, front.sign, front.one_sided, back.height_field,
                      back.trimming.strips, self.index)

    @cached_property
    def plate(self) -> plate_edge.Plate | None:  # type: ignore[override]  # worked out once
        """Itself, where one kernel takes it."""
        front, sheets, whole = self.front, self._sheets, self.untrimmed()._sheets
        if sheets is None or whole is None or not isinstance(front, BSplineFace):
            return None
        outline, heights = front.outline(), front.surface.poles[..., 2]  # a B-spline lies between its poles
        bounds = np.stack([outline.min(axis=0), outline.max(axis=0)]) + np.array([[-BESIDE_MM], [BESIDE_MM]])
        bounds[:, 2] = heights.min(), heights.max()
        reach = np.array([[edges[:, 0].min(), edges[:, 0].max(), edges[:, 1].min(), edges[:, 1].max()]
                          for edges in (sheets.front_strips.edges, sheets.back_strips.edges)])  # loops: each end is a start
        return plate_edge.Plate(sheets, whole, reach, bounds)

    @property
    def _grid(self) -> SortingGrid | None:
        """Where rays go on the back."""
        return self.back.sorting_grid if isinstance(self.back, BSplineFace) else None

    def face_by_face(self, rays: Rays, out: Trace) -> None:
        """The same for any faces: all rays to one, then those that are left to the next."""
        x_min, x_max, y_min, y_max = self.back.domain
        run_up = RUN_UP * float(np.hypot(x_max - x_min, y_max - y_min))
        self.front.first_hits(rays, out)
        inside = np.flatnonzero(out.status == Status.REFLECTED)
        _, units, _ = rays.some(inside).units()
        down, _ = refract(units, out.normals[inside], 1.0 / self.index)
        turning = _from_before(self.back, out.points[inside], down, run_up)
        inside = _still(out, inside, turning.status)
        met = turning.status == Status.REFLECTED
        leaving = _from_before(self._front_from_inside, turning.points[met], turning.directions[met], run_up)
        after, total = refract(turning.directions[met], leaving.normals, self.index)
        status = np.where(total, np.int8(Status.BLOCKED), leaving.status)
        out.points[inside], out.normals[inside], out.directions[inside] = leaving.points, turning.normals[met], after
        _still(out, inside, status)

    @cached_property
    def _front_from_inside(self) -> Face:
        return replace(self.front, one_sided=False)

    @property
    def glass(self) -> Plate:
        """Itself."""
        return self

    @property
    def refracts(self) -> bool:
        """Light goes through its glass."""
        return True

    def outline(self) -> Array:
        """Of the back, which reflects."""
        return self.back.outline()

    @property
    def box(self) -> Box:  # type: ignore[override]  # worked out once, there
        """Of the back."""
        return self.back.box

    @property
    def rim(self) -> tuple[Curve, ...]:
        """That of the back."""
        return self.back.rim

    @property
    def extends(self) -> bool:
        """Its sheets go on."""
        return True

    @property
    def edge_inset(self) -> float:
        """None: rays are found by where they are reflected, on sheets that go on."""
        return 0.0

    @property
    def domain(self) -> Box:
        """That of the back."""
        return self.back.domain

    def is_above(self, points: Array, margin_mm: float) -> bool:
        """By the front, which rays from before it reach first: known where they meet that only once."""
        x, y, z = points.T
        return self._sheets is not None and bool((z <= self.front.points_over(x, y)[:, 2] + margin_mm).all())

    def untrimmed(self) -> Plate:
        """The whole of both sheets."""
        return self._untrimmed

    @cached_property
    def _untrimmed(self) -> Plate:
        return replace(self, front=self.front.untrimmed(), back=self.back.untrimmed())

    def uncoated(self) -> Face:
        """The back."""
        return self.back

    def inset(self, margin_mm: float) -> Plate:
        """With both loops moved inwards, on the parameters of the back."""
        if not (isinstance(self.front, BSplineFace) and isinstance(self.back, BSplineFace)):
            raise no_inset(margin_mm)
        back = self.back.inset(margin_mm)
        return replace(self, front=replace(self.front, loops=back.loops), back=back)  # both on the parameters of the back

    def inboard_of(self, x: float) -> Plate:
        """Both faces cut at x."""
        if not (isinstance(self.front, BSplineFace) and isinstance(self.back, BSplineFace)):
            raise no_transition(x)
        back = self.back.inboard_of(x)
        return replace(self, front=replace(self.front, loops=back.loops), back=back)

    def front_at(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Points of the front and its normals towards the air.

        Parameters
        ----------
        u, v : (n,), its parameters.

        Returns
        -------
        points, normals : (n, 3), mm and unit.

        Raises
        ------
        TraceError
            For a front that is no B-spline.
        """
        if not isinstance(self.front, BSplineFace):
            raise TraceError("the plate's front is no B-spline: its ghost is not measured")
        d = self.front.surface.derivatives(u, v)
        return d["s"], self.front.sign * normals(d["u"], d["v"])

    def moved(self, motion: RigidMotion) -> Plate:
        """Both faces."""
        return replace(self, front=self.front.moved(motion), back=self.back.moved(motion))

    @property
    def looks_outward(self) -> bool:
        """Whether the back is one-sided."""
        return self.back.one_sided

    def area_samples(self) -> AreaSamples:
        """Of the back, which reflects."""
        return self.back.area_samples()

    def one_side(self, samples: AreaSamples, side: Mask) -> tuple[OpticalSurface, Array]:
        """That of the back, which reflects."""
        return self.back.one_side(samples, side)

    def prepared(self) -> Plate:
        """With both faces prepared."""
        self.front.prepared(), self.back.prepared()
        return self

    def eye_rays(self, eye: Array, x: Array, y: Array) -> Array:
        """Find the directions from an eye to where the front lets rays in that are reflected at points of the back.

        By Fermat's principle (`raytrace.kernels.plate_entry`), from the point right above.

        Parameters
        ----------
        eye : (3,), mm.
        x, y : (n,), mm, of the points.

        Returns
        -------
        (n, 3), of any length; NaN where no such point is on the front's sheet, and for faces that are no B-splines over (x, y).
        """
        front, back = self.front, self.back
        if not (isinstance(front, BSplineFace) and isinstance(back, BSplineFace) and back.is_graph):
            return np.full((len(x), 3), np.nan)
        rays = plate_entry.rays_through(front.patches, self.index, eye, back.evaluate(x, y), MAX_STEPS, STEP_MM)
        x_min, x_max, y_min, y_max = self.domain
        rays[~((x >= x_min) & (x <= x_max) & (y >= y_min) & (y <= y_max))] = np.nan
        return rays


def _still(trace: Trace, index: Index, status: NDArray[np.int8]) -> Index:
    """Those of the rays that go on; the others are blocked, but for those that Newton lost."""
    off = status != Status.REFLECTED
    ended = index[off]
    trace.status[ended] = np.where(status[off] == Status.LOST, Status.LOST, Status.BLOCKED)
    trace.invalidate(ended)
    return index[~off]


def _from_before(face: Face, points: Array, directions: Array, run_up: float) -> Trace:
    found = Trace.empty(len(points))
    face.first_hits(Rays(points - run_up * directions, np.ascontiguousarray(directions)), found)
    return found
