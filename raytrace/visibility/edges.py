"""The edges of what several eyes see reflecting, asked together: the two eyes' of a mirror, or those of its turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels import image_points as nearest_kernel
from raytrace.kernels import sign_changes as signs
from raytrace.kernels.eye_rays import Posed, rays_to, trace
from raytrace.kernels.sheet import Sheet, surface_points
from raytrace.kernels.sheet_rim import Rim, rim_points, rim_roots
from raytrace.rays import Status
from raytrace.roots import SETTLED
from raytrace.viewing.view import Mask
from raytrace.visibility.edge import Edge
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


@dataclass(frozen=True, eq=False)
class Edges:
    """Edges that are asked together, m of them.

    Where all are those of one bare sheet, which several eyes look into or which is turned, one call finds the rays of all; else
    each is asked by itself.
    In what is asked of them, `of` (n,) says whose edge each row is about.
    """

    edges: tuple[Edge, ...]

    @staticmethod
    def of(edges: Sequence[Edge]) -> Edges:
        """Raises: ValueError without any."""
        if not edges:
            raise ValueError("there is no edge to be asked")
        return Edges(tuple(edges))

    def __len__(self) -> int:
        return len(self.edges)

    @cached_property
    def sheet_rim(self) -> tuple[Sheet, Rim] | None:
        """The sheet and the rim that all share, of which no search is made; None for one edge, which knows itself."""
        first = self.edges[0]
        shared = len(self.edges) > 1 and first.sheet_rim is not None and all(
            one.sheet_rim is not None and one.sheet_rim[0] is first.sheet_rim[0] and one.of.reflector is first.of.reflector
            for one in self.edges)
        return first.sheet_rim if shared and first.of.reflector.obstacles is None else None

    @cached_property
    def posed(self) -> Posed:
        """Their eyes and poses."""
        views = [one.view for one in self.edges]
        return Posed(np.stack([view.eye_in_mirror for view in views]), np.stack([view.pose.rotation for view in views]),
                     np.stack([view.pose.offset for view in views]))

    @cached_property
    def show_more_than_half(self) -> Mask:
        """Whether each may show directions that are opposite to each other, (m,)."""
        if self.sheet_rim is None:
            return np.array([len(one.on_plane) > 0 and one.shows_more_than_half(one.middle()) for one in self.edges])
        centres = np.stack([one.extent[0] for one in self.edges])
        status, _, directions, _ = trace(self.sheet_rim[0], self.posed, centres, np.arange(len(self.edges)))
        return np.array([one.shows_more_than_half(one.middle_of(status[j] == Status.REFLECTED, directions[j]))
                         for j, one in enumerate(self.edges)])

    def settle(self, of: Index, k: Index, function: RayFunction) -> tuple[Array, Array, Array]:
        """Find where functions of rays (n,) vanish between vertices k (n,) and the following ones.

        Returns
        -------
        Places (n, 2) of the picture plane; points and unit directions (n, 3) of the rays, in vehicle coordinates.
        """
        points, directions, after, after_directions = (np.empty((len(k), 3)) for _ in range(4))
        for j, rows in self._rows(of):
            edge, here = self.edges[j], k[rows]
            following = edge.following[here]
            points[rows], directions[rows] = edge.points[here], edge.directions[here]
            after[rows], after_directions[rows] = edge.points[following], edge.directions[following]
        at_low, at_high = function(points, directions), function(after, after_directions)
        if self.sheet_rim is not None and len(k):
            sheet, rim = self.sheet_rim
            share = rim_roots(sheet, rim, self.posed, function.coefficients, k, np.zeros(len(k)), np.ones(len(k)),
                                       at_low, at_high, SETTLED, of)
            if share is not None:
                surface = surface_points(sheet, rim_points(rim, k, share))
                direct = rays_to(sheet, self.posed, surface, of)
                if direct is not None:
                    return direct
        on_plane = np.empty((len(k), 2))
        for j, rows in self._rows(of):
            on_plane[rows], traced = self.edges[j].settle(k[rows], at_low[rows], at_high[rows], function.some(rows))
            points[rows], directions[rows] = traced.points, traced.directions
        return on_plane, points, directions

    def crossings(self, function: RayFunction) -> tuple[Index, Array, Array, Array]:
        """Find where a function changes its sign along each edge: on which, and as `settle`."""
        of, k = [], []
        for j, edge in enumerate(self.edges):
            if len(edge.on_plane) == 0:
                continue
            now = function(edge.points, edge.directions)
            crossed, may_turn = signs.along_loops(now, edge.on_plane, edge.following, NEAR_ZERO, BESIDE_CELL)
            if may_turn.size:  # it may cross twice between two vertices: each by itself
                return self._crossings_apart(function)
            of.append(np.full(len(crossed), j))
            k.append(crossed)
        owner = np.concatenate([np.zeros(0, dtype=np.intp), *of])
        return owner, *self.settle(owner, np.concatenate([np.zeros(0, dtype=np.intp), *k]), function)

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
            trimmed = self.edges[0].of.reflector.surface.sheet
            assert trimmed is not None
            inside[index] = trimmed.strips.contain(*leaving[index, :2].T)
            return on_plane, inside
        for j, rows in self._rows(of):
            on_plane[rows], inside[rows] = self.edges[j].image_points(targets[rows])
        return on_plane, inside

    def follow_image_points(self, of: Index, starts: Array, targets: Array) -> tuple[Array, Array]:
        """`raytrace.visibility.image_points.follow_image_points` of points (n, 3), mm."""
        if self.sheet_rim is not None:
            at, leaving, passes = self._solved(of, starts, targets, MAX_FOLLOWING_STEPS)
            lost = ~(passes < FOLLOWED_BY)
            at[lost], leaving[lost] = np.nan, np.nan
            return at, np.einsum("nij,nj->ni", self.posed.rotations[of], leaving) + self.posed.offsets[of]
        on_plane, points = np.empty((len(of), 2)), np.empty((len(of), 3))
        for j, rows in self._rows(of):
            on_plane[rows], points[rows] = follow_image_points(self.edges[j].view, starts[rows], targets[rows])
        return on_plane, points

    def _solved(self, of: Index, starts: Array, targets: Array, max_steps: int) -> tuple[Array, Array, Array]:
        assert self.sheet_rim is not None
        wanted = np.einsum("nji,nj->ni", self.posed.rotations[of], targets - self.posed.offsets[of])
        box = self.edges[0].of.box
        return solve_on_sheet(self.sheet_rim[0], self.posed.eyes, of, starts, wanted, False, max_steps, box[1] - box[0])

    def _starts(self, of: Index, targets: Array) -> Array | None:
        """The points of a grid whose rays pass nearest to targets; None where each edge is to be asked by itself."""
        if self.sheet_rim is None or len(of) == 0:
            return None
        view = self.edges[0].of.untrimmed
        surface = grid_on_sheet(view.reflector.surface, self.edges[0].of.box)
        asked, owner = np.unique(of, return_inverse=True)
        n = len(surface)
        found = rays_to(self.sheet_rim[0], self.posed, np.tile(surface, (len(asked), 1)), np.repeat(asked, n))
        if found is None:
            return None
        starts, points, directions = found
        index = np.empty(len(of), dtype=np.intp)
        for j in range(len(asked)):
            rows, part = np.flatnonzero(owner == j), slice(j * n, (j + 1) * n)
            nearest = np.empty(len(rows), dtype=np.intp)
            nearest_kernel.nearest_rays(targets[rows], False, points[part], directions[part], nearest)
            index[rows] = nearest + j * n
        return starts[index]

    def _rows(self, of: Index) -> list[tuple[int, Index]]:
        """The edges that are asked, each with its rows."""
        if len(self.edges) == 1:
            return [(0, np.arange(len(of)))]
        return [(int(j), np.flatnonzero(of == j)) for j in np.unique(of)]
