"""Whether parameters (u, v) lie inside trimming loops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels import newton

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

STRIPS = 2048  # that a trimming polygon is sorted into: a handful of edges in each


@dataclass(frozen=True, slots=True, eq=False)
class Trimming:
    """Closed polygons with their edges sorted into strips of v: inside is where an odd number of edges lies to the right.

    first (strips + 1,) : the first edge of each strip.   edges (m, 4) : u0, v0, u1, v1.   low, inverse_height : the
    strips' start and 1/height.   interior_spans (strips, 2) : an interval of u that lies inside all over its strip.
    """

    first: NDArray[np.int64]
    edges: Array
    low: float
    inverse_height: float
    interior_spans: Array
    box: Box

    @staticmethod
    def of(loops: tuple[Array, ...], strips: int = STRIPS) -> Trimming:
        """Of loops (n, 2) each, the first point not repeated."""
        edges = np.concatenate([np.hstack([loop, np.roll(loop, -1, axis=0)]) for loop in loops])
        low, high = float(edges[:, 1].min()), float(edges[:, 1].max())
        inverse = strips / (high - low) if high > low else 1.0
        first, sorted_edges = newton.into_strips(edges, low, inverse, strips)
        spans = np.empty((strips, 2))
        newton.interior_spans(first, sorted_edges, low, inverse, spans)
        return Trimming(first, sorted_edges, low, inverse, spans,
                        (float(edges[:, 0].min()), float(edges[:, 0].max()), low, high))

    @property
    def arguments(self) -> tuple[NDArray[np.int64], Array, float, float]:
        """What the kernels take, without `interior_spans`."""
        return self.first, self.edges, self.low, self.inverse_height

    def contains(self, u: Array, v: Array) -> NDArray[np.bool_]:
        """Which of the places (n,) lie inside."""
        answer = np.empty(len(u), dtype=np.bool_)
        newton.inside(*self.arguments, np.ascontiguousarray(u), np.ascontiguousarray(v), answer)
        return answer
