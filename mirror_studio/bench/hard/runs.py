"""A case's figures: by the whole chain, or by another path."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_studio.bench.hard.case import Figure
from mirror_studio.bench.hard.chain import make, mirror_of, sample_points
from mirror_studio.bench.hard.figures import (
    ARCSEC,
    ASKED,
    CURVATURE_PERCENT,
    POSITION_MM,
    RAYS,
    mesh_figures,
    ray_figures,
    surface_figures,
    thickness_figure,
    verdict_figure,
)
from mirror_studio.bench.hard.sheets import STEP_MM, Array, Decoupled, Law, Sheet, designed, mean_and_gauss, principal
from mirror_studio.bench.hard.specs import ZONES, ZONES_BREAKS, ZONES_LAW, Spec, constant, kappa, spec


def decoupled(folder: Path, raw: Spec, across: Law, upright: Law, level_mm: float = 0.0, breaks: tuple[float, ...] = (),
              clear_mm: float = 1e-3, percent: float = CURVATURE_PERCENT, position_mm: float = POSITION_MM,
              reason: str = ASKED, met: bool = True, traced: bool = False, shown: str = "curvature") -> list[Figure]:
    """The chain for a decoupled mirror of the laws `across` and `upright`, which the specification spells."""
    made = make(folder, raw)
    sheet = Decoupled(across, upright, level_mm, breaks, *made.mirror.box[:2])
    x, y = sample_points(made.mirror, breaks, clear_mm if isinstance(upright, float) else 3.0 * STEP_MM)
    figures = [*surface_figures(made, sheet, x, y, percent, position_mm, reason), verdict_figure(made, met),
               *mesh_figures(made, sheet, position_mm), thickness_figure(made, sheet)]
    if traced:
        figures += ray_figures(made, sheet, x, y)
    return sorted(figures, key=lambda figure: figure.what != shown)


def faithful_exact(folder: Path, raw: Spec, sheet: Sheet) -> list[Figure]:
    """Laws that a surface can have both of, in closed form: least squares has to find it."""
    made = make(folder, raw)
    x, y = sample_points(made.mirror)
    return [*surface_figures(made, sheet, x, y, CURVATURE_PERCENT, POSITION_MM, ASKED), verdict_figure(made, True),
            *mesh_figures(made, sheet, POSITION_MM), thickness_figure(made, sheet)]


def faithful(folder: Path, raw: Spec, across: Law, upright: Law, breaks: tuple[float, ...] = ()) -> list[Figure]:
    """Other laws: the shape operator has to come nearer to the design than the decoupled surface's does."""
    made = make(folder, raw)
    x, y = sample_points(made.mirror, breaks, 3.0 * STEP_MM)
    sheet = Decoupled(across, upright, 0.0, breaks, *made.mirror.box[:2])
    kx, ky = sheet.laws(x)

    def miss(derivatives: Sequence[Array]) -> float:
        """RMS ‖W − diag(κ_x, κ_y)‖ with W22 = −z_yy/(m²n), W11 = 2H − W22 and W12² = W11·W22 − K."""
        mean, gauss = mean_and_gauss(derivatives)
        p, q, _, _, t = derivatives
        w22 = -t / ((1.0 + q * q) * np.sqrt(1.0 + p * p + q * q))
        w11 = 2.0 * mean - w22
        return float(np.sqrt(((w11 - kx) ** 2 + (w22 - ky) ** 2 + 2.0 * (w11 * w22 - gauss)).mean()))

    return [Figure("shape operator's RMS deviation, of the decoupled surface's",
                   miss(made.derivatives(x, y)) / miss(sheet.derivatives(x, y)), 1.0, "",
                   "least squares may not be worse than where it starts"),
            verdict_figure(made, True)]


