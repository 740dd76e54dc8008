"""What rays see of a picture on a plane z = const, linear between its elements: sixteen rays at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from raytrace.kernels.blocks import BLOCK, DX, DY, DZ, OX, OY, OZ, RX, RY, RZ, V0, V1, V2, T, X, Y, at, clamp, work
from raytrace.kernels.compiled import compiled, inner
from raytrace.kernels.lanes import load_three
from raytrace.kernels.outcomes import HIT
from raytrace.kernels.vectors import RAYS

Array = NDArray[np.float64]

ELEMENT = 3  # bytes: red, green and blue
WORD = 8  # bytes that are read at once: an element, its neighbour on the right, and two more
LEAST = 2  # rows and columns that are kept of a picture: of one alone, twice the same


class OnPlane(NamedTuple):
    """A picture on a plane, seen in a mirror: its left is at the largest X.

    Attributes
    ----------
    picture : its bytes, row by row, LEAST rows and columns at least.
    columns, rows : how many elements it has.
    x_max, y_max : where its left and top are, mm.
    per_mm : elements a mm.
    """

    picture: NDArray[np.uint8]
    columns: int
    rows: int
    x_max: float
    y_max: float
    per_mm: float

    @staticmethod
    def of(picture: NDArray[np.uint8], x_max: float, y_max: float, per_mm: float) -> OnPlane:
        """That of a picture (rows, columns, 3)."""
        rows, columns, _ = picture.shape
        if min(rows, columns) < LEAST:
            picture = np.pad(picture, ((0, max(0, LEAST - rows)), (0, max(0, LEAST - columns)), (0, 0)), mode="edge")
        return OnPlane(picture.ravel(), columns, rows, x_max, y_max, per_mm)


NOTHING = OnPlane(np.zeros(0, dtype=np.uint8), 1, 0, 0.0, 0.0, 1.0)


@intrinsic
def _word(typing_context, picture, begin):
    """Eight bytes of a picture, the first lowest."""
    def generate(context, builder, signature, arguments):
        data = cgutils.create_struct_proxy(signature.args[0])(context, builder, arguments[0]).data
        place = builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(64).as_pointer())
        return builder.load(place, align=1)

    return types.int64(picture, begin), generate


@inner()
def _land(place, z, w):
    """Where a block's rays meet the plane: columns and rows, from the middle of the first element, into the rows V0 and V1.

    Row V2 becomes 1 for rays without a colour that the picture has one for, else 0. Returns its sum.
    """
    count = 0
    for m in range(BLOCK):
        t = (z - w[OZ + m]) / w[DZ + m]
        column = (place.x_max - w[OX + m] - t * w[DX + m]) * place.per_mm - 0.5
        row = (place.y_max - w[OY + m] - t * w[DY + m]) * place.per_mm - 0.5
        across = (column >= -0.5) & (column <= place.columns - 0.5)
        down = (row >= -0.5) & (row <= place.rows - 0.5) & (place.rows > 0)
        met = (w[T + m] > 0.0) & (t > 0.0) & (t < np.inf) & across & down
        w[V0 + m] = clamp(column, 0.0, place.columns - 1.0) if met else 0.0
        w[V1 + m] = clamp(row, 0.0, place.rows - 1.0) if met else 0.0
        w[V2 + m] = 1.0 if met else 0.0
        count += int(met)
    return count


@inner()
def _blend(place, w, words):
    """Colours at columns V0 and rows V1 into the rows RX, RY, RZ where V2 says so."""
    picture, pitch = place.picture, ELEMENT * max(place.columns, LEAST)
    last = picture.size - WORD
    for m in range(BLOCK):
        i = min(np.int64(w[V1 + m]), max(place.rows, LEAST) - 2)
        j = min(np.int64(w[V0 + m]), max(place.columns, LEAST) - 2)
        w[X + m], w[Y + m] = w[V0 + m] - j, w[V1 + m] - i
        words[m] = ELEMENT * j + pitch * i
    for m in range(BLOCK):
        begin = at(words[m])
        beneath = min(begin + pitch, last)  # the word of the last element of all would go beyond the picture
        words[m] = _word(picture, begin)
        words[BLOCK + m] = _word(picture, beneath) >> 8 * (begin + pitch - beneath)
    for m in range(BLOCK):
        across, down, upper, lower, met = w[X + m], w[Y + m], words[m], words[BLOCK + m], w[V2 + m] > 0.0
        here, right = (1.0 - down) * (1.0 - across), (1.0 - down) * across
        beneath, corner = down * (1.0 - across), down * across
        red = (here * (upper & 255) + right * (upper >> 24 & 255)
               + beneath * (lower & 255) + corner * (lower >> 24 & 255))
        green = (here * (upper >> 8 & 255) + right * (upper >> 32 & 255)
                 + beneath * (lower >> 8 & 255) + corner * (lower >> 32 & 255))
        blue = (here * (upper >> 16 & 255) + right * (upper >> 40 & 255)
                + beneath * (lower >> 16 & 255) + corner * (lower >> 40 & 255))
        w[RX + m], w[RY + m], w[RZ + m] = (red if met else w[RX + m], green if met else w[RY + m], blue if met else w[RZ + m])
        w[T + m] = 0.0 if met else w[T + m]


@compiled(nogil=True, _nrt=False)
def _add_colours(w, words, status, points, directions, z, inner, outer, background, beside, sums, samples):
    rays, pixel, taken = status.size, 0, 0
    for start in range(0, rays, BLOCK):
        count = min(BLOCK, rays - start)
        n, k = at(start), at(3 * start)
        if count == BLOCK:
            for m in range(0, BLOCK, RAYS):
                load_three(points, k + 3 * m, w, OX + m, OY + m, OZ + m)
                load_three(directions, k + 3 * m, w, DX + m, DY + m, DZ + m)
        else:
            for m in range(count):
                r = at(k + 3 * m)
                w[OX + m], w[OY + m], w[OZ + m] = points[r], points[r + 1], points[r + 2]
                w[DX + m], w[DY + m], w[DZ + m] = directions[r], directions[r + 1], directions[r + 2]
        left = 0  # without a colour, which row T tells
        for m in range(BLOCK):
            reflected = m < count and status[n + min(m, count - 1)] == HIT
            w[T + m] = 1.0 if reflected else 0.0
            w[RX + m] = beside[0] if reflected else background[0]
            w[RY + m] = beside[1] if reflected else background[1]
            w[RZ + m] = beside[2] if reflected else background[2]
            left += int(reflected)
        for place in (inner, outer):
            met = _land(place, z, w) if left > 0 else 0
            if met > 0:
                _blend(place, w, words)
            left -= met
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
