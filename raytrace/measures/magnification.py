"""A view in, by how much the mirror makes things look smaller at each of its places, across and upright, out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.in_use import MirrorInUse, finite
from raytrace.measures.registry import Measure, register
from raytrace.viewing.view import View
from raytrace.visibility.edge import edge_of
from raytrace.visibility.extremes import Samples, largest

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

# Radians to either side of a ray, 0.01 mm of a mirror at the driver's distance: rounding gives the derivatives 1e-11 of their
# size, the third derivative 1e-9 of what changes over a degree, and where the law of curvature breaks, they are those of the
# one side or the other but for that width.
TURN = 1.5e-5
NEAR, WIDE = np.array([-1.0, 1.0]), np.array([-2.0, -1.0, 1.0, 2.0])  # turns
CREASE = np.radians(60.0)  # between neighbouring reflected rays: normals 30° apart are those of two faces, as in mesh_normals
COLUMNS, ROWS = 41, 61  # of a map
GLASS_STEPS = 3  # from where a ray leaves the glass to what it is seen over: each leaves some hundredth
ON_EDGE = 96  # places of the edge at which the largest and the least are looked for first
COARSE = (13, 19)  # columns and rows of such places inside


@dataclass(frozen=True, eq=False)
class RayDifferentials:
    """How the rays through n places leave when the eye turns a little. Rows of places that show nothing are NaN.

    Both the eye's ray and the one that leaves have a frame across them: to the right as one looks along the ray, level, and
    upward from there. With ω the eye's direction, d the reflected one and P where the ray leaves the mirror:

    jacobian (n, 2, 2) : ∂d/∂ω from the eye's frame to that of d, pure numbers; orthogonal for a flat mirror.
    shift (n, 2, 2) : the part of ∂P/∂ω across d, mm a radian; `path_mm` times an orthogonal matrix where there is no glass.
    path_mm (n,) : from the eye to P, straight.   seen (n,) : whether the mirror shows anything there.
    Source: H. Igehy, Tracing ray differentials (1999); docs/derivations/what-the-eye-sees.md.
    """

    jacobian: Array
    shift: Array
    path_mm: Array
    seen: Mask

    def at(self, distance_mm: float = np.inf) -> Magnification:
        """Magnification of small objects across the ray, `distance_mm` from where it leaves the mirror; far ones by default.

        A far object of extent e (radians) is seen with the extent J⁻¹·e; one of e mm at the distance D with
        (shift + D·J)⁻¹·e. A flat mirror at the same place shows |e|, or |e|/(a + D), a being `path_mm`.
        """
        if np.isinf(distance_mm):
            return Magnification(*_seen_sizes(self.jacobian))
        reach = (self.path_mm + distance_mm)[:, None, None]
        return Magnification(*_seen_sizes((self.shift + distance_mm * self.jacobian) / reach))

    @cached_property
    def widening(self) -> Array:
        """√|det J|, (n,): times as wide, in the mean of its directions, is a narrow cone from the eye once reflected."""
        return np.sqrt(np.abs(_determinant(self.jacobian)))


@dataclass(frozen=True, slots=True, eq=False)
class Magnification:
    """Seen size over the size that a flat mirror at the same place would show; NaN where nothing is shown.

    horizontal, vertical : of small objects that lie level and across the ray, and upright from there.
    area : of the solid angle; its root is the mean of the directions.
    """

    horizontal: Array
    vertical: Array
    area: Array

    @property
    def ratio(self) -> Array:
        """Horizontal over vertical: below 1, things look slimmer than they are."""
        return self.horizontal / self.vertical


@dataclass(frozen=True, slots=True, eq=False)
class MagnificationMap:
    """Magnification over a mirror: at x (columns,) and y (rows,), mm on the surface in mirror coordinates, (rows, columns)
    each; places (rows, columns, 2) are where the eye sees it."""

    x: Array
    y: Array
    places: Array
    magnification: Magnification


def ray_differentials(view: View, places: Array) -> RayDifferentials:
    """Derivatives of the rays through places (n, 2) by the eye's direction, from exact rays beside them.

    Central differences of the second order, which do not overshoot where a law breaks; beside a crease or an edge beyond which
    nothing can be traced, to one side. On a mesh, whatever its normals, they are of the fourth order and those of the smooth
    surface that its vertices lie on, and the turns span two facets, since what is between vertices is right in the mean
    only.
    """
    n = len(places)
    jacobian, shift, path = np.full((n, 2, 2), np.nan), np.full((n, 2, 2), np.nan), np.full(n, np.nan)
    view = view.interpolated
    sight = view.trace_places(places)
    index = np.flatnonzero(sight.seen)
    if index.size:
        towards, resolution = view.towards(places[index]), view.reflector.surface.resolution_mm
        turn = resolution / float(np.linalg.norm(view.eye_in_mirror)) or TURN
        by_ends, by_ways = _by_turns(view, towards, sight.points[index], sight.directions[index], turn, resolution > 0.0)
        across = np.stack(frame(sight.directions[index]), axis=1)
        jacobian[index] = np.einsum("nik,njk->nij", across, by_ways)
        shift[index] = np.einsum("nik,njk->nij", across, by_ends)
        path[index] = np.linalg.norm(sight.points[index] - view.eye, axis=1)
    return RayDifferentials(jacobian, shift, path, sight.seen)


def magnification_map(view: View, distance_mm: float = np.inf, columns: int = COLUMNS, rows: int = ROWS) -> MagnificationMap:
    """`RayDifferentials.at` at the middles of columns × rows equal cells of the mirror's box."""
    x, y, places = mirror_grid(view, columns, rows)
    found = ray_differentials(view, places.reshape(-1, 2)).at(distance_mm)
    shaped = Magnification(*(part.reshape(rows, columns) for part in (found.horizontal, found.vertical, found.area)))
    return MagnificationMap(x, y, places, shaped)


