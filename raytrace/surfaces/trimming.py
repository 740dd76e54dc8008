"""Whether parameters (u, v) lie inside trimming loops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.trimming import Strips, interior_spans, into_strips

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

STRIPS = 2048  # that a trimming polygon is sorted into: a handful of edges in each


@dataclass(frozen=True, slots=True, eq=False)
class Trimming:
    """Closed polygons in (u, v): inside is where an odd number of edges lies to the right.

    Attributes
    ----------
    strips : the edges, as the kernels take them.
    box : (u_min, u_max, v_min, v_max), between which they lie.
    """

    strips: Strips
    box: Box

    @staticmethod
    def of(loops: tuple[Array, ...], strips: int = STRIPS) -> Trimming:
        """Sort the edges of polygons into strips of v.

        Parameters
        ----------
        loops : (n, 2) each, the first point not repeated.
        strips : how many.

        Returns
        -------
        Trimming
        """
        edges = np.concatenate([np.hstack([loop, np.roll(loop, -1, axis=0)]) for loop in loops])
        low, high = float(edges[:, 1].min()), float(edges[:, 1].max())
        inverse = strips / (high - low) if high > low else 1.0
        first, sorted_edges = into_strips(edges, low, inverse, strips)
        found = Strips(first, sorted_edges, low, inverse, np.empty((strips, 2)))
        interior_spans(found)
        return Trimming(found, (float(edges[:, 0].min()), float(edges[:, 0].max()), low, high))

    def contains(self, u: Array, v: Array) -> NDArray[np.bool_]:
        """Which of the points (n,) lie inside."""
        return self.strips.contain(u, v)
