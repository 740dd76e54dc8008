"""Read the B-spline surface under a named face from the text of a STEP file, without the kernel, so that it can judge one."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from mirror_cad.errors import FileError
from mirror_cad.surfaces.bspline import BSplineSurface

_TOKEN = re.compile(r"""\s*(?:(?P<string>'(?:[^']|'')*')|(?P<number>[-+]?\d[\d.]*(?:[eE][-+]?\d+)?)|(?P<ref>\#\d+)
                        |(?P<enum>\.[A-Z_0-9]+\.)|(?P<word>[A-Za-z_][A-Za-z_0-9]*)|(?P<mark>[(),$*=]))""", re.VERBOSE)
_RECORD = re.compile(r"#(\d+)\s*=\s*((?:[^;']|'(?:[^']|'')*')*);")


def read_named_surface(path: Path, face_name: str) -> BSplineSurface:
    """The surface of ADVANCED_FACE('face_name', …), from degree, knots, multiplicities and poles as the text gives them.

    The file must be in mm.

    Raises
    ------
    FileError
        Where the face, its B_SPLINE_SURFACE_WITH_KNOTS or the unit is missing.

    References
    ----------
    ISO 10303-21 (the text), ISO 10303-42 (the entity).
    """
    try:
        text = path.read_text("ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"{path}: cannot be read as Part 21 text: {error}") from None
    if not re.search(r"SI_UNIT\s*\(\s*\.MILLI\.\s*,\s*\.METRE\.\s*\)", text):
        raise FileError(f"{path}: the length unit is not the millimetre")
    records = dict(_RECORD.findall(text))
    for body in records.values():
        if body.startswith("ADVANCED_FACE") and f"'{face_name}'" in body:
            surface = _parse(body)[1][2]
            return _surface(records, surface.removeprefix("#"), path)
    raise FileError(f"{path}: no face is named {face_name!r}")


def _surface(records: dict[str, str], key: str, path: Path) -> BSplineSurface:
    name, arguments = _parse(records[key])
    if name != "B_SPLINE_SURFACE_WITH_KNOTS":
        raise FileError(f"{path}: the face lies on {name}, not on a B_SPLINE_SURFACE_WITH_KNOTS")
    _, degree_u, degree_v, rows, _, _, _, _, times_u, times_v, knots_u, knots_v, _ = arguments
    poles = [[_parse(records[ref.removeprefix("#")])[1][1] for ref in row] for row in rows]
    return BSplineSurface(int(degree_u), int(degree_v), np.repeat(knots_u, np.asarray(times_u, dtype=int)),
                          np.repeat(knots_v, np.asarray(times_v, dtype=int)), np.array(poles, dtype=np.float64))


def _parse(body: str) -> tuple[str, list[Any]]:
    """KEYWORD(arguments) as its keyword and nested lists."""
    stack: list[list[Any]] = [[]]
    keyword = ""
    position = 0
    body = body.strip()
    while position < len(body):
        match = _TOKEN.match(body, position)
        if match is None:
            raise FileError(f"not Part 21 text: {body[position:position + 40]!r}")
        position = match.end()
        token = match.group(match.lastgroup or 0)
        if match.lastgroup == "word" and not keyword:
            keyword = token
        elif token == "(":
            stack.append([])
        elif token == ")":
            closed = stack.pop()
            stack[-1].append(closed)
        elif match.lastgroup == "number":
            stack[-1].append(float(token))
        elif token != ",":
            stack[-1].append(token)
    return keyword, stack[0][0]
