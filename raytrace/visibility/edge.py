"""The edge of what an eye sees reflecting, and where lines of the world cross it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels import loops as kernel_loops
from raytrace.kernels import sign_changes as kernel
from raytrace.kernels.eye_rays import rays_to
from raytrace.kernels.sheet import Sheet, surface_points
from raytrace.kernels.sheet_rim import Rim, rim_points, rim_roots, values
from raytrace.rays import Status
from raytrace.reflector import Reflector
from raytrace.roots import SETTLED, roots
from raytrace.surfaces.base import BoundedFace
from raytrace.surfaces.rim import AROUND, Evaluate
from raytrace.trace import OBSTACLE_MARGIN_MM, reflect
from raytrace.viewing.view import Mask, TracedRays, View
from raytrace.visibility.image_points import image_points
from raytrace.visibility.sign_changes import BESIDE_CELL, NEAR_ZERO, lowest

Array = NDArray[np.float64]
Index = NDArray[np.intp]

CORNER = 0.1  # radians between two pieces of a rim
LEAST = 16  # vertices on the smallest curve
SAME_PLACE_MM = 1e-6  # a ray to a vertex of the outline meets it, and not another part of the sheet before it
GRID_SHAPE = (113, 149)  # places across and up, where the edge is not known and has to be looked for: some 2.5 mm apart
BESIDE = 0.1  # of the width and height of what is known of the outline: where it bulges
REFINED = 1  # times: each halves the distance
SPLIT, ROUNDS = 4, 14  # parts of their distance, one of which is left each time: 2e-8 mm in the end
RIM = 0.5  # the cosine of the turn against the mirror's z from which a face is a rim: mirrors slope by less than 60°


@dataclass(frozen=True, slots=True, eq=False)
class RayFunction:
    """Functions f0 + f1..3·q + f4..6·d + f7..9·(q × d) of rays from q along unit d.

    Whatever says on which side of a point, a line or a plane a ray passes is one of them.
    coefficients (1, 10), or (n, 10) for n rays.
    """

    coefficients: Array

    @staticmethod
    def of(constant: Array | float = 0.0, point: Array | None = None, direction: Array | None = None,
           moment: Array | None = None) -> RayFunction:
        """By f0, f1..3, f4..6 and f7..9: (3,) or (n, 3); 0 where left out."""
        parts = [np.atleast_2d(np.asarray(constant, dtype=np.float64).reshape(-1, 1)),
                 *(np.zeros((1, 3)) if part is None else np.atleast_2d(part) for part in (point, direction, moment))]
        n = next((len(part) for part in parts if len(part) != 1), 1)
        return RayFunction(np.concatenate([np.broadcast_to(part, (n, part.shape[1])) for part in parts], axis=1))

    def some(self, rows: Index) -> RayFunction:
        """Those of some rays, where there is one a ray."""
        return self if len(self.coefficients) == 1 else RayFunction(self.coefficients[rows])

    def __call__(self, points: Array, directions: Array) -> Array:
        """Values (n,) of rays from points (n, 3) along directions (n, 3)."""
        found = np.empty(len(points))
        values(self.coefficients, points, directions, found)
        return found


LEVEL = RayFunction.of(direction=np.array([0.0, 0.0, 1.0]))  # above 0 for rays that rise


@dataclass(frozen=True, eq=False)
class Edge:
    """Closed loops of points at which the eye sees the mirror's edge, and what the rays through them do.

    Where one face without glass is all that the eye sees reflecting, and it sees all of it, the edge is its rim. For glass,
    several faces and meshes, where the face turns away from the eye, and where something stands before the mirror, it is
    looked for: vertices some 0.6 mm apart and the points half way between are right to 1e-9 of the mirror's width, and
    parabolas join them.

    Attributes
    ----------
    of : the view that it is the edge of.
    view : is asked for rays through the edge: the view of the whole sheet where there is one, which goes on there.
    beyond : whether there is one.
    rim : whether it is that of a face, or was looked for.
    on_plane : (n, 2), mm, of the picture plane: the vertices.
    points, directions : (n, 3), mm and unit, in vehicle coordinates: where the rays through the vertices leave the mirror, and
        in which direction.
    following : (n,), the index of the next vertex of the same loop; what reflects lies on one side.
    at_share : points (m, 2) of the edge, mm, at shares (m,) of the way from vertices (m,) to the next.
    sheet_rim : the sheet and its rim, where it is that of one sheet z(x, y), of whose rays no search is made; else None.
    """

    of: View
    view: View
    beyond: bool
    rim: bool
    on_plane: Array
    points: Array
    directions: Array
    following: Index
    at_share: Callable[[Index, Array], Array]
    sheet_rim: tuple[Sheet, Rim] | None = None

    def between(self, k: Index, t: Array) -> tuple[Array, TracedRays]:
        """Trace rays through points of the edge between its vertices.

        Parameters
        ----------
        k : (m,), vertices.
        t : (m,), shares of the way from each to the next one.

        Returns
        -------
        on_plane : (m, 2), mm, of the picture plane.
        traced : what the rays there do. Where an edge that was looked for is hollow, on a straight way between the rays of its
            vertices.
        """
        if self.sheet_rim is not None:
            sheet, rim = self.sheet_rim
            surface = surface_points(sheet, rim_points(rim, k, t))
            direct = rays_to(sheet, self.view.posed, surface)
            if direct is not None:
                return direct[0], TracedRays(np.zeros(len(k), dtype=np.int8), *direct[1:], surface[:, :3])
        on_plane = self.at_share(k, t)
        traced = self.view.trace_points(on_plane)
        lost = ~(traced.seen if self.beyond else _shows(self.view, on_plane, traced))
        if not lost.any():
            return on_plane, traced
        # Where an edge that was looked for is hollow: a straight way between the rays of its vertices.
        after, share = self.following[k], t[:, None]
        points, directions = (one[k] + share * (one[after] - one[k]) for one in (self.points, self.directions))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        points = np.where(lost[:, None], points, traced.points)
        return on_plane, TracedRays(np.zeros(len(lost), dtype=np.int8), points,
                                  np.where(lost[:, None], directions, traced.directions),
                             self.view.pose.to_mirror(points))

    def rings(self) -> tuple[Index, ...]:
        """The vertices of each of the loops, in their order."""
        order, ends = kernel_loops.loops(self.following)
        return tuple(np.split(order, ends))

    def along(self, ring: Index, place: Array) -> tuple[Array, TracedRays]:
        """`between` at points (m,) of one of the `rings`, counted in vertices, round and round."""
        along = np.mod(place, len(ring))
        k = np.minimum(along.astype(np.intp), len(ring) - 1)
        return self.between(ring[k], along - k)

    def image_points(self, targets: Array, at_infinity: bool = False) -> tuple[Array, Mask]:
        """`image_points` of the view that this is the edge of, and whether it encloses them: a solid's rim shows none."""
        on_plane, inside = image_points(self.of, targets, at_infinity)
        if not self.rim:
            inside[inside] = _shows(self.of, on_plane[inside])
        return on_plane, inside

    @cached_property
    def extent(self) -> tuple[Array, Array, Array]:
        """The mean of its places, and from where to where its points reach in X and Y, mm, (2,) each."""
        return kernel_loops.extent(self.on_plane, self.points)

    def middle(self) -> Array:
        """The direction (3,) that is shown about the middle of what the edge encloses; for a hole there, that of the edge."""
        traced = self.view.trace_points(self.extent[0][None])
        return self.middle_of(traced.seen[0], traced.directions[0])

    def middle_of(self, seen: bool, direction: Array) -> Array:
        """`middle`, by whether the eye sees the sheet at `extent[0]`, and what it shows there."""
        found: Array = direction if seen else np.add.reduce(self.directions) / len(self.on_plane)
        return found

    def shows_more_than_half(self, middle: Array) -> bool:
        """Whether directions may be shown that are opposite to each other; `middle` (3,) as the method of that name has it."""
        return bool(kernel_loops.least_along(self.directions, middle) <= 0.0)

    def crossings(self, value: Callable[[Array, Array], Array]) -> tuple[Index, Array, TracedRays]:
        """Find where a function of the rays changes its sign along the edge, on exact rays.

        Also where it does so twice between two vertices, if the parabola through three of them comes near to 0 there.

        Parameters
        ----------
        value : the function: of points (m, 3) and directions (m, 3) of rays that leave the mirror, in vehicle coordinates, to
            (m,).

        Returns
        -------
        k : (m,), the vertices after which it does.
        on_plane : (m, 2), mm, of the picture plane, where it does.
        traced : the rays there.
        """
        now = value(self.points, self.directions)
        after = now[self.following]
        k, may_turn = kernel.along_loops(now, self.on_plane, self.following, NEAR_ZERO, BESIDE_CELL)
        turned, share, there = self._turns(may_turn, now, value)
        if turned.size == 0:
            return k, *self.settle(k, now[k], after[k], value)
        every = np.concatenate([k, turned, turned])
        low = np.concatenate([np.zeros(len(k) + len(turned)), share])
        high = np.concatenate([np.ones(len(k)), share, np.ones(len(turned))])
        return every, *self.settle(every, np.concatenate([now[k], now[turned], there]),
                                   np.concatenate([after[k], there, after[turned]]), value, low, high)

    def _turns(self, k: Index, now: Array, value: Callable[[Array, Array], Array]) -> tuple[Index, Array, Array]:
        """Where a function, `now` (n,) at the vertices, has the other sign after some vertices k than at both.

        After which of them (m,), at which shares of the way to the next, and with which values.
        """
        if k.size == 0:
            return k, np.zeros(0), np.zeros(0)
        sign = np.where(now[k] > 0.0, 1.0, -1.0)

        def height(share: Array) -> Array:
            _, traced = self.between(k, share)
            found: Array = sign * value(traced.points, traced.directions)
            return found

        share, best = lowest(height, len(k))
        crossed = best < 0.0
        return k[crossed], share[crossed], (sign * best)[crossed]

    def settle(self, k: Index, at_low: Array, at_high: Array, value: Callable[[Array, Array], Array],
               low: Array | float = 0.0, high: Array | float = 1.0) -> tuple[Array, TracedRays]:
        """Find where functions of rays vanish between two points of the edge each.

        Parameters
        ----------
        k : (m,), vertices.
        at_low, at_high : (m,), the functions' values at the two points, of opposite signs.
        value : the functions: of points (m, 3) and directions (m, 3) to (m,).
        low, high : (m,), shares of the way from the vertices to the next, at which the points are.

        Returns
        -------
        on_plane : (m, 2), mm, of the picture plane.
        traced : the rays there.
        """
        if isinstance(value, RayFunction) and self.sheet_rim is not None and len(k):
            whole = np.zeros(len(k))
            share = rim_roots(*self.sheet_rim, self.view.posed, value.coefficients, k, whole + low, whole + high,
                                       at_low, at_high, SETTLED)
            if share is not None:
                return self.between(k, share)

        def at(t: Array) -> Array:
            _, traced = self.between(k, low + t * (high - low))
            return value(traced.points, traced.directions)

        return self.between(k, low + roots(at, at_low, at_high) * (high - low))


