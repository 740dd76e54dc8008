"""Mirrors that numerics find hard in, one table out: each case's worst figure beside its tolerance, or its refusal.

A case goes through the whole chain: specification, design, plate, STEP and STL, both read back, deviation. What is read
back is compared with a second working-out that uses nothing of the program: closed forms where radii are constant, else
the paper's equation by scipy's Runge-Kutta rule, and the textbook's fundamental forms. The surface of the STEP file is
taken from its text and evaluated by scipy, the STL file is read as bare bytes.
"""

from __future__ import annotations

import faulthandler
import itertools
import json
import math
import multiprocessing
import re
import signal
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property, partial
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline, NdBSpline

from mirror_cad.bspline import BSplineSurface
from mirror_cad.errors import MirrorError, OutlineError, ProfileError, SolidError, SpecError
from mirror_cad.mirror import Mirror, design
from mirror_cad.spec_file import validate_spec
from mirror_studio.bench.table import Column, Table
from mirror_studio.progress import Progress

Array = NDArray[np.float64]
Law = float | Callable[[Array], Array]  # κ in 1/mm, constant or of x (n,)
Row = dict[str, Any]
Spec = dict[str, Any]

LIMIT_S = 10.0  # of processor time for one case, the kernel's import not counted: how busy the machine is does not matter
LONGEST_WAIT = 12.0  # times the limit by the clock, for a case that waits without working
AT_ONCE = 2
WARM_UP_S = 600.0  # for the kernel's import and numba's first compilation
PLACES = 3000  # at random inside the outline, seed fixed, where curvature and height are compared
RAYS = 400
STEP_MM = 0.05  # of the differences that stand for κ₂′, κ₂″: fourth order, some 1e-9 of a law that changes over 10 mm
ARCSEC = math.degrees(1.0) * 3600.0
PACKAGES = ("mirror_cad", "raytrace", "mirror_studio")
STACK = "stack.txt"

GOOD = WITHIN, REFUSED = "within", "refused"
BAD = OUTSIDE, NOT_A_NUMBER, NOT_REFUSED, WRONGLY_REFUSED, CAUSE_NOT_NAMED, INTERNAL, CRASHED, HANGS = (
    "outside", "NaN", "not refused", "wrongly refused", "cause not named", "internal error", "crashed", "hangs")


@dataclass(frozen=True, slots=True)
class Figure:
    """One comparison: |value| may not pass the tolerance, which has a reason."""

    what: str
    value: float
    tolerance: float
    unit: str
    reason: str

    @property
    def share(self) -> float:
        """|value| as a share of the tolerance."""
        if self.tolerance == 0.0:
            return 0.0 if self.value == 0.0 else math.inf
        return abs(self.value) / self.tolerance


@dataclass(frozen=True, slots=True)
class Refusal:
    """The error that a case has to end with, and the words of its message that name the cause."""

    kind: type[MirrorError]
    words: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """What is hard, and the work: a folder for files in, figures out. Where a refusal is expected, it is right alone."""

    name: str
    hard: str
    run: Callable[[Path], Sequence[Figure]]
    refusal: Refusal | None = None


# --- the surface worked out a second time -----------------------------------------------------------------------------


class Sheet(Protocol):
    """A surface z(x, y) known from elsewhere, and the two curvatures asked for."""

    def laws(self, x: Array) -> tuple[Array, Array]: ...

    def height(self, x: Array, y: Array) -> Array: ...

    def derivatives(self, x: Array, y: Array) -> tuple[Array, Array, Array, Array, Array]:
        """z_x, z_y, z_xx, z_xy, z_yy."""


@dataclass(frozen=True, eq=False)
class Decoupled:
    """z(x, y) = z_p(x) − s(κ₂(x), y) between x = low and high, with z_p level at `level_mm` and 0 at x = 0.

    across, upright : κ₁, κ₂.   breaks : x where a law is less than smooth.
    """

    across: Law
    upright: Law
    level_mm: float
    breaks: tuple[float, ...]
    low: float
    high: float

    def laws(self, x: Array) -> tuple[Array, Array]:
        return _value(self.across, x), _value(self.upright, x)

    def height(self, x: Array, y: Array) -> Array:
        return self.profile(x)[0] - _circle(_value(self.upright, x), y)

    def derivatives(self, x: Array, y: Array) -> tuple[Array, Array, Array, Array, Array]:
        k1, k = self.laws(x)
        g = self.profile(x)[1]
        k_x = k_xx = np.zeros_like(x)
        if not isinstance(self.upright, float):
            a, b, c, d = (self.upright(x + i * STEP_MM) for i in (-2, -1, 1, 2))
            k_x = (a - 8.0 * b + 8.0 * c - d) / (12.0 * STEP_MM)
            k_xx = (-a + 16.0 * b - 30.0 * k + 16.0 * c - d) / (12.0 * STEP_MM**2)
        w = np.sqrt((1.0 - k * y) * (1.0 + k * y))
        s_k = y**2 / (w * (1.0 + w))
        s_kk = k * y**4 * (1.0 + 2.0 * w) / (w**3 * (1.0 + w) ** 2)
        return (g - s_k * k_x, -k * y / w, -k1 * (1.0 + g * g) ** 1.5 - s_kk * k_x**2 - s_k * k_xx, -k_x * y / w**3,
                -k / w**3)

    def profile(self, x: Array) -> tuple[Array, Array]:
        """z_p and z_p′ at x: the arc's closed form, or the solution of the paper's eq. 2."""
        if isinstance(self.across, float):
            s = self.across * (x - self.level_mm)
            height = _circle(self.across, -self.level_mm) - _circle(self.across, x - self.level_mm)
            return height, -s / np.sqrt((1.0 - s) * (1.0 + s))
        state = np.full((2, x.size), np.nan)
        for low, high, solution in self._pieces:
            here = (x >= low) & (x <= high)
            if here.any():
                state[:, here] = solution(x[here])
        at_origin = next(float(solution(0.0)[0]) for low, high, solution in self._pieces if low <= 0.0 <= high)
        return state[0] - at_origin, state[1]

    @cached_property
    def _pieces(self) -> list[tuple[float, float, Any]]:
        """z′ = g, g′ = −κ(1 + g²)^(3/2) from the level point to either end, from break to break."""

        def rates(x: float, state: Array) -> tuple[float, float]:
            return state[1], -float(_value(self.across, np.array([x]))[0]) * (1.0 + state[1] ** 2) ** 1.5

        pieces = []
        for end in (min(self.low, self.level_mm), max(self.high, self.level_mm)):
            between = [b for b in self.breaks if min(end, self.level_mm) < b < max(end, self.level_mm)]
            stops = [self.level_mm, *sorted(between, reverse=end < self.level_mm), end]
            state = np.zeros(2)
            for a, b in itertools.pairwise(stops):
                inset = 1e-12 * (b - a)  # so that a jump at an end is seen from inside
                solved = solve_ivp(rates, (a + inset, b - inset), state, "DOP853", dense_output=True, rtol=1e-13,
                                   atol=1e-15, max_step=max(abs(b - a) / 8.0, 1e-9))
                pieces.append((min(a, b), max(a, b), solved.sol))
                state = solved.y[:, -1]
        return pieces


@dataclass(frozen=True, slots=True)
class Sphere:
    """z = √(R² − x² − y²) − R, convex for R > 0; R = inf is the plane."""

    radius_mm: float

    def laws(self, x: Array) -> tuple[Array, Array]:
        return np.full_like(x, 1.0 / self.radius_mm), np.full_like(x, 1.0 / self.radius_mm)

    def height(self, x: Array, y: Array) -> Array:
        return -_circle(1.0 / self.radius_mm, np.hypot(x, y))

    def derivatives(self, x: Array, y: Array) -> tuple[Array, Array, Array, Array, Array]:
        k = 1.0 / self.radius_mm
        w = np.sqrt(1.0 - k * k * (x * x + y * y))
        return (-k * x / w, -k * y / w, -k * (1.0 - (k * y) ** 2) / w**3, -(k**3) * x * y / w**3,
                -k * (1.0 - (k * x) ** 2) / w**3)


