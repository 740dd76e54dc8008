"""A wanted view in, the height field whose reflected rays come closest to it out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from mirror_cad.errors import SurfaceError
from mirror_cad.outline import Outline
from mirror_cad.surfaces.basis import dense_basis, greville_abscissae
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import graph, knot_vector
from mirror_cad.surfaces.faithful import MAX_POLES, spans_with_margin
from mirror_cad.surfaces.quadrature import gauss_grid
from mirror_cad.wanted_view import WantedView, WeightMap, on_plane

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

ARCMIN = np.degrees(1.0) * 60.0
DEGREE = 5
LEVELS = ((8, 6), (12, 8), (18, 12))  # spans over the mirror's box, until more of them gain nothing
# More spans gain nothing when the RMS falls by less than this, arc minutes: a fiftieth of what an eye resolves.
GAIN_ARCMIN = 0.02
# An RMS below this is a view that a surface can show: then more spans are taken as long as it falls by more than a tenth.
HELD_ARCMIN, HELD_GAIN = 0.01, 0.1
NOTHING_ARCMIN = 1e-5  # no part, eye or camera could show it
MAX_STEPS = 30  # four or five are the rule
SETTLED_MM = 1e-9  # of the height: what a file's digits keep
# Where no mirror is, the sheet is held by its third differences, of which a surface of second order has none. They weigh as
# much as the rays miss, as what is noise to the one is structure to the other: SMOOTH where these miss SMOOTH_ARCMIN or more,
# and less with its square, so that a view that a surface can show is met as if there were nothing beside the mirror.
SMOOTH, SMOOTH_ARCMIN = 2e-3, 1.0
MIN_SMOOTH = 1e-10  # or what no ray sees would be settled by nothing
SEEN = 0.1  # a pole of whose reach the mirror has this share is settled by its rays
MIN_WEIGHT = 1e-9  # of the largest: what counts less is no part of the mirror, and is held as what lies beside it
# On the diagonal of the scaled normal equations, whose rounding is some 1e-15: it only shortens a step, and moves no minimum.
RIDGE = 1e-13
STEEPEST = 5.7  # of a slope, 80°: beyond, a sheet over (x, y) is no description of a mirror
TRUSTED_SLOPE = 0.5  # a step may change slopes by this at most: reflection is far from linear beyond


@dataclass(frozen=True, slots=True)
class ViewLevel:
    """One set of spans: what it reached, by area times weight over all eyes, and cost."""

    spans: tuple[int, int]
    unknowns: int
    steps: int
    rms_arcmin: float
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class FromView:
    """The surface that shows a view most nearly, and how what it misses fell with the spans.

    Where that stops, no surface shows it better.

    Attributes
    ----------
    surface : BSplineSurface
        u = x, v = y.
    degree : int
        In both directions.
    levels : tuple of ViewLevel
        One set of spans after the other: the surface is the last, or the one before it where that gained nothing.
    eyes_rms_arcmin : tuple of float
        Of each eye alone, arc minutes.
    settled : bool
        Whether the last step changed nothing, and more spans would gain nothing.
    """

    surface: BSplineSurface
    degree: int
    levels: tuple[ViewLevel, ...]
    eyes_rms_arcmin: tuple[float, ...]
    settled: bool


def surface_from_view(view: WantedView, eyes: Sequence[Array], outline: Outline, domain: Box, degree: int | str = "auto",
                      spans: tuple[int, int] | str = "auto", knots: tuple[Array, Array] | None = None,
                      weight: WeightMap | None = None) -> FromView:
    """Find the height field z(x, y) with z(0, 0) = 0 whose reflected rays come closest to a wanted view.

    Minimises Σ_eyes ∫ω|d′ − w|² dx dy over the trimmed mirror, with ω the weight, d′ the direction in which the eye's ray
    leaves and w the one that is wanted of it, both of unit length: |d′ − w| is 2·sin of half the angle between them.
    Gauss–Newton with the analytic derivatives of `reflected`.

    Parameters
    ----------
    view : WantedView
    eyes : sequence of ndarray
        (3,) mm each.
    outline : Outline
    domain : tuple
        (x_min, x_max, y_min, y_max), where the surface is wanted, mm.
    degree, spans : int or "auto", (nx, ny) or "auto"
        Over the mirror's box; "auto" takes more spans until they gain nothing.
    knots : pair of ndarray, optional
        Taken instead of spans, with the degree.
    weight : WeightMap, optional
        ω over (x, y), by ratios; 1 everywhere by default.

    Returns
    -------
    FromView

    Raises
    ------
    SurfaceError
        Where no sheet over (x, y) comes near the view, more is asked for than is solved for, or nothing of the mirror counts.

    References
    ----------
    R. A. Hicks, "Controlling a ray bundle with a free-form reflector", Optics Letters 33, 1672 (2008), for mirrors of
    prescribed projection and why most have none: W = (X, Y, 1) settles the normal field, which need not be that of a surface.
    """
    chosen = DEGREE if isinstance(degree, str) else degree
    box = outline.bounding_box()
    fixed = not isinstance(spans, str) or knots is not None
    found: list[tuple[_Problem, ViewLevel, bool]] = []
    for nx, ny in (LEVELS if isinstance(spans, str) else (spans,))[:1 if fixed else None]:
        began = time.perf_counter()
        ends = (spans_with_margin(domain[:2], box[:2], (), chosen, nx), spans_with_margin(domain[2:], box[2:], (), chosen, ny))
        pair = knots or (knot_vector(ends[0], (), chosen), knot_vector(ends[1], (), chosen))
        if knots is not None:
            ends = (np.unique(knots[0]), np.unique(knots[1]))
        poles = (len(pair[0]) - chosen - 1) * (len(pair[1]) - chosen - 1)
        if poles > MAX_POLES:
            raise SurfaceError(f"surface.spans = [{nx}, {ny}] with method = \"view\" asks for {poles} unknowns, at most "
                               f"{MAX_POLES} are solved for: fewer spans (\"auto\" takes {list(LEVELS[-1])} at most)")
        problem = _Problem(view, eyes, outline, pair, ends, chosen, weight)
        if found:
            problem.start_from(found[-1][0].surface())
        steps, converged = problem.solve()
        level = ViewLevel((len(ends[0]) - 1, len(ends[1]) - 1), poles - 1, steps, problem.rms_arcmin(),
                          time.perf_counter() - began)
        found.append((problem, level, converged))
        if level.rms_arcmin < NOTHING_ARCMIN or (
                len(found) > 1 and _gained_nothing(found[-2][1].rms_arcmin, level.rms_arcmin)):
            break
    levels = tuple(level for _, level, _ in found)
    enough = len(found) > 1 and _gained_nothing(levels[-2].rms_arcmin, levels[-1].rms_arcmin)
    # Of two that show the same, the one with fewer spans: what more of them find is at the rim, and bends it.
    problem, _, converged = found[-2] if enough else found[-1]
    settled = converged and (fixed or enough or levels[-1].rms_arcmin < NOTHING_ARCMIN)
    return FromView(problem.surface(), chosen, levels, problem.eyes_rms_arcmin(), settled)


def _gained_nothing(before: float, after: float) -> bool:
    gain = before - after
    return gain < GAIN_ARCMIN and (after > HELD_ARCMIN or gain < HELD_GAIN * before)


class Reflected(NamedTuple):
    """Unit directions (n, 3) of reflected rays and their derivatives by z, z_x and z_y of the point they leave from."""

    direction: Array
    by_z: Array
    by_zx: Array
    by_zy: Array


def reflected(eye: Array, points: Array, z_x: Array, z_y: Array) -> Reflected:
    """Reflect an eye's rays at points of a sheet z(x, y), with derivatives; z_x and z_y are its slopes there.

    With v = P − E, N = (−z_x, −z_y, 1), s = N·v and m = N·N: d′ = (v − 2·s/m·N)/|v|, and its derivatives in closed form.
    """
    v = points - eye
    normal = np.stack([-z_x, -z_y, np.ones_like(z_x)], axis=-1)
    s, m = np.sum(normal * v, axis=-1), np.sum(normal * normal, axis=-1)
    length = np.sqrt(np.sum(v * v, axis=-1))[:, None]
    share = (2.0 * s / m)[:, None]
    direction = (v - share * normal) / length
    by_z = -2.0 * normal / m[:, None]
    by_z[:, 2] += 1.0
    by_z = by_z / length - direction * v[:, 2:] / length**2
    slopes = []
    for axis, slope in ((0, z_x), (1, z_y)):
        part = (2.0 * v[:, axis] / m + 4.0 * s * slope / m**2)[:, None] * normal
        part[:, axis] += share[:, 0]
        slopes.append(part / length)
    return Reflected(direction, by_z, slopes[0], slopes[1])


class _Problem:
    """Least squares for the poles' heights at Gauss points inside the outline; the height at the origin is held at 0."""

    def __init__(self, view: WantedView, eyes: Sequence[Array], outline: Outline, knots: tuple[Array, Array],
                 ends: tuple[Array, Array], degree: int, weight: WeightMap | None) -> None:
        self.view, self.eyes, self.knots, self.degree = view, eyes, knots, degree
        x, weight_x, y, weight_y, share = gauss_grid(outline, ends)
        counts = np.ones_like(share) if weight is None else _counts(weight, x, y, share)
        share = np.where(counts > 0.0, share, 0.0)
        basis_x, basis_y = dense_basis(knots[0], degree, x, 1), dense_basis(knots[1], degree, y, 1)
        self.shape = (basis_x.shape[2], basis_y.shape[2])
        i, j = np.nonzero(share > 0.0)
        self.x, self.y = x[i], y[j]
        area = weight_x[i] * weight_y[j] * share[i, j] * counts[i, j]
        self.weight = area / area.sum()
        self.root_weight = np.sqrt(self.weight)
        self.matrices = [(basis_x[a][i][:, :, None] * basis_y[b][j][:, None, :]).reshape(len(i), -1)
                         for a, b in ((0, 0), (1, 0), (0, 1))]
        origin = np.outer(dense_basis(knots[0], degree, np.zeros(1), 0)[0, 0],
                          dense_basis(knots[1], degree, np.zeros(1), 0)[0, 0]).ravel()
        # One pole follows the others, so that the height at the origin stays: the one that counts most there.
        self.origin, self.tied = origin, int(np.argmax(origin))
        self.follows = -origin / origin[self.tied]
        whole = np.outer(weight_x @ basis_x[0], weight_y @ basis_y[0])
        seen = np.einsum("ab,ai,bj->ij", weight_x[:, None] * weight_y * share, basis_x[0], basis_y[0], optimize=True) / whole
        self.smooth = _third_differences(knots, degree, seen)
        self.smooth_free = self._reduced(self.smooth)
        self.smooth_squared = self.smooth_free.T @ self.smooth_free
        self.heights = self._start()

    def start_from(self, surface: BSplineSurface) -> None:
        """Begin with the heights of a sheet on fewer spans, where that reaches as far."""
        x, y = (greville_abscissae(knots, self.degree) for knots in self.knots)
        u_min, u_max, v_min, v_max = surface.domain
        if x[0] < u_min or x[-1] > u_max or y[0] < v_min or y[-1] > v_max:
            return
        across, upright = (dense_basis(knots, self.degree, at, 0)[0] for knots, at in zip(self.knots, (x, y), strict=True))
        heights = np.linalg.solve(across, surface.on_grid(x, y, order=0, component=2)["s"])
        found = np.linalg.solve(upright, heights.T).T.ravel()
        self.heights = found - self.origin @ found  # what interpolates it is off by rounding's or the spans' part there

    def solve(self) -> tuple[int, bool]:
        """Gauss–Newton until the heights stay: how many steps, and whether they did."""
        for step in range(1, MAX_STEPS + 1):
            if self._step() < SETTLED_MM:
                return step, True
        return MAX_STEPS, False

    def _step(self) -> float:
        """One step; returns by how much it moved the mirror at most, mm."""
        residuals, slopes = self._residuals(self.heights)
        missed = ARCMIN * np.sqrt(sum(float(self.weight @ np.sum(one**2, axis=1)) for one in residuals) / len(residuals))
        share = max(SMOOTH * min(1.0, missed / SMOOTH_ARCMIN)**2, MIN_SMOOTH)**2
        matrix = share * self.smooth_squared
        right = -share * self.smooth_free.T @ (self.smooth @ self.heights)
        for residual, (by_z, by_zx, by_zy) in zip(residuals, slopes, strict=True):
            for k in range(3):
                rows = by_z[:, k, None] * self.matrices[0]
                rows += by_zx[:, k, None] * self.matrices[1]
                rows += by_zy[:, k, None] * self.matrices[2]
                rows = self._reduced(rows)
                rows *= self.root_weight[:, None]
                matrix += rows.T @ rows  # of one array with itself: half the work
                right -= rows.T @ (self.root_weight * residual[:, k])
        change = self._solved(matrix, right)
        moved = [m @ change for m in self.matrices]
        steepest = max(float(np.abs(part).max()) for part in moved[1:])
        # A step that turns normals far is cut: the derivatives say nothing of what lies there.
        self.heights = self.heights + change * min(1.0, TRUSTED_SLOPE / max(steepest, 1e-300))
        slope = np.hypot(*(m @ self.heights for m in self.matrices[1:]))
        if not slope.max() <= STEEPEST:  # NaN too
            worst = int(np.argmax(slope))
            raise SurfaceError(f"no sheet comes near the view of [target]: at ({self.x[worst]:.1f}, {self.y[worst]:.1f}) mm "
                               "the mirror would stand steeper than 80°; ask for smaller angles")
        return float(np.abs(moved[0]).max())

    def surface(self) -> BSplineSurface:
        return graph(*self.knots, self.degree, self.heights.reshape(self.shape))

    def eyes_rms_arcmin(self) -> tuple[float, ...]:
        """What each eye misses, RMS by area: the angle between wanted and shown."""
        residuals, _ = self._residuals(self.heights)
        return tuple(float(np.sqrt(np.sum(self.weight * (2.0 * np.arcsin(0.5 * np.linalg.norm(one, axis=1)))**2))) * ARCMIN
                     for one in residuals)

    def rms_arcmin(self) -> float:
        each = self.eyes_rms_arcmin()
        return float(np.sqrt(np.mean(np.square(each))))

    def _reduced(self, rows: Array) -> Array:
        """Rows over all poles as rows over those that are free; that of the tied pole becomes nothing."""
        follows = np.where(np.arange(len(self.follows)) == self.tied, -1.0, self.follows)
        result: Array = rows + np.outer(rows[:, self.tied], follows)
        return result

    def _solved(self, matrix: Array, right: Array) -> Array:
        free = np.arange(len(right)) != self.tied
        scale = 1.0 / np.sqrt(np.diag(matrix)[free])
        try:
            scaled = matrix[np.ix_(free, free)] * scale[:, None] * scale
            factor = cho_factor(scaled + RIDGE * np.eye(len(scaled)), check_finite=False)
        except LinAlgError:
            raise SurfaceError("the view of [target] leaves the mirror undetermined: are two of its directions the same all "
                               "over it? Fewer spans may do") from None
        change = np.zeros(len(right))
        change[free] = scale * cho_solve(factor, scale * right[free], check_finite=False)
        change[self.tied] = self.follows[free] @ change[free]
        return change

    def _residuals(self, heights: Array) -> tuple[list[Array], list[tuple[Array, Array, Array]]]:
        """d′ − w of each eye (n, 3), and its derivatives by z, z_x and z_y, over the root of the number of eyes."""
        z, p, q = (m @ heights for m in self.matrices)
        points = np.stack([self.x, self.y, z], axis=-1)
        residuals, slopes = [], []
        for eye in self.eyes:
            found = reflected(eye, points, p, q)
            wanted, by_z = _wanted(self.view, eye, points)
            residuals.append(found.direction - wanted)
            slopes.append((found.by_z - by_z, found.by_zx, found.by_zy))
        return residuals, slopes

    def _start(self) -> Array:
        """A paraboloid whose slopes come nearest, in least squares, to those that the view asks of the plane z = 0."""
        flat = np.stack([self.x, self.y, np.zeros_like(self.x)], axis=-1)
        rows, right = [], []
        weight = np.sqrt(self.weight)
        zero, one = np.zeros_like(self.x), np.ones_like(self.x)
        for eye in self.eyes:
            p, q = wanted_slopes(self.view, eye, flat)
            rows += [weight[:, None] * np.stack([one, zero, 2.0 * self.x, self.y, zero], axis=-1),
                     weight[:, None] * np.stack([zero, one, zero, self.x, 2.0 * self.y], axis=-1)]
            right += [weight * p, weight * q]
        a, b, c, d, e = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
        gx, gy = (greville_abscissae(knots, self.degree) for knots in self.knots)
        x2, y2 = (_blossom_of_square(knots, self.degree) for knots in self.knots)
        heights: Array = (a * gx[:, None] + b * gy + c * x2[:, None] + d * gx[:, None] * gy + e * y2).ravel()
        return heights


