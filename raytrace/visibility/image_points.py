"""Where a mirror shows points of the world, and directions of what is far away: Newton on exact rays."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from raytrace.kernels import image_points as kernel
from raytrace.kernels import sheet_image_points
from raytrace.kernels.eye_rays import NONE, rays_to
from raytrace.kernels.sheet import Sheet, surface_points
from raytrace.parallel import parallel_for
from raytrace.surfaces.base import Box, OpticalSurface
from raytrace.trace import reflect
from raytrace.viewing.view import View

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

# An image point is found when its reflected ray passes the target by less: far above rounding, and 2e-5″. Newton goes on to
# DIRECTION_RAD, or until no step betters it, so that what is found does not hang on how it was found.
PASSES_BY = 1e-10
DIRECTION_RAD = 1e-13  # a few roundings of a direction
MAX_STEPS = 40
SMALLEST_STEP = 1e-12  # of the mirror's width
HALVED_TO = 1e-3  # of Newton's own step: where even that betters nothing, the sheet ends or folds
LONGEST_STEP = 0.25  # of the mirror's width
START_GRID = 33  # rays a direction
BEYOND = 0.1  # of the box, on every side: what Newton may start from beside the mirror
# Of what is followed from near by: rays that facets turn in steps of as much are the nearest that there are.
FOLLOWED_BY = 0.02
MAX_FOLLOWING_STEPS = 12


def image_points(view: View, targets: Array, at_infinity: bool = False) -> tuple[Array, Mask]:
    """Find the points of the picture plane at which the mirror shows points of the world, or infinitely far directions.

    The eye's ray through such a point is reflected through the target: by Newton, with one ray a step and its differentials,
    from the nearest of a grid of rays. Where a mirror shows a target more than once, one of them is found
    (`raytrace.visibility.orientation`). What stands between mirror and target is not looked at. Of targets nearer to the mirror
    than 4 mm, whose image runs over it fast, one in a hundred is missed.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    targets : (n, 3), mm, in vehicle coordinates; or directions of any length.
    at_infinity : whether they are directions.

    Returns
    -------
    points : (n, 2), mm, of the picture plane; NaN where the sheet shows the target nowhere.
    shown : (n,), whether the mirror itself does, inside its outline.

    References
    ----------
    docs/derivations/what-the-eye-sees.md
    """
    found, shown = np.full((len(targets), 2), np.nan), np.zeros(len(targets), dtype=np.bool_)
    if len(targets) == 0:
        return found, shown
    wanted = targets / np.linalg.norm(targets, axis=1, keepdims=True) if at_infinity else targets
    at, leaving, passes = _solve(view.untrimmed, _nearest(view, wanted, at_infinity), wanted, at_infinity, MAX_STEPS)
    index = np.flatnonzero(passes <= PASSES_BY)
    found[index] = at[index]
    shown[index] = shown_inside(view, leaving[index], found[index])
    return found, shown


def shown_inside(view: View, on_mirror: Array, on_plane: Array | None = None) -> Mask:
    """Whether the mirror itself shows what its sheet does, inside its outline and with nothing before it.

    Parameters
    ----------
    view : the mirror as the eye sees it.
    on_mirror : (n, 3), mm, in mirror coordinates: where the eye's rays leave the sheet.
    on_plane : (n, 2), mm, of the picture plane, that these rays go through; without them they are worked out.

    Returns
    -------
    (n,).
    """
    sheet = view.reflector.surface.sheet if view.reflector.obstacles is None else None
    if sheet is not None:
        return sheet.strips.contain(*on_mirror[:, :2].T)
    return view.trace_points(view.on_plane_of(on_mirror) if on_plane is None else on_plane).seen


def follow_image_points(view: View, starts: Array, targets: Array, at_infinity: bool = False) -> tuple[Array, Array]:
    """Find image points of targets from points near them, by the same Newton.

    A mirror that shows nothing beyond its edge is followed as far as it goes, and one of facets to the nearest that they show.

    Parameters
    ----------
    view : asked as it is, trimmed or not.
    starts : (n, 2), mm, of the picture plane.
    targets, at_infinity : as in `image_points`; directions are units.

    Returns
    -------
    points : (n, 2), mm, of the picture plane; NaN where nothing near is shown.
    leaving : (n, 3), mm, where their rays leave the mirror, in vehicle coordinates.
    """
    at, leaving, passes = _solve(view, starts, targets, at_infinity, MAX_FOLLOWING_STEPS)
    lost = ~(passes < FOLLOWED_BY)
    at[lost], leaving[lost] = np.nan, np.nan
    return at, view.pose.to_vehicle(leaving)


def _solve(view: View, starts: Array, targets: Array, at_infinity: bool, max_steps: int) -> tuple[Array, Array, Array]:
    """The best points (n, 2) that Newton reaches, where their rays leave the mirror (n, 3), and by how much they pass (n,)."""
    n, size, eye, reflector = len(starts), view.box[1] - view.box[0], view.eye_in_mirror, view.reflector
    wanted = np.ascontiguousarray(view.pose.directions_to_mirror(targets) if at_infinity else view.pose.to_mirror(targets))
    sheet = reflector.surface.sheet
    if sheet is not None and reflector.obstacles is None:
        return solve_on_sheet(sheet, eye[None], NONE, starts, wanted, at_infinity, max_steps, size)
    best, kept, leaving = np.full(n, np.inf), starts.copy(), np.full((n, 3), np.nan)
    # Of the rays that are still going: which they are, where they are, their last steps and how short these may become.
    going = np.flatnonzero(np.isfinite(starts).all(axis=1) & np.isfinite(wanted).all(axis=1))
    at, steps, shortest = starts[going], np.zeros((len(going), 2)), np.zeros(len(going))
    for _ in range(max_steps):
        m = len(going)
        if m == 0:
            break
        rays, turns, missed = np.empty((m, 3)), np.empty((m, 2, 3)), np.empty((m, 2))
        axes, reach, moving = np.empty((m, 2, 3)), np.empty(m), np.empty(m, dtype=np.int8)
        kernel.rays_through(eye, at, rays, turns)
        trace = reflect(reflector, eye, rays)
        kernel.misses(eye, wanted[going], at_infinity, trace.points, trace.directions, missed, axes, reach)
        count = kernel.keep_best(going, missed, at, trace.points, DIRECTION_RAD, PASSES_BY, best, kept, leaving, steps, moving)
        if count:
            part = slice(None) if count == m else np.flatnonzero(moving == 1)
            along = steps[part]
            kernel.newton_steps(missed[part], axes[part], reach[part], *reflector.surface.ray_differentials(
                eye, rays[part], turns[part], trace.points[part], trace.directions[part]), LONGEST_STEP * size, along)
            steps[part], shortest[part] = along, HALVED_TO * np.abs(along).max(axis=1)
        on = np.flatnonzero((moving > 0) & (np.abs(steps).max(axis=1) > np.maximum(SMALLEST_STEP * size, shortest)))
        going, steps, shortest = going[on], steps[on], shortest[on]
        at = kept[going] + steps
    return kept, leaving, best


def solve_on_sheet(sheet: Sheet, eyes: Array, of: Index, starts: Array, wanted: Array, at_infinity: bool, max_steps: int,
                   size_mm: float) -> tuple[Array, Array, Array]:
    """`sheet_image_points.image_points` with the numbers of this file; `size_mm` : the mirror's width."""
    return sheet_image_points.image_points(sheet, eyes, of, np.ascontiguousarray(starts), wanted, at_infinity, max_steps,
                                           DIRECTION_RAD, PASSES_BY, SMALLEST_STEP * size_mm, LONGEST_STEP * size_mm, HALVED_TO)