def _value(law: Law, x: Array) -> Array:
    return np.full(np.shape(x), law) if isinstance(law, float) else np.asarray(law(x), dtype=np.float64)


def _circle(kappa: ArrayLike, y: ArrayLike) -> Array:
    """Sag of a circle of curvature κ at y."""
    k, y = np.asarray(kappa, dtype=np.float64), np.asarray(y, dtype=np.float64)
    result: Array = k * y**2 / (1.0 + np.sqrt((1.0 - k * y) * (1.0 + k * y)))
    return result


def _mean_and_gauss(derivatives: Sequence[Array]) -> tuple[Array, Array]:
    """H (convex positive) and K of z(x, y). Source: M. do Carmo, Differential Geometry, section 3-3, example 5."""
    p, q, r, s, t = derivatives
    n2 = 1.0 + p * p + q * q
    mean = -((1.0 + q * q) * r - 2.0 * p * q * s + (1.0 + p * p) * t) / (2.0 * n2**1.5)
    return mean, (r * t - s * s) / n2**2


def _principal(derivatives: Sequence[Array]) -> Array:
    mean, gauss = _mean_and_gauss(derivatives)
    root = np.sqrt(np.maximum(mean**2 - gauss, 0.0))
    return np.stack([mean + root, mean - root])


def _normals(derivatives: Sequence[Array]) -> Array:
    p, q = derivatives[:2]
    normal = np.stack([-p, -q, np.ones_like(p)], axis=1)
    result: Array = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return result


# --- the chain, and what is compared of it -----------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Made:
    """A mirror through the whole chain, its files, and their optical surface as scipy's spline over (x, y)."""

    mirror: Mirror
    numerical: bool
    deviation: dict[str, Any]
    step: Path
    stl: Path
    spline: NdBSpline

    def derivatives(self, x: Array, y: Array) -> tuple[Array, ...]:
        """z_x, z_y, z_xx, z_xy, z_yy of the surface in the STEP text; u = x and v = y is compared elsewhere."""
        orders = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        return tuple(self.spline(np.stack([x, y], axis=1), nu=order)[:, 2] for order in orders)


def make(folder: Path, raw: Spec) -> Made:
    """Specification → design → plate → files → read back → deviation. Raises: MirrorError."""
    from mirror_cad.occt.step import OPTICAL_FACE
    from mirror_cad.occt.tessellate import read_stl
    from mirror_cad.outline_files import write_dxf
    from mirror_cad.part21 import read_named_surface
    from mirror_studio import checks

    mirror = design(validate_spec({"name": "case"} | raw, folder=folder))
    step, sheet, stl, outline = (folder / name for name in ("case.step", "case-surface.step", "case.stl", "case.dxf"))
    mirror.export_step(step)
    mirror.export_surface_step(sheet)
    mirror.export_stl(stl)
    write_dxf(mirror.outline, outline)
    read_back, _ = checks.check_step(step, mirror)
    checks.check_surface_step(sheet, mirror)
    checks.check_outline(outline, mirror)
    deviation = mirror.deviation(read_back, read_stl(stl))
    text = read_named_surface(step, OPTICAL_FACE)
    spline = NdBSpline((text.knots_u, text.knots_v), text.poles, (text.degree_u, text.degree_v))
    return Made(mirror, deviation.numerical, deviation.as_json(), step, stl, spline)


def places(mirror: Mirror, breaks: Sequence[float] = (), clear_mm: float = 0.0) -> tuple[Array, Array]:
    """PLACES inside the outline and off the breaks."""
    x_min, x_max, y_min, y_max = mirror.box
    rng = np.random.default_rng(20)
    x, y = rng.uniform(x_min, x_max, 4 * PLACES), rng.uniform(y_min, y_max, 4 * PLACES)
    keep = mirror.outline.contains(x, y)
    for b in breaks:
        keep &= np.abs(x - b) > clear_mm
    return x[keep][:PLACES], y[keep][:PLACES]


def surface_figures(made: Made, sheet: Sheet, x: Array, y: Array, percent: float, position_mm: float,
                    reason: str) -> list[Figure]:
    """Height and principal curvatures of the STEP file's surface, against the sheet."""
    points = made.spline(np.stack([x, y], axis=1))
    off = np.abs(points[:, 2] - sheet.height(x, y))
    same = np.abs(points[:, :2] - np.stack([x, y], axis=1)).max()
    miss = np.abs(_principal(made.derivatives(x, y)) - _principal(sheet.derivatives(x, y)))
    designed = np.sort(np.stack(sheet.laws(x)), axis=0)[::-1]
    rms = float(np.sqrt((designed**2).sum(axis=0).mean()))
    if rms == 0.0:
        curvature = Figure("curvature", 1e3 * float(miss.max()), 1e-6, "1/m",
                           "bends a height of 150 mm by the position tolerance, 1e-5 mm")
    else:
        share = miss / np.maximum(np.abs(designed), 0.01 * rms)
        curvature = Figure("curvature", 100.0 * float(share.max()), percent, "%", reason)
    return [curvature, Figure("height", float(off.max()), position_mm, "mm", reason),
            Figure("x, y against u, v", float(same), 1e-9, "mm", "u = x and v = y but for a STEP file's digits")]


def mesh_figures(path: Path, mirror: Mirror, sheet: Sheet, position_mm: float = 1e-5) -> list[Figure]:
    """The STL file's optical facets against the sheet, which the surface may miss, and whether its triangles close."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    stored = np.frombuffer(path.read_bytes()[84:], dtype=record)["corners"] + np.float32(0.0)  # −0 and 0 are one place
    corners = stored.astype(np.float64)
    faces = np.unique(stored.reshape(-1, 3).view("V12"), return_inverse=True)[1].reshape(-1, 3).astype(np.int64)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    low, high = np.sort(np.stack([faces.ravel(), np.roll(faces, 1, axis=1).ravel()]), axis=0)
    open_edges = int(np.count_nonzero(np.unique(low * faces.max() + high, return_counts=True)[1] % 2))
    x_min, x_max, y_min, y_max = mirror.box

    def off(points: Array) -> Array:
        """Distance from the sheet, to first order."""
        x, y = np.clip(points[..., 0], x_min, x_max).ravel(), np.clip(points[..., 1], y_min, y_max).ravel()
        upright = _normals(sheet.derivatives(x, y))[:, 2]
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
    mean, gauss = _mean_and_gauss(derivatives)
    area = weight * np.sqrt(1.0 + derivatives[0] ** 2 + derivatives[1] ** 2)
    volume = float((area * (t - t * t * mean + t**3 / 3.0 * gauss)).sum())
    return Figure(THICKNESS, (mirror.plate.volume_mm3 - volume) / float(area.sum()), 1e-3, "mm",
                  "what the back may miss the true offset by")


def _inside(mirror: Mirror) -> tuple[Array, Array, Array]:
    """Gauss points and weights over the outline's polygon, in y crowded towards the edges as the arcsine: where a sheet
    comes near to vertical, its area element is no polynomial there."""
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


def ray_figures(step: Path, mirror: Mirror, sheet: Sheet, x: Array, y: Array) -> list[Figure]:
    """Rays from the eye to places of the sheet, traced on the STEP file: their directions after reflection."""
    from raytrace import load_reflector, reflect
    from raytrace.eye import eye_position

    x, y = x[:RAYS], y[:RAYS]
    targets = np.stack([x, y, sheet.height(x, y)], axis=1)
    eye = eye_position(max(762.0, 2.0 * mirror.box[1]), "right", mirror.box)
    rays = (targets - eye) / np.linalg.norm(targets - eye, axis=1, keepdims=True)
    normal = _normals(sheet.derivatives(x, y))
    wanted = rays - 2.0 * (rays * normal).sum(axis=1, keepdims=True) * normal
    trace = reflect(load_reflector(step), eye, rays)
    lost = int(np.count_nonzero(trace.status))
    off = np.linalg.norm(trace.directions - wanted, axis=1)
    return [Figure("rays lost", float(lost), 0.0, "", "every ray is aimed inside the outline"),
            Figure("reflected rays", float(np.nanmax(off, initial=0.0)) * ARCSEC, 1.0, "″",
                   "a sixtieth of what an eye resolves")]


def verdict_figure(made: Made, met: bool) -> Figure:
    """Whether the deviation's own verdict is the one the case gives reason to expect; NaN where its JSON would hold one."""
    numbers = json.dumps([made.deviation, made.mirror.section_fields_of_view()])
    value = math.nan if "NaN" in numbers or "Infinity" in numbers else float(made.numerical != met)
    return Figure("verdict of the report", value, 0.0, "",
                  f"the tolerances are {'met' if met else 'missed, and it has to say so'}")


