"""Reading a mirror's outline from DXF and SVG files, and writing it to DXF."""

from __future__ import annotations

import io
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.parsers import expat

import ezdxf
import numpy as np
from ezdxf.entities import DXFEntity
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, make_interp_spline
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mirror_cad.errors import OutlineError, WriteError
from mirror_cad.outline import (
    Arc,
    FloatArray,
    Line,
    Outline,
    Point,
    Segment,
    Spline,
    arc_between,
    closed_outline,
)

FILE_JOIN_TOLERANCE_MM = 1e-3
"""Ends of pieces in a file that are this close are one point; larger gaps are errors."""

MAXIMUM_FILE_BYTES = 20_000_000
MAXIMUM_SEGMENTS = 20_000
"""Most segments in a file, every knot span of a spline counted as one."""

_FULL_TURN = 2.0 * math.pi
# An arc that rises less than this over its chord is a line: its centre is too far away to place its ends.
_FLAT_MM = 1e-6
_ELEVATION_TOLERANCE_MM = 1e-6


class _Piece(NamedTuple):
    """One segment in mirror coordinates and what it was in the file."""

    segment: Segment
    label: str


def read_outline(path: str | os.PathLike[str]) -> Outline:
    """The outline in a .dxf or .svg file, in mirror coordinates (mm, x right, y up); nothing is recentred.

    The pieces may be drawn in any order and direction. Ends within 1e-3 mm of each other are joined exactly; pieces
    whose two ends are joined that way and that are no larger themselves draw nothing and are dropped. What is left must
    be one closed loop.

    DXF: lengths are in the drawing's $INSUNITS (0, no unit, is mm). All LINE, ARC, CIRCLE, ELLIPSE, LWPOLYLINE,
    POLYLINE (2D and 3D, with bulges) and SPLINE (polynomial or rational, clamped or not) entities of the model space
    count, whatever their layer, in one plane of constant z with the extrusion direction (0, 0, 1) or (0, 0, -1). An
    arc of a polyline that rises less than 1e-6 mm is read as a line. TEXT, MTEXT, DIMENSION, POINT, LEADER,
    MULTILEADER, TOLERANCE, ATTDEF and ATTRIB are annotations and ignored, as is the paper space. Any other entity is
    an error.

    SVG: the user origin of the outermost svg element is the mirror's origin and y_mirror = -y_svg, so a centred
    outline has a viewBox with a negative corner. With a physical width or height (mm, cm, in, pt, pc, Q, or px at 96
    to the inch), lengths are scaled as viewBox and preserveAspectRatio say (without viewBox a user unit is a px), but
    the viewport's position does not matter. Without one a user unit is 1 mm. path, rect, circle, ellipse, line,
    polyline and polygon count, inside g and a and with all transforms; what is in defs or has display none is not
    drawn and ignored, as are text, metadata and elements of other namespaces. Any other element (use, image, a nested
    svg, ...) and clipping, masks and geometry set by CSS are errors, as is a document type that declares entities.

    Circular arcs become `Arc`, elliptic ones exact rational `Spline`, Bezier curves `Spline`.

    Raises `OutlineError`, naming file, entity, place and numbers, for a file that is missing, empty, larger than
    20 MB, not DXF or SVG, damaged, or has more than 20 000 segments; an unknown unit; no geometry; an open outline;
    several loops; and whatever `mirror_cad.outline.closed_outline` refuses.
    """
    file = Path(path)
    readers: dict[str, Callable[[Path], Iterator[_Piece]]] = {".dxf": _dxf_pieces, ".svg": _svg_pieces}
    reader = readers.get(file.suffix.lower())
    if reader is None:
        raise OutlineError(f"{file}: an outline file must end in .dxf or .svg, not {file.suffix!r}")
    try:
        size = file.stat().st_size
        if not file.is_file():
            raise OutlineError(f"{file}: not a file; give the path of a .dxf or .svg file")
        if size == 0:
            raise OutlineError(f"{file}: the file is empty (0 bytes); export the outline again")
        if size > MAXIMUM_FILE_BYTES:
            raise OutlineError(
                f"{file}: the file has {size} bytes, more than {MAXIMUM_FILE_BYTES}; export the outline alone"
            )
        pieces: list[_Piece] = []
        total = 0
        for piece in reader(file):
            pieces.append(piece)
            segment = piece.segment
            total += len(np.unique(segment.knots)) - 1 if isinstance(segment, Spline) else 1
            if total > MAXIMUM_SEGMENTS:
                raise OutlineError(
                    f"{file}: more than {MAXIMUM_SEGMENTS} segments; export the outline alone, as few smooth curves"
                )
    except OSError as error:
        raise OutlineError(f"{file}: cannot be read: {error.strerror or error}") from None
    return closed_outline(_chained(pieces, str(file)), str(file), FILE_JOIN_TOLERANCE_MM)


def _text(point: ArrayLike) -> str:
    x, y = np.asarray(point, dtype=float)
    return f"({x:.6g}, {y:.6g}) mm"


# ---------------------------------------------------------------------------------------------------------- chaining


