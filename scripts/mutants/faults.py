"""What a small fault is: one changed number, sign, operation or comparison in a formula, as Cosmic Ray plants it."""

from __future__ import annotations

import ast
import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import parso
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators import number_replacer, unary_operator_replacement
from cosmic_ray.operators.binary_operator_replacement import operators as arithmetic
from cosmic_ray.operators.comparison_operator_replacement import operators as comparisons
from cosmic_ray.operators.operator import Operator

ARITHMETIC = ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Pow_Mul")
COMPARISONS = ("Lt_LtE", "LtE_Lt", "Gt_GtE", "GtE_Gt", "Lt_Gt", "Eq_NotEq")
FACTOR = 1.001


class WholeNumberBesideIt(number_replacer.NumberReplacer):
    """An integer one more or less: an end left out, a neighbour's index."""

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        """Integers only."""
        if node.type == "number" and node.value.isdigit():
            yield from super().mutation_positions(node)


class NumberNearIt(Operator):
    """A float times 1.001: what only a closed form or an independent computation sees."""

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        """Floats only."""
        if node.type == "number" and re.fullmatch(r"\d*\.\d*(e-?\d+)?|\d+e-\d+", node.value) and float(node.value) != 0.0:
            yield node.start_pos, node.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        """The number times the factor."""
        return parso.python.tree.Number(f" {float(node.value) * FACTOR!r}", node.start_pos)

    @classmethod
    def examples(cls) -> tuple[Any, ...]:
        """None."""
        return ()


def _kinds() -> dict[str, list[Operator]]:
    named = {cls.__name__.split("_", 1)[1]: cls() for cls in (*arithmetic(), *comparisons()) if "_" in cls.__name__}
    signs = [cls() for cls in unary_operator_replacement.operators() if cls.__name__.endswith("USub_UAdd")]
    return {"arithmetic": [named[name] for name in ARITHMETIC], "comparison": [named[name] for name in COMPARISONS],
            "whole number": [WholeNumberBesideIt()], "number": [NumberNearIt()], "sign": signs}


@dataclass(frozen=True, slots=True)
class Fault:
    """A file with one change: its line (from 1), what kind, the line before and after, and the changed file's text."""

    path: str
    line: int
    kind: str
    before: str
    after: str
    text: str

    @property
    def name(self) -> str:
        """What tells it from others in a list of results; lines of text may come before it."""
        return f"{self.path}: {self.before} -> {self.after}"


def sampled(path: str, source: str, count: int, seed: int) -> list[Fault]:
    """`count` faults of a file, of all kinds in turn, no two on a line."""
    chance = random.Random(f"{seed} {path}")
    inside = _formulas(source)
    nodes, meaning = list(ast_nodes(get_ast(source))), ast.dump(ast.parse(source))
    waiting = []
    for kind, operators in _kinds().items():
        found = [(operator, k, start) for operator in operators for k, (start, _) in enumerate(
            position for node in nodes for position in operator.mutation_positions(node)) if start[0] in inside]
        chance.shuffle(found)
        waiting.append((kind, found))
    chance.shuffle(waiting)
    faults: list[Fault] = []
    while len(faults) < count and any(found for _, found in waiting):
        for kind, found in waiting:
            while found and len(faults) < count:
                operator, k, (line, column) = found.pop()
                if column not in inside[line] or any(line == other.line for other in faults):
                    continue
                text = mutate_code(source, operator, k)
                if text is not None and _means(text) not in (None, meaning):
                    faults.append(_fault(path, source, text, kind, line))
                    break
    return faults


def by_hand(path: str, source: str, old: str, new: str) -> Fault:
    """A stated fault: `old` stands once in the file and becomes `new`."""
    if source.count(old) != 1:
        raise SystemExit(f"{path}: {old!r} stands there {source.count(old)} times, not once: state the fault anew")
    return _fault(path, source, source.replace(old, new), "by hand", source[:source.index(old)].count("\n") + 1)


def _means(text: str) -> str | None:
    try:
        return ast.dump(ast.parse(text))
    except SyntaxError:
        return None


def _fault(path: str, source: str, text: str, kind: str, line: int) -> Fault:
    was, now = source.splitlines(), text.splitlines()
    changed = [k for k in range(min(len(was), len(now))) if was[k] != now[k]] or [line - 1]
    return Fault(path, changed[0] + 1, kind, was[changed[0]].strip(), now[changed[0]].strip(), text)


def _formulas(source: str) -> dict[int, set[int]]:
    """The columns of each line that belong to what functions compute: no annotation, decorator, message or default."""
    inside: dict[int, set[int]] = {}
    messages: list[ast.expr] = []

    def visit(node: ast.AST, within: bool) -> None:
        if isinstance(node, ast.JoinedStr):
            messages.append(node)
        if isinstance(node, (ast.Raise, ast.JoinedStr, ast.Assert)):
            return
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            for child in node.body:
                visit(child, True)
            return
        if isinstance(node, ast.ClassDef):
            for child in node.body:
                visit(child, False)
            return
        if isinstance(node, ast.AnnAssign):
            if node.value is not None:
                visit(node.value, within)
            return
        if within and isinstance(node, ast.expr) and node.end_col_offset is not None:
            if node.lineno == node.end_lineno:
                inside.setdefault(node.lineno, set()).update(range(node.col_offset, node.end_col_offset))
            else:  # an operator at the end or the start of a line of a longer expression
                for line in range(node.lineno, (node.end_lineno or node.lineno) + 1):
                    inside.setdefault(line, set()).update(range(200))
        for child in ast.iter_child_nodes(node):
            visit(child, within)

    visit(ast.parse(source), False)
    for node in messages:
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1):
            inside.pop(line, None)
    return inside
