"""Docstrings follow the numpy convention everywhere, and name all parameters where they name any."""

from __future__ import annotations

import ast
import inspect
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

HOME = Path(__file__).parents[1]
PACKAGES = ("mirror_cad", "raytrace", "mirror_studio")
# `x, y : (n,), mm.` and, further on in a line, `columns : of cells.`; or `x, y` alone, with what they are in the next line.
NAMED = re.compile(r"(?:^|   )((?:\*{0,2}\w+)(?:, \*{0,2}\w+)*)(?: :(?: |$)|:?$)")


def test_no_file_of_the_packages_is_excused_from_the_convention() -> None:
    lint = tomllib.loads((HOME / "pyproject.toml").read_text("utf-8"))["tool"]["ruff"]["lint"]
    assert "D" in lint["select"]
    assert lint["pydocstyle"]["convention"] == "numpy"
    excused = {file for file, rules in lint["per-file-ignores"].items() if any(rule.startswith("D") for rule in rules)}
    assert not {file for file in excused if file.split("/")[0] in PACKAGES}


def functions(path: Path) -> Iterator[ast.FunctionDef]:
    """Those of a file that others may call."""
    waiting: list[ast.AST] = [ast.parse(path.read_text("utf-8"))]
    while waiting:
        for node in ast.iter_child_nodes(waiting.pop()):
            if isinstance(node, ast.ClassDef):
                waiting.append(node)
            elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                yield node


def section(text: str, name: str) -> str:
    """What stands in a section of a docstring."""
    found = re.search(rf"^{name}\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", text, re.M | re.S)
    return found[1] if found else ""


def test_all_parameters_are_named_where_any_is() -> None:
    missing = []
    for package in PACKAGES:
        for path in sorted((HOME / package).rglob("*.py")):
            if path.parent == HOME / "mirror_studio" / "commands":  # what several commands take is told once, in its type
                continue
            for function in functions(path):
                told = section(inspect.cleandoc(ast.get_docstring(function) or ""), "Parameters")
                if not told:
                    continue
                arguments = function.args
                taken = {each.arg for each in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, arguments.vararg,
                                               arguments.kwarg) if each is not None} - {"self", "cls"}
                named = {name.lstrip("*") for line in told.splitlines() if not line.startswith(" ")
                         for part in NAMED.findall(line) for name in part.split(", ")}
                if taken - named or named - taken:
                    missing.append((str(path.relative_to(HOME)), function.name, taken ^ named))
    assert not missing, "\n".join(map(str, missing))