def _nodes(pieces: list[_Piece], source: str) -> FloatArray:
    """The number of the common point each piece starts and ends at, (n, 2): ends within tolerance share one."""
    ends = np.array([[piece.segment.start, piece.segment.end] for piece in pieces]).reshape(-1, 2)
    points, index = np.unique(ends, axis=0, return_inverse=True)
    tree = cKDTree(points)
    # Each end should have one neighbour; a crowd would make the list of pairs grow with its square.
    if tree.count_neighbors(tree, FILE_JOIN_TOLERANCE_MM) > 50 * len(points):
        raise OutlineError(
            f"{source}: too many ends of pieces lie within {FILE_JOIN_TOLERANCE_MM:g} mm of each other; check the "
            "drawing's units and delete the small pieces"
        )
    first, second = tree.query_pairs(FILE_JOIN_TOLERANCE_MM, output_type="ndarray").T
    links = coo_matrix((np.ones(len(first), dtype=bool), (first, second)), shape=(len(points), len(points)))
    labels = connected_components(links, directed=False)[1]
    return np.asarray(labels[index.ravel()].reshape(-1, 2))


def _extent(segments: Iterable[Segment]) -> tuple[float, float, float, float]:
    boxes = np.array([segment.bounds() for segment in segments])
    return boxes[:, 0].min(), boxes[:, 1].max(), boxes[:, 2].min(), boxes[:, 3].max()


def _chained(pieces: list[_Piece], source: str) -> list[Segment]:
    """The segments of the one closed loop the pieces make, in order and head to tail."""
    if not pieces:
        raise OutlineError(f"{source}: no outline found: the file has no lines, arcs or curves; draw one closed loop")
    node = _nodes(pieces, source)
    chains: list[list[_Piece]] = []
    at_node: dict[int, list[int]] = {}
    for i, (piece, (start, end)) in enumerate(zip(pieces, node.tolist(), strict=True)):
        if start != end:
            at_node.setdefault(start, []).append(i)
            at_node.setdefault(end, []).append(i)
            continue
        x_min, x_max, y_min, y_max = piece.segment.bounds()
        if not isinstance(piece.segment, Line) and max(x_max - x_min, y_max - y_min) > 2.0 * FILE_JOIN_TOLERANCE_MM:
            chains.append([piece])
    closed = len(chains)
    for number, here in at_node.items():
        if len(here) > 2:
            i = here[0]
            where = pieces[i].segment.start if node[i, 0] == number else pieces[i].segment.end
            raise OutlineError(
                f"{source}: {len(here)} pieces end at {_text(where)}: "
                f"{', '.join(pieces[k].label for k in here[:4])}{', ...' if len(here) > 4 else ''}; an outline does "
                "not branch, so delete duplicates and construction lines"
            )
    used = np.zeros(len(pieces), dtype=bool)
    # Open chains first, from their ends; whatever is left then closes on itself.
    loose = [number for number, here in at_node.items() if len(here) == 1]
    for number in [*loose, *at_node]:
        chain: list[_Piece] = []
        at = number
        while True:
            ahead = [i for i in at_node[at] if not used[i]]
            if not ahead:
                break
            i = ahead[0]
            used[i] = True
            piece = pieces[i]
            if node[i, 0] == at:
                chain.append(piece)
                at = node[i, 1]
            else:
                chain.append(_Piece(piece.segment.reversed(), piece.label))
                at = node[i, 0]
        if chain:
            chains.append(chain)
            closed += int(at == number)
    if closed == 0 and chains:
        raise OutlineError(f"{source}: the outline is open: {_gaps(chains)}")
    if len(chains) != 1:
        if not chains:
            raise OutlineError(
                f"{source}: no outline found: all pieces are within {FILE_JOIN_TOLERANCE_MM:g} mm; check the units"
            )
        places = []
        for chain in chains[:4]:
            x_min, x_max, y_min, y_max = _extent(piece.segment for piece in chain)
            places.append(f"x {x_min:.6g} to {x_max:.6g} and y {y_min:.6g} to {y_max:.6g} mm (from {chain[0].label})")
        raise OutlineError(
            f"{source}: {closed} closed loop{'s' * (closed != 1)} and {len(chains) - closed} leftover open "
            f"piece{'s' * (len(chains) - closed != 1)} found, but an outline is one closed loop: {'; '.join(places)}"
            f"{'; ...' if len(chains) > 4 else ''}; keep one and delete the rest"
        )
    return [piece.segment for piece in chains[0]]


def _gaps(chains: list[list[_Piece]]) -> str:
    """What to say of open chains: each loose end with the loose end nearest to it."""
    ends = np.array([point for chain in chains for point in (chain[0].segment.start, chain[-1].segment.end)])
    labels = [label for chain in chains for label in (chain[0].label, chain[-1].label)]
    distance, nearest = cKDTree(ends).query(ends, k=2)
    found: dict[tuple[int, int], float] = {}
    for i in range(len(ends)):
        # Of two coincident points the query may name the point itself second.
        other = int(nearest[i, 1] if nearest[i, 1] != i else nearest[i, 0])
        found.setdefault((min(i, other), max(i, other)), float(distance[i, 1]))
    said = [
        f"gap of {size:.6g} mm between {_text(ends[a])} ({labels[a]}) and {_text(ends[b])} ({labels[b]})"
        for (a, b), size in list(found.items())[:4]
    ]
    return (
        f"{'; '.join(said)}{'; ...' if len(found) > 4 else ''}; gaps up to {FILE_JOIN_TOLERANCE_MM:g} mm are closed: "
        "move the ends together or add the missing piece"
    )


# --------------------------------------------------------------------------------------------------- curves of files


