"""Sag function in, a B-spline surface with u = x, v = y and the error it reached out."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from mirror_cad.bspline import BSplineSurface
from mirror_cad.curvature import Break
from mirror_cad.differential import ShapeOperator, principal_curvatures_of, shape_operator, shape_operator_of_sag
from mirror_cad.errors import SurfaceError
from mirror_cad.sections import DecoupledSag

Array = NDArray[np.float64]
PointSet = Callable[[Array, Array], Array]

# Where a span is looked at: off the collocation sites, and close enough to its ends to see the end effects.
INSIDE_SPAN = np.array([0.06, 0.29, 0.5, 0.71, 0.94])
# Places a direction at which a finished fit is measured at least: where a curvature passes through zero, its percent has
# a peak a few millimetres wide.
DENSEST = 150
# More soft breaks (a table's nodes) than this are left to the refinement: a knot at each would only slow it.
MOST_SOFT_BREAKS = 64
# Beyond the mirror the sheet may miss by ten times the tolerances: an error there reaches inside through the smooth knots.
OUTSIDE_SHARE = 0.1
MOST_SPANS = 400  # a direction; a law that needs more holds structure far below what glass can take
ROUNDS = 24
DEGREE_FIRST, DEGREE_THEN = 5, 7  # "auto": quintic, and septic where quintic wants more than MANY_SPANS
MANY_SPANS = 96


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A fitted surface and what it reached against its sag, measured off the nodes over the mirror's bounding box."""

    surface: BSplineSurface
    route: str
    degree: int
    spans: tuple[int, int]
    position_error_mm: float
    curvature_error_percent: float | None  # None for a plane, which has no percent
    worst_at_mm: tuple[float, float]
    seconds: float
    met: bool


@dataclass(frozen=True, slots=True, eq=False)
class FitTask:
    """What has to be fitted: the sag, where it is needed, where it is judged, and its percent of curvature.

    domain, judged : (x_min, x_max, y_min, y_max) mm.   breaks : where z(x, ·) has few derivatives, as (x, derivatives).
    percent_of : x (n,) -> (n, 2), the curvature 1/mm that counts as 100 % for k1 and k2; zeros for a plane.
    """

    sag: DecoupledSag
    domain: tuple[float, float, float, float]
    judged: tuple[float, float, float, float]
    breaks: tuple[tuple[float, int], ...]
    percent_of: Callable[[Array], Array]
    position_tolerance_mm: float
    curvature_tolerance_percent: float


def sheet_breaks(horizontal: Sequence[Break], vertical: Sequence[Break]) -> tuple[tuple[float, int], ...]:
    """Continuous x-derivatives of z at each break: two more than of κ₁, as many as of κ₂."""
    order: dict[float, int] = {}
    for b in horizontal:
        order[b.x_mm] = min(order.get(b.x_mm, 99), b.smoothness + 2)
    for b in vertical:
        order[b.x_mm] = min(order.get(b.x_mm, 99), b.smoothness)
    return tuple(sorted(order.items()))


# --- collocation -----------------------------------------------------------------------------------------------------


def greville_abscissae(knots: Array, degree: int) -> Array:
    """g_i = (t_i+1 + … + t_i+p)/p: the collocation sites, and the poles of the identity."""
    windows = np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree)
    sites: Array = windows.mean(axis=1)
    sites[0], sites[-1] = knots[0], knots[-1]
    return sites


def collocate(points: PointSet, knots_u: Array, knots_v: Array, degree: int) -> BSplineSurface:
    """The B-spline surface through points(u, v) at the Greville abscissae.

    points : u (m,), v (n,) -> (m, n, 3) mm.
    Raises: SurfaceError where a point is not finite, with its parameters.
    Source: C. de Boor, A Practical Guide to Splines, chapter XIII.
    """
    u, v = greville_abscissae(knots_u, degree), greville_abscissae(knots_v, degree)
    values = points(u, v)
    bad = ~np.isfinite(values).all(axis=2)
    if bad.any():
        i, j = np.argwhere(bad)[0]
        raise SurfaceError(f"the point set is not finite at (x, y) = ({u[i]:.3f}, {v[j]:.3f}) mm")
    along_u = make_interp_spline(u, values, k=degree, t=knots_u, axis=0, check_finite=False).c
    poles = make_interp_spline(v, along_u, k=degree, t=knots_v, axis=1, check_finite=False).c
    # scipy keeps the interpolated axis first.
    poles = poles if poles.shape[:2] == (len(u), len(v)) else np.moveaxis(poles, 0, 1)
    return BSplineSurface(degree, degree, knots_u, knots_v, np.ascontiguousarray(poles))