@lru_cache(maxsize=8)
def _start_rays(view: View) -> tuple[Array, Array, Array]:
    """Points (m, 2) of a grid over the mirror and beside it, those that the sheet reflects at, and their rays.

    Where these leave, (m, 3), and their unit directions then.
    """
    untrimmed = view.untrimmed
    sheet = untrimmed.reflector.surface.sheet
    if sheet is not None:  # the points of the sheet itself over the grid: the same for every eye
        surface = grid_on_sheet(untrimmed.reflector.surface, view.box)
        direct = rays_to(sheet, view.posed, surface)
        if direct is not None:
            return direct
    x, y = _start_grid(view.box)
    starts = view.on_plane_of(np.stack([x, y, np.zeros(x.size)], axis=1))
    traced = untrimmed.trace_points(starts)
    seen = traced.seen
    return starts[seen], traced.points[seen], traced.directions[seen]


def _start_grid(box: Box) -> tuple[Array, Array]:
    x_min, x_max, y_min, y_max = box
    more_x, more_y = BEYOND * (x_max - x_min), BEYOND * (y_max - y_min)
    x, y = np.meshgrid(np.linspace(x_min - more_x, x_max + more_x, START_GRID),
                       np.linspace(y_min - more_y, y_max + more_y, START_GRID))
    return x.ravel(), y.ravel()


@lru_cache(maxsize=8)
def grid_on_sheet(surface: OpticalSurface, box: Box) -> Array:
    """The start grid as `raytrace.kernels.sheet.surface_points` has it, without what lies beside the sheet."""
    at = np.stack(_start_grid(box), axis=1)
    assert surface.sheet is not None
    found = surface_points(surface.sheet, at)
    return found[(found[:, :2] == at).all(axis=1)]


def _nearest(view: View, targets: Array, at_infinity: bool) -> Array:
    """Find the points (n, 2) of the grid whose rays pass nearest to targets (n, 3).

    At infinity, those that leave most nearly along unit directions (n, 3). NaN where the mirror reflects nothing.
    """
    starts, points, directions = _start_rays(view)
    if len(starts) == 0:
        return np.full((len(targets), 2), np.nan)
    index = np.empty(len(targets), dtype=np.intp)
    parallel_for(lambda i, j: kernel.nearest_rays(targets[i:j], at_infinity, points, directions, index[i:j]), len(targets))
    return starts[index]
