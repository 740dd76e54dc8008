"""Formulas of a law: Python's own arithmetic without Python, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mirror_cad
from mirror_cad.laws.formula import DEEPEST, LONGEST, parse_formula

T = np.linspace(0.0, 1.0, 7)
X = np.linspace(-115.0, 115.0, 7)
NAMES = {"sqrt": np.sqrt, "exp": np.exp, "log": np.log, "sin": np.sin, "cos": np.cos, "tanh": np.tanh, "pi": math.pi,
         "min": lambda *a: np.minimum.reduce(np.broadcast_arrays(*a)),
         "max": lambda *a: np.maximum.reduce(np.broadcast_arrays(*a))}


@pytest.mark.parametrize("text", [
    "1250 - 850*t", "-t**2 + +x/3 - -2", "2**3**0.5", "10 - 4 - 3", "8/4/2", "min(t, 0.5, x) + max(t, 0.2)",
    "sqrt(t) + exp(-t)", "log(1 + t)*sin(pi*t)/cos(x/100)", "tanh(x/40)", "7", "-(t - 1)*(x + 2)",
])
def test_a_formula_is_what_python_makes_of_it(text: str) -> None:
    ours = parse_formula(text)(T, X)
    theirs = np.broadcast_to(eval(text, {"__builtins__": {}}, NAMES | {"t": T, "x": X}), T.shape)  # the test's own texts
    assert ours.shape == T.shape
    assert ours == pytest.approx(theirs, rel=1e-15)


@pytest.mark.parametrize("nested", [
    lambda n: "-" * n + "t", lambda n: "(" * n + "t" + " + 1)" * n, lambda n: "t + (" * n + "1" + ")" * n,
    lambda n: "1" + " + t" * n,
])
def test_a_formula_may_be_nested_as_deep_as_said_and_no_deeper(nested: object) -> None:
    assert np.isfinite(parse_formula(nested(DEEPEST))(T, X)).all()  # type: ignore[operator]
    with pytest.raises(mirror_cad.SpecError, match="nested too deeply"):
        parse_formula(nested(DEEPEST + 1))  # type: ignore[operator]


def test_a_formula_may_be_as_long_as_said_and_no_longer() -> None:
    assert parse_formula("t" + " " * (LONGEST - 1))(T, X) == pytest.approx(T)
    with pytest.raises(mirror_cad.SpecError, match=f"has {LONGEST + 1} characters"):
        parse_formula("t" + " " * LONGEST)


def test_what_is_refused_is_named_with_its_column() -> None:
    with pytest.raises(mirror_cad.SpecError, match=r"unknown name 'y' at column 5"):
        parse_formula("t + y")
    with pytest.raises(mirror_cad.SpecError, match=r"sin\(\) with 2 arguments at column 1"):
        parse_formula("sin(t, x)")
