"""B-splines as polynomials on each cell of their knots: finding the cell, and Horner's rule on it.

What needs the number of `powers` as a constant is inlined: with it the loops unroll, and what is left of the loop over a
block of rays is straight-line code that LLVM turns into vector instructions; with a variable it does not, and runs six times
slower.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.blocks import at, clamp
from raytrace.kernels.compiled import inner
from raytrace.kernels.lanes import pitch

Array = NDArray[np.float64]

# The numbers of powers that cells are padded to with zeros, a kernel for each: degrees to 3, 5, 7, 9, 13 and 25, the CAD
# kernel's highest; those beyond 9 are loops again.
PADDED_POWERS = (4, 6, 8, 10, 14, 26)
# What `taylor` tells of a height field, as offsets.
Z, Z_X, Z_Y, HALF_XX, XY, HALF_YY, AT_X, AT_Y = range(8)
MAX_CELLS = 4  # that a block is evaluated on as a whole; a block over more goes ray by ray


class Cells(NamedTuple):
    """A surface as polynomials about the middle of each cell of its knots.

    Attributes
    ----------
    powers : degree + 1 in both directions, one of PADDED_POWERS.
    coefficients : flat, of (u spans, v spans, parts, powers of v, `pitch` of powers of u), highest powers first, then zeros.
    ends_u, ends_v : ends of the spans, then inf.
    middle_u, middle_v : of the spans.
    lookup_u, lookup_v : the span at the start of each of many uniform bins.
    bins_u, bins_v : how many bins there are to a unit.
    """

    powers: int
    coefficients: Array
    ends_u: Array
    ends_v: Array
    middle_u: Array
    middle_v: Array
    lookup_u: NDArray[np.int32]
    lookup_v: NDArray[np.int32]
    bins_u: float
    bins_v: float


@inner()
def span(value, ends, lookup, bins):
    """Index of the span that holds a value between ends[0] and ends[-2]; the last span holds its end too."""
    # Clamped from below too: a NaN becomes the most negative integer.
    k = lookup[at(max(min(int((value - ends[0]) * bins), lookup.size - 1), 0))]
    # Nearly every bin holds one end, and on which side of it the value lies is not to be guessed: no branch.
    k = min(k + int(value >= ends[at(k + 1)]), ends.size - 3)
    while value >= ends[at(k + 1)] and k < ends.size - 3:
        k += 1
    return k


@inner()
def cell_at(cells, u, v):
    """Indices of the cell that holds a place between the ends."""
    return span(u, cells.ends_u, cells.lookup_u, cells.bins_u), span(v, cells.ends_v, cells.lookup_v, cells.bins_v)


@inner(fastmath={"contract"}, forceinline=True)
def horner(powers, flat, base, a, b):
    """A polynomial in a and b, whose coefficients begin at base, highest powers first, and its derivatives by a and by b."""
    value = along_a = along_b = 0.0
    for r in range(powers):
        row = flat[base + r]
        slope = 0.0
        for c in range(1, powers):
            slope = slope * b + row
            row = row * b + flat[base + c * pitch(powers) + r]
        along_a = along_a * a + value
        value = value * a + row
        along_b = along_b * a + slope
    return value, along_a, along_b


@inner(fastmath={"contract"}, forceinline=True)
def _locate(powers, cells, x, y, q):
    """Where the coefficients of the cell nearest to (x, y) begin, and that place from the cell's middle; the place into q."""
    ends_x, ends_y = cells.ends_u, cells.ends_v
    x, y = clamp(x, ends_x[0], ends_x[-2]), clamp(y, ends_y[0], ends_y[-2])
    i, j = cell_at(cells, x, y)
    q[AT_X], q[AT_Y] = x, y
    return at((i * (ends_y.size - 2) + j) * powers * pitch(powers)), x - cells.middle_u[i], y - cells.middle_v[j]


@inner(fastmath={"contract"}, forceinline=True)
def expand(powers, flat, base, a, b, q):
    """A polynomial in a and b, whose coefficients begin at base, its derivatives and half its second ones into q, from Z on."""
    z = z_a = z_b = z_aa = z_ab = z_bb = 0.0
    for r in range(powers):
        row, slope, bend = flat[base + r], 0.0, 0.0
        for c in range(1, powers):
            bend = bend * b + slope
            slope = slope * b + row
            row = row * b + flat[base + c * pitch(powers) + r]
        z_aa = z_aa * a + z_a
        z_a = z_a * a + z
        z = z * a + row
        z_ab = z_ab * a + z_b
        z_b = z_b * a + slope
        z_bb = z_bb * a + bend
    q[Z], q[Z_X], q[Z_Y], q[HALF_XX], q[XY], q[HALF_YY] = z, z_a, z_b, z_aa, z_ab, z_bb


@inner(fastmath={"contract"}, forceinline=True)
def taylor(powers, cells, x, y, q):
    """z, z_x, z_y, z_xx/2, z_xy, z_yy/2 at the point of a height field nearest to (x, y), then that point's x and y: q (8,)."""
    base, a, b = _locate(powers, cells, x, y, q)
    expand(powers, cells.coefficients, base, a, b, q)


@inner(fastmath={"contract"})
def taylor_of_any(cells, x, y, q):
    """`taylor` where the number of powers is known only at run time.

    Those of degrees 3, 5 and 7 are written down, so that their loops unroll: one compiled function serves for all.
    """
    base, a, b = _locate(cells.powers, cells, x, y, q)
    if cells.powers == 6:
        expand(6, cells.coefficients, base, a, b, q)
    elif cells.powers == 4:
        expand(4, cells.coefficients, base, a, b, q)
    elif cells.powers == 8:
        expand(8, cells.coefficients, base, a, b, q)
    else:
        expand(cells.powers, cells.coefficients, base, a, b, q)
