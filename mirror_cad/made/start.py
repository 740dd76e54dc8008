"""Where measured points may lie on the design: places to begin an alignment, from the points' extent and shape alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.made.alignment import AlignmentError, best_fit
from mirror_cad.made.motion import Motion
from mirror_cad.made.nominal import Nominal

Array = NDArray[np.float64]

FEW = 300  # points that places to begin are judged by
ANGLES = 24  # in which the points are laid on the design
PLACES = (0.0, -0.25, 0.25)  # of the design's width and height, where the points' middle is laid
WHOLE = 0.9  # of the design's reach along both axes: points that cover all of it
BEST, FIRST_STEPS = 16, 5  # of them that are followed up, and how far
NEAREST, STEPS = 4, 30
CELLS = 24  # of the design's own sample points, along its longer side
AS_GIVEN = 1.05  # of the best cost: where the points lie already, they stay
# The other hand's mirror must fit better than this share of the cost of this hand's to be taken for it.
OTHER_HAND = 0.25
NOISE = 1e-5  # of the mirror's size: costs below are equal


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A place to begin, and how well it fits: the root of the mean square of distances from sheet and outline, cut off, mm."""

    motion: Motion
    cost_mm: float


def find_start(nominal: Nominal, points: Array, given: Motion | None = None) -> Start:
    """The best place to begin; the points as they are given, where that is as good.

    Upside down, back to front, left for right: all are tried.

    Parameters
    ----------
    nominal : Nominal
        The design.
    points : ndarray
        (n, 3), mm, n ≥ 6.
    given : Motion, optional
        From the coordinates of the points to the design's, as files have them; none without it.

    Raises
    ------
    AlignmentError
        Where the points lie on a straight line.
    """
    few = points[np.linspace(0, len(points) - 1, min(len(points), FEW)).astype(int)] if len(points) > FEW else points
    design = _samples(nominal)
    mine, theirs = _Frame.of(few), _Frame.of(design)
    if mine.widths[1] < 1e-6 * mine.widths[0]:
        raise AlignmentError(f"all {len(points)} points lie on a straight line: they tell no surface")
    x_min, x_max, y_min, y_max = nominal.box
    whole = (mine.reach[:2] > WHOLE * theirs.reach[:2]).all()
    shifts = [(0.0, 0.0)] if whole else [(a * (x_max - x_min), b * (y_max - y_min)) for a in PLACES for b in PLACES]
    found = _followed(nominal, few, [given or Motion.identity()], STEPS)
    if not found or found[0].cost_mm > NOISE * nominal.size_mm:
        for reflected in (False, True):
            laid = [_laid(mine, theirs, 2.0 * np.pi * k / ANGLES, side, reflected, shift)
                    for side in (1.0, -1.0) for k in range(ANGLES) for shift in shifts]
            costs = np.array([_cost(nominal, few[::3], motion, level=True) for motion in laid])
            near = _followed(nominal, few, [laid[k] for k in np.argsort(costs)[:BEST]], FIRST_STEPS)
            near.sort(key=lambda each: each.cost_mm)
            found += _followed(nominal, few, [each.motion for each in near[:NEAREST]], STEPS)
    if not found:
        raise AlignmentError("the points cannot be laid on the design")
    floor = NOISE * nominal.size_mm
    ours = [each for each in found if not each.motion.reflected]
    best = min(found, key=lambda each: each.cost_mm)
    if best.motion.reflected and ours:
        own = min(ours, key=lambda each: each.cost_mm)
        if own.cost_mm <= floor or best.cost_mm > OTHER_HAND * own.cost_mm:
            best = own
    first = found[0]
    if not first.motion.reflected and first.cost_mm <= max(AS_GIVEN * best.cost_mm, floor):
        return first
    return best


def _followed(nominal: Nominal, points: Array, starts: list[Motion], steps: int) -> list[Start]:
    """Where alignments from some places end."""
    found = []
    for motion in starts:
        try:
            end = best_fit(nominal, points, motion, steps=steps).motion
        except AlignmentError:
            continue
        found.append(Start(end, _cost(nominal, points, end)))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """The middle of points and their principal axes.

    axes : as columns, right-handed, the least wide last.   widths : singular values.   reach : of the points along the axes,
    mm.
    """

    middle: Array
    axes: Array
    widths: Array
    reach: Array

    @staticmethod
    def of(points: Array) -> _Frame:
        middle = np.median(points, axis=0)
        off = points - middle
        # Far outliers would turn the axes.
        reach = np.linalg.norm(off, axis=1)
        kept = reach <= 3.0 * np.median(reach)
        middle = points[kept].mean(axis=0)
        _, widths, axes = np.linalg.svd(points[kept] - middle, full_matrices=False)
        axes = axes.T
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        return _Frame(middle, axes, widths, np.ptp((points[kept] - middle) @ axes, axis=0))


def _laid(mine: _Frame, theirs: _Frame, angle: float, side: float, reflected: bool, shift: tuple[float, float]) -> Motion:
    """Middle on middle, but for a shift in (x, y), and axis along axis, turned by an angle, on this or the other side."""
    flip = np.array([-1.0, 1.0, 1.0]) if reflected else np.ones(3)
    axes = mine.axes * flip[:, None]
    axes = np.column_stack([axes[:, 0], side * axes[:, 1], side * np.cross(axes[:, 0], axes[:, 1])])
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    rotation = theirs.axes @ turn @ axes.T
    return Motion(rotation, theirs.middle + [*shift, 0.0] - rotation @ (mine.middle * flip), reflected)


def _cost(nominal: Nominal, points: Array, motion: Motion, level: bool = False) -> float:
    """Root of the mean square of distances, each cut off at a tenth of the size; `level` takes height and tilt away first."""
    at = motion.of_points(points)
    z, _, _ = nominal.heights(at[:, 0], at[:, 1])
    off = at[:, 2] - z
    if level:
        plane = np.stack([np.ones(len(at)), at[:, 0], at[:, 1]], axis=1)
        off = off - plane @ np.linalg.lstsq(plane, off, rcond=None)[0]
    beyond, _ = nominal.outside_by(at[:, 0], at[:, 1])
    beyond = np.maximum(beyond - 0.01 * nominal.size_mm, 0.0)
    most = 0.1 * nominal.size_mm
    return float(np.sqrt(np.mean(np.minimum(off**2 + beyond**2, most**2))))


def _samples(nominal: Nominal) -> Array:
    x_min, x_max, y_min, y_max = nominal.box
    step = max(x_max - x_min, y_max - y_min) / CELLS
    x, y = (each.ravel() for each in np.meshgrid(np.arange(x_min + 0.5 * step, x_max, step),
                                                 np.arange(y_min + 0.5 * step, y_max, step)))
    kept = nominal.outline.contains(x, y)
    x, y = np.concatenate([x[kept], nominal.rim[:, 0]]), np.concatenate([y[kept], nominal.rim[:, 1]])
    return np.stack([x, y, nominal.heights(x, y)[0]], axis=1)
