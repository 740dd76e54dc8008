"""Polynomials of rays that each have a cell of their own, in vector instructions that are written down.

LLVM makes vectors of a loop over rays where all read the same coefficients. Where each ray reads its own it goes one number at
a time, three times as slowly: a gather costs more than it saves. Here a ray's coefficients are the vectors, one for each power
of b with a lane for each power of a. What eight rays have in these lanes is then turned about, and the rest goes ray by ray
side by side. Vectors (x, y, z, x, …) become rows, and rows such vectors, in the same way.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, register_jitable

from raytrace.kernels.vectors import DOUBLE, INT64, RAYS, picked, place, spread

FUSED = ("contract",)  # a·b + c is rounded once where the processor can, as in the other kernels


@register_jitable
def pitch(powers: int) -> int:
    """How many numbers apart the rows of a cell's coefficients begin: whole vectors, of four at the least."""
    return (powers + 3) // 4 * 4


@intrinsic(prefer_literal=True)
def horner_apart(typing_context, powers, flat, w, lanes, base, a, b, value, along_a, along_b):
    """Polynomials in a and b and their derivatives, of RAYS lanes of w from `lanes` on.

    The last six are offsets of rows of w: of where in `flat` a ray's coefficients begin, of its a and b, and of where the
    results go. Every step is one of `raytrace.kernels.cells.horner`.
    """
    count = powers.literal_value
    wide, many = ir.VectorType(DOUBLE, pitch(count)), ir.VectorType(DOUBLE, RAYS)

    def generate(context, builder, signature, arguments):
        coefficients, rows = (cgutils.create_struct_proxy(kind)(context, builder, array).data
                              for kind, array in zip(signature.args[1:3], arguments[1:3], strict=True))
        begins, at_a, at_b, *results = (builder.add(arguments[3], row) for row in arguments[4:])

        def place(array, index, offset, kind):
            return builder.bitcast(builder.gep(array, [builder.add(index, INT64(offset))]), kind.as_pointer())

        def load(array, index, offset, kind):
            return builder.load(place(array, index, offset, kind), align=8)

        def step(so_far, by, term):
            return builder.fadd(builder.fmul(so_far, by, flags=FUSED), term, flags=FUSED)

        rows_of, slopes_of = [], []
        for ray in range(RAYS):
            begin = builder.fptosi(load(rows, begins, ray, DOUBLE), INT64)
            by = spread(builder, load(rows, at_b, ray, DOUBLE), wide)
            slope = load(coefficients, begin, 0, wide)
            row = step(slope, by, load(coefficients, begin, wide.count, wide))
            for power in range(2, count):
                slope = step(slope, by, row)
                row = step(row, by, load(coefficients, begin, power * wide.count, wide))
            rows_of.append(row)
            slopes_of.append(slope)
        by = load(rows, at_a, 0, many)
        (slope, *rest), (beside, *beside_rest) = _turned(builder, rows_of, count), _turned(builder, slopes_of, count)
        found, beside = step(slope, by, rest[0]), step(beside, by, beside_rest[0])
        for row, across in zip(rest[1:], beside_rest[1:], strict=True):
            slope = step(slope, by, found)
            found, beside = step(found, by, row), step(beside, by, across)
        for row, result in zip(results, (found, slope, beside), strict=True):
            builder.store(result, place(rows, row, 0, many), align=8)
        return context.get_dummy_value()

    return types.void(powers, flat, w, lanes, base, a, b, value, along_a, along_b), generate


@intrinsic
def load_three(typing_context, array, index, w, x, y, z):
    """RAYS vectors of a flat array (x, y, z, x, …), of which the first begins at an index, into rows of w."""
    def generate(context, builder, signature, arguments):
        (given, index, rows), (of_given, _, of_rows) = arguments[:3], signature.args[:3]
        parts = [builder.load(place(context, builder, of_given, given, index, RAYS * k), align=8) for k in range(3)]
        for c, row in enumerate(arguments[3:]):
            lanes = [3 * k + c for k in range(RAYS)]
            first = picked(builder, parts[0], parts[1], [min(lane, 2 * RAYS - 1) for lane in lanes])
            all_ = picked(builder, first, parts[2], [k if lane < 2 * RAYS else lane - RAYS for k, lane in enumerate(lanes)])
            builder.store(all_, place(context, builder, of_rows, rows, row), align=8)
        return context.get_dummy_value()

    return types.void(array, index, w, x, y, z), generate


@intrinsic
def store_three(typing_context, array, index, w, x, y, z):
    """RAYS vectors out of rows of w into a flat array (x, y, z, x, …), the first to an index."""
    def generate(context, builder, signature, arguments):
        (to, index, rows), (of_to, _, of_rows) = arguments[:3], signature.args[:3]
        x, y, z = (builder.load(place(context, builder, of_rows, rows, row), align=8) for row in arguments[3:])
        for part in range(3):
            lanes = [divmod(RAYS * part + k, 3) for k in range(RAYS)]  # of which ray, and which of its coordinates
            two = picked(builder, x, y, [ray + (RAYS if c == 1 else 0) for ray, c in lanes])
            three = picked(builder, two, z, [RAYS + ray if c == 2 else k for k, (ray, c) in enumerate(lanes)])
            builder.store(three, place(context, builder, of_to, to, index, RAYS * part), align=8)
        return context.get_dummy_value()

    return types.void(array, index, w, x, y, z), generate


def _turned(builder, vectors, count):
    """The first `count` lanes of RAYS vectors, each as a vector with a lane for each of those."""
    last = vectors[0].type.count - 1
    columns = []
    for first in range(0, count, RAYS):
        parts = [picked(builder, v, v, [min(first + k, last) for k in range(RAYS)]) for v in vectors]
        for side in (1, 2, 4):  # in squares of 2·side, the two quarters beside the diagonal change places
            lanes = [lane + (RAYS - side if lane & side else 0) for lane in range(RAYS)]
            parts = [picked(builder, parts[k & ~side], parts[k | side], [lane + (k & side) for lane in lanes])
                     for k in range(RAYS)]
        columns += parts[:count - first]
    return columns
