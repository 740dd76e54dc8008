"""The small pieces that B-spline surfaces are searched in, with bounds on each, and a tree of their boxes.

A piece is a rectangle of (u, v) inside one cell of the knots, small enough that its normal turns little. What bounds it are
the Bézier poles of that rectangle: the surface lies in their box, and its second derivatives among those of the poles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mirror_cad.surfaces.bspline import BSplineSurface
from raytrace.errors import TraceError
from raytrace.kernels.first_hit import Pieces
from raytrace.surfaces.polynomials import polynomial_cells
from raytrace.surfaces.trimming import Trimming

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# A piece is halved until its second derivatives, over its half sizes, are less than this share of its shorter side: then
# most rays that meet it are known to meet it once, and find the place in three or four steps. Half or twice as much is no
# faster.
BEND = 0.5
MAX_PIECES = 4096  # that the cells of one surface together are halved into, if there are not more cells than that
MAX_HALVINGS = 12  # of a cell; what is not straight enough then (a pole, a tip) the search halves further for each ray
BOX_MARGIN = 1e-12  # of the surface's size and its distance from the origin: rounding of poles of degree 25, and more
LEAF = 2  # pieces of a leaf of the tree

# Columns of a piece's numbers: the middle of its cell, its own middle counted from there, its half sizes, and the bounds on
# the second derivatives by u, by both and by v, times the half sizes; from VALUES on the three or four coordinates in its
# middle, each with its derivatives by u and v.
MIDDLE_U, MIDDLE_V, OFF_U, OFF_V, HALF_U, HALF_V, BEND_UU, BEND_UV, BEND_VV, VALUES = range(10)
COLUMNS = VALUES + 12
# Columns of a surface's numbers.
POWERS_U, POWERS_V, PARTS, FIRST, STRIPS, ONE_SIDED = range(6)
CENTRE, EXTENT, SIGN, LOW, INVERSE_HEIGHT, U_MIN, U_MAX, V_MIN, V_MAX = 0, 3, 4, 5, 6, 7, 8, 9, 10


class Tree(NamedTuple):
    """Boxes (k, 6), mm: lows then highs, and links (k, 2): the first of two children, 0; or the first piece, their count."""

    boxes: Array
    links: Index


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
    """The pieces of trimmed surfaces within the boxes of their trimmings.

    Raises: TraceError for a degree that the kernels do not take.
    """
    boxes, numbers, bases, owners, coefficients, counts, sizes, first, edges = [], [], [], [], [], [], [], [], []
    base = edge = strips = 0
    for number, each in enumerate(surfaces):
        surface, trimming = each.surface, each.trimming
        cells = polynomial_cells(surface)
        if cells is None:
            raise TraceError(f"a face's B-spline has degree {surface.degree_u} × {surface.degree_v}; degrees up to "
                             "25 are traced: convert the face")
        u_min, u_max, v_min, v_max = trimming.box
        margin = BOX_MARGIN * (cells.extent + float(np.abs(cells.centre).max()))
        halvings = min(max(math.ceil(math.log2(MAX_PIECES / len(cells.middle_u) / len(cells.middle_v))), 1), MAX_HALVINGS)
        found_boxes, found, found_bases = _halved(
            cells.coefficients, _to_bezier(surface.degree_u), _to_bezier(surface.degree_v), cells.middle_u,
            np.diff(cells.ends_u) / 2, cells.middle_v, np.diff(cells.ends_v) / 2, u_min, u_max, v_min, v_max, halvings)
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
    return Pieces(*tree, box[order], np.concatenate(numbers)[order], np.concatenate(bases)[order],
                  np.concatenate(owners)[order], np.concatenate(coefficients), np.array(counts, dtype=np.int64),
                  np.array(sizes), np.concatenate(first), np.concatenate(edges))


@lru_cache(maxsize=32)
def _to_bezier(degree: int) -> Array:
    """What takes coefficients of powers of t, highest first, to Bézier poles on −1 ≤ t ≤ 1, (p + 1, p + 1).

    t^k = (2s − 1)^k = Σ_j C(k, j)·2^j·(−1)^(k−j)·s^j, and s^j = Σ_i C(i, j)/C(p, j)·B_i.   Source: Farouki & Rajan, Computer
    Aided Geometric Design 4 (1987).
    """
    matrix = np.empty((degree + 1, degree + 1))
    for i in range(degree + 1):
        for k in range(degree + 1):
            matrix[i, degree - k] = math.fsum(math.comb(k, j) * 2**j * (-1)**(k - j) * math.comb(i, j) / math.comb(degree, j)
                                              for j in range(k + 1))
    return matrix


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]  # numba's are
def _halved(coefficients: Array, bezier_u: Array, bezier_v: Array, middle_u: Array, half_u: Array, middle_v: Array,  # type: ignore[no-untyped-def]
            half_v: Array, u_min: float, u_max: float, v_min: float, v_max: float, halvings: int):
    """Boxes, numbers and bases of the pieces of one surface; boxes about its centre."""
    parts, nu, nv = coefficients.shape[2:]
    boxes, numbers = np.empty((64, 6)), np.empty((64, COLUMNS))
    bases = np.empty(64, dtype=np.int64)
    count = 0
    # The pieces that wait: one of each number of halvings, and the one at work.
    nets = np.empty((halvings + 2, nu, nv, parts))
    rectangles = np.empty((halvings + 2, 4))
    depths = np.empty(halvings + 2, dtype=np.int64)
    local = np.empty((nu, nv, parts))
    for i in range(len(middle_u)):
        for j in range(len(middle_v)):
            for part in range(parts):
                for a in range(nu):
                    for b in range(nv):
                        value = 0.0
                        for c in range(nu):
                            row = 0.0
                            for d in range(nv):
                                row += bezier_v[b, d] * coefficients[i, j, part, c, d] * half_v[j] ** (nv - 1 - d)
                            value += bezier_u[a, c] * row * half_u[i] ** (nu - 1 - c)
                        nets[0, a, b, part] = value
            rectangles[0] = np.array([0.0, 0.0, half_u[i], half_v[j]])
            depths[0] = 0
            waiting = 1
            while waiting > 0:
                top = waiting - 1
                off_u, off_v, du, dv = rectangles[top]
                u, v = middle_u[i] + off_u, middle_v[j] + off_v
                slack_u, slack_v = 1e-9 * half_u[i], 1e-9 * half_v[j]
                if u - du > u_max + slack_u or u + du < u_min - slack_u or v - dv > v_max + slack_v or v + dv < v_min - slack_v:
                    waiting -= 1
                    continue
                if count == len(boxes):
                    more_boxes, more_numbers = np.empty((2 * count, 6)), np.empty((2 * count, COLUMNS))
                    more_bases = np.empty(2 * count, dtype=np.int64)
                    more_boxes[:count], more_numbers[:count], more_bases[:count] = boxes, numbers, bases
                    boxes, numbers, bases = more_boxes, more_numbers, more_bases
                along_u, along_v, straight = _bounds(nets[top], local, boxes[count], numbers[count])
                if straight or depths[top] == halvings:
                    numbers[count, MIDDLE_U], numbers[count, MIDDLE_V] = middle_u[i], middle_v[j]
                    numbers[count, OFF_U], numbers[count, OFF_V] = off_u, off_v
                    numbers[count, HALF_U], numbers[count, HALF_V] = du, dv
                    _at_middle(coefficients[i, j], off_u, off_v, numbers[count, VALUES:])
                    bases[count] = (i * len(middle_v) + j) * parts * nu * nv
                    count += 1
                    waiting -= 1
                    continue
                depths[top] += 1
                depths[top + 1] = depths[top]
                rectangles[top + 1] = rectangles[top]
                if along_u > along_v:
                    _halve_u(nets[top], nets[top + 1])
                    rectangles[top:top + 2, 2] *= 0.5
                    rectangles[top, 0] -= rectangles[top, 2]
                    rectangles[top + 1, 0] += rectangles[top, 2]
                else:
                    _halve_v(nets[top], nets[top + 1])
                    rectangles[top:top + 2, 3] *= 0.5
                    rectangles[top, 1] -= rectangles[top, 3]
                    rectangles[top + 1, 1] += rectangles[top, 3]
                waiting += 1
    return boxes[:count], numbers[:count], bases[:count]


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _bounds(net: Array, local: Array, box: Array, numbers: Array) -> tuple[float, float, bool]:
    """The box and the bends of a Bézier net; what halving it in either direction would straighten, and whether it is
    straight enough.

    Of a rational net the bends are those of P − w·c, c the middle of the box, and those of w times the box's half diagonal:
    for a ray that meets the box these bound the second derivatives of P − w·o across the ray.
    """
    nu, nv, parts = net.shape
    box[:3], box[3:] = np.inf, -np.inf
    for a in range(nu):
        for b in range(nv):
            weight = net[a, b, 3] if parts == 4 else 1.0
            for c in range(3):
                value = net[a, b, c] / weight
                box[c], box[c + 3] = min(box[c], value), max(box[c + 3], value)
    radius = 0.0
    for c in range(3):
        middle = 0.5 * (box[c] + box[c + 3])
        radius += (box[c + 3] - middle) ** 2
        for a in range(nu):
            for b in range(nv):
                local[a, b, c] = net[a, b, c] - middle * (net[a, b, 3] if parts == 4 else 1.0)
    radius = math.sqrt(radius)
    heaviest = 1.0
    if parts == 4:
        heaviest = 0.0
        for a in range(nu):
            for b in range(nv):
                local[a, b, 3] = net[a, b, 3] * radius
                heaviest = max(heaviest, net[a, b, 3])
    uu = uv = vv = 0.0
    for a in range(nu):
        for b in range(nv):
            if a > 1:
                uu = max(uu, _second(local, parts, a, b, a - 1, b, a - 1, b, a - 2, b))
            if a > 0 and b > 0:
                uv = max(uv, _second(local, parts, a, b, a - 1, b, a, b - 1, a - 1, b - 1))
            if b > 1:
                vv = max(vv, _second(local, parts, a, b, a, b - 1, a, b - 1, a, b - 2))
    p, q = nu - 1, nv - 1
    uu, uv, vv = 0.25 * p * (p - 1) * uu, 0.25 * p * q * uv, 0.25 * q * (q - 1) * vv
    numbers[BEND_UU], numbers[BEND_UV], numbers[BEND_VV] = uu, uv, vv
    # The sides: half of the chords between the middles of opposite ones.
    side_u, side_v = np.zeros(3), np.zeros(3)
    for b in range(nv):
        for c in range(3):
            side_u[c] += 0.5 * (local[p, b, c] - local[0, b, c]) / nv
    for a in range(nu):
        for c in range(3):
            side_v[c] += 0.5 * (local[a, q, c] - local[a, 0, c]) / nu
    area = math.sqrt((side_u[1] * side_v[2] - side_u[2] * side_v[1]) ** 2 + (side_u[2] * side_v[0] - side_u[0] * side_v[2]) ** 2
                     + (side_u[0] * side_v[1] - side_u[1] * side_v[0]) ** 2)
    long_u, long_v = math.sqrt((side_u**2).sum()), math.sqrt((side_v**2).sum())
    shorter = area / (max(long_u, long_v) + 1e-300)
    # Where both directions bend equally, as where they only twist, the longer side is halved.
    along_u, along_v = uu + 1e-6 * long_u, vv + 1e-6 * long_v
    if uv >= max(uu, vv):
        along_u, along_v = long_u, long_v
    return along_u, along_v, uu + 2.0 * uv + vv <= BEND * shorter + 1e-9 * radius * heaviest


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _at_middle(cell: Array, a: float, b: float, values: Array) -> None:
    """The coordinates of a cell, highest powers first, at (a, b) from its middle: x, x_u, x_v, y, …"""
    parts, nu, nv = cell.shape
    for part in range(parts):
        value = along_a = along_b = 0.0
        for r in range(nu):
            row = slope = 0.0
            for c in range(nv):
                slope = slope * b + row
                row = row * b + cell[part, r, c]
            along_a = along_a * a + value
            value = value * a + row
            along_b = along_b * a + slope
        values[3 * part], values[3 * part + 1], values[3 * part + 2] = value, along_a, along_b


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _second(net: Array, parts: int, a: int, b: int, a1: int, b1: int, a2: int, b2: int, a3: int, b3: int) -> float:
    """Length of a second difference of the poles; that of the weights beside it, by its size."""
    square = 0.0
    for c in range(3):
        square += (net[a, b, c] - net[a1, b1, c] - net[a2, b2, c] + net[a3, b3, c]) ** 2
    length = math.sqrt(square)
    if parts == 4:
        length += abs(net[a, b, 3] - net[a1, b1, 3] - net[a2, b2, 3] + net[a3, b3, 3])
    return length


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _halve_u(net: Array, other: Array) -> None:
    """The net of the lower half of u in place, that of the upper into `other`: de Casteljau's algorithm at 1/2."""
    last = net.shape[0] - 1
    for r in range(last + 1):
        other[last - r] = net[last]
        for a in range(last, r, -1):
            net[a] = 0.5 * (net[a - 1] + net[a])


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _halve_v(net: Array, other: Array) -> None:
    """The same for v."""
    last = net.shape[1] - 1
    for r in range(last + 1):
        other[:, last - r] = net[:, last]
        for b in range(last, r, -1):
            net[:, b] = 0.5 * (net[:, b - 1] + net[:, b])