ASKED = "the specification's tolerance"
THICKNESS = "mean thickness by the volume"


def decoupled(folder: Path, raw: Spec, across: Law, upright: Law, level_mm: float = 0.0, breaks: tuple[float, ...] = (),
              clear_mm: float = 1e-3, percent: float = 0.01, position_mm: float = 1e-5, reason: str = ASKED, met: bool = True,
              traced: bool = False, shown: str = "curvature") -> list[Figure]:
    """The chain for a decoupled mirror of the laws `across` and `upright`, which the specification spells."""
    made = make(folder, raw)
    sheet = Decoupled(across, upright, level_mm, breaks, *made.mirror.box[:2])
    x, y = places(made.mirror, breaks, clear_mm if isinstance(upright, float) else 3.0 * STEP_MM)
    figures = [*surface_figures(made, sheet, x, y, percent, position_mm, reason), verdict_figure(made, met),
               *mesh_figures(made.stl, made.mirror, sheet, position_mm), thickness_figure(made, sheet)]
    if traced:
        figures += ray_figures(made.step, made.mirror, sheet, x, y)
    return sorted(figures, key=lambda figure: figure.what != shown)


def faithful_exact(folder: Path, raw: Spec, sheet: Sheet) -> list[Figure]:
    """Laws that a surface can have both of, in closed form: least squares has to find it."""
    made = make(folder, raw)
    x, y = places(made.mirror)
    return [*surface_figures(made, sheet, x, y, 0.01, 1e-5, ASKED), verdict_figure(made, True),
            *mesh_figures(made.stl, made.mirror, sheet), thickness_figure(made, sheet)]


def faithful(folder: Path, raw: Spec, across: Law, upright: Law, breaks: tuple[float, ...] = ()) -> list[Figure]:
    """Other laws: the shape operator has to come nearer to the design than the decoupled surface's does."""
    made = make(folder, raw)
    x, y = places(made.mirror, breaks, 3.0 * STEP_MM)
    sheet = Decoupled(across, upright, 0.0, breaks, *made.mirror.box[:2])
    kx, ky = sheet.laws(x)

    def miss(derivatives: Sequence[Array]) -> float:
        """RMS ‖W − diag(κ₁, κ₂)‖ with W22 = −z_yy/(m²n), W11 = 2H − W22 and W12² = W11·W22 − K."""
        mean, gauss = _mean_and_gauss(derivatives)
        p, q, _, _, t = derivatives
        w22 = -t / ((1.0 + q * q) * np.sqrt(1.0 + p * p + q * q))
        w11 = 2.0 * mean - w22
        return float(np.sqrt(((w11 - kx) ** 2 + (w22 - ky) ** 2 + 2.0 * (w11 * w22 - gauss)).mean()))

    return [Figure("shape operator's RMS deviation, of the decoupled surface's",
                   miss(made.derivatives(x, y)) / miss(sheet.derivatives(x, y)), 1.0, "",
                   "least squares may not be worse than where it starts"),
            verdict_figure(made, True)]


# --- cases that take another way ---------------------------------------------------------------------------------------


def far_away(folder: Path) -> list[Figure]:
    """A mirror turned and moved to vehicle coordinates by build123d, written, read back and traced there."""
    from mirror_cad.occt.step import Part, read_step_faces, write_step
    from raytrace import load_reflector, reflect

    made = make(folder, _spec(ZONES, _constant(1250.0)))
    mirror = made.mirror
    part = mirror.to_build123d()
    place = type(part.location)((20_000.0, 800.0, -1000.0), (10.0, 25.0, -40.0))
    path = folder / "moved.step"
    write_step(path, [Part(part.moved(place).wrapped, "moved")], "moved")
    motion = place.wrapped.Transformation()
    matrix = np.array([[motion.Value(i, j) for j in range(1, 5)] for i in range(1, 4)])
    turn, shift = matrix[:, :3], matrix[:, 3]
    x, y = places(mirror)
    sheet = Decoupled(ZONES_LAW, 1.0 / 1250.0, 0.0, ZONES_BREAKS, *mirror.box[:2])
    points = np.stack([x, y, sheet.height(x, y)], axis=1)

    def off(surface: BSplineSurface) -> float:
        if surface.domain != mirror.surface.domain:
            return math.inf
        return float(np.linalg.norm((surface.evaluate(x, y) - shift) @ turn - points, axis=1).max())

    surface = min((face.surface for face in read_step_faces(path)), key=off)
    d = surface.derivatives(x, y)
    normal = np.cross(d["u"], d["v"])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    e, f, g = ((d[a] * d[b]).sum(axis=1) for a, b in (("u", "u"), ("u", "v"), ("v", "v")))
    ll, mm, nn = ((d[key] * normal).sum(axis=1) for key in ("uu", "uv", "vv"))
    mean, gauss = -(ll * g - 2.0 * mm * f + nn * e) / (2.0 * (e * g - f * f)), (ll * nn - mm * mm) / (e * g - f * f)
    root = np.sqrt(np.maximum(mean**2 - gauss, 0.0))
    miss = np.abs(np.stack([mean + root, mean - root]) - _principal(sheet.derivatives(x, y)))
    designed = np.sort(np.stack(sheet.laws(x)), axis=0)[::-1]
    eye = np.array([115.0, 0.0, 753.0])
    rays: Array = points[:RAYS] - eye
    here = reflect(load_reflector(made.step), eye, rays)
    there = reflect(load_reflector(path), turn @ eye + shift, rays @ turn.T)
    apart = np.linalg.norm(there.directions - here.directions @ turn.T, axis=1)
    return [Figure("rays against the unmoved mirror's, turned", float(np.nanmax(apart)) * ARCSEC, 1e-6, "″",
                   "what a trace on a B-spline promises"),
            Figure("rays with another status", float(np.count_nonzero(there.status != here.status)), 0.0, "",
                   "moving changes no ray's fate"),
            Figure("place", off(surface), 1e-5, "mm", ASKED),
            Figure("curvature", 100.0 * float((miss / designed).max()), 0.01, "%", ASKED)]


def million_places(folder: Path) -> list[Figure]:
    """A point grid of a million rows, and derivatives on 1000 × 1000 places."""
    mirror = design(validate_spec({"name": "case"} | _spec(_constant(1250.0), _constant(900.0)), folder=folder))
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
    return [Figure("height of the points", float(np.abs(points[:, 2] - sheet.height(points[:, 0], points[:, 1])).max()), 1e-5,
                   "mm", ASKED),
            Figure("rows short of a million", max(0.0, 1e6 - len(points)), 0.0, "", "the pitch is chosen for a million"),
            Figure("z_xx and z_yy", 100.0 * curvature, 0.01, "%", ASKED),
            Figure("memory", peak, 2.0, "GB", "the results alone are 0.2 GB; what a small computer can spare")]


