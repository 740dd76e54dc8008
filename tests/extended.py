"""A second working-out of reflection off a B-spline: Cox and de Boor's recursion and Newton in extended precision."""

from __future__ import annotations

import numpy as np

from mirror_cad.surfaces.bspline import BSplineSurface

Long = np.longdouble
ARCSEC = np.degrees(1.0) * 3600.0


def _basis(knots: np.ndarray, degree: int, spans: np.ndarray, t: np.ndarray) -> np.ndarray:
    values = np.zeros((len(t), degree + 1), Long)
    values[:, 0] = 1
    for d in range(1, degree + 1):
        new = np.zeros_like(values)
        for j in range(d + 1):
            i = spans - d + j
            if j > 0:
                new[:, j] += (t - knots[i]) / (knots[i + d] - knots[i]) * values[:, j - 1]
            if j < d:
                new[:, j] += (knots[i + d + 1] - t) / (knots[i + d + 1] - knots[i + 1]) * values[:, j]
        values = new
    return values


def _with_slopes(knots: np.ndarray, degree: int, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    knots = knots.astype(Long)
    spans = np.clip(np.searchsorted(knots, t, side="right") - 1, degree, len(knots) - degree - 2)
    lower = _basis(knots, degree - 1, spans, t)
    slopes = np.zeros((len(t), degree + 1), Long)
    for j in range(degree + 1):
        i = spans - degree + j
        if j > 0:
            slopes[:, j] += degree * lower[:, j - 1] / (knots[i + degree] - knots[i])
        if j < degree:
            slopes[:, j] -= degree * lower[:, j] / (knots[i + degree + 1] - knots[i + 1])
    return spans - degree, _basis(knots, degree, spans, t), slopes


def points_and_tangents(surface: BSplineSurface, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """S, S_u, S_v (n, 3) of a surface without or with weights."""
    weights = np.ones(surface.poles.shape[:2]) if surface.weights is None else surface.weights
    poles = np.concatenate([surface.poles * weights[..., None], weights[..., None]], axis=2).astype(Long)
    if surface.weights is not None:
        poles[..., :3] = surface.poles.astype(Long) * weights.astype(Long)[..., None]
    iu, bu, du = _with_slopes(surface.knots_u, surface.degree_u, u)
    iv, bv, dv = _with_slopes(surface.knots_v, surface.degree_v, v)
    sums = np.zeros((3, len(u), 4), Long)
    for a in range(surface.degree_u + 1):
        for b in range(surface.degree_v + 1):
            pole = poles[iu + a, iv + b]
            for k, (along_u, along_v) in enumerate(((bu, bv), (du, bv), (bu, dv))):
                sums[k] += (along_u[:, a] * along_v[:, b])[:, None] * pole
    weight = sums[0, :, 3:]
    s = sums[0, :, :3] / weight
    return s, (sums[1, :, :3] - sums[1, :, 3:] * s) / weight, (sums[2, :, :3] - sums[2, :, 3:] * s) / weight


def reflected(surface: BSplineSurface, origins: np.ndarray, directions: np.ndarray, u: np.ndarray, v: np.ndarray,
              ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, reflected unit directions and cosines of incidence of rays that meet the surface near (u, v)."""
    d = directions.astype(Long)
    d /= np.sqrt((d * d).sum(axis=1))[:, None]
    o = np.broadcast_to(origins, d.shape).astype(Long)
    u, v = u.astype(Long), v.astype(Long)
    for _ in range(6):
        s, su, sv = points_and_tangents(surface, u, v)
        normal = np.cross(su, sv)
        t = (normal * (s - o)).sum(axis=1) / (normal * d).sum(axis=1)
        rest = o + t[:, None] * d - s
        e, f, g = (su * su).sum(axis=1), (su * sv).sum(axis=1), (sv * sv).sum(axis=1)
        a, b, det = (rest * su).sum(axis=1), (rest * sv).sum(axis=1), e * g - f * f
        u, v = u + (a * g - b * f) / det, v + (b * e - a * f) / det
    s, su, sv = points_and_tangents(surface, u, v)
    normal = np.cross(su, sv)
    normal /= np.sqrt((normal * normal).sum(axis=1))[:, None]
    along = (d * normal).sum(axis=1)
    return s, d - 2 * along[:, None] * normal, np.abs(along)
