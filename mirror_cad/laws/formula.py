"""Compile a formula in t and x to a function on arrays; nothing but arithmetic is ever run."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SpecError

Array = NDArray[np.float64]
Formula = Callable[[Array, Array], Array]

LONGEST = 1000  # characters: far more than a law needs, far less than a parser can be made to choke on
DEEPEST = 100  # levels of nesting: evaluation calls itself once a level

_BINARY: dict[type[ast.operator], Callable[[Array, Array], Array]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_FUNCTIONS: dict[str, tuple[Callable[..., Array], int | None]] = {
    "sqrt": (np.sqrt, 1),
    "exp": (np.exp, 1),
    "log": (np.log, 1),
    "sin": (np.sin, 1),
    "cos": (np.cos, 1),
    "tanh": (np.tanh, 1),
    "min": (lambda *arguments: np.minimum.reduce(np.broadcast_arrays(*arguments)), None),
    "max": (lambda *arguments: np.maximum.reduce(np.broadcast_arrays(*arguments)), None),
}
_NAMES = "t, x and pi"
_KNOWN = "+ − * / **, " + ", ".join(_FUNCTIONS) + ", numbers, " + _NAMES


def parse_formula(text: str) -> Formula:
    """Turn a formula in t (1) and x (mm) into f(t, x) on float64 arrays of one shape.

    Values are not checked here: 1/0 gives inf.

    Raises
    ------
    SpecError
        Naming the first part that is not arithmetic.
    """
    if len(text) > LONGEST:
        raise SpecError(f"the formula has {len(text)} characters, at most {LONGEST} are read: use a table law instead")
    try:
        tree = ast.parse(text.strip(), mode="eval")
        _check(tree.body)
    except (SyntaxError, ValueError) as error:
        why = error.msg if isinstance(error, SyntaxError) else error  # without the parser's line: a formula has one
        raise SpecError(f"the formula {text!r} cannot be read: {why}; it may hold {_KNOWN}") from None
    except (RecursionError, MemoryError):
        raise SpecError("the formula is nested too deeply: write it with fewer brackets") from None

    def formula(t: Array, x: Array) -> Array:
        names: dict[str, Array | np.float64] = {"t": t, "x": x, "pi": np.float64(np.pi)}
        with np.errstate(all="ignore"):
            return np.asarray(_evaluate(tree.body, names), dtype=np.float64) + np.zeros(np.shape(x))

    return formula


def _refuse(node: ast.expr, what: str) -> SpecError:
    return SpecError(f"the formula holds {what} at column {node.col_offset + 1}: it may hold {_KNOWN}")


def _check(node: ast.expr, depth: int = 0) -> None:
    if depth > DEEPEST:
        raise RecursionError
    match node:
        case ast.Constant(value=bool()):
            raise _refuse(node, f"{node.value!r}")
        case ast.Constant(value=int() | float() as value):
            if abs(value) > np.finfo(np.float64).max:
                raise _refuse(node, "a number too large")
        case ast.Name(id=name):
            if name not in ("t", "x", "pi"):
                raise _refuse(node, f"the unknown name {name!r}")
        case ast.UnaryOp(op=ast.UAdd() | ast.USub()):
            _check(node.operand, depth + 1)
        case ast.BinOp() if type(node.op) in _BINARY:
            _check(node.left, depth + 1)
            _check(node.right, depth + 1)
        case ast.BinOp(op=ast.BitXor()):
            raise _refuse(node, "'^' (a power is written '**')")
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in _FUNCTIONS:
            count = _FUNCTIONS[name][1]
            if (count is not None and len(arguments) != count) or len(arguments) == 0:
                raise _refuse(node, f"{name}() with {len(arguments)} arguments")
            for argument in arguments:
                _check(argument, depth + 1)
        case ast.Call():
            raise _refuse(node, f"a call to {ast.unparse(node.func)!r}")
        case _:
            raise _refuse(node, f"{ast.unparse(node)!r}")


def _evaluate(node: ast.expr, names: dict[str, Array | np.float64]) -> Array | np.float64:
    match node:
        case ast.Constant(value=value):
            return np.float64(value)  # type: ignore[arg-type]  # _check let only numbers pass
        case ast.Name(id=name):
            return names[name]
        case ast.UnaryOp():
            operand = _evaluate(node.operand, names)
            return -operand if isinstance(node.op, ast.USub) else operand
        case ast.BinOp():
            return _BINARY[type(node.op)](_evaluate(node.left, names), _evaluate(node.right, names))  # type: ignore[arg-type]
        case ast.Call(func=ast.Name(id=name)):
            return _FUNCTIONS[name][0](*(_evaluate(argument, names) for argument in node.args))
    raise AssertionError(f"unchecked node {node!r}")