@lru_cache(maxsize=8)
def edge_of(view: View) -> Edge:
    """Find the edge of what the eye of a view sees reflecting; that of the last views is kept.

    It is the rim of the one face that is seen, where there is one without glass that nothing stands before, and is looked for
    as a contour of visibility else (`visibility_contour`).

    Parameters
    ----------
    view : the mirror as the eye sees it.

    Returns
    -------
    Edge
        Without vertices where the eye sees nothing reflecting.
    """
    face = _shown_face(view)
    rim = None if face is None else _rim(face)
    if face is not None and rim is not None:
        # What is one face already has its sheet at hand.
        whole = view.untrimmed if face is view.reflector.surface else replace(view, reflector=_alone(face).untrimmed)
        sheet = whole.reflector.surface.sheet
        if sheet is not None and not _stands_before(view, rim.points):
            direct = rays_to(sheet, view.posed, _on_sheet(face))
            if direct is not None:
                return Edge(view, whole, True, True, *direct, rim.following, lambda k, t: view.on_plane_of(rim.at(k, t)),
                            (sheet, rim.pieces))
        on_plane = view.on_plane_of(rim.points)
        traced = whole.trace_points(on_plane)
        if traced.seen.all() and np.linalg.norm(traced.on_mirror - rim.points, axis=1).max() < SAME_PLACE_MM \
                and not _stands_before(view, rim.points):
            return Edge(view, whole, True, True, on_plane, traced.points, traced.directions, rim.following,
                        lambda k, t: view.on_plane_of(rim.at(k, t)))
    return visibility_contour(view)


