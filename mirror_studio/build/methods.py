"""A mirror in, its decoupled and its faithful surface side by side out: curvature, height and what the driver would see."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np

from mirror_cad.deviation import against_design
from mirror_cad.grid import Grid
from mirror_cad.mirror import Mirror, design
from mirror_cad.spec import MirrorSpec, SurfaceSpec
from mirror_cad.surfaces.faithful import Faithful
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.measures.difference import reflected_difference
from raytrace.measures.field_of_view import traced_fields_of_view
from raytrace.measures.lane import lane_straightness_percent
from raytrace.reflector import Reflector

Method = Literal["decoupled", "faithful"]
METHODS: tuple[Method, ...] = ("decoupled", "faithful")
CURVATURE_KEYS = tuple(f"{key}_{kind}_percent" for key in ("k1", "k2", "kx", "ky", "twist", "shape") for kind in ("max", "rms"))


def with_method(spec: MirrorSpec, method: Method) -> MirrorSpec:
    """The same mirror by the other method, all numerics chosen automatically."""
    surface = spec.surface
    chosen = SurfaceSpec(method=method, position_tolerance_mm=surface.position_tolerance_mm,
                         curvature_tolerance_percent=surface.curvature_tolerance_percent)
    return spec.model_copy(update={"surface": chosen})


def compare_methods(mirror: Mirror) -> dict[str, Any]:
    """Both surfaces of one specification, designed and traced.

    Returns, for "decoupled" and "faithful": the deviation from the laws (percent, as in deviation.json's `total`), traced
    fields of view (degrees), lane straightness (percent); and under "change", faithful against decoupled: the height moved
    with the point and normal at the origin held, and after the best fit of a rigid motion (mm), the normal's and the
    reflected ray's turn (arc minutes), and how far rays land from each other on the lane's plane (mm).
    """
    setting = ViewingSetup.of(mirror.spec, mirror.box)
    eye = setting.eye
    mirrors = {method: mirror if mirror.spec.surface.method == method else design(with_method(mirror.spec, method))
               for method in METHODS}
    result: dict[str, Any] = {}
    for method, one in mirrors.items():
        entry = against_design(one.curvature, one.outline, one.reference, one.surface)
        face = Reflector.from_mirror(one).uncoated.surface
        h_fov, v_fov = traced_fields_of_view(face, eye, one.box, one.left_height_mm)
        result[method] = {key: entry[key] for key in CURVATURE_KEYS} | {
            "h_fov_deg": math.degrees(h_fov), "v_fov_left_deg": math.degrees(v_fov),
            "lane_straightness_percent": lane_straightness_percent(face, eye, setting.lane, one.box)}
    decoupled, faithful = (mirrors[method] for method in METHODS)
    seen = reflected_difference(Reflector.from_mirror(decoupled), Reflector.from_mirror(faithful), eye, setting.plane_z_mm,
                                mirror.box)
    result["change"] = _moved(decoupled, faithful) | {
        "ray_max_arcmin": seen.turn_max_arcmin, "ray_rms_arcmin": seen.turn_rms_arcmin,
        "on_plane_max_mm": seen.plane_max_mm, "on_plane_rms_mm": seen.plane_rms_mm}
    result["floor"] = floor_of(faithful.faithful)
    return result


def floor_of(faithful: Faithful | None) -> dict[str, Any] | None:
    """How the faithful surface's deviation fell with its spans, and whether it settled."""
    if faithful is None:
        return None
    return {"settled": faithful.settled, "degree": faithful.degree,
            "levels": [{"spans": list(level.spans), "unknowns": level.unknowns, "evaluations": level.evaluations,
                        "shape_rms_percent": level.shape_rms_percent}
                       for level in faithful.levels]}


def _moved(decoupled: Mirror, faithful: Mirror) -> dict[str, Any]:
    grid = Grid.over(decoupled.outline)
    before, after = (one.model.derivatives(grid.x, grid.y) for one in (decoupled, faithful))
    moved = after.z - before.z
    worst = int(np.argmax(np.abs(moved)))
    # A rigid motion to first order: a shift along z and two tilts; shifts along the mirror and the turn about z are not a
    # matter of form but of where the laws are.
    motion = np.stack([np.ones_like(grid.x), grid.x + before.z * before.zx, grid.y + before.z * before.zy], axis=1)
    left = moved - motion @ np.linalg.lstsq(motion, moved, rcond=None)[0]
    turned = np.arctan(np.hypot(after.zx - before.zx, after.zy - before.zy))
    return {"sag_max_mm": float(moved[worst]), "sag_max_at_mm": [float(grid.x[worst]), float(grid.y[worst])],
            "sag_rms_mm": float(np.sqrt(np.average(moved**2, weights=grid.weights))),
            "sag_best_fit_max_mm": float(np.abs(left).max()),
            "slope_max_arcmin": float(np.degrees(turned.max()) * 60.0)}
