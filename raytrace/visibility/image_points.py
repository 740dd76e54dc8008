"""Where a mirror shows points of the world, and directions of what is far away: Newton on exact rays."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from raytrace.viewing.view import TracedRays, View

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

# An image point is found when its reflected ray passes the target by less: far above rounding, and 2e-5″. Newton goes on to
# SETTLED, or until no step betters it, so that what is found does not hang on how it was found.
PASSES_BY = 1e-10
SETTLED = 1e-13  # radians: a few roundings of a direction
MAX_STEPS = 40
SMALLEST_STEP = 1e-12  # of the mirror's width
LONGEST_STEP = 0.25  # of the mirror's width
START_GRID = 33  # rays a direction
BEYOND = 0.1  # of the box, on every side: what Newton may start from beside the mirror
STARTS_AT_ONCE = 4_000  # targets: 35 MB of distances to all starts
# Of what is followed from near by: rays that facets turn in steps of as much are the nearest that there are.
FOLLOWED_BY = 0.02
MAX_FOLLOWING_STEPS = 12


def image_points(view: View, targets: Array, at_infinity: bool = False) -> tuple[Array, Mask]:
    """Find the points of the picture plane at which the mirror shows points of the world, or infinitely far directions.

    The eye's ray through such a point is reflected through the target: by Newton, with one ray a step and its differentials,
    from the nearest of a grid of rays. Where a mirror shows a target more than once, one of them is found
    (`raytrace.visibility.orientation`). What stands between mirror and target is not looked at.

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
    at, _, passes = _solve(view.untrimmed, _nearest(view, wanted, at_infinity), wanted, at_infinity, MAX_STEPS)
    index = np.flatnonzero(passes <= PASSES_BY)
    found[index] = at[index]
    shown[index] = view.trace_places(found[index]).seen
    return found, shown


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
    return at, leaving


def _solve(view: View, starts: Array, wanted: Array, at_infinity: bool, max_steps: int) -> tuple[Array, Array, Array]:
    """The best points (n, 2) that Newton reaches, where their rays leave (n, 3), and by what angles they pass (n,)."""
    n, size = len(starts), view.box[1] - view.box[0]
    best, kept, leaving = np.full(n, np.inf), starts.copy(), np.full((n, 3), np.nan)
    at, step = starts.copy(), np.zeros((n, 2))
    going = np.flatnonzero(np.isfinite(starts).all(axis=1))
    for _ in range(max_steps):
        if going.size == 0:
            break
        traced = view.trace_places(at[going])
        missed, axes, towards, apart = _misses(view, traced, wanted[going], at_infinity)
        now = np.sqrt(np.einsum("ij,ij->i", missed, missed))
        better = now < best[going]  # not where it is NaN
        ahead = going[better]
        best[ahead], kept[ahead], leaving[ahead] = now[better], at[ahead], traced.points[better]
        settled = (best[going] <= SETTLED) | (~better & (best[going] <= PASSES_BY))
        moved = np.flatnonzero(better & ~settled)
        step[going] *= 0.5  # not better: half the step before, from the best
        step[going[moved]] = _newton_steps(view, at[going[moved]], traced, moved, missed, axes, towards, apart, size,
                                           step[going[moved]])
        at[going] = kept[going] + step[going]
        going = going[~settled & (np.abs(step[going]).max(axis=1) > SMALLEST_STEP * size)]
    return kept, leaving, best