def _shown_face(view: View) -> BoundedFace | None:
    """The face that is all that the eye sees reflecting, with nothing before it; None where there is none."""
    reflector = view.reflector
    faces = reflector.surface.bounding_faces
    if not faces:
        return None
    if len(faces) == 1 and (reflector.obstacles is None or reflector.obstacles_behind):
        return faces[0]
    on_plane = _grid(view).reshape(-1, 2)
    traced = view.trace_points(on_plane)
    shown = np.flatnonzero(_shows(view, on_plane, traced))
    if shown.size == 0:
        return None
    rays = np.concatenate([on_plane, np.zeros((len(on_plane), 1))], axis=1) - view.eye_in_mirror
    for face in faces:
        # One ray first: most of a solid's faces are not the one.
        for asked in (shown[:1], np.arange(len(on_plane))):
            alone = reflect(_alone(face), view.eye_in_mirror, rays[asked])
            seen = alone.status == Status.REFLECTED
            if not np.array_equal(seen, np.isin(asked, shown)):
                break
            if np.linalg.norm(alone.points[seen] - traced.on_mirror[asked[seen]], axis=1).max() > SAME_PLACE_MM:
                break
        else:
            return face
    return None


@lru_cache(maxsize=8)
def _alone(face: BoundedFace) -> Reflector:
    """A face that nothing stands before, with the sheet and the pieces that it is searched in, made once."""
    return Reflector(face)