def _elliptic_arc(centre: ArrayLike, u: ArrayLike, v: ArrayLike, start: float, sweep: float) -> Segment:
    """centre + cos(a) u + sin(a) v for a from `start` over `sweep` (rad): an `Arc`, or a rational quadratic `Spline`.

    Between the angles a - h and a + h the conic has the inner pole centre + (cos(a) u + sin(a) v) / cos(h) of weight
    cos(h); pieces of at most a quarter turn keep the weights at 0.7 and above.
    """
    c, u, v = (np.asarray(value, dtype=float) for value in (centre, u, v))
    cross = u[0] * v[1] - u[1] * v[0]
    length_u, length_v = math.hypot(*u), math.hypot(*v)
    if not (math.isfinite(cross) and abs(cross) > 1e-12 * max(length_u, length_v) ** 2):
        raise OutlineError(f"the ellipse about {_text(c)} is flat, with half axes {length_u:.6g} and {length_v:.6g} mm")
    if abs(float(u @ v)) <= 1e-12 * abs(cross) and abs(length_u - length_v) <= 1e-12 * length_u:
        turn = math.copysign(1.0, cross)
        return Arc((c[0], c[1]), length_u, math.atan2(u[1], u[0]) + turn * start, turn * sweep)
    count = max(1, math.ceil(abs(sweep) / (0.5 * math.pi) - 1e-9))
    half = 0.5 * sweep / count
    angles = start + half * np.arange(2 * count + 1)
    weights = np.ones(2 * count + 1)
    weights[1::2] = math.cos(half)
    poles = c + (np.cos(angles)[:, None] * u + np.sin(angles)[:, None] * v) / weights[:, None]
    if abs(sweep) >= _FULL_TURN * (1.0 - 1e-15):
        poles[-1] = poles[0]
    knots = np.concatenate([[0.0], np.repeat(np.arange(count + 1.0), 2), [count]])
    return Spline(2, knots, poles, weights)


def _clamped_spline(degree: int, knots: FloatArray, poles: FloatArray, weights: FloatArray | None) -> Spline:
    """The clamped spline that is the given one over its domain, the knots from index p to n."""
    p, n = degree, len(poles)
    if weights is not None and (weights == weights[0]).all():
        weights = None
    if p < 1 or n < p + 1 or knots.shape != (n + p + 1,) or (np.diff(knots) < 0.0).any():
        return Spline(p, knots, poles, weights)  # which says what is wrong
    low, high = knots[p], knots[n]
    # Files round knots; end knots that are equal but for that are meant to be equal.
    close = 1e-9 * (high - low)
    inner = knots[p + 1 : n]
    inner = inner[(inner > low + close) & (inner < high - close)]
    for i in range(1, len(inner)):
        if inner[i] - inner[i - 1] <= 1e-12 * (high - low):
            inner[i] = inner[i - 1]
    clamped = np.concatenate([np.full(p + 1, low), inner, np.full(p + 1, high)])
    if len(clamped) == len(knots) and low - knots[0] <= close and knots[-1] - high <= close:
        return Spline(p, clamped, poles, weights)
    if not low < high or (inner[p:] <= inner[: len(inner) - p]).any():
        raise OutlineError(f"the spline is empty or broken: an inner knot is repeated more than {p} times")
    # The same piecewise polynomial in the clamped basis, found by interpolating it at the Greville abscissae.
    scale = np.ones(n) if weights is None else weights
    curve = BSpline(knots, np.column_stack([poles * scale[:, None], scale]), p)
    count = len(clamped) - p - 1
    greville = np.array([clamped[i + 1 : i + p + 1].mean() for i in range(count)])
    greville[0], greville[-1] = low, high
    columns = np.asarray(make_interp_spline(greville, curve(greville), k=p, t=clamped).c)
    return Spline(p, clamped, columns[:, :2] / columns[:, 2:], None if weights is None else columns[:, 2])


# --------------------------------------------------------------------------------------------------------------- DXF

_MM_PER_UNIT = {
    0: 1.0, 1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1000.0, 8: 25.4e-6, 9: 25.4e-3, 10: 914.4, 13: 1e-3, 14: 100.0
}  # fmt: skip
_ANNOTATIONS = {
    "TEXT", "MTEXT", "DIMENSION", "ARC_DIMENSION", "LARGE_RADIAL_DIMENSION", "POINT", "LEADER", "MULTILEADER",
    "MLEADER", "TOLERANCE", "ATTDEF", "ATTRIB"
}  # fmt: skip
_ENTITIES = "LINE, ARC, CIRCLE, ELLIPSE, LWPOLYLINE, POLYLINE and SPLINE"


def _printable(text: object) -> str:
    """At most 200 characters of a text that came from a damaged file, bytes that are none written as escapes."""
    return str(text)[:200].encode("ascii", "backslashreplace").decode()


def _dxf_pieces(file: Path) -> Iterator[_Piece]:
    try:
        document = ezdxf.readfile(str(file))
        # Without a header of its own a document gets ezdxf's, whose unit is the metre: only what the file says counts.
        unit = document.header.get("$INSUNITS", 0) if b"$INSUNITS" in file.read_bytes() else 0
        entities = list(document.modelspace())
    except OSError as error:
        raise OutlineError(f"{file}: not a DXF file, or it cannot be read ({error}); export it again as DXF") from None
    except Exception as error:
        raise OutlineError(
            f"{file}: damaged DXF file ({type(error).__name__}: {_printable(error)}); export it again as R2000 or later"
        ) from None
    scale = _MM_PER_UNIT.get(unit) if isinstance(unit, int) else None
    if scale is None:
        raise OutlineError(
            f"{file}: unit code $INSUNITS = {unit!r} is not supported; use 4 (mm), 5 (cm), 6 (m), 1 (in) or 2 (ft)"
        )
    level: tuple[float, str] | None = None
    for entity in entities:
        kind = entity.dxftype()
        if kind in _ANNOTATIONS:
            continue
        label = _printable(f"{kind} with handle {entity.dxf.get('handle')}")
        try:
            segments, elevations = _dxf_segments(entity, kind, scale)
        except OutlineError as error:
            raise OutlineError(f"{file}: {label}: {error}") from None
        except Exception as error:
            raise OutlineError(f"{file}: {label} is damaged ({type(error).__name__}: {_printable(error)})") from None
        for z in elevations:
            level = level or (z, label)
            if not abs(z - level[0]) <= _ELEVATION_TOLERANCE_MM:
                raise OutlineError(
                    f"{file}: the outline is not in one plane: z = {level[0]:.6g} mm at {level[1]} but {z:.6g} mm at "
                    f"{label}; flatten the drawing"
                )
        yield from (_Piece(segment, label) for segment in segments)


