"""B-spline surfaces as polynomials on each cell of their knots: what the kernels evaluate."""

from __future__ import annotations

import math
from functools import lru_cache
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from mirror_cad.surfaces.basis import greville_abscissae
from mirror_cad.surfaces.bspline import BSplineSurface
from raytrace.kernels.cells import PADDED_POWERS, Cells
from raytrace.kernels.height_field import HeightField
from raytrace.kernels.lanes import pitch
from raytrace.kernels.parametric import Patches
from raytrace.kernels.pieces import PolynomialCells

Array = NDArray[np.float64]
Index = NDArray[np.int32]

# x = u and y = v to this: above what the digits of a STEP file move a pole, below what any trace could see.
IDENTITY_TOLERANCE_MM = 1e-9
MAX_BINS = 1 << 17  # of the table that finds a span: half a megabyte
SAMPLES = 4  # a span and direction, at which a sheet is looked at for whether rays can meet it twice
# Sine of the angle between a sheet's mean normal and the others beyond which it is not taken to be a single sheet.
WIDEST_CONE = 0.9
MARGIN_MM = 1e-6  # above and below a height field, so that a ray enters its box before it meets it
CONE_MARGIN = 0.01  # for what the normals do between the samples


def is_graph(surface: BSplineSurface) -> bool:
    """Whether a surface is z(x, y) over its own parameters, u = x and v = y, to IDENTITY_TOLERANCE_MM."""
    if surface.weights is not None:
        return False
    x, y = surface.poles[..., 0], surface.poles[..., 1]
    off = max(np.abs(x - greville_abscissae(surface.knots_u, surface.degree_u)[:, None]).max(),
              np.abs(y - greville_abscissae(surface.knots_v, surface.degree_v)).max())
    return bool(off <= IDENTITY_TOLERANCE_MM)


def height_field_of(surface: BSplineSurface) -> HeightField | None:
    """Take a surface as z(x, y), where its parameters are x and y themselves.

    Parameters
    ----------
    surface : of any kind.

    Returns
    -------
    None where u and v are not x and y, where the degree is above 25, and for a surface that has a crease, across which no
    bound on the second derivative holds.
    """
    cells = None if _has_crease(surface) or not is_graph(surface) else _padded_cells(surface, surface.poles[..., 2:])
    if cells is None:
        return None
    z = surface.poles[..., 2]
    bend, twist = _bends(surface)
    return HeightField(cells, float(z.max()) + MARGIN_MM, _steepest(surface), float(z.min()) - MARGIN_MM, bend, twist)


# Those of the surfaces that are in use: a face with its loops, without them, and from its other side have one.
_patches: WeakKeyDictionary[BSplineSurface, Patches | None] = WeakKeyDictionary()


def patches_of(surface: BSplineSurface) -> Patches | None:
    """Take a surface as polynomials of its own parameters.

    Parameters
    ----------
    surface : of any kind.

    Returns
    -------
    None where the degree is above 25.
    """
    if surface not in _patches:
        centre, extent, poles = _homogeneous(surface)
        cells = _padded_cells(surface, poles)
        _patches[surface] = None if cells is None else Patches(
            cells, poles.shape[2], centre, extent, _sheet(surface, centre), _closed(surface))
    return _patches[surface]


def polynomial_cells(surface: BSplineSurface) -> PolynomialCells | None:
    """Take a surface as polynomials on each cell of its knots, not padded.

    Parameters
    ----------
    surface : of any kind.

    Returns
    -------
    None where its degree is above 25.
    """
    if max(surface.degree_u, surface.degree_v) >= PADDED_POWERS[-1]:
        return None
    centre, extent, poles = _homogeneous(surface)
    ends_u, ends_v = _cuts(surface.knots_u, surface.degree_u), _cuts(surface.knots_v, surface.degree_v)
    return PolynomialCells(_coefficients(surface, poles), ends_u, ends_v, _middles(ends_u), _middles(ends_v), centre, extent)


def _homogeneous(surface: BSplineSurface) -> tuple[Array, float, Array]:
    """The middle of the poles' box, their largest coordinate about it, and the poles about it, times and with the weights."""
    centre = 0.5 * (surface.poles.min(axis=(0, 1)) + surface.poles.max(axis=(0, 1)))
    poles = surface.poles - centre
    extent = float(np.abs(poles).max())
    if surface.weights is not None:
        weights = surface.weights[..., None]
        poles = np.concatenate([poles * weights, weights], axis=2)
    return centre, extent, poles


def _coefficients(surface: BSplineSurface, values: Array) -> Array:
    """Of Σ N_i·N_j·values_ij, values (n_u, n_v, parts): (u spans, v spans, parts, degree u + 1, degree v + 1)."""
    # (u spans, p + 1, n_v, parts), then (v spans, q + 1, u spans, p + 1, parts)
    along_u = _power_form(surface.knots_u, values.astype(np.longdouble), surface.degree_u)
    both = _power_form(surface.knots_v, np.moveaxis(along_u, 2, 0), surface.degree_v)
    return np.ascontiguousarray(both.transpose(2, 0, 4, 3, 1).astype(np.float64))


