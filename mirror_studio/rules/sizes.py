"""The outline of what reflects, as seen along the normal at the centre, in; what can be inscribed in it out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SpecError
from raytrace.errors import TraceError
from raytrace.reflector import Reflector
from raytrace.viewing.pose import Pose
from raytrace.viewing.view import View
from raytrace.visibility.edge_of import edge_of

Array = NDArray[np.float64]

SAMPLES = 129  # heights, or abscissae, at which a longest base is looked for at first
FOLLOWED = 4  # of the best of these that are followed
GAPS = 8  # of the longest between edges, of which the first inside counts: of two neighbours one is
CLOSER, ROUNDS = 17, 12  # samples about each, and how often: each round leaves an eighth, 1e-11 of the first step in the end
CIRCLE_GRID, CIRCLE_ROUNDS = 17, 12
FEW_CORNERS = 400  # of a polygon of thousands, that tell where its largest circle may be
KEPT_DECIMALS = 7  # of mm: of some ten thousand corners, rounding to fewer digits than they have leaves all as they were
FAR_MM = 1e8  # from where a mesh is looked at along z: its outline is then seen 1e-6 mm from straight below
POINT_MM2 = 1e-6  # loops of less area bound nothing


@dataclass(frozen=True, slots=True, eq=False)
class Inscribed:
    """A rectangle (x_min, x_max, y_min, y_max), mm, within an outline; of no height or width, a segment."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    @property
    def width(self) -> float:
        """Along x, mm."""
        return self.x_max - self.x_min

    @property
    def height(self) -> float:
        """Along y, mm."""
        return self.y_max - self.y_min


def outline_of(reflector: Reflector) -> Array:
    """The closed polygon (n, 2), mm, in (x, y) of the mirror, that bounds what reflects.

    The rim of a face, to the chords of its loops; of what has no rim, a mesh or several faces, the edge that an eye sees from
    far away along z.

    Raises
    ------
    SpecError
        For a face with holes, or in parts.
    """
    curves = [curve.points[:, :2] for curve in reflector.surface.uncoated().rim]
    if not curves:
        middle = 0.5 * (reflector.bounds[0] + reflector.bounds[1])
        try:
            eye = np.array([middle[0], middle[1], FAR_MM])
            edge = edge_of(View(Reflector(reflector.surface.uncoated()), Pose.identity(), eye))
        except TraceError as error:
            raise TraceError(f"no outline can be found: {error}") from None
        on_mirror = edge.view.pose.to_mirror(edge.points)[:, :2]
        curves = [on_mirror[ring] for ring in edge.rings()]
    curves = [curve for curve in curves if abs(area_of(curve)) > POINT_MM2]
    if not curves:
        raise SpecError("what reflects has no outline: choose a face, or state with --place where the mirror is")
    if len(curves) > 1:
        sizes = ", ".join(f"{abs(area_of(curve)):.0f}" for curve in curves[:4])
        raise SpecError(f"what reflects is bounded by {len(curves)} curves, around {sizes} mm²: a face with holes, or in "
                        "parts. The rules' sizes are those of one whole surface: close its holes")
    return curves[0]


def area_of(polygon: Array) -> float:
    """The signed area of a polygon (n, 2), counter-clockwise positive."""
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


