"""Read the pieces drawn in a DXF file, and write an outline to one."""

from __future__ import annotations

import io
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from mirror_cad.errors import OutlineError, WriteError
from mirror_cad.outline.dxf_drawn import drawn_entities, open_dxf, printable
from mirror_cad.outline.numbers import FULL_TURN, FloatArray, point_text
from mirror_cad.outline.options import FILE_JOIN_TOLERANCE_MM
from mirror_cad.outline.pieces import Piece, elliptic_arc
from mirror_cad.outline.record import Outline
from mirror_cad.outline.segments import Arc, Line, Segment, Spline, arc_between
from mirror_cad.outline.transition import TRANSITION_LAYER, TransitionLine

if TYPE_CHECKING:
    from ezdxf.entities import DXFEntity

_MM_PER_UNIT = {
    0: 1.0, 1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1000.0, 8: 25.4e-6, 9: 25.4e-3, 10: 914.4, 13: 1e-3, 14: 100.0
}  # fmt: skip
_ENTITIES = "LINE, ARC, CIRCLE, ELLIPSE, LWPOLYLINE, POLYLINE and SPLINE"
# An arc that rises less than this over its chord is a line: its centre is too far away to place its ends.
_FLAT_MM = 1e-6
_ELEVATION_TOLERANCE_MM = 1e-6


def dxf_pieces(file: Path, layer: str | None, notes: list[str]) -> Iterator[Piece]:
    """The pieces drawn in a DXF file, in mm; `mirror_cad.outline.files.read_outline` says what counts."""
    try:
        document, unit = open_dxf(file, notes)
        entities = list(drawn_entities(document, file, layer, notes))
    except OutlineError:
        raise
    except Exception as error:
        raise OutlineError(
            f"{file}: damaged DXF file ({type(error).__name__}: {printable(error)}); export it again as R2000 or later"
        ) from None
    scale = _MM_PER_UNIT.get(unit) if isinstance(unit, int) else None
    if scale is None:
        raise OutlineError(
            f"{file}: unit code $INSUNITS = {unit!r} is not supported; use 4 (mm), 5 (cm), 6 (m), 1 (in) or 2 (ft)"
        )
    level: tuple[float, str] | None = None
    for entity, label in entities:
        try:
            segments, elevations = _dxf_segments(entity, entity.dxftype(), scale)
        except OutlineError as error:
            raise OutlineError(f"{file}: {label}: {error}") from None
        except Exception as error:
            raise OutlineError(f"{file}: {label} is damaged ({type(error).__name__}: {printable(error)})") from None
        for z in elevations:
            level = level or (z, label)
            if not abs(z - level[0]) <= _ELEVATION_TOLERANCE_MM:
                raise OutlineError(
                    f"{file}: the outline is not in one plane: z = {level[0]:.6g} mm at {level[1]} but {z:.6g} mm at "
                    f"{label}; flatten the drawing"
                )
        yield from (Piece(segment, label) for segment in segments)


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
        first, turn = 0.0, FULL_TURN
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
        turn = _turn(first, entity.dxf.get("end_param", FULL_TURN), FULL_TURN)
        return [elliptic_arc((x, y), u[:2], v, first, turn)], [z, z + u[2]]
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


def write_dxf(outline: Outline, path: str | os.PathLike[str], transition: TransitionLine | None = None) -> None:
    """Write an outline to a DXF file: R2010, mm ($INSUNITS = 4), LINE, ARC, CIRCLE and SPLINE on the layer OUTLINE.

    `read_outline` reads the same curve back to rounding; a full circle then starts at its rightmost point. When the environment
    variable SOURCE_DATE_EPOCH is set, the dates and identifiers in the file are constants instead of the current time and
    random numbers, and writing twice gives the same bytes.

    Parameters
    ----------
    outline : Outline
        What to write.
    path : str or path
        Of the file.
    transition : TransitionLine, optional
        Where an aspheric part begins: a LINE on the layer TRANSITION, which `read_outline` leaves out.

    Raises
    ------
    OutlineError
        Where a segment is so short (1e-3 mm) that a reader joining ends that close would lose it.
    WriteError
        Where the file cannot be written.
    """
    import ezdxf

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
                    f"{path}: segment {i + 1} at {point_text(segment.start)} is not longer than {FILE_JOIN_TOLERANCE_MM:g} "
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
        if transition is not None:
            document.layers.add(TRANSITION_LAYER)
            ends = [(transition.x_mm, y) for y in (transition.low_mm, transition.high_mm)]
            space.add_line(*ends, {"layer": TRANSITION_LAYER})
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