def collocate_sag(sag: DecoupledSag, knots_x: Array, knots_y: Array, degree: int) -> BSplineSurface:
    """`collocate` for (x, y, z(x, y)); x and y are reproduced exactly, so u = x and v = y."""
    surface = collocate(lambda x, y: sag.height(x[:, None], y)[..., None].repeat(3, axis=2), knots_x, knots_y, degree)
    poles = surface.poles.copy()
    poles[..., 0] = greville_abscissae(knots_x, degree)[:, None]
    poles[..., 1] = greville_abscissae(knots_y, degree)
    return BSplineSurface(degree, degree, knots_x, knots_y, poles)


def knot_vector(ends: Array, breaks: Sequence[tuple[float, int]], degree: int) -> Array:
    """Clamped knots over the spans' ends, repeated at a break so that only its derivatives stay continuous."""
    orders = dict(breaks)
    inner = [[end] * max(1, min(degree, degree - orders.get(float(end), degree - 1))) for end in ends[1:-1]]
    return np.concatenate([[ends[0]] * (degree + 1), *inner, [ends[-1]] * (degree + 1)]).astype(np.float64)


def _span_ends(low: float, high: float, breaks: Sequence[tuple[float, int]], degree: int, count: int) -> Array:
    """`count` spans between low and high, shared out over the stretches between breaks by their length."""
    hard = [x for x, order in breaks if low < x < high and order < degree]
    soft = len(hard) > MOST_SOFT_BREAKS
    corners = [low, *(x for x, order in breaks if low < x < high and order < (4 if soft else degree)), high]
    lengths = np.diff(corners)
    shares = np.ones(len(lengths), dtype=int)
    while shares.sum() < count:
        shares[np.argmax(lengths / shares)] += 1
    parts = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(corners[:-1], corners[1:], shares, strict=True)]
    return np.concatenate([*parts, [high]])


def fit_by_collocation(task: FitTask, degree: int | str, spans: tuple[int, int] | str) -> Fit:
    """Collocation, with the spans that miss the tolerances halved until all meet them.

    Spans stand at the law's breaks from the start. With degree and spans given, they are taken as they are.
    """
    start = time.perf_counter()
    first = DEGREE_FIRST if degree == "auto" else int(degree)
    fit = _refine(task, first, spans)
    if degree == "auto" and spans == "auto" and (not fit.met or max(fit.spans) > MANY_SPANS):
        higher = _refine(task, DEGREE_THEN, spans)
        if higher.met or higher.position_error_mm < fit.position_error_mm:
            fit = higher
    seconds = time.perf_counter() - start
    return Fit(fit.surface, fit.route, fit.degree, fit.spans, fit.position_error_mm, fit.curvature_error_percent,
               fit.worst_at_mm, seconds, fit.met)


