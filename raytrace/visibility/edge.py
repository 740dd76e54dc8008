"""The edge of what an eye sees reflecting, and where lines of the world cross it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels import loops as kernel_loops
from raytrace.kernels import sign_changes as kernel
from raytrace.kernels.eye_rays import rays_to
from raytrace.kernels.sheet import Sheet, surface_points
from raytrace.kernels.sheet_rim import Rim, rim_points, rim_roots
from raytrace.roots import ROOT_SHARE, roots
from raytrace.viewing.view import Mask, TracedRays, View
from raytrace.visibility.image_points import image_points
from raytrace.visibility.ray_function import RayFunction
from raytrace.visibility.shows import shows
from raytrace.visibility.sign_changes import BESIDE_CELL, NEAR_ZERO, lowest

Array = NDArray[np.float64]
Index = NDArray[np.intp]


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
        lost = ~(traced.seen if self.beyond else shows(self.view, on_plane, traced))
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
            inside[inside] = shows(self.of, on_plane[inside])
        return on_plane, inside

    @cached_property
    def extent(self) -> tuple[Array, Array, Array]:
        """The mean of its places, and from where to where its points reach in X and Y, mm, (2,) each."""
        return kernel_loops.extent(self.on_plane, self.points)

    @cached_property
    def middle(self) -> Array:
        """The direction (3,) that is shown about the middle of what the edge encloses; for a hole there, that of the edge."""
        traced = self.view.trace_points(self.extent[0][None])
        found: Array = traced.directions[0] if traced.seen[0] else np.add.reduce(self.directions) / len(self.on_plane)
        return found

    @cached_property
    def shows_more_than_half(self) -> bool:
        """Whether directions may be shown that are opposite to each other."""
        return bool(kernel_loops.least_along(self.directions, self.middle) <= 0.0)

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
                                       at_low, at_high, ROOT_SHARE)
            if share is not None:
                return self.between(k, share)

        def at(t: Array) -> Array:
            _, traced = self.between(k, low + t * (high - low))
            return value(traced.points, traced.directions)

        return self.between(k, low + roots(at, at_low, at_high) * (high - low))