def _stands_before(view: View, points: Array) -> bool:
    """Whether anything stands between the eye and points (n, 3) of the mirror, which the eye sees on the sheet alone."""
    reflector, eye = view.reflector, view.eye_in_mirror
    alone = len(reflector.surface.bounding_faces) == 1
    if alone and (reflector.obstacle_scene is None or reflector.obstacles_behind):
        return False
    rays = points - eye
    reach = np.linalg.norm(rays, axis=1)
    met = np.full(len(rays), np.inf) if alone \
        else reflect(replace(reflector, obstacles=None), eye, rays).distances
    if reflector.obstacle_scene is not None and not reflector.obstacles_behind:
        origins = np.broadcast_to(eye, rays.shape)
        met = np.fmin(met, reflector.obstacle_scene.first_hits(origins, rays / reach[:, None]).distance)
    return bool((met < reach - OBSTACLE_MARGIN_MM).any())


@dataclass(frozen=True, slots=True, eq=False)
class _Rim:
    """n vertices on the curves that bound a face, points (n, 3), and the pieces of the curves from each to the following one.

    They are `count` pieces from piece `first` on; pieces start (m, 2), end (m, 2) in (u, v).
    """

    evaluate: Evaluate
    start: Array
    end: Array
    first: Index
    count: Index
    points: Array
    following: Index

    @property
    def pieces(self) -> Rim:
        """As the kernels take it."""
        return Rim(self.start, self.end, self.first, self.count)

    def at(self, k: Index, t: Array) -> Array:
        """Points (m, 3) at shares t (m,) of the way from vertices k (m,) to the following ones, piece by piece."""
        along = t * self.count[k]
        piece = np.clip(along.astype(np.intp), 0, self.count[k] - 1)
        share, piece = (along - piece)[:, None], self.first[k] + piece
        return self.evaluate(*(self.start[piece] + share * (self.end[piece] - self.start[piece])).T)


