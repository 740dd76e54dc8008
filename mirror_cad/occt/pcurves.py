"""Approximate curves in a face's parameters by polygons, within a share of the face's size.

Arcs and splines are evaluated all at once; the kernel, which takes a microsecond a point, evaluates what is neither.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from OCP.BRepAdaptor import BRepAdaptor_Curve2d
from OCP.Geom2d import Geom2d_BSplineCurve
from OCP.GeomAbs import GeomAbs_BSplineCurve, GeomAbs_C1, GeomAbs_Circle, GeomAbs_Ellipse, GeomAbs_Line
from OCP.gp import gp_Circ2d, gp_Elips2d
from OCP.TColStd import TColStd_Array1OfReal

Array = NDArray[np.float64]

# Trimming polygons stay this close to the pcurves, as a share of the parameter range in either direction.
LOOP_CHORD = 1e-8
MAX_CHORDS = 1 << 15  # of one smooth piece of a pcurve
STRAIGHT = 1e-3  # of LOOP_CHORD: poles as far beside a line are on it but for rounding
STRAIGHT_CHORDS = 16  # of a spline that is a straight line
MAX_PARTS = 64  # that a chord is divided into at once
FIRST_CHORDS = 8  # of a smooth piece of a curve of which nothing is known


def polyline(curve: BRepAdaptor_Curve2d, scale: Array) -> Array:
    """Points along a pcurve, ends included, whose chords are within LOOP_CHORD of it, in shares of `scale`."""
    kind, start, end = curve.GetType(), float(curve.FirstParameter()), float(curve.LastParameter())
    if kind == GeomAbs_Line:
        return np.array([curve.Value(start).Coord(), curve.Value(end).Coord()])
    if kind in (GeomAbs_Circle, GeomAbs_Ellipse):
        return _arc_polyline(curve.Circle() if kind == GeomAbs_Circle else curve.Ellipse(), start, end, scale)
    if kind == GeomAbs_BSplineCurve:
        return _spline_polyline(curve.BSpline(), start, end, scale)
    ends = TColStd_Array1OfReal(1, curve.NbIntervals(GeomAbs_C1) + 1)
    curve.Intervals(ends, GeomAbs_C1)
    cuts = np.concatenate([*(np.linspace(a, b, FIRST_CHORDS, endpoint=False) for a, b in pairwise(list(ends))), [end]])
    return _refined(lambda t: np.array([curve.Value(float(value)).Coord() for value in t]), cuts, scale)


def _arc_polyline(conic: gp_Circ2d | gp_Elips2d, start: float, end: float, scale: Array) -> Array:
    """C + a·cos t·X + b·sin t·Y: a chord over the angle h is off by (1 − cos(h/2)) of the radius at most."""
    major, minor = (conic.Radius(),) * 2 if isinstance(conic, gp_Circ2d) else (conic.MajorRadius(), conic.MinorRadius())
    frame = conic.Axis()
    sides = np.array([major * np.array(frame.XDirection().Coord()), minor * np.array(frame.YDirection().Coord())])
    share = LOOP_CHORD / float((major / scale).max())
    chords = int(np.ceil((end - start) / (2.0 * np.arccos(max(1.0 - share, 0.0)))))
    t = np.linspace(start, end, min(max(chords, 1), MAX_CHORDS) + 1)
    points: Array = np.array(frame.Location().Coord()) + np.stack([np.cos(t), np.sin(t)], axis=1) @ sides
    return points


def _spline_polyline(curve: Geom2d_BSplineCurve, start: float, end: float, scale: Array) -> Array:
    if curve.IsPeriodic():
        curve = curve.Copy()
        curve.SetNotPeriodic()
    degree, count = curve.Degree(), curve.NbPoles()
    poles = np.array([curve.Pole(i).Coord() for i in range(1, count + 1)])
    if curve.IsRational():
        weights = np.array([[curve.Weight(i)] for i in range(1, count + 1)])
        poles = np.concatenate([poles * weights, weights], axis=1)
    distinct = np.array([curve.Knot(i) for i in range(1, curve.NbKnots() + 1)])
    knots = np.repeat(distinct, [curve.Multiplicity(i) for i in range(1, curve.NbKnots() + 1)])

    if _is_straight(poles[:, :2] / poles[:, 2:] if poles.shape[1] == 3 else poles, scale):
        # In a few chords: where the next edge begins is off by the file's rounding, and the last chord alone leads there.
        return np.linspace(curve.Value(start).Coord(), curve.Value(end).Coord(), STRAIGHT_CHORDS + 1)

    def evaluate(t: Array) -> Array:
        # De Boor's algorithm on all t at once (The NURBS Book, eq. 5.11).
        span = np.clip(np.searchsorted(knots, t, side="right") - 1, degree, count - 1)
        local = [poles[span - degree + j] for j in range(degree + 1)]
        for r in range(1, degree + 1):
            for j in range(degree, r - 1, -1):
                low, high = knots[span - degree + j], knots[span + 1 + j - r]
                share = ((t - low) / (high - low))[:, None]
                local[j] = (1.0 - share) * local[j - 1] + share * local[j]
        at = local[degree]
        return at if at.shape[1] == 2 else at[:, :2] / at[:, 2:]

    ends = np.concatenate([[start], distinct[(distinct > start) & (distinct < end)], [end]])
    # One of degree 1 is its own polygon.
    parts = 1 if degree == 1 and poles.shape[1] == 2 else degree
    inner = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(parts) / parts
    return _refined(evaluate, np.append(inner.ravel(), end), scale)


def _is_straight(poles: Array, scale: Array) -> bool:
    """Whether a curve of these poles runs straight from one end to the other: seams do, and are known by it."""
    beside = (poles - poles[0]) / scale
    chord_vector = beside[-1]
    square = float(chord_vector @ chord_vector)
    if square == 0.0:
        return False
    along = beside @ chord_vector / square
    off = np.abs(beside - along[:, None] * chord_vector).max()
    return bool(off <= STRAIGHT * LOOP_CHORD and (np.diff(along) >= -STRAIGHT * LOOP_CHORD).all())


def _refined(evaluate: Callable[[Array], Array], t: Array, scale: Array) -> Array:
    """The points of a curve at t and between, so many that its chords are within LOOP_CHORD of it.

    That is evaluated at a quarter, half and three quarters of each chord.
    """
    uv, most = evaluate(t), MAX_CHORDS * len(t)
    open_ = np.ones(len(t) - 1, dtype=np.bool_)  # the chords that have not been found close enough
    while open_.any() and len(t) <= most:
        chord = np.flatnonzero(open_)
        from_, length = t[chord], t[chord + 1] - t[chord]
        begin, chord_vector = uv[chord] / scale, (uv[chord + 1] - uv[chord]) / scale
        square, off = np.maximum((chord_vector**2).sum(axis=1), 1e-300), np.zeros(len(chord))
        for share in (0.25, 0.5, 0.75):
            # From the chord itself: a curve may run along it at any pace.
            beside = evaluate(from_ + share * length) / scale - begin
            along = np.clip((beside * chord_vector).sum(axis=1) / square, 0.0, 1.0)
            off = np.maximum(off, np.linalg.norm(beside - along[:, None] * chord_vector, axis=1))
        parts = np.ones(len(t) - 1, dtype=np.intp)
        parts[chord] = np.clip(np.ceil(np.sqrt(off / LOOP_CHORD)), 1, MAX_PARTS)  # the error falls with the square
        if parts.max() == 1:
            break
        new = np.concatenate([[0], np.cumsum(parts)])
        owner = np.repeat(np.arange(len(parts)), parts)
        inside = (np.arange(new[-1]) - new[owner]) / parts[owner]
        finer, points = np.append(t[:-1][owner] + inside * np.diff(t)[owner], t[-1]), np.empty((new[-1] + 1, 2))
        kept = np.zeros(len(finer), dtype=np.bool_)
        kept[new] = True
        points[kept], points[~kept] = uv, evaluate(finer[~kept])
        t, uv, open_ = finer, points, parts[owner] > 1
    return uv