def euler(folder: Path) -> list[Figure]:
    """The paper's rule with a step of 10 mm: κ comes out one step late, which the report has to show."""
    step, slope = 10.0, 2e-6
    made = make(folder, _spec(_curvature(f"0.0008 + {slope}*(115 - x)"), _constant(1250.0),
                              surface={"integration": "euler", "step_mm": step}))
    x = np.linspace(-80.0, 80.0, 1001)  # away from the ends, where the joining spline has errors of its own
    z_x, _, z_xx, _, _ = made.derivatives(x, np.zeros_like(x))
    asked = 0.0008 + slope * (115.0 - x)
    late = -z_xx / (1.0 + z_x**2) ** 1.5 / asked - 1.0 + step * slope / asked
    return [Figure("κ, less the delay −h·κ′", 100.0 * float(np.abs(late).max()), 0.5, "%",
                   "what is left is of the next order in h, or h·κ·tan θ"),
            verdict_figure(made, False)]


def with_outline(case: Case, points: Array) -> Case:
    """The case in a folder that holds outline.dxf with the closed polyline through points (n, 2), written by ezdxf."""

    def run(folder: Path) -> Sequence[Figure]:
        import ezdxf

        document = ezdxf.new("R2010", units=4)
        document.modelspace().add_lwpolyline([(float(x), float(y)) for x, y in points], close=True)
        document.saveas(folder / "outline.dxf")
        return case.run(folder)

    return Case(case.name, case.hard, run, case.refusal)


# --- the cases ----------------------------------------------------------------------------------------------------------

FLAT = math.inf


def _constant(radius_mm: float) -> Spec:
    return {"law": "constant", "radius_mm": radius_mm}


def _curvature(formula: str) -> Spec:
    return {"law": "expression", "curvature": formula}


def _linear(right_mm: float, left_mm: float) -> Spec:
    return {"law": "linear", "right_mm": right_mm, "left_mm": left_mm}


def _zones(right_mm: float, left_mm: float, start: float, end: float) -> Spec:
    return {"law": "zones", "right_mm": right_mm, "left_mm": left_mm, "blend_from": start, "blend_to": end}


def _spec(horizontal: Spec, vertical: Spec, **sections: Spec) -> Spec:
    return {"horizontal": horizontal, "vertical": vertical, **sections}


def _rectangle(width_mm: float, height_mm: float, corner_mm: float = 0.0) -> dict[str, Spec]:
    return {"outline": {"width_mm": width_mm, "left_height_mm": height_mm, "right_height_mm": height_mm,
                        "corner_radius_mm": corner_mm},
            "blank": {"width_mm": 1.1 * width_mm, "height_mm": 1.1 * height_mm}}


def _scaled(width_mm: float) -> dict[str, Spec]:
    """The standard truck mirror at another size, margin and all."""
    k = width_mm / 230.0
    return {"outline": {"width_mm": width_mm, "left_height_mm": 270.0 * k, "right_height_mm": 340.0 * k,
                        "corner_radius_mm": 40.0 * k},
            "blank": {"width_mm": 250.0 * k, "height_mm": 380.0 * k}, "export": {"surface_margin_mm": 15.0 * k}}


def _t(x: Array) -> Array:
    return (115.0 - x) / 230.0


def _smooth(t: Array, start: float, end: float) -> Array:
    u = np.clip((t - start) / (end - start), 0.0, 1.0)
    return u * u * (3.0 - 2.0 * u)


def _zones_law(x: Array) -> Array:
    return 1.0 / (1250.0 - 850.0 * _smooth(_t(x), 0.5, 1.0))


ZONES, ZONES_LAW, ZONES_BREAKS = _zones(1250.0, 400.0, 0.5, 1.0), _zones_law, (0.0,)


def _table(x: Array, radius: Array) -> tuple[Spec, CubicSpline]:
    """A table law and the spline that it is defined as."""
    return {"law": "table", "x_mm": x.tolist(), "radius_mm": radius.tolist()}, CubicSpline(x, 1.0 / radius)


def _noisy(share: float) -> tuple[Spec, CubicSpline]:
    x = np.arange(-115.0, 116.0)
    return _table(x, (1000.0 + x) * (1.0 + share * np.random.default_rng(7).standard_normal(x.size)))


def _polygon(count: int) -> Array:
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.stack([110.0 * np.cos(angle), 150.0 * np.sin(angle)], axis=1)


STAR = np.array([(0.0, 150.0), (30.0, 40.0), (110.0, 30.0), (45.0, -30.0), (80.0, -140.0), (0.0, -70.0), (-80.0, -140.0),
                 (-45.0, -30.0), (-110.0, 30.0), (-30.0, 40.0)])
SQUARE = np.array([(-80.0, -80.0), (80.0, -80.0), (80.0, 80.0), (-80.0, 80.0)])
SPIKE = np.array([(-80.0, -80.0), (80.0, -80.0), (80.0, 0.0), (80.0005, 0.0005), (80.0, 80.0), (-80.0, 80.0)])


def _made(name: str, hard: str, horizontal: Spec, vertical: Spec, across: Law | None = None, upright: Law | None = None,
          sections: dict[str, Spec] | None = None, **options: Any) -> Case:
    """A case that has to come out; the laws of constant radii are read off the specification."""
    across = 1.0 / horizontal["radius_mm"] if across is None else across
    upright = 1.0 / vertical["radius_mm"] if upright is None else upright
    return Case(name, hard, partial(decoupled, raw=_spec(horizontal, vertical, **(sections or {})), across=across,
                                    upright=upright, **options))


def _refused(name: str, hard: str, horizontal: Spec, vertical: Spec, kind: type[MirrorError], *words: str,
             sections: dict[str, Spec] | None = None) -> Case:
    def run(folder: Path) -> Sequence[Figure]:
        make(folder, _spec(horizontal, vertical, **(sections or {})))
        return ()

    return Case(name, hard, run, Refusal(kind, words))


@cache
def cases() -> dict[str, Case]:
    """Every case by its name."""
    found = [*_flat_and_signs(), *_laws(), *_tables(), *_steep(), *_sizes(), *_places_and_outlines(), *_plates(),
             *_numerics(), *_faithful(), *_impossible()]
    return {case.name: case for case in found}


def case_named(name: str) -> Case:
    return cases()[name]


def _flat_and_signs() -> list[Case]:
    c = _constant
    return [
        _made("plane", "no curvature: no percent, no radius", c(FLAT), c(FLAT), traced=True),
        _made("nearly plane", "radii of 1e9 mm, of either sign: sags of 1e-5 mm", c(1e9), c(-1e9)),
        _made("curvature 1e-300", "squares and percent underflow", _curvature("1e-300"), _curvature("-1e-300"), 1e-300,
              -1e-300),
        _made("radius 1e300", "1/R² underflows", c(1e300), c(1250.0)),
        _made("concave", "both radii negative", c(-2000.0), c(-1500.0), traced=True),
        _made("concave zones", "a progressive law of negative radii", _zones(-1250.0, -400.0, 0.5, 1.0), c(-1250.0),
              lambda x: -_zones_law(x), breaks=ZONES_BREAKS),
        _made("saddle", "convex across, concave upright", c(1250.0), c(-1500.0), traced=True),
        _made("sign-changing law", "curvature through 0, where percent of it have no meaning", _curvature("0.001*sin(x/40)"),
              c(1250.0), lambda x: 0.001 * np.sin(x / 40.0), traced=True),
        _made("sign-changing both ways", "flat in all directions along one line", _curvature("x*1e-5"), _curvature("x*2e-5"),
              lambda x: 1e-5 * x, lambda x: 2e-5 * x),
        _made("cylinder, upright straight", "one principal curvature 0 everywhere", c(1250.0), c(FLAT), traced=True),
        _made("cylinder, straight across", "one principal curvature 0 everywhere", c(FLAT), c(1250.0), traced=True),
        _made("progressive, upright straight", "straight rulings under a changing radius", ZONES, c(FLAT), ZONES_LAW,
              breaks=ZONES_BREAKS),
        _made("umbilic line inside", "Rx crosses Ry: the principal directions swap", _linear(1250.0, 600.0), c(900.0),
              lambda x: 1.0 / (1250.0 - 650.0 * _t(x)), traced=True),
        _made("umbilic everywhere", "equal radii: no principal directions", c(950.0), c(950.0), traced=True),
    ]


