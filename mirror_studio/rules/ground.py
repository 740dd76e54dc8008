"""Two eyes' views of a mirror and a piece of ground that a rule asks for in, what of it is not seen out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mirror_studio.rules.schema import FieldSection, Origin
from raytrace.viewing.vehicle import HostVehicle
from raytrace.viewing.view import View
from raytrace.visibility.edge import Edge
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.intervals import IntervalSet, combined, intersection, union
from raytrace.visibility.plan import ENDLESS_MM, Polygon, outlines, visible_intervals

Array = NDArray[np.float64]
Widths = Callable[[Array], Array]

MM = 1e3
FIRST_PANELS = 24  # along the road, of an integral over X; each is halved until its halves agree
MAX_ROUNDS = 40  # halvings: a panel of 1 km is then 1 nm long
AREA_MM2 = 1e-2  # of a panel, that its halves may differ by: 1e-8 m², with a few hundred of them far below what is printed
SEEN_MM = 1e-6  # a strip no wider than this is not missing: what rays through an edge are known to
FEW_LINES = 25  # of them where a mirror is turned to and fro
LINES = 241  # X = const, that polygons are drawn and the least margin is looked for on
STRAIGHT_BACK = np.array([[1.0, 0.0, 0.0]])  # where a strip of any width ends on the horizon
OBSTRUCTED_OVER_MM = 100_000.0  # along the road, of a field that ends at the horizon: what a share of it is of


@dataclass(frozen=True, slots=True, eq=False)
class RequiredGround:
    """A field of vision on level ground: between inner(x) and outer(x) for first ≤ X ≤ last, mm, on the side of sign `side`."""

    x: Array
    inner: Array
    outer: Array
    side: float
    endless: bool
    corner_mm: float = 0.0

    @staticmethod
    def of(field: FieldSection, host: HostVehicle, side: float) -> RequiredGround:
        """On a vehicle, for a mirror on its left (−1) or right (1) side."""
        start = host.front_mm if field.x_from == "front" else 0.0
        from_median: dict[Origin, float] = {"median": 0.0, "flank": host.half_width_mm, "other flank": -host.half_width_mm}
        x, inner, outer = (MM * np.array(column) for column in zip(*field.rows_m, strict=True))
        return RequiredGround(start + np.minimum(x, ENDLESS_MM), inner + from_median[field.inner_from],
                              outer + from_median[field.outer_from], side, field.endless, MM * field.corner_radius_m)

    def between(self, x: Array) -> IntervalSet:
        """The intervals of Y on lines X = x (n,), rising."""
        inner, outer = np.interp(x, self.x, self.inner), np.interp(x, self.x, self.outer)
        ahead = np.clip(self.x[0] + self.corner_mm - x, 0.0, self.corner_mm)  # of the corner's centre
        outer = outer - (self.corner_mm - np.sqrt(self.corner_mm**2 - ahead**2))
        low, high = (inner, outer) if self.side > 0 else (-outer, -inner)
        row = np.flatnonzero((x >= self.x[0]) & (x <= self.x[-1]) & (low < high))
        return IntervalSet(row, low[row], high[row])

    @property
    def area_m2(self) -> float:
        """Its area; of one that goes on to the horizon, as far as lines are followed."""
        return integral(lambda x: _lengths(self.between(x), len(x)), self.x) / MM**2

    def polygon(self, up_to_mm: float) -> Polygon:
        """Its outline (n, 2) up to some X, mm."""
        x = np.unique(np.concatenate([np.linspace(self.x[0], min(self.x[-1], up_to_mm), LINES), self.x[self.x < up_to_mm]]))
        return outlines(self.between(x), x)[0]


@dataclass(frozen=True, slots=True, eq=False)
class SeenLines:
    """The ground on lines X = x (n,) that the left eye sees in a mirror, the right one, either and both."""

    x: Array
    left: IntervalSet
    right: IntervalSet

    @property
    def either(self) -> IntervalSet:
        """The ambinocular field."""
        return union(self.left, self.right)

    @property
    def both(self) -> IntervalSet:
        """The binocular field."""
        return intersection(self.left, self.right)


@dataclass(frozen=True, slots=True, eq=False)
class MissingGround:
    """What of a required field either eye does not see.

    missing_m2, missing_to_both_m2 : of the ambinocular and the binocular field, up to 1 km where it goes on to the horizon.
    horizon : whether its end on the horizon is seen; None where it ends before.   margin_m : the least by which what is seen
    reaches beyond the field in Y, negative where it does not, and where: at_m (X, Y).   missing, seen, required : polygons (n,
    2), mm.
    """

    missing_m2: float
    missing_to_both_m2: float
    required_m2: float
    horizon: bool | None
    margin_m: float
    at_m: tuple[float, float]
    missing: tuple[Polygon, ...]
    seen: tuple[Polygon, ...]
    required: Polygon


def seen_lines(left: Edge, right: Edge, x: Array, host: HostVehicle | None = None) -> SeenLines:
    """Compute which parts of lines X = x (n,), rising, on the ground two eyes see; without a host nothing hides."""
    one, other = (visible_intervals(edge, 0, x, 0.0, host) for edge in (left, right))
    return SeenLines(x, one, other)


def missing_ground(left: View, right: View, required: RequiredGround) -> MissingGround:
    """Compute what of a required field two eyes do not see in a mirror, whatever the vehicle hides of it.

    On a line X = const the ends of what is seen are rays through the mirror's edge, exact; areas are integrals over these
    lines, halved where they bend. Where the field goes on to the horizon, all of its strip ends in the one direction straight
    back: what is seen to 1 km and in that direction is seen throughout.
    """
    edges = edge_of(left), edge_of(right)

    def widths(pick: Callable[[SeenLines], IntervalSet]) -> Widths:
        return lambda x: _lengths(_without(required.between(x), pick(seen_lines(*edges, x))), len(x))

    area = integral(widths(lambda seen: seen.either), required.x) / MM**2
    to_both = integral(widths(lambda seen: seen.both), required.x) / MM**2
    horizon = None
    if required.endless:
        horizon = _seen_at_the_end(*edges)
    near = max(4.0 * required.x[-2 if required.endless else -1], 60.0 * MM) if required.endless else float(required.x[-1])
    x = np.unique(np.concatenate([np.linspace(required.x[0], near, LINES), required.x]))
    x = x[x <= max(near, required.x[-1])]
    seen = seen_lines(*edges, x)
    margin, at = _least_margin(required.between(x), seen.either, x)
    drawn = x[x <= near]
    on_drawn = seen_lines(*edges, drawn)
    missing = _without(required.between(drawn), on_drawn.either)
    return MissingGround(area, to_both, required.area_m2, horizon, margin / MM, at, outlines(missing, drawn),
                         outlines(on_drawn.either, drawn), required.polygon(near))


def field_margin(left: View, right: View, required: RequiredGround) -> float:
    """Compute the least by which what either eye sees reaches beyond a field in Y, mm, negative where it does not.

    On FEW_LINES lines: what a search turns a mirror by; `missing_ground` looks closer.
    """
    edges = edge_of(left), edge_of(right)
    first, last = float(required.x[0]), float(required.x[-1])
    x = np.linspace(first, last, FEW_LINES) if not required.endless else first + np.geomspace(
        1.0, last - first + 1.0, FEW_LINES) - 1.0
    x = np.unique(np.concatenate([np.clip(x, first, last), required.x]))
    margin, _ = _least_margin(required.between(x), seen_lines(*edges, x).either, x)
    if required.endless and margin >= 0.0 and not _seen_at_the_end(*edges):
        return -SEEN_MM
    return margin


def _seen_at_the_end(*edges: Edge) -> bool:
    """Whether any of the eyes sees the direction straight back, in which every strip ends on the horizon."""
    return any(bool(edge.image_points(STRAIGHT_BACK, at_infinity=True)[1][0]) for edge in edges)


def hidden_share(left: View, right: View, required: RequiredGround, host: HostVehicle) -> float:
    """Compute the share of a field that either eye would see in the mirror but for the vehicle's box, over 100 m of it."""
    edges = edge_of(left), edge_of(right)
    ends = np.minimum(required.x, required.x[0] + OBSTRUCTED_OVER_MM)
    ends = np.unique(ends)

    def hidden(x: Array) -> Array:
        free, seen = (seen_lines(*edges, x, own).either for own in (None, host))
        return _lengths(_without(intersection(required.between(x), free), seen), len(x))

    whole = integral(lambda x: _lengths(required.between(x), len(x)), ends)
    return integral(hidden, ends, share=1e-4) / whole