def _is_mirrored(entity: DXFEntity) -> bool:
    """Whether the entity's coordinates are seen from below; error where they are in a tilted plane."""
    x, y, z = entity.dxf.get("extrusion", (0.0, 0.0, 1.0))
    if not max(abs(x), abs(y)) <= 1e-9 * abs(z):
        raise OutlineError(
            f"its extrusion direction is ({x:.6g}, {y:.6g}, {z:.6g}); only (0, 0, 1) and (0, 0, -1) are supported, so "
            "draw it in the xy plane"
        )
    return bool(z < 0.0)


def _attributes(entity: DXFEntity, *names: str) -> list[Any]:
    for name in names:
        if not entity.dxf.hasattr(name):
            raise OutlineError(f"it has no {name}; export the file again")
    return [entity.dxf.get(name) for name in names]


def _turn(start: float, end: float, full: float) -> float:
    """Counter-clockwise turn from start to end; equal angles are a full turn, give or take a file's rounding."""
    if not (math.isfinite(start) and math.isfinite(end)):
        raise OutlineError(f"its angles are {start!r} and {end!r}: they must be finite")
    turn = (end - start) % full
    return full if min(turn, full - turn) <= 1e-9 * full else turn


def _dxf_segments(entity: Any, kind: str, scale: float) -> tuple[list[Segment], list[float]]:
    """The segments of a DXF entity and the elevations of its points, both in mm."""
    if kind == "LINE":
        start, end = (scale * np.array(point) for point in _attributes(entity, "start", "end"))
        return [Line((start[0], start[1]), (end[0], end[1]))], [start[2], end[2]]
    if kind in ("ARC", "CIRCLE"):
        centre, radius = _attributes(entity, "center", "radius")
        first, turn = 0.0, _FULL_TURN
        if kind == "ARC":
            start_angle, end_angle = _attributes(entity, "start_angle", "end_angle")
            first, turn = math.radians(start_angle), math.radians(_turn(start_angle, end_angle, 360.0))
        x, y, z = (scale * value for value in centre)
        if _is_mirrored(entity):
            # Seen from below, x and z change sign, and with x the sense of rotation.
            x, z, first, turn = -x, -z, math.pi - first, -turn
        return [Arc((x, y), scale * radius, first, turn)], [z]
    if kind == "ELLIPSE":
        centre, major, ratio = _attributes(entity, "center", "major_axis", "ratio")
        # Centre and major axis are world coordinates whatever the extrusion; that only turns the minor axis.
        side = -1.0 if _is_mirrored(entity) else 1.0
        x, y, z = (scale * value for value in centre)
        u = scale * np.array(major)
        v = side * ratio * np.array([-u[1], u[0]])
        first = entity.dxf.get("start_param", 0.0)
        turn = _turn(first, entity.dxf.get("end_param", _FULL_TURN), _FULL_TURN)
        return [_elliptic_arc((x, y), u[:2], v, first, turn)], [z, z + u[2]]
    if kind == "LWPOLYLINE":
        mirrored = -1.0 if _is_mirrored(entity) else 1.0
        rows = [(x, y, bulge) for x, y, _, _, bulge in entity.lwpoints]
        return _polyline(rows, entity.closed, mirrored, scale), [mirrored * scale * entity.dxf.get("elevation", 0.0)]
    if kind == "POLYLINE":
        if not (entity.is_2d_polyline or entity.is_3d_polyline) or entity.dxf.flags & 4:
            raise OutlineError("meshes and spline-fit polylines are not supported; explode it or draw it as a SPLINE")
        mirrored = -1.0 if entity.is_2d_polyline and _is_mirrored(entity) else 1.0
        points = [np.array(vertex.dxf.location) for vertex in entity.vertices]
        bulges = [vertex.dxf.get("bulge", 0.0) for vertex in entity.vertices]
        heights = [point[2] for point in points]
        if entity.is_2d_polyline:
            heights = [entity.dxf.get("elevation", (0.0, 0.0, 0.0))[2]]
        rows = [(point[0], point[1], bulge) for point, bulge in zip(points, bulges, strict=True)]
        return _polyline(rows, entity.is_closed, mirrored, scale), [mirrored * scale * z for z in heights]
    if kind == "SPLINE":
        poles = scale * np.array(entity.control_points, dtype=float).reshape(-1, 3)
        if len(poles) == 0:
            raise OutlineError("it has fit points but no poles, so its curve is not defined; convert it to poles")
        weights = np.array(entity.weights, dtype=float) if len(entity.weights) else None
        if weights is not None and len(weights) != len(poles):
            raise OutlineError(f"it has {len(weights)} weights for {len(poles)} poles; export the file again")
        knots = np.array(entity.knots, dtype=float)
        return [_clamped_spline(entity.dxf.degree, knots, poles[:, :2], weights)], list(poles[:, 2])
    raise OutlineError(
        f"this kind of entity is not supported in an outline; explode or delete it (supported are {_ENTITIES})"
    )