def _refine(task: FitTask, degree: int, spans: tuple[int, int] | str) -> Fit:
    x_min, x_max, y_min, y_max = task.domain
    nx, ny = (6, 3) if isinstance(spans, str) else spans
    ends_x = _span_ends(x_min, x_max, task.breaks, degree, nx)
    ends_y = _span_ends(y_min, y_max, (), degree, ny)
    narrowest = _narrowest_span(task, _on_spans(task, ends_x, ends_y, degree))
    # Each direction alone first, cheaply: what it misses at the sites of the other is its own error.
    for _ in range(ROUNDS):
        surface = _on_spans(task, ends_x, ends_y, degree)
        if not isinstance(spans, str):
            return measure(task, surface, "collocation", degree, (len(ends_x) - 1, len(ends_y) - 1))
        next_x = _halved(ends_x, _directional_misses(task, surface, ends_x, "x") > 1.0, narrowest)
        next_y = _halved(ends_y, _directional_misses(task, surface, ends_y, "y") > 1.0, narrowest)
        if max(len(next_x), len(next_y)) > MOST_SPANS or (len(next_x), len(next_y)) == (len(ends_x), len(ends_y)):
            break
        ends_x, ends_y = next_x, next_y
    fit = measure(task, surface, "collocation", degree, (len(ends_x) - 1, len(ends_y) - 1))
    # Then what only shows in both together (the mixed derivative): halve where it helps more.
    for _ in range(ROUNDS):
        if fit.met:
            break
        trials = []
        more_x = _halved(ends_x, _misses_by_span(task, surface, ends_x), narrowest)
        more_y = _halved(ends_y, np.ones(len(ends_y) - 1, dtype=bool), narrowest)
        for trial_x, trial_y in ((more_x, ends_y), (ends_x, more_y), (more_x, more_y)):
            if (len(trial_x), len(trial_y)) != (len(ends_x), len(ends_y)) and max(len(trial_x), len(trial_y)) <= MOST_SPANS:
                trial = measure(task, _on_spans(task, trial_x, trial_y, degree), "collocation", degree,
                                (len(trial_x) - 1, len(trial_y) - 1))
                trials.append((_excess(task, trial), trial, trial_x, trial_y))
        if not trials:
            break
        excess, trial, trial_x, trial_y = min(trials, key=lambda entry: entry[0])
        if excess >= _excess(task, fit):
            break
        fit, surface, ends_x, ends_y = trial, trial.surface, trial_x, trial_y
    return fit


def _on_spans(task: FitTask, ends_x: Array, ends_y: Array, degree: int) -> BSplineSurface:
    return collocate_sag(task.sag, knot_vector(ends_x, task.breaks, degree), knot_vector(ends_y, (), degree), degree)


def _excess(task: FitTask, fit: Fit) -> float:
    return max(fit.position_error_mm / task.position_tolerance_mm,
               (fit.curvature_error_percent or 0.0) / task.curvature_tolerance_percent)


def _misses_by_span(task: FitTask, surface: BSplineSurface, ends_x: Array) -> NDArray[np.bool_]:
    """The x spans in which a tolerance is missed, and their neighbours."""
    x, _, position, percent = _errors(task, surface)
    over = position > task.position_tolerance_mm
    if percent is not None:
        over |= percent > task.curvature_tolerance_percent
    missed = np.zeros(len(ends_x) + 1, dtype=bool)
    missed[np.searchsorted(ends_x, x[over.any(axis=1)], side="right")] = True
    near: NDArray[np.bool_] = (missed[:-2] | missed[1:-1] | missed[2:])
    return near


def _narrowest_span(task: FitTask, surface: BSplineSurface) -> float:
    """Below this width the rounding of z, some 50·ε·|z|/h² in curvature, would eat a tenth of the tolerance."""
    allowed = 1e-3 * task.curvature_tolerance_percent * float(task.percent_of(np.array(task.judged[:2])).min())
    height = float(np.abs(surface.poles[..., 2]).max())
    width = task.domain[1] - task.domain[0]
    return max(1e-6 * width, float(np.sqrt(50.0 * np.finfo(float).eps * height / allowed)) if allowed > 0 else 0.0)


def _halved(ends: Array, over: NDArray[np.bool_], narrowest: float) -> Array:
    """The span ends with the middle of every span that is over, unless that would be too narrow to gain from."""
    middles = 0.5 * (ends[:-1] + ends[1:])
    return np.sort(np.concatenate([ends, middles[over & (np.diff(ends) > 2.0 * narrowest)]]))