@dataclass(frozen=True, slots=True, eq=False)
class Polygon:
    """A closed polygon by its edges, from (x0, y0) to (x1, y1), (n,) each; slope (n,) : dx/dy, 0 where an edge is level."""

    x0: Array
    y0: Array
    x1: Array
    y1: Array
    slope: Array

    @staticmethod
    def of(corners: Array) -> Polygon:
        """Of corners (n, 2)."""
        (x0, y0), (x1, y1) = corners.T, np.roll(corners, -1, axis=0).T
        slope = np.divide(x1 - x0, y1 - y0, out=np.zeros(len(x0)), where=y1 != y0)
        x0, y0, x1, y1 = (np.ascontiguousarray(each) for each in (x0, y0, x1, y1))
        return Polygon(x0, y0, x1, y1, slope)

    def contains(self, x: float, y: float) -> bool:
        """Whether it holds a point, by the even-odd rule."""
        k = np.flatnonzero((self.y0 <= y) != (self.y1 <= y))
        return bool(np.count_nonzero(x < self.x0[k] + (y - self.y0[k]) * self.slope[k]) % 2)

    def longest_gap(self, y: float, height: float) -> tuple[float, float, float]:
        """The longest piece of x over which it holds all of y to y + height: its length, y, and where it begins."""
        high = y + height
        # Edges that enter the open strip, or cross the line that a strip without height is.
        if height == 0.0:
            k = np.flatnonzero((self.y0 <= y) != (self.y1 <= y))
        else:
            k = np.flatnonzero((np.minimum(self.y0, self.y1) < high) & (np.maximum(self.y0, self.y1) > y))
        if len(k) == 0:
            return 0.0, y, 0.0
        x0, y0, slope = self.x0[k], self.y0[k], self.slope[k]
        level = slope == 0.0
        ends = [np.where(level, x, x0 + slope * (np.clip(at, y, high) - y0)) for x, at in ((x0, y0), (self.x1[k], self.y1[k]))]
        first, last = np.minimum(*ends), np.maximum(*ends)
        order = np.argsort(first, kind="stable")
        first, reach = first[order], np.maximum.accumulate(last[order])
        length = first[1:] - reach[:-1]
        for gap in np.argsort(-length)[:GAPS]:
            # Nothing of the outline is in a gap: it is inside as its middle is.
            if length[gap] > 0.0 and self.contains(float(reach[gap] + 0.5 * length[gap]), y + 0.5 * height):
                return float(length[gap]), y, float(reach[gap])
        return 0.0, y, 0.0


def longest_rectangle(corners: Array, height_mm: float) -> Inscribed | None:
    """Find the longest level rectangle of some height within a polygon (n, 2); None where none has any length.

    At a given lower side the edges leave gaps, exactly; the lower side is looked for at SAMPLES heights, and then closer about
    the best of them.
    """
    return _longest_rectangle(_kept(corners), height_mm)


# A mirror that is bent keeps its outline: what was found of the last ones is there at once, where a slider moves or in a study.
def _kept(corners: Array) -> bytes:
    """What a polygon (n, 2) is known by: its corners to KEPT_DECIMALS, beyond which evaluating a surface rounds."""
    return (np.round(corners, KEPT_DECIMALS) + 0.0).tobytes()


@lru_cache(maxsize=16)
def _longest_rectangle(kept: bytes, height_mm: float) -> Inscribed | None:
    corners = np.frombuffer(kept).reshape(-1, 2)
    polygon = Polygon.of(corners)
    y_min, top = float(corners[:, 1].min()), float(corners[:, 1].max()) - height_mm
    if top < y_min:
        return None
    at = np.linspace(y_min, top, SAMPLES)
    step = float(at[1] - at[0])
    best = sorted((polygon.longest_gap(float(y), height_mm) for y in at), key=lambda gap: gap[0])[-FOLLOWED:]
    for _ in range(ROUNDS if step > 0.0 else 0):
        found = [polygon.longest_gap(float(y), height_mm) for _, middle, _ in best
                 for y in np.clip(np.linspace(middle - step, middle + step, CLOSER), y_min, top)]
        best = sorted([*best, *found], key=lambda gap: gap[0])[-FOLLOWED:]
        step *= 2.0 / (CLOSER - 1)
    length, y, low = best[-1]
    return Inscribed(low, low + length, y, y + height_mm) if length > 0.0 else None


def longest_upright(corners: Array) -> Inscribed:
    """Find the longest upright segment within a polygon (n, 2)."""
    found = longest_rectangle(corners[:, ::-1], 0.0)
    if found is None:
        raise SpecError("what reflects has no outline")
    return Inscribed(found.y_min, found.y_max, found.x_min, found.x_max)


def contains(corners: Array, x: float, y: float) -> bool:
    """Whether a polygon (n, 2) holds a point."""
    return Polygon.of(corners).contains(x, y)