def _newton_steps(view: View, at: Array, traced: TracedRays, these: Index, missed: Array, axes: Array, towards: Array,
                  apart: Array, size: float, otherwise: Array) -> Array:
    """Steps (m, 2) on the picture plane for some of the rays traced; `otherwise` (m, 2) where the derivatives fail.

    With the ray's direction d, P where it leaves and τ = (T − P)/|T − P|, the misses s·d along the axes s across τ change by
    s·(∂d + (d·τ)·∂P/|T − P|).
    """
    pose, eye = view.pose, view.eye_in_mirror
    rays = np.concatenate([at, np.zeros((len(at), 1))], axis=1) - eye
    length = np.sqrt(np.einsum("ij,ij->i", rays, rays))[:, None]
    rays /= length
    turns = (np.eye(3)[:2] - rays[:, None] * rays[:, :2, None]) / length[:, None]
    by_points, by_directions = view.reflector.surface.ray_differentials(
        eye, rays, turns, traced.on_mirror[these], pose.directions_to_mirror(traced.directions[these]))
    along = np.einsum("ij,ij->i", traced.directions[these], towards[these])
    change = by_directions + (along / apart[these])[:, None, None] * by_points
    slopes = np.einsum("nai,nki->nak", pose.directions_to_mirror(axes[these]), change)
    miss = missed[these]
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] * slopes[:, 1, 0]
        step = -np.stack([slopes[:, 1, 1] * miss[:, 0] - slopes[:, 0, 1] * miss[:, 1],
                          slopes[:, 0, 0] * miss[:, 1] - slopes[:, 1, 0] * miss[:, 0]], axis=1) / determinant[:, None]
        step *= np.minimum(1.0, LONGEST_STEP * size / np.sqrt(np.einsum("ij,ij->i", step, step)))[:, None]
    return np.where(np.isfinite(step).all(axis=1)[:, None], step, otherwise)


def _misses(view: View, traced: TracedRays, wanted: Array, at_infinity: bool) -> tuple[Array, Array, Array, Array]:
    """By what angles rays pass their targets (n, 2), NaN where they are not reflected or leave it behind; the axes (n, 2, 3)
    that they are measured along, unit directions (n, 3) towards the targets, and the distance there (n,), mm."""
    apart = np.full(len(wanted), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        if at_infinity:
            towards = wanted
        else:
            towards = wanted - traced.points
            apart = np.sqrt(np.einsum("ij,ij->i", towards, towards))
            towards = towards / apart[:, None]
        # Two directions across the target's, from an axis that is the same for all rays to one target.
        far = wanted if at_infinity else wanted - view.eye
        side = np.cross(towards, np.eye(3)[np.argmin(np.abs(far), axis=1)])
        side /= np.sqrt(np.einsum("ij,ij->i", side, side))[:, None]
        axes = np.stack([side, np.cross(towards, side)], axis=1)
        missed = np.einsum("nai,ni->na", axes, traced.directions)
        missed[~(np.einsum("ij,ij->i", traced.directions, towards) > 0.0)] = np.nan
    return missed, axes, towards, apart


@lru_cache(maxsize=8)
def _start_rays(view: View) -> tuple[Array, TracedRays]:
    """Points (m, 2) of a grid over the mirror and beside it, those that the sheet reflects at, and their rays."""
    x_min, x_max, y_min, y_max = view.box
    more_x, more_y = BEYOND * (x_max - x_min), BEYOND * (y_max - y_min)
    x, y = np.meshgrid(np.linspace(x_min - more_x, x_max + more_x, START_GRID),
                       np.linspace(y_min - more_y, y_max + more_y, START_GRID))
    starts = view.places_of(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1))
    traced = view.untrimmed.trace_places(starts)
    seen = traced.seen
    return starts[seen], TracedRays(traced.status[seen], traced.points[seen], traced.directions[seen], traced.on_mirror[seen])


def _nearest(view: View, wanted: Array, at_infinity: bool) -> Array:
    """The points (n, 2) of the grid whose rays pass nearest to targets (n, 3), or leave most nearly along unit directions
    (n, 3); NaN where the mirror reflects nothing."""
    found = np.full((len(wanted), 2), np.nan)
    starts, first = _start_rays(view)
    for begin in range(0, len(wanted) if len(starts) else 0, STARTS_AT_ONCE):
        part = wanted[begin:begin + STARTS_AT_ONCE]
        # Not by BLAS: its threads would spin beside those that trace.
        alike = np.einsum("ij,kj->ik", part, first.directions) if at_infinity else _alike(part, first)
        found[begin:begin + STARTS_AT_ONCE] = starts[np.argmax(alike, axis=1)]
    return found


def _alike(points: Array, first: TracedRays) -> Array:
    """Cosines (n, m) between the rays that start and what each point is seen at from where they start."""
    apart = points[:, None, :] - first.points[None, :, :]
    length = np.sqrt(np.einsum("ijk,ijk->ij", apart, apart))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(np.einsum("ijk,jk->ij", apart, first.directions) / length, nan=-1.0)
