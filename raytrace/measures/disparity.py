"""Binocular disparity: by how many percent a mirror shows things larger to the left eye than to the right one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.in_use import MirrorInUse
from raytrace.measures.registry import Measure, register
from raytrace.viewing.eye_views import EyeViews
from raytrace.viewing.view import Mask, View, mirror_grid
from raytrace.visibility.edge import Edge
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.extremes import Samples, largest
from raytrace.visibility.far_sizes import far_points, far_sizes
from raytrace.visibility.image_points import shown_inside

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Size = Literal["horizontal", "vertical", "area"]

COLUMNS, ROWS = 31, 15  # of the map: what is shown changes along a row
STEP_MM = 0.25  # to either side of a place: where the law of curvature breaks, the rate is that over half a millimetre
ON_EDGE = 72  # places of each eye's edge at which the largest are looked for first
COARSE = (17, 9)  # columns and rows of such places inside


@dataclass(frozen=True, slots=True, eq=False)
class Disparity:
    """Binocular disparity over a mirror: 100·(M_left − M_right)/(½·(M_left + M_right)), percent.

    The largest are the signed values of largest magnitude over all that both eyes and the middle between them see, edge
    included, to 1e-6 of them; None where no far direction is seen by all.

    Attributes
    ----------
    x, y : (columns,) and (rows,), mm, on the surface, where the middle between the eyes sees a far direction.
    on_plane : (rows, columns, 2), mm, of the picture plane, through which it looks.
    percent : (rows, columns), of that direction; NaN where not both eyes see it in the mirror.
    rate_percent_per_mm : (rows, columns), its derivative by x along the mirror's rows, from the map's columns.
    max_percent, max_at_mm : the largest disparity, percent, and (x, y) of it, mm.
    max_rate_percent_per_mm, max_rate_at_mm : the largest derivative by x, percent per mm, and (x, y) of it, mm.
    """

    x: Array
    y: Array
    on_plane: Array
    percent: Array
    rate_percent_per_mm: Array
    max_percent: float | None
    max_at_mm: tuple[float, float] | None
    max_rate_percent_per_mm: float | None
    max_rate_at_mm: tuple[float, float] | None


def disparity(views: EyeViews, size: Size = "horizontal", columns: int = COLUMNS, rows: int = ROWS) -> Disparity:
    """Measure how much larger the left eye sees what is far away than the right eye, each at its own point of the mirror.

    It counts what both eyes see inside the outline; what the host vehicle hides is not looked at. Zero for a flat mirror. A
    mesh stands for the smooth surface that its vertices lie on, and its largest rate is one over some facets.

    Parameters
    ----------
    views : of the left eye, of the middle between the eyes, and of the right eye.
    size : which size of `raytrace.viewing.ray_differentials.Magnification` is compared: horizontal, vertical or area.
    columns, rows : of the map.

    Returns
    -------
    Disparity
        The map and the largest values, which do not hang on the map's cells.

    References
    ----------
    S. M. O'Day, Binocular Disparity in Aspherical Mirrors, SAE 980918 (1998): the percent change of angular image size from one
    eye to the other, its maximum and its maximum rate of change. There it is a share of one eye's size, of targets 2 to 6 m
    away, among which it recommends squares ("area"); here of the mean, which does not prefer an eye, and of far objects, for
    which it is a property of a point of the mirror. 10 % here is 9.5 or 10.5 % there.
    """
    views = EyeViews(views.left.interpolated, views.middle.interpolated, views.right.interpolated)
    x, y, on_plane = mirror_grid(views.middle, columns, rows)
    percent = _of_places(views, on_plane.reshape(-1, 2), size).reshape(rows, columns)
    both_see = _BothSee(views, size)
    coarse_x, coarse_y, _ = mirror_grid(views.middle, *COARSE)
    found = largest(both_see.samples, coarse_x, coarse_y, both_see.lengths, ON_EDGE)
    signed, _, _ = both_see.at(found.curve, found.place, np.ones(len(found.curve), dtype=np.bool_))
    (most, steepest), (at, steepest_at) = np.diagonal(signed).tolist(), [tuple(one) for one in found.at.tolist()]
    known, rated = (bool(one) for one in np.isfinite(found.value))
    return Disparity(x, y, on_plane, percent, _along_rows(percent, x), most if known else None, at if known else None,
                     steepest if rated else None, steepest_at if rated else None)


@dataclass(frozen=True, eq=False)
class _BothSee:
    """What both eyes see inside the outline, and the middle between them too: bounded by the three edges.

    The edge's rings are the curves of `largest`, the left eye's first, with places counted in vertices.
    """

    views: EyeViews
    size: Size

    @cached_property
    def rings(self) -> list[tuple[int, Edge, Index]]:
        """Which view's edge each is, the edge, and its vertices."""
        return [(k, edge, ring) for k, edge in enumerate(edge_of(view) for view in self._three) for ring in edge.rings()]

    @property
    def _three(self) -> tuple[View, View, View]:
        return self.views.left, self.views.middle, self.views.right

    @property
    def lengths(self) -> Array:
        return np.array([len(ring) for _, _, ring in self.rings], dtype=np.float64)

    def samples(self, curve: Index, place: Array, of: Index) -> Samples:
        signed, inside, at = self.at(curve, place, of != 0)
        return Samples(np.abs(signed), inside, at)

    def at(self, curve: Index, place: Array, rated: Mask) -> tuple[Array, Mask, Array]:
        """Disparity and its rate (2, n), whether the place counts, and where it is (n, 2); no rate of what is not `rated`."""
        middle, n = self.views.middle, len(curve)
        at, directions, on_edge_of = np.full((n, 2), np.nan), np.full((n, 3), np.nan), np.full(n, -1)
        seen = np.zeros(n, dtype=np.bool_)
        inner = np.flatnonzero(curve < 0)
        at[inner] = place[inner]
        looked, traced = middle.trace_over(*place[inner].T)
        directions[inner] = traced.directions
        seen[inner] = shown_inside(middle, traced.on_mirror, looked)
        for c, (eye, edge, ring) in enumerate(self.rings):
            these = np.flatnonzero(curve == c)
            if these.size == 0:
                continue
            on_plane, traced = edge.along(ring, place[these, 0])
            directions[these], on_edge_of[these] = traced.directions, eye
            at[these], seen[these] = (middle.surface_under(on_plane), True) if eye == 1 \
                else far_points(middle, traced.directions, traced.on_mirror[:, :2])
        step = middle.reflector.surface.resolution_mm or STEP_MM
        around = np.full((2, n, 3), np.nan)
        beside = np.concatenate([at[rated, 0] - step, at[rated, 0] + step])
        _, traced = middle.trace_over(beside, np.tile(at[rated, 1], 2))
        around[:, rated] = traced.directions.reshape(2, -1, 3)
        (here, before, after), in_left, in_right = _of_directions(self.views, directions, self.size, around, at)
        rate = (after - before) / (2.0 * step)
        for other in ((after - here) / step, (here - before) / step):  # beside what ends there
            rate = np.where(np.isfinite(rate), rate, other)
        inside = seen & (in_left | (on_edge_of == 0)) & (in_right | (on_edge_of == 2))
        return np.stack([here, rate]), inside, at


