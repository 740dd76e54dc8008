"""Ghost: how far beside the image the front of the glass shows it a second time, and how bright."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.rays import Rays, Trace
from raytrace.surfaces.base import GlassPlate

Array = NDArray[np.float64]

ARCMIN = np.degrees(1.0) * 60.0
TILT = 1e-4  # radians of the eye's direction, to either side: the magnification by central differences
CHORD_STEPS = 4  # each takes the error down some hundredfold; what is left is looked at
PARALLEL_RAD = 1e-9  # between the two leaving rays: some 1e-6 of the smallest ghost that matters


@dataclass(frozen=True, slots=True)
class Ghost:
    """How far from the image the front of the glass shows it a second time, and how bright, over the rays that were compared.

    Figures are None where no ray was. Light is told in shares of the light that falls on the plate.

    Attributes
    ----------
    rays : how many were compared.
    max_arcmin, max_at_mm : the largest angle between ghost and image as the eye sees them, arc minutes, and (x, y) of it, mm.
    mean_arcmin : their mean, arc minutes.
    front_mean, front_max : mean and largest reflectance of the front.
    image_mean : the mean share that comes by way of the back.
    """

    rays: int
    max_arcmin: float | None = None
    max_at_mm: tuple[float, float] | None = None
    mean_arcmin: float | None = None
    front_mean: float | None = None
    front_max: float | None = None
    image_mean: float | None = None


def ghost(glass: GlassPlate, eye: Array, u: Array, v: Array) -> Ghost:
    """Measure the front's own reflection beside the image in the back, for rays from the eye to points of the front.

    A far point sends the eye two rays, one by each face. The ghost's distance is the angle at the eye between the two. The
    ray to F(u, v) is reflected there into the direction w; the direction in which the eye sees the same far point by way
    of the back is found by Newton on the ray traced through the glass, until it leaves along w. To first order this is the
    angle between the two rays that leave after meeting the front at one point, over the mirror's angular magnification.
    Light: `reflectance` R at the front; the back reflects all of it, and both passes of the front let 1 − R through: a ray
    leaves at very nearly the incidence at which it came in.

    Parameters
    ----------
    glass : the plate.
    eye : (3,), mm, in mirror coordinates.
    u, v : (n,), parameters of points of the front.

    Returns
    -------
    Ghost
        Over the rays that meet the front from outside and whose counterpart by way of the back is found.

    References
    ----------
    docs/derivations/second-surface.md
    """
    points, normal = glass.front_at(u, v)
    ray = points - eye
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    cosine = -np.einsum("ij,ij->i", ray, normal)
    ghosts = ray + 2.0 * cosine[:, None] * normal
    apart = ARCMIN * _seen_apart(glass, eye, ray, ghosts)
    seen = np.isfinite(apart) & (cosine > 0.0)
    if not seen.any():
        return Ghost(0)
    apart, share = apart[seen], reflectance(cosine[seen], glass.index)
    worst = int(np.argmax(apart))
    at = (float(u[seen][worst]), float(v[seen][worst]))
    return Ghost(int(seen.sum()), float(apart[worst]), at, float(apart.mean()), float(share.mean()), float(share.max()),
                 float(np.mean((1.0 - share) ** 2)))


def reflectance(cosine: Array, index: float) -> Array:
    """Share of unpolarised light that a face from air to glass reflects, by Fresnel's formulae.

    R = ½·((c − n·c′)/(c + n·c′))² + ½·((n·c − c′)/(n·c + c′))², c′ = √(n² − 1 + c²)/n.

    Parameters
    ----------
    cosine : (n,), c, of the angle of incidence in air, above 0.
    index : n, the refractive index of the glass.

    Returns
    -------
    (n,), between 0 and 1.

    References
    ----------
    Born and Wolf, Principles of Optics, section 1.5.2.
    """
    inside = np.sqrt((index - 1.0) * (index + 1.0) + cosine * cosine) / index
    across = (cosine - index * inside) / (cosine + index * inside)
    along = (index * cosine - inside) / (index * cosine + inside)
    result: Array = 0.5 * (across**2 + along**2)
    return result


def _seen_apart(glass: GlassPlate, eye: Array, ray: Array, wanted: Array) -> Array:
    """The angle by which the eye's directions have to turn for the rays to leave the glass along `wanted`, radians, (n,).

    NaN where none is found: where the sheets end, or beside the focus of a concave mirror.
    """
    a, b = _across(ray)
    left, up = _across(wanted)

    def off(p: Array, q: Array) -> Array:
        found = Trace.empty(len(ray))
        glass.first_hits(Rays(eye[None], ray + p[:, None] * a + q[:, None] * b), found)
        leaving = found.directions
        return np.stack([np.einsum("ij,ij->i", leaving, left), np.einsum("ij,ij->i", leaving, up)], axis=1)

    p, q = np.zeros(len(ray)), np.zeros(len(ray))
    tilt = np.full(len(ray), TILT)
    by_p, by_q = (off(tilt, q) - off(-tilt, q)) / (2.0 * TILT), (off(p, tilt) - off(p, -tilt)) / (2.0 * TILT)
    determinant = by_p[:, 0] * by_q[:, 1] - by_p[:, 1] * by_q[:, 0]
    for _ in range(CHORD_STEPS):
        missing = off(p, q)
        p = p - (missing[:, 0] * by_q[:, 1] - missing[:, 1] * by_q[:, 0]) / determinant
        q = q - (by_p[:, 0] * missing[:, 1] - by_p[:, 1] * missing[:, 0]) / determinant
    settled = np.linalg.norm(off(p, q), axis=1) <= PARALLEL_RAD
    return np.where(settled, np.arctan(np.hypot(p, q)), np.nan)


def _across(directions: Array) -> tuple[Array, Array]:
    """Two unit vectors across each direction and each other."""
    smallest = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, smallest)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(directions, first)
