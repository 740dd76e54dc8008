"""The edges of what several eyes see reflecting, asked together: the two eyes' of a mirror, or those of its turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels import image_points as nearest_kernel
from raytrace.kernels import loops as kernel_loops
from raytrace.kernels import sign_changes as signs
from raytrace.kernels.eye_rays import Posed, rays_to, trace
from raytrace.kernels.sheet import Sheet, surface_points
from raytrace.kernels.sheet_rim import Rim, rim_points, rim_roots
from raytrace.rays import Status
from raytrace.roots import ROOT_SHARE
from raytrace.viewing.view import Mask, View
from raytrace.visibility.edge import Edge
from raytrace.visibility.edge_of import edge_of, sheet_rim_of
from raytrace.visibility.image_points import (
    FOLLOWED_BY,
    MAX_FOLLOWING_STEPS,
    MAX_STEPS,
    PASSES_BY,
    follow_image_points,
    grid_on_sheet,
    solve_on_sheet,
)
from raytrace.visibility.ray_function import RayFunction
from raytrace.visibility.sign_changes import BESIDE_CELL, NEAR_ZERO

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class _Shared:
    """The edges of several views of one bare sheet: the same n vertices for each, whose rays are worked out when asked for.

    rim, surface (n, 5), following (n,) : as `sheet_rim_of` has them.
    rays : of the edge that was asked last, on the picture plane (n, 2), points and directions (n, 3): one place in memory, as
        fresh memory for all would cost more than to work them out again.   owner : (n,), whose they are.
    seen : (m,), of whom it is known that all of the rim is seen.
    low, high, more_than_half : as `Edges` has them, once they are measured; low and high are NaN before.
    """

    sheet: Sheet
    rim: Rim
    surface: Array
    following: Index
    rays: tuple[Array, Array, Array]
    owner: Index
    seen: Mask
    low: Array
    high: Array
    more_than_half: Mask

    def of(self, posed: Posed, j: int) -> bool:
        """Put the rays of one eye into `rays`; whether it is sure to see all of the rim."""
        self.owner[:] = j
        self.seen[j] = rays_to(self.sheet, posed, self.surface, self.owner, self.rays) is not None
        return bool(self.seen[j])

    def measure(self, posed: Posed, j: int) -> None:
        """Find how far the rays of one eye reach, which are in `rays`."""
        on_plane, points, directions = self.rays
        centre, self.low[j], self.high[j] = kernel_loops.extent(on_plane, points)
        status, _, ahead, _ = trace(self.sheet, posed, centre[None], self.owner[:1])
        middle = ahead[0] if status[0] == Status.REFLECTED else np.add.reduce(directions) / len(directions)
        self.more_than_half[j] = kernel_loops.least_along(directions, middle) <= 0.0


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of what the eyes of m views see reflecting, asked together.

    Where all are those of one bare sheet, which several eyes look into or which is turned, few calls find the rays of all; else
    each is asked by itself.
    In what is asked of them, `of` (n,) says whose edge each row is about.
    """

    views: tuple[View, ...]

    @staticmethod
    def of(views: Sequence[View]) -> Edges:
        """Raises: ValueError without any."""
        if not views:
            raise ValueError("there is no edge to be asked")
        return Edges(tuple(views))

    @staticmethod
    @lru_cache(maxsize=8)  # one measure after the other asks the same edges
    def of_one(edge: Edge) -> Edges:
        """One edge that is there already."""
        found = Edges((edge.of,))
        vars(found)["edges"] = (edge,)
        return found

    def __len__(self) -> int:
        return len(self.views)

    @cached_property
    def edges(self) -> tuple[Edge, ...]:
        """Each by itself."""
        return tuple(edge_of(view) for view in self.views)

    @cached_property
    def posed(self) -> Posed:
        """Their eyes and poses."""
        if len(self) == 1:
            return self.views[0].posed
        return Posed(np.stack([view.eye_in_mirror for view in self.views]),
                     np.stack([view.pose.rotation for view in self.views]),
                     np.stack([view.pose.offset for view in self.views]))

    @cached_property
    def shared(self) -> _Shared | None:
        """What all share, of which no search is made; None for one edge, which knows itself, and where nothing is."""
        shared = self._of_one_sheet
        whole = shared is not None and all(shared.seen[j] or shared.of(self.posed, j) for j in range(len(self)))
        return shared if whole else None

    @cached_property
    def _of_one_sheet(self) -> _Shared | None:
        """What all share if each eye sees all of the rim, which the rays of each tell."""
        first, m = self.views[0].reflector, len(self.views)
        found = sheet_rim_of(first) if m > 1 and all(view.reflector is first for view in self.views) else None
        if found is None:
            return None
        n = len(found[2])
        return _Shared(*found, (np.empty((n, 2)), np.empty((n, 3)), np.empty((n, 3))), np.empty(n, dtype=np.intp),
                       np.zeros(m, dtype=np.bool_), np.full((m, 2), np.nan), np.full((m, 2), np.nan),
                       np.empty(m, dtype=np.bool_))

    def _measured(self) -> _Shared | None:
        """`shared`, with how far the points and directions of each reach."""
        shared = self.shared
        if shared is not None:
            for j in np.flatnonzero(np.isnan(shared.low[:, 0])):
                shared.of(self.posed, int(j))
                shared.measure(self.posed, int(j))
        return shared

    @cached_property
    def reach(self) -> tuple[Array, Array]:
        """From where to where the points of each reach in X and Y, mm, (m, 2) each; ∞ to −∞ where there are none."""
        shared = self._measured()
        if shared is not None:
            return shared.low, shared.high
        return np.stack([one.extent[1] for one in self.edges]), np.stack([one.extent[2] for one in self.edges])

    @cached_property
    def show_more_than_half(self) -> Mask:
        """Whether each may show directions that are opposite to each other, (m,)."""
        shared = self._measured()
        if shared is not None:
            return shared.more_than_half
        return np.array([len(one.on_plane) > 0 and one.shows_more_than_half for one in self.edges])

    def rays(self, j: int) -> tuple[Array, Array, Index]:
        """Points, directions and following vertices of the edge j, as `Edge` has them; until the next is asked for."""
        shared = self._of_one_sheet
        if shared is None or not shared.of(self.posed, j):
            edge = self.edges[j]
            return edge.points, edge.directions, edge.following
        if np.isnan(shared.low[j, 0]):  # who looks at all rays asks how far they reach too, and they are at hand
            shared.measure(self.posed, j)
        return *shared.rays[1:], shared.following

    def settle(self, of: Index, k: Index, function: RayFunction) -> tuple[Array, Array, Array]:
        """Find where functions of rays (n,) vanish between vertices k (n,) and the following ones.

        Returns
        -------
        Points (n, 2) of the picture plane; points and unit directions (n, 3) of the rays, in vehicle coordinates.
        """
        shared = self.shared
        if shared is not None and len(k):
            at_low, at_high = (function(*self._rays_to(shared.surface[at], of)) for at in (k, shared.following[k]))
            share = rim_roots(shared.sheet, shared.rim, self.posed, function.coefficients, k, np.zeros(len(k)),
                              np.ones(len(k)), at_low, at_high, ROOT_SHARE, of)
            if share is not None:
                surface = surface_points(shared.sheet, rim_points(shared.rim, k, share))
                direct = rays_to(shared.sheet, self.posed, surface, of)
                if direct is not None:
                    return direct
        on_plane, points, directions = np.empty((len(k), 2)), np.empty((len(k), 3)), np.empty((len(k), 3))
        for j, rows in self._rows(of):
            edge, here, asked = self.edges[j], k[rows], function.some(rows)
            at_low, at_high = (asked(edge.points[at], edge.directions[at]) for at in (here, edge.following[here]))
            on_plane[rows], traced = edge.settle(here, at_low, at_high, asked)
            points[rows], directions[rows] = traced.points, traced.directions
        return on_plane, points, directions

    def crossings(self, function: RayFunction) -> tuple[Index, Array, Array, Array]:
        """Find where a function changes its sign along each edge: on which, and as `settle`."""
        shared = self._of_one_sheet
        if shared is None:
            return self._crossings_apart(function)
        of, k = [], []
        for j in range(len(self)):
            if not shared.of(self.posed, j):
                return self._crossings_apart(function)
            on_plane, points, directions = shared.rays
            now = function(points, directions)
            crossed, may_turn = signs.along_loops(now, on_plane, shared.following, NEAR_ZERO, BESIDE_CELL)
            if may_turn.size:  # it may cross twice between two vertices: each by itself
                return self._crossings_apart(function)
            of.append(np.full(len(crossed), j))
            k.append(crossed)
        owner = np.concatenate(of)
        return owner, *self.settle(owner, np.concatenate(k), function)

    def _rays_to(self, surface: Array, of: Index) -> tuple[Array, Array]:
        """Points and directions of the rays to vertices of the shared rim, which all see."""
        assert self.shared is not None
        found = rays_to(self.shared.sheet, self.posed, surface, of)
        assert found is not None
        return found[1], found[2]

    def _crossings_apart(self, function: RayFunction) -> tuple[Index, Array, Array, Array]:
        found = [(j, *edge.crossings(function)[1:]) for j, edge in enumerate(self.edges) if len(edge.on_plane)]
        of = np.concatenate([np.zeros(0, dtype=np.intp), *(np.full(len(on_plane), j) for j, on_plane, _ in found)])
        return (of, np.concatenate([np.empty((0, 2)), *(on_plane for _, on_plane, _ in found)]),
                np.concatenate([np.empty((0, 3)), *(traced.points for _, _, traced in found)]),
                np.concatenate([np.empty((0, 3)), *(traced.directions for _, _, traced in found)]))

    def image_points(self, of: Index, targets: Array) -> tuple[Array, Mask]:
        """`Edge.image_points` of points (n, 3), mm."""
        on_plane, inside = np.full((len(of), 2), np.nan), np.zeros(len(of), dtype=np.bool_)
        starts = self._starts(of, targets)
        if starts is not None:
            at, leaving, passes = self._solved(of, starts, targets, MAX_STEPS)
            index = np.flatnonzero(passes <= PASSES_BY)
            on_plane[index] = at[index]
            trimmed = self.views[0].reflector.surface.sheet
            assert trimmed is not None
            inside[index] = trimmed.strips.contain(*leaving[index, :2].T)
            return on_plane, inside
        for j, rows in self._rows(of):
            on_plane[rows], inside[rows] = self.edges[j].image_points(targets[rows])
        return on_plane, inside

    def follow_image_points(self, of: Index, starts: Array, targets: Array) -> tuple[Array, Array]:
        """`raytrace.visibility.image_points.follow_image_points` of points (n, 3), mm."""
        if self.shared is not None:
            at, leaving, passes = self._solved(of, starts, targets, MAX_FOLLOWING_STEPS)
            lost = ~(passes < FOLLOWED_BY)
            at[lost], leaving[lost] = np.nan, np.nan
            return at, np.einsum("nij,nj->ni", self.posed.rotations[of], leaving) + self.posed.offsets[of]
        on_plane, points = np.empty((len(of), 2)), np.empty((len(of), 3))
        for j, rows in self._rows(of):
            on_plane[rows], points[rows] = follow_image_points(self.edges[j].view, starts[rows], targets[rows])
        return on_plane, points

    def _solved(self, of: Index, starts: Array, targets: Array, max_steps: int) -> tuple[Array, Array, Array]:
        assert self.shared is not None
        wanted = np.einsum("nji,nj->ni", self.posed.rotations[of], targets - self.posed.offsets[of])
        box = self.views[0].box
        return solve_on_sheet(self.shared.sheet, self.posed.eyes, of, starts, wanted, False, max_steps, box[1] - box[0])

    def _starts(self, of: Index, targets: Array) -> Array | None:
        """The points of a grid whose rays pass nearest to targets; None where each edge is to be asked by itself."""
        shared, first = self.shared, self.views[0]
        if shared is None or len(of) == 0:
            return None
        surface = grid_on_sheet(first.reflector.untrimmed.surface, first.box)
        starts = np.empty((len(of), 2))
        for j in np.unique(of):
            found = rays_to(shared.sheet, self.posed, surface, np.full(len(surface), j))
            if found is None:
                return None
            rows = np.flatnonzero(of == j)
            nearest = np.empty(len(rows), dtype=np.intp)
            nearest_kernel.nearest_rays(targets[rows], False, *found[1:], nearest)
            starts[rows] = found[0][nearest]
        return starts

    def _rows(self, of: Index) -> list[tuple[int, Index]]:
        """The edges that are asked, each with its rows."""
        if len(self) == 1:
            return [(0, np.arange(len(of)))]
        return [(int(j), np.flatnonzero(of == j)) for j in np.unique(of)]
