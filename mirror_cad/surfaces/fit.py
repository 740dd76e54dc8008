"""Fit a B-spline surface with u = x, v = y to a sag function, and measure the error it reaches."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mirror_cad.sections import Sag, SagDerivatives
from mirror_cad.surfaces.basis import greville_abscissae
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import collocate_height, knot_vector
from mirror_cad.surfaces.differential import ShapeOperator, principal_curvatures_of, shape_operator, shape_operator_of_sag
from mirror_cad.surfaces.spans import MAX_SOFT_BREAKS, MAX_SPANS, cut_spans, parts_of_each, span_ends, too_many

Array = NDArray[np.float64]

# Where a span is looked at: off the collocation sites, and close enough to its ends to see the end effects.
INSIDE_SPAN = np.array([0.06, 0.29, 0.5, 0.71, 0.94])
# Points a direction at which a fit is looked at, at least. Along x the percent has peaks a few millimetres wide where a
# curvature passes through zero; along y what counts as 100 % does not change.
DENSEST_X, DENSEST_Y = 150, 30
# Beyond the mirror the sheet may miss by ten times the tolerances: an error there reaches inside through the smooth knots.
# Through spans that narrow towards a break near the edge it does so undamped: where a cut lowers the error inside to no less
# than this share, which by the order of convergence it should do by far, the sheet is held to the tolerances everywhere.
OUTSIDE_SHARE, LEAST_FALL = 0.1, 0.5
# The spans are cut until the points looked at stay below this share of the tolerances: others may be a little worse.
TARGET_FRACTION = 0.7
ROUNDS = 24
FIRST_SPANS = (8, 4)
# Points this near to where the design's curvature is smallest are looked at besides: there the percent has its peaks.
SMALL_CURVATURE, MAX_SMALL = 0.05, 100
DEGREE_FIRST, DEGREE_THEN = 5, 7  # "auto": quintic, and septic where quintic wants more than MANY_SPANS
MANY_SPANS = 96


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A fitted surface and what it reached against its sag, measured off the nodes over the mirror's bounding box.

    Attributes
    ----------
    surface : BSplineSurface
        u = x, v = y.
    route : str
        How it was fitted.
    degree : int
        In both directions.
    spans : tuple
        Along x and y.
    position_error_mm : float
        The largest.
    curvature_error_percent : float or None
        The largest of k1 and k2; None for a plane, which has no percent.
    worst_at_mm : tuple
        (x, y) of the largest error, of curvature where there is one.
    seconds : float
        What it took.
    met : bool
        Whether both tolerances hold.
    """

    surface: BSplineSurface
    route: str
    degree: int
    spans: tuple[int, int]
    position_error_mm: float
    curvature_error_percent: float | None
    worst_at_mm: tuple[float, float]
    seconds: float
    met: bool