@dataclass(frozen=True, slots=True)
class Extent:
    """From the least to the largest value over a mirror, and where on it, (x, y) in mm."""

    least: float
    largest: float
    least_at_mm: tuple[float, float]
    largest_at_mm: tuple[float, float]


@dataclass(frozen=True, slots=True)
class MagnificationExtremes:
    """The least and the largest magnification of far objects over all that is seen of a mirror, edge included, to 1e-6 of
    them; None where nothing is seen. horizontal, vertical and ratio as in `Magnification`."""

    horizontal: Extent | None
    vertical: Extent | None
    ratio: Extent | None


def magnification_extremes(view: View) -> MagnificationExtremes:
    """Where a mirror shows far things smallest and largest, over what the eye sees reflecting.

    The host vehicle hides nothing here. A mesh stands for the smooth surface that its vertices lie on.
    """
    view = view.interpolated
    edge = edge_of(view)
    rings = edge.rings()

    def samples(curve: Index, place: Array) -> Samples:
        at, looked, on_edge = place.copy(), np.full((len(curve), 2), np.nan), curve >= 0
        inner = np.flatnonzero(~on_edge)
        looked[inner] = view.places_over(*place[inner].T)
        for c, ring in enumerate(rings):
            these = np.flatnonzero(curve == c)
            if these.size:
                looked[these], sight = edge.along(ring, place[these, 0])
                at[these] = sight.on_mirror[:, :2]
        found = ray_differentials(view.untrimmed, looked).at()
        values = np.stack([found.horizontal, found.vertical, found.ratio])
        return Samples(np.concatenate([values, -values]), on_edge | view.trace_places(looked).seen, at)

    x, y, _ = mirror_grid(view, *COARSE)
    found = largest(samples, x, y, np.array([len(ring) for ring in rings], dtype=np.float64), ON_EDGE)
    parts = []
    for k in range(3):
        most, least = float(found.value[k]), -float(found.value[k + 3])
        places = [(float(found.at[j, 0]), float(found.at[j, 1])) for j in (k + 3, k)]
        parts.append(Extent(least, most, *places) if np.isfinite([most, least]).all() else None)
    return MagnificationExtremes(*parts)


def mirror_grid(view: View, columns: int, rows: int) -> tuple[Array, Array, Array]:
    """Middles x (columns,) and y (rows,) of equal cells of the mirror's box, and the places (rows, columns, 2) that the
    eye looks through at them; NaN where the mirror has no surface."""
    x_min, x_max, y_min, y_max = view.box
    x = x_min + (np.arange(columns) + 0.5) * (x_max - x_min) / columns
    y = y_min + (np.arange(rows) + 0.5) * (y_max - y_min) / rows
    at_x, at_y = np.meshgrid(x, y)
    return x, y, view.places_over(at_x.ravel(), at_y.ravel()).reshape(rows, columns, 2)


def surface_under(view: View, places: Array) -> Array:
    """(x, y) of what reflects (n, 2), without glass before it, through which the eye looks at places (n, 2): `places_over`
    the other way round, on the whole sheet."""
    at: Array = view.untrimmed.trace_places(places).on_mirror[:, :2].copy()
    if view.reflector.surface.refracts:  # rays leave by the front, beside where they are reflected
        for _ in range(GLASS_STEPS):
            off = places - view.places_over(*at.T)
            at += np.where(np.isfinite(off), off, 0.0)
    return at


def frame(directions: Array) -> tuple[Array, Array]:
    """To the right, level, and upward, as one looks along unit directions (n, 3): unit, across them, (n, 3) each.

    r = d × Z/|d × Z|, u = r × d; NaN along Z.
    """
    with np.errstate(invalid="ignore"):
        right = np.stack([directions[:, 1], -directions[:, 0], np.zeros(len(directions))], axis=1)
        right /= np.linalg.norm(right, axis=1, keepdims=True)
    return right, np.cross(right, directions)