def _laws() -> list[Case]:
    c = _constant

    def step(width: float) -> Callable[[Array], Array]:
        return lambda x: 0.0008 + 0.0008 * np.clip((x - 10.0) / width, 0.0, 1.0)

    return [
        _made("jump, not announced", "κ doubles within 1e-6 mm inside a formula",
              _curvature("0.0008 + 0.0008*max(0, min(1, (x - 10)*1e6))"), c(1250.0), step(1e-6), breaks=(10.0, 10.000001)),
        _made("jump, by zones", "κ triples within 2e-5 mm", _zones(1250.0, 400.0, 0.5, 0.5 + 1e-7), c(1250.0),
              lambda x: 1.0 / (1250.0 - 850.0 * _smooth(_t(x), 0.5, 0.5 + 1e-7)), breaks=(0.0, -2.3e-5)),
        _made("kink, not announced", "κ′ jumps inside a formula", _curvature("0.0008 + max(0, 0.00001*(x - 10))"), c(1250.0),
              lambda x: 0.0008 + np.maximum(0.0, 1e-5 * (x - 10.0)), breaks=(10.0,)),
        _made("transition 0.1 mm wide", "κ triples within 0.1 mm", _zones(1250.0, 400.0, 0.5, 0.5 + 0.1 / 230.0), c(1250.0),
              lambda x: 1.0 / (1250.0 - 850.0 * _smooth(_t(x), 0.5, 0.5 + 0.1 / 230.0)), breaks=(0.0, -0.1), traced=True),
        _made("tanh 0.1 mm wide", "the same without an end: no break to put a knot at",
              _curvature("0.0012 + 0.0004*tanh((x - 20)/0.05)"), c(1250.0),
              lambda x: 0.0012 + 0.0004 * np.tanh((x - 20.0) / 0.05), breaks=(20.0,)),
        _made("kink upright", "Ry's kink is a crease in the surface", c(1250.0), _zones(1250.0, 900.0, 0.3, 0.7),
              upright=lambda x: 1.0 / (1250.0 - 350.0 * _smooth(_t(x), 0.3, 0.7)), breaks=(46.0, -46.0)),
        _refused("jump upright", "where Ry jumps the circles do not meet: a step of millimetres", c(1250.0),
                 _zones(1250.0, 900.0, 0.5, 0.5 + 1e-7), MirrorError, "vertical"),
        _made("power law, exponent 0.02", "R falls by half within 1e-13 mm of the edge",
              {"law": "power", "right_mm": 1250.0, "left_mm": 800.0, "exponent": 0.02}, c(1250.0),
              lambda x: 1.0 / (1250.0 - 450.0 * np.clip(_t(x), 0.0, 1.0) ** 0.02), percent=0.1,
              reason="no span resolves the last 0.1 mm: the report has to say so", met=False),
        _made("power law, exponent 50", "all change in the last millimetres",
              {"law": "power", "right_mm": 1250.0, "left_mm": 400.0, "exponent": 50.0}, c(1250.0),
              lambda x: 1.0 / (1250.0 - 850.0 * _t(x) ** 50)),
        _made("law's span inside the mirror", "kinks at ±40 mm, where the law is held from",
              _linear(1250.0, 600.0) | {"span_mm": [-40.0, 40.0]}, c(1250.0),
              lambda x: 1.0 / (1250.0 - 650.0 * np.clip((40.0 - x) / 80.0, 0.0, 1.0)), breaks=(-40.0, 40.0)),
        _made("law's span beside the mirror", "the law is held at one value all over it",
              _linear(1250.0, 600.0) | {"span_mm": [200.0, 300.0]}, c(1250.0), 1.0 / 600.0),
        _made("law's span 20 m wide", "the mirror sees a hundredth of the law",
              _linear(1250.0, 600.0) | {"span_mm": [-10_000.0, 10_000.0]}, c(1250.0),
              lambda x: 1.0 / (1250.0 - 650.0 * (1e4 - x) / 2e4)),
        _made("level at the edge", "slopes of one sign only, to 12°", c(1250.0) | {"level_at": "right"}, c(1250.0),
              level_mm=115.0, traced=True),
        _made("level outside the mirror", "nowhere level", c(1250.0) | {"level_at": -125.0}, c(1250.0), level_mm=-125.0),
        _made("waves of 20 mm", "κ between 0 and 0.002, 12 times", _curvature("0.001*(1 + sin(x/3))"), c(1250.0),
              lambda x: 0.001 * (1.0 + np.sin(x / 3.0))),
        _made("waves of 0.5 mm", "460 waves, more than spans are allowed: the sag can hold, the curvature cannot",
              _curvature("0.001*(1 + 0.5*sin(4*pi*x))"), c(1250.0), lambda x: 0.001 * (1.0 + 0.5 * np.sin(4.0 * np.pi * x)),
              percent=150.0, position_mm=1e-4, met=False,
              reason="the waves are ±100 % of κ where it is lowest; the report has to say missed"),
        _made("hole in a formula", "0/0 at one place", _curvature("0.001*(x - 20)/(x - 20)"), c(1250.0), 0.001),
        _made("vertical radius falling from 1250 to 200 mm", "beside the mirror the circles would be lower than it", c(1250.0),
              _linear(1250.0, 200.0), upright=lambda x: 1.0 / (1250.0 - 1050.0 * _t(x)), breaks=(-115.0,)),
    ]


def _tables() -> list[Case]:
    c = _constant
    x = np.arange(-115.0, 116.0)
    one, one_law = _noisy(0.01)
    small, small_law = _noisy(1e-4)
    digits, digits_law = _table(x, np.array([float(f"{1000.0 + 200.0 * math.sin(at / 50.0):.6g}") for at in x]))
    two, two_law = {"law": "table", "x_mm": [-115.0, 115.0], "radius_mm": [400.0, 1250.0]}, \
        lambda x: 1.0 / 1250.0 + (1.0 / 400.0 - 1.0 / 1250.0) * _t(x)
    fine = np.linspace(-115.0, 115.0, 100_000)
    many, _ = _table(fine, 1000.0 + 200.0 * np.sin(fine / 50.0))
    far = {"law": "table", "x_mm": [20_000.0, 20_100.0], "radius_mm": [800.0, 1250.0]}
    near = {"law": "table", "x_mm": [-115.0, 0.0, 1e-7, 115.0], "radius_mm": [1000.0, 1000.0, 1001.0, 1001.0]}
    return [
        _made("table with 1 % noise", "231 rows, each 1 % off at random", one, c(1250.0), one_law, traced=True),
        _made("table with 0.01 % noise", "231 rows, each 0.01 % off at random", small, c(1250.0), small_law),
        _made("vertical table with 0.01 % noise", "Ry's second derivative counts y²/2 times: each row is a crease", c(1250.0),
              small, upright=small_law, breaks=tuple(x)),
        _made("table to six digits", "231 rows, radii rounded", digits, c(1250.0), digits_law),
        _made("table of two rows", "a law linear in κ", two, c(1250.0), two_law),
        _made("table of 100,000 rows", "a row every 2 µm", many, c(1250.0),
              lambda x: 1.0 / (1000.0 + 200.0 * np.sin(x / 50.0))),
        _made("table 20 m away", "held at its first value over the whole mirror", far, c(1250.0), 1.0 / 800.0),
        _refused("table with rows 1e-7 mm apart", "the spline swings by its slope, 1e7 times the step", near, c(1250.0),
                 MirrorError, "table"),
    ]