@lru_cache(maxsize=8)
def _rim(face: BoundedFace) -> _Rim | None:
    """The rim of a face with vertices at its corners and AROUND others, evenly spread; None for a face without one."""
    if not face.rim:
        return None
    evaluate: Evaluate = face.evaluate
    low, high = face.parameter_limits
    start, end = (np.clip(np.concatenate([getattr(curve, side) for curve in face.rim]), low, high) for side in ("start", "end"))
    step = sum(float(curve.lengths.sum()) for curve in face.rim) / AROUND
    first, count, following, pieces, vertices = [], [], [], 0, 0
    for curve in face.rim:
        length = curve.lengths
        cell = np.floor((np.cumsum(length) - length) / min(step, float(length.sum()) / LEAST))
        tangents = (np.roll(curve.points, -1, axis=0) - curve.points) / length[:, None]
        bent = np.einsum("ij,ij->i", tangents, np.roll(tangents, 1, axis=0)) < np.cos(CORNER)
        at = np.flatnonzero((cell != np.roll(cell, 1)) | bent | (np.arange(len(length)) == 0))
        first.append(pieces + at)
        count.append(np.diff(np.append(at, len(length))))
        following.append(vertices + np.roll(np.arange(len(at)), -1))
        pieces, vertices = pieces + len(length), vertices + len(at)
    begin = np.concatenate(first)
    return _Rim(evaluate, start, end, begin, np.concatenate(count), evaluate(*start[begin].T), np.concatenate(following))


@lru_cache(maxsize=8)
def _on_sheet(face: BoundedFace) -> Array:
    """The vertices of a face's rim as `raytrace.kernels.sheet.surface_points` has them: the same for every eye."""
    rim, sheet = _rim(face), face.sheet
    assert rim is not None
    assert sheet is not None
    return surface_points(sheet, rim.start[rim.first])


def _grid(view: View) -> Array:
    """Places (GRID_SHAPE, 2) over all that a view may show."""
    seen_at = view.on_plane_of(view.reflector.outline())
    low, high = seen_at.min(axis=0), seen_at.max(axis=0)
    margin = BESIDE * (high - low)
    x, y = (np.linspace(low[c] - margin[c], high[c] + margin[c], GRID_SHAPE[c]) for c in (0, 1))
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=2)


def visibility_contour(view: View) -> Edge:
    """Find the edge as the border of those points of a grid whose rays are reflected, moved to where they cease to be.

    Parameters
    ----------
    view : the mirror as the eye sees it.

    Returns
    -------
    Edge
        Joined by parabolas through points half way between its vertices.
    """
    grid = _grid(view)
    seen = _shows(view, grid.reshape(-1, 2)).reshape(grid.shape[:2])
    seen[[0, -1]] = seen[:, [0, -1]] = False  # a loop closes
    sides, following = _border(seen)
    nodes = grid.reshape(-1, 2)
    on_plane = bisect_visibility(view, nodes[sides[:, 0]], nodes[sides[:, 1]])
    for _ in range(REFINED):
        middles = _middles(view, on_plane, following)
        on_plane, following = (np.concatenate([on_plane, middles]),
                             np.concatenate([len(on_plane) + np.arange(len(on_plane)), following]))
    middles = _middles(view, on_plane, following)

    def at_share(k: Index, t: Array) -> Array:
        after, share = following[k], t[:, None]
        found: Array = ((1.0 - share) * (1.0 - 2.0 * share) * on_plane[k] + 4.0 * share * (1.0 - share) * middles[k]
                        + share * (2.0 * share - 1.0) * on_plane[after])
        return found

    traced = view.trace_points(on_plane)
    beyond = view.reflector.surface.extends
    asked = view.untrimmed if beyond else view
    return Edge(view, asked, beyond, False, on_plane, traced.points, traced.directions, following, at_share)


