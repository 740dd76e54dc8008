"""A view in, the edge of what its eye sees reflecting, and where lines of the world cross it, out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from raytrace.quadrics import TrimmedQuadric
from raytrace.reflector import TrimmedSurface
from raytrace.view import Mask, Sight, View

Array = NDArray[np.float64]
Index = NDArray[np.intp]

LONGEST_MM = 1.0  # between neighbours on an outline
SHORT_MM = 0.1  # below it they are joined straight: what is straight on the sheet is bent as places by 1e-6 mm then
SAME_PLACE_MM = 1e-6  # a ray to a vertex of the outline meets it, and not another part of the sheet before it
LOOKED_AT = (113, 149)  # places across and up, where the edge is not known and has to be looked for: some 2.5 mm apart
BESIDE = 0.1  # of the width and height of what is known of the outline: where it bulges
REFINED = 1  # times: each halves the distance
HALVINGS = 34  # of their distance: 2e-10 mm
RIM = 0.5  # the cosine of the turn against the mirror's z from which a face is a rim: mirrors slope by less than 60°
MOST_STEPS = 80  # halving alone takes 37
SETTLED = 1e-11  # of the bracket: a root that is known to less is found


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """Closed loops of n places at which the eye sees the mirror's edge, and what the rays through them do.

    places (n, 2) : on the picture plane, mm.   following (n,) : the index of the next vertex of the same loop; what reflects
    lies on one side.   middles (n, 2) : places half way to it; a parabola through the three is the edge.   points, directions
    (n, 3) : where the rays through the vertices leave the mirror, and whither, in vehicle coordinates.
    view : is asked for rays through the edge: the view of the whole sheet where there is one (`beyond`), which goes on there.
    Of one face without glass, the edge is the outline that it was cut with. For glass, several faces and meshes, and where
    something stands before the mirror, it is looked for: vertices and middles, some 0.6 mm apart, are right to 1e-9 of the
    mirror's width.
    """

    view: View
    beyond: bool
    places: Array
    middles: Array
    points: Array
    directions: Array
    following: Index

    def between(self, k: Index, t: Array) -> tuple[Array, Sight]:
        """Places (m, 2) of the edge at shares t (m,) of the way from vertex k to the next, and what the rays there do."""
        after, share = self.following[k], t[:, None]
        places = ((1.0 - share) * (1.0 - 2.0 * share) * self.places[k] + 4.0 * share * (1.0 - share) * self.middles[k]
                  + share * (2.0 * share - 1.0) * self.places[after])
        sight = self.view.sight(places)
        lost = np.zeros(len(k), dtype=np.bool_) if self.beyond else ~_shows(self.view, places, sight)
        if not lost.any():
            return places, sight
        # Where an edge that was looked for is hollow: a straight way between the rays of its vertices.
        points, directions = (one[k] + share * (one[after] - one[k]) for one in (self.points, self.directions))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        points = np.where(lost[:, None], points, sight.points)
        return places, Sight(np.ones_like(lost), points, np.where(lost[:, None], directions, sight.directions),
                             self.view.pose.to_mirror(points))

    def crossings(self, value: Callable[[Array, Array], Array]) -> tuple[Index, Array, Sight]:
        """Where a function (points (m, 3), directions (m, 3)) -> (m,) changes its sign along the edge: after which vertices,
        and the places and rays."""
        now = value(self.points, self.directions)
        k = np.flatnonzero((now > 0.0) != (now[self.following] > 0.0))
        return k, *self.settle(k, now[k], now[self.following[k]], value)

    def settle(self, k: Index, at_low: Array, at_high: Array, value: Callable[[Array, Array], Array]) -> tuple[Array, Sight]:
        """Where functions (m,) of rays that have opposite signs at the vertices k (m,) and at the next vanish between."""
        def at(t: Array) -> Array:
            _, sight = self.between(k, t)
            return value(sight.points, sight.directions)

        return self.between(k, roots(at, at_low, at_high))


@lru_cache(maxsize=8)
def edge_of(view: View) -> Edge:
    """The edge of what the eye of a view sees reflecting; that of the last views is kept."""
    reflector = view.reflector
    if len(reflector.surfaces) == 1 and reflector.glass is None and (reflector.obstacles is None or reflector.obstacles_behind):
        points, middles, following = _outline(reflector.surfaces[0])
        places = view.places_of(points)
        sight = view.whole.sight(places)
        if sight.seen.all() and np.linalg.norm(sight.on_mirror - points, axis=1).max() < SAME_PLACE_MM:
            return Edge(view.whole, True, places, view.places_of(middles), sight.points, sight.directions, following)
    return _looked_for(view)


@lru_cache(maxsize=8)
def _outline(face: TrimmedSurface | TrimmedQuadric) -> tuple[Array, Array, Index]:
    """Points of a face's loops (n, 3), no farther apart than LONGEST_MM, those half way to the next of the same loop, and the
    index of that."""
    if isinstance(face, TrimmedSurface):
        u_min, u_max, v_min, v_max = face.surface.domain
        evaluate, domain = face.surface.evaluate, (np.array([u_min, v_min]), np.array([u_max, v_max]))
    else:
        evaluate, domain = face.quadric.evaluate, (np.full(2, -np.inf), np.full(2, np.inf))
    parts, steps, following, total = [], [], [], 0
    for loop in face.loops:
        corners = np.clip(loop, *domain)
        way = np.roll(corners, -1, axis=0) - corners
        at = evaluate(*corners.T)
        length = np.linalg.norm(np.roll(at, -1, axis=0) - at, axis=1)
        count = np.maximum(1, np.ceil(length / LONGEST_MM).astype(np.intp))
        k = np.repeat(np.arange(len(loop)), count)
        t = (np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)) / count[k]
        parts.append(corners[k] + t[:, None] * way[k])
        steps.append(way[k] / count[k, None])
        following.append(total + np.roll(np.arange(len(k)), -1))
        total += len(k)
    places, after = np.concatenate(parts), np.concatenate(following)
    points = evaluate(*places.T)
    middles = 0.5 * (points + points[after])
    long = np.flatnonzero(np.linalg.norm(points[after] - points, axis=1) > SHORT_MM)
    middles[long] = evaluate(*(places + 0.5 * np.concatenate(steps))[long].T)
    return points, middles, after


def _looked_for(view: View) -> Edge:
    """The edge as the border of the places of a grid whose rays are reflected, moved to where they cease to be."""
    seen_at = view.places_of(view.reflector.outline())
    low, high = seen_at.min(axis=0), seen_at.max(axis=0)
    margin = BESIDE * (high - low)
    x, y = (np.linspace(low[c] - margin[c], high[c] + margin[c], LOOKED_AT[c]) for c in (0, 1))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=2)
    seen = _shows(view, grid.reshape(-1, 2)).reshape(grid.shape[:2])
    seen[[0, -1]] = seen[:, [0, -1]] = False  # a loop closes
    sides, following = _border(seen)
    nodes = grid.reshape(-1, 2)
    places = _end_of_sight(view, nodes[sides[:, 0]], nodes[sides[:, 1]])
    for _ in range(REFINED):
        middles = _middles(view, places, following)
        places, following = (np.concatenate([places, middles]),
                             np.concatenate([len(places) + np.arange(len(places)), following]))
    sight = view.sight(places)
    one = len(view.reflector.surfaces) == 1
    return Edge(view.whole if one else view, one, places, _middles(view, places, following), sight.points, sight.directions,
                following)


def _middles(view: View, places: Array, following: Index) -> Array:
    """Places of the edge half way from each to the next, inside lying to the left; on the chord where they are not found."""
    along = places[following] - places
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    middles = places + 0.5 * along
    k = np.flatnonzero(_shows(view, middles + left) & ~_shows(view, middles - left))
    middles[k] = _end_of_sight(view, middles[k] + left[k], middles[k] - left[k])
    return middles


def _border(seen: Mask) -> tuple[Index, Index]:
    """Where a mask on a grid changes: the nodes inside and outside (m, 2) of each side of a cell on which it does, and the
    index of the next such side round what is inside, which lies to the left.

    Where two corners of a cell that lie across are inside, they are taken to be apart.
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


