"""The points inside an outline at which a mirror is evaluated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mirror_cad.outline import Outline
from mirror_cad.surfaces.bspline import BSplineSurface

Array = NDArray[np.float64]

# Cells of the evaluation grid: odd numbers, so that their centres meet no knot of a regular subdivision.
GRID = (211, 311)
# Points on the outline, shared out over its segments by length: a largest value on the edge is not missed by half a
# cell, and the ends of the segments, where it often is, are among them.
EDGE_POINTS = 2000


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Where the trimmed mirror is evaluated: cell centres inside the outline, then points on its edge.

    Attributes
    ----------
    x, y : ndarray
        (n,), mm.
    weights : ndarray
        (n,), 1 inside, 0 on the edge, which counts for largest values only.
    cells_x, cells_y, inside : ndarray
        The grid as a rectangle, for maps.
    """

    x: Array
    y: Array
    weights: Array
    cells_x: Array
    cells_y: Array
    inside: NDArray[np.bool_]

    @staticmethod
    @lru_cache(maxsize=4)  # a design, its deviation and its plate look at one outline; an outline never changes
    def over(outline: Outline, cells: tuple[int, int] = GRID, edge_points: int = EDGE_POINTS) -> Grid:
        """The grid of an outline.

        Parameters
        ----------
        outline : Outline
            Closed, mm.
        cells : tuple
            Along x and y over its box.
        edge_points : int
            About so many on the outline.
        """
        x_min, x_max, y_min, y_max = outline.bounding_box()
        nx, ny = cells
        cells_x = x_min + (x_max - x_min) * (np.arange(nx) + 0.5) / nx
        cells_y = y_min + (y_max - y_min) * (np.arange(ny) + 0.5) / ny
        x, y = np.meshgrid(cells_x, cells_y, indexing="ij")
        inside = outline.contains(x, y)
        edge = _points_on_edge(outline, edge_points)
        weights = np.concatenate([np.ones(int(inside.sum())), np.zeros(len(edge))])
        arrays = (np.concatenate([x[inside], edge[:, 0]]), np.concatenate([y[inside], edge[:, 1]]), weights,
                  cells_x, cells_y, inside)
        for array in arrays:
            array.setflags(write=False)
        return Grid(*arrays)

    @property
    def edge(self) -> slice:
        """Which of the points lie on the edge."""
        return slice(int(self.inside.sum()), len(self.x))

    def derivatives(self, surface: BSplineSurface) -> dict[str, Array]:
        """`surface.derivatives` at (x, y), the cells as the regular grid that they are.

        Parameters
        ----------
        surface : BSplineSurface
            u = x, v = y.

        Returns
        -------
        dict
            Each (n, 3).
        """
        cells = surface.on_grid(self.cells_x, self.cells_y)
        edge = surface.derivatives(self.x[self.edge], self.y[self.edge])
        return {key: self._joined(cells[key], edge[key]) for key in cells}

    def points(self, surface: BSplineSurface) -> Array:
        """`surface.evaluate` at (x, y).

        Parameters
        ----------
        surface : BSplineSurface
            u = x, v = y.

        Returns
        -------
        ndarray
            (n, 3), mm.
        """
        cells = surface.on_grid(self.cells_x, self.cells_y, order=0)["s"]
        return self._joined(cells, surface.evaluate(self.x[self.edge], self.y[self.edge]))

    def _joined(self, cells: Array, edge: Array) -> Array:
        """Vectors of all cells and on the edge, as (x, y) are."""
        inside = np.flatnonzero(self.inside)  # rows by their numbers are taken in a sixth of the time that a mask takes
        return np.concatenate([np.take(cells.reshape(-1, 3), inside, axis=0), edge])

    def as_map(self, values: Array) -> Array:
        """Values at (x, y) as a rectangle.

        Parameters
        ----------
        values : ndarray
            (n,).

        Returns
        -------
        ndarray
            (cells_x, cells_y), NaN outside the outline.
        """
        rectangle = np.full(self.inside.shape, np.nan)
        rectangle[self.inside] = values[: int(self.weights.sum())]
        return rectangle


def _points_on_edge(outline: Outline, points: int) -> Array:
    chords = [segment.point(np.linspace(0.0, 1.0, 17)) for segment in outline.segments]
    lengths = np.array([np.linalg.norm(np.diff(chord, axis=0), axis=1).sum() for chord in chords])
    counts = np.ceil(points * lengths / lengths.sum()).astype(int) + 1
    parts = [segment.point(np.linspace(0.0, 1.0, n)) for segment, n in zip(outline.segments, counts, strict=True)]
    return np.concatenate(parts)
