"""Find what is wrong with the statements of a STEP file, so that no kernel has to trip over it.

Only what a face rests on is judged, by ISO 10303-42: points, curves, surfaces, edges, loops, faces, shells. What programs
leave open elsewhere (colours, properties, drawings) does no harm here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise

# Texts and comments, so that what stands in them is not taken for statements.
_TEXT = re.compile(r"'[^']*(?:''[^']*)*'")
_SPOKEN = re.compile(rf"{_TEXT.pattern}|/\*.*?\*/", re.DOTALL)
_UNCLOSED = re.compile(r"'[^']*;\s*#\d+\s*=")
_REFERENCE = re.compile(r"#(\d+)")
_KEYWORD = re.compile(r"[A-Z_][A-Z_0-9]*")
_OUTSIDE = ("DOCUMENT_FILE", "EXTERNALLY_DEFINED_", "APPLIED_EXTERNAL_IDENTIFICATION_ASSIGNMENT")
_SECTION = re.compile(r"(?:ENDSEC|DATA(?:\(.*\))?|END-ISO-10303-21|ANCHOR|REFERENCE|SIGNATURE|)")
MAX_NAMED = 3  # faults in a message, and references in a fault
SHOWN_CHARACTERS = 30  # of what is no statement

# The arguments of each entity, one letter each; texts have become ''.
_REF = r"(?:\#\d+|\$|\*)"
_NUMBER = r"(?:[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_INTEGER = r"(?:[-+]?\d+)"


def _list(item: str) -> str:
    return rf"\({item}(?:,{item})*\)"


_PATTERNS = {
    "s": r"(?:''|\$|\*)", "e": r"(?:\.\w+\.|\$|\*)", "n": rf"(?:{_NUMBER}|\w+\({_NUMBER}\))", "i": _INTEGER, "r": _REF,
    "N": rf"(?:{_list(_NUMBER)})", "I": rf"(?:{_list(_INTEGER)})", "R": rf"(?:\(\)|{_list(_REF)})", "P": _list(_REF),
    "G": _list(_list(_REF)), "p": _REF, "d": _REF, "a": _REF, "v": _REF, "V": _REF,
}
_SIGNATURES = {
    "CARTESIAN_POINT": "sN", "DIRECTION": "sN", "VECTOR": "sdn", "VERTEX_POINT": "sp", "LINE": "spv", "CIRCLE": "san",
    "ELLIPSE": "sann", "AXIS1_PLACEMENT": "spd", "AXIS2_PLACEMENT_2D": "spd", "AXIS2_PLACEMENT_3D": "spdd", "PLANE": "sa",
    "CYLINDRICAL_SURFACE": "san", "SPHERICAL_SURFACE": "san", "CONICAL_SURFACE": "sann", "TOROIDAL_SURFACE": "sann",
    "B_SPLINE_CURVE_WITH_KNOTS": "siPeeeINe", "B_SPLINE_SURFACE_WITH_KNOTS": "siiGeeeeIINNe",
    "SURFACE_OF_REVOLUTION": "srr", "SURFACE_OF_LINEAR_EXTRUSION": "srv", "OFFSET_SURFACE": "srne",
    "EDGE_CURVE": "sVVre", "ORIENTED_EDGE": "srrre", "EDGE_LOOP": "sR", "VERTEX_LOOP": "sV", "FACE_BOUND": "sre",
    "FACE_OUTER_BOUND": "sre", "ADVANCED_FACE": "sRre", "FACE_SURFACE": "sRre", "OPEN_SHELL": "sR", "CLOSED_SHELL": "sR",
    "MANIFOLD_SOLID_BREP": "sr", "PCURVE": "srr", "SURFACE_CURVE": "srRe", "SEAM_CURVE": "srRe", "INTERSECTION_CURVE": "srRe",
}
_SHAPES = {name: re.compile(rf"{name}\({','.join(f'({_PATTERNS[code]})' for code in codes)}\)")
           for name, codes in _SIGNATURES.items()}
_POINT = _SHAPES["CARTESIAN_POINT"]
# What an argument of that letter must name, if it names one of the entities above.
_TARGETS = {"p": {"CARTESIAN_POINT"}, "P": {"CARTESIAN_POINT"}, "G": {"CARTESIAN_POINT"}, "d": {"DIRECTION"},
            "a": {"AXIS1_PLACEMENT", "AXIS2_PLACEMENT_2D", "AXIS2_PLACEMENT_3D"}, "v": {"VECTOR"}, "V": {"VERTEX_POINT"}}
_IN_SPACE = {"B_SPLINE_SURFACE_WITH_KNOTS", "VERTEX_POINT", "AXIS2_PLACEMENT_3D"}


def faults_of(text: str) -> list[str]:
    """What is wrong with the statements of a Part 21 file on which faces rest, one sentence each; none where all is right.

    References
    ----------
    ISO 10303-21 (the text), ISO 10303-42 (the entities).
    """
    start = re.search(r"\bDATA\s*(?:\([^;]*\))?\s*;", text)
    if start is None:
        return ["it holds no DATA section, as every whole STEP file does"]
    if re.search(r"\bREFERENCE\s*;", text[:start.start()]):
        return []  # it names statements of other files
    data = text[start.end():]
    spoken = (_SPOKEN.sub(lambda found: "''" if found[0][0] == "'" else " ", data) if "/*" in data
              else _TEXT.sub("''", data))  # which is quick
    statements, faults = _statements(spoken)
    if not faults:
        for number, body in statements.items():
            if _POINT.fullmatch(body):  # most statements are points, and there is no more to one
                continue
            faults += _of_statement(number, body, statements)
            if len(faults) > MAX_NAMED:
                break
    if faults:
        unclosed = _first_unclosed(data)
        if unclosed is not None:
            return [f"#{unclosed}: a text in it is not closed by an apostrophe"]
    return faults


def external_files(text: str) -> list[str]:
    """The files that a STEP file names as holding its parts, in its order.

    References
    ----------
    ISO 10303-41, DOCUMENT_FILE; the recommended practices for external references with it.
    """
    if not any(word in text for word in _OUTSIDE):
        return []
    names = re.findall(r"\b(?:DOCUMENT_FILE|EXTERNALLY_DEFINED_\w+|APPLIED_EXTERNAL_IDENTIFICATION_ASSIGNMENT)\s*\(\s*'"
                       r"((?:[^']|'')+)'", text)
    return list(dict.fromkeys(name for name in names if re.search(r"\.(?:step|stp)$", name, re.IGNORECASE)))


def _statements(spoken: str) -> tuple[dict[str, str], list[str]]:
    """Number and body of each statement, without blanks; and where the text is not a row of statements."""
    statements: dict[str, str] = {}
    faults: list[str] = []
    number = "0"
    pieces = "".join(spoken.split()).split(";")
    for piece in pieces:
        head, equals, body = piece.partition("=")
        if not equals or head[:1] != "#" or not head[1:].isdecimal():
            if _SECTION.fullmatch(piece) is None:
                faults.append(f"after #{number}: {piece[:SHOWN_CHARACTERS]!r} is no statement")
            continue
        number = head[1:]
        if "=" in body and re.search(r"#\d+=", body):
            faults.append(f"#{number}: it is not ended by a semicolon")
        elif body.count("(") != body.count(")"):
            faults.append(f"#{number}: its brackets do not close")
        elif number in statements and statements[number] != body:
            faults.append(f"#{number} stands twice in the file, each time as something else")
        statements[number] = body
        if len(faults) > MAX_NAMED:
            break
    if not faults and "ENDSEC" not in pieces:
        faults.append(f"it is cut short after #{number}")
    return statements, faults


def _of_statement(number: str, body: str, statements: dict[str, str]) -> Iterator[str]:
    found = _KEYWORD.match(body)
    name = found[0] if found else ""
    if name not in _SIGNATURES and not (body.startswith("(") and "B_SPLINE" in body):
        return
    missing = [key for key in _REFERENCE.findall(body) if key not in statements]
    if missing:
        shown = ", ".join(f"#{key}" for key in missing[:MAX_NAMED]) + (", …" if len(missing) > MAX_NAMED else "")
        yield f"#{number}{f' ({name})' if name else ''}: it names {shown}, which the file does not hold"
        return
    if not name:
        return
    shape = _SHAPES[name].fullmatch(body)
    if shape is None:
        yield f"#{number}: its arguments are not those of {name}"
        return
    for code, argument in zip(_SIGNATURES[name], shape.groups(), strict=True):
        wanted = _TARGETS.get(code)
        if wanted is None:
            continue
        for key in _REFERENCE.findall(argument):
            other = _KEYWORD.match(statements[key])
            if other is not None and other[0] in _SIGNATURES and other[0] not in wanted:
                yield f"#{number} ({name}): it names #{key}, a {other[0]}, for a {min(wanted)}"
                return
    flat = _flat(name, body, statements)
    if flat is not None:
        yield f"#{number} ({name}): #{flat}, which it names, has no three coordinates"
        return
    if name.startswith("B_SPLINE"):
        yield from _of_knots(number, name, shape)


def _flat(name: str, body: str, statements: dict[str, str]) -> str | None:
    """The first point or direction of an entity in space that has not three coordinates.

    Of a curve, that has another count than its first point.
    """
    if name not in _IN_SPACE and name != "B_SPLINE_CURVE_WITH_KNOTS":
        return None
    wanted = None if name == "B_SPLINE_CURVE_WITH_KNOTS" else 3
    for key in _REFERENCE.findall(body):
        other = statements[key]
        if other.startswith(("CARTESIAN_POINT", "DIRECTION")):
            count = other.count(",")
            wanted = wanted or count
            if count != wanted:
                return str(key)
    return None


def _of_knots(number: str, name: str, shape: re.Match[str]) -> Iterator[str]:
    """A B-spline of degree p with n poles has n + p + 1 knots, none more than p + 1 times, in rising order."""
    arguments = shape.groups()
    if name == "B_SPLINE_CURVE_WITH_KNOTS":
        directions = [("", arguments[1], arguments[2].count("#"), arguments[6], arguments[7])]
    else:
        rows = [row.count("#") for row in arguments[3][1:-1].split("),(")]
        if len(set(rows)) != 1:
            yield f"#{number} ({name}): its rows have {min(rows)} to {max(rows)} points: all must have as many"
            return
        directions = [(" in u", arguments[1], len(rows), arguments[8], arguments[10]),
                (" in v", arguments[2], rows[0], arguments[9], arguments[11])]
    for where, degree_text, poles, times_text, knots_text in directions:
        degree = int(degree_text)
        times, knots = [int(t) for t in times_text[1:-1].split(",")], [float(t) for t in knots_text[1:-1].split(",")]
        if degree < 1 or poles < degree + 1:
            yield f"#{number} ({name}): degree {degree} with {poles} points{where}: no curve has that"
        elif len(times) != len(knots):
            yield f"#{number} ({name}): {len(knots)} knots{where} with {len(times)} multiplicities"
        elif sum(times) != poles + degree + 1:
            yield (f"#{number} ({name}): {poles} points{where} at degree {degree} need {poles + degree + 1} knots, not "
                   f"{sum(times)}")
        elif min(times) < 1 or max(times) > degree + 1:
            wrong = min(times) if min(times) < 1 else max(times)
            yield f"#{number} ({name}): a knot{where} stands {wrong} times at degree {degree}"
        elif any(a >= b for a, b in pairwise(knots)):
            yield f"#{number} ({name}): its knots{where} do not rise"


def _first_unclosed(data: str) -> str | None:
    """The number of the first statement with a text in it that runs on into the next statements."""
    for found in _SPOKEN.finditer(data):
        if _UNCLOSED.match(found[0]):
            numbers = re.findall(r"#(\d+)\s*=", data[:found.start()])
            return str(numbers[-1]) if numbers else None
    return None
