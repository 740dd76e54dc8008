"""Gauss points over the spans of a surface, and how much of each one's cell lies in the mirror."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirror_cad.outline import Outline

Array = NDArray[np.float64]

GAUSS = 4  # points a span and direction
SUBCELLS = 5  # a direction, to see how much of a Gauss point's cell lies inside the outline


def gauss_points(ends: Array) -> tuple[Array, Array]:
    """Compute the Gauss-Legendre points and weights of every span between `ends`, rising."""
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS)
    half = 0.5 * np.diff(ends)[:, None]
    middle = 0.5 * (ends[:-1] + ends[1:])[:, None]
    return (middle + half * nodes).ravel(), (half * weights).ravel()


def gauss_grid(outline: Outline, ends: tuple[Array, Array]) -> tuple[Array, Array, Array, Array, Array]:
    """Spread Gauss points over a mirror.

    Parameters
    ----------
    outline : Outline
        Of the mirror.
    ends : tuple
        Of the spans along x and y, rising, mm.

    Returns
    -------
    ndarray
        x (m,), their weights, y (n,), their weights, and which share of each point's cell lies inside the outline (m, n).
    """
    x, weight_x = gauss_points(ends[0])
    y, weight_y = gauss_points(ends[1])
    return x, weight_x, y, weight_y, share_inside(outline, ends, weight_x, weight_y)


def share_inside(outline: Outline, ends: tuple[Array, Array], weight_x: Array, weight_y: Array) -> Array:
    """How much of each Gauss point's cell lies inside the outline, (m, n): the cells' widths are the weights.

    A plain yes or no would let the surface bend freely in the cells that the outline cuts.
    """
    samples = []
    for end, weight in ((ends[0], weight_x), (ends[1], weight_y)):
        start = end[0] + np.concatenate([[0.0], np.cumsum(weight)[:-1]])
        samples.append((start[:, None] + weight[:, None] * (np.arange(SUBCELLS) + 0.5) / SUBCELLS).ravel())
    inside = outline.contains(*np.meshgrid(*samples, indexing="ij"))
    result: Array = inside.reshape(len(weight_x), SUBCELLS, len(weight_y), SUBCELLS).mean(axis=(1, 3))
    return result
