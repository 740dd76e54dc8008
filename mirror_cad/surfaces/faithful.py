"""The height field whose shape operator comes closest to both curvature laws, in least squares."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import null_space
from scipy.optimize import least_squares

from mirror_cad.designed import DesignedCurvature
from mirror_cad.errors import SurfaceError
from mirror_cad.grid import Grid
from mirror_cad.outline import Outline
from mirror_cad.profile import Profile
from mirror_cad.sections import DecoupledSag, SagDerivatives
from mirror_cad.surfaces.basis import dense_basis
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import collocate_height, graph, knot_vector
from mirror_cad.surfaces.differential import shape_operator_of_sag
from mirror_cad.surfaces.quadrature import gauss_grid
from mirror_cad.surfaces.spans import span_ends
from mirror_cad.surfaces.spline_sag import SplineSag

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]

# "auto": quintic, which reaches the floor of free laws with half the unknowns; septic where quintic comes so near to the laws
# that a surface may have them, as a sphere or torus has: it then comes nearer by orders.
DEGREES, NEAR_PERCENT = (5, 7), 0.01
LEVELS = ((4, 3), (6, 4), (8, 6), (12, 8))  # spans over the mirror's box, until more of them gain nothing
# More spans gain nothing when the RMS falls by less than this in percentage points and by less than this share of it.
GAIN_POINTS, GAIN_SHARE = 0.01, 0.1
NOTHING_PERCENT = 1e-6  # an RMS below this is no deviation that any part or measurement could show
COLUMNS = 16  # of the evaluation grid looked at together: their derivatives stay near a core
# Share of the least squares that the surface around the mirror has: without one, poles that only live there run away; more
# would bend the mirror. It weighs the law at first, then only holds that part where the step before left it, so that what
# it pulls at the mirror falls by this factor with each step.
OUTSIDE = 1e-3
LATER_STEPS = 2
# The time grows with their third power: a minute or two for a mirror symmetric in y, of half as many unknowns.
MAX_POLES = 2000
MAX_EVALUATIONS = 20  # four to eight are the rule; a law that tears the surface (a jump of Ry) creeps on for little
# Least squares ends when a step changes the sum or the poles by less than this share: far below GAIN_SHARE.
CONVERGED = 1e-9


# Derivatives of the residual height more than of κ_x and κ_y that stay continuous at a break of theirs.
RESIDUAL_CONTINUITY = (3, 2)


@dataclass(frozen=True, slots=True, eq=False)
class FaithfulSag:
    """z(x, y) = z_p(x) + r(x, y): the exact horizontal profile and a B-spline over (x, y).

    Attributes
    ----------
    profile : Profile
        z_p.
    residual : BSplineSurface
        r as a graph, u = x and v = y. It has two derivatives more than what the laws hold it to: κ_y, and of κ_x, whose own
        share is in the profile, the slope's effect alone. So it has no crease, whose curvature least squares could not see.
    """

    profile: Profile
    residual: BSplineSurface

    def height(self, x: ArrayLike, y: ArrayLike) -> Array:
        """z at (x, y), mm, broadcast."""
        return self.derivatives(x, y).z

    def derivatives(self, x: ArrayLike, y: ArrayLike) -> SagDerivatives:
        """z, z_x, z_y, z_xx, z_xy, z_yy at (x, y), broadcast; mm and 1/mm."""
        x, profile = np.asarray(x, dtype=np.float64), self.profile
        z, z_x, z_y, z_xx, z_xy, z_yy = SplineSag(self.residual).derivatives(x, y)
        return SagDerivatives(profile.height(x) + z, profile.slope(x) + z_x, z_y, profile.bend(x) + z_xx, z_xy, z_yy)


@dataclass(frozen=True, slots=True)
class FaithfulLevel:
    """One set of spans: what it reached and cost.

    Attributes
    ----------
    spans : tuple
        Along x and y, over the whole sheet: those over the mirror's box and those of its margins.
    unknowns, evaluations : int
        Of the least squares.
    shape_rms_percent : float or None
        RMS deviation of the shape operator, percent of the designed RMS; None for a plane.
    seconds : float
        What it took.
    """

    spans: tuple[int, int]
    unknowns: int
    evaluations: int
    shape_rms_percent: float | None
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Faithful:
    """The closest surface, and how its deviation fell with the spans: where it stops falling is the floor of the laws.

    Attributes
    ----------
    sag : FaithfulSag
        The surface.
    degree : int
        Of its B-spline.
    ends : tuple of ndarray
        The ends of its spans along x and y, mm.
    levels : tuple of FaithfulLevel
        One set of spans after the other.
    settled : bool
        Whether more spans gain nothing.
    """

    sag: FaithfulSag
    degree: int
    ends: tuple[Array, Array]
    levels: tuple[FaithfulLevel, ...]
    settled: bool


def closest_surface(curvature: DesignedCurvature, outline: Outline, start: DecoupledSag, domain: Box,
                    breaks: Sequence[tuple[float, int]], degree: int | str = "auto",
                    spans: tuple[int, int] | str = "auto") -> Faithful:
    """The height field that minimises ∫‖W − diag(1/Rx, 1/Ry)‖² dx dy over the trimmed mirror (Frobenius norm).

    W is the shape operator in the frame of `ShapeOperator`.

    Parameters
    ----------
    curvature : DesignedCurvature
        1/Rx(x) and 1/Ry(x).
    outline : Outline
        What the mirror is trimmed to.
    start : DecoupledSag
        The decoupled surface, whose point and normal at the origin are kept, and from which the Levenberg–Marquardt iteration
        of MINPACK sets out with analytic derivatives.
    domain : tuple
        (x_min, x_max, y_min, y_max) where the surface is wanted, mm.
    breaks : sequence
        (x, derivatives of the residual height that stay continuous there).
    degree : int or "auto"
        Of the B-spline.
    spans : tuple or "auto"
        Over the mirror's box; "auto" raises them until more gain nothing.

    References
    ----------
    do Carmo, Differential Geometry of Curves and Surfaces, sections 3-2 and 3-3, for W; J. Moré, The Levenberg–Marquardt
    algorithm, Lecture Notes in Mathematics 630 (1978).
    """
    rms = curvature.rms(outline)
    if not isinstance(degree, str):
        return _refined(curvature, outline, start, domain, breaks, degree, spans, rms, NOTHING_PERCENT)
    quintic = _refined(curvature, outline, start, domain, breaks, DEGREES[0], spans, rms, NEAR_PERCENT)
    reached = quintic.levels[-1].shape_rms_percent
    if reached is None or reached > NEAR_PERCENT:
        return quintic
    return _refined(curvature, outline, start, domain, breaks, DEGREES[1], spans, rms, NOTHING_PERCENT)


def _refined(curvature: DesignedCurvature, outline: Outline, start: DecoupledSag, domain: Box,
             breaks: Sequence[tuple[float, int]], degree: int, spans: tuple[int, int] | str, rms: float,
             enough_percent: float) -> Faithful:
    box = outline.bounding_box()
    levels: list[FaithfulLevel] = []
    settled = not isinstance(spans, str) or rms == 0.0
    for nx, ny in LEVELS if isinstance(spans, str) else (spans,):
        began = time.perf_counter()
        ends = (spans_with_margin(domain[:2], box[:2], breaks, degree, nx),
                spans_with_margin(domain[2:], box[2:], (), degree, ny))
        knots = (knot_vector(ends[0], breaks, degree), knot_vector(ends[1], (), degree))
        poles = (len(knots[0]) - degree - 1) * (len(knots[1]) - degree - 1)
        if poles > MAX_POLES:
            raise SurfaceError(f"surface.spans = [{nx}, {ny}] with method = \"faithful\" asks for {poles} unknowns, at most "
                               f"{MAX_POLES} are solved for: fewer spans "
                               f"(\"auto\" takes [{LEVELS[-1][0]}, {LEVELS[-1][1]}] at most)")
        residual = collocate_height(start.residual_height, *knots, degree)
        unknowns = evaluations = 0
        if rms > 0.0:  # a plane has nothing to solve for
            problem = _Problem(curvature, outline, start.profile, residual, ends)
            unknowns = problem.unknowns
            residual, evaluations = problem.solve()
        sag = FaithfulSag(start.profile, residual)
        reached = _shape_rms_percent(sag, curvature, outline, rms)
        counts = len(ends[0]) - 1, len(ends[1]) - 1
        levels.append(FaithfulLevel(counts, unknowns, evaluations, reached, time.perf_counter() - began))
        if settled or reached is None or reached < enough_percent or (
                len(levels) > 1 and _gained_nothing(levels[-2].shape_rms_percent, reached)):
            settled = True
            break
    return Faithful(sag, degree, ends, tuple(levels), settled)


def _shape_rms_percent(sag: FaithfulSag, curvature: DesignedCurvature, outline: Outline, rms: float) -> float | None:
    """The contract's shape_rms_percent of the exact height field; None for a plane."""
    if rms == 0.0:
        return None
    grid = Grid.over(outline)
    total = 0.0
    for start in range(0, len(grid.cells_x), COLUMNS):
        x, inside = grid.cells_x[start:start + COLUMNS, None], grid.inside[start:start + COLUMNS]
        off = shape_operator_of_sag(sag.derivatives(x, grid.cells_y)).minus(curvature.shape(x))
        total += float(np.sum(inside * (off.w11**2 + off.w22**2 + 2.0 * off.w12**2)))
    return 100.0 * float(np.sqrt(total / grid.inside.sum())) / rms


