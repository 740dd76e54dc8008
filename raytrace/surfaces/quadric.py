"""A plane, sphere or cylinder face: rays are met in closed form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirror_cad.surfaces.quadric import Quadric
from raytrace.kernels.blocks import unit_directions
from raytrace.kernels.quadrics import CYLINDER, PLANE, SPHERE, TURN, QuadricArrays, Quadrics, meet, meet_first, on_face
from raytrace.kernels.trees import NODES, tree_of
from raytrace.parallel import parallel_for
from raytrace.rays import Mask, Rays, Trace
from raytrace.surfaces.base import BoundedFace, RigidMotion, with_trimming_of
from raytrace.surfaces.pieces import BOX_MARGIN
from raytrace.surfaces.trimming import STRIPS, Trimming

Array = NDArray[np.float64]

# Edges that run along u crowd into few strips: where rays are looked at one by one, narrow ones are worth their memory.
MAX_STRIPS = 1 << 16
EQUATOR = 256  # points on it
FEW = 8  # quadrics that are looked at one by one sooner than by their tree
KINDS = {"plane": PLANE, "sphere": SPHERE, "cylinder": CYLINDER}


@dataclass(frozen=True, eq=False)
class QuadricFace(BoundedFace):
    """A quadric inside trimming loops.

    Parameters
    ----------
    quadric : the whole surface.
    loops : closed polygons (n, 2) in its (u, v), the first point not repeated; inside is by the even-odd rule.
    sign : S_u × S_v times sign is outward.
    one_sided : whether only the outward side reflects.
    """

    quadric: Quadric
    loops: tuple[Array, ...]
    sign: float = 1.0
    one_sided: bool = True

    @cached_property
    def trimming(self) -> Trimming:
        """The loops as the kernels take them."""
        return Trimming.of(self.loops, min(max(STRIPS, sum(map(len, self.loops)) // 4), MAX_STRIPS))

    def outline(self) -> Array:
        """Points (n, 3), mm, of its rim, and of a sphere where it bulges beyond that: between which it lies in x, y and z."""
        return self._outline

    @cached_property
    def _outline(self) -> Array:
        points, quadric = [curve.points for curve in self.rim], self.quadric
        if quadric.kind == "sphere":
            angle = np.linspace(0.0, TURN, EQUATOR, endpoint=False)
            normals = np.concatenate([np.stack([np.cos(angle), np.sin(angle), np.zeros(EQUATOR)], axis=1),
                                      [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
            x, y, z = quadric.axes @ normals.T
            u, v = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
            inside = [on_face(SPHERE, self.trimming.strips, *self.trimming.box[:2], *at) for at in zip(u, v, strict=True)]
            points.append(quadric.centre + quadric.radius_mm * normals[inside])
        return np.concatenate(points)

    def untrimmed(self) -> QuadricFace:
        """A part of the same quadric that reaches farther than its loops by half of their size, on every side."""
        return self._untrimmed

    @cached_property
    def _untrimmed(self) -> QuadricFace:
        u_min, u_max, v_min, v_max = self.trimming.box
        more_u, more_v = 0.5 * (u_max - u_min), 0.5 * (v_max - v_min)
        low, high, bottom, top = u_min - more_u, u_max + more_u, v_min - more_v, v_max + more_v
        if self.quadric.kind != "plane" and high - low > TURN:
            low, high = u_min, u_min + TURN
        if self.quadric.kind == "sphere":
            bottom, top = max(bottom, -0.5 * np.pi), min(top, 0.5 * np.pi)
        return replace(self, loops=(np.array([[low, bottom], [high, bottom], [high, top], [low, top]]),))

    # --- what is asked of any optical surface -------------------------------------------------------------------------

    @property
    def parameter_limits(self) -> tuple[Array, Array]:
        """None: a quadric has no ends of its own."""
        return np.full(2, -np.inf), np.full(2, np.inf)

    def moved(self, motion: RigidMotion) -> QuadricFace:
        """By its centre and axes; S_u × S_v of a reflection points to the other side."""
        q = self.quadric
        turned = Quadric(q.kind, motion.to_mirror(q.centre), q.axes @ motion.rotation.T, q.radius_mm)
        sign = self.sign if motion.hand == "left" else -self.sign  # S_u × S_v of the reflection points to the other side
        return with_trimming_of(self, replace(self, quadric=turned, sign=sign))

    def two_sided(self) -> QuadricFace:
        """The same face, reflecting on both sides."""
        return replace(self, one_sided=False)

    def evaluate(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Points (…, 3), mm, at its parameters."""
        return self.quadric.evaluate(u, v)

    def first_hits(self, rays: Rays, out: Trace) -> None:
        """In closed form. See `OpticalSurface`."""
        first_of_quadrics((self,), None, rays, out)

    def curvature_tensors(self, points: Array, normals: Array) -> Array:
        """N = 0 of a plane; ±(1 − rr)/R of a sphere and ±(1 − rr − zz)/R of a cylinder, r = ±n the radial direction."""
        quadric, found = self.quadric, np.zeros((len(points), 3, 3))
        if quadric.kind == "plane":
            return found
        radial = points - quadric.centre
        found[:] = np.eye(3)
        if quadric.kind == "cylinder":
            axis = quadric.axes[2]
            radial = radial - (radial @ axis)[:, None] * axis
            found -= np.outer(axis, axis)
        with np.errstate(invalid="ignore"):
            radial /= np.linalg.norm(radial, axis=1, keepdims=True)
            found -= radial[:, :, None] * radial[:, None]
            found *= (np.sign(np.einsum("ij,ij->i", radial, normals)) / quadric.radius_mm)[:, None, None]
        return found

    @cached_property
    def arrays(self) -> QuadricArrays:
        """The face as the kernels take it."""
        quadric, trimming = self.quadric, self.trimming
        return QuadricArrays(KINDS[quadric.kind], quadric.radius_mm, quadric.centre, quadric.axes,
                             self.sign * float(np.sign(np.linalg.det(quadric.axes))), self.one_sided, *trimming.box[:2],
                             trimming.strips)