def far_away(folder: Path) -> list[Figure]:
    """A mirror turned and moved to vehicle coordinates by build123d, written, read back and traced there."""
    from mirror_cad.occt.step import Part, read_step, write_step
    from raytrace import load_reflector, reflect

    made = make(folder, spec(ZONES, constant(1250.0)))
    mirror = made.mirror
    part = mirror.to_build123d()
    location = type(part.location)((20_000.0, 800.0, -1000.0), (10.0, 25.0, -40.0))
    path = folder / "moved.step"
    write_step(path, [Part(part.moved(location).wrapped, "moved")], "moved")
    motion = location.wrapped.Transformation()
    matrix = np.array([[motion.Value(i, j) for j in range(1, 5)] for i in range(1, 4)])
    turn, shift = matrix[:, :3], matrix[:, 3]
    x, y = sample_points(mirror)
    sheet = Decoupled(ZONES_LAW, 1.0 / 1250.0, 0.0, ZONES_BREAKS, *mirror.box[:2])
    points = np.stack([x, y, sheet.height(x, y)], axis=1)

    def off(surface: BSplineSurface) -> float:
        if surface.domain != mirror.surface.domain:
            return math.inf
        return float(np.linalg.norm((surface.evaluate(x, y) - shift) @ turn - points, axis=1).max())

    surface = min((face.surface for face in read_step(path).faces), key=off)
    d = surface.derivatives(x, y)
    normal = np.cross(d["u"], d["v"])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    e, f, g = ((d[a] * d[b]).sum(axis=1) for a, b in (("u", "u"), ("u", "v"), ("v", "v")))
    ll, mm, nn = ((d[key] * normal).sum(axis=1) for key in ("uu", "uv", "vv"))
    mean, gauss = -(ll * g - 2.0 * mm * f + nn * e) / (2.0 * (e * g - f * f)), (ll * nn - mm * mm) / (e * g - f * f)
    miss = np.abs(principal(mean, gauss) - principal(*mean_and_gauss(sheet.derivatives(x, y))))
    eye = np.array([115.0, 0.0, 753.0])
    rays: Array = points[:RAYS] - eye
    here = reflect(load_reflector(made.step), eye, rays)
    there = reflect(load_reflector(path), turn @ eye + shift, rays @ turn.T)
    apart = np.linalg.norm(there.directions - here.directions @ turn.T, axis=1)
    return [Figure("rays against the unmoved mirror's, turned", float(np.nanmax(apart)) * ARCSEC, 1e-6, "″",
                   "what a trace on a B-spline promises"),
            Figure("rays with another status", float(np.count_nonzero(there.status != here.status)), 0.0, "",
                   "moving changes no ray's fate"),
            Figure("place", off(surface), POSITION_MM, "mm", ASKED),
            Figure("curvature", 100.0 * float((miss / designed(sheet, x)).max()), CURVATURE_PERCENT, "%", ASKED)]


def million_points(folder: Path) -> list[Figure]:
    """A point grid of a million rows, and derivatives on 1000 × 1000 points."""
    mirror = mirror_of(spec(constant(1250.0), constant(900.0)), folder)
    sheet = Decoupled(1.0 / 1250.0, 1.0 / 900.0, 0.0, (), *mirror.box[:2])
    tracemalloc.start()
    try:
        points = mirror.grid_points(0.26)
        x, y = np.meshgrid(np.linspace(-115.0, 115.0, 1000), np.linspace(-160.0, 160.0, 1000))
        d = mirror.surface.derivatives(x, y)
        peak = tracemalloc.get_traced_memory()[1] / 1e9
    finally:
        tracemalloc.stop()
    wanted = sheet.derivatives(x.ravel(), y.ravel())
    curvature = max(float(np.abs(d[key][..., 2].ravel() / wanted[i] - 1.0).max()) for key, i in (("uu", 2), ("vv", 4)))
    height = np.abs(points[:, 2] - sheet.height(points[:, 0], points[:, 1]))
    return [Figure("height of the points", float(height.max()), POSITION_MM, "mm", ASKED),
            Figure("rows short of a million", max(0.0, 1e6 - len(points)), 0.0, "", "the pitch is chosen for a million"),
            Figure("z_xx and z_yy", 100.0 * curvature, CURVATURE_PERCENT, "%", ASKED),
            Figure("memory", peak, 2.0, "GB", "the results alone are 0.2 GB; what a small computer can spare")]


def euler(folder: Path) -> list[Figure]:
    """The paper's rule with a step of 10 mm: κ comes out one step late, which the report has to show."""
    step, slope = 10.0, 2e-6
    made = make(folder, spec(kappa(f"0.0008 + {slope}*(115 - x)"), constant(1250.0),
                             surface={"integration": "euler", "step_mm": step}))
    x = np.linspace(-80.0, 80.0, 1001)  # away from the ends, where the joining spline has errors of its own
    z_x, _, z_xx, _, _ = made.derivatives(x, np.zeros_like(x))
    asked = 0.0008 + slope * (115.0 - x)
    late = -z_xx / (1.0 + z_x**2) ** 1.5 / asked - 1.0 + step * slope / asked
    return [Figure("κ, less the delay −h·κ′", 100.0 * float(np.abs(late).max()), 0.5, "%",
                   "what is left is of the next order in h, or h·κ·tan θ"),
            verdict_figure(made, False)]