def _polyline(rows: list[tuple[float, float, float]], closed: bool, mirrored: float, scale: float) -> list[Segment]:
    """Lines and arcs through vertices (x, y, bulge); bulge = tan(sweep/4) of the piece to the next vertex."""
    points = [(mirrored * scale * x, scale * y) for x, y, _ in rows]
    segments: list[Segment] = []
    for i in range(len(rows) if closed else len(rows) - 1):
        start, end, bulge = points[i], points[(i + 1) % len(rows)], mirrored * rows[i][2]
        if start == end:
            continue  # coincident vertices draw nothing
        # The rise of an arc over its chord is bulge chord/2.
        if abs(bulge) * 0.5 * math.dist(start, end) <= _FLAT_MM:
            segments.append(Line(start, end))
        else:
            segments.append(arc_between(start, end, 4.0 * math.atan(bulge)))
    return segments


def write_dxf(outline: Outline, path: str | os.PathLike[str]) -> None:
    """Write an outline to a DXF file: R2010, mm ($INSUNITS = 4), LINE, ARC, CIRCLE and SPLINE on the layer OUTLINE.

    `read_outline` reads the same curve back to rounding; a full circle then starts at its rightmost point. When the
    environment variable SOURCE_DATE_EPOCH is set, the dates and identifiers in the file are constants instead of the
    current time and random numbers, and writing twice gives the same bytes.

    Raises `OutlineError` where a segment is so short (1e-3 mm) that a reader joining ends that close would lose it;
    `WriteError` where the file cannot be written.
    """
    fixed_before = ezdxf.options.write_fixed_meta_data_for_testing
    if os.environ.get("SOURCE_DATE_EPOCH"):
        ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        document = ezdxf.new("R2010", units=4)
        document.layers.add("OUTLINE")
        space = document.modelspace()
        layer = {"layer": "OUTLINE"}
        for i, segment in enumerate(outline.segments):
            x_min, x_max, y_min, y_max = segment.bounds()
            if math.hypot(x_max - x_min, y_max - y_min) <= FILE_JOIN_TOLERANCE_MM:
                raise OutlineError(
                    f"{path}: segment {i + 1} at {_text(segment.start)} is not longer than {FILE_JOIN_TOLERANCE_MM:g} "
                    "mm and would be lost when the file is read; make it longer or leave it out"
                )
            if isinstance(segment, Line):
                space.add_line(segment.start, segment.end, layer)
            elif isinstance(segment, Spline):
                entity = space.add_spline(degree=segment.degree, dxfattribs=layer)
                entity.control_points = [(x, y, 0.0) for x, y in segment.poles.tolist()]
                entity.knots = segment.knots.tolist()
                if segment.weights is not None:
                    entity.weights = segment.weights.tolist()
                    entity.dxf.flags |= entity.RATIONAL
            elif segment.is_full_circle:
                space.add_circle(segment.centre, segment.radius_mm, layer)
            else:
                # DXF arcs always run counter-clockwise.
                angles = sorted([segment.start_angle, segment.start_angle + segment.sweep])
                first, last = (math.degrees(angle) % 360.0 for angle in angles)
                space.add_arc(segment.centre, segment.radius_mm, first, last, dxfattribs=layer)
        # Writing adds classes in the order of a set, which differs from process to process: here they are in order already.
        for name in sorted({entity.dxftype() for entity in document.entitydb.values()}):
            document.classes.add_class(name)
        stream = io.StringIO()
        document.write(stream)
        Path(path).write_bytes(document.encode(stream.getvalue()))
    except OSError as error:
        raise WriteError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = fixed_before


# --------------------------------------------------------------------------------------------------------------- SVG

_SVG = "{http://www.w3.org/2000/svg}"
_NOT_DRAWN = {
    "defs", "title", "desc", "metadata", "style", "text", "symbol", "marker", "pattern", "clipPath", "mask", "filter",
    "linearGradient", "radialGradient", "view"
}  # fmt: skip
_GEOMETRY_PROPERTIES = {
    "d", "x", "y", "cx", "cy", "r", "rx", "ry", "width", "height", "transform", "translate", "rotate", "scale", "zoom",
    "clip-path", "mask", "display"
}  # fmt: skip
_SPACE = re.compile(r"[ \t\r\n\f]*")
_SEPARATOR = re.compile(r"[ \t\r\n\f]*,?[ \t\r\n\f]*")
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_FLAG = re.compile(r"[01]")
_LENGTH = re.compile(rf"[ \t\r\n\f]*({_NUMBER.pattern})([a-zA-Z%]*)[ \t\r\n\f]*")
_COMMAND = re.compile(r"([MmZzLlHhVvCcSsQqTtAa])([^MmZzLlHhVvCcSsQqTtAa]*)")
_TRANSFORM = re.compile(r"([a-zA-Z]+)[ \t\r\n\f]*\(([^()]*)\)[ \t\r\n\f,]*")
_ARGUMENTS = {"M": 2, "Z": 0, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7}
_MM_PER_PX = 25.4 / 96.0
_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "px": _MM_PER_PX, "pt": 25.4 / 72.0, "pc": 25.4 / 6.0, "q": 0.25}


