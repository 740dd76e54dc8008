"""A mirror seen by two eyes in, by how many percent it shows things larger to the left eye than to the right one, out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.in_use import MirrorInUse
from raytrace.measures.magnification import mirror_grid, ray_differentials
from raytrace.measures.registry import Measure, register
from raytrace.viewing.eye_views import EyeViews

Array = NDArray[np.float64]
Size = Literal["horizontal", "vertical", "area"]

COLUMNS, ROWS = 31, 15  # of the map: what is shown changes along a row
STEP_MM = 0.25  # to either side of a place: the rate by differences, 1e-6 of it on a smooth law
# Places across and upright about the largest of the map, at which a larger one is looked for. Both are often where one eye
# ceases to see, and change along a row: to 0.1 mm across and 2 mm upright.
CLOSER = (15, 7)
ROUNDS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Disparity:
    """Binocular disparity over a mirror: 100·(M_left − M_right)/(½·(M_left + M_right)), percent.

    x (columns,), y (rows,) : mm on the surface, where the middle between the eyes sees a far direction; `places`
    (rows, columns, 2), where it looks.   percent (rows, columns) : of that direction; NaN where not both eyes see it in the
    mirror.   rate_percent_per_mm (rows, columns) : its derivative by x along the mirror's rows, from the map's columns.
    max_percent, max_rate_percent_per_mm : the signed values of largest magnitude, sought between the map's places, with
    (x, y); None where no far direction is seen by both.
    """

    x: Array
    y: Array
    places: Array
    percent: Array
    rate_percent_per_mm: Array
    max_percent: float | None
    max_at_mm: tuple[float, float] | None
    max_rate_percent_per_mm: float | None
    max_rate_at_mm: tuple[float, float] | None


def disparity(views: EyeViews, size: Size = "horizontal", columns: int = COLUMNS, rows: int = ROWS) -> Disparity:
    """How much larger the left eye sees what is far away: of the same direction, each eye at its own place of the mirror.

    size : which of the sizes of `raytrace.measures.magnification` are compared.
    It counts what both eyes see inside the outline; what the own vehicle hides is not looked at. Zero for a flat mirror. A
    mesh stands for the smooth surface that its vertices lie on, and its largest rate is one over some facets.
    Source: S. M. O'Day, Binocular Disparity in Aspherical Mirrors, SAE 980918 (1998): the percent change of angular image
    size from one eye to the other, its maximum and its maximum rate of change. There it is a share of one eye's size, of
    targets 2 to 6 m away, among which it recommends squares ("area"); here of the mean, which does not prefer an eye, and
    of far objects, for which it is a property of a place. 10 % here is 9.5 or 10.5 % there.
    """
    views = EyeViews(views.left.interpolated, views.middle.interpolated, views.right.interpolated)
    step = views.middle.reflector.surface.resolution_mm or STEP_MM

    def at(x: Array, y: Array) -> Array:
        """Disparity of the directions that the middle sees at (x, y), (n,)."""
        return _of_places(views, views.middle.places_over(x, y), size)

    def rate(x: Array, y: Array) -> Array:
        both = at(np.concatenate([x - step, x + step]), np.concatenate([y, y]))
        return (both[len(x):] - both[:len(x)]) / (2.0 * step)

    x, y, places = mirror_grid(views.middle, columns, rows)
    percent = _of_places(views, places.reshape(-1, 2), size).reshape(rows, columns)
    slope = _along_rows(percent, x)
    cell = ((views.middle.box[1] - views.middle.box[0]) / columns, (views.middle.box[3] - views.middle.box[2]) / rows)
    largest, where = _largest(at, percent, x, y, cell)
    steepest, where_steepest = _largest(rate, slope, x, y, cell)
    return Disparity(x, y, places, percent, slope, largest, where, steepest, where_steepest)


def _of_places(views: EyeViews, places: Array, size: Size) -> Array:
    """Disparity of the far directions that the middle sees through places (n, 2); NaN where not both eyes see one."""
    result = np.full(len(places), np.nan)
    sight = views.middle.trace_places(places)
    seen = np.flatnonzero(sight.seen)
    left, right = (_sizes(views, name, sight.directions[seen], size) for name in ("left", "right"))
    result[seen] = 100.0 * (left - right) / (0.5 * (left + right))
    return result


def _sizes(views: EyeViews, name: str, directions: Array, size: Size) -> Array:
    """The magnification at which an eye sees far directions (n, 3), (n,)."""
    view = getattr(views, name)
    places, shown = view.find(directions, at_infinity=True)
    places[~shown] = np.nan
    sizes: Array = getattr(ray_differentials(view, places).at(), size)
    return sizes


def _along_rows(values: Array, x: Array) -> Array:
    """Derivative of values (rows, columns) by x, central; where a neighbour is NaN, towards the other one."""
    beside = np.full((len(values), len(x) + 1), np.nan)
    beside[:, 1:-1] = np.diff(values, axis=1) / np.diff(x)
    before, after = beside[:, :-1], beside[:, 1:]
    return np.where(np.isnan(before), after, np.where(np.isnan(after), before, 0.5 * (before + after)))


def _largest(function: Callable[[Array, Array], Array], values: Array, x: Array, y: Array, cell: tuple[float, float],
             ) -> tuple[float | None, tuple[float, float] | None]:
    """The value of largest magnitude of a function (n,), (n,) -> (n,) near that of its values on the grid x, y, and where."""
    if not np.isfinite(values).any():
        return None, None
    row, column = np.unravel_index(int(np.nanargmax(np.abs(values))), values.shape)
    best, at, reach = np.nan, (float(x[column]), float(y[row])), np.array(cell)
    for _ in range(ROUNDS):
        near_x, near_y = (axis.ravel() for axis in np.meshgrid(*(
            middle + half * np.linspace(-1.0, 1.0, count) for middle, half, count in zip(at, reach, CLOSER, strict=True))))
        near = function(near_x, near_y)
        if np.isfinite(near).any():
            k = int(np.nanargmax(np.abs(near)))
            best, at = float(near[k]), (float(near_x[k]), float(near_y[k]))
        reach = 2.0 * reach / (np.array(CLOSER) - 1.0)
    return (best, at) if np.isfinite(best) else (None, None)


def disparity_in_use(use: MirrorInUse) -> Disparity:
    """`disparity` of a mirror in use."""
    return disparity(use.on_vehicle.views)


register(Measure("disparity_max_percent", "binocular disparity, largest", "%", 2,
                 "difference of the horizontal size of a far object between the eyes, of their mean",
                 lambda use: use.record(disparity_in_use).max_percent, group="Two eyes", better="less"))
register(Measure("disparity_max_rate_percent_per_mm", "its largest rate of change", "%/mm", 3, "along a row of the mirror",
                 lambda use: use.record(disparity_in_use).max_rate_percent_per_mm, group="Two eyes", better="less"))