def _counts(weight: WeightMap, x: Array, y: Array, share: Array) -> Array:
    """The weights (m, n) at places x (m,) by y (n,), of which share (m, n) lies in the mirror; 0 for next to nothing."""
    found = weight(*np.meshgrid(x, y, indexing="ij"))
    largest = float(found[share > 0.0].max(initial=0.0))
    if largest == 0.0:
        raise SurfaceError("target.weight is 0 all over the mirror: some place of it must count")
    return np.where(found > MIN_WEIGHT * largest, found, 0.0)


def _blossom_of_square(knots: Array, degree: int) -> Array:
    """The poles of x² over knots: the mean of t_i·t_j over the pairs of a pole's inner knots."""
    windows = np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree)
    total, squares = windows.sum(axis=1), (windows**2).sum(axis=1)
    poles: Array = (total**2 - squares) / (degree * (degree - 1))
    return poles


def _wanted(view: WantedView, eye: Array, points: Array) -> tuple[Array, Array]:
    """The wanted directions (n, 3) of an eye's rays through points, and their derivatives by the points' z."""
    x, y = on_plane(eye, points)
    found = view.tangents(x, y)
    # d/dz of where the ray crosses z = 0
    rate = eye[2] / (eye[2] - points[:, 2]) ** 2
    x_by_z, y_by_z = (points[:, 0] - eye[0]) * rate, (points[:, 1] - eye[1]) * rate
    across = found.x_by_x * x_by_z + found.x_by_y * y_by_z
    upright = found.y_by_x * x_by_z + found.y_by_y * y_by_z
    length = np.sqrt(1.0 + found.x**2 + found.y**2)
    wanted = np.stack([found.x, found.y, np.ones_like(length)], axis=-1) / length[:, None]
    change = np.stack([across, upright, np.zeros_like(length)], axis=-1) / length[:, None]
    return wanted, change - wanted * np.sum(wanted * change, axis=-1, keepdims=True)