@dataclass(frozen=True, eq=False)
class FitTask:
    """What has to be fitted: the sag, where it is needed, where it is judged, and its percent of curvature.

    Attributes
    ----------
    sag : Sag
        z(x, y).
    domain, judged : tuple
        (x_min, x_max, y_min, y_max), mm.
    breaks : tuple
        (x, continuous derivatives) where z(x, ·) has few of them.
    reference_curvature : callable
        x (n,) -> (n, 2), the curvature, 1/mm, that counts as 100 % for k1 and k2; zeros for a plane.
    position_tolerance_mm, curvature_tolerance_percent : float
        What the surface is to keep to.
    ends : tuple of ndarray or None
        The spans along x and y to begin with, which the sag itself has when it is a spline in part.
    """

    sag: Sag
    domain: tuple[float, float, float, float]
    judged: tuple[float, float, float, float]
    breaks: tuple[tuple[float, int], ...]
    reference_curvature: Callable[[Array], Array]
    position_tolerance_mm: float
    curvature_tolerance_percent: float
    ends: tuple[Array, Array] | None = None

    @cached_property
    def points_of_small_curvature(self) -> Array:
        """x where what counts as 100 % is a small share of its largest value: none for a law that keeps its size."""
        x = np.linspace(self.judged[0], self.judged[1], 2001)[1:-1]
        scale = self.reference_curvature(x)
        small = x[(scale < SMALL_CURVATURE * scale.max(axis=0)).any(axis=1)]
        return small[:: max(1, -(-len(small) // MAX_SMALL))]


# --- the choice of degree and spans ----------------------------------------------------------------------------------


def fit_by_collocation(task: FitTask, degree: int | str, spans: tuple[int, int] | str) -> Fit:
    """Collocate, with the spans that miss the tolerances cut until all meet them.

    Spans stand at the breaks of the law from the start.

    Parameters
    ----------
    task : FitTask
        What has to be fitted.
    degree : int or "auto"
        In both directions; "auto" is quintic, and septic where that needs many spans.
    spans : tuple or "auto"
        Along x and y. With both given, they are taken as they are.
    """
    start = time.perf_counter()
    first = DEGREE_FIRST if degree == "auto" else int(degree)
    fit = _refine(task, first, spans)
    if degree == "auto" and spans == "auto" and (not fit.met or max(fit.spans) > MANY_SPANS):
        fit = _better(task, fit, _refine(task, DEGREE_THEN, spans))
    if spans == "auto" and not fit.met and MAX_SOFT_BREAKS < len(task.breaks) <= MAX_SPANS:
        fit = _better(task, fit, _refine(task, first, spans, MAX_SPANS))
    return replace(fit, seconds=time.perf_counter() - start)


def _better(task: FitTask, fit: Fit, other: Fit) -> Fit:
    """The other if it keeps to the tolerances, or comes nearer to them where neither does."""
    return other if other.met or (not fit.met and _excess(task, other) < _excess(task, fit)) else fit


def _refine(task: FitTask, degree: int, spans: tuple[int, int] | str, most_soft: int = MAX_SOFT_BREAKS) -> Fit:
    x_min, x_max, y_min, y_max = task.domain
    nx, ny = FIRST_SPANS if isinstance(spans, str) else spans
    ends_x, ends_y = task.ends or (span_ends(x_min, x_max, task.breaks, degree, nx, most_soft),
                                   span_ends(y_min, y_max, (), degree, ny))
    fit, misses = _try(task, ends_x, ends_y, degree)
    if not isinstance(spans, str):
        return fit
    narrowest = _narrowest_span(task, fit.surface)
    # Each direction by its own error first: what it misses at the sites of the other.
    lenient = True
    for _ in range(ROUNDS):
        if _excess(task, fit) <= TARGET_FRACTION:
            return fit
        parts_x = misses.parts_x if lenient else misses.parts_x_everywhere
        next_x, next_y = cut_spans(ends_x, parts_x, narrowest), cut_spans(ends_y, misses.parts_y, narrowest)
        if too_many(next_x, next_y) or (len(next_x), len(next_y)) == (len(ends_x), len(ends_y)):
            break
        before, ends_x, ends_y = _excess(task, fit), next_x, next_y
        fit, misses = _try(task, ends_x, ends_y, degree)
        lenient = lenient and _excess(task, fit) < LEAST_FALL * before
    # Then what only shows in both together (the mixed derivative): halve where it helps more.
    for _ in range(ROUNDS):
        if _excess(task, fit) <= TARGET_FRACTION:
            break
        more_x = cut_spans(ends_x, np.where(misses.over_x, 2, 1), narrowest)
        more_y = cut_spans(ends_y, np.full(len(ends_y) - 1, 2), narrowest)
        trials = [(*_try(task, trial_x, trial_y, degree), trial_x, trial_y)
                  for trial_x, trial_y in ((more_x, ends_y), (ends_x, more_y), (more_x, more_y))
                  if (len(trial_x), len(trial_y)) != (len(ends_x), len(ends_y)) and not too_many(trial_x, trial_y)]
        if not trials:
            break
        best = min(trials, key=lambda trial: _excess(task, trial[0]))
        if _excess(task, best[0]) >= _excess(task, fit):
            break
        fit, misses, ends_x, ends_y = best
    return fit


@dataclass(frozen=True, slots=True, eq=False)
class _Misses:
    """Into how many parts each span should be cut for its direction's own error; which x spans miss in both together.

    `parts_x` lets the sheet beyond the mirror miss by more, `parts_x_everywhere` does not.
    """

    parts_x: NDArray[np.int64]
    parts_x_everywhere: NDArray[np.int64]
    parts_y: NDArray[np.int64]
    over_x: NDArray[np.bool_]


def _try(task: FitTask, ends_x: Array, ends_y: Array, degree: int) -> tuple[Fit, _Misses]:
    """Collocate on these spans and look at the result once, off the sites and at the sites of either direction.

    At the sites of one direction the spline is exact in it, so what is missed there is the other direction's own error.
    """
    knots = knot_vector(ends_x, task.breaks, degree), knot_vector(ends_y, (), degree)
    surface = collocate_height(task.sag.height, *knots, degree)
    x_min, x_max, y_min, y_max = task.judged

    # The surface and the sag at samples: along each axis those off the sites come first, the sites after them.
    inside_x, span_x = _inside(ends_x, x_min, x_max, DENSEST_X, task.points_of_small_curvature)
    inside_y, span_y = _inside(ends_y, y_min, y_max, DENSEST_Y)
    sites_x = _sites_within(surface.knots_u, degree, x_min, x_max)
    sites_y = _sites_within(surface.knots_v, degree, y_min, y_max)
    x, y = np.concatenate([inside_x, sites_x]), np.concatenate([inside_y, sites_y])
    # Beyond the judged height the sections may end: there the nearest judged point stands in.
    y = np.clip(y, y_min, y_max)
    got = _sag_of(surface, x, y)
    want = task.sag.derivatives(x[:, None], y)
    position = np.abs(got.z - want.z)
    reference = task.reference_curvature(x)
    curved = bool(np.any(reference > 0))

    # What each direction misses by itself.
    off_sites_x, sites_along_x = slice(0, len(inside_x)), slice(len(inside_x), None)
    off_sites_y, sites_along_y = slice(0, len(inside_y)), slice(len(inside_y), None)
    exact_in_y, exact_in_x = (off_sites_x, sites_along_y), (sites_along_x, off_sites_y)
    allowed = np.maximum(0.01 * task.curvature_tolerance_percent * reference.min(axis=1), np.finfo(float).tiny)[:, None]
    bend_x = np.abs(got.zxx - want.zxx)[exact_in_y] / allowed[off_sites_x] if curved else None
    bend_y = np.abs(got.zyy - want.zyy)[exact_in_x] / allowed[sites_along_x] if curved else None
    along_x = _parts(position[exact_in_y], bend_x, 1, task, degree)
    along_y = _parts(position[exact_in_x], bend_y, 0, task, degree)
    # Spans that touch the judged edges count in full: across a break only few derivatives are continuous, but those are.
    near = (ends_x[span_x + 1] >= x_min) & (ends_x[span_x] <= x_max)
    lenient = along_x * np.where(near, 1.0, OUTSIDE_SHARE ** (1.0 / (degree - 1)))
    parts_x, parts_x_everywhere = (parts_of_each(per_x, span_x, len(ends_x) - 1) for per_x in (lenient, along_x))
    parts_y = parts_of_each(along_y, span_y, len(ends_y) - 1)

    # What both miss together, off the sites of either over the judged rectangle; and which spans along x that is in.
    rows = np.flatnonzero((inside_x >= x_min) & (inside_x <= x_max))
    columns = np.flatnonzero((inside_y >= y_min) & (inside_y <= y_max))
    block = (rows[:, None], columns)
    off = position[block]
    ours, exact = (shape_operator_of_sag(SagDerivatives(*(part[block] for part in parts))) for parts in (got, want))
    percent = curvature_percent(ours, exact, reference[rows][:, None, :])
    over = off > task.position_tolerance_mm
    if percent is not None:
        over |= percent > task.curvature_tolerance_percent
    over_x = np.zeros(len(ends_x) + 1, dtype=bool)  # of each span and one more at each end: the neighbours count too
    over_x[span_x[rows[over.any(axis=1)]] + 1] = True
    fit = _fit(task, surface, "collocation", x[rows], y[columns], off, percent)
    return fit, _Misses(parts_x, parts_x_everywhere, parts_y, over_x[:-2] | over_x[1:-1] | over_x[2:])


def _inside(ends: Array, low: float, high: float, densest: int, besides: Array | None = None,
            ) -> tuple[Array, NDArray[np.int64]]:
    """Points inside every span, up to low and high where these cut one, `densest` or more; and the span of each."""
    cut = np.union1d(ends, np.clip([low, high], ends[0], ends[-1]))
    count = max(len(INSIDE_SPAN), -(-densest // (len(cut) - 1)))
    shares = INSIDE_SPAN if count == len(INSIDE_SPAN) else (np.arange(count) + 0.5) / count
    points = (cut[:-1, None] + np.diff(cut)[:, None] * shares).ravel()
    # The judged edges too, from within: a curvature that is zero there has its largest percent on them.
    hair = 1e-9 * (high - low)
    points = np.concatenate([points, [low + hair, high - hair], [] if besides is None else besides])
    return points, np.searchsorted(ends, points, side="right") - 1


def _sites_within(knots: Array, degree: int, low: float, high: float) -> Array:
    """The collocation sites between low and high; a few points there while a small mirror in a large blank has none."""
    sites = greville_abscissae(knots, degree)
    sites = sites[(sites >= low) & (sites <= high)]
    return sites if len(sites) >= 3 else np.linspace(low, high, 5)


def _parts(position: Array, bend: Array | None, axis: int, task: FitTask, degree: int) -> Array:
    """Parts that the largest errors along an axis ask for: position falls with h^(p+1), curvature with h^(p−1)."""
    parts: Array = (position.max(axis=axis) / task.position_tolerance_mm) ** (1.0 / (degree + 1))
    return parts if bend is None else np.maximum(parts, bend.max(axis=axis) ** (1.0 / (degree - 1)))


def _narrowest_span(task: FitTask, surface: BSplineSurface) -> float:
    """Below this width the rounding of z, some 50·ε·|z|/h² in curvature, would eat a tenth of the tolerance."""
    allowed = 1e-3 * task.curvature_tolerance_percent * float(task.reference_curvature(np.array(task.judged[:2])).min())
    height = float(np.abs(surface.poles[..., 2]).max())
    width = task.domain[1] - task.domain[0]
    return max(1e-6 * width, float(np.sqrt(50.0 * np.finfo(float).eps * height / allowed)) if allowed > 0 else 0.0)


def _excess(task: FitTask, fit: Fit) -> float:
    return max(fit.position_error_mm / task.position_tolerance_mm,
               (fit.curvature_error_percent or 0.0) / task.curvature_tolerance_percent)


# --- what a fit reached ----------------------------------------------------------------------------------------------


def measure(task: FitTask, surface: BSplineSurface, route: str) -> Fit:
    """Position and curvature error of any surface with u = x, v = y, off the nodes over the judged rectangle.

    Parameters
    ----------
    task : FitTask
        What was to be fitted.
    surface : BSplineSurface
        What came of it.
    route : str
        How it was fitted.
    """
    x_min, x_max, y_min, y_max = task.judged
    x, _ = _inside(np.unique(np.clip(surface.knots_u, x_min, x_max)), x_min, x_max, DENSEST_X,
                   task.points_of_small_curvature)
    y, _ = _inside(np.unique(np.clip(surface.knots_v, y_min, y_max)), y_min, y_max, DENSEST_Y)
    got = surface.on_grid(x, y)
    want = task.sag.derivatives(x[:, None], y)
    percent = curvature_percent(shape_operator(got), shape_operator_of_sag(want), task.reference_curvature(x)[:, None, :])
    return _fit(task, surface, route, x, y, np.abs(got["s"][..., 2] - want.z), percent)


def _fit(task: FitTask, surface: BSplineSurface, route: str, x: Array, y: Array, off: Array, percent: Array | None) -> Fit:
    i, j = np.unravel_index(np.argmax(off if percent is None else percent), off.shape)
    largest = None if percent is None else float(percent.max())
    met = float(off.max()) <= task.position_tolerance_mm
    met = met and (largest is None or largest <= task.curvature_tolerance_percent)
    spans = (len(np.unique(surface.knots_u)) - 1, len(np.unique(surface.knots_v)) - 1)
    return Fit(surface=surface, route=route, degree=surface.degree_u, spans=spans, position_error_mm=float(off.max()),
               curvature_error_percent=largest, worst_at_mm=(float(x[i]), float(y[j])), seconds=0.0, met=met)


def _sag_of(surface: BSplineSurface, x: Array, y: Array) -> SagDerivatives:
    """z and its derivatives on the grid x × y, of a surface that is x = u, y = v by its making."""
    d = surface.on_grid(x, y, component=2)
    return SagDerivatives(*(d[key] for key in ("s", "u", "v", "uu", "uv", "vv")))


def curvature_percent(got: ShapeOperator, want: ShapeOperator, reference: Array) -> Array | None:
    """The larger of the two principal curvatures' errors, percent.

    Parameters
    ----------
    got, want : ShapeOperator
        Components of one shape, 1/mm.
    reference : ndarray
        (…, 2), what counts as 100 %, 1/mm.

    Returns
    -------
    ndarray or None
        None where nothing is curved.
    """
    if not np.any(reference > 0):
        return None
    errors = [np.abs(a - b) for a, b in zip(principal_curvatures_of(got), principal_curvatures_of(want), strict=True)]
    result: Array = 100.0 * np.maximum(errors[0] / reference[..., 0], errors[1] / reference[..., 1])
    return result
