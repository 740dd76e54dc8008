"""The deviation of a measured mirror as a spline: outliers told apart, spans chosen, sigma from the residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import MirrorError
from mirror_cad.made.alignment import MAD, robust_sigma, tukey
from mirror_cad.made.coverage import Coverage
from mirror_cad.made.nominal import Nominal
from mirror_cad.made.smoothing import smoothed
from mirror_cad.made.spline_fit import Combined, Observations, Space, SplineFit, fit_spline, predicted, with_sigmas
from mirror_cad.surfaces.differential import shape_operator_of_sag

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SPANS_OF_GAUGE = 4.0  # a span is no longer than this part of the gauge
FINER = np.sqrt(2.0)  # from one choice of spans to the next
MAX_COEFFICIENTS = 3000  # whose covariance is held whole
POINTS_PER_COEFFICIENT = 1.6  # at least, where points lie
MARGIN_MM = 15.0  # beyond the outline, as far as the design has a sheet
COARSE = (6, 8)  # spans that outliers are looked for with
FEW = 100_000  # points that spans are chosen with
CELL_POINTS = 9  # whose median a point is compared with
OUTLIER = 8.0  # sigmas
BACK = 5.0  # sigmas within which a point counts after all
# Of the mirror's size: residuals below it are rounding or the spline's own error, and no point is left out for them.
NO_OUTLIER = 2e-9
BETTER = 0.98  # of the generalised cross-validation: less is no reason for more spans
PRIOR = 20.0  # times the designed curvature: what second derivatives may be where nothing was measured
PRIOR_FLAT = 0.2  # over the mirror's size, for a plane
MIN_POINTS = 6
UNSTATED_MM = 1e-6  # a sigma to begin with, below all that is measured, so that the prior says nothing
MIN_FACTOR = 1e-6  # of residuals that are exactly nought
HELD_MM, HELD_SLOPE = 1e-4, 1e-7  # sigmas of a mean height and mean slopes that nothing tells and that are set to nought
NO_PRIOR = 1e9  # 1/mm


class ReconstructionError(MirrorError):
    """Points that do not tell a surface."""


@dataclass(frozen=True, slots=True, eq=False)
class Reconstruction:
    """A measured mirror as its deviation from the design.

    Attributes
    ----------
    fit : SplineFit
        d(x, y) = z_measured − z_design, by least squares: right on the average, and rough.
    smooth : SplineFit
        The same, smoothed as far as the noise asks for.
    sigma_factor : float
        What the sigmas of the observations are to be multiplied with: above 1 where the residuals are larger than they say.
    sigma_mm : float
        Of a point along the normal, typical, with this factor; NaN without points.
    kept : ndarray
        (n,), which of the heights count.
    residuals : ndarray
        (n,), mm, along the normal, of all heights.
    coverage : Coverage
        Where the mirror was measured.
    principle : str
        How the spans were chosen.
    tried : tuple
        Of each choice: the span's length (mm), √(χ²/(n − p)) and the root of the generalised cross-validation.
    """

    fit: SplineFit
    smooth: SplineFit
    sigma_factor: float
    sigma_mm: float
    kept: Mask
    residuals: Array
    coverage: Coverage
    principle: str
    tried: tuple[tuple[float, float, float], ...]


def reconstruct(nominal: Nominal, points: Array, sigmas: Array | None, gauge_mm: float, extra: Observations | None = None,
                combined: Sequence[Combined] = ()) -> Reconstruction:
    """Fit the deviation to aligned points, and to what else was observed of it.

    Parameters
    ----------
    nominal : Nominal
        The design.
    points : ndarray
        (n, 3), mm, in the design's coordinates, inside its sheet.
    sigmas : ndarray, optional
        (n,), mm, of the points along the normal; estimated from the residuals without them.
    gauge_mm : float
        Over which curvature will be told.
    extra, combined
        Slopes, curvatures and readings of the deviation.

    Raises
    ------
    ReconstructionError
        For too few observations.
    """
    x, y = points[:, 0], points[:, 1]
    count = len(points) + (0 if extra is None else extra.x.size) + len(combined)
    if count < MIN_POINTS:
        raise ReconstructionError(f"{count} measured points are left on the mirror: at least {MIN_POINTS} are needed")
    z, zx, zy = nominal.heights(x, y)
    tilt = np.sqrt(1.0 + zx * zx + zy * zy)  # heights over perpendicular distances
    along = (points[:, 2] - z) / tilt
    given = np.full(len(points), UNSTATED_MM) if sigmas is None else sigmas
    prior = _prior(nominal)
    all_x, all_y = (x, y) if extra is None else (np.concatenate([x, extra.x]), np.concatenate([y, extra.y]))
    coverage = Coverage.of(nominal, all_x, all_y, gauge_mm)
    kept = isolated_points(nominal, x, y, along, given)
    if extra is not None:
        extra = _without_isolated(nominal, extra)
    observed = Observations.of_heights(x, y, points[:, 2] - z, given * tilt)

    def fitted(space: Space, kept: Mask) -> SplineFit:
        part = Observations(*(getattr(observed, name)[kept] for name in ("x", "y", "operators", "values", "sigmas", "weights")))
        return fit_spline(space, part if extra is None else part.joined(extra), combined, prior)

    stated = sigmas is not None or extra is not None or bool(combined)
    if extra is not None and not len(points):
        combined = (*combined, *_held_motion(nominal, extra))
    chosen: SplineFit | None = None
    best, tried = np.inf, []
    principle = "generalised cross-validation"
    some = kept.copy()
    if len(points) > FEW:  # a part of them tells which spans serve
        some &= np.arange(len(points)) % (len(points) // FEW) == 0
    for space in spaces(nominal, coverage, gauge_mm, count):
        fit = fitted(space, some)
        share = 1.0 - min(fit.determined / max(fit.used, 1), 1.0 - 1e-9)
        gcv = np.sqrt(fit.chi2 / max(fit.used, 1)) / share
        tried.append((float(np.mean(space.span_mm)), fit.scale, float(gcv)))
        if chosen is None or gcv < BETTER * best:
            chosen, best = fit, gcv
        free = fit.used - fit.determined
        if stated and free > 1.0 and fit.scale <= 1.0 + 2.0 / np.sqrt(2.0 * free):
            chosen, principle = fit, "discrepancy: the longest spans whose residuals are as large as the stated sigma"
            break
    assert chosen is not None  # there is a space
    if len(points) > FEW:
        chosen = fitted(chosen.space, kept)
    residuals = (observed.values - predicted(chosen, observed)) / tilt
    # A point that was taken for an outlier may be the surface itself.
    sigma = robust_sigma((residuals / given)[kept]) if kept.any() else 0.0
    floor = NO_OUTLIER * nominal.size_mm
    again = np.abs(residuals) <= np.maximum(BACK * sigma * given, floor)
    again &= ~kept
    if again.any():
        kept = kept | again
        chosen = fitted(chosen.space, kept)
        residuals = (observed.values - predicted(chosen, observed)) / tilt
    if not stated and np.isfinite(chosen.scale) and chosen.scale > 0.0:
        # Once more with the sigma that was found: the prior, which holds what was not measured, is weighed against it.
        given = given * chosen.scale
        chosen = with_sigmas(chosen, chosen.scale, prior)
    scale = chosen.scale if np.isfinite(chosen.scale) else 1.0
    factor = max(1.0, scale) if stated else scale
    sigma_mm = factor * float(np.median(given)) if len(given) else float("nan")
    smooth = smoothed(chosen, max(factor, MIN_FACTOR))
    return Reconstruction(chosen, smooth, factor, sigma_mm, kept, residuals, coverage, principle, tuple(tried))


def _held_motion(nominal: Nominal, extra: Observations) -> list[Combined]:
    """The mean height as nought, where no height was measured, and the mean slopes, where no slope was."""
    x_min, x_max, y_min, y_max = nominal.box
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(x_min, x_max, 15), np.linspace(y_min, y_max, 15)))
    kept = nominal.outline.contains(x, y)
    held = [] if extra.operators[:, 0].any() else [(0, HELD_MM)]
    if not _slopes_among(extra):
        held += [(1, HELD_SLOPE), (2, HELD_SLOPE)]
    found = []
    for term, sigma in held:
        operators = np.zeros((int(kept.sum()), 6))
        operators[:, term] = 1.0 / kept.sum()
        found.append(Combined(x[kept], y[kept], operators, 0.0, sigma))
    return found


def _slopes_among(extra: Observations) -> bool:
    """Whether slopes themselves were observed: curvatures depend on them too, but only where the design is steep."""
    return bool((extra.operators[:, 1:3].any(axis=1) & ~extra.operators[:, 3:].any(axis=1)).any())


def _without_isolated(nominal: Nominal, extra: Observations) -> Observations:
    """The observations without those that disagree with the ones around them; each kind by itself."""
    weights = extra.weights.copy()
    kinds = np.argmax(np.abs(extra.operators) > 0.0, axis=1)
    for kind in np.unique(kinds):
        rows = np.flatnonzero(kinds == kind)
        if len(rows) < 2 * MIN_POINTS:
            continue
        relative = extra.values[rows] / extra.sigmas[rows]
        rest = relative - _cell_medians(extra.x[rows], extra.y[rows], relative)
        around = MAD * _cell_medians(extra.x[rows], extra.y[rows], np.abs(rest))
        largest = OUTLIER * np.maximum(around, max(robust_sigma(rest), 1e-9 * float(np.abs(relative).max())))
        weights[rows[np.abs(rest) > largest]] = 0.0
    return replace(extra, weights=weights)


def isolated_points(nominal: Nominal, x: Array, y: Array, along: Array, sigmas: Array) -> Mask:
    """Which points agree with those around them, after the long waves are taken away; (n,).

    Parameters
    ----------
    nominal : Nominal
        The design.
    x, y : ndarray
        (n,), mm.
    along : ndarray
        (n,), mm, perpendicular distances from the design.
    sigmas : ndarray
        (n,), whose ratio weighs the points.
    """
    if len(x) < 2 * MIN_POINTS:
        return np.ones(len(x), dtype=bool)
    few = slice(None, None, max(1, len(x) // 20_000))
    weights = tukey(along[few], max(robust_sigma(along[few]), NO_OUTLIER * nominal.size_mm))
    space = Space(_box(nominal), COARSE)
    fit = None
    for _ in range(4):
        fit = fit_spline(space, Observations.of_heights(x[few], y[few], along[few], sigmas[few], weights), (), NO_PRIOR)
        rest = along[few] - fit.heights(x[few], y[few])
        weights = np.maximum(tukey(rest, max(robust_sigma(rest), NO_OUTLIER * nominal.size_mm)), 1e-6)
    assert fit is not None
    rest = along - fit.heights(x, y)
    rest = (rest - _cell_medians(x, y, rest)) / sigmas
    # Where form is steep within a cell, all of its points are far from its median, and none is an outlier.
    around = MAD * _cell_medians(x, y, np.abs(rest))
    largest = OUTLIER * np.maximum(around, max(robust_sigma(rest), NO_OUTLIER * nominal.size_mm / sigmas.max()))
    return np.asarray(np.abs(rest) <= largest)


def spaces(nominal: Nominal, coverage: Coverage, gauge_mm: float, count: int) -> list[Space]:
    """Spline spaces from a quarter of the gauge downwards, as far as the points go.

    Parameters
    ----------
    nominal : Nominal
        The design.
    coverage : Coverage
        Of the points.
    gauge_mm : float
        Over which curvature will be told.
    count : int
        Of observations.
    """
    box = _box(nominal)
    width, height = box[1] - box[0], box[3] - box[2]
    least = coverage.spacing_mm * np.sqrt(POINTS_PER_COEFFICIENT)

    def space(span: float) -> Space:
        return Space(box, (max(1, int(np.ceil(width / span))), max(1, int(np.ceil(height / span)))))

    found: list[Space] = []
    span = gauge_mm / SPANS_OF_GAUGE
    while not found or (span >= least and np.prod(space(span).shape) <= MAX_COEFFICIENTS):
        smallest = max(span, least)
        while np.prod(space(smallest).shape) > MAX_COEFFICIENTS:
            smallest *= 1.02
        found.append(space(smallest))
        span = min(span, smallest) / FINER
    return found


def _box(nominal: Nominal) -> tuple[float, float, float, float]:
    """What the deviation is told over: the outline's box with a margin, as far as the design goes."""
    box, domain = nominal.box, nominal.surface.domain
    return (max(box[0] - MARGIN_MM, domain[0]), min(box[1] + MARGIN_MM, domain[1]),
            max(box[2] - MARGIN_MM, domain[2]), min(box[3] + MARGIN_MM, domain[3]))