def _numbers(text: str, what: str, flags: tuple[int, ...] = (), period: int = 1) -> list[float]:
    """The numbers in a list separated by white space or commas; those at `flags` modulo `period` are one digit 0 or 1.

    Read one by one, not with one pattern: numbers may follow each other without a separator.
    """
    values: list[float] = []
    match = _SPACE.match(text)
    at = match.end() if match else 0
    end = at
    while at < len(text):
        number = (_FLAG if len(values) % period in flags else _NUMBER).match(text, at)
        if number is None or not math.isfinite(float(number.group())):
            raise OutlineError(f"{what} has something that is not a finite number at {text[at : at + 20]!r}")
        values.append(float(number.group()))
        end = number.end()
        match = _SEPARATOR.match(text, end)
        at = match.end() if match else end
    if text[end:].strip():
        raise OutlineError(f"{what} ends in {text[end:].strip()!r}")
    return values


class _Frame(NamedTuple):
    """Affine map from an element's coordinates to the mirror's: (a x + c y + e, b x + d y + f)."""

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float

    def __matmul__(self, inner: _Frame) -> _Frame:
        e, f = self.at((inner.e, inner.f))
        return _Frame(*self.along((inner.a, inner.b)), *self.along((inner.c, inner.d)), e, f)

    def along(self, vector: Point) -> Point:
        x, y = vector
        return self.a * x + self.c * y, self.b * x + self.d * y

    def at(self, point: Point) -> Point:
        x, y = self.along(point)
        return x + self.e, y + self.f

    def line(self, start: Point, end: Point) -> Segment:
        return Line(self.at(start), self.at(end))

    def bezier(self, *poles: Point) -> Segment:
        order = len(poles)
        return Spline(order - 1, np.repeat([0.0, 1.0], order), np.array([self.at(pole) for pole in poles]))

    def ellipse(self, centre: Point, rx: float, ry: float, tilt: float, start: float, sweep: float) -> Segment:
        cos, sin = math.cos(tilt), math.sin(tilt)
        u, v = self.along((rx * cos, rx * sin)), self.along((-ry * sin, ry * cos))
        return _elliptic_arc(self.at(centre), u, v, start, sweep)