def integral(width: Widths, ends: Array, share: float = 0.0) -> float:
    """Integrate a function of X over panels between `ends`, rising, by Lobatto's rule of five points.

    Its ends tell what is narrow there too. Panels are halved until halves agree to AREA_MM2, or to a share of all.
    """
    panels = np.concatenate([_graded(a, b) for a, b in pairwise(ends)])
    total, values = 0.0, _lobatto(width, panels)
    for _ in range(MAX_ROUNDS):
        if len(panels) == 0:
            break
        middle = panels.mean(axis=1)
        halves = np.stack([np.stack([panels[:, 0], middle], axis=1), np.stack([middle, panels[:, 1]], axis=1)], axis=1)
        finer = _lobatto(width, halves.reshape(-1, 2)).reshape(-1, 2)
        scale = max(AREA_MM2, share * abs(float(values.sum()) + total))
        settled = np.abs(finer.sum(axis=1) - values) <= scale
        total += float(finer[settled].sum())
        panels, values = halves[~settled].reshape(-1, 2), finer[~settled].ravel()
    return total + float(values.sum())


def _graded(a: float, b: float) -> Array:
    """Panels (n, 2) from a to b, in equal ratios where that runs over decades."""
    at = np.geomspace(a, b, FIRST_PANELS + 1) if 0.0 < a < 0.1 * b else np.linspace(a, b, FIRST_PANELS + 1)
    at[0], at[-1] = a, b
    return np.stack([at[:-1], at[1:]], axis=1)


