"""Polynomials of rays that each have a cell of their own, in vector instructions that are written down.

LLVM makes vectors of a loop over rays where all read the same coefficients. Where each ray reads its own it goes one number at
a time, three times as slowly: a gather costs more than it saves. Here a ray's coefficients are the vectors, one for each power
of b with a lane for each power of a. What eight rays have in these lanes is then turned about, and the rest goes ray by ray
side by side.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, register_jitable

RAYS = 8  # taken together: as many numbers as the widest vectors have
FUSED = ("contract",)  # a·b + c is rounded once where the processor can, as in the other kernels
DOUBLE, INT64, INT32 = ir.DoubleType(), ir.IntType(64), ir.IntType(32)


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
            by = _spread(builder, load(rows, at_b, ray, DOUBLE), wide)
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


def _spread(builder, number, kind):
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), number, INT32(0))
    return _picked(builder, one, one, [0] * kind.count)


def _picked(builder, a, b, lanes):
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(INT32, len(lanes)), lanes))


def _turned(builder, vectors, count):
    """The first `count` lanes of RAYS vectors, each as a vector with a lane for each of those."""
    last = vectors[0].type.count - 1
    columns = []
    for first in range(0, count, RAYS):
        parts = [_picked(builder, v, v, [min(first + k, last) for k in range(RAYS)]) for v in vectors]
        for side in (1, 2, 4):  # in squares of 2·side, the two quarters beside the diagonal change places
            lanes = [lane + (RAYS - side if lane & side else 0) for lane in range(RAYS)]
            parts = [_picked(builder, parts[k & ~side], parts[k | side], [lane + (k & side) for lane in lanes])
                     for k in range(RAYS)]
        columns += parts[:count - first]
    return columns
