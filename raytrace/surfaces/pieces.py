"""B-spline faces in, the pieces that they are searched in out, with bounds on each and a tree of their boxes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mirror_cad.surfaces.bspline import BSplineSurface
from raytrace.errors import TraceError
from raytrace.kernels.pieces import Pieces, halved
from raytrace.kernels.trees import tree_of
from raytrace.surfaces.polynomials import polynomial_cells
from raytrace.surfaces.trimming import Trimming

Array = NDArray[np.float64]

MAX_PIECES = 4096  # that the cells of one surface together are halved into, if there are not more cells than that
MAX_HALVINGS = 12  # of a cell; what is not straight enough then (a pole, a tip) the search halves further for each ray
BOX_MARGIN = 1e-12  # of the surface's size and its distance from the origin: rounding of poles of degree 25, and more


class SplineFace(Protocol):
    """What is cut into pieces: a B-spline inside trimming loops, S_u × S_v times `sign` outward."""

    @property
    def surface(self) -> BSplineSurface:
        """S(u, v)."""

    @property
    def trimming(self) -> Trimming:
        """Its loops."""

    @property
    def sign(self) -> float:
        """1 or −1."""

    @property
    def one_sided(self) -> bool:
        """Whether only the outward side reflects."""


def pieces_of(surfaces: Sequence[SplineFace]) -> Pieces:
    """Make the pieces of trimmed surfaces within the boxes of their trimmings, and a tree of their boxes.

    Parameters
    ----------
    surfaces : one or more.

    Returns
    -------
    Pieces

    Raises
    ------
    TraceError
        For a degree that the kernels do not take.
    """
    boxes, numbers, bases, owners, coefficients, counts, sizes, first, edges = [], [], [], [], [], [], [], [], []
    base = edge = strips = 0
    for number, each in enumerate(surfaces):
        surface, limits, trimming = each.surface, each.trimming.box, each.trimming.strips
        cells = polynomial_cells(surface)
        if cells is None:
            raise TraceError(f"a face's B-spline has degree {surface.degree_u} × {surface.degree_v}; degrees up to "
                             "25 are traced: convert the face")
        margin = BOX_MARGIN * (cells.extent + float(np.abs(cells.centre).max()))
        halvings = min(max(math.ceil(math.log2(MAX_PIECES / len(cells.middle_u) / len(cells.middle_v))), 1), MAX_HALVINGS)
        found_boxes, found, found_bases = halved(cells, _to_bezier(surface.degree_u), _to_bezier(surface.degree_v), limits,
                                                 halvings)
        boxes.append(found_boxes + np.concatenate([cells.centre - margin, cells.centre + margin]))
        numbers.append(found)
        bases.append(found_bases + base)
        owners.append(np.full(len(found), number))
        coefficients.append(cells.coefficients.ravel())
        counts.append([*cells.coefficients.shape[3:], cells.coefficients.shape[2], strips, len(trimming.first) - 1,
                       int(each.one_sided)])
        sizes.append([*cells.centre, cells.extent, each.sign, trimming.low, trimming.inverse_height, *surface.domain])
        first.append(trimming.first + edge)
        edges.append(trimming.edges)
        base, edge, strips = base + cells.coefficients.size, edge + len(trimming.edges), strips + len(trimming.first)
    box = np.concatenate(boxes)
    tree, order = tree_of(box)
    return Pieces(tree, box[order], np.concatenate(numbers)[order], np.concatenate(bases)[order],
                  np.concatenate(owners)[order], np.concatenate(coefficients), np.array(counts, dtype=np.int64),
                  np.array(sizes), np.concatenate(first), np.concatenate(edges))


@lru_cache(maxsize=32)
def _to_bezier(degree: int) -> Array:
    """What takes coefficients of powers of t, highest first, to Bézier poles on −1 ≤ t ≤ 1, (p + 1, p + 1).

    t^k = (2s − 1)^k = Σ_j C(k, j)·2^j·(−1)^(k−j)·s^j, and s^j = Σ_i C(i, j)/C(p, j)·B_i.

    References
    ----------
    Farouki and Rajan, Computer Aided Geometric Design 4 (1987).
    """
    matrix = np.empty((degree + 1, degree + 1))
    for i in range(degree + 1):
        for k in range(degree + 1):
            matrix[i, degree - k] = math.fsum(math.comb(k, j) * 2**j * (-1)**(k - j) * math.comb(i, j) / math.comb(degree, j)
                                              for j in range(k + 1))
    return matrix
