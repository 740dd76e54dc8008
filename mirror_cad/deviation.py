"""A design and the surfaces of each stage in, realised minus designed curvature out, stage by stage."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_cad.designed import FLOOR, DesignedCurvature, percent_scale
from mirror_cad.grid import Grid
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.outline import Outline
from mirror_cad.sections import Sag, SagDerivatives
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.differential import (
    ShapeOperator,
    mean_curvature_and_difference,
    normals,
    principal_curvatures_of,
    rms_norm,
    shape_operator,
    shape_operator_of_sag,
)

Array = NDArray[np.float64]

ARCSEC = np.degrees(1.0) * 3600.0


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """A surface as one stage leaves it, at the grid: shape operator (1/mm), height (mm) and unit normals."""

    shape: ShapeOperator
    height: Array
    normal: Array


@dataclass(frozen=True, slots=True, eq=False)
class CurvatureDeviation:
    """What `deviation.json` holds, and the fields behind it for maps.

    stages, total : as in deviation.json.   numerical, part : the verdicts; part is None without a limit.
    explained : how the stages make up the total.   chain : what each link turns a reflected ray by, arc minutes.
    states : the shape operator (1/mm), height and normals that the design and each stage leave, at the grid.
    designed, realised : shape operators at the grid.   percent : signed deviation of k1, k2, kx, ky and twist in
    percent at the grid, or None for a plane.
    """

    grid: Grid
    stages: dict[str, dict[str, Any]]
    total: dict[str, Any]
    explained: dict[str, Any]
    chain: dict[str, Any]
    numerical: bool
    part: bool | None
    states: dict[str, Stage]
    designed: ShapeOperator
    realised: ShapeOperator
    percent: dict[str, Array] | None

    def as_json(self) -> dict[str, Any]:
        """The contract's deviation.json."""
        return {"stages": self.stages, "total": self.total, "verdicts": {"numerical": self.numerical, "part": self.part}}

    def power_maps(self) -> dict[str, Array]:
        """Km and Ka of eq. 1, designed and realised, 1/m, as rectangles."""
        maps = {}
        for name, shape in (("designed", self.designed), ("realised", self.realised)):
            mean, difference = mean_curvature_and_difference(shape)
            maps[f"Km {name}"], maps[f"Ka {name}"] = (self.grid.as_map(1e3 * v) for v in (mean, difference))
        return maps


def compare_stages(
    curvature: DesignedCurvature, outline: Outline, reference: Sag, model: Sag, integrated: Sag,
    fitted: BSplineSurface, read_back: BSplineSurface, stl: SurfaceMesh,
    position_tolerance_mm: float, curvature_tolerance_percent: float, limit_percent: float | None,
) -> CurvatureDeviation:
    """Each stage against the one before: design → model → integration → fit → step; total against the design.

    model: the exact surface of the chosen method, what no numerics can remove. integration: its profile as integrated.
    fit: the B-spline. step: that B-spline as read back. stl: the triangles' height and facet normals.
    The parts add up: at every place the sum of the stages' kx (ky, twist, sag) is the total's.
    Curvatures alone have no sag and no slope: those of `model` and `total` are against `reference`, the exact decoupled surface
    or the sphere (`Mirror.reference`).
    """
    grid = Grid.over(outline)
    against = _of_sag(reference, grid)
    designed = Stage(curvature.shape(grid.x), against.height, against.normal)
    states = {"design": designed, "model": against if model is reference else _of_sag(model, grid),
              "integration": _of_sag(integrated, grid), "fit": _of_surface(fitted, grid), "step": _of_surface(read_back, grid)}
    rms = rms_norm(designed.shape, grid.weights)
    names = list(states)
    results = {name: _deviation(states[name], states[before], designed.shape, rms, grid)
               for before, name in itertools.pairwise(names)}
    final = states["step"]
    total = _deviation(final, designed, designed.shape, rms, grid)
    results["stl"] = stl_deviation(stl, fitted, outline)

    numerical = all(_within(results[name], position_tolerance_mm, curvature_tolerance_percent)
                    for name in ("integration", "fit", "step"))
    # A limit in percent says nothing of a plane.
    part = None if limit_percent is None or rms == 0.0 else _within(total, np.inf, limit_percent)
    return CurvatureDeviation(grid, results, total, _explained(states, rms, grid), _chain(results, final, limit_percent),
                              numerical, part, states, designed.shape, final.shape,
                              _percent_fields(final.shape, designed.shape, designed.shape, rms))


