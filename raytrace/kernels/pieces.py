"""The pieces that B-splines are searched in: cells of their knots, halved until they are straight enough.

A piece is a rectangle of (u, v) inside one cell, small enough that its normal turns little. What bounds it are the Bézier
poles of that rectangle: the surface lies in their box, and its second derivatives among those of the poles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.compiled import compiled
from raytrace.kernels.trees import Tree

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# A piece is halved until its second derivatives, over its half sizes, are less than this share of its shorter side: then
# most rays that meet it are known to meet it once, and find the place in three or four steps. Half or twice as much is no
# faster.
BEND = 0.5

# Columns of a piece's numbers: the middle of its cell, its own middle counted from there, its half sizes, and the bounds on
# the second derivatives by u, by both and by v, times the half sizes; from VALUES on the three or four coordinates in its
# middle, each with its derivatives by u and v.
MIDDLE_U, MIDDLE_V, OFF_U, OFF_V, HALF_U, HALF_V, BEND_UU, BEND_UV, BEND_VV, VALUES = range(10)
COLUMNS = VALUES + 12
# Columns of a surface's counts and sizes.
POWERS_U, POWERS_V, PARTS, FIRST, STRIPS, ONE_SIDED = range(6)
CENTRE, EXTENT, SIGN, LOW, INVERSE_HEIGHT, U_MIN, U_MAX, V_MIN, V_MAX = 0, 3, 4, 5, 6, 7, 8, 9, 10


class PolynomialCells(NamedTuple):
    """A B-spline surface as polynomials about the middle of each cell of its knots, of its own degrees.

    Attributes
    ----------
    coefficients : (u spans, v spans, parts, degree u + 1, degree v + 1), highest powers first; parts are 3 coordinates, or 4
        homogeneous ones.
    ends_u, ends_v, middle_u, middle_v : of the spans.
    centre : (3,), mm, what the coordinates are counted from.
    extent : largest size of a coordinate, mm.
    """

    coefficients: Array
    ends_u: Array
    ends_v: Array
    middle_u: Array
    middle_v: Array
    centre: Array
    extent: float


class Pieces(NamedTuple):
    """The pieces of several surfaces, in the order of their tree's leaves, as the search takes them.

    Attributes
    ----------
    tree : of the pieces' boxes.
    boxes : (m, 6), mm.
    numbers : (m, COLUMNS), see the columns.
    bases : (m,), where the coefficients of a piece's cell begin.
    owners : (m,), the surface that a piece is of.
    coefficients : flat, of each surface (u spans, v spans, parts, powers of u, powers of v), highest first, about its centre.
    counts, sizes : (f, 6) and (f, 11), of the surfaces, see the columns.
    first, edges : of the trimmings, one after the other, as in `raytrace.kernels.trimming.Strips`.
    """

    tree: Tree
    boxes: Array
    numbers: Array
    bases: Index
    owners: Index
    coefficients: Array
    counts: Index
    sizes: Array
    first: Index
    edges: Array


@compiled(nogil=True)
def halved(cells, bezier_u, bezier_v, limits, halvings):
    """Halve the cells of a surface until they are straight enough to be pieces.

    Parameters
    ----------
    cells : PolynomialCells.
    bezier_u, bezier_v : (p + 1, p + 1) and (q + 1, q + 1), what takes powers of t to Bézier poles on −1 ≤ t ≤ 1.
    limits : (u_min, u_max, v_min, v_max), beyond which there are no pieces.
    halvings : of a cell at most.

    Returns
    -------
    boxes, numbers, bases : of m pieces, as in `Pieces`; the boxes about the surface's centre.
    """
    coefficients, middle_u, middle_v = cells.coefficients, cells.middle_u, cells.middle_v
    half_u, half_v = 0.5 * np.diff(cells.ends_u), 0.5 * np.diff(cells.ends_v)
    u_min, u_max, v_min, v_max = limits
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


@compiled(nogil=True)
def _bounds(net, local, box, numbers):
    """The box and the bends of a Bézier net; what halving it either way would straighten, and whether it is straight enough.

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


@compiled(nogil=True)
def _at_middle(cell, a, b, values):
    """The coordinates of a cell, highest powers first, at (a, b) from its middle: x, x_u, x_v, y and so on."""
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


@compiled(nogil=True)
def _second(net, parts, a, b, a1, b1, a2, b2, a3, b3):
    """Length of a second difference of the poles; that of the weights beside it, by its size."""
    square = 0.0
    for c in range(3):
        square += (net[a, b, c] - net[a1, b1, c] - net[a2, b2, c] + net[a3, b3, c]) ** 2
    length = math.sqrt(square)
    if parts == 4:
        length += abs(net[a, b, 3] - net[a1, b1, 3] - net[a2, b2, 3] + net[a3, b3, 3])
    return length


@compiled(nogil=True)
def _halve_u(net, other):
    """The net of the lower half of u in place, that of the upper into `other`: de Casteljau's algorithm at 1/2."""
    last = net.shape[0] - 1
    for r in range(last + 1):
        other[last - r] = net[last]
        for a in range(last, r, -1):
            net[a] = 0.5 * (net[a - 1] + net[a])


@compiled(nogil=True)
def _halve_v(net, other):
    """The same for v."""
    last = net.shape[1] - 1
    for r in range(last + 1):
        other[:, last - r] = net[:, last]
        for b in range(last, r, -1):
            net[:, b] = 0.5 * (net[:, b - 1] + net[:, b])
