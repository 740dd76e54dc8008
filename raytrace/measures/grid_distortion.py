"""Distortion of a 1° grid of the far world against a flat mirror's picture, magnified."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from raytrace.measures.in_use import MirrorInUse
from raytrace.measures.registry import Measure, register
from raytrace.viewing.eye_views import picture_grid
from raytrace.viewing.view import View
from raytrace.visibility.image_points import image_points

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ARCMIN = float(np.degrees(1.0)) * 60.0
STEP_DEG = 1.0
# A node farther than this from the middle of what is shown would be seen beyond the edge of any picture on a plane.
WIDEST = np.radians(60.0)
LOOK = 65  # rays a direction that say which part of the world is shown
BESIDE = 2.0  # of the mean distance of their directions: how much farther the outermost may be from the edge's
MIN_NODES = 7  # one more than an affine map in two directions needs, in threes: fewer say nothing of what is left


@dataclass(frozen=True, slots=True, eq=False)
class GridDistortion:
    """A grid of far directions as the mirror shows it, and how far that is from an affine map of a flat mirror's picture.

    Figures over all are None where fewer than MIN_NODES nodes are shown. Percents are of the field's diagonal as seen, from
    corner to corner of the nodes' box.

    Attributes
    ----------
    azimuth_deg, elevation_deg : (m,) and (n,), degrees, of the grid's lines; azimuths from straight rearward, positive to the
        right of the vehicle.
    on_plane : (n, m, 2), mm, of the picture plane, where each node is seen, also beside the outline where its sheet goes on;
        its rows and columns are the grid's lines.
    shown : (n, m), which nodes lie inside.
    residual_arcmin : (n, m), arc minutes, angle at the eye between where a node is seen and where the affine map has it; NaN
        for nodes that are not shown.
    affine : (2, 3), the map, from the tangents (right, up, 1) of a flat mirror's picture.
    rms_arcmin, max_arcmin : RMS and largest residual, arc minutes, over the nodes shown.
    max_at_deg : (azimuth, elevation) of the largest, degrees.
    rms_percent, max_percent : the same two, percent.
    """

    azimuth_deg: Array
    elevation_deg: Array
    on_plane: Array
    shown: Mask
    residual_arcmin: Array
    affine: Array | None = None
    rms_arcmin: float | None = None
    max_arcmin: float | None = None
    max_at_deg: tuple[float, float] | None = None
    rms_percent: float | None = None
    max_percent: float | None = None


def grid_distortion(view: View, step_deg: float = STEP_DEG) -> GridDistortion:
    """Measure the distortion of a grid of far directions against a flat mirror's picture, affinely magnified.

    Let the eye look along u0 at the middle of the mirror's box, and the ray leave along d0. A flat mirror there would show the
    direction d where its mirror image d* is, d* = d − 2(d·n)n with n along d0 − u0. On the plane across u0 it would be seen
    at the tangents t(d*), and the mirror shows it at t(u). The affine map A with the least Σ|t(u) − A·t(d*)|² takes out
    magnification, different ones across and upright too, and turning; the residual is the angle between u and the
    direction that A has the node in. A flat mirror has none, and none is left only where straight lines stay straight.
    It is the distortion of a lens against a perspective picture (ISO 9039), with a map of six numbers for the scale.
    Nodes farther than WIDEST from d0 do not count. What the host vehicle hides is not looked at. A mesh stands for the smooth
    surface that its vertices lie on.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    step_deg : degrees between the grid's lines, in azimuth and in elevation.

    Returns
    -------
    GridDistortion
        Without figures where fewer than MIN_NODES nodes are shown.

    References
    ----------
    ISO 9039, Optics and photonics: quality evaluation of optical systems, determination of distortion.
    """
    view = view.interpolated
    looked = picture_grid(view, LOOK).reshape(-1, 2)
    traced = view.trace_points(looked)
    reflected, seen = traced.directions[traced.seen], view.towards(looked[traced.seen])
    nothing = np.empty(0)
    if len(reflected) == 0:
        return GridDistortion(nothing, nothing, np.empty((0, 0, 2)), np.empty((0, 0), dtype=np.bool_), np.empty((0, 0)))
    u0, d0 = _middle(view)
    if not np.isfinite(d0).all():  # a hole
        nearest = int(np.argmax(seen @ seen.mean(axis=0)))
        u0, d0 = seen[nearest], reflected[nearest]
    near = reflected[reflected @ d0 > np.cos(WIDEST)]
    azimuth = _lines(np.arctan2(near[:, 1], near[:, 0]), step_deg)
    elevation = _lines(np.arcsin(near[:, 2]), step_deg)
    at_azimuth, at_elevation = np.meshgrid(np.radians(azimuth), np.radians(elevation))
    nodes = np.stack([np.cos(at_elevation) * np.cos(at_azimuth), np.cos(at_elevation) * np.sin(at_azimuth),
                      np.sin(at_elevation)], axis=-1).reshape(-1, 3)
    on_plane, shown = image_points(view, nodes, at_infinity=True)
    shown &= nodes @ d0 > np.cos(WIDEST)
    shape = (len(elevation), len(azimuth))
    residual = np.full(len(nodes), np.nan)
    empty = GridDistortion(azimuth, elevation, on_plane.reshape(*shape, 2), shown.reshape(shape), residual.reshape(shape))
    if shown.sum() < MIN_NODES:
        return empty
    normal = (d0 - u0) / np.linalg.norm(d0 - u0)
    right = np.cross(u0, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    across = np.stack([right, np.cross(right, u0)], axis=1)

    def tangents(directions: Array) -> Array:
        result: Array = (directions @ across) / (directions @ u0)[:, None]
        return result

    flat = nodes[shown] - 2.0 * (nodes[shown] @ normal)[:, None] * normal
    given = np.concatenate([tangents(flat), np.ones((len(flat), 1))], axis=1)
    wanted = view.towards(on_plane[shown])
    at = tangents(wanted)
    affine, _, rank, _ = np.linalg.lstsq(given, at, rcond=None)
    if rank < 3:
        return empty
    mapped = u0 + given @ affine @ across.T
    mapped /= np.linalg.norm(mapped, axis=1, keepdims=True)
    off = 2.0 * ARCMIN * np.arcsin(0.5 * np.linalg.norm(wanted - mapped, axis=1))
    residual[shown] = off
    diagonal = ARCMIN * 2.0 * float(np.arctan(0.5 * np.linalg.norm(at.max(axis=0) - at.min(axis=0))))
    rms, worst = float(np.sqrt(np.mean(off**2))), int(np.argmax(off))
    row, column = np.unravel_index(np.flatnonzero(shown)[worst], shape)
    return GridDistortion(azimuth, elevation, empty.on_plane, empty.shown, residual.reshape(shape), affine.T, rms,
                          float(off[worst]), (float(azimuth[column]), float(elevation[row])), 100.0 * rms / diagonal,
                          100.0 * float(off[worst]) / diagonal)


def _middle(view: View) -> tuple[Array, Array]:
    """The direction in which the eye sees the middle of the mirror's box, and that of the ray when it leaves, (3,)."""
    x_min, x_max, y_min, y_max = view.box
    place = view.on_plane_over(np.array([0.5 * (x_min + x_max)]), np.array([0.5 * (y_min + y_max)]))
    return view.towards(place)[0], view.trace_points(place).directions[0]


