"""Angular magnification over a mirror, across and upright: how much smaller than a flat one it shows things."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.in_use import MirrorInUse, finite
from raytrace.measures.registry import Measure, register
from raytrace.viewing.ray_differentials import Magnification, ray_differentials
from raytrace.viewing.view import View, mirror_grid
from raytrace.visibility.edge_of import edge_of
from raytrace.visibility.extremes import Samples, largest
from raytrace.visibility.image_points import shown_inside

Array = NDArray[np.float64]
Index = NDArray[np.intp]

COLUMNS, ROWS = 41, 61  # of a map
ON_EDGE = 96  # places of the edge at which the largest and the least are looked for first
COARSE = (13, 19)  # columns and rows of such places inside


@dataclass(frozen=True, slots=True, eq=False)
class MagnificationMap:
    """Magnification over a mirror.

    Attributes
    ----------
    x, y : (columns,) and (rows,), mm, on the surface in mirror coordinates.
    on_plane : (rows, columns, 2), mm, of the picture plane, where the eye sees them.
    magnification : each of its arrays (rows, columns), NaN where nothing is shown.
    """

    x: Array
    y: Array
    on_plane: Array
    magnification: Magnification


def magnification_map(view: View, distance_mm: float = np.inf, columns: int = COLUMNS, rows: int = ROWS) -> MagnificationMap:
    """Take the magnification of small objects at the middles of equal cells of the mirror's box (`RayDifferentials.at`).

    Parameters
    ----------
    view : the mirror as the eye sees it.
    distance_mm : of the objects, mm, from where a ray leaves the mirror; far ones by default.
    columns, rows : of cells.

    Returns
    -------
    MagnificationMap
    """
    x, y, on_plane = mirror_grid(view, columns, rows)
    found = ray_differentials(view, on_plane.reshape(-1, 2)).at(distance_mm)
    shaped = Magnification(*(part.reshape(rows, columns) for part in (found.horizontal, found.vertical, found.area)))
    return MagnificationMap(x, y, on_plane, shaped)


@dataclass(frozen=True, slots=True)
class Extent:
    """From the least to the largest value over a mirror, and where on it.

    Attributes
    ----------
    least, largest : the values.
    least_at_mm, largest_at_mm : (x, y) of them, mm.
    """

    least: float
    largest: float
    least_at_mm: tuple[float, float]
    largest_at_mm: tuple[float, float]


@dataclass(frozen=True, slots=True)
class MagnificationExtremes:
    """The least and the largest magnification of far objects over all that is seen of a mirror, edge included, to 1e-6 of them.

    Attributes
    ----------
    horizontal, vertical, ratio : as in `Magnification`; None where nothing is seen.
    """

    horizontal: Extent | None
    vertical: Extent | None
    ratio: Extent | None


def magnification_extremes(view: View) -> MagnificationExtremes:
    """Find where a mirror shows far things smallest and largest, over what the eye sees reflecting.

    On a grid and along the edge first, then closer about the best of both (`raytrace.visibility.extremes`). The host vehicle
    hides nothing here. A mesh stands for the smooth surface that its vertices lie on.

    Parameters
    ----------
    view : the mirror as the eye sees it.

    Returns
    -------
    MagnificationExtremes
    """
    view = view.interpolated
    edge = edge_of(view)
    rings = edge.rings()

    def samples(curve: Index, place: Array, _of: Index) -> Samples:
        at, looked, on_edge = place.copy(), np.full((len(curve), 2), np.nan), curve >= 0
        inner = np.flatnonzero(~on_edge)
        looked[inner], traced = view.trace_over(*place[inner].T)
        seen = on_edge.copy()
        seen[inner] = shown_inside(view, traced.on_mirror, looked[inner])
        for c, ring in enumerate(rings):
            these = np.flatnonzero(curve == c)
            if these.size:
                looked[these], traced = edge.along(ring, place[these, 0])
                at[these] = traced.on_mirror[:, :2]
        found = ray_differentials(view.untrimmed, looked).at()
        values = np.stack([found.horizontal, found.vertical, found.ratio])
        return Samples(np.concatenate([values, -values]), seen, at)

    x, y, _ = mirror_grid(view, *COARSE)
    found = largest(samples, x, y, np.array([len(ring) for ring in rings], dtype=np.float64), ON_EDGE)
    parts = []
    for k in range(3):
        most, least = float(found.value[k]), -float(found.value[k + 3])
        on_plane = [(float(found.at[j, 0]), float(found.at[j, 1])) for j in (k + 3, k)]
        parts.append(Extent(least, most, *on_plane) if np.isfinite([most, least]).all() else None)
    return MagnificationExtremes(*parts)


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
                 "seen size of a far, level object over that in a flat mirror at the same place, in the middle of the mirror",
                 lambda use: _middle(use.record(map_in_use).magnification.horizontal, use.record(map_in_use)), group="Size",
                 better="more", local=True))
register(Measure("magnification_least", "horizontal magnification, least", "", 3,
                 "seen size of a far, level object over that in a flat mirror at the same place, where it is least on the "
                 "mirror",
                 lambda use: _least(use.record(extremes_in_use).horizontal), group="Size", better="more", local=True))
register(Measure("magnification_vertical_middle", "vertical magnification, middle", "", 3,
                 "seen size of a far, upright object over that in a flat mirror at the same place, in the middle of the mirror",
                 lambda use: _middle(use.record(map_in_use).magnification.vertical, use.record(map_in_use)), group="Size",
                 better="more", local=True))
register(Measure("magnification_ratio_least", "horizontal over vertical, least", "", 3,
                 "horizontal over vertical magnification, where on the mirror that is least: below 1 things look too slim",
                 lambda use: _least(use.record(extremes_in_use).ratio), group="Size", better="more", local=True))