def wanted_slopes(view: WantedView, eye: Array, points: Array) -> tuple[Array, Array]:
    """Compute the slopes z_x, z_y that a mirror through points (n, 3) would need to show the view: those of w − i."""
    v = points - eye
    wanted, _ = _wanted(view, eye, points)
    normal = wanted - v / np.linalg.norm(v, axis=-1, keepdims=True)
    return -normal[:, 0] / normal[:, 2], -normal[:, 1] / normal[:, 2]


def _third_differences(knots: tuple[Array, Array], degree: int, inside: Array) -> Array:
    """Third divided differences of the poles along x and along y, as slopes: times the square of the sheet's size.

    inside (m, n) : how much of each pole's reach lies in the mirror. A difference counts by how little its least one has: all
    of it where a pole is not seen at all.
    """
    parts = []
    for axis in (0, 1):
        abscissae = greville_abscissae(knots[axis], degree)
        size = abscissae[-1] - abscissae[0]
        rows = np.eye(len(abscissae))
        for order in (1, 2, 3):
            rows = np.diff(rows, axis=0) * (order / (abscissae[order:] - abscissae[:-order]))[:, None]
        rows *= size**2 / np.sqrt(inside.size)
        other = np.eye(inside.shape[1 - axis])
        least = np.min(np.lib.stride_tricks.sliding_window_view(inside, 4, axis=axis), axis=-1).ravel()
        whole = np.kron(rows, other) if axis == 0 else np.kron(other, rows)
        parts.append(whole * np.maximum(1.0 - least / SEEN, 0.0)[:, None])
    return np.concatenate(parts)