def _lines(angles: Array, step_deg: float) -> Array:
    """Multiples of the step, degrees, that cover angles (n,), radians, and what lies beside them.

    Beside them is as far as the rays that were looked at are apart, some times over.
    """
    low, high = float(np.degrees(angles.min())), float(np.degrees(angles.max()))
    beside = BESIDE * (high - low) / (LOOK - 1)
    return step_deg * np.arange(np.floor((low - beside) / step_deg), np.ceil((high + beside) / step_deg) + 1.0)


def distortion_in_use(use: MirrorInUse) -> GridDistortion:
    """`grid_distortion` of a mirror in use, from between the eyes, 1° apart."""
    return grid_distortion(use.on_vehicle.views.middle)


register(Measure("grid_distortion_rms_arcmin", "distortion of the 1° grid, RMS", "′", 1,
                 "root mean square of the angles, at the eye, between the images of the grid's points and the affine map of "
                 "the grid that fits them best",
                 lambda use: use.record(distortion_in_use).rms_arcmin, group="Straightness", better="less"))
register(Measure("grid_distortion_max_arcmin", "distortion of the 1° grid, largest", "′", 1,
                 "largest angle, at the eye, between the image of a point of the grid and the affine map of the grid that "
                 "fits best",
                 lambda use: use.record(distortion_in_use).max_arcmin, group="Straightness", better="less"))