NODES = np.array([-1.0, -np.sqrt(3.0 / 7.0), 0.0, np.sqrt(3.0 / 7.0), 1.0])
WEIGHTS = np.array([0.1, 49.0 / 90.0, 32.0 / 45.0, 49.0 / 90.0, 0.1])


def _lobatto(width: Widths, panels: Array) -> Array:
    """The integral over each of the panels (n, 2)."""
    half = 0.5 * (panels[:, 1] - panels[:, 0])
    x = panels.mean(axis=1)[:, None] + half[:, None] * NODES
    x[:, 0], x[:, -1] = panels[:, 0], panels[:, 1]
    values, back = np.unique(x.ravel(), return_inverse=True)
    result: Array = half * (width(values)[back].reshape(x.shape) @ WEIGHTS)
    return result


def _without(needed: IntervalSet, seen: IntervalSet) -> IntervalSet:
    """What of some intervals others leave, but for strips that are no wider than rays are known."""
    left = combined(lambda a, b: a & ~b, needed, seen)
    wide = left.high - left.low > SEEN_MM
    return IntervalSet(left.row[wide], left.low[wide], left.high[wide])


def _lengths(spans: IntervalSet, rows: int) -> Array:
    """The sum of the intervals' lengths on each row, (rows,)."""
    return np.bincount(spans.row, spans.high - spans.low, minlength=rows).astype(np.float64)


def _least_margin(needed: IntervalSet, seen: IntervalSet, x: Array) -> tuple[float, tuple[float, float]]:
    """The least by which what is seen reaches beyond what is needed, mm, and where (X, Y) in m."""
    best, at = np.inf, (float("nan"), float("nan"))
    for row, low, high in zip(needed.row, needed.low, needed.high, strict=True):
        spans = seen.of(int(row))
        over = np.minimum(spans[:, 1], high) - np.maximum(spans[:, 0], low)
        if not len(over) or over.max() <= 0.0:
            margin, y = low - high, 0.5 * (low + high)
        else:
            a, b = spans[int(np.argmax(over))]
            margin, y = (low - a, low) if low - a < b - high else (b - high, high)
        if margin < best:
            best, at = float(margin), (float(x[row]) / MM, float(y) / MM)
    return best, at
