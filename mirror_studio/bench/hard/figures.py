"""Figures of a hard case: surface, facets, thickness, rays, and the report's verdict.

The STL file is read as bare bytes.
"""

from __future__ import annotations

import itertools
import json
import math

import numpy as np

from mirror_cad.mirror import Mirror
from mirror_studio.as_json import deviation_as_json
from mirror_studio.bench.hard.case import Figure
from mirror_studio.bench.hard.chain import Made
from mirror_studio.bench.hard.sheets import Array, Sheet, designed, mean_and_gauss, normals, principal

# What a specification asks for that names no tolerances.
ASKED = "the specification's tolerance"
POSITION_MM = 1e-5
CURVATURE_PERCENT = 0.01

RAYS = 400
ARCSEC = math.degrees(1.0) * 3600.0
THICKNESS = "mean thickness by the volume"


def surface_figures(made: Made, sheet: Sheet, x: Array, y: Array, percent: float, position_mm: float,
                    reason: str) -> list[Figure]:
    """Height and principal curvatures of the STEP file's surface, against the sheet."""
    points = made.spline(np.stack([x, y], axis=1))
    off = np.abs(points[:, 2] - sheet.height(x, y))
    same = np.abs(points[:, :2] - np.stack([x, y], axis=1)).max()
    miss = np.abs(principal(*mean_and_gauss(made.derivatives(x, y))) - principal(*mean_and_gauss(sheet.derivatives(x, y))))
    asked = designed(sheet, x)
    rms = float(np.sqrt((asked**2).sum(axis=0).mean()))
    if rms == 0.0:
        curvature = Figure("curvature", 1e3 * float(miss.max()), 1e-6, "1/m",
                           "bends a height of 150 mm by the position tolerance, 1e-5 mm")
    else:
        share = miss / np.maximum(np.abs(asked), 0.01 * rms)
        curvature = Figure("curvature", 100.0 * float(share.max()), percent, "%", reason)
    return [curvature, Figure("height", float(off.max()), position_mm, "mm", reason),
            Figure("x, y against u, v", float(same), 1e-9, "mm", "u = x and v = y but for a STEP file's digits")]


def mesh_figures(made: Made, sheet: Sheet, position_mm: float) -> list[Figure]:
    """The STL file's optical facets against the sheet, which the surface may miss, and whether its triangles close."""
    mirror = made.mirror
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    stored = np.frombuffer(made.stl.read_bytes()[84:], dtype=record)["corners"] + np.float32(0.0)  # −0 and 0 are one point
    corners = stored.astype(np.float64)
    faces = np.unique(stored.reshape(-1, 3).view("V12"), return_inverse=True)[1].reshape(-1, 3).astype(np.int64)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    low, high = np.sort(np.stack([faces.ravel(), np.roll(faces, 1, axis=1).ravel()]), axis=0)
    open_edges = int(np.count_nonzero(np.unique(low * faces.max() + high, return_counts=True)[1] % 2))
    x_min, x_max, y_min, y_max = mirror.box

    def off(points: Array) -> Array:
        """Distance from the sheet, to first order."""
        x, y = np.clip(points[..., 0], x_min, x_max).ravel(), np.clip(points[..., 1], y_min, y_max).ravel()
        upright = normals(sheet.derivatives(x, y))[:, 2]
        return np.abs(points[..., 2].ravel() - sheet.height(x, y)) * upright

    size = float(np.abs(corners).max())
    on = (off(corners).reshape(-1, 3) <= 2.0 * position_mm + 8.0 * size * float(np.finfo(np.float32).eps)).all(axis=1)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    on &= cross[:, 2] > 0.0
    optical = corners[on]
    shadow = 0.5 * float(cross[on, 2].sum()) / mirror.outline.area_mm2() - 1.0
    middles = np.concatenate([optical.mean(axis=1), (0.5 * (optical + np.roll(optical, 1, axis=1))).reshape(-1, 3)])
    deflection = mirror.spec.export.stl_deflection_mm
    edge = mirror.outline.polyline(deflection)
    around = float(np.linalg.norm(edge - np.roll(edge, 1, axis=0), axis=1).sum())
    cut = 100.0 * deflection * around / mirror.outline.area_mm2()
    return [Figure("STL facets", float(off(middles).max()) if len(optical) else math.nan,
                   deflection + position_mm, "mm", "the deflection asked for, and the surface's own tolerance"),
            Figure("STL area of the optical side", 100.0 * shadow, cut, "%", "facets may cut arcs by the deflection"),
            Figure("STL open edges", float(open_edges), 0.0, "", "a solid is closed")]


