"""A plane, sphere or cylinder face: rays are met in closed form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from mirror_cad.surfaces.quadric import Quadric
from raytrace.kernels import newton
from raytrace.parallel import parallel_for
from raytrace.rays import Mask, Rays, Trace
from raytrace.surfaces.base import BoundedFace, RigidMotion, with_trimming_of
from raytrace.surfaces.pieces import BOX_MARGIN, tree_of
from raytrace.surfaces.rim import Curve, rim_of
from raytrace.surfaces.trimming import STRIPS, Trimming

Array = NDArray[np.float64]

TURN = 2.0 * np.pi
SEAM = 1e-9  # radians beside a seam or pole; loops of other programs miss these by 1e-12 and more
# Edges that run along u crowd into few strips: where rays are looked at one by one, narrow ones are worth their memory.
MAX_STRIPS = 1 << 16
EQUATOR = 256  # points on it
FEW = 8  # quadrics that are looked at one by one sooner than by their tree
NODES = 128  # of the tree that wait; it is less deep than that
PLANE, SPHERE, CYLINDER = range(3)
KINDS = {"plane": PLANE, "sphere": SPHERE, "cylinder": CYLINDER}
# As numbers of this file: numba's cache does not notice a change in another one (newton.py keeps them as well).
REFLECTED, MISSED, BEHIND, INVALID, NEAREST_MM = newton.HIT, newton.OUTSIDE, newton.BEHIND, newton.INVALID, newton.NEAREST_MM


@dataclass(frozen=True, eq=False)
class QuadricFace(BoundedFace):
    """A quadric inside trimming loops (closed polygons in its (u, v), even-odd), S_u × S_v times `sign` outward.

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

    @cached_property
    def rim(self) -> tuple[Curve, ...]:
        """The curves that bound it."""
        return rim_of(self.quadric.evaluate, self.loops)

    def outline(self) -> Array:
        """Points (n, 3), mm, of its rim, and of a sphere where it bulges beyond that: between which it lies in x, y and z."""
        return self._outline

    @cached_property
    def _outline(self) -> Array:
        points, quadric = [curve.points for curve in self.rim], self.quadric
        if quadric.kind == "sphere":
            angle = np.linspace(0.0, TURN, EQUATOR, endpoint=False)
            ways = np.concatenate([np.stack([np.cos(angle), np.sin(angle), np.zeros(EQUATOR)], axis=1),
                                   [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
            x, y, z = quadric.axes @ ways.T
            u, v = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
            inside = [_on_face(SPHERE, *self.trimming.arguments, self.trimming.interior_spans, *self.trimming.box[:2], *place)
                      for place in zip(u, v, strict=True)]
            points.append(quadric.centre + quadric.radius_mm * ways[inside])
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

    @cached_property
    def _outward(self) -> float:
        """1 or −1: whether the outer side is the quadric's own."""
        return self.sign * float(np.sign(np.linalg.det(self.quadric.axes)))

    # --- what is asked of any optical surface -------------------------------------------------------------------------

    @property
    def parameter_limits(self) -> tuple[Array, Array]:
        """None: a quadric has no ends of its own."""
        return np.full(2, -np.inf), np.full(2, np.inf)

    def moved(self, motion: RigidMotion) -> QuadricFace:
        q = self.quadric
        turned = Quadric(q.kind, motion.to_mirror(q.centre), q.axes @ motion.rotation.T, q.radius_mm)
        sign = self.sign if motion.hand == "left" else -self.sign  # S_u × S_v of the reflection points to the other side
        return with_trimming_of(self, replace(self, quadric=turned, sign=sign))

    def two_sided(self) -> QuadricFace:
        return replace(self, one_sided=False)

    def evaluate(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Points (…, 3), mm, at its parameters."""
        return self.quadric.evaluate(u, v)

    def first_hits(self, rays: Rays, out: Trace) -> None:
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

    # --- tracing ------------------------------------------------------------------------------------------------------

    def meet(self, first: bool, origins: Array, units: Array, valid: NDArray[np.bool_], status: NDArray[np.int8], points: Array,
             normals: Array, reflected: Array, distances: Array) -> None:
        """Trace a run of n rays to where they first meet it inside its loops; results are those of `raytrace.reflect`.

        first : whether results are new; else a ray keeps what it has met before, unless it meets this nearer.
        origins (3,) or (3n,), units (3n,) : flat; rays that are not `valid` (n,) become INVALID.
        """
        quadric = self.quadric
        _meet(KINDS[quadric.kind], quadric.radius_mm, quadric.centre, quadric.axes, self._outward, self.one_sided,
              *self.trimming.arguments, self.trimming.interior_spans, *self.trimming.box[:2], first, origins, units, valid,
              status, points, normals, reflected, distances)


def first_of_quadrics(faces: tuple[QuadricFace, ...], tree: Quadrics | None, rays: Rays, out: Trace) -> None:
    """What rays meet first of some quadrics, by the tree of many or one by one; results are new."""
    origins, directions = rays.origins.ravel(), rays.directions
    finite: Mask = np.asarray(np.isfinite(rays.origins).all(axis=1))
    points, normals, reflected = out.points.ravel(), out.normals.ravel(), out.directions.ravel()

    def work(i: int, j: int) -> None:
        units, valid, three = np.empty((j - i, 3)), np.empty(j - i, dtype=np.bool_), slice(3 * i, 3 * j)
        newton.unit_directions(directions[i:j], units, valid)
        valid &= finite if len(finite) == 1 else finite[i:j]
        given = (origins if origins.size == 3 else origins[three], units.ravel(), valid, out.status[i:j], points[three],
                 normals[three], reflected[three], out.distances[i:j])
        if tree is not None:
            tree.meet(*given)
            return
        for number, face in enumerate(faces):
            face.meet(number == 0, *given)

    parallel_for(work, len(rays))


@njit(cache=True, error_model="numpy", _nrt=False)
def _within(first, edges, low, inverse_height, interior, u, v):  # type: ignore[no-untyped-def]
    """Even-odd rule on the trimming polygon, as `newton._inside`, whose changes a cached kernel here would not notice."""
    if not low <= v <= low + (first.size - 1) / inverse_height:
        return False
    strip = int((v - low) * inverse_height)
    if strip >= first.size - 1:
        return False
    if interior[strip, 0] < u < interior[strip, 1]:
        return True
    inside = False
    for k in range(first[strip], first[strip + 1]):
        u0, v0, u1, v1 = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        if (v0 <= v) != (v1 <= v) and u < u0 + (v - v0) * (u1 - u0) / (v1 - v0):
            inside = not inside
    return inside


@njit(cache=True, error_model="numpy", _nrt=False)
def _on_face(kind, first, edges, low, inverse_height, interior, u_low, u_high, u, v):  # type: ignore[no-untyped-def]
    """Whether a place lies inside the loops, whose u may run over several turns."""
    if kind == PLANE:
        return _within(first, edges, low, inverse_height, interior, u, v)
    u = u_low + (u - u_low) % TURN
    # A seam is no edge, nor is a pole: what lies beside it is judged by what lies a little farther beside.
    if u_high - u_low >= TURN - SEAM:
        u = min(max(u, u_low + SEAM), u_low + TURN - SEAM)
    if kind == SPHERE:
        v = min(max(v, -0.5 * np.pi + SEAM), 0.5 * np.pi - SEAM)
    while u <= u_high:
        if _within(first, edges, low, inverse_height, interior, u, v):
            return True
        u += TURN
    return False


@njit(cache=True, error_model="numpy", _nrt=False)
def _roots(kind, radius, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Distances along a ray at which it meets the whole quadric, nearer first, NaN for none; in the quadric's frame.

    For sphere and cylinder the discriminant is taken from the ray's distance q to the centre or axis, (R − q)(R + q): as
    the square of a root's difference it would lose half of the digits where the ray grazes.
    """
    if kind == PLANE:
        return (-oz / dz if dz != 0.0 else np.nan), np.nan
    if kind == CYLINDER:
        oz = dz = 0.0
    squared = dx * dx + dy * dy + dz * dz
    middle = -(ox * dx + oy * dy + oz * dz) / squared
    fx, fy, fz = ox + middle * dx, oy + middle * dy, oz + middle * dz
    foot = np.sqrt(fx * fx + fy * fy + fz * fz)
    half = np.sqrt((radius - foot) * (radius + foot) / squared)
    start = np.sqrt(ox * ox + oy * oy + oz * oz)
    # The root nearer to zero from the product of both: as a difference it would lose digits next to the surface.
    far = middle + half if middle >= 0.0 else middle - half
    near = (start - radius) * (start + radius) / squared / far if far != 0.0 else 0.0
    return min(near, far), max(near, far)


@njit(cache=True, error_model="numpy", _nrt=False)
def _meet_one(kind, radius, centre, axes, outward, one_sided, first_edge, edges, low, inverse_height, interior, u_low,  # type: ignore[no-untyped-def]
              u_high, n, origins, units, status, points, normals, reflected, distances):
    """What ray n meets of one quadric, into its results where it is nearer than what stands there."""
    k = 3 * n
    o = 0 if origins.size == 3 else k
    x_x, x_y, x_z = axes[0, 0], axes[0, 1], axes[0, 2]
    y_x, y_y, y_z = axes[1, 0], axes[1, 1], axes[1, 2]
    z_x, z_y, z_z = axes[2, 0], axes[2, 1], axes[2, 2]
    px, py, pz = origins[o] - centre[0], origins[o + 1] - centre[1], origins[o + 2] - centre[2]
    ex, ey, ez = units[k], units[k + 1], units[k + 2]
    ox, oy, oz = x_x * px + x_y * py + x_z * pz, y_x * px + y_y * py + y_z * pz, z_x * px + z_y * py + z_z * pz
    dx, dy, dz = x_x * ex + x_y * ey + x_z * ez, y_x * ex + y_y * ey + y_z * ez, z_x * ex + z_y * ey + z_z * ez
    nearer, farther = _roots(kind, radius, ox, oy, oz, dx, dy, dz)
    for root in range(2):
        t = nearer if root == 0 else farther
        # A NaN, a ray without this root, passes no comparison; one that has met nothing has met it at NaN.
        if not t > NEAREST_MM or t >= distances[n]:
            continue
        # Brought onto the quadric: place (qx, qy, qz), its outer normal (mx, my, mz), and its parameters.
        qx, qy, qz = ox + t * dx, oy + t * dy, oz + t * dz
        if kind == PLANE:
            mx, my, mz, qz, u, v = 0.0, 0.0, 1.0, 0.0, qx, qy
        elif kind == SPHERE:
            length = np.sqrt(qx * qx + qy * qy + qz * qz)
            mx, my, mz = qx / length, qy / length, qz / length
            u, v = np.arctan2(qy, qx), np.arctan2(qz, np.sqrt(qx * qx + qy * qy))
            qx, qy, qz = radius * mx, radius * my, radius * mz
        else:
            length = np.sqrt(qx * qx + qy * qy)
            mx, my, mz = qx / length, qy / length, 0.0
            u, v = np.arctan2(qy, qx), qz
            qx, qy = radius * mx, radius * my
        if not _on_face(kind, first_edge, edges, low, inverse_height, interior, u_low, u_high, u, v):
            continue
        distances[n] = t
        nx, ny, nz = x_x * mx + y_x * my + z_x * mz, x_y * mx + y_y * my + z_y * mz, x_z * mx + y_z * my + z_z * mz
        along = outward * (ex * nx + ey * ny + ez * nz)
        if one_sided and along >= 0.0:
            status[n] = BEHIND
            for c in range(k, k + 3):
                points[c] = normals[c] = reflected[c] = np.nan
            break
        side = -outward if along > 0.0 else outward
        nx, ny, nz = side * nx, side * ny, side * nz
        twice = 2.0 * abs(along)
        status[n] = REFLECTED
        points[k] = centre[0] + x_x * qx + y_x * qy + z_x * qz
        points[k + 1] = centre[1] + x_y * qx + y_y * qy + z_y * qz
        points[k + 2] = centre[2] + x_z * qx + y_z * qy + z_z * qz
        normals[k], normals[k + 1], normals[k + 2] = nx, ny, nz
        reflected[k], reflected[k + 1], reflected[k + 2] = ex + twice * nx, ey + twice * ny, ez + twice * nz
        break


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def _begin(valid, status, points, normals, reflected, distances):  # type: ignore[no-untyped-def]
    """Results of rays that have met nothing."""
    for n in range(status.size):
        status[n], distances[n] = (MISSED if valid[n] else INVALID), np.nan
        for c in range(3 * n, 3 * n + 3):
            points[c] = normals[c] = reflected[c] = np.nan


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def _meet(kind, radius, centre, axes, outward, one_sided, first_edge, edges, low, inverse_height, interior, u_low,  # type: ignore[no-untyped-def]
          u_high, first, origins, units, valid, status, points, normals, reflected, distances):
    """`QuadricFace.meet`; outward : 1 or −1, whether the quadric's own outer side is that of the face."""
    if first:
        _begin(valid, status, points, normals, reflected, distances)
    for n in range(status.size):
        if valid[n]:
            _meet_one(kind, radius, centre, axes, outward, one_sided, first_edge, edges, low, inverse_height, interior, u_low,
                      u_high, n, origins, units, status, points, normals, reflected, distances)


# --- many of them -----------------------------------------------------------------------------------------------------


class Quadrics(NamedTuple):
    """Many trimmed quadrics, in the order of their tree's leaves, as the kernel takes them.

    tree_boxes, tree_links : see `raytrace.surfaces.pieces.Tree`.   boxes (f, 6) mm.   counts (f, 6) : kind, one_sided, where
    the strips of the trimming begin and end, and its edges.   sizes (f, 18) : radius, outward, the trimming's low, inverse
    height, u_min, u_max, then centre and axes.   first, edges, interior : of the trimmings, one after the other.
    """

    tree_boxes: Array
    tree_links: NDArray[np.int64]
    boxes: Array
    counts: NDArray[np.int64]
    sizes: Array
    first: NDArray[np.int64]
    edges: Array
    interior: Array

    @staticmethod
    def of(surfaces: tuple[QuadricFace, ...]) -> Quadrics:
        """Of one or more."""
        boxes = np.array([_box(surface) for surface in surfaces])
        tree, order = tree_of(boxes, 1)
        taken = [surfaces[k] for k in order]
        strips = np.cumsum([0, *(len(each.trimming.interior_spans) for each in taken)])
        ends = np.cumsum([0, *(len(each.trimming.edges) for each in taken)])
        counts = np.array([[KINDS[each.quadric.kind], int(each.one_sided), strips[k], strips[k + 1], ends[k], ends[k + 1]]
                           for k, each in enumerate(taken)], dtype=np.int64)
        sizes = np.array([[each.quadric.radius_mm, each._outward, *each.trimming.arguments[2:], *each.trimming.box[:2],
                           *each.quadric.centre, *each.quadric.axes.ravel()] for each in taken])
        # Of each trimming without its last number, where the next begins: one array of all has that of the last alone.
        return Quadrics(*tree, boxes[order], counts, sizes, np.concatenate([each.trimming.first for each in taken]),
                        np.concatenate([each.trimming.edges for each in taken]),
                        np.concatenate([each.trimming.interior_spans for each in taken]))

    def meet(self, origins: Array, units: Array, valid: NDArray[np.bool_], status: NDArray[np.int8], points: Array,
             normals: Array, reflected: Array, distances: Array) -> None:
        """`QuadricFace.meet` for the first of all of them; results are new."""
        _meet_tree(*self, np.empty(NODES, dtype=np.int64), np.empty(NODES), origins, units, valid, status, points, normals,
                   reflected, distances)


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


@njit(cache=True, error_model="numpy", _nrt=False)
def _entered(boxes, k, ox, oy, oz, ix, iy, iz, farthest):  # type: ignore[no-untyped-def]
    """Distance at which a ray enters a box, as in first_hit.py; inf where it does not before `farthest`."""
    a, b = (boxes[k, 0] - ox) * ix, (boxes[k, 3] - ox) * ix
    near, far = min(a, b), max(a, b)
    a, b = (boxes[k, 1] - oy) * iy, (boxes[k, 4] - oy) * iy
    near, far = max(near, min(a, b)), min(far, max(a, b))
    a, b = (boxes[k, 2] - oz) * iz, (boxes[k, 5] - oz) * iz
    near, far = max(near, min(a, b)), min(far, max(a, b))
    return near if near <= far and far > 0.0 and near < farthest else np.inf


@njit(cache=True, nogil=True, error_model="numpy", _nrt=False)
def _meet_tree(nodes, links, boxes, counts, sizes, firsts, edges, interior, stack, entries, origins, units, valid,  # type: ignore[no-untyped-def]
               status, points, normals, reflected, distances):
    """`Quadrics.meet`: the nearer of two boxes first, none that begins beyond what has been met."""
    _begin(valid, status, points, normals, reflected, distances)
    for n in range(status.size):
        if not valid[n]:
            continue
        k, o = 3 * n, 0 if origins.size == 3 else 3 * n
        ox, oy, oz = origins[o], origins[o + 1], origins[o + 2]
        ix = 1.0 / (units[k] if abs(units[k]) > 1e-200 else 1e-200)
        iy = 1.0 / (units[k + 1] if abs(units[k + 1]) > 1e-200 else 1e-200)
        iz = 1.0 / (units[k + 2] if abs(units[k + 2]) > 1e-200 else 1e-200)
        stack[0], entries[0] = 0, _entered(nodes, 0, ox, oy, oz, ix, iy, iz, np.inf)
        left = 1 if entries[0] < np.inf else 0
        while left > 0:
            left -= 1
            if entries[left] >= distances[n]:  # never where nothing has been met
                continue
            child, size = links[stack[left], 0], links[stack[left], 1]
            if size > 0:
                for f in range(child, child + size):
                    a, b = counts[f, 2], counts[f, 3]
                    # A trimming has one more first edge than strips, and f of them stand before this one.
                    _meet_one(counts[f, 0], sizes[f, 0], sizes[f, 6:9], sizes[f, 9:18].reshape(3, 3), sizes[f, 1],
                              counts[f, 1] != 0, firsts[a + f:b + f + 1], edges[counts[f, 4]:counts[f, 5]], sizes[f, 2],
                              sizes[f, 3], interior[a:b], sizes[f, 4], sizes[f, 5], n, origins, units, status, points, normals,
                              reflected, distances)
                continue
            farthest = distances[n] if distances[n] < np.inf else np.inf
            one = _entered(nodes, child, ox, oy, oz, ix, iy, iz, farthest)
            other = _entered(nodes, child + 1, ox, oy, oz, ix, iy, iz, farthest)
            nearer = 0 if one <= other else 1
            for turn in range(2):  # the nearer one is taken first, so put last
                which = 1 - nearer if turn == 0 else nearer
                entry = other if which == 1 else one
                if entry < np.inf:
                    stack[left], entries[left] = child + which, entry
                    left += 1