def _transform(text: str) -> _Frame:
    """The map of an SVG transform attribute."""
    frame = _Frame(1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    at = len(text) - len(text.lstrip())
    while at < len(text):
        match = _TRANSFORM.match(text, at)
        if match is None:
            raise OutlineError(f"transform {text[:80]!r} is not understood at {text[at : at + 20]!r}")
        at = match.end()
        name = match[1]
        values = _numbers(match[2], f"transform {name}")
        count = len(values)
        if name == "matrix" and count == 6:
            step = _Frame(*values)
        elif name == "translate" and count in (1, 2):
            step = _Frame(1.0, 0.0, 0.0, 1.0, values[0], values[1] if count == 2 else 0.0)
        elif name == "scale" and count in (1, 2):
            step = _Frame(values[0], 0.0, 0.0, values[-1], 0.0, 0.0)
        elif name == "rotate" and count in (1, 3):
            cos, sin = math.cos(math.radians(values[0])), math.sin(math.radians(values[0]))
            x, y = values[1:] or (0.0, 0.0)
            step = _Frame(cos, sin, -sin, cos, x - cos * x + sin * y, y - sin * x - cos * y)
        elif name == "skewX" and count == 1:
            step = _Frame(1.0, 0.0, math.tan(math.radians(values[0])), 1.0, 0.0, 0.0)
        elif name == "skewY" and count == 1:
            step = _Frame(1.0, math.tan(math.radians(values[0])), 0.0, 1.0, 0.0, 0.0)
        else:
            raise OutlineError(f"transform {name} with {count} numbers is not understood")
        frame = frame @ step
    return frame


def _length(text: str, what: str) -> tuple[float, str]:
    """Number and unit (lower case, '' for none) of a length."""
    match = _LENGTH.fullmatch(text)
    if match is None or not math.isfinite(float(match[1])):
        raise OutlineError(f"{what} is {text!r}, not a length")
    unit = match[2].lower()
    if unit not in ("", "%") and unit not in _MM:
        raise OutlineError(f"{what} is {text!r}: the unit {match[2]!r} is not supported; use mm, cm, in or px")
    return float(match[1]), unit


def _document_frame(root: ElementTree.Element) -> tuple[_Frame, bool]:
    """The map of the outermost svg element and whether the document has a physical size."""
    if root.get("transform") is not None:
        raise OutlineError("a transform on the svg element itself is not supported; put it on a group")
    sizes: dict[str, tuple[float, str]] = {}
    for name in ("width", "height"):
        text = root.get(name, "auto").strip()
        if text != "auto":
            value, unit = _length(text, name)
            if unit != "%":  # of a window nobody knows: no size
                if value <= 0.0:
                    raise OutlineError(f"{name} of the svg element is {text!r}: it must be above 0")
                sizes[name] = (value, unit)
    box = None
    if "viewBox" in root.attrib:
        box = _numbers(root.attrib["viewBox"], "viewBox")
        if len(box) != 4 or not (box[2] > 0.0 and box[3] > 0.0):
            raise OutlineError(
                f"viewBox is {root.attrib['viewBox']!r}: it must be four numbers, the width and height above 0"
            )
    spans = {"width": box[2], "height": box[3]} if box else {}
    physical = {name: value * _MM[unit] for name, (value, unit) in sizes.items() if unit}
    if not physical:
        for name, (value, _) in sizes.items():
            if box and abs(value - spans[name]) > 1e-9 * value:
                raise OutlineError(
                    f"{name} is {value:g} without a unit but the viewBox spans {spans[name]:g}: the size of a unit is "
                    f'not clear; write {name}="{value:g}mm" (or the unit that is meant)'
                )
        return _Frame(1.0, 0.0, 0.0, -1.0, 0.0, 0.0), False
    if len(physical) != len(sizes):
        raise OutlineError("width and height of the svg element must both have a unit or both have none")
    if box is None:
        return _Frame(_MM_PER_PX, 0.0, 0.0, -_MM_PER_PX, 0.0, 0.0), True
    scales = [physical[name] / spans[name] for name in physical]
    words = root.get("preserveAspectRatio", "xMidYMid").split()
    known = re.fullmatch(r"none|x(Min|Mid|Max)Y(Min|Mid|Max)", words[0]) if words else None
    if known is None or words[1:] not in ([], ["meet"], ["slice"]):
        raise OutlineError(f"preserveAspectRatio is {' '.join(words)!r}, which SVG does not know")
    if words[0] != "none":
        scales = [max(scales) if words[1:] == ["slice"] else min(scales)]
    return _Frame(scales[0], 0.0, 0.0, -scales[-1], 0.0, 0.0), True


def _svg_root(file: Path) -> ElementTree.Element:
    data = file.read_bytes()

    def refuse(name: str, *_: Any) -> None:
        raise OutlineError(
            f"{file}: the document type declares the entity {name!r}; entities are not expanded, so save as plain SVG"
        )

    guard = expat.ParserCreate()
    guard.EntityDeclHandler = refuse
    try:
        guard.Parse(data, True)
        root = ElementTree.fromstring(data)
    except (expat.ExpatError, ElementTree.ParseError, LookupError, ValueError) as error:
        raise OutlineError(f"{file}: not an SVG file, or damaged ({error}); export it again as plain SVG") from None
    if root.tag not in ("svg", _SVG + "svg"):
        raise OutlineError(f"{file}: the outermost element is <{root.tag}>, not <svg>; export it again as plain SVG")
    return root


def _svg_pieces(file: Path) -> Iterator[_Piece]:
    root = _svg_root(file)
    try:
        frame, physical = _document_frame(root)
    except OutlineError as error:
        raise OutlineError(f"{file}: {error}") from None
    namespace = _SVG if root.tag.startswith(_SVG) else ""
    pending = [(child, frame) for child in reversed(root)]
    for style in root.iter(f"{namespace}style"):
        sheet = re.sub(r"/\*.*?\*/", "", "".join(style.itertext()), flags=re.DOTALL)
        _refuse_css(re.findall(r"[{;]\s*([a-zA-Z-]+)\s*:", sheet), f"{file}: <style>")
    while pending:
        element, outer = pending.pop()
        if not isinstance(element.tag, str) or not element.tag.startswith(namespace):
            continue
        name = element.tag[len(namespace) :]
        if name.startswith("{") or name in _NOT_DRAWN:
            continue
        identity = element.get("id")
        label = f"<{name}>" if identity is None else f"<{name} id={identity!r}>"
        style_text = element.get("style", "")
        css = {key.strip(): value.strip() for key, _, value in (part.partition(":") for part in style_text.split(";"))}
        if "none" in (css.pop("display", "").lower(), element.get("display", "").strip().lower()):
            continue
        _refuse_css(css, f"{file}: {label}")
        for key in ("clip-path", "mask"):
            if element.get(key, "none").strip() != "none":
                raise OutlineError(f"{file}: {label} has a {key}, which is not supported; cut the curve instead")
        try:
            inner = outer @ _transform(element.get("transform", ""))
            if name in ("g", "a"):
                pending.extend((child, inner) for child in reversed(element))
                continue
            segments = _svg_segments(element, name, inner, physical)
        except OutlineError as error:
            raise OutlineError(f"{file}: {label}: {error}") from None
        yield from (_Piece(segment, label) for segment in segments)


def _refuse_css(properties: Iterable[str], where: str) -> None:
    for name in properties:
        if name.lower() in _GEOMETRY_PROPERTIES:
            raise OutlineError(f"{where} sets {name!r} by CSS, which is not supported; set it as an attribute")


def _svg_segments(element: ElementTree.Element, name: str, frame: _Frame, physical: bool) -> list[Segment]:
    def length(key: str, default: float | None = 0.0) -> float | None:
        text = element.get(key)
        if text is None or (default is None and text.strip() == "auto"):
            return default
        value, unit = _length(text, key)
        if unit in ("", "px"):
            return value
        if unit == "%" or not physical:
            raise OutlineError(f"{key} is {text!r}: write it in user units, as a number without a unit")
        return value * _MM[unit] / _MM_PER_PX

    def number(key: str) -> float:
        return length(key) or 0.0

    if name == "path":
        return _path_segments(element.get("d", ""), frame)
    if name == "line":
        return [frame.line((number("x1"), number("y1")), (number("x2"), number("y2")))]
    if name in ("polyline", "polygon"):
        values = _numbers(element.get("points", ""), "points")
        if len(values) % 2:
            raise OutlineError(f"points has {len(values)} numbers, an x without a y")
        points = list(zip(values[::2], values[1::2], strict=True))
        if name == "polygon":
            points = points + points[:1]
        return [frame.line(a, b) for a, b in pairwise(points)]
    if name in ("circle", "ellipse"):
        centre = (number("cx"), number("cy"))
        rx = number("r") if name == "circle" else length("rx", None)
        ry = number("r") if name == "circle" else length("ry", None)
        rx, ry = (ry if rx is None else rx) or 0.0, (rx if ry is None else ry) or 0.0
        _check_sizes(rx, ry)
        return [frame.ellipse(centre, rx, ry, 0.0, 0.0, _FULL_TURN)] if rx and ry else []
    if name == "rect":
        x, y, width, height = number("x"), number("y"), number("width"), number("height")
        rx, ry = length("rx", None), length("ry", None)
        rx, ry = (ry if rx is None else rx) or 0.0, (rx if ry is None else ry) or 0.0
        _check_sizes(width, height, rx, ry)
        if not (width and height):
            return []
        rx, ry = min(rx, 0.5 * width), min(ry, 0.5 * height)
        if not (rx and ry):
            corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)]
            return [frame.line(a, b) for a, b in pairwise(corners)]
        left, right, top, bottom = x + rx, x + width - rx, y + ry, y + height - ry
        quarter = 0.5 * math.pi
        segments: list[Segment] = []
        for centre, first, side in (
            ((right, top), -quarter, ((x + width, top), (x + width, bottom))),
            ((right, bottom), 0.0, ((right, y + height), (left, y + height))),
            ((left, bottom), quarter, ((x, bottom), (x, top))),
            ((left, top), 2.0 * quarter, ((left, y), (right, y))),
        ):
            segments.append(frame.ellipse(centre, rx, ry, 0.0, first, quarter))
            segments.append(frame.line(*side))
        return segments
    raise OutlineError("this element is not supported in an outline; convert it to a path or delete it")


