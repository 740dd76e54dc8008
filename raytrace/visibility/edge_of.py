"""Which edge an eye sees: the rim of the one face that it sees whole, or a contour of visibility."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels.eye_rays import rays_to
from raytrace.kernels.sheet import Sheet, surface_points
from raytrace.kernels.sheet_rim import Rim
from raytrace.rays import Status
from raytrace.reflector import Reflector
from raytrace.surfaces.base import BoundedFace
from raytrace.surfaces.rim import AROUND, Evaluate
from raytrace.trace import OBSTACLE_MARGIN_MM, reflect
from raytrace.viewing.view import View
from raytrace.visibility.contour import grid_over, visibility_contour
from raytrace.visibility.edge import Edge
from raytrace.visibility.shows import shows

Array = NDArray[np.float64]
Index = NDArray[np.intp]

CORNER = 0.1  # radians between two pieces of a rim
MIN_VERTICES = 16  # vertices on the smallest curve
SAME_POINT_MM = 1e-6  # a ray to a vertex of the outline meets it, and not another part of the sheet before it


@lru_cache(maxsize=8)
def edge_of(view: View) -> Edge:
    """Find the edge of what the eye of a view sees reflecting; that of the last views is kept.

    It is the rim of the one face that is seen, where there is one without glass that nothing stands before, and is looked for
    as a contour of visibility else (`visibility_contour`).

    Parameters
    ----------
    view : the mirror as the eye sees it.

    Returns
    -------
    Edge
        Without vertices where the eye sees nothing reflecting.
    """
    face = _shown_face(view)
    rim = None if face is None else _rim(face)
    if face is not None and rim is not None:
        # What is one face already has its sheet at hand.
        whole = view.untrimmed if face is view.reflector.surface else replace(view, reflector=_alone(face).untrimmed)
        sheet = whole.reflector.surface.sheet
        if sheet is not None and not _stands_before(view, rim.points):
            direct = rays_to(sheet, view.posed, _on_sheet(face))
            if direct is not None:
                return Edge(view, whole, True, True, *direct, rim.following, lambda k, t: view.on_plane_of(rim.at(k, t)),
                            (sheet, rim.pieces))
        on_plane = view.on_plane_of(rim.points)
        traced = whole.trace_points(on_plane)
        if traced.seen.all() and np.linalg.norm(traced.on_mirror - rim.points, axis=1).max() < SAME_POINT_MM \
                and not _stands_before(view, rim.points):
            return Edge(view, whole, True, True, on_plane, traced.points, traced.directions, rim.following,
                        lambda k, t: view.on_plane_of(rim.at(k, t)))
    return visibility_contour(view)


def sheet_rim_of(reflector: Reflector) -> tuple[Sheet, Rim, Array, Index] | None:
    """The whole sheet of a reflector that is one bare one, with nothing before it, and the rim that it is trimmed along.

    Its vertices (n, 5) as `surface_points` has them, and the following ones (n,). None for other reflectors.
    """
    face, faces = reflector.surface, reflector.surface.bounding_faces
    if reflector.obstacles is not None or len(faces) != 1 or faces[0] is not face:
        return None
    rim, sheet = _rim(faces[0]), reflector.untrimmed.surface.sheet
    return None if rim is None or sheet is None else (sheet, rim.pieces, _on_sheet(faces[0]), rim.following)


def _shown_face(view: View) -> BoundedFace | None:
    """The face that is all that the eye sees reflecting, with nothing before it; None where there is none."""
    reflector = view.reflector
    faces = reflector.surface.bounding_faces
    if not faces:
        return None
    if len(faces) == 1 and (reflector.obstacles is None or reflector.obstacles_behind):
        return faces[0]
    on_plane = grid_over(view).reshape(-1, 2)
    traced = view.trace_points(on_plane)
    shown = np.flatnonzero(shows(view, on_plane, traced))
    if shown.size == 0:
        return None
    rays = np.concatenate([on_plane, np.zeros((len(on_plane), 1))], axis=1) - view.eye_in_mirror
    for face in faces:
        # One ray first: most of a solid's faces are not the one.
        for asked in (shown[:1], np.arange(len(on_plane))):
            alone = reflect(_alone(face), view.eye_in_mirror, rays[asked])
            seen = alone.status == Status.REFLECTED
            if not np.array_equal(seen, np.isin(asked, shown)):
                break
            if np.linalg.norm(alone.points[seen] - traced.on_mirror[asked[seen]], axis=1).max() > SAME_POINT_MM:
                break
        else:
            return face
    return None


@lru_cache(maxsize=8)
def _alone(face: BoundedFace) -> Reflector:
    """A face that nothing stands before, with the sheet and the pieces that it is searched in, made once."""
    return Reflector(face)


def _stands_before(view: View, points: Array) -> bool:
    """Whether anything stands between the eye and points (n, 3) of the mirror, which the eye sees on the sheet alone."""
    reflector, eye = view.reflector, view.eye_in_mirror
    alone = len(reflector.surface.bounding_faces) == 1
    if alone and (reflector.obstacle_scene is None or reflector.obstacles_behind):
        return False
    rays = points - eye
    reach = np.linalg.norm(rays, axis=1)
    met = np.full(len(rays), np.inf) if alone \
        else reflect(replace(reflector, obstacles=None), eye, rays).distances
    if reflector.obstacle_scene is not None and not reflector.obstacles_behind:
        origins = np.broadcast_to(eye, rays.shape)
        met = np.fmin(met, reflector.obstacle_scene.first_hits(origins, rays / reach[:, None]).distance)
    return bool((met < reach - OBSTACLE_MARGIN_MM).any())


@dataclass(frozen=True, slots=True, eq=False)
class _Rim:
    """n vertices on the curves that bound a face, points (n, 3), and the pieces of the curves from each to the following one.

    They are `count` pieces from piece `first` on; pieces start (m, 2), end (m, 2) in (u, v).
    """

    evaluate: Evaluate
    start: Array
    end: Array
    first: Index
    count: Index
    points: Array
    following: Index

    @property
    def pieces(self) -> Rim:
        """As the kernels take it."""
        return Rim(self.start, self.end, self.first, self.count)

    def at(self, k: Index, t: Array) -> Array:
        """Points (m, 3) at shares t (m,) of the way from vertices k (m,) to the following ones, piece by piece."""
        along = t * self.count[k]
        piece = np.clip(along.astype(np.intp), 0, self.count[k] - 1)
        share, piece = (along - piece)[:, None], self.first[k] + piece
        return self.evaluate(*(self.start[piece] + share * (self.end[piece] - self.start[piece])).T)


@lru_cache(maxsize=8)
def _rim(face: BoundedFace) -> _Rim | None:
    """The rim of a face with vertices at its corners and AROUND others, evenly spread; None for a face without one."""
    if not face.rim:
        return None
    evaluate: Evaluate = face.evaluate
    low, high = face.parameter_limits
    start, end = (np.clip(np.concatenate([getattr(curve, side) for curve in face.rim]), low, high) for side in ("start", "end"))
    step = sum(float(curve.lengths.sum()) for curve in face.rim) / AROUND
    first, count, following, pieces, vertices = [], [], [], 0, 0
    for curve in face.rim:
        length = curve.lengths
        cell = np.floor((np.cumsum(length) - length) / min(step, float(length.sum()) / MIN_VERTICES))
        tangents = (np.roll(curve.points, -1, axis=0) - curve.points) / length[:, None]
        bent = np.einsum("ij,ij->i", tangents, np.roll(tangents, 1, axis=0)) < np.cos(CORNER)
        at = np.flatnonzero((cell != np.roll(cell, 1)) | bent | (np.arange(len(length)) == 0))
        first.append(pieces + at)
        count.append(np.diff(np.append(at, len(length))))
        following.append(vertices + np.roll(np.arange(len(at)), -1))
        pieces, vertices = pieces + len(length), vertices + len(at)
    begin = np.concatenate(first)
    return _Rim(evaluate, start, end, begin, np.concatenate(count), evaluate(*start[begin].T), np.concatenate(following))


@lru_cache(maxsize=8)
def _on_sheet(face: BoundedFace) -> Array:
    """The vertices of a face's rim as `raytrace.kernels.sheet.surface_points` has them: the same for every eye."""
    rim, sheet = _rim(face), face.sheet
    assert rim is not None
    assert sheet is not None
    return surface_points(sheet, rim.start[rim.first])
