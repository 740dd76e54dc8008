"""Realised minus designed curvature of a mirror, stage by stage: model, integration, fit, STEP and STL."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from mirror_cad.designed import FLOOR, DesignedCurvature, reference_curvature
from mirror_cad.grid import Grid
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.mesh_deviation import MeshDeviation, stl_deviation
from mirror_cad.outline import Outline
from mirror_cad.sections import Sag, SagDerivatives
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import (
    ShapeOperator,
    normals,
    principal_curvatures_of,
    rms_norm,
    shape_operator,
    shape_operator_of_sag,
)
from mirror_cad.vectors import lengths

Array = NDArray[np.float64]
Point = tuple[float, float]
Quantity = Literal["k1", "k2", "kx", "ky", "twist"]

QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
ARCSEC = np.degrees(1.0) * 3600.0
TURN_OF_RAY = 2.0  # a mirror that turns by an angle turns the ray that it reflects by twice that
ARCSEC_PER_ARCMIN = ARCMIN_PER_DEGREE = 60.0
SAME_SIZE = 1e-6  # relative: values that rounding alone tells apart, as a mirror that is symmetric in y has them


class CurvatureFields(NamedTuple):
    """Differences of curvature at points: k1, k2, kx, ky and twist, arrays of one shape, in 1/mm or percent."""

    k1: Array
    k2: Array
    kx: Array
    ky: Array
    twist: Array


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceState:
    """A surface as one stage leaves it, at the n points of the grid.

    Attributes
    ----------
    shape
        Shape operator, components (n,), 1/mm.
    height
        (n,), mm.
    normal
        Unit normals, (n, 3).
    """

    shape: ShapeOperator
    height: Array
    normal: Array


class SurfaceStates(NamedTuple):
    """The surface as the design and each stage leave it."""

    design: SurfaceState
    model: SurfaceState
    integration: SurfaceState
    fit: SurfaceState
    step: SurfaceState


@dataclass(frozen=True, slots=True)
class QuantityDeviation:
    """Deviation of one curvature over the mirror.

    Attributes
    ----------
    max_percent
        The signed value of largest size, in percent of the local designed value; None for a plane.
    rms_percent
        Root of the mean square by area, percent; None for a plane.
    max_per_m
        The signed value of largest size, 1/m.
    max_at_mm
        (x, y) of the largest in percent, for a plane of the largest in 1/m; mm.
    """

    max_percent: float | None
    rms_percent: float | None
    max_per_m: float
    max_at_mm: Point


@dataclass(frozen=True, slots=True)
class ShapeDeviation:
    """Deviation ‖W − W₀‖ (Frobenius) of the whole shape operator over the mirror.

    Attributes
    ----------
    max_percent, rms_percent
        In percent of RMS ‖diag(1/Rx, 1/Ry)‖; None for a plane.
    max_per_m, rms_per_m
        1/m.
    max_at_mm
        (x, y) of the largest, mm.
    """

    max_percent: float | None
    rms_percent: float | None
    max_per_m: float
    rms_per_m: float
    max_at_mm: Point


@dataclass(frozen=True, slots=True)
class StageDeviation:
    """What one stage adds to a surface, or all of them together.

    Attributes
    ----------
    k1, k2
        Principal curvatures, larger first.
    kx, ky, twist
        The components W11, W22, W12 of the shape operator.
    shape
        The shape operator as a whole.
    sag_max_mm
        The signed height difference of largest size, mm.
    slope_max_arcsec
        The largest angle between the normals, arc seconds.
    sag_max_at_mm, slope_max_at_mm
        (x, y) of these, mm.
    """

    k1: QuantityDeviation
    k2: QuantityDeviation
    kx: QuantityDeviation
    ky: QuantityDeviation
    twist: QuantityDeviation
    shape: ShapeDeviation
    sag_max_mm: float
    sag_max_at_mm: Point
    slope_max_arcsec: float
    slope_max_at_mm: Point

    def of(self, quantity: Quantity) -> QuantityDeviation:
        """The deviation of the quantity so named."""
        found: QuantityDeviation = getattr(self, quantity)
        return found

    @property
    def largest_principal_percent(self) -> float | None:
        """The larger deviation of k1 and k2 in size, percent; None for a plane."""
        found = [abs(one.max_percent) for one in (self.k1, self.k2) if one.max_percent is not None]
        return max(found) if found else None

    @property
    def largest_principal_per_m(self) -> float:
        """The larger deviation of k1 and k2 in size, 1/m."""
        return max(abs(self.k1.max_per_m), abs(self.k2.max_per_m))


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
    against = _of_sag(reference, grid)
    designed = SurfaceState(curvature.shape(grid.x), against.height, against.normal)
    states = SurfaceStates(designed, against if model is reference else _of_sag(model, grid), _of_sag(integrated, grid),
                           _of_surface(fitted, grid), _of_surface(read_back, grid))
    rms = rms_norm(designed.shape, grid.weights)
    of_model, of_integration, of_fit, of_step = (_deviation(after, before, designed.shape, rms, grid)
                                                 for before, after in itertools.pairwise(states))
    stages = StageDeviations(of_model, of_integration, of_fit, of_step, stl_deviation(stl, fitted, outline))
    total = _deviation(states.step, designed, designed.shape, rms, grid)

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
    before = _of_sag(reference, grid)
    designed = SurfaceState(curvature.shape(grid.x), before.height, before.normal)
    return _deviation(_of_surface(surface, grid), designed, designed.shape, rms_norm(designed.shape, grid.weights), grid)


def differences(after: ShapeOperator, before: ShapeOperator) -> CurvatureFields:
    """k1, k2, kx, ky and twist, after − before, 1/mm."""
    a, b = principal_curvatures_of(after), principal_curvatures_of(before)
    return CurvatureFields(a[0] - b[0], a[1] - b[1], after.w11 - before.w11, after.w22 - before.w22, after.w12 - before.w12)


def in_percent(difference: CurvatureFields, designed: ShapeOperator, rms: float) -> CurvatureFields:
    """Differences of curvature in percent of the local designed value, and nowhere of less than `FLOOR` of the RMS.

    Parameters
    ----------
    difference
        (n,) each, 1/mm.
    designed
        The designed shape operator at the same points, 1/mm.
    rms
        RMS ‖diag(1/Rx, 1/Ry)‖ over the mirror, 1/mm, above 0; twist is in percent of this.
    """
    pair, floor = reference_curvature(designed, rms), FLOOR * rms
    scale = (pair[..., 0], pair[..., 1], np.maximum(np.abs(designed.w11), floor), np.maximum(np.abs(designed.w22), floor),
             np.asarray(rms))
    return CurvatureFields(*(100.0 * value / size for value, size in zip(difference, scale, strict=True)))


def index_of_largest(size: Array, grid: Grid) -> int:
    """The index at which a field is largest; of points that rounding alone tells apart (a mirror is symmetric in y) the upper.

    Parameters
    ----------
    size
        (n,) at the points of the grid, not negative.
    grid
        Whose y decides between equals.
    """
    ties = np.flatnonzero(size >= size.max() * (1.0 - SAME_SIZE))
    return int(ties[np.argmax(grid.y[ties])])


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


def _of_sag(sag: Sag, grid: Grid) -> SurfaceState:
    cells = sag.derivatives(grid.cells_x[:, None], grid.cells_y)
    edge = sag.derivatives(grid.x[grid.edge], grid.y[grid.edge])
    d = SagDerivatives(*(np.concatenate([np.broadcast_to(a, grid.inside.shape)[grid.inside], b])
                         for a, b in zip(cells, edge, strict=True)))
    normal = np.stack([-d.zx, -d.zy, np.ones_like(d.z)], axis=-1)
    return SurfaceState(shape_operator_of_sag(d), d.z, normal / lengths(normal)[..., None])


def _of_surface(surface: BSplineSurface, grid: Grid) -> SurfaceState:
    d = grid.derivatives(surface)
    return SurfaceState(shape_operator(d), d["s"][..., 2], normals(d["u"], d["v"]))


def _deviation(after: SurfaceState, before: SurfaceState, designed: ShapeOperator, rms: float, grid: Grid) -> StageDeviation:
    per_mm = differences(after.shape, before.shape)
    percent = (None,) * len(per_mm) if rms == 0.0 else in_percent(per_mm, designed, rms)
    k1, k2, kx, ky, twist = (_quantity(*each, grid) for each in zip(per_mm, percent, strict=True))
    sag = after.height - before.height
    highest = index_of_largest(np.abs(sag), grid)
    # |n − m| = 2·sin(angle/2): arccos of n·m would lose the small angles that matter here.
    chord = lengths(after.normal - before.normal)
    steepest = index_of_largest(chord, grid)
    return StageDeviation(
        k1=k1, k2=k2, kx=kx, ky=ky, twist=twist, shape=_shape(after.shape.minus(before.shape), rms, grid),
        sag_max_mm=float(sag[highest]), sag_max_at_mm=_point(grid, highest),
        slope_max_arcsec=float(2.0 * np.arcsin(0.5 * chord[steepest]) * ARCSEC), slope_max_at_mm=_point(grid, steepest))


def _quantity(per_mm: Array, percent: Array | None, grid: Grid) -> QuantityDeviation:
    max_per_m = 1e3 * float(per_mm[index_of_largest(np.abs(per_mm), grid)])
    if percent is None:
        return QuantityDeviation(max_percent=None, rms_percent=None, max_per_m=max_per_m,
                                 max_at_mm=_point(grid, index_of_largest(np.abs(per_mm), grid)))
    worst = index_of_largest(np.abs(percent), grid)
    return QuantityDeviation(max_percent=float(percent[worst]),
                             rms_percent=float(np.sqrt(np.average(percent**2, weights=grid.weights))),
                             max_per_m=max_per_m, max_at_mm=_point(grid, worst))


def _shape(difference: ShapeOperator, rms: float, grid: Grid) -> ShapeDeviation:
    size = np.sqrt(difference.w11**2 + difference.w22**2 + 2.0 * difference.w12**2)
    worst, average = index_of_largest(size, grid), rms_norm(difference, grid.weights)
    flat = rms == 0.0
    return ShapeDeviation(max_percent=None if flat else 100.0 * float(size[worst]) / rms,
                          rms_percent=None if flat else 100.0 * average / rms,
                          max_per_m=1e3 * float(size[worst]), rms_per_m=1e3 * average, max_at_mm=_point(grid, worst))


def _point(grid: Grid, index: int) -> Point:
    return float(grid.x[index]), float(grid.y[index])


def _within(stage: StageDeviation, position_mm: float, percent: float) -> bool:
    largest = stage.largest_principal_percent
    return abs(stage.sag_max_mm) <= position_mm and (largest is None or largest <= percent)
