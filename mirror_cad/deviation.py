"""Realised minus designed curvature of a mirror, stage by stage: model, integration, fit, STEP and STL."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mirror_cad.curvature_fields import CurvatureFields, differences, in_percent
from mirror_cad.designed import DesignedCurvature
from mirror_cad.grid import Grid
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.mesh_deviation import MeshDeviation, stl_deviation
from mirror_cad.outline import Outline
from mirror_cad.sections import Sag
from mirror_cad.stage_deviation import StageDeviation, SurfaceState, deviation_of, state_of_sag, state_of_surface
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import ShapeOperator, rms_norm

TURN_OF_RAY = 2.0  # a mirror that turns by an angle turns the ray that it reflects by twice that
ARCSEC_PER_ARCMIN = ARCMIN_PER_DEGREE = 60.0


class SurfaceStates(NamedTuple):
    """The surface as the design and each stage leave it."""

    design: SurfaceState
    model: SurfaceState
    integration: SurfaceState
    fit: SurfaceState
    step: SurfaceState


@dataclass(frozen=True, slots=True)
class StageDeviations:
    """What each stage adds to the one before it.

    Attributes
    ----------
    model
        The exact surface of the method against the design: what no numerics can remove.
    integration
        Its profile as integrated, against the model.
    fit
        The B-spline against that.
    step
        The B-spline as read back from STEP, against the fit.
    stl
        The triangles against the B-spline.
    """

    model: StageDeviation
    integration: StageDeviation
    fit: StageDeviation
    step: StageDeviation
    stl: MeshDeviation

    def numerical(self) -> tuple[StageDeviation, StageDeviation, StageDeviation]:
        """Integration, fit and STEP: what the two tolerances hold for."""
        return self.integration, self.fit, self.step


@dataclass(frozen=True, slots=True)
class ExplainedDeviation:
    """How much of the total is the model's and how much is numerical.

    Attributes
    ----------
    model_shape_rms_percent, numerical_shape_rms_percent, total_shape_rms_percent
        RMS of the shape operator's deviation, in percent of the designed RMS; None for a plane.
    unexplained_max_per_m
        The largest part of the total that the sum of the stages leaves, 1/m: rounding.
    """

    model_shape_rms_percent: float | None
    numerical_shape_rms_percent: float | None
    total_shape_rms_percent: float | None
    unexplained_max_per_m: float


@dataclass(frozen=True, slots=True)
class RayDeviation:
    """What each link between the exact surface and the eye may turn a reflected ray by, arc minutes.

    Twice the slope error of the surface.

    Attributes
    ----------
    kernel
        Integration and fit.
    file
        STEP, read back.
    mesh
        The facets of the STL; None where it has no optical facet.
    glass
        A curvature that is `glass_percent` off from the centre to the edge.
    glass_percent
        The limit of the part, or 1 % where none is stated.
    eye
        What an eye resolves.
    """

    kernel: float
    file: float
    mesh: float | None
    glass: float
    glass_percent: float
    eye: float


@dataclass(frozen=True, slots=True, eq=False)
class Deviation:
    """Realised minus designed curvature of a mirror, stage by stage, and the fields behind it for maps.

    Attributes
    ----------
    grid
        Where all is evaluated.
    stages, total
        Each stage against the one before; the surface as read back against the design.
    explained
        How the stages make up the total.
    rays
        What each link turns a reflected ray by.
    numerical
        Whether integration, fit and STEP are within the two tolerances.
    part
        Whether the total is within the limit; None without a limit, and for a plane.
    states
        The surface that the design and each stage leave, at the grid.
    percent
        Signed deviation of the total at the grid, percent; None for a plane.
    of_laws
        Whether a law asked for the curvature; without one it is what the surface has along y = 0, and there is no model to
        deviate from it, and no total.
    """

    grid: Grid
    stages: StageDeviations
    total: StageDeviation
    explained: ExplainedDeviation
    rays: RayDeviation
    numerical: bool
    part: bool | None
    states: SurfaceStates
    percent: CurvatureFields | None
    of_laws: bool = True

    @property
    def designed(self) -> ShapeOperator:
        """diag(1/Rx, 1/Ry) at the grid, 1/mm."""
        return self.states.design.shape

    @property
    def realised(self) -> ShapeOperator:
        """The shape operator of the face as read back, at the grid, 1/mm."""
        return self.states.step.shape

    def __repr__(self) -> str:
        k1, k2 = (one.max_percent for one in (self.total.k1, self.total.k2))
        largest = "of a plane" if k1 is None or k2 is None else f"k1 {k1:+.3g} %, k2 {k2:+.3g} %"
        part = {None: "not asked for", True: "within its limit", False: "beyond its limit"}[self.part]
        return f"<Deviation {largest}; tolerances {'met' if self.numerical else 'missed'}; part {part}>"


def compare_stages(
    curvature: DesignedCurvature, outline: Outline, reference: Sag, model: Sag, integrated: Sag,
    fitted: BSplineSurface, read_back: BSplineSurface, stl: SurfaceMesh,
    position_tolerance_mm: float, curvature_tolerance_percent: float, limit_percent: float | None,
    *, of_laws: bool = True,
) -> Deviation:
    """Each stage against the one before: design → model → integration → fit → STEP; the total against the design.

    The parts add up: at every point the sum of the stages' kx (ky, twist, sag) is the total's.
    Curvatures alone have no sag and no slope: those of `model` and `total` are against `reference`.

    Parameters
    ----------
    curvature
        The designed pair 1/Rx(x), 1/Ry(x).
    outline
        What the mirror is trimmed to.
    reference, model, integrated
        The exact decoupled surface, or the sphere where the method is one (`Mirror.reference`); the exact surface of the chosen
        method, and that with its profile as integrated.
    fitted, read_back
        The B-spline, and the same as read back from STEP.
    stl
        The triangles as read back.
    position_tolerance_mm, curvature_tolerance_percent
        What `numerical` holds integration, fit and STEP to.
    limit_percent
        What `part` holds k1 and k2 of the total to; None for nothing.
    of_laws
        Whether a law asked for the curvature.
    """
    grid = Grid.over(outline)
    against = state_of_sag(reference, grid)
    designed = SurfaceState(curvature.shape(grid.x), against.height, against.normal)
    states = SurfaceStates(designed, against if model is reference else state_of_sag(model, grid),
                           state_of_sag(integrated, grid), state_of_surface(fitted, grid), state_of_surface(read_back, grid))
    rms = rms_norm(designed.shape, grid.weights)
    of_model, of_integration, of_fit, of_step = (deviation_of(after, before, designed.shape, rms, grid)
                                                 for before, after in itertools.pairwise(states))
    stages = StageDeviations(of_model, of_integration, of_fit, of_step, stl_deviation(stl, fitted, outline))
    total = deviation_of(states.step, designed, designed.shape, rms, grid)

    numerical = all(_within(one, position_tolerance_mm, curvature_tolerance_percent) for one in stages.numerical())
    # A limit in percent says nothing of a plane.
    part = None if limit_percent is None or rms == 0.0 else _within(total, np.inf, limit_percent)
    percent = None if rms == 0.0 else in_percent(differences(states.step.shape, designed.shape), designed.shape, rms)
    return Deviation(grid=grid, stages=stages, total=total, explained=_explained(states, rms, grid),
                     rays=_rays(stages, states.step, limit_percent), numerical=numerical, part=part, states=states,
                     percent=percent, of_laws=of_laws)


def against_design(curvature: DesignedCurvature, outline: Outline, reference: Sag,
                   surface: BSplineSurface) -> StageDeviation:
    """The deviation from the design of any surface with u = x, v = y; see `compare_stages` for the parameters."""
    grid = Grid.over(outline)
    before = state_of_sag(reference, grid)
    designed = SurfaceState(curvature.shape(grid.x), before.height, before.normal)
    return deviation_of(state_of_surface(surface, grid), designed, designed.shape, rms_norm(designed.shape, grid.weights), grid)


def _explained(states: SurfaceStates, rms: float, grid: Grid) -> ExplainedDeviation:
    """How much of the total is the model's, how much is numerical, and what the stages' sum leaves of the total."""
    shapes = [state.shape for state in states]
    steps = [after.minus(before) for before, after in itertools.pairwise(shapes)]
    total = shapes[-1].minus(shapes[0])
    left = max(float(np.abs(all_of_it - sum(parts)).max()) for all_of_it, *parts in zip(total, *steps, strict=True))
    model, numerical, whole = (None if rms == 0.0 else 100.0 * rms_norm(shape, grid.weights) / rms
                               for shape in (steps[0], shapes[-1].minus(shapes[1]), total))
    return ExplainedDeviation(model_shape_rms_percent=model, numerical_shape_rms_percent=numerical,
                              total_shape_rms_percent=whole, unexplained_max_per_m=1e3 * left)


def _rays(stages: StageDeviations, final: SurfaceState, limit_percent: float | None) -> RayDeviation:
    degrees = stages.stl.normal_max_deg
    steepest = float(np.arccos(np.clip(final.normal[:, 2], -1.0, 1.0)).max())
    share = 0.01 * (1.0 if limit_percent is None else limit_percent)
    return RayDeviation(
        kernel=TURN_OF_RAY * (stages.integration.slope_max_arcsec + stages.fit.slope_max_arcsec) / ARCSEC_PER_ARCMIN,
        file=TURN_OF_RAY * stages.step.slope_max_arcsec / ARCSEC_PER_ARCMIN,
        mesh=None if degrees is None else TURN_OF_RAY * ARCMIN_PER_DEGREE * degrees,
        glass=float(np.degrees(TURN_OF_RAY * share * steepest)) * ARCMIN_PER_DEGREE,
        glass_percent=100.0 * share,
        eye=1.0)


def _within(stage: StageDeviation, position_mm: float, percent: float) -> bool:
    largest = stage.largest_principal_percent
    return abs(stage.sag_max_mm) <= position_mm and (largest is None or largest <= percent)