def tree_of(boxes: Array, leaf: int = LEAF) -> tuple[Tree, Index]:
    """A tree over boxes (m, 6), and the order (m,) in which its leaves take them.

    Each node is parted at the median of its boxes' middles along the axis in which these reach farthest, so that m boxes
    have a tree log2 m deep.
    """
    order = np.arange(len(boxes))
    links, nodes = np.empty((2 * len(boxes), 2), dtype=np.int64), np.empty((2 * len(boxes), 6))
    count = _plant(boxes, 0.5 * (boxes[:, :3] + boxes[:, 3:]), leaf, order, nodes, links)
    return Tree(nodes[:count].copy(), links[:count].copy()), order


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _plant(boxes: Array, middles: Array, leaf: int, order: Index, nodes: Array, links: Index) -> int:
    waiting = np.empty((128, 3), dtype=np.int64)  # nodes to be filled: number, first box, end
    waiting[0] = np.array([0, 0, len(order)])
    left, count = 1, 1
    while left > 0:
        left -= 1
        node, first, end = waiting[left]
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        nodes[node, :3], nodes[node, 3:] = np.inf, -np.inf
        for k in range(first, end):
            for c in range(3):
                nodes[node, c] = min(nodes[node, c], boxes[order[k], c])
                nodes[node, c + 3] = max(nodes[node, c + 3], boxes[order[k], c + 3])
                low[c], high[c] = min(low[c], middles[order[k], c]), max(high[c], middles[order[k], c])
        if end - first <= leaf:
            links[node] = np.array([first, end - first])
            continue
        axis = int(np.argmax(high - low))
        part = order[first:end]
        order[first:end] = part[np.argsort(middles[part, axis], kind="mergesort")]
        middle = (first + end) // 2
        links[node] = np.array([count, 0])
        waiting[left] = np.array([count, first, middle])
        waiting[left + 1] = np.array([count + 1, middle, end])
        left += 2
        count += 2
    return count