def _steep() -> list[Case]:
    c = _constant
    radius = 115.0 / math.sin(math.radians(80.0))
    past_80: dict[str, Any] = {"percent": 50.0, "position_mm": 0.05, "met": False,
                               "reason": "what 400 spans come to past 80°; the report has to call it missed"}
    return [
        _made("slope to 80°", "at the left and right edge", c(radius), c(1250.0)),
        _made("slope to 80° upright", "at the upper and lower edge", c(1250.0), c(170.0 / math.sin(math.radians(80.0))),
              sections=_rectangle(230.0, 340.0)),
        _made("slope to 89°", "at the left and right edge, where z″ is 190,000 times κ",
              c(115.0 / math.sin(math.radians(89.0))), c(1250.0), **past_80),
        _made("slope to 80° at a corner of two 70°", "both ways at once", c(115.0 / math.sin(math.radians(70.0))),
              c(170.0 / math.sin(math.radians(70.0))), sections=_rectangle(230.0, 340.0)),
        _made("concave slope to 80°", "the edge leans over what it reflects", c(-radius), c(-1250.0)),
        _made("concave, vertical radius just above the half-height", "−171 mm over 170", c(-1250.0), c(-171.0),
              sections=_rectangle(230.0, 340.0)),
        _refused("slope past vertical", "∫κ dx reaches 1 at 105 mm of 115", c(105.0), c(1250.0), ProfileError,
                 "turns vertical at x = ", "-115.0 mm"),
        _refused("slope vertical at the edge", "∫κ dx = 1 exactly there", c(115.0), c(1250.0), ProfileError, "vertical"),
        _made("vertical radius just above the half-height", "171 mm over 170: 84°", c(1250.0), c(171.0),
              sections=_rectangle(230.0, 340.0)),
        _made("vertical radius 0.03 mm above the half-height", "88.9° at the upper edge", c(1250.0), c(170.03),
              sections=_rectangle(230.0, 340.0), **past_80),
        _refused("vertical radius just below the half-height", "its circle ends before the edge", c(1250.0), c(169.9),
                 ProfileError, "169.9", "half-height 170", sections=_rectangle(230.0, 340.0)),
    ]


def _sizes() -> list[Case]:
    c = _constant
    return [
        _made("20 mm wide, radii scaled", "everything at 1:11.5", c(1250.0 * 20 / 230), c(900.0 * 20 / 230),
              sections=_scaled(20.0), traced=True),
        _made("20 mm wide, radii as they are", "sags of micrometres", c(1250.0), c(900.0), sections=_scaled(20.0)),
        _made("3 m wide, radii scaled", "everything at 13:1", c(1250.0 * 3000 / 230), c(900.0 * 3000 / 230),
              sections=_scaled(3000.0), traced=True),
        _refused("3 m wide, radii as they are", "the profile turns vertical inside", c(1250.0), c(4000.0), ProfileError,
                 "turns vertical at x = ", sections=_scaled(3000.0)),
        _made("1.5 mm wide", "next to the smallest outline", c(1250.0), c(900.0), sections=_scaled(1.5)),
        _refused("0.5 mm wide", "below the smallest outline", c(1250.0), c(900.0), OutlineError, "0.5 mm wide",
                 sections=_scaled(0.5)),
        _made("strip of 230 × 3 mm", "76 times as wide as high", c(1250.0), c(900.0), sections=_rectangle(230.0, 3.0, 1.0)),
        _made("strip of 3 × 340 mm", "113 times as high as wide", c(1250.0), c(900.0), sections=_rectangle(3.0, 340.0, 1.0)),
        _made("30 m wide, sags of a metre", "coordinates of 15,000 mm, still to 1e-5", c(1e5), c(1e5),
              sections=_rectangle(30_000.0, 30_000.0, 100.0) | {"export": {"stl_deflection_mm": 1.0}}),
        _refused("90 m wide, STL within 0.01 mm", "STL's 24 bits end at 0.006 mm there", c(FLAT), c(FLAT), MirrorError,
                 "deflection of 0.01 mm", "STL rounds", sections=_rectangle(90_000.0, 90_000.0, 100.0)),
        _made("blank of 2 m around a small mirror", "the sheet is eight times as wide as what is judged", c(1250.0), c(1250.0),
              sections={"blank": {"width_mm": 2000.0, "height_mm": 2000.0}}),
        _made("margin of 1 m", "the sheet has to stop where it is steeper than 80°", c(400.0), c(400.0),
              sections={"export": {"surface_margin_mm": 1000.0}}),
        _made("margin 0", "rays at the very end of the sheet", c(1250.0), c(900.0), traced=True, sections=_rectangle(
            230.0, 340.0) | {"blank": {"width_mm": 230.0, "height_mm": 340.0}, "export": {"surface_margin_mm": 0.0}}),
    ]


def _places_and_outlines() -> list[Case]:
    c = _constant
    file = {"outline": {"file": "outline.dxf"}}

    def drawn(name: str, hard: str, points: Array, **options: Any) -> Case:
        return with_outline(_made(name, hard, c(1250.0), c(900.0), sections=file, **options), points)

    away = np.array([20_000.0, 800.0])
    return [
        Case("origin 20 m away", "vehicle coordinates: moved by build123d to (20000, 800, −1000) mm and turned", far_away),
        with_outline(_refused("outline file 20 m away", "an outline is in mirror coordinates", c(1250.0), c(900.0),
                              OutlineError, "beyond the blank", "20080.0", sections=file), SQUARE + away),
        Case("a million places", "time and memory of evaluation", million_places),
        _made("outline touches the blank", "no glass left beside the outline", c(1250.0), c(900.0), sections={
            "blank": {"width_mm": 230.0, "height_mm": 340.0}}),
        _made("corners of 0.1 mm", "arcs a thousandth of the sides", c(1250.0), c(900.0),
              sections={"outline": {"corner_radius_mm": 0.1}}),
        _made("sharp corners", "no arcs", c(1250.0), c(900.0), sections={"outline": {"corner_radius_mm": 0.0}}),
        _made("corner arcs that meet", "sides of no length", c(1250.0), c(900.0), sections=_rectangle(230.0, 230.0, 115.0)),
        drawn("outline of 1,000 vertices", "a plate of 1,002 faces", _polygon(1000)),
        drawn("star", "an outline that is not convex", STAR),
        drawn("an edge of 0.7 µm", "shorter than the gaps that are closed: its ends become one", SPIKE, level_mm=0.000125),
        with_outline(_refused("outline that crosses itself", "a bow tie", c(1250.0), c(900.0), OutlineError,
                              "crosses or touches itself", "(0, 0) mm", sections=file), SQUARE[[0, 2, 1, 3]]),
        drawn("origin 1 mm inside the edge", "the mirror hangs to one side", np.array(
            [(-1.0, -80.0), (120.0, -80.0), (120.0, 80.0), (-1.0, 80.0)]), level_mm=59.5),
    ]


def _plates() -> list[Case]:
    c, zones = _constant, (ZONES, _constant(1250.0))

    def glass(t: float) -> dict[str, Spec]:
        return {"glass": {"thickness_mm": t}}

    return [
        _made("plate of 0.05 mm", "front and back 50 µm apart", *zones, ZONES_LAW, breaks=ZONES_BREAKS, sections=glass(0.05),
              shown=THICKNESS),
        _made("plate of 60 mm", "a seventh of the smallest radius", *zones, ZONES_LAW, breaks=ZONES_BREAKS,
              sections=glass(60.0), shown=THICKNESS),
        _made("plate of 1 m", "four fifths of the radius: the back is a fifth as wide", c(1250.0), c(1250.0),
              sections=glass(1000.0), shown=THICKNESS),
        _refused("plate of 1 nm", "front and back are one to any reader", *zones, SolidError, "glass.thickness_mm = 1e-06",
                 sections=glass(1e-6)),
        _made("concave plate of 60 mm", "the back is larger than the front", c(-400.0), c(-500.0), sections=glass(60.0),
              shown=THICKNESS),
        _refused("thicker than the smallest convex radius", "the back would fold", *zones, SolidError,
                 "glass.thickness_mm = 450", "smallest convex radius", "400", sections=glass(450.0)),
        _refused("thicker than the smallest concave radius", "a plate deeper than its own radius", c(-400.0), c(-500.0),
                 SolidError, "glass.thickness_mm = 450", "concave radius", sections=glass(450.0)),
    ]


