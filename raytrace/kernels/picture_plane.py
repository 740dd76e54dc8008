"""What rays see of a picture on a plane z = const, linear between its elements: sixteen at a time that all see one picture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from raytrace.kernels.blocks import BLOCK, DX, DY, DZ, OX, OY, OZ, RX, RY, RZ, V0, V1, X, Y, at, clamp, work
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.lanes import RAYS, load_three
from raytrace.kernels.outcomes import HIT

Array = NDArray[np.float64]

ELEMENT = 3  # bytes: red, green and blue
WORD = 8  # bytes that are read at once: an element, its neighbour on the right, and two more


class OnPlane(NamedTuple):
    """A picture on a plane: its bytes, columns and rows, where its left and top are, mm, and elements a mm.

    It is seen in a mirror: its left is at the largest X.
    """

    picture: NDArray[np.uint8]
    columns: int
    rows: int
    x_max: float
    y_max: float
    per_mm: float


NOTHING = OnPlane(np.zeros(0, dtype=np.uint8), 1, 0, 0.0, 0.0, 1.0)


@intrinsic
def _word(typing_context, picture, begin):
    """Eight bytes of a picture, the first lowest."""
    def generate(context, builder, signature, arguments):
        data = cgutils.create_struct_proxy(signature.args[0])(context, builder, arguments[0]).data
        place = builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(64).as_pointer())
        return builder.load(place, align=1)

    return types.int64(picture, begin), generate


@inner(forceinline=True)
def _landing(place, z, w, m):
    """Column and row where lane m meets the plane, from the middle of the first element; whether they lie on the picture."""
    t = (z - w[OZ + m]) / w[DZ + m]
    column = (place.x_max - w[OX + m] - t * w[DX + m]) * place.per_mm - 0.5
    row = (place.y_max - w[OY + m] - t * w[DY + m]) * place.per_mm - 0.5
    across = (column >= -0.5) & (column <= place.columns - 0.5)
    down = (row >= -0.5) & (row <= place.rows - 0.5) & (place.rows > 0)
    return column, row, (t > 0.0) & (t < np.inf) & across & down


@inner()
def _land(place, z, w):
    """Columns and rows of a block, within the picture, into the rows V0 and V1; how many lie on the picture."""
    count = 0
    for m in range(BLOCK):
        column, row, on = _landing(place, z, w, m)
        count += int(on)
        w[V0 + m], w[V1 + m] = clamp(column, 0.0, place.columns - 1.0), clamp(row, 0.0, place.rows - 1.0)
    return count


@inner()
def _blend(place, w, words):
    """Colours of a block at columns V0 and rows V1 into the rows RX, RY, RZ; for pictures of two rows and columns at least."""
    picture, columns = place.picture, place.columns
    below, last = ELEMENT * columns, picture.size - WORD
    for m in range(BLOCK):
        i, j = min(np.int64(w[V1 + m]), place.rows - 2), min(np.int64(w[V0 + m]), columns - 2)
        w[X + m], w[Y + m] = w[V0 + m] - j, w[V1 + m] - i
        words[m] = ELEMENT * (i * columns + j)
    for m in range(BLOCK):
        begin = at(words[m])
        beneath = min(begin + below, last)  # the word of the last element of all would go beyond the picture
        words[m] = _word(picture, begin)
        words[BLOCK + m] = _word(picture, beneath) >> 8 * (begin + below - beneath)
    for m in range(BLOCK):
        across, down, upper, lower = w[X + m], w[Y + m], words[m], words[BLOCK + m]
        here, right = (1.0 - down) * (1.0 - across), (1.0 - down) * across
        beneath, corner = down * (1.0 - across), down * across
        w[RX + m] = (here * (upper & 255) + right * (upper >> 24 & 255)
                     + beneath * (lower & 255) + corner * (lower >> 24 & 255))
        w[RY + m] = (here * (upper >> 8 & 255) + right * (upper >> 32 & 255)
                     + beneath * (lower >> 8 & 255) + corner * (lower >> 32 & 255))
        w[RZ + m] = (here * (upper >> 16 & 255) + right * (upper >> 40 & 255)
                     + beneath * (lower >> 16 & 255) + corner * (lower >> 40 & 255))


@inner()
def _colour(place, column, row):
    """`_blend` for one place; the picture may have one row or column."""
    picture, columns, rows = place.picture, place.columns, place.rows
    right, below = ELEMENT * min(columns - 1, 1), ELEMENT * columns * min(rows - 1, 1)  # from an element to the next ones
    column, row = clamp(column, 0.0, columns - 1.0), clamp(row, 0.0, rows - 1.0)
    i, j = min(int(row), max(rows - 2, 0)), min(int(column), max(columns - 2, 0))
    across, down = column - j, row - i
    m = at(ELEMENT * (i * columns + j))
    here, beside = (1.0 - down) * (1.0 - across), (1.0 - down) * across
    beneath, corner = down * (1.0 - across), down * across
    return (here * picture[m] + beside * picture[m + right]
            + beneath * picture[m + below] + corner * picture[m + below + right],
            here * picture[m + 1] + beside * picture[m + right + 1]
            + beneath * picture[m + below + 1] + corner * picture[m + below + right + 1],
            here * picture[m + 2] + beside * picture[m + right + 2]
            + beneath * picture[m + below + 2] + corner * picture[m + below + right + 2])


@inner()
def _one_by_one(status, start, count, z, inner, outer, background, beside, w):
    """Colours of a block's rays of which not all see the same picture into the rows RX, RY, RZ."""
    for m in range(count):
        if status[start + m] != HIT:
            w[RX + m], w[RY + m], w[RZ + m] = background[0], background[1], background[2]
            continue
        column, row, on = _landing(inner, z, w, m)
        if on:
            w[RX + m], w[RY + m], w[RZ + m] = _colour(inner, column, row)
            continue
        column, row, on = _landing(outer, z, w, m)
        if on:
            w[RX + m], w[RY + m], w[RZ + m] = _colour(outer, column, row)
        else:
            w[RX + m], w[RY + m], w[RZ + m] = beside[0], beside[1], beside[2]