def first_of_quadrics(faces: tuple[QuadricFace, ...], tree: Quadrics | None, rays: Rays, out: Trace) -> None:
    """Find what rays meet first of some quadrics, by the tree of many or one by one.

    Parameters
    ----------
    faces : one or more.
    tree : of them; None for a few.
    rays : n rays.
    out : what is written; results are new.
    """
    origins, directions, results = rays.origins.ravel(), rays.directions, out.flat
    finite: Mask = np.asarray(np.isfinite(rays.origins).all(axis=1))

    def work(i: int, j: int) -> None:
        units, valid = np.empty((j - i, 3)), np.empty(j - i, dtype=np.bool_)
        unit_directions(directions[i:j], units, valid)
        valid &= finite if len(finite) == 1 else finite[i:j]
        given = (origins if origins.size == 3 else origins[3 * i:3 * j], units.ravel(), valid, results.of_rays(i, j))
        if tree is not None:
            meet_first(tree, np.empty(NODES, dtype=np.int64), np.empty(NODES), *given)
            return
        for number, face in enumerate(faces):
            meet(face.arrays, number == 0, *given)

    parallel_for(work, len(rays))


def quadrics_of(faces: tuple[QuadricFace, ...]) -> Quadrics:
    """Put faces into a tree, as the kernels take them.

    Parameters
    ----------
    faces : one or more.

    Returns
    -------
    Quadrics
    """
    tree, order = tree_of(np.array([_box(face) for face in faces]), 1)
    taken = [faces[k].arrays for k in order]
    strips = np.cumsum([0, *(len(each.strips.interior) for each in taken)])
    ends = np.cumsum([0, *(len(each.strips.edges) for each in taken)])
    counts = np.array([[each.kind, int(each.one_sided), strips[k], strips[k + 1], ends[k], ends[k + 1]]
                       for k, each in enumerate(taken)], dtype=np.int64)
    sizes = np.array([[each.radius, each.outward, each.strips.low, each.strips.inverse_height, each.u_low, each.u_high,
                       *each.centre, *each.axes.ravel()] for each in taken])
    first, edges, interior = (np.concatenate([getattr(each.strips, name) for each in taken])
                              for name in ("first", "edges", "interior"))
    return Quadrics(tree, counts, sizes, first, edges, interior)


def _box(surface: QuadricFace) -> Array:
    """Lows and highs in x, y, z of what lies between the ends of its loops in u and v."""
    quadric, (u_min, u_max, v_min, v_max) = surface.quadric, surface.trimming.box
    u, v = np.array([u_min, u_max]), np.array([v_min, v_max])
    if quadric.kind == "cylinder":
        u = _with_extremes(u_min, u_max, quadric.axes[0], quadric.axes[1])
    if quadric.kind == "sphere":
        # Where a coordinate is largest along v depends on u: the whole sphere's box is near enough.
        reach = quadric.radius_mm + BOX_MARGIN * (quadric.radius_mm + float(np.abs(quadric.centre).max()))
        return np.concatenate([quadric.centre - reach, quadric.centre + reach])
    points = quadric.evaluate(*(grid.ravel() for grid in np.meshgrid(u, v)))
    margin = BOX_MARGIN * float(np.abs(points).max())
    return np.concatenate([points.min(axis=0) - margin, points.max(axis=0) + margin])


def _with_extremes(low: float, high: float, x: Array, y: Array) -> Array:
    """The ends of an interval of angles, and those angles in it where a coordinate of cos u·X + sin u·Y is extreme."""
    turns = np.arange(np.floor(low / np.pi) - 1.0, np.ceil(high / np.pi) + 1.0) * np.pi
    extremes = (np.arctan2(y, x)[:, None] + turns).ravel()
    return np.concatenate([[low, high], extremes[(extremes > low) & (extremes < high)]])