def _padded_cells(surface: BSplineSurface, values: Array) -> Cells | None:
    """The cells of Σ N_i·N_j·values_ij, values (n_u, n_v, parts), as the kernels take them; None for a degree above 25."""
    coefficients = _coefficients(surface, values)
    powers = next((n for n in PADDED_POWERS if n >= max(coefficients.shape[3:])), None)
    cuts = _cuts(surface.knots_u, surface.degree_u), _cuts(surface.knots_v, surface.degree_v)
    lookup_u, lookup_v = _lookup(cuts[0]), _lookup(cuts[1])
    if powers is None:
        return None
    *_, n_u, n_v = coefficients.shape
    rows = np.pad(coefficients.swapaxes(3, 4), [*[(0, 0)] * 3, (powers - n_v, 0), (powers - n_u, pitch(powers) - powers)])
    ends_u, ends_v = (np.append(ends, np.inf) for ends in cuts)
    middle_u, middle_v = (_middles(ends) for ends in cuts)
    bins_u, bins_v = (len(bins) / float(ends[-1] - ends[0]) for bins, ends in zip((lookup_u, lookup_v), cuts, strict=True))
    return Cells(powers, rows.ravel(), ends_u, ends_v, middle_u, middle_v, lookup_u, lookup_v, bins_u, bins_v)


def _cuts(knots: Array, degree: int) -> Array:
    """Ends of the spans of the domain; a periodic surface cut open has knots beyond it."""
    return np.unique(knots[degree:len(knots) - degree])


def _middles(ends: Array) -> Array:
    return 0.5 * (ends[:-1] + ends[1:])


def _power_form(knots: Array, poles: Array, degree: int) -> Array:
    """Powers of t − t_middle on each span, highest first, from the Taylor series there: (spans, degree + 1, …).

    In extended precision: the highest derivatives are differences of poles that agree to many digits, and what they lose
    in float64 is 2e-15 rad of the normal.
    """
    spans, matrices = _taylor_matrices(knots.tobytes(), degree)
    local = poles[spans[:, None] - degree + np.arange(degree + 1)]
    powers: Array = matrices @ local.reshape(*local.shape[:2], -1)
    return powers.reshape(local.shape)


@lru_cache(maxsize=8)  # from one design to the next, mostly the knots of one direction change
def _taylor_matrices(knots_bytes: bytes, degree: int) -> tuple[NDArray[np.intp], Array]:
    """The knot that starts each span, and what takes the poles that live there to the powers of `_power_form`.

    (spans,) and (spans, p + 1, p + 1): de Boor's algorithm on each derivative of the p + 1 splines themselves.
    """
    knots = np.frombuffer(knots_bytes)
    cuts = _cuts(knots, degree)
    spans, at = np.searchsorted(knots, cuts[:-1], side="right") - 1, _middles(cuts)  # the middles that the kernels take
    knots = knots.astype(np.longdouble)
    poles = np.repeat(np.eye(degree + 1, dtype=np.longdouble)[:, None], len(spans), axis=1)  # (pole, span, spline)
    terms = []
    for m in range(degree + 1):
        left = degree - m
        j = np.arange(left + 1)[:, None]
        local = poles
        for r in range(1, left + 1):
            low, high = knots[spans - left + j[r:]], knots[spans + j[r:] - r + 1]
            share = ((at - low) / (high - low))[..., None]
            local = (1 - share) * local[:-1] + share * local[1:]
        terms.append(local[0] / math.factorial(m))
        apart = knots[spans + 1 + j[:-1]] - knots[spans - left + 1 + j[:-1]]
        poles = left * np.diff(poles, axis=0) / apart[..., None]
    return spans, np.stack(terms[::-1], axis=1)


def _lookup(ends: Array) -> Index:
    """The span that holds the start of each bin, none of which holds two ends unless spans are very narrow."""
    bins = min(int(np.ceil((ends[-1] - ends[0]) / np.diff(ends).min() * 1.001)) + 1, MAX_BINS)
    starts = ends[0] + (ends[-1] - ends[0]) * np.arange(bins) / bins
    return np.clip(np.searchsorted(ends, starts, side="right") - 1, 0, len(ends) - 2).astype(np.int32)


def _samples(knots: Array, degree: int) -> Array:
    """The ends of the spans and places between them."""
    ends = _cuts(knots, degree)
    inner = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(SAMPLES) / SAMPLES
    return np.append(inner.ravel(), ends[-1])


def _has_crease(surface: BSplineSurface) -> bool:
    """Whether a slope may jump: at a knot inside that is repeated as often as the degree."""
    for knots, degree in ((surface.knots_u, surface.degree_u), (surface.knots_v, surface.degree_v)):
        values, counts = np.unique(knots[degree + 1:len(knots) - degree - 1], return_counts=True)
        if np.any(counts[values < knots[-degree - 1]] >= degree):
            return True
    return False


def _steepest(surface: BSplineSurface) -> float:
    """The square of the largest slope, which the derivatives' poles bound."""
    z_x, _ = _derivative_poles(surface.poles[..., 2], surface.knots_u, surface.degree_u, 0)
    z_y, _ = _derivative_poles(surface.poles[..., 2], surface.knots_v, surface.degree_v, 1)
    return float(np.abs(z_x).max() ** 2 + np.abs(z_y).max() ** 2)