def _numerics() -> list[Case]:
    c = _constant
    kernel: dict[str, Any] = {"percent": 0.2, "position_mm": 1e-4, "met": False, "breaks": ZONES_BREAKS,
                              "reason": "no knot stands where the law breaks; the report has to call it missed"}
    return [
        _made("degree 9, one span", "ten coefficients a direction are all there is", c(1250.0), c(1250.0),
              sections={"surface": {"degree": 9, "spans": [1, 1]}}),
        _made("degree 3, one span", "a cubic cannot be a circle to 1e-5 mm, and the report has to say so", c(1250.0), c(1250.0),
              sections={"surface": {"degree": 3, "spans": [1, 1]}}, percent=10.0, position_mm=0.05,
              reason="the quartic term of a circle, x⁴/8R³, over a span of 250 mm", met=False),
        _made("200 × 60 spans", "12,000 patches, each rounding", c(1250.0), c(900.0),
              sections={"surface": {"degree": 5, "spans": [200, 60]}}),
        _made("tolerances at their lowest", "1e-9 mm and 1e-6 %: below the rounding of curvature", c(1250.0), c(900.0),
              sections={"surface": {"position_tolerance_mm": 1e-9, "curvature_tolerance_percent": 1e-6}}, percent=1e-6,
              position_mm=1e-9),
        _made("tolerances at their highest", "1 mm and 100 %: almost any surface is good enough", ZONES, c(1250.0), ZONES_LAW,
              breaks=ZONES_BREAKS, sections={"surface": {"position_tolerance_mm": 1.0, "curvature_tolerance_percent": 100.0}},
              percent=100.0, position_mm=1.0),
        _made("the kernel's interpolation", "it takes no word on errors, and has failed with every node hit", ZONES, c(1250.0),
              ZONES_LAW, sections={"surface": {"fit": "occt-interpolate"}}, **kernel),
        _made("the kernel's approximation", "a tolerance for points, none for curvature", ZONES, c(1250.0), ZONES_LAW,
              sections={"surface": {"fit": "occt-approximate"}}, **kernel),
        Case("Euler, h = 10 mm", "26 steps of first order across the mirror", euler),
        _made("Euler, h = 0.001 mm", "260,000 steps, each a rounding of z that z″ divides by h²", c(1250.0), c(900.0),
              sections={"surface": {"integration": "euler", "step_mm": 0.001}}, position_mm=1e-4,
              reason="first order: h·θ/2 over half the width; the report has to call it missed", met=False),
        _made("STL within 1 µm", "a hundred thousand facets", c(1250.0), c(900.0),
              sections={"export": {"stl_deflection_mm": 0.001}}, shown="STL facets"),
        _made("STL within 10 mm", "the deflection is as large as the sag", c(1250.0), c(900.0),
              sections={"export": {"stl_deflection_mm": 10.0}}, shown="STL facets"),
    ]


def _faithful() -> list[Case]:
    c = _constant
    surface = {"surface": {"method": "faithful"}}

    def ball(name: str, hard: str, radius: float, sections: dict[str, Spec] | None = None) -> Case:
        raw = _spec(c(radius), c(radius), **surface, **(sections or {}))
        return Case(f"faithful: {name}", hard, partial(faithful_exact, raw=raw, sheet=Sphere(radius)))

    def other(name: str, hard: str, law: Spec, across: Law, sections: dict[str, Spec] | None = None,
              **options: Any) -> Case:
        return Case(f"faithful: {name}", hard, partial(faithful, raw=_spec(law, c(1250.0), **surface, **(sections or {})),
                                                       across=across, upright=1.0 / 1250.0, **options))

    return [
        ball("sphere", "umbilic everywhere, and a closed form to be found by least squares", 950.0),
        ball("plane", "nothing to weigh by", FLAT),
        ball("concave sphere", "negative radii", -2000.0),
        ball("sphere 20 mm wide", "sags of micrometres", 1250.0, _scaled(20.0)),
        ball("sphere 3 m wide", "sags of decimetres", 1250.0 * 3000 / 230, _scaled(3000.0)),
        Case("faithful: cylinder", "one law flat", partial(faithful_exact, raw=_spec(c(1250.0), c(FLAT), **surface),
                                                           sheet=Decoupled(1.0 / 1250.0, 0.0, 0.0, (), -115.0, 115.0))),
        other("progressive", "the paper's mirror", ZONES, ZONES_LAW, breaks=ZONES_BREAKS),
        other("sign-changing law", "curvature through 0", _curvature("0.001*sin(x/40)"), lambda x: 0.001 * np.sin(x / 40.0)),
        other("jump in the law", "no smooth surface has it", _curvature("0.0008 + 0.0008*max(0, min(1, (x - 10)*1e6))"),
              lambda x: 0.0008 + 0.0008 * np.clip((x - 10.0) * 1e6, 0.0, 1.0), breaks=(10.0,)),
    ]


def _impossible() -> list[Case]:
    c = _constant
    return [
        _refused("formula with a pole", "κ → ∞ at 20 mm", _curvature("0.001/(x - 20)"), c(1250.0), SpecError, "per mm at x = 2",
                 "radius below 1 mm"),
        _refused("formula that overflows", "exp(1000·x)", _curvature("exp(1000*x)"), c(1250.0), SpecError,
                 "exp(1000*x)", "not finite at x ="),
        _refused("root of the negative", "half the mirror has no law", _curvature("0.001*sqrt(x)"), c(1250.0), SpecError,
                 "not finite", "x ="),
        _refused("power of powers", "9**9**9 is no float", _curvature("9**9**9"), c(1250.0), SpecError, "9**9**9"),
        _refused("law rougher than numbers", "a wave every 6e-6 mm", _curvature("0.001*(1 + sin(1e6*x))"), c(1250.0),
                 MirrorError, "rough", "x ="),
        _refused("radius of 0.5 mm", "no mirror", c(0.5), c(1250.0), SpecError, "2 per mm", "radius below 1 mm"),
        _refused("radius 0", "no curvature at all", c(0.0), c(1250.0), SpecError, "horizontal.radius_mm = 0"),
        _refused("radius NaN", "not a number", c(math.nan), c(1250.0), SpecError, "horizontal.radius_mm = nan"),
        _refused("table with a NaN", "not a number in row 2",
                 {"law": "table", "x_mm": [0.0, 5.0], "curvature_per_mm": [0.001, math.nan]}, c(1250.0), SpecError,
                 "horizontal.curvature_per_mm"),
        _refused("table that turns back", "two rows at one place",
                 {"law": "table", "x_mm": [0.0, 5.0, 5.0], "radius_mm": [900.0, 900.0, 800.0]}, c(1250.0), SpecError,
                 "must rise", "row 3"),
        _refused("radius through infinity", "linear from 900 to −900 mm passes 0", _linear(900.0, -900.0), c(1250.0), SpecError,
                 "opposite signs"),
        _refused("match out of reach", "no exponent gives 120°",
                 {"law": "power", "right_mm": 1250.0, "left_mm": 400.0, "exponent": "match", "match": {"h_fov_deg": 120.0}},
                 c(1250.0), SpecError, "120.00°", "reaches"),
        _refused("level outside the blank", "125 mm is its half-width", c(1250.0) | {"level_at": 126.0}, c(1250.0), SpecError,
                 "horizontal.level_at = 126", "125"),
        _refused("wider than the blank", "260 of 250 mm", c(1250.0), c(1250.0), SpecError, "outline.width_mm = 260", "250",
                 sections={"outline": {"width_mm": 260.0}}),
        _refused("corner radius that does not fit", "150 mm on sides of 230", c(1250.0), c(1250.0), OutlineError,
                 "corner_radius_mm 150", "largest radius that fits", sections={"outline": {"corner_radius_mm": 150.0}}),
        _refused("march of millions of steps", "0.001 mm over 3 m", c(16_000.0), c(16_000.0), ProfileError, "step_mm",
                 "steps", sections=_scaled(3000.0) | {"surface": {"integration": "rk4", "step_mm": 0.001}}),
        _refused("march of three steps", "100 mm over 260", c(1250.0), c(1250.0), ProfileError, "step_mm = 100", "3 steps",
                 sections={"surface": {"integration": "euler", "step_mm": 100.0}}),
    ]