def _of_places(views: EyeViews, on_plane: Array, size: Size) -> Array:
    """Disparity of the far directions that the middle sees through places (n, 2); NaN where not both eyes see one."""
    result = np.full(len(on_plane), np.nan)
    traced = views.middle.trace_points(on_plane)
    seen = np.flatnonzero(traced.seen)
    (percent,), in_left, in_right = _of_directions(views, traced.directions[seen], size, np.empty((0, len(seen), 3)),
                                                   traced.on_mirror[seen, :2])
    result[seen] = np.where(in_left & in_right, percent, np.nan)
    return result


def _of_directions(views: EyeViews, directions: Array, size: Size, around: Array, near: Array) -> tuple[Array, Mask, Mask]:
    """Disparity of far directions (n, 3) and of some beside each of them (k, n, 3): (1 + k, n).

    NaN where a sheet shows one nowhere; and whether each eye sees the first inside, (n,) each. near (n, 2) : where on the
    surface the middle sees them.
    """
    (left, in_left), (right, in_right) = (far_sizes(view, directions, around, near) for view in (views.left, views.right))
    one, other = getattr(left, size), getattr(right, size)
    return 100.0 * (one - other) / (0.5 * (one + other)), in_left, in_right


def _along_rows(values: Array, x: Array) -> Array:
    """Derivative of values (rows, columns) by x, central; where a neighbour is NaN, towards the other one."""
    beside = np.full((len(values), len(x) + 1), np.nan)
    beside[:, 1:-1] = np.diff(values, axis=1) / np.diff(x)
    before, after = beside[:, :-1], beside[:, 1:]
    return np.where(np.isnan(before), after, np.where(np.isnan(after), before, 0.5 * (before + after)))


def disparity_in_use(use: MirrorInUse) -> Disparity:
    """`disparity` of a mirror in use: horizontal, on the default map."""
    return disparity(use.on_vehicle.views)


register(Measure("disparity_max_percent", "binocular disparity, largest", "%", 2,
                 "largest difference of the horizontal size of a far object between the eyes, of their mean",
                 lambda use: use.record(disparity_in_use).max_percent, group="Two eyes", better="less"))
register(Measure("disparity_max_rate_percent_per_mm", "binocular disparity, largest rate of change", "%/mm", 3,
                 "largest change of the binocular disparity along a row of the mirror, a millimetre",
                 lambda use: use.record(disparity_in_use).max_rate_percent_per_mm, group="Two eyes", better="less"))