def thickness_figure(made: Made, sheet: Sheet) -> Figure:
    """The plate's volume against Steiner's formula t·A − t²·∫H dA + t³/3·∫K dA, as a thickness."""
    mirror = made.mirror
    t = mirror.spec.glass.thickness_mm
    x, y, weight = _inside(mirror)
    derivatives = sheet.derivatives(x, y)
    mean, gauss = mean_and_gauss(derivatives)
    area = weight * np.sqrt(1.0 + derivatives[0] ** 2 + derivatives[1] ** 2)
    volume = float((area * (t - t * t * mean + t**3 / 3.0 * gauss)).sum())
    return Figure(THICKNESS, (mirror.plate.volume_mm3 - volume) / float(area.sum()), 1e-3, "mm",
                  "what the back may miss the true offset by")


def _inside(mirror: Mirror) -> tuple[Array, Array, Array]:
    """Gauss points and weights over the outline's polygon, in y crowded towards the edges as the arcsine.

    Where a sheet comes near to vertical, its area element is no polynomial there.
    """
    x_min, x_max, _, _ = mirror.box
    polygon = mirror.outline.polyline(1e-5 * (x_max - x_min))
    following = np.roll(polygon, -1, axis=0)
    crowded = 0.5 * (x_max + x_min) - 0.5 * (x_max - x_min) * np.cos(np.linspace(0.0, np.pi, 121))
    ends = np.unique(np.concatenate([polygon[:, 0], crowded[1:-1]]))
    node, share = np.polynomial.legendre.leggauss(2)
    fine, fine_share = np.polynomial.legendre.leggauss(32)
    turned, slope = np.sin(0.5 * np.pi * fine), 0.5 * np.pi * np.cos(0.5 * np.pi * fine)
    xs, ys, weights = [], [], []
    for a, b in itertools.pairwise(ends):
        for x, w in zip(0.5 * (a + b) + 0.5 * (b - a) * node, 0.5 * (b - a) * share, strict=True):
            crossed = (polygon[:, 0] <= x) != (following[:, 0] <= x)
            (x0, y0), (x1, y1) = polygon[crossed].T, following[crossed].T
            cuts = np.sort(y0 + (x - x0) * (y1 - y0) / (x1 - x0))
            for low, high in zip(cuts[::2], cuts[1::2], strict=True):
                xs.append(np.full(fine.size, x))
                ys.append(0.5 * (low + high) + 0.5 * (high - low) * turned)
                weights.append(0.5 * w * (high - low) * fine_share * slope)
    weight = np.concatenate(weights)
    return np.concatenate(xs), np.concatenate(ys), weight * (mirror.outline.area_mm2() / weight.sum())


def ray_figures(made: Made, sheet: Sheet, x: Array, y: Array) -> list[Figure]:
    """Rays from the eye to points of the sheet, traced on the STEP file: their directions after reflection."""
    from raytrace import load_reflector, reflect
    from raytrace.viewing.eye import EYE_DISTANCE_MM, eye_position

    x, y = x[:RAYS], y[:RAYS]
    box = made.mirror.box
    targets = np.stack([x, y, sheet.height(x, y)], axis=1)
    eye = eye_position(max(EYE_DISTANCE_MM, 2.0 * box[1]), "right", box)
    rays = (targets - eye) / np.linalg.norm(targets - eye, axis=1, keepdims=True)
    normal = normals(sheet.derivatives(x, y))
    wanted = rays - 2.0 * (rays * normal).sum(axis=1, keepdims=True) * normal
    trace = reflect(load_reflector(made.step), eye, rays)
    lost = int(np.count_nonzero(trace.status))
    off = np.linalg.norm(trace.directions - wanted, axis=1)
    return [Figure("rays lost", float(lost), 0.0, "", "every ray is aimed inside the outline"),
            Figure("reflected rays", float(np.nanmax(off, initial=0.0)) * ARCSEC, 1.0, "″",
                   "a sixtieth of what an eye resolves")]


def verdict_figure(made: Made, met: bool) -> Figure:
    """Whether the deviation's own verdict is the one the case gives reason to expect; NaN where its JSON would hold one."""
    numbers = json.dumps([deviation_as_json(made.deviation), made.mirror.section_fields_of_view()])
    value = math.nan if "NaN" in numbers or "Infinity" in numbers else float(made.deviation.numerical != met)
    return Figure("verdict of the report", value, 0.0, "",
                  f"the tolerances are {'met' if met else 'missed, and it has to say so'}")