def _gained_nothing(before: float | None, after: float) -> bool:
    gain = (before or 0.0) - after
    return gain < GAIN_POINTS and gain < GAIN_SHARE * (before or 0.0)


def spans_with_margin(domain: tuple[float, float], box: tuple[float, float], breaks: Sequence[tuple[float, int]], degree: int,
          count: int) -> Array:
    """`count` spans over the box, with the breaks among them, and beyond it spans of twice their neighbour's width."""
    low, high = max(box[0], domain[0]), min(box[1], domain[1])
    ends = list(span_ends(low, high, breaks, degree, count))
    for edge, side in ((domain[0], 0), (domain[1], -1)):
        width = (high - low) / count
        while abs(edge - ends[side]) > 0.0:
            left = edge - ends[side]
            # No sliver at the domain's edge: the last span takes what is left.
            step = left if abs(left) <= 3.0 * width else np.sign(left) * 2.0 * width
            ends.insert(0 if side == 0 else len(ends), edge if step == left else ends[side] + step)
            width *= 2.0
    return np.array(ends)


class _Problem:
    """Least squares for the poles of the residual height: residuals √weight·(W11 − 1/Rx, W22 − 1/Ry, √2·W12) at Gauss points.

    The poles are those of the start plus N·c, where the columns of N span what leaves r, r_x and r_y at the origin alone.
    A mirror that is symmetric in y has a symmetric closest surface: then only its upper half is looked at.
    """

    def __init__(self, curvature: DesignedCurvature, outline: Outline, profile: Profile, residual: BSplineSurface,
                 ends: tuple[Array, Array]) -> None:
        self.residual = residual
        x, weight_x, y, weight_y, inside = gauss_grid(outline, ends)
        basis_x = dense_basis(residual.knots_u, residual.degree_u, x, 2)
        basis_y = dense_basis(residual.knots_v, residual.degree_v, y, 2)
        origin_x = dense_basis(residual.knots_u, residual.degree_u, np.zeros(1), 1)
        origin_y = dense_basis(residual.knots_v, residual.degree_v, np.zeros(1), 1)
        poles = residual.poles[..., 2]
        self.fold: Array | None = None
        if _symmetric(y) and _symmetric(residual.knots_v) and np.array_equal(inside, inside[:, ::-1]):
            upper = y > 0.0
            y, weight_y, inside, basis_y = y[upper], weight_y[upper], inside[:, upper], basis_y[:, upper]
            n = poles.shape[1]
            self.fold = np.zeros((n, (n + 1) // 2))
            self.fold[np.arange(n), np.minimum(np.arange(n), n - 1 - np.arange(n))] = 1.0
            basis_y, origin_y, poles = basis_y @ self.fold, origin_y @ self.fold, poles[:, : (n + 1) // 2]
        held = ((0, 0), (1, 0), (0, 1)) if self.fold is None else ((0, 0), (1, 0))
        rows = np.array([np.outer(origin_x[i, 0], origin_y[j, 0]).ravel() for i, j in held])
        rows /= np.linalg.norm(rows, axis=1, keepdims=True)
        self.free = null_space(rows)
        self.start = poles.ravel() - np.linalg.pinv(rows) @ (rows @ poles.ravel())  # r = 0, level: the circles' own apex
        # One matrix a derivative: r's z_x, z_y, z_xx, z_xy, z_yy at the points from its poles.
        self.matrices = [np.einsum("ai,bj->abij", basis_x[i], basis_y[j]).reshape(x.size * y.size, -1)
                         for i, j in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))]
        self.tangents = [matrix @ self.free for matrix in self.matrices]
        shape = inside.shape
        zero = np.zeros(shape)
        self.profile = [np.broadcast_to(part, shape).ravel() for part in (
            profile.slope(x)[:, None], zero, profile.bend(x)[:, None], zero, zero)]
        designed = curvature.shape(x[:, None])
        self.target = np.stack([np.broadcast_to(part, shape).ravel() for part in designed])
        self.inside = inside.ravel() > 0.0
        area = (weight_x[:, None] * weight_y).ravel() * np.maximum(inside.ravel(), OUTSIDE)
        size = float(np.sum(area * (self.target[0] ** 2 + self.target[1] ** 2)))
        self.weight = np.sqrt(area / size) * np.array([1.0, 1.0, np.sqrt(2.0)])[:, None]

    @property
    def unknowns(self) -> int:
        """How many numbers are solved for."""
        return int(self.free.shape[1])

    def solve(self) -> tuple[BSplineSurface, int]:
        """The residual height with its poles where the sum of squares is least, and how often that was evaluated."""
        c, evaluations, most = np.zeros(self.unknowns), 0, MAX_EVALUATIONS
        for _ in range(1 + LATER_STEPS):
            found = least_squares(self._residuals, c, jac=self._jacobian, method="lm", x_scale="jac",
                                  ftol=CONVERGED, xtol=CONVERGED, gtol=CONVERGED, max_nfev=most)
            c, evaluations = found.x, evaluations + int(found.nfev)
            self.target[:, ~self.inside] = self._shape(c)[:, ~self.inside]
            most = 2  # one step: so near the end they are right to second order
        heights = (self.start + self.free @ c).reshape(self.residual.poles.shape[0], -1)
        if self.fold is not None:
            heights = heights @ self.fold.T
        return graph(self.residual.knots_u, self.residual.knots_v, self.residual.degree_u, heights), evaluations

    def _derivatives(self, c: Array) -> list[Array]:
        poles = self.start + self.free @ c
        return [part + matrix @ poles for part, matrix in zip(self.profile, self.matrices, strict=True)]

    def _shape(self, c: Array) -> Array:
        p, q, r, s, t = self._derivatives(c)
        return np.stack(shape_operator_of_sag(SagDerivatives(p, p, q, r, s, t)))

    def _residuals(self, c: Array) -> Array:
        return (self.weight * (self._shape(c) - self.target)).ravel()

    def _jacobian(self, c: Array) -> Array:
        p, q, r, s, t = self._derivatives(c)
        partial = shape_operator_partials(p, q, r, s, t)
        rows = [sum((weight * slope)[:, None] * tangent for slope, tangent in zip(slopes, self.tangents, strict=True)
                    if slope is not None) for weight, slopes in zip(self.weight, partial, strict=True)]
        return np.concatenate(rows)


def shape_operator_partials(p: Array, q: Array, r: Array, s: Array, t: Array) -> tuple[tuple[Array | None, ...], ...]:
    """∂W11, ∂W22, ∂W12 by p = z_x, q = z_y, r = z_xx, s = z_xy, t = z_yy.

    Of the closed forms in `shape_operator_of_sag`, with m² = 1 + q² and n² = 1 + p² + q².

    Parameters
    ----------
    p, q, r, s, t : ndarray
        Of one shape, mm and 1/mm.

    Returns
    -------
    tuple
        Three of five each; None where a partial derivative vanishes.
    """
    m2 = 1.0 + q * q
    n2 = m2 + p * p
    n = np.sqrt(n2)
    n3 = n2 * n
    pq = p * q
    w11, w22, w12 = shape_operator_of_sag(SagDerivatives(p, p, q, r, s, t))
    of_w11 = (2.0 * q * (s - pq * t / m2) / n3 - 3.0 * p / n2 * w11,
              2.0 * (p * s - q * r - p * pq * t / m2**2) / n3 - 3.0 * q / n2 * w11,
              -m2 / n3, 2.0 * pq / n3, -pq * pq / (m2 * n3))
    of_w22 = (-p / n2 * w22, -(2.0 / m2 + 1.0 / n2) * q * w22, None, None, -1.0 / (m2 * n))
    of_w12 = (q * t / (m2 * n2) - 2.0 * p / n2 * w12, p * t * (1.0 - q * q) / (m2**2 * n2) - 2.0 * q / n2 * w12,
              None, -1.0 / n2, pq / (m2 * n2))
    return of_w11, of_w22, of_w12


def _symmetric(y: Array) -> bool:
    """Whether values (n,), rising, are their own mirror image about 0."""
    return bool(np.allclose(y, -y[::-1], rtol=0.0, atol=1e-9 * float(np.abs(y).max())))
