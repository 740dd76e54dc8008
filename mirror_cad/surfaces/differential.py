"""Normals, shape operator and principal curvatures of a surface, from its derivatives."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirror_cad.errors import SurfaceError
from mirror_cad.vectors import cross, lengths

if TYPE_CHECKING:
    from mirror_cad.sections import SagDerivatives

Array = NDArray[np.float64]

# |S_u × S_v| over |S_u|·|S_v| below which a surface has no normal: half the digits of float64 are gone there.
DEGENERATE = 1e-8


class Differentiable(Protocol):
    """A surface S(u, v) that gives its derivatives."""

    def derivatives(self, u: ArrayLike, v: ArrayLike) -> dict[str, Array]:
        """S, S_u, S_v, S_uu, S_uv, S_vv as "s", "u", … "vv", (…, 3) each, mm, at parameters of shapes that broadcast."""


class ShapeOperator(NamedTuple):
    """The shape operator W at points, in the orthonormal tangent frame (e1, e2), 1/mm, convex positive.

    e2 lies in the plane x = const and points to +y, e1 = e2 × N points to +x.

    Attributes
    ----------
    w11, w22, w12 : ndarray
        kx, ky and twist, of one shape.
    """

    w11: Array  # kx
    w22: Array  # ky
    w12: Array  # twist

    def minus(self, other: ShapeOperator) -> ShapeOperator:
        """Subtract component by component: both are in the same frame."""
        return ShapeOperator(*(a - b for a, b in zip(self, other, strict=True)))


def normals(s_u: Array, s_v: Array) -> Array:
    """Unit normals S_u × S_v/|S_u × S_v|; towards the driver when u runs right and v up.

    Parameters
    ----------
    s_u, s_v : ndarray
        (…, 3).

    Returns
    -------
    ndarray
        (…, 3).

    Raises
    ------
    SurfaceError
        Where |S_u × S_v| vanishes.
    """
    across = cross(s_u, s_v)
    length = lengths(across)
    size = lengths(s_u) * lengths(s_v)
    flat = ~(length > DEGENERATE * size)
    if flat.any():
        raise SurfaceError(f"the surface has no normal at {int(flat.sum())} of {flat.size} points: S_u × S_v vanishes")
    result: Array = across / length[..., None]
    return result


def shape_operator(derivatives: dict[str, Array]) -> ShapeOperator:
    """W(e_i, e_j) = −II(e_i, e_j) in the frame of `ShapeOperator`.

    Parameters
    ----------
    derivatives : dict
        S_u … S_vv, each (…, 3), as `BSplineSurface.derivatives` gives them.

    Raises
    ------
    SurfaceError
        Where S_u × S_v vanishes.

    References
    ----------
    M. do Carmo, Differential Geometry of Curves and Surfaces, sections 3-2 and 3-3.
    """
    s_u, s_v = derivatives["u"], derivatives["v"]
    normal = normals(s_u, s_v)
    e2 = np.stack([np.zeros_like(normal[..., 0]), normal[..., 2], -normal[..., 1]], axis=-1)  # N × x
    e2 /= lengths(e2)[..., None]
    e1 = cross(e2, normal)
    first = [_dot(s_u, s_u), _dot(s_u, s_v), _dot(s_v, s_v)]
    second = [_dot(derivatives[key], normal) for key in ("uu", "uv", "vv")]
    determinant = first[0] * first[2] - first[1] ** 2
    coordinates = []
    for e in (e1, e2):
        along_u, along_v = _dot(e, s_u), _dot(e, s_v)
        coordinates.append(((first[2] * along_u - first[1] * along_v) / determinant,
                            (first[0] * along_v - first[1] * along_u) / determinant))
    (a1, b1), (a2, b2) = coordinates
    return ShapeOperator(
        w11=-(a1 * a1 * second[0] + 2.0 * a1 * b1 * second[1] + b1 * b1 * second[2]),
        w22=-(a2 * a2 * second[0] + 2.0 * a2 * b2 * second[1] + b2 * b2 * second[2]),
        w12=-(a1 * a2 * second[0] + (a1 * b2 + a2 * b1) * second[1] + b1 * b2 * second[2]),
    )


def shape_operator_of_sag(d: SagDerivatives) -> ShapeOperator:
    """The shape operator of a height field z(x, y), in closed form.

    With p = z_x, q = z_y, m² = 1 + q², n² = 1 + p² + q²:  W22 = −z_yy/(m²n),
    W12 = −(m²·z_xy − pq·z_yy)/(m²n²),  W11 = −(m⁴·z_xx − 2pq·m²·z_xy + p²q²·z_yy)/(m²n³).

    Parameters
    ----------
    d : SagDerivatives
        z_x … z_yy, mm and 1/mm.
    """
    p, q = d.zx, d.zy
    m2 = 1.0 + q * q
    n2 = m2 + p * p
    n = np.sqrt(n2)
    pq = p * q
    return ShapeOperator(
        w11=-(m2 * m2 * d.zxx - 2.0 * pq * m2 * d.zxy + pq * pq * d.zyy) / (m2 * n2 * n),
        w22=-d.zyy / (m2 * n),
        w12=-(m2 * d.zxy - pq * d.zyy) / (m2 * n2),
    )


def rms_norm(w: ShapeOperator, weights: Array) -> float:
    """√(Σ weight·‖W‖²/Σ weight) with the Frobenius norm, 1/mm.

    Parameters
    ----------
    w : ShapeOperator
        Components (n,), 1/mm.
    weights : ndarray
        (n,), not negative.
    """
    return float(np.sqrt(np.average(w.w11**2 + w.w22**2 + 2.0 * w.w12**2, weights=weights)))


def principal_curvatures_of(w: ShapeOperator) -> tuple[Array, Array]:
    """k1, k2 = (W11 + W22)/2 ± √(((W11 − W22)/2)² + W12²), which loses no digits at umbilics.

    Parameters
    ----------
    w : ShapeOperator
        1/mm.

    Returns
    -------
    tuple of ndarray
        k1 ≥ k2, 1/mm, convex positive.
    """
    mean = 0.5 * (w.w11 + w.w22)
    half_difference = np.hypot(0.5 * (w.w11 - w.w22), w.w12)
    return mean + half_difference, mean - half_difference


def principal_curvatures(surface: Differentiable, u: ArrayLike, v: ArrayLike) -> Array:
    """Signed principal curvatures of a surface: the eigenvalues of its shape operator.

    Parameters
    ----------
    surface : Differentiable
        In mm; a `BSplineSurface`, say.
    u, v : array_like
        Of shapes that broadcast.

    Returns
    -------
    ndarray
        (…, 2), 1/mm, convex positive, larger first.

    Raises
    ------
    SurfaceError
        Where S_u × S_v vanishes or (u, v) lies outside the surface.
    """
    return np.stack(principal_curvatures_of(shape_operator(surface.derivatives(u, v))), axis=-1)


def _dot(a: Array, b: Array) -> Array:
    result: Array = np.einsum("...i,...i->...", a, b)
    return result
