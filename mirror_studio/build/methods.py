"""The decoupled and the faithful surface of a mirror side by side: curvature, height and what the driver would see."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from mirror_cad.design_stages import design
from mirror_cad.deviation import against_design
from mirror_cad.grid import Grid
from mirror_cad.mirror import Mirror
from mirror_cad.spec import MirrorSpec, SurfaceSpec
from mirror_studio.build.results import MethodChange, MethodComparison, MethodFigures
from mirror_studio.viewing_setup import ViewingSetup
from raytrace.measures.difference import ReflectedDifference, reflected_difference
from raytrace.measures.field_of_view import traced_fields_of_view
from raytrace.measures.lane import lane_straightness_percent
from raytrace.reflector import Reflector

Method = Literal["decoupled", "faithful"]
METHODS: tuple[Method, ...] = ("decoupled", "faithful")


def with_method(spec: MirrorSpec, method: Method) -> MirrorSpec:
    """The same mirror by the other method, all numerics chosen automatically."""
    surface = spec.surface
    chosen = SurfaceSpec(method=method, position_tolerance_mm=surface.position_tolerance_mm,
                         curvature_tolerance_percent=surface.curvature_tolerance_percent)
    return spec.model_copy(update={"surface": chosen})


def compare_methods(mirror: Mirror) -> MethodComparison:
    """Both surfaces of one specification, designed and traced."""
    setup = ViewingSetup.of(mirror.spec, mirror.box)
    decoupled, faithful = (mirror if mirror.spec.surface.method == method else design(with_method(mirror.spec, method))
                           for method in METHODS)
    seen = reflected_difference(Reflector.from_mirror(decoupled), Reflector.from_mirror(faithful), setup.eye, setup.plane_z_mm,
                                mirror.box)
    return MethodComparison(_figures(decoupled, setup), _figures(faithful, setup), _change(decoupled, faithful, seen),
                            faithful.faithful)


def _figures(mirror: Mirror, setup: ViewingSetup) -> MethodFigures:
    face = Reflector.from_mirror(mirror).uncoated.surface
    h_fov, v_fov = traced_fields_of_view(face, setup.eye, mirror.box, mirror.left_height_mm)
    return MethodFigures(against_design(mirror.curvature, mirror.outline, mirror.reference, mirror.surface),
                         math.degrees(h_fov), math.degrees(v_fov),
                         lane_straightness_percent(face, setup.eye, setup.lane, mirror.box))


def _change(decoupled: Mirror, faithful: Mirror, seen: ReflectedDifference) -> MethodChange:
    grid = Grid.over(decoupled.outline)
    before, after = (one.model.derivatives(grid.x, grid.y) for one in (decoupled, faithful))
    moved = after.z - before.z
    worst = int(np.argmax(np.abs(moved)))
    # A rigid motion to first order: a shift along z and two tilts; shifts along the mirror and the turn about z are not a
    # matter of form but of where the laws are.
    motion = np.stack([np.ones_like(grid.x), grid.x + before.z * before.zx, grid.y + before.z * before.zy], axis=1)
    left = moved - motion @ np.linalg.lstsq(motion, moved, rcond=None)[0]
    turned = np.arctan(np.hypot(after.zx - before.zx, after.zy - before.zy))
    return MethodChange(
        sag_max_mm=float(moved[worst]), sag_max_at_mm=(float(grid.x[worst]), float(grid.y[worst])),
        sag_rms_mm=float(np.sqrt(np.average(moved**2, weights=grid.weights))),
        sag_best_fit_max_mm=float(np.abs(left).max()),
        slope_max_arcmin=float(np.degrees(turned.max()) * 60.0),
        ray_max_arcmin=seen.turn_max_arcmin, ray_rms_arcmin=seen.turn_rms_arcmin,
        on_plane_max_mm=seen.plane_max_mm, on_plane_rms_mm=seen.plane_rms_mm)