def _middles(view: View, on_plane: Array, following: Index) -> Array:
    """Places of the edge half way from each to the next, inside lying to the left; on the chord where they are not found."""
    along = on_plane[following] - on_plane
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    middles = on_plane + 0.5 * along
    k = np.flatnonzero(_shows(view, middles + left) & ~_shows(view, middles - left))
    middles[k] = bisect_visibility(view, middles[k] + left[k], middles[k] - left[k])
    return middles


def _border(seen: Mask) -> tuple[Index, Index]:
    """Where a mask on a grid changes: the nodes inside and outside (m, 2) of each side of a cell on which it does.

    And the index (m,) of the next such side round what is inside, which lies to the left. Where two corners of a cell that lie
    across are inside, they are taken to be apart.
    """
    node = np.arange(seen.size).reshape(seen.shape)
    corners = np.stack([node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]], axis=2).reshape(-1, 4)
    inside = seen.ravel()[corners]
    starts, ends = [], []
    for side in range(4):  # a run of corners that are inside begins after this side of the cell, counter-clockwise
        cell = np.flatnonzero(~inside[:, side] & inside[:, (side + 1) % 4])
        last = np.full(len(cell), (side + 1) % 4)
        while (more := inside[cell, (last + 1) % 4]).any():
            last = np.where(more, (last + 1) % 4, last)
        # The border cuts the run off, from behind its last corner to before its first.
        starts.append(np.stack([corners[cell, last], corners[cell, (last + 1) % 4]], axis=1))
        ends.append(np.stack([corners[cell, (side + 1) % 4], corners[cell, side]], axis=1))
    start, end = np.concatenate(starts), np.concatenate(ends)
    name, wanted = start @ [seen.size, 1], end @ [seen.size, 1]
    order = np.argsort(name)
    return start, order[np.searchsorted(name[order], wanted)]


def _shows(view: View, on_plane: Array, traced: TracedRays | None = None) -> Mask:
    """Whether places (m, 2) show a reflection, and not one from a rim: the mirror looks the way that its face is turned."""
    traced = traced or view.trace_points(on_plane)
    normal = traced.directions - view.towards(on_plane)
    with np.errstate(invalid="ignore"):
        towards = view.pose.directions_to_mirror(normal)[:, 2] / np.linalg.norm(normal, axis=1)
        shows: Mask = traced.seen & (towards > RIM)
    return shows


def bisect_visibility(view: View, inside: Array, outside: Array) -> Array:
    """Find the last points that are seen on the way from points that are to others that are not.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    inside, outside : (m, 2), mm, of the picture plane.

    Returns
    -------
    (m, 2), mm, to 4e-9 of the way.
    """
    share = (np.arange(SPLIT + 1) / SPLIT)[:, None]
    row = np.arange(len(inside))
    for _ in range(ROUNDS):
        at = inside[:, None] + share * (outside - inside)[:, None]
        seen = _shows(view, at[:, 1:-1].reshape(-1, 2)).reshape(-1, SPLIT - 1)
        last = np.argmin(np.concatenate([seen, np.zeros((len(seen), 1), dtype=np.bool_)], axis=1), axis=1)
        inside, outside = at[row, last], at[row, last + 1]
    return inside