def against_design(curvature: DesignedCurvature, outline: Outline, reference: Sag,
                   surface: BSplineSurface) -> dict[str, Any]:
    """The entry that deviation.json has as `total`, of any surface with u = x, v = y."""
    grid = Grid.over(outline)
    before = _of_sag(reference, grid)
    designed = Stage(curvature.shape(grid.x), before.height, before.normal)
    return _deviation(_of_surface(surface, grid), designed, designed.shape, rms_norm(designed.shape, grid.weights), grid)


def _explained(states: dict[str, Stage], rms: float, grid: Grid) -> dict[str, Any]:
    """How much of the total is the model's, how much is numerical, and what the stages' sum leaves of the total."""
    shapes = [state.shape for state in states.values()]
    steps = [after.minus(before) for before, after in itertools.pairwise(shapes)]
    total = shapes[-1].minus(shapes[0])
    left = max(float(np.abs(whole - sum(parts)).max()) for whole, *parts in zip(total, *steps, strict=True))
    parts = {"model": steps[0], "numerical": shapes[-1].minus(shapes[1]), "total": total}
    result: dict[str, Any] = {f"{name}_shape_rms_percent": None if rms == 0.0 else
                              100.0 * rms_norm(shape, grid.weights) / rms for name, shape in parts.items()}
    return result | {"unexplained_max_per_m": 1e3 * left}


def _chain(results: dict[str, dict[str, Any]], final: Stage, limit_percent: float | None) -> dict[str, Any]:
    """What each link may turn a reflected ray by, arc minutes: twice the surface's slope error.

    glass : a curvature that is off by the part's limit (by 1 % where none is stated) from the centre to the edge.
    """
    degrees = results["stl"]["normal_max_deg"]
    steepest = float(np.arccos(np.clip(final.normal[:, 2], -1.0, 1.0)).max())
    share = 0.01 * (1.0 if limit_percent is None else limit_percent)
    return {"kernel": (results["integration"]["slope_max_arcsec"] + results["fit"]["slope_max_arcsec"]) / 30.0,
            "file": results["step"]["slope_max_arcsec"] / 30.0,
            "mesh": None if degrees is None else 120.0 * degrees,
            "glass": float(np.degrees(2.0 * share * steepest)) * 60.0,
            "glass_percent": 100.0 * share,
            "eye": 1.0}


