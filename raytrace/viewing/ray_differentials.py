"""How the rays of an eye leave a mirror when the eye turns a little, and how much smaller that makes what is seen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mirror_cad.vectors import cross
from raytrace.kernels import sheet_differentials as kernel
from raytrace.viewing.view import View

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class RayDifferentials:
    """How the rays through n points of the picture plane leave when the eye turns a little. Rows that show nothing are NaN.

    Both the eye's ray and the one that leaves have a frame across them: to the right as one looks along the ray, level, and
    upward from there (`frame`). With ω the eye's direction, d the reflected one and P where the ray leaves the mirror:

    Attributes
    ----------
    jacobian : (n, 2, 2), ∂d/∂ω from the eye's frame to that of d, pure numbers; orthogonal for a flat mirror.
    shift : (n, 2, 2), the part of ∂P/∂ω across d, mm a radian; `path_mm` times an orthogonal matrix where there is no glass.
    path_mm : (n,), mm, from the eye to P, straight.
    seen : (n,), whether the mirror shows anything there.

    References
    ----------
    H. Igehy, Tracing ray differentials (1999); docs/derivations/what-the-eye-sees.md.
    """

    jacobian: Array
    shift: Array
    path_mm: Array
    seen: Mask

    def at(self, distance_mm: float = np.inf) -> Magnification:
        """Compute the magnification of small objects across the ray.

        A far object of extent e (radians) is seen with the extent J⁻¹·e; one of e mm at the distance D with
        (shift + D·J)⁻¹·e. A flat mirror at the same place shows |e|, or |e|/(a + D), a being `path_mm`.

        Parameters
        ----------
        distance_mm : D, mm, from where the ray leaves the mirror; far objects by default.

        Returns
        -------
        Magnification
            Of the n rays.
        """
        if np.isinf(distance_mm):
            return magnification_of(self.jacobian)
        reach = (self.path_mm + distance_mm)[:, None, None]
        return magnification_of((self.shift + distance_mm * self.jacobian) / reach)

    @cached_property
    def widening(self) -> Array:
        """√|det J|, (n,): times as wide, in the mean of its directions, is a narrow cone from the eye once reflected."""
        return np.sqrt(np.abs(_determinant(self.jacobian)))


@dataclass(frozen=True, slots=True, eq=False)
class Magnification:
    """Seen size over the size that a flat mirror at the same place would show; NaN where nothing is shown.

    Attributes
    ----------
    horizontal, vertical : of small objects that lie level and across the ray, and upright from there.
    area : of the solid angle; its root is the mean of the directions.
    """

    horizontal: Array
    vertical: Array
    area: Array

    @property
    def ratio(self) -> Array:
        """Horizontal over vertical: below 1, things look slimmer than they are."""
        return self.horizontal / self.vertical


def ray_differentials(view: View, on_plane: Array) -> RayDifferentials:
    """Differentiate the rays through points of the picture plane by the eye's direction.

    In closed form where the surface's shape operator is known, else by differences of exact rays: one surface, one answer
    (`OpticalSurface.ray_differentials`). A mesh stands for the smooth surface that its vertices lie on.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    on_plane : (n, 2), mm, of the picture plane.

    Returns
    -------
    RayDifferentials
        Of the n rays, NaN for those that the mirror does not reflect.
    """
    view = view.interpolated
    sheet = view.reflector.surface.sheet if view.reflector.obstacles is None else None
    if sheet is not None:
        return RayDifferentials(*kernel.ray_differentials(sheet, view.eye_in_mirror, np.ascontiguousarray(on_plane),
                                                          view.pose.rotation))
    n = len(on_plane)
    jacobian, shift, path = np.full((n, 2, 2), np.nan), np.full((n, 2, 2), np.nan), np.full(n, np.nan)
    traced = view.trace_points(on_plane)
    index = np.flatnonzero(traced.seen)
    if index.size:
        pose, rays, directions = view.pose, view.towards(on_plane[index]), traced.directions[index]
        by_points, by_directions = view.reflector.surface.ray_differentials(
            view.eye_in_mirror, pose.directions_to_mirror(rays), pose.directions_to_mirror(np.stack(frame(rays), axis=1)),
            traced.on_mirror[index], pose.directions_to_mirror(directions))
        across = pose.directions_to_mirror(np.stack(frame(directions), axis=1))
        jacobian[index] = np.einsum("nik,njk->nij", across, by_directions)
        shift[index] = np.einsum("nik,njk->nij", across, by_points)
        path[index] = np.linalg.norm(traced.points[index] - view.eye, axis=1)
    return RayDifferentials(jacobian, shift, path, traced.seen)


def frame(directions: Array) -> tuple[Array, Array]:
    """To the right, level, and upward, as one looks along unit directions (n, 3): unit, across them, (n, 3) each.

    r = d × Z/|d × Z|, u = r × d; NaN along Z.
    """
    with np.errstate(invalid="ignore"):
        right = np.stack([directions[:, 1], -directions[:, 0], np.zeros(len(directions))], axis=1)
        right /= np.linalg.norm(right, axis=1, keepdims=True)
    return right, cross(right, directions)


def _determinant(matrix: Array) -> Array:
    result: Array = matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] * matrix[..., 1, 0]
    return result


def magnification_of(jacobian: Array) -> Magnification:
    """Compute the magnification of far objects: lengths of J⁻¹·(1, 0) and J⁻¹·(0, 1), and 1/|det J|.

    Parameters
    ----------
    jacobian : (…, 2, 2), J, as `RayDifferentials` has it.

    Returns
    -------
    Magnification
        Its arrays (…,).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        area = 1.0 / np.abs(_determinant(jacobian))
        return Magnification(np.hypot(jacobian[..., 1, 1], jacobian[..., 1, 0]) * area,
                             np.hypot(jacobian[..., 0, 1], jacobian[..., 0, 0]) * area, area)