def _shows(view: View, places: Array, sight: Sight | None = None) -> Mask:
    """Whether places (m, 2) show a reflection, and not one from a rim: the mirror looks the way that its face is turned."""
    sight = sight or view.sight(places)
    normal = sight.directions - view.towards(places)
    with np.errstate(invalid="ignore"):
        towards = view.pose.directions_to_mirror(normal)[:, 2] / np.linalg.norm(normal, axis=1)
        shows: Mask = sight.seen & (towards > RIM)
    return shows


def _end_of_sight(view: View, inside: Array, outside: Array) -> Array:
    """The last places (m, 2) that are seen on the way from places inside to such outside."""
    for _ in range(HALVINGS):
        middle = 0.5 * (inside + outside)
        seen = _shows(view, middle)[:, None]
        inside, outside = np.where(seen, middle, inside), np.where(seen, outside, middle)
    return inside


def roots(function: Callable[[Array], Array], at_low: Array, at_high: Array) -> Array:
    """Where functions (m,) -> (m,) vanish between 0 and 1; at_low, at_high (m,) : their values there, of opposite signs.

    A secant first, then inverse quadratic interpolation where three values allow it, halving elsewhere.
    Source: Chandrupatla, A new hybrid quadratic/bisection algorithm for finding the zero of a nonlinear function, Advances in
    Engineering Software 28 (1997).
    """
    here, other = np.zeros_like(at_low), np.ones_like(at_low)
    at_here, at_other = at_low, at_high
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(at_low == at_high, 0.5, at_low / (at_low - at_high))  # a straight line: most are nearly that
    for _ in range(MOST_STEPS):
        there = here + share * (other - here)
        now = function(there)
        beside = (now > 0.0) == (at_here > 0.0)
        third, at_third = np.where(beside, here, other), np.where(beside, at_here, at_other)
        other, at_other = np.where(beside, other, here), np.where(beside, at_other, at_here)
        here, at_here = there, now
        least = np.minimum(0.5, SETTLED / np.maximum(np.abs(other - here), SETTLED))
        if ((least >= 0.5) | (at_here == 0.0)).all():
            break
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = (here - other) / (third - other), (at_here - at_other) / (at_third - at_other)
            quadratic = (at_here / (at_other - at_here) * at_third / (at_other - at_third)
                         + (third - here) / (other - here) * at_here / (at_third - at_here) * at_other / (at_third - at_other))
        share = np.where((y * y < x) & ((1.0 - y) ** 2 < 1.0 - x), np.clip(quadratic, least, 1.0 - least), 0.5)
        share = np.where(at_here == 0.0, 0.0, share)
    return np.where(np.abs(at_here) <= np.abs(at_other), here, other)