def _of_sag(sag: Sag, grid: Grid) -> Stage:
    cells = sag.derivatives(grid.cells_x[:, None], grid.cells_y)
    edge = sag.derivatives(grid.x[grid.edge], grid.y[grid.edge])
    d = SagDerivatives(*(np.concatenate([np.broadcast_to(a, grid.inside.shape)[grid.inside], b])
                         for a, b in zip(cells, edge, strict=True)))
    normal = np.stack([-d.zx, -d.zy, np.ones_like(d.z)], axis=-1)
    return Stage(shape_operator_of_sag(d), d.z, normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def _of_surface(surface: BSplineSurface, grid: Grid) -> Stage:
    d = grid.derivatives(surface)
    return Stage(shape_operator(d), d["s"][..., 2], normals(d["u"], d["v"]))


def _differences(after: ShapeOperator, before: ShapeOperator) -> dict[str, Array]:
    a, b = principal_curvatures_of(after), principal_curvatures_of(before)
    return {"k1": a[0] - b[0], "k2": a[1] - b[1], "kx": after.w11 - before.w11, "ky": after.w22 - before.w22,
            "twist": after.w12 - before.w12}


def _percent_fields(after: ShapeOperator, before: ShapeOperator, designed: ShapeOperator,
                    rms: float) -> dict[str, Array] | None:
    if rms == 0.0:
        return None
    pair = percent_scale(designed, rms)
    floor = FLOOR * rms
    scale = {"k1": pair[..., 0], "k2": pair[..., 1], "kx": np.maximum(np.abs(designed.w11), floor),
             "ky": np.maximum(np.abs(designed.w22), floor), "twist": np.full_like(designed.w11, rms)}
    return {key: 100.0 * value / scale[key] for key, value in _differences(after, before).items()}


def _deviation(after: Stage, before: Stage, designed: ShapeOperator, rms: float, grid: Grid) -> dict[str, Any]:
    """One stage's entry of deviation.json."""
    percent = _percent_fields(after.shape, before.shape, designed, rms)
    result: dict[str, Any] = {}
    for key, value in _differences(after.shape, before.shape).items():
        ranked = value if percent is None else percent[key]
        worst = _place_of_largest(np.abs(ranked), grid)
        result[f"{key}_max_percent"] = None if percent is None else float(ranked[worst])
        result[f"{key}_rms_percent"] = None if percent is None else float(
            np.sqrt(np.average(ranked**2, weights=grid.weights)))
        result[f"{key}_max_per_m"] = 1e3 * float(value[_place_of_largest(np.abs(value), grid)])
        result[f"{key}_max_at_mm"] = _place(grid, worst)
    difference = after.shape.minus(before.shape)
    size = np.sqrt(difference.w11**2 + difference.w22**2 + 2.0 * difference.w12**2)
    worst = _place_of_largest(size, grid)
    average = rms_norm(difference, grid.weights)
    result |= {"shape_max_percent": None if rms == 0.0 else 100.0 * float(size[worst]) / rms,
               "shape_rms_percent": None if rms == 0.0 else 100.0 * average / rms,
               "shape_max_per_m": 1e3 * float(size[worst]), "shape_rms_per_m": 1e3 * average,
               "shape_max_at_mm": _place(grid, worst)}
    sag = after.height - before.height
    worst = _place_of_largest(np.abs(sag), grid)
    result |= {"sag_max_mm": float(sag[worst]), "sag_max_at_mm": _place(grid, worst)}
    # |n − m| = 2·sin(angle/2): arccos of n·m would lose the small angles that matter here.
    chord = np.linalg.norm(after.normal - before.normal, axis=-1)
    worst = _place_of_largest(chord, grid)
    return result | {"slope_max_arcsec": float(2.0 * np.arcsin(0.5 * chord[worst]) * ARCSEC),
                     "slope_max_at_mm": _place(grid, worst)}


def _place(grid: Grid, index: int) -> list[float]:
    return [float(grid.x[index]), float(grid.y[index])]


def _place_of_largest(size: Array, grid: Grid) -> int:
    """Where a field is largest; of places that rounding alone tells apart (a mirror is symmetric in y) the upper one."""
    ties = np.flatnonzero(size >= size.max() * (1.0 - 1e-6))
    return int(ties[np.argmax(grid.y[ties])])


def _within(entry: dict[str, Any], position_mm: float, percent: float) -> bool:
    if abs(entry.get("sag_max_mm", 0.0)) > position_mm:
        return False
    return all(entry[key] is None or abs(entry[key]) <= percent for key in ("k1_max_percent", "k2_max_percent"))


def stl_deviation(mesh: SurfaceMesh, surface: BSplineSurface, outline: Outline) -> dict[str, Any]:
    """Largest distance of the optical facets from the surface (mm) and angle of their normals to its normal (degrees).

    Optical facets are those whose three corners lie on the surface to STL's own float32 and the edge tolerance;
    their middles and edge middles are compared, where a facet strays most.
    """
    corners = mesh.vertices[mesh.faces]
    x_min, x_max, y_min, y_max = outline.bounding_box()
    u = np.clip(mesh.vertices[:, 0], x_min, x_max)
    v = np.clip(mesh.vertices[:, 1], y_min, y_max)
    size = float(np.abs(mesh.vertices).max())
    off = np.linalg.norm(surface.evaluate(u, v) - mesh.vertices, axis=1)
    on_surface = off <= 1e-5 + 4.0 * size * float(np.finfo(np.float32).eps)
    # A sliver of the rim can have all corners on the edge: the optical side is the one that looks at the driver.
    optical = on_surface[mesh.faces].all(axis=1) & (mesh.facet_normals()[:, 2] > 0.1)
    facets = corners[optical]
    if len(facets) == 0:
        return {"height_max_mm": None, "normal_max_deg": None, "facets": 0}
    # Two facets share an edge: its middle is looked at once.
    used = mesh.faces[optical]
    edges = np.sort(np.concatenate([used[:, [0, 1]], used[:, [1, 2]], used[:, [2, 0]]]), axis=1).astype(np.int64)
    edges = np.stack(np.divmod(np.unique(edges[:, 0] * len(mesh.vertices) + edges[:, 1]), len(mesh.vertices)), axis=1)
    places = np.concatenate([facets.mean(axis=1), mesh.vertices[edges].mean(axis=1)])
    z, z_x, z_y = surface.heights(np.clip(places[:, 0], x_min, x_max), np.clip(places[:, 1], y_min, y_max))
    normal = np.stack([-z_x, -z_y, np.ones_like(z)], axis=1) / np.sqrt(1.0 + z_x**2 + z_y**2)[:, None]
    height = (places[:, 2] - z) * normal[:, 2]  # vertical miss times cos of the slope: the distance to first order
    at_middle = normal[: len(facets)]
    chord = np.linalg.norm(mesh.facet_normals()[optical] - at_middle, axis=1)
    return {"height_max_mm": float(np.abs(height).max()),
            "normal_max_deg": float(np.degrees(2.0 * np.arcsin(0.5 * np.minimum(chord.max(), 2.0)))),
            "facets": int(optical.sum())}
