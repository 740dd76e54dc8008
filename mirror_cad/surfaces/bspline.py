"""Tensor-product B-spline surfaces as plain records, with their points and derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from mirror_cad.errors import SurfaceError
from mirror_cad.surfaces.basis import basis_functions, dense_basis, greville_abscissae
from mirror_cad.surfaces.differential import principal_curvatures
from mirror_cad.vectors import lengths

Array = NDArray[np.float64]

ORDERS = {"s": (0, 0), "u": (1, 0), "v": (0, 1), "uu": (2, 0), "uv": (1, 1), "vv": (0, 2)}  # of differentiation by u and v
# How far the poles of a height field may lie from where u = x and v = y have them, mm: STEP rounds to 15 digits, and a sheet
# that is off by more is no longer the one that x and y name.
PARAMETER_ROUNDING_MM = 1e-9
CHUNK = 20_000  # points evaluated at once: a few MB of basis functions, inside the cache of most machines


@dataclass(frozen=True, eq=False)
class BSplineSurface:
    """S(u, v) = Σ_ij N_i,p(u)·N_j,q(v)·w_ij·P_ij / Σ_ij N_i,p(u)·N_j,q(v)·w_ij.

    Attributes
    ----------
    degree_u, degree_v : int
        p, q.
    knots_u, knots_v : ndarray
        (m_u,) and (m_v,), clamped, with repetition.
    poles : ndarray
        P, (n_u, n_v, 3), mm.
    weights : ndarray or None
        w, (n_u, n_v); None where all are 1.

    References
    ----------
    L. Piegl, W. Tiller, The NURBS Book, chapters 3 and 4; eq. 7 of Lee et al. (2014).
    """

    degree_u: int
    degree_v: int
    knots_u: Array
    knots_v: Array
    poles: Array
    weights: Array | None = None

    def __post_init__(self) -> None:
        nu, nv = len(self.knots_u) - self.degree_u - 1, len(self.knots_v) - self.degree_v - 1
        if self.poles.shape != (nu, nv, 3):
            raise SurfaceError(f"a surface of degree {self.degree_u} × {self.degree_v} on {len(self.knots_u)} × "
                               f"{len(self.knots_v)} knots has {nu} × {nv} poles, not {self.poles.shape}")
        if not all(np.isfinite(a).all() for a in (self.knots_u, self.knots_v, self.poles)):
            raise SurfaceError("a surface's knots and poles must be finite")
        for array in (self.knots_u, self.knots_v, self.poles, self.weights):
            if array is not None:
                array.setflags(write=False)

    @cached_property
    def domain(self) -> tuple[float, float, float, float]:
        """(u_min, u_max, v_min, v_max)."""
        p, q = self.degree_u, self.degree_v
        return (float(self.knots_u[p]), float(self.knots_u[-p - 1]), float(self.knots_v[q]), float(self.knots_v[-q - 1]))

    def __repr__(self) -> str:
        u_min, u_max, v_min, v_max = self.domain
        spans = " × ".join(str(len(np.unique(knots)) - 1) for knots in (self.knots_u, self.knots_v))
        kind = "" if self.weights is None else "rational, "
        return (f"<BSplineSurface: {kind}degree {self.degree_u} × {self.degree_v}, {spans} spans, u {u_min:g} to {u_max:g}, "
                f"v {v_min:g} to {v_max:g}>")

    @cached_property
    def is_height_field(self) -> bool:
        """Whether u = x and v = y everywhere, so that the surface is a sag z(x, y): so are the mirrors that are designed here.

        A coordinate is linear in a parameter exactly where its poles stand at the Greville abscissae.
        """
        if self.weights is not None:
            return False
        x = greville_abscissae(self.knots_u, self.degree_u)[:, None]
        y = greville_abscissae(self.knots_v, self.degree_v)[None, :]
        return bool(np.abs(self.poles[..., 0] - x).max() <= PARAMETER_ROUNDING_MM
                    and np.abs(self.poles[..., 1] - y).max() <= PARAMETER_ROUNDING_MM)

    def u_reversed(self) -> BSplineSurface:
        """S(−u, v): the same points, with the first parameter run backwards."""
        weights = None if self.weights is None else np.ascontiguousarray(self.weights[::-1])
        return BSplineSurface(self.degree_u, self.degree_v, -self.knots_u[::-1], self.knots_v,
                              np.ascontiguousarray(self.poles[::-1]), weights)

    def sag(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Evaluate the height z at (x, y).

        Parameters
        ----------
        x, y : array_like
            mm, of shapes that broadcast.

        Returns
        -------
        ndarray
            (…) mm; negative away from the centre of a convex mirror. A number for numbers.

        Raises
        ------
        SurfaceError
            For a surface that is no height field over its parameters, and outside it.
        """
        self._check_height_field("sag")
        return self._derivatives(x, y, 0, component=2)[..., 0, 0, 0][()]

    def normal(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Evaluate the unit normal at (x, y), towards the driver.

        Parameters
        ----------
        x, y : array_like
            mm, of shapes that broadcast.

        Returns
        -------
        ndarray
            (…, 3), z > 0.

        Raises
        ------
        SurfaceError
            As `sag`.
        """
        self._check_height_field("normal")
        _, z_x, z_y = self.heights(x, y)
        n = np.stack([-z_x, -z_y, np.ones_like(z_x)], axis=-1)
        return n / lengths(n)[..., None]

    def principal_curvatures(self, x: ArrayLike, y: ArrayLike) -> Array:
        """Evaluate the principal curvatures at (x, y), the eigenvalues of the shape operator.

        Parameters
        ----------
        x, y : array_like
            mm, of shapes that broadcast.

        Returns
        -------
        ndarray
            (…, 2) 1/mm, convex positive, larger first.

        Raises
        ------
        SurfaceError
            As `sag`.

        References
        ----------
        M. do Carmo, Differential Geometry of Curves and Surfaces, section 3-2.
        """
        self._check_height_field("principal_curvatures")
        return principal_curvatures(self, x, y)

    def _check_height_field(self, what: str) -> None:
        if not self.is_height_field:
            raise SurfaceError(f"this surface is no height field over its parameters (u is not x, or v is not y): {what}(x, y) "
                               "is not defined; evaluate it at its parameters with `evaluate` and `derivatives`, or "
                               "mirror_cad.surfaces.differential.principal_curvatures(surface, u, v)")

    def evaluate(self, u: ArrayLike, v: ArrayLike) -> Array:
        """Points S(u, v).

        Parameters
        ----------
        u, v : array_like
            Of shapes that broadcast.

        Returns
        -------
        ndarray
            (…, 3), mm.

        Raises
        ------
        SurfaceError
            For parameters outside the domain.
        """
        return self._derivatives(u, v, 0)[..., 0, 0, :]

    def derivatives(self, u: ArrayLike, v: ArrayLike) -> dict[str, Array]:
        """S, S_u, S_v, S_uu, S_uv, S_vv at (u, v).

        Parameters
        ----------
        u, v : array_like
            Of shapes that broadcast.

        Returns
        -------
        dict
            Each (…, 3), under the keys "s", "u", "v", "uu", "uv", "vv".

        Raises
        ------
        SurfaceError
            For parameters outside the domain.
        """
        d = self._derivatives(u, v, 2)
        return {key: d[..., i, j, :] for key, (i, j) in ORDERS.items()}

    def heights(self, u: ArrayLike, v: ArrayLike) -> tuple[Array, Array, Array]:
        """z, z_u, z_v: all that a surface with u = x, v = y has besides x and y, at a quarter of the work.

        Parameters
        ----------
        u, v : array_like
            Of shapes that broadcast.

        Returns
        -------
        tuple of ndarray
            Each of the common shape, mm.
        """
        if self.weights is not None:
            raise SurfaceError("one coordinate alone is not defined by the poles of a rational surface")
        d = self._derivatives(u, v, 1, component=2)[..., 0]
        return d[..., 0, 0], d[..., 1, 0], d[..., 0, 1]

    def on_grid(self, u: Array, v: Array, component: int | None = None, order: int = 2) -> dict[str, Array]:
        """`derivatives` up to an order on a tensor grid, by a few matrix products.

        Parameters
        ----------
        u, v : ndarray
            (m,) and (n,).
        component : int, optional
            0, 1 or 2 gives that coordinate alone; only where there are no weights.
        order : int
            0 to 2.

        Returns
        -------
        dict
            As `derivatives` gives them, each (m, n, 3), or (m, n) of one component.
        """
        bu, bv = dense_basis(self.knots_u, self.degree_u, u, order), dense_basis(self.knots_v, self.degree_v, v, order)
        orders = {key: (i, j) for key, (i, j) in ORDERS.items() if i + j <= order}
        if component is not None:
            if self.weights is not None:
                raise SurfaceError("one coordinate alone is not defined by the poles of a rational surface")
            along_u = bu @ self.poles[..., component]
            return {key: along_u[i] @ bv[j].T for key, (i, j) in orders.items()}
        homogeneous = self._homogeneous()
        parts = {key: np.einsum("ai,ijc,bj->abc", bu[i], homogeneous, bv[j], optimize=True) for key, (i, j) in orders.items()}
        if self.weights is None:
            return parts
        size = 1 if order == 0 else 3  # of what _project takes
        stacked = np.zeros((len(u), len(v), size, size, 4))
        for key, (i, j) in orders.items():
            stacked[:, :, i, j] = parts[key]
        quotient = _project(stacked)
        return {key: quotient[:, :, i, j] for key, (i, j) in orders.items()}

    def _homogeneous(self) -> Array:
        if self.weights is None:
            return self.poles
        return np.concatenate([self.poles * self.weights[..., None], self.weights[..., None]], axis=2)

    def _derivatives(self, u: ArrayLike, v: ArrayLike, order: int, component: int | None = None) -> Array:
        u, v = np.broadcast_arrays(np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64))
        shape = u.shape
        u, v = u.ravel(), v.ravel()
        self._check_domain(u, v)
        homogeneous = self._homogeneous()
        channel, channels = (0, homogeneous.shape[2]) if component is None else (component, 1)
        out = np.empty((u.size, order + 1, order + 1, channels))
        for start in range(0, u.size, CHUNK):
            part = slice(start, start + CHUNK)
            first_u, bu = basis_functions(self.knots_u, self.degree_u, u[part], order)
            first_v, bv = basis_functions(self.knots_v, self.degree_v, v[part], order)
            _contract(first_u, bu, first_v, bv, homogeneous, channel, out[part])
        if self.weights is not None:
            out = _project(out)
        return out.reshape((*shape, *out.shape[1:]))

    def _check_domain(self, u: Array, v: Array) -> None:
        u_min, u_max, v_min, v_max = self.domain
        # A parameter computed at the very edge may sit a few units of rounding outside.
        slack = 1e-12
        du, dv = slack * (u_max - u_min), slack * (v_max - v_min)
        outside = ~((u >= u_min - du) & (u <= u_max + du) & (v >= v_min - dv) & (v <= v_max + dv))
        if outside.any():
            i = int(np.flatnonzero(outside)[0])
            raise SurfaceError(f"the surface has no point at (u, v) = ({u[i]:.6g}, {v[i]:.6g}): it reaches from "
                               f"({u_min:.6g}, {v_min:.6g}) to ({u_max:.6g}, {v_max:.6g})")


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _contract(first_u: NDArray[np.int64], bu: Array, first_v: NDArray[np.int64], bv: Array, poles: Array, channel: int,
              out: Array) -> None:
    """out[n, a, b, c] = Σ_ij bu[n, a, i]·bv[n, b, j]·poles[first_u + i, first_v + j, channel + c]."""
    for n in range(out.shape[0]):
        out[n] = 0.0
        for a in range(bu.shape[1]):
            for j in range(bv.shape[2]):
                for c in range(out.shape[3]):
                    along = 0.0
                    for i in range(bu.shape[2]):
                        along += bu[n, a, i] * poles[first_u[n] + i, first_v[n] + j, channel + c]
                    for b in range(bv.shape[1]):
                        out[n, a, b, c] += along * bv[n, b, j]


def _project(h: Array) -> Array:
    """Derivatives of the quotient from those of numerator and weight, (…, a, b, 4) -> (…, a, b, 3), order 0 or 2."""
    out = np.zeros((*h.shape[:-1], 3))
    w = h[..., 3:]
    w0 = w[..., 0, 0, :]
    out[..., 0, 0, :] = h[..., 0, 0, :3] / w0
    if h.shape[-2] == 1:
        return out
    s = out[..., 0, 0, :]
    out[..., 1, 0, :] = (h[..., 1, 0, :3] - w[..., 1, 0, :] * s) / w0
    out[..., 0, 1, :] = (h[..., 0, 1, :3] - w[..., 0, 1, :] * s) / w0
    su, sv = out[..., 1, 0, :], out[..., 0, 1, :]
    out[..., 2, 0, :] = (h[..., 2, 0, :3] - 2.0 * w[..., 1, 0, :] * su - w[..., 2, 0, :] * s) / w0
    out[..., 0, 2, :] = (h[..., 0, 2, :3] - 2.0 * w[..., 0, 1, :] * sv - w[..., 0, 2, :] * s) / w0
    out[..., 1, 1, :] = (h[..., 1, 1, :3] - w[..., 1, 0, :] * sv - w[..., 0, 1, :] * su - w[..., 1, 1, :] * s) / w0
    return out
