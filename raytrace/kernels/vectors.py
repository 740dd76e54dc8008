"""Eight numbers as one value of compiled code: arithmetic on them is one vector instruction for each operation.

LLVM makes vectors of some loops over a block of rays, and of others, the shortest, sixteen steps one after the other. Here
they are written down: `eight(w, X + m)` is what stands in a row from ray m on, and `put` writes such a value back.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model

RAYS = 8  # taken together: as many numbers as the widest vectors have
DOUBLE, INT64, INT32 = ir.DoubleType(), ir.IntType(64), ir.IntType(32)
NUMBERS, TRUTHS = ir.VectorType(DOUBLE, RAYS), ir.VectorType(ir.IntType(1), RAYS)


class Eight(types.Type):
    """Of eight numbers; a number is taken for eight of it."""

    def unify(self, typingctx: Any, other: types.Type) -> types.Type | None:
        """Eight, with a number."""
        return self if isinstance(other, types.Float) else None


class EightTruths(types.Type):
    """Of what comparing eight numbers gives."""


numbers, truths = Eight("Eight"), EightTruths("EightTruths")


@register_model(Eight)
class _Numbers(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: types.Type) -> None:
        super().__init__(manager, kind, NUMBERS)


@register_model(EightTruths)
class _Truths(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: types.Type) -> None:
        super().__init__(manager, kind, TRUTHS)


@lower_cast(types.Float, Eight)
def _number_to_eight(context: Any, builder: Any, of: Any, to: Any, value: Any) -> Any:
    return spread(builder, context.cast(builder, value, of, types.float64), NUMBERS)


# --- operators ------------------------------------------------------------------------------------------------------------


def _operator(function: Any, arity: int, of: types.Type, result: types.Type, build: Any) -> None:
    """Let an operator take values of a type, some of which may be plain numbers."""
    class Typed(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) == arity and of in args and all(each == of or (of is numbers and isinstance(each, types.Float))
                                                         for each in args):
                return signature(result, *[of] * arity)
            return None

    infer_global(function)(Typed)
    lower_builtin(function, *[of] * arity)(lambda context, builder, signature, values: build(builder, *values))


_operator(operator.neg, 1, numbers, numbers, lambda builder, a: builder.fneg(a))
for _function, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv")):
    _operator(_function, 2, numbers, numbers, lambda builder, a, b, name=_name: getattr(builder, name)(a, b))
for _function, _name in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
    _operator(_function, 2, numbers, truths, lambda builder, a, b, name=_name: builder.fcmp_ordered(name, a, b))
for _function, _name in ((operator.and_, "and_"), (operator.or_, "or_")):
    _operator(_function, 2, truths, truths, lambda builder, a, b, name=_name: getattr(builder, name)(a, b))


# --- functions ------------------------------------------------------------------------------------------------------------


@intrinsic
def eight(typing_context, array, index):
    """Eight numbers of an array from an index on, which is not looked at: none counts from the end."""
    def generate(context, builder, signature, arguments):
        return builder.load(place(context, builder, signature.args[0], *arguments), align=8)

    return numbers(array, types.int64), generate


@intrinsic
def put(typing_context, array, index, value):
    """Write eight numbers to an array, from an index on."""
    def generate(context, builder, signature, arguments):
        builder.store(arguments[2], place(context, builder, signature.args[0], *arguments[:2]), align=8)
        return context.get_dummy_value()

    return types.void(array, types.int64, numbers), generate


@intrinsic
def where(typing_context, condition, a, b):
    """The numbers of a where the condition is true, else those of b."""
    return numbers(truths, numbers, numbers), lambda context, builder, signature, arguments: builder.select(*arguments)


@intrinsic
def minimum(typing_context, a, b):
    """The lesser of each two numbers; that of b where one is NaN."""
    return numbers(numbers, numbers), lambda context, builder, signature, arguments: _lesser(builder, *arguments)


@intrinsic
def maximum(typing_context, a, b):
    """The greater of each two numbers; that of b where one is NaN."""
    return numbers(numbers, numbers), lambda context, builder, signature, arguments: _greater(builder, *arguments)


@intrinsic
def root(typing_context, a):
    """Square roots."""
    return numbers(numbers), lambda context, builder, signature, arguments: _called(builder, "llvm.sqrt.v8f64", arguments[0])


@intrinsic
def size(typing_context, a):
    """Absolute values."""
    return numbers(numbers), lambda context, builder, signature, arguments: _called(builder, "llvm.fabs.v8f64", arguments[0])


@intrinsic
def count_of(typing_context, condition):
    """How many of eight are true."""
    def generate(context, builder, signature, arguments):
        bits = builder.bitcast(arguments[0], ir.IntType(RAYS))
        return builder.zext(_called(builder, "llvm.ctpop.i8", bits), INT64)

    return types.int64(truths), generate


@intrinsic
def ends_of(typing_context, a_low, a_high, b_low, b_high):
    """The least of eight numbers, the greatest of eight, and the same once more. A NaN may give anything."""
    def generate(context, builder, signature, arguments):
        # Half of one beside half of the other: each step is then one of both.
        lower, upper = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
        found = []
        for of_two, a, b in ((_lesser, *arguments[::2]), (_greater, *arguments[1::2])):
            kept = of_two(builder, picked(builder, a, b, lower), picked(builder, a, b, upper))
            for side in (2, 1):
                kept = of_two(builder, kept, picked(builder, kept, kept, [lane ^ side for lane in range(RAYS)]))
            found.append(kept)
        return context.make_tuple(builder, signature.return_type, [
            builder.extract_element(kept, INT32(lane)) for lane in (0, 4) for kept in found])

    return types.UniTuple(types.float64, 4)(numbers, numbers, numbers, numbers), generate


# --- as the code generator has them ---------------------------------------------------------------------------------------


def place(context: Any, builder: Any, kind: types.Array, array: Any, index: Any, offset: int = 0) -> Any:
    """A pointer to eight numbers of an array, from an index and an offset on."""
    data = cgutils.create_struct_proxy(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [builder.add(index, INT64(offset))]), NUMBERS.as_pointer())


def spread(builder: Any, number: Any, kind: ir.VectorType) -> Any:
    """A vector of one number."""
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), number, INT32(0))
    return picked(builder, one, one, [0] * kind.count)


def picked(builder: Any, a: Any, b: Any, lanes: list[int]) -> Any:
    """The numbers of a, and of b after them, that are at these places."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(INT32, len(lanes)), lanes))


def _called(builder: Any, name: str, value: Any) -> Any:
    kind = ir.FunctionType(value.type, [value.type])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), [value])


def _lesser(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered("<", a, b), a, b)


def _greater(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)