def _prior(nominal: Nominal) -> float:
    x_min, x_max, y_min, y_max = nominal.box
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(x_min, x_max, 9), np.linspace(y_min, y_max, 9)))
    w = shape_operator_of_sag(nominal.derivatives(x, y))
    curvature = float(np.sqrt(np.mean(w.w11**2 + w.w22**2 + 2.0 * w.w12**2)))
    return max(PRIOR * curvature, PRIOR_FLAT / nominal.size_mm)


def _cell_medians(x: Array, y: Array, values: Array) -> Array:
    """Of each point the median over the cell that it lies in, of about CELL_POINTS points."""
    width, height = float(np.ptp(x)), float(np.ptp(y))
    size = max(np.sqrt(width * height * CELL_POINTS / len(x)), max(width, height) * CELL_POINTS / len(x), 1e-300)
    i, j = np.floor((x - x.min()) / size).astype(np.int64), np.floor((y - y.min()) / size).astype(np.int64)
    cell = i * (int(j.max()) + 1) + j
    order = np.lexsort((values, cell))
    _, start, count = np.unique(cell[order], return_index=True, return_counts=True)
    ranked = values[order]
    medians = 0.5 * (ranked[start + (count - 1) // 2] + ranked[start + count // 2])
    result = np.empty(len(x))
    result[order] = np.repeat(medians, count)
    return result