def _by_turns(view: View, towards: Array, points: Array, directions: Array, turn: float, wide: bool) -> tuple[Array, Array]:
    """Derivatives by a turn of where rays leave and whither, (n, 2, 3) each, from those of the middle rays (n, 3); `wide` ones
    take the fourth order."""
    if wide:
        ends, ways = _beside(view, towards, directions, turn, WIDE)
        return _derivative(ends, points, turn, True), _derivative(ways, directions, turn, True)
    ends, ways = _beside(view, towards, directions, turn, NEAR)
    by_ends, by_ways = ((beside[:, :, 1] - beside[:, :, 0]) / (2.0 * turn) for beside in (ends, ways))
    lacking = np.flatnonzero(~np.isfinite(by_ways).all(axis=(1, 2)))
    if lacking.size:
        ends, ways = _beside(view, towards[lacking], directions[lacking], turn, WIDE)
        by_ends[lacking] = _derivative(ends, points[lacking], turn, False)
        by_ways[lacking] = _derivative(ways, directions[lacking], turn, False)
    return by_ends, by_ways


def _beside(view: View, towards: Array, directions: Array, turn: float, turns: Array) -> tuple[Array, Array]:
    """Where rays leave and whither, (n, 2, k, 3) each: turned rightward and upward by `turns` (k,); NaN beyond a crease."""
    angles = turn * turns
    across = np.stack(frame(towards), axis=1)
    rays = np.cos(angles)[:, None] * towards[:, None, None] + np.sin(angles)[:, None] * across[:, :, None]
    rays = view.pose.directions_to_mirror(rays.reshape(-1, 3))
    eye = view.eye_in_mirror
    with np.errstate(divide="ignore", invalid="ignore"):
        places = np.where(rays[:, 2:] < 0.0, eye[:2] - rays[:, :2] * (eye[2] / rays[:, 2:]), np.nan)
    sight = view.untrimmed.trace_places(places)
    ends, ways = (one.reshape(-1, 2, len(turns), 3) for one in (sight.points, sight.directions))
    beyond = np.einsum("nijk,nk->nij", ways, directions) < np.cos(CREASE)
    ends[beyond] = ways[beyond] = np.nan
    return ends, ways


def _derivative(beside: Array, middle: Array, turn: float, wide: bool) -> Array:
    """Derivative by a turn, (n, 2, 3), of what is `beside` (n, 2, 4, 3) at −2, −1, 1, 2 turns and in the middle (n, 3); `wide`
    turns take the fourth order."""
    a, b, c, d = np.moveaxis(beside, 2, 0)
    m = middle[:, None]
    near = (c - b) / (2.0 * turn)
    found = (8.0 * (c - b) - (d - a)) / (12.0 * turn) if wide else near
    for other in (near, (4.0 * c - 3.0 * m - d) / (2.0 * turn), (3.0 * m - 4.0 * b + a) / (2.0 * turn)):
        found = np.where(np.isnan(found), other, found)
    return found


def _determinant(matrix: Array) -> Array:
    result: Array = matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0]
    return result


def _seen_sizes(matrix: Array) -> tuple[Array, Array, Array]:
    """Lengths of A⁻¹·(1, 0) and A⁻¹·(0, 1), and 1/|det A|, of matrices A (n, 2, 2)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        area = 1.0 / np.abs(_determinant(matrix))
        return np.hypot(matrix[:, 1, 1], matrix[:, 1, 0]) * area, np.hypot(matrix[:, 0, 1], matrix[:, 0, 0]) * area, area


def map_in_use(use: MirrorInUse) -> MagnificationMap:
    """`magnification_map` of far things, from between the eyes of a mirror in use."""
    return magnification_map(use.on_vehicle.views.middle)


def _middle(values: Array, found: MagnificationMap) -> float | None:
    return finite(values[int(np.argmin(np.abs(found.y))), int(np.argmin(np.abs(found.x)))])


def extremes_in_use(use: MirrorInUse) -> MagnificationExtremes:
    """`magnification_extremes` from between the eyes of a mirror in use."""
    return magnification_extremes(use.on_vehicle.views.middle)


def _least(extent: Extent | None) -> float | None:
    return None if extent is None else finite(extent.least)


register(Measure("magnification_middle", "horizontal magnification, middle", "", 3,
                 "seen size of a far, level object over that in a flat mirror at the same place",
                 lambda use: _middle(use.record(map_in_use).magnification.horizontal, use.record(map_in_use)), group="Size",
                 better="more", local=True))
register(Measure("magnification_least", "horizontal magnification, least", "", 3, "over the mirror",
                 lambda use: _least(use.record(extremes_in_use).horizontal), group="Size", better="more", local=True))
register(Measure("magnification_vertical_middle", "vertical magnification, middle", "", 3, "the same of an upright object",
                 lambda use: _middle(use.record(map_in_use).magnification.vertical, use.record(map_in_use)), group="Size",
                 better="more", local=True))
register(Measure("magnification_ratio_least", "horizontal over vertical, least", "", 3, "below 1 things look too slim",
                 lambda use: _least(use.record(extremes_in_use).ratio), group="Size", better="more", local=True))