def _bends(surface: BSplineSurface) -> tuple[float, float]:
    """Bounds on |z_dd| over all directions d, and on |∂z_dd| by another: the largest row sums of bounds on the derivatives.

    The second is inf where a second derivative may jump, at a knot inside that is repeated as often as the degree less one,
    or at any of a degree below 3.
    """
    u, v = (surface.knots_u, surface.degree_u), (surface.knots_v, surface.degree_v)
    along = {(0, 0): (surface.poles[..., 2], u, v)}
    for order in (1, 2, 3):
        for k in range(order):
            poles, of_u, of_v = along[order - 1 - k, k]
            along[order - k, k] = (*_derivative_poles(poles, *of_u, 0), of_v)
        poles, of_u, of_v = along[0, order - 1]
        poles, of_v = _derivative_poles(poles, *of_v, 1)
        along[0, order] = (poles, of_u, of_v)
    uu, uv, vv, uuu, uuv, uvv, vvv = (float(np.abs(along[n - k, k][0]).max(initial=0.0)) for n in (2, 3) for k in range(n + 1))
    twist = float(np.max((uuu + 2.0 * uuv + uvv, uuv + 2.0 * uvv + vvv)))  # NaN where one is: Python's max may forget it
    jumps = any(degree < 3 and len(knots) > 2 * (degree + 1) for knots, degree in (u, v))
    return max(uu + uv, uv + vv), np.inf if jumps or not np.isfinite(twist) else twist


def _derivative_poles(poles: Array, knots: Array, degree: int, axis: int) -> tuple[Array, tuple[Array, int]]:
    """Poles, knots and degree of the derivative along an axis: degree·(P_i+1 − P_i)/(t_i+p+1 − t_i+1); they bound it."""
    if degree == 0:
        return np.zeros_like(poles), (knots, 0)
    apart = knots[degree + 1:-1] - knots[1:-degree - 1]
    steps = np.diff(poles, axis=axis)
    with np.errstate(divide="ignore", invalid="ignore"):
        return degree * steps / np.expand_dims(apart, 1 - axis), (knots[1:-1], degree - 1)


def _closed(surface: BSplineSurface) -> Array:
    u_min, u_max, v_min, v_max = surface.domain
    u, v = _samples(surface.knots_u, surface.degree_u), _samples(surface.knots_v, surface.degree_v)
    same = IDENTITY_TOLERANCE_MM + 1e-12 * float(np.abs(surface.poles).max())
    apart = (np.linalg.norm(surface.evaluate(u_min, v) - surface.evaluate(u_max, v), axis=-1).max(),
             np.linalg.norm(surface.evaluate(u, v_min) - surface.evaluate(u, v_max), axis=-1).max())
    return np.array([float(distance <= same) for distance in apart])


def _sheet(surface: BSplineSurface, centre: Array) -> Array:
    """Normal, cone and affine maps of a surface that is a graph over a plane, (12,); (0,) where it is not.

    It is one where, in the plane across its mean normal and after the affine map that brings the parameters nearest to the
    places, the Jacobian's symmetric part is positive definite: on a convex domain no two places then coincide.
    """
    u, v = _samples(surface.knots_u, surface.degree_u), _samples(surface.knots_v, surface.degree_v)
    d = surface.on_grid(u, v, order=1)
    across = np.cross(d["u"], d["v"]).reshape(-1, 3)
    length = np.linalg.norm(across, axis=1)
    if not length.min() > 0.0:
        return np.empty(0)
    normal = across.sum(axis=0)
    if not np.linalg.norm(normal) > 0.0:
        return np.empty(0)
    normal /= np.linalg.norm(normal)
    cosine = float((across @ normal / length).min())
    if cosine <= 0.0:
        return np.empty(0)
    cone = math.sqrt(max(0.0, 1.0 - cosine**2))
    along = np.linalg.svd(normal[None])[2][1:]  # two directions in the plane
    place = (d["s"].reshape(-1, 3) - centre) @ along.T
    design = np.column_stack([np.ones(len(place)), place])
    uv = np.column_stack([grid.ravel() for grid in np.meshgrid(u, v, indexing="ij")])
    maps = np.linalg.lstsq(design, uv, rcond=None)[0]  # (3, 2)
    jacobian = np.stack([d["u"].reshape(-1, 3) @ along.T, d["v"].reshape(-1, 3) @ along.T], axis=2)  # ∂place/∂(u, v)
    product = np.einsum("nij,kj->nik", jacobian, maps[1:])  # ∂place/∂(mapped place)
    symmetric = 0.5 * (product + product.transpose(0, 2, 1))
    if cone > WIDEST_CONE or not np.linalg.eigvalsh(symmetric).min() > 0.0:
        return np.empty(0)
    return np.concatenate([normal, [cone + CONE_MARGIN], [maps[0, 0]], maps[1:, 0] @ along, [maps[0, 1]], maps[1:, 1] @ along])
