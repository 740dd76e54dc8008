"""Derivatives of reflected rays by the direction of the eye's ray: in closed form, and as differences of exact rays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels import image_points as kernel

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Reflect = Callable[[Array], tuple[Array, Array]]

CREASE = np.radians(60.0)  # between neighbouring reflected rays: normals 30° apart are those of two faces, as in mesh_normals
NEAR, WIDE = np.array([-1.0, 1.0]), np.array([-2.0, -1.0, 1.0, 2.0])  # turns


def curvature_tensors(normals: Array, s_u: Array, s_v: Array, s_uu: Array, s_uv: Array, s_vv: Array) -> Array:
    """Compute the derivative of the unit normal along a surface, as a tensor in space: dn = N·dP for steps dP along it.

    N = −Σ b_ij·aⁱ⊗aʲ with the second fundamental form b_ij = S_ij·n and the reciprocal basis aⁱ of S_u, S_v: the shape
    operator, continued by N·n = 0.

    Parameters
    ----------
    normals : (n, 3), unit, of either sense: N changes its sign with n.
    s_u, s_v, s_uu, s_uv, s_vv : (n, 3), derivatives of S(u, v).

    Returns
    -------
    (n, 3, 3), 1/mm; NaN where S_u × S_v vanishes.

    References
    ----------
    M. do Carmo, Differential Geometry of Curves and Surfaces, sections 3-2 and 3-3.
    """
    e, f, g = (np.einsum("ij,ij->i", a, b) for a, b in ((s_u, s_u), (s_u, s_v), (s_v, s_v)))
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = (e * g - f * f)[:, None]
        first = (g[:, None] * s_u - f[:, None] * s_v) / determinant
        second = (e[:, None] * s_v - f[:, None] * s_u) / determinant
    b_uu, b_uv, b_vv = (np.einsum("ij,ij->i", b, normals)[:, None] for b in (s_uu, s_uv, s_vv))
    return -(first[:, :, None] * (b_uu * first + b_uv * second)[:, None]
             + second[:, :, None] * (b_uv * first + b_vv * second)[:, None])


def reflected_differentials(eye: Array, rays: Array, turns: Array, points: Array, directions: Array,
                            tensors: Callable[[Array, Array], Array]) -> tuple[Array, Array]:
    """Differentiate P = E + t·ω and d = ω − 2(ω·n)n by changes δ of ω.

    dP = t·(δ − ω·(n·δ)/(n·ω)),   dd = δ − 2(δ·n + ω·dn)·n − 2(ω·n)·dn,   dn = N·dP.

    Parameters
    ----------
    eye : (3,), mm.   rays : ω, (n, 3), unit.   turns : δ, (n, k, 3), across ω.
    points, directions : P (n, 3), mm, and d (n, 3), unit, of the reflected rays.
    tensors : N (n, 3, 3) at points with normals, as `curvature_tensors`.

    Returns
    -------
    dP (n, k, 3), mm, and dd (n, k, 3), to each change; NaN where N is.

    References
    ----------
    H. Igehy, Tracing ray differentials (1999), sections 3.1 and 3.2.
    """
    normals, by_points, by_directions = np.empty_like(rays), np.empty_like(turns), np.empty_like(turns)
    kernel.normals_between(rays, directions, normals)
    kernel.reflected_differentials(eye, rays, turns, points, normals, tensors(points, normals), by_points, by_directions)
    return by_points, by_directions


def traced_differentials(reflect: Reflect, rays: Array, turns: Array, points: Array, directions: Array, turn: float,
                         smooth: bool) -> tuple[Array, Array]:
    """Differentiate where rays leave and their directions then by differences of exact rays.

    Central differences of the second order, which do not overshoot where a law breaks; beside a crease or an edge beyond
    which nothing is traced, to one side.

    Parameters
    ----------
    reflect : of directions (m, 3), points (m, 3) and directions (m, 3) of the reflected rays; NaN where there are none.
    rays, turns, points, directions : as in `reflected_differentials`.
    turn : radians between neighbouring rays.
    smooth : whether differences are of the fourth order, where they can be.

    Returns
    -------
    As `reflected_differentials`; NaN where no two neighbours are reflected.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.linalg.norm(turns, axis=2, keepdims=True)
        unit_turns = turns / size

    def beside(these: Index, at: Array) -> tuple[Array, Array]:
        angles = turn * at
        asked = (np.cos(angles)[:, None] * rays[these, None, None] + np.sin(angles)[:, None] * unit_turns[these, :, None])
        ends, after = (one.reshape(asked.shape) for one in reflect(asked.reshape(-1, 3)))
        beyond = np.einsum("nkmi,ni->nkm", after, directions[these]) < np.cos(CREASE)
        ends[beyond] = after[beyond] = np.nan
        return ends, after

    every = np.arange(len(rays))
    if smooth:
        ends, after = beside(every, WIDE)
        return _wide(ends, points, turn, True) * size, _wide(after, directions, turn, True) * size
    ends, after = beside(every, NEAR)
    by_points, by_directions = ((one[:, :, 1] - one[:, :, 0]) / (2.0 * turn) for one in (ends, after))
    lacking = np.flatnonzero(~np.isfinite(by_directions).all(axis=(1, 2)))
    if lacking.size:
        ends, after = beside(lacking, WIDE)
        by_points[lacking] = _wide(ends, points[lacking], turn, False)
        by_directions[lacking] = _wide(after, directions[lacking], turn, False)
    return by_points * size, by_directions * size


def _wide(beside: Array, middle: Array, turn: float, smooth: bool) -> Array:
    """Derivative (n, k, 3) of what is `beside` (n, k, 4, 3) at −2, −1, 1, 2 turns and in the middle (n, 3)."""
    a, b, c, d = np.moveaxis(beside, 2, 0)
    m = middle[:, None]
    near = (c - b) / (2.0 * turn)
    found = (8.0 * (c - b) - (d - a)) / (12.0 * turn) if smooth else near
    for other in (near, (4.0 * c - 3.0 * m - d) / (2.0 * turn), (3.0 * m - 4.0 * b + a) / (2.0 * turn)):
        found = np.where(np.isnan(found), other, found)
    return found