def inscribed_circle(polygon: Array) -> float:
    """Find the diameter of the largest circle within a polygon (n, 2), mm.

    The point within that is farthest from its edges, on closer and closer grids. A polygon of fewer corners tells which points
    of a grid can be that; of the edges only those count that are no farther from the grid's middle than the middle's own
    distance and twice the grid's reach.
    """
    return _inscribed_circle(_kept(polygon))


@lru_cache(maxsize=16)
def _inscribed_circle(kept: bytes) -> float:
    polygon = np.frombuffer(kept).reshape(-1, 2)
    corners, off = _coarser(polygon)
    few, edges = _Edges.of(corners), _Edges.of(polygon)
    centre = 0.5 * (polygon.min(axis=0) + polygon.max(axis=0))
    half, best = 0.5 * np.ptp(polygon, axis=0), 0.0
    for _ in range(CIRCLE_ROUNDS):
        grid = centre + half * np.stack(np.meshgrid(*2 * (np.linspace(-1.0, 1.0, CIRCLE_GRID),)), axis=2).reshape(-1, 2)
        grid = grid[_inside(polygon, grid)]
        reach = float(np.hypot(*half))
        few, edges = few.about(centre, reach), edges.about(centre, reach)
        if len(grid):
            nearly = few.distance(grid)
            grid = grid[nearly >= nearly.max() - 2.0 * off]
            distance = edges.distance(grid)
            if distance.max() > best:
                best, centre = float(distance.max()), grid[int(np.argmax(distance))]
        half = half * 4.0 / (CIRCLE_GRID - 1)
    return 2.0 * best


def _coarser(polygon: Array) -> tuple[Array, float]:
    """Some of a polygon's corners (m, 2), FEW_CORNERS or fewer, and how far the others are off the sides between them."""
    step = max(1, len(polygon) // FEW_CORNERS)
    kept = np.arange(0, len(polygon), step)
    a = polygon[kept[np.arange(len(polygon)) // step]]
    b = polygon[np.roll(kept, -1)[np.arange(len(polygon)) // step]]
    span = b - a
    long = np.maximum(np.einsum("ij,ij->i", span, span), np.finfo(float).tiny)
    share = np.clip(np.einsum("ij,ij->i", polygon - a, span) / long, 0.0, 1.0)
    return polygon[kept], float(np.linalg.norm(polygon - a - share[:, None] * span, axis=1).max())


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """Straight edges from `start` (n, 2) along `span` (n, 2), whose squared lengths are (n,)."""

    start: Array
    span: Array
    squared: Array

    @staticmethod
    def of(polygon: Array) -> _Edges:
        span = np.roll(polygon, -1, axis=0) - polygon
        squared = np.einsum("ij,ij->i", span, span)
        there = squared > 0.0
        return _Edges(polygon[there], span[there], squared[there])

    def about(self, middle: Array, reach: float) -> _Edges:
        """Those that can be the nearest to a point no farther than `reach` from a middle."""
        distance = self._distances(middle[None])[0]
        near = distance <= distance.min() + 2.0 * reach
        return _Edges(self.start[near], self.span[near], self.squared[near])

    def distance(self, points: Array) -> Array:
        """How far points (m, 2) are from the nearest edge, (m,)."""
        return self._distances(points).min(axis=1)

    def _distances(self, points: Array) -> Array:
        off = points[:, None] - self.start
        share = np.clip(np.einsum("mnj,nj->mn", off, self.span) / self.squared, 0.0, 1.0)
        off -= share[:, :, None] * self.span
        result: Array = np.sqrt(np.einsum("mnj,mnj->mn", off, off))
        return result


def _inside(polygon: Array, points: Array) -> NDArray[np.bool_]:
    """Which points (m, 2), of which many share a y, a polygon holds, by the even-odd rule."""
    sides = Polygon.of(polygon)
    found = np.zeros(len(points), dtype=np.bool_)
    for y in np.unique(points[:, 1]):
        row = points[:, 1] == y
        k = np.flatnonzero((sides.y0 <= y) != (sides.y1 <= y))
        cuts = np.sort(sides.x0[k] + (y - sides.y0[k]) * sides.slope[k])
        found[row] = (len(cuts) - np.searchsorted(cuts, points[row, 0], "right")) % 2 == 1
    return found