def _directional_misses(task: FitTask, surface: BSplineSurface, ends: Array, direction: str) -> Array:
    """Error over tolerance in each span of one direction, at the sites of the other: no error of the other mixes in."""
    x_min, x_max, y_min, y_max = task.judged
    inside = (ends[:-1, None] + np.diff(ends)[:, None] * INSIDE_SPAN).ravel()
    if direction == "x":
        x, y = inside, _sites_within(surface.knots_v, surface.degree_v, y_min, y_max)
    else:
        x, y = _sites_within(surface.knots_u, surface.degree_u, x_min, x_max), np.clip(inside, y_min, y_max)
    got = surface.on_grid(x, y)
    want = task.sag.derivatives(x[:, None], y)
    position = np.abs(got["s"][..., 2] - want.z) / task.position_tolerance_mm
    miss = position
    bend = got["uu"][..., 2] - want.zxx if direction == "x" else got["vv"][..., 2] - want.zyy
    allowed = task.percent_of(x).min(axis=1) * task.curvature_tolerance_percent
    if allowed.all():
        miss = np.maximum(miss, np.abs(bend) / allowed[:, None])
    per_line = miss.max(axis=1 if direction == "x" else 0)
    if direction == "x":
        per_line = np.where((x >= x_min) & (x <= x_max), per_line, OUTSIDE_SHARE * per_line)
    result: Array = per_line.reshape(-1, len(INSIDE_SPAN)).max(axis=1)
    return result


def _sites_within(knots: Array, degree: int, low: float, high: float) -> Array:
    """The collocation sites between low and high; a few places there while a small mirror in a large blank has none."""
    sites = greville_abscissae(knots, degree)
    sites = sites[(sites >= low) & (sites <= high)]
    return sites if len(sites) >= 3 else np.linspace(low, high, 5)


# --- what a fit reached ----------------------------------------------------------------------------------------------


def measure(task: FitTask, surface: BSplineSurface, route: str, degree: int, spans: tuple[int, int]) -> Fit:
    """Position and curvature error of a surface with u = x, v = y, off the nodes over the judged rectangle."""
    x, y, position, percent = _errors(task, surface)
    worst = np.unravel_index(np.argmax(position if percent is None else percent), position.shape)
    largest = None if percent is None else float(percent.max())
    met = float(position.max()) <= task.position_tolerance_mm
    met = met and (largest is None or largest <= task.curvature_tolerance_percent)
    return Fit(surface, route, degree, spans, float(position.max()), largest,
               (float(x[worst[0]]), float(y[worst[1]])), 0.0, met)


def _errors(task: FitTask, surface: BSplineSurface) -> tuple[Array, Array, Array, Array | None]:
    """Places x (m,), y (n,) off the nodes, position error (m, n) in mm and curvature error (m, n) in percent there."""
    x_min, x_max, y_min, y_max = task.judged
    x = _between(surface.knots_u, x_min, x_max)
    y = _between(surface.knots_v, y_min, y_max)
    got = surface.on_grid(x, y)
    want = task.sag.derivatives(x[:, None], y)
    percent = curvature_percent(shape_operator(got), shape_operator_of_sag(want), task.percent_of(x)[:, None, :])
    return x, y, np.abs(got["s"][..., 2] - want.z), percent


def curvature_percent(got: ShapeOperator, want: ShapeOperator, percent_of: Array) -> Array | None:
    """The larger of the two principal curvatures' errors in percent; None where nothing is curved."""
    if not np.any(percent_of > 0):
        return None
    errors = [np.abs(a - b) for a, b in zip(principal_curvatures_of(got), principal_curvatures_of(want), strict=True)]
    result: Array = 100.0 * np.maximum(errors[0] / percent_of[..., 0], errors[1] / percent_of[..., 1])
    return result


def _between(knots: Array, low: float, high: float) -> Array:
    """Points inside every span within [low, high], never on a knot, and DENSEST of them or more in all."""
    ends = np.unique(np.clip(np.unique(knots), low, high))
    count = max(len(INSIDE_SPAN), -(-DENSEST // (len(ends) - 1)))
    inside = INSIDE_SPAN if count == len(INSIDE_SPAN) else (np.arange(count) + 0.5) / count
    return (ends[:-1, None] + np.diff(ends)[:, None] * inside).ravel()