def _check_sizes(*sizes: float) -> None:
    if min(sizes) < 0.0:
        raise OutlineError(f"a width, height or radius is {min(sizes):g}: it must not be negative")


def _path_segments(data: str, frame: _Frame) -> list[Segment]:
    """The segments of SVG path data. Unlike a viewer, which draws up to the first mistake, any mistake is an error."""
    at = len(data) - len(data.lstrip())
    segments: list[Segment] = []
    here: Point = (0.0, 0.0)
    begin = here
    # Where the last control point was, for the smooth commands, and of which kind.
    control, control_kind = here, ""
    if data.strip() and data[at] not in "Mm":
        raise OutlineError(f"path data begins with {data[at]!r} instead of M or m")
    while at < len(data):
        match = _COMMAND.match(data, at)
        if match is None:
            raise OutlineError(f"path data is not understood at {data[at : at + 20]!r}")
        at = match.end()
        letter = match[1]
        kind, relative = letter.upper(), letter.islower()
        count = _ARGUMENTS[kind]
        values = _numbers(match[2], f"path command {letter}", (3, 4) if kind == "A" else (), 7)
        if (len(values) % count or not values) if count else values:
            raise OutlineError(f"path command {letter} has {len(values)} numbers, which does not fit its {count}")
        if kind == "Z":
            if here != begin:
                segments.append(frame.line(here, begin))
            here, control_kind = begin, ""
            continue
        for row in (values[i : i + count] for i in range(0, len(values), count)):
            base = here if relative else (0.0, 0.0)
            if kind in "HV":
                end = (base[0] + row[0], here[1]) if kind == "H" else (here[0], base[1] + row[0])
            else:
                end = (base[0] + row[-2], base[1] + row[-1])
            inner = [(base[0] + row[i], base[1] + row[i + 1]) for i in range(0, count - 2, 2)] if kind in "CSQ" else []
            if kind in "ST":
                # The last control point mirrored at the current point, if the last command was of the same family.
                same = control_kind == ("C" if kind == "S" else "Q")
                inner.insert(0, (2.0 * here[0] - control[0], 2.0 * here[1] - control[1]) if same else here)
            control_kind = ""
            if kind == "M":
                begin = end
                kind = "L"  # further pairs are lines
            elif kind == "A":
                segments.extend(_path_arc(frame, here, end, row))
            elif inner:
                segments.append(frame.bezier(here, *inner, end))
                control, control_kind = inner[-1], "C" if kind in "CS" else "Q"
            elif here != end:
                segments.append(frame.line(here, end))
            here = end
    return segments


def _path_arc(frame: _Frame, start: Point, end: Point, row: list[float]) -> list[Segment]:
    """An SVG arc from its end points: the centre form of the standard's implementation notes (SVG 1.1, F.6.5)."""
    rx, ry, tilt = abs(row[0]), abs(row[1]), math.radians(row[2])
    if start == end:
        return []
    if rx == 0.0 or ry == 0.0:
        return [frame.line(start, end)]
    cos, sin = math.cos(tilt), math.sin(tilt)
    dx, dy = 0.5 * (start[0] - end[0]), 0.5 * (start[1] - end[1])
    # In units of the radii, along the axes: half the chord, then the centre from its middle.
    px, py = (cos * dx + sin * dy) / rx, (cos * dy - sin * dx) / ry
    square = px * px + py * py
    if square > 1.0:
        # Radii too small to reach are enlarged until they just do.
        root = math.sqrt(square)
        rx, ry, px, py, square = rx * root, ry * root, px / root, py / root, 1.0
    away = math.sqrt(max(0.0, 1.0 / square - 1.0)) * (1.0 if row[3] != row[4] else -1.0)
    qx, qy = away * py, -away * px
    first, last = math.atan2(py - qy, px - qx), math.atan2(-py - qy, -px - qx)
    sweep = (last - first) % _FULL_TURN
    if not row[4]:
        sweep -= _FULL_TURN
    centre = (
        0.5 * (start[0] + end[0]) + cos * rx * qx - sin * ry * qy,
        0.5 * (start[1] + end[1]) + sin * rx * qx + cos * ry * qy,
    )
    return [frame.ellipse(centre, rx, ry, tilt, first, sweep)]