@compiled(nogil=True, _nrt=False)
def _add_colours(w, words, status, points, directions, z, inner, outer, background, beside, sums, samples):
    rays, pixel, taken = status.size, 0, 0
    blends = inner.columns > 1 and inner.rows > 1
    blends_outer = outer.columns > 1 and outer.rows > 1
    for start in range(0, rays, BLOCK):
        count = min(BLOCK, rays - start)
        k, hits = at(3 * start), 0
        if count == BLOCK:
            for m in range(0, BLOCK, RAYS):
                load_three(points, k + 3 * m, w, OX + m, OY + m, OZ + m)
                load_three(directions, k + 3 * m, w, DX + m, DY + m, DZ + m)
            for m in range(BLOCK):
                hits += int(status[at(start) + m] == HIT)
        else:
            for m in range(count):
                n = at(k + 3 * m)
                w[OX + m], w[OY + m], w[OZ + m] = points[n], points[n + 1], points[n + 2]
                w[DX + m], w[DY + m], w[DZ + m] = directions[n], directions[n + 1], directions[n + 2]
        on_inner = _land(inner, z, w) if hits == BLOCK and blends else 1
        if on_inner == BLOCK:
            _blend(inner, w, words)
        elif on_inner == 0 and blends_outer and _land(outer, z, w) == BLOCK:
            _blend(outer, w, words)
        else:
            _one_by_one(status, start, count, z, inner, outer, background, beside, w)
        for m in range(count):
            sums[pixel] += w[RX + m]
            sums[pixel + 1] += w[RY + m]
            sums[pixel + 2] += w[RZ + m]
            taken += 1
            if taken == samples:
                taken, pixel = 0, pixel + 3


def add_colours(status: NDArray[np.int8], points: Array, directions: Array, z: float, inner: OnPlane, outer: OnPlane,
                background: Array, beside: Array, sums: Array, samples: int) -> None:
    """Add the colours that rays see on the plane at z.

    Parameters
    ----------
    status : (n,); what is not HIT sees `background`.
    points, directions : (n, 3), mm and unit: whence the rays come.
    z : mm.
    inner, outer : the picture, and what is seen beside it; beside both, `beside`.
    background, beside : (3,), 0 to 255.
    sums : (n // samples, 3), what is added to.
    samples : how many rays in a row make one sum.
    """
    _add_colours(work().rows, np.empty(2 * BLOCK, dtype=np.int64), status, points.ravel(), directions.ravel(), z, inner, outer,
                 background, beside, sums.reshape(-1), samples)
