"""Parameters that a docstring gives on one line, `name : what it is.`, as numpydoc's `name` with a description below.

Types stand in the signature; where the docstring has one (`array_like`, `float or None`), it is left alone.
"""

from __future__ import annotations

import re
from typing import Any

import griffe

NAME = r"\*{0,2}\w+(?: \([^)]*\))?"
ONE_LINE = re.compile(rf"^({NAME}(?:, {NAME})*) : (.+)$")  # names are apart by commas alone: read in one pass
TYPES = re.compile(r"^(array_like|ndarray|float|int|str|bool|tuple|list|dict|type|callable|None|sequence|path|\w+ or )")


class Parameters(griffe.Extension):
    """Rewrites docstrings before they are parsed."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        if obj.docstring is not None and "Parameters\n---" in obj.docstring.value:
            obj.docstring.value = _rewritten(obj.docstring.value)


def _rewritten(text: str) -> str:
    lines, found, inside = text.split("\n"), [], False
    for number, line in enumerate(lines):
        if re.fullmatch(r"-{3,}", line.strip()):
            inside = lines[number - 1].strip() == "Parameters"
        match = ONE_LINE.match(line) if inside else None
        if match and not TYPES.match(match[2]):
            found += [re.sub(r" \([^)]*\)", "", match[1]), f"    {match[2]}"]
        else:
            found.append(line)
    return "\n".join(found)