# --- running ------------------------------------------------------------------------------------------------------------


def judge(case: Case) -> Row:
    """Run a case here and now; the table's row with its verdict."""
    row = _empty_row(case)
    start = time.process_time()
    try:
        with tempfile.TemporaryDirectory(prefix="hard-case-") as folder:
            figures = case.run(Path(folder))
    except MirrorError as error:
        message = " ".join(str(error).replace(f"{folder}/", "").split())
        row |= {"verdict": _refusal_verdict(case.refusal, error), "remark": message}
    except Exception as error:  # whatever it is, it is this case's result and not the table's end
        row |= {"verdict": INTERNAL, "remark": f"{type(error).__name__}: {error}"}
    else:
        row |= _figures_row(case, figures)
    return row | {"seconds": time.process_time() - start}


def _refusal_verdict(expected: Refusal | None, error: MirrorError) -> str:
    if expected is None or not isinstance(error, expected.kind):
        return WRONGLY_REFUSED
    return REFUSED if all(word in str(error) for word in expected.words) else CAUSE_NOT_NAMED


def _figures_row(case: Case, figures: Sequence[Figure]) -> Row:
    if case.refusal is not None:
        return {"verdict": NOT_REFUSED, "remark": f"expected a {case.refusal.kind.__name__}: {case.hard}"}
    lost = [figure for figure in figures if not math.isfinite(figure.value)]
    worst = max(figures, key=lambda figure: figure.share)
    verdict = NOT_A_NUMBER if lost else WITHIN if worst.share <= 1.0 else OUTSIDE
    shown = lost[0] if lost else figures[0] if verdict == WITHIN else worst
    return {"what": shown.what, "figure": None if lost else shown.value, "tolerance": shown.tolerance, "unit": shown.unit,
            "verdict": verdict, "remark": shown.reason}


@dataclass(frozen=True, slots=True)
class Work:
    """What workers are to do: module functions, so that another process can import them, and a case's limit.

    find : the case of a name.   warm_up : what no case's time is to hold.
    """

    find: Callable[[str], Case]
    warm_up: Callable[[], None]
    limit_s: float


def _serve(connection: Connection, work: Work, folder: str) -> None:
    """A worker's whole life: warm up, say so, then a row for each name that comes. A timer's signal ends it at the limit.

    folder : for the cases' files, and for the call stack if the process dies; the caller clears it away.
    """
    tempfile.tempdir = folder
    stack = open(Path(folder) / STACK, "w")  # noqa: SIM115  (as long as the process lives)
    faulthandler.enable(stack)
    faulthandler.register(signal.SIGPROF, stack, all_threads=False, chain=True)
    work.warm_up()
    connection.send(None)
    while True:
        try:
            name = connection.recv()
        except EOFError:
            return
        signal.setitimer(signal.ITIMER_PROF, work.limit_s)  # its signal ends the process even inside the kernel's code
        row = judge(work.find(name))
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        connection.send(row)


def warm_up() -> None:
    """Load the kernel and compile what numba compiles: one kernel for each degree, and the one for any surface."""
    from raytrace import Reflector, reflect

    with tempfile.TemporaryDirectory(prefix="hard-case-") as folder:
        made = make(Path(folder), _spec(_constant(1250.0), _constant(900.0), **_scaled(20.0)))
        ray_figures(made.step, made.mirror, Sphere(1250.0), *places(made.mirror))
    for degree in (7, 9):
        raw = _spec(_constant(1250.0), _constant(900.0), surface={"degree": degree, "spans": [2, 2]})
        reflector = Reflector.from_mirror(design(validate_spec({"name": "warm-up"} | raw)))
        reflect(reflector, [0.0, 0.0, 700.0], [[0.0, 0.0, -1.0], [0.1, 0.0, -0.01]])


class _Worker:
    """A process that judges one case after the other, and is replaced where one kills it or takes too long."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._folder = tempfile.TemporaryDirectory(prefix="hard-cases-")
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._work, self._folder.name), daemon=True)
        self._process.start()
        theirs.close()
        if not self._connection.poll(WARM_UP_S):
            self.stop()
            raise RuntimeError(f"a worker did not start within {WARM_UP_S:g} s")
        self._connection.recv()

    def judge(self, name: str) -> Row:
        """The case's row; of a case that ended the process, what ended it."""
        self._connection.send(name)
        try:
            if self._connection.poll(LONGEST_WAIT * self._work.limit_s):
                row: Row = self._connection.recv()
                return row
        except (EOFError, ConnectionResetError):
            self._process.join()
        code = self._process.exitcode
        self._end()
        stack = (Path(self._folder.name) / STACK).read_text()
        self._start()
        where = re.search(rf"/((?:{'|'.join(PACKAGES)})/.*)\", line (\d+) in (\w+)", stack)
        within = f", in {where[1]}:{where[2]} ({where[3]})" if where else ""
        if code is None or code == -signal.SIGPROF:
            limit = self._work.limit_s
            end = {"verdict": HANGS, "remark": f"over {limit:g} s{within}", "seconds": limit}
        else:
            by = signal.Signals(-code).name if code < 0 else f"exit code {code}"
            end = {"verdict": CRASHED, "remark": by + within, "seconds": None}
        return _empty_row(self._work.find(name)) | end

    def _end(self) -> None:
        self._process.kill()
        self._process.join()
        self._connection.close()

    def stop(self) -> None:
        self._end()
        self._folder.cleanup()


def _empty_row(case: Case) -> Row:
    return {"case": case.name, "hard": case.hard, "what": None, "figure": None, "tolerance": None, "unit": None}


THE_CASES = Work(case_named, warm_up, LIMIT_S)


def run_cases(names: Sequence[str], work: Work = THE_CASES, progress: Progress | None = None) -> list[Row]:
    """The cases' rows in their order, AT_ONCE at a time, each in a process that it can take down without harm."""
    workers: SimpleQueue[_Worker] = SimpleQueue()

    def judged(name: str) -> Row:
        worker = workers.get()
        try:
            row = worker.judge(name)
        finally:
            workers.put(worker)
        if progress is not None:
            progress.step(f"hard cases: {name}: {row['verdict']}")
        return row

    with ThreadPoolExecutor(AT_ONCE) as pool:
        try:
            for worker in pool.map(_Worker, [work] * min(AT_ONCE, len(names))):
                workers.put(worker)
            return list(pool.map(judged, names))
        finally:
            while not workers.empty():
                workers.get().stop()


def tables(progress: Progress | None) -> tuple[Table, ...]:
    """The one table of all cases."""
    return (table_of(run_cases(list(cases()), progress=progress)),)


def table_of(rows: Sequence[Row]) -> Table:
    """Rows as the table shows them, their verdicts counted in its text."""
    verdicts = [row["verdict"] for row in rows]
    bad = [f"{verdicts.count(verdict)} {verdict}" for verdict in BAD if verdict in verdicts]
    text = (f"{len(rows)} mirrors that are hard for one reason each, through the whole chain from the specification to the "
            f"files read back: {verdicts.count(WITHIN)} within their tolerances, {verdicts.count(REFUSED)} refused with the "
            f"cause named, as they have to be, {', '.join(bad) if bad else 'none otherwise'}. Of the figures of a case the one "
            "it is about is shown, or one that fails; they are measured against closed forms and scipy, not against the "
            f"program. Times are processor time without the kernel's import; a case may take {LIMIT_S:g} s.")
    columns = (Column("case", "case"), Column("hard", "what is hard"), Column("verdict", "verdict"), Column("what", "figure"),
               Column("figure", "reached"), Column("tolerance", "allowed"), Column("unit", "unit"),
               Column("remark", "the tolerance's reason, or the message"), Column("seconds", "time, s", 2))
    return Table("hard-cases", "Hard cases", text, columns, tuple(rows))
