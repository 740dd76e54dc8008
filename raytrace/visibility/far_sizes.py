"""Where a mirror shows far directions to an eye and how large, from places near by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels import far_sizes as kernel
from raytrace.viewing.ray_differentials import Magnification, magnification_of, ray_differentials
from raytrace.viewing.view import Mask, View
from raytrace.visibility.image_points import (
    DIRECTION_RAD,
    LONGEST_STEP,
    PASSES_BY,
    follow_image_points,
    image_points,
    shown_inside,
)

Array = NDArray[np.float64]


def far_sizes(view: View, directions: Array, around: Array, near: Array) -> tuple[Magnification, Mask]:
    """Find the magnification of far directions where an eye sees them, and of others beside each.

    Newton on exact rays: on one bare sheet from places near by, in one call for all, else and where that does not settle as
    `image_points` and `follow_image_points` find them.

    Parameters
    ----------
    view : the mirror as the eye sees it, without facets.
    directions : (n, 3), unit, in vehicle coordinates.
    around : (k, n, 3), others near them; NaN for what is not asked.
    near : (n, 2), mm, (x, y) on the surface near to where the directions are seen; NaN where none is known.

    Returns
    -------
    sizes : each of its arrays ((1 + k), n); NaN where the sheet shows a direction nowhere.
    shown : (n,), whether the mirror shows the first inside its outline.
    """
    k = len(around)
    leaving, jacobian = _followed(view, directions, around, near)
    shown = np.zeros(len(directions), dtype=np.bool_)
    missing = np.isnan(leaving[:, 0])
    found, left = np.flatnonzero(~missing), np.flatnonzero(missing & np.isfinite(directions).all(axis=1))
    shown[found] = shown_inside(view, leaving[found])
    if left.size:
        on_plane, shown[left] = image_points(view, directions[left], at_infinity=True)
        beside, wanted = np.tile(on_plane, (k, 1)), around[:, left].reshape(-1, 3)
        known = np.isfinite(beside).all(axis=1) & np.isfinite(wanted).all(axis=1)
        beside[~known] = np.nan
        if known.any():
            beside[known], _ = follow_image_points(view.untrimmed, beside[known], wanted[known], at_infinity=True)
        turned = ray_differentials(view.untrimmed, np.concatenate([on_plane, beside]))
        jacobian[:, left] = turned.jacobian.reshape(1 + k, -1, 2, 2)
    return magnification_of(jacobian), shown


def far_points(view: View, directions: Array, near: Array) -> tuple[Array, Mask]:
    """Find where on the surface an eye sees far directions, as `far_sizes` does.

    Parameters
    ----------
    view, directions, near : as for `far_sizes`.

    Returns
    -------
    at : (n, 2), mm, (x, y) on the surface, without glass before it; NaN where the sheet shows a direction nowhere.
    shown : (n,), whether the mirror shows it inside its outline.
    """
    leaving, _ = _followed(view, directions, np.empty((0, len(directions), 3)), near)
    at, shown = leaving[:, :2], shown_inside(view, leaving)
    left = np.flatnonzero(np.isnan(leaving[:, 0]) & np.isfinite(directions).all(axis=1))
    if left.size:
        on_plane, shown[left] = image_points(view, directions[left], at_infinity=True)
        at[left] = view.surface_under(on_plane)
    return at, shown


def _followed(view: View, directions: Array, around: Array, near: Array) -> tuple[Array, Array]:
    """`kernel.far_sizes` of a bare sheet; all NaN for what is none."""
    sheet = view.untrimmed.reflector.surface.sheet
    if sheet is None:
        return np.full((len(directions), 3), np.nan), np.full((1 + len(around), len(directions), 2, 2), np.nan)
    pose = view.pose
    return kernel.far_sizes(sheet, view.eye_in_mirror, pose.rotation, np.ascontiguousarray(near),
                            pose.directions_to_mirror(directions), pose.directions_to_mirror(around), DIRECTION_RAD, PASSES_BY,
                            LONGEST_STEP * (view.box[1] - view.box[0]))
