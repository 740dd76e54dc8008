"""Design a mirror from its specification: laws, series, model, surface. The only module that knows the order of the stages."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirror_cad.designed import DesignedCurvature
from mirror_cad.errors import OutlineError, SpecError
from mirror_cad.eyes import eye_position, ocular_points
from mirror_cad.laws import CurvatureLaw, Law, Span, Unstated
from mirror_cad.laws.curvature import Break, smooth_extrapolation
from mirror_cad.laws.matched import with_solved
from mirror_cad.laws.matching import solve_match
from mirror_cad.mirror import Mirror
from mirror_cad.outline import Outline, truck_outline
from mirror_cad.outline.transition import transition_line
from mirror_cad.profile import (
    Profile,
    check_profile,
    existing_interval,
    integrate_exactly,
    integrate_ode,
    sine_of_tangent_angle,
)
from mirror_cad.sections import DecoupledSag, Sag, check_circles, check_steps, existing_half_height
from mirror_cad.spec import MirrorSpec, Target
from mirror_cad.surfaces.convexity import check_convex, check_convex_surface
from mirror_cad.surfaces.differential import shape_operator_of_sag
from mirror_cad.surfaces.faithful import RESIDUAL_CONTINUITY, Faithful, closest_surface
from mirror_cad.surfaces.fit import Fit, FitTask, fit_by_collocation
from mirror_cad.surfaces.from_view import surface_from_view
from mirror_cad.surfaces.piecewise import PiecewiseChebyshev, approximate
from mirror_cad.surfaces.spans import DECOUPLED_CONTINUITY, FAITHFUL_CONTINUITY, orders_at_breaks
from mirror_cad.surfaces.sphere import (
    SPHERE_CURVATURE_PERCENT,
    SPHERE_DEGREE,
    SPHERE_POSITION_MM,
    SphericalSag,
    spherical_domain,
)
from mirror_cad.surfaces.spline_sag import SplineSag

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]


def design(spec: MirrorSpec) -> Mirror:
    """Design a mirror: curvature laws → profile → sag → B-spline surface, with the outline it will be cut to.

    Or a wanted view → surface.

    Parameters
    ----------
    spec : MirrorSpec
        What is asked for.

    Returns
    -------
    Mirror
        Its plate and files are made when they are asked for.

    Raises
    ------
    SpecError, ProfileError, OutlineError, SurfaceError
        For a mirror that cannot be.
    TypeError
        For anything but a specification.
    """
    if not isinstance(spec, MirrorSpec):
        raise TypeError(f"design() takes a MirrorSpec, not {type(spec).__name__}: load_spec(…) makes one of a preset or a file")
    outline, read_notes = _outline(spec)
    box = outline.bounding_box()
    if spec.part.transition_mm is not None:
        transition_line(outline, spec.part.transition_mm)  # which refuses one that parts nothing, before the mirror is made
    if spec.target is not None:
        return _design_from_view(spec, spec.target, outline, read_notes)
    laws = _laws(spec, box)
    series, limit_notes = _series_as_far_as_it_exists(spec, laws, box)
    designed, exact, profile = _decoupled(spec, laws, series)
    breaks = laws.horizontal.all_breaks(series.kappa_x), laws.vertical.all_breaks(series.kappa_y)
    if spec.surface.method == "sphere":
        sphere = SphericalSag(float(series.kappa_x(0.0)), laws.level_mm)
        model = _Model(sphere, sphere, None)
    elif spec.surface.method == "decoupled":
        half_height = max(abs(box[2]), abs(box[3]))
        check_steps(series.kappa_y, [b.x_mm for b in breaks[1] if b.smoothness < 0], box[0], box[1], half_height)
        model = _Model(exact, exact if profile is exact.profile else DecoupledSag(profile, series.kappa_y), None)
    else:
        model = _faithful(spec, outline, designed, exact, series.domain, breaks)
    fit = _fitted(spec, outline, designed, model, series.domain, breaks)
    return Mirror(spec=spec, surface=fit.surface, outline=outline, box=box, curvature=designed, exact=exact, model=model.exact,
                  integrated=model.integrated, faithful=model.faithful, fit=fit, matched=laws.matched,
                  notes=(*read_notes, *_remarks(spec, box), *limit_notes))


# --- the stages of a design ---------------------------------------------------------------------------------------


class _Laws(NamedTuple):
    """Both laws over the mirror, the vertical one extrapolated smoothly beyond it; where θ = 0; what `match` was solved for."""

    horizontal: CurvatureLaw
    vertical: CurvatureLaw
    level_mm: float
    matched: tuple[str, float] | None


class _Series(NamedTuple):
    """Both curvatures as series over the domain (x_min, x_max, y_min, y_max) that the surface is made on."""

    kappa_x: PiecewiseChebyshev
    kappa_y: PiecewiseChebyshev
    domain: Box


class _Model(NamedTuple):
    """The exact surface of a method, the same with its profile as integrated, and how a faithful one was found."""

    exact: Sag
    integrated: Sag
    faithful: Faithful | None


Breaks = tuple[Sequence[Break], Sequence[Break]]


def _laws(spec: MirrorSpec, box: Box) -> _Laws:
    """Solve what is to be matched, and refuse what cannot be built within the box."""
    x_min, x_max, y_min, y_max = box
    level_mm = _level(spec, box)
    span = Span(*(spec.horizontal.span_mm or (x_min, x_max)))
    matched = _solved(spec.horizontal, spec.eye.distance_mm, span, x_min, x_max, level_mm)
    horizontal = _law(with_solved(spec.horizontal, matched), span)
    vertical = _law(spec.vertical, span)
    check_profile(sine_of_tangent_angle(_series(horizontal, min(x_min, level_mm), max(x_max, level_mm)), level_mm),
                  level_mm, x_min, x_max)
    vertical = _extrapolated(vertical, x_min, x_max, 1.0 / max(abs(y_min), abs(y_max)))
    return _Laws(horizontal, vertical, level_mm, matched)


def _series_as_far_as_it_exists(spec: MirrorSpec, laws: _Laws, box: Box) -> tuple[_Series, list[str]]:
    """The curvatures over blank and outline, or as far as the surface exists there; with a note where that is less."""
    x_min, x_max, y_min, y_max = box
    half_height, wanted = max(abs(y_min), abs(y_max)), _wanted_domain(spec, box)
    check_circles(_series(laws.vertical, wanted[0], wanted[1]), x_min, x_max, half_height)
    kappa_x = _series(laws.horizontal, wanted[0], wanted[1])
    x_low, x_high = existing_interval(sine_of_tangent_angle(kappa_x, laws.level_mm), laws.level_mm, wanted[0], wanted[1])
    x_low, x_high = min(x_low, x_min), max(x_high, x_max)
    kappa_x, kappa_y = _series(laws.horizontal, x_low, x_high), _series(laws.vertical, x_low, x_high)
    half = max(half_height, existing_half_height(kappa_y, x_low, x_high, max(-wanted[2], wanted[3])))
    domain = (x_low, x_high, max(wanted[2], -half), min(wanted[3], half))
    if spec.surface.method == "sphere":
        domain = spherical_domain(SphericalSag(float(kappa_x(0.0)), laws.level_mm), box, domain)
    notes = [] if domain == wanted else [
        f"the surface reaches x {domain[0]:.1f} to {domain[1]:.1f}, y {domain[2]:.1f} to {domain[3]:.1f} mm, "
        f"less than blank and margin ask for: beyond, it would be steeper than 80°"]
    return _Series(kappa_x, kappa_y, domain), notes


def _decoupled(spec: MirrorSpec, laws: _Laws, series: _Series) -> tuple[DesignedCurvature, DecoupledSag, Profile]:
    """The designed curvature, the decoupled surface on the exact profile, and the profile as it is integrated."""
    exact = integrate_exactly(sine_of_tangent_angle(series.kappa_x, laws.level_mm), series.kappa_x)
    profile, surface = exact, spec.surface
    if surface.integration != "quadrature":
        profile = integrate_ode(series.kappa_x, exact, surface.integration, surface.step_mm or 1.0)
    return DesignedCurvature(series.kappa_x, series.kappa_y), DecoupledSag(exact, series.kappa_y), profile


def _faithful(spec: MirrorSpec, outline: Outline, designed: DesignedCurvature, exact: DecoupledSag, domain: Box,
              breaks: Breaks) -> _Model:
    continuity = orders_at_breaks(*breaks, RESIDUAL_CONTINUITY, domain[1] - domain[0])
    found = closest_surface(designed, outline, exact, domain, continuity, spec.surface.degree, spec.surface.spans)
    return _Model(found.sag, found.sag, found)


def _fitted(spec: MirrorSpec, outline: Outline, designed: DesignedCurvature, model: _Model, domain: Box,
            breaks: Breaks) -> Fit:
    surface, faithful, rms = spec.surface, model.faithful, designed.rms(outline)
    continuity, ends, degree = DECOUPLED_CONTINUITY, None, surface.degree
    if faithful is not None:
        continuity, ends, degree = FAITHFUL_CONTINUITY, faithful.ends, faithful.degree
    position_mm, percent = surface.position_tolerance_mm, surface.curvature_tolerance_percent
    if surface.method == "sphere" and surface.fit == "collocation" and surface.spans == "auto":
        position_mm, percent = min(position_mm, SPHERE_POSITION_MM), min(percent, SPHERE_CURVATURE_PERCENT)
        degree = SPHERE_DEGREE if degree == "auto" else degree
    task = FitTask(sag=model.integrated, domain=domain, judged=outline.bounding_box(),
                   breaks=orders_at_breaks(*breaks, continuity, domain[1] - domain[0]),
                   reference_curvature=lambda x: designed.reference_curvature(x, rms),
                   position_tolerance_mm=position_mm, curvature_tolerance_percent=percent, ends=ends)
    if surface.fit == "collocation":
        return fit_by_collocation(task, degree, surface.spans)
    from mirror_cad.occt.fit import fit_by_kernel

    return fit_by_kernel(task, surface.fit)


def _design_from_view(spec: MirrorSpec, target: Target, outline: Outline, read_notes: list[str]) -> Mirror:
    """The mirror that shows a wanted view most nearly.

    What stands for its laws are the curvatures that it has along y = 0; they say nothing of what was asked for.
    """
    box, domain = outline.bounding_box(), _wanted_domain(spec, outline.bounding_box())
    view, eyes = target.view(box), eyes_of(spec, box)
    notes = list(read_notes)
    if not all(isinstance(law, Unstated) for law in (spec.horizontal, spec.vertical)):
        notes.append("the laws [horizontal] and [vertical] have no effect: the surface comes from [target]")
    began = time.perf_counter()
    if target.convex:
        check_convex(view, eyes, outline, "target.azimuth_deg and elevation_deg")
    weight = None if target.weight is None else target.weight.map()
    found = surface_from_view(view, eyes, outline, domain, spec.surface.degree, spec.surface.spans, weight=weight)
    surface = found.surface
    sag = SplineSag(surface)
    if target.convex:
        check_convex_surface(surface, outline)
    if not found.settled:
        notes.append("the wanted view has not settled: more spans, or more steps, would still change the mirror")
    ends = np.unique(surface.knots_u)
    across, upright = (approximate(partial(_own_curvature, sag, key), ends.tolist()) for key in (0, 1))
    height, slope, bend = (partial(_along_middle, sag, key) for key in (0, 1, 3))
    profile = Profile(height, slope, bend, domain[0], domain[1], "wanted view", len(ends) - 1)
    designed, exact = DesignedCurvature(across, upright), DecoupledSag(profile, upright)
    fit = Fit(surface=surface, route="least squares on the reflected rays", degree=surface.degree_u,
              spans=(len(ends) - 1, len(np.unique(surface.knots_v)) - 1), position_error_mm=0.0, curvature_error_percent=0.0,
              worst_at_mm=(0.0, 0.0), seconds=time.perf_counter() - began, met=True)
    return Mirror(spec=spec, surface=surface, outline=outline, box=box, curvature=designed, exact=exact, model=sag,
                  integrated=sag, faithful=None, fit=fit, matched=None, notes=tuple(notes), from_view=found)


def _own_curvature(sag: Sag, key: int, x: Array) -> Array:
    """kx (0) or ky (1) of a surface along y = 0, 1/mm."""
    return np.asarray(shape_operator_of_sag(sag.derivatives(x, np.zeros_like(x)))[key])


def _along_middle(sag: Sag, key: int, x: Array) -> Array:
    """One of the `SagDerivatives` along y = 0."""
    return np.asarray(sag.derivatives(x, np.zeros_like(x))[key])


def eyes_of(spec: MirrorSpec, box: Box) -> tuple[Array, ...]:
    """Place the eye that [eye] and [target] mean, or the two of them, left first.

    Parameters
    ----------
    spec : MirrorSpec
    box : tuple
        The outline's (x_min, x_max, y_min, y_max), mm.

    Returns
    -------
    tuple of ndarray
        (3,) mm.
    """
    middle = eye_position(spec.eye.distance_mm, spec.eye.aligned, box)
    return (middle,) if spec.target is None or spec.target.eye == "one" else ocular_points(middle)


# Most changes to a design leave its outline and one of its laws alone: what they give is kept. All of it is frozen.
_truck_outline = lru_cache(maxsize=8)(truck_outline)
_solved = lru_cache(maxsize=8)(solve_match)
_extrapolated = lru_cache(maxsize=8)(smooth_extrapolation)
_series = lru_cache(maxsize=32)(CurvatureLaw.series)


@lru_cache(maxsize=16)
def _law(law: Law, span: Span) -> CurvatureLaw:
    return law.over(span)


def _outline(spec: MirrorSpec) -> tuple[Outline, list[str]]:
    """The outline, and what a user should know of the file that it was read from."""
    given, blank = spec.outline, spec.blank
    if given.file is None:
        return _truck_outline(given.width_mm, given.left_height_mm, given.right_height_mm, given.corner_radius_mm), []
    from mirror_cad.outline.files import open_outline

    read = open_outline(Path(given.file), given.file_options)
    outline = read.outline
    x_min, x_max, y_min, y_max = outline.bounding_box()
    half_width, half_height = blank.width_mm / 2, blank.height_mm / 2
    reach, faults = f"x {x_min:.1f} to {x_max:.1f}, y {y_min:.1f} to {y_max:.1f} mm", []
    if x_min < -half_width or x_max > half_width or y_min < -half_height or y_max > half_height:
        faults.append(f"{given.file}: the outline reaches {reach}, beyond the blank of {blank.width_mm:g} × "
                      f"{blank.height_mm:g} mm about the origin: move it, check its unit, or enlarge [blank]")
    elif not (x_min < 0 < x_max and y_min < 0 < y_max):
        faults.append(f"{given.file}: the outline, {reach}, does not hold the origin, which is the centre of the mirror: an "
                      "outline file is in mirror coordinates")
    if faults:  # with what else is to be known of the file, which may be the cause
        raise OutlineError("\n".join([*faults, *read.notes]))
    return outline, list(read.notes)


def _level(spec: MirrorSpec, box: Box) -> float:
    level = spec.horizontal.level_at
    if level == "centre":
        return 0.5 * (box[0] + box[1])
    if level in ("left", "right"):
        return box[0] if level == "left" else box[1]
    half_blank = spec.blank.width_mm / 2
    if not -half_blank <= float(level) <= half_blank:
        raise SpecError(f"horizontal.level_at = {float(level):g} lies outside the blank, −{half_blank:g} to {half_blank:g} mm")
    return float(level)


def _remarks(spec: MirrorSpec, box: Box) -> list[str]:
    """What the two laws have to say of themselves on this mirror."""
    return [f"the {name} law {remark}" for name, law in (("horizontal", spec.horizontal), ("vertical", spec.vertical))
            for remark in law.remarks(box[0], box[1])]


def _wanted_domain(spec: MirrorSpec, box: Box) -> Box:
    """Blank and outline with its margin, whichever reaches farther."""
    margin, blank = spec.export.surface_margin_mm, spec.blank
    return (min(-blank.width_mm / 2, box[0] - margin), max(blank.width_mm / 2, box[1] + margin),
            min(-blank.height_mm / 2, box[2] - margin), max(blank.height_mm / 2, box[3] + margin))
