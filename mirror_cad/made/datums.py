"""Align measured points by three datum places of the face; along it the points stay where they were measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mirror_cad.made.alignment import AlignmentError
from mirror_cad.made.motion import Motion
from mirror_cad.made.nominal import Nominal

Array = NDArray[np.float64]

PLACES = ((-0.7, -0.7), (0.7, -0.7), (0.0, 0.8))  # of half the width and half the height: lower left and right, top centre
NEAREST = 7  # points whose median distance stands for a place
FARTHEST = 0.1  # of the mirror's size: no point of a datum place is farther from it
STEPS, SETTLED_MM = 20, 1e-12
FLATTEST = 0.02  # height of the places' triangle over its longest side, and that over the mirror's size

Datums = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


def on_three_points(nominal: Nominal, points: Array, given: Motion, places: Datums | None = None) -> Motion:
    """Move and tilt so that the points lie on the design at three places of it.

    Parameters
    ----------
    nominal : Nominal
        The design.
    points : ndarray
        (n, 3), mm, as measured.
    given : Motion
        To the design's coordinates, as files have them, in which the mirror lies already but for height and tilt.
    places : tuple, optional
        Three places (x, y), mm, in mirror coordinates; without them those of PLACES.

    Raises
    ------
    AlignmentError
        Where no points lie about one of the places, or the places lie on a line or beside the mirror.
    """
    wanted = _usual(nominal) if places is None else np.array(places, dtype=np.float64)
    if places is not None:
        _check(nominal, wanted)
    motion = given
    for _ in range(STEPS):
        at = motion.of_points(points)
        off, near = cKDTree(at[:, :2]).query(wanted, min(NEAREST, len(at)))
        if off.max() > FARTHEST * nominal.size_mm:
            x, y = wanted[int(np.argmax(off.max(axis=1)))]
            raise AlignmentError(f"--align 321: no measured points lie about the datum place ({x:.0f}, {y:.0f}) mm: the "
                                 "points must be in the design's coordinates but for height and tilt; take --align best-fit")
        feet = nominal.feet(at[near.ravel()])
        distances = feet.distance.reshape(near.shape)
        middle = np.argsort(distances, axis=1)[:, near.shape[1] // 2]
        rows = np.arange(3)
        p, n, d = at[near[rows, middle]], feet.normal.reshape(*near.shape, 3)[rows, middle], distances[rows, middle]
        centre = p.mean(axis=0)
        turns = np.cross(p - centre, n)[:, :2]
        move = np.linalg.solve(np.column_stack([n[:, 2], turns]), -d)
        motion = motion.then(np.array([move[1], move[2], 0.0]), np.array([0.0, 0.0, move[0]]), centre)
        if np.abs(d).max() < SETTLED_MM * nominal.size_mm:
            break
    return motion


def _usual(nominal: Nominal) -> Array:
    x_min, x_max, y_min, y_max = nominal.box
    result: Array = 0.5 * np.array([[x_min + x_max, y_min + y_max]]) + 0.5 * np.array(PLACES) * [x_max - x_min, y_max - y_min]
    return result


def _check(nominal: Nominal, wanted: Array) -> None:
    off = ~nominal.outline.contains(wanted[:, 0], wanted[:, 1])
    if off.any():
        x, y = wanted[int(np.argmax(off))]
        raise AlignmentError(f"the datum place ({x:g}, {y:g}) mm lies outside the mirror's outline, x {nominal.box[0]:.0f} to "
                             f"{nominal.box[1]:.0f}, y {nominal.box[2]:.0f} to {nominal.box[3]:.0f} mm")
    a, b = wanted[1] - wanted[0], wanted[2] - wanted[0]
    longest = max(float(np.hypot(*side)) for side in (a, b, b - a))
    if abs(a[0] * b[1] - a[1] * b[0]) < FLATTEST * longest**2 or longest < FLATTEST * nominal.size_mm:
        raise AlignmentError("the three datum places lie on a line, or nearly: the mirror can tilt about it; choose them apart")
