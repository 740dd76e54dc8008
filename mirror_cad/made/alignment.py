"""Align measured points with the exact surface: least squares on the perpendiculars, robust against outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import MirrorError
from mirror_cad.made.motion import Motion
from mirror_cad.made.nominal import Nominal

Array = NDArray[np.float64]

MAX_STEPS = 60
# What a step may still move the mirror by, and as a share of what noise leaves open of the best-known direction.
SETTLED_MM, SETTLED_SHARE = 1e-10, 1e-3
TUKEY = 6.0  # of the scale: points farther off count nothing
MAD = 1.4826  # of the median of absolute values: the sigma of a normal distribution
# Of the residuals' sigma times the mirror's size over the points' root: a direction of motion that the shape tells of less
# well than to this many millimetres is left alone.
UNDETERMINED_MM = 1.0
WEAKEST = 1e-5  # singular value over the largest, below which a direction is not told by the shape at all
FAR_SHARE = 1e-4  # of the mirror's size: residuals that are larger are those of a start, not of noise
SMALLEST_SCALE = 1e-9  # of the mirror's size: residuals of points that are exact to rounding


class AlignmentError(MirrorError):
    """Points that cannot be laid on the design."""


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Where measured points lie on the design.

    Attributes
    ----------
    motion : Motion
        Points to the design.
    covariance : ndarray
        (6, 6) of (translation of `centre`, mm; rotation vector about it, radians), in the design's coordinates, for a sigma of
        1 mm of each point; of directions that the shape does not tell it holds 0, and `undetermined` counts them.
    centre : ndarray
        (3,), mm, what the rotation is about.
    undetermined : int
        How many of the six directions of motion the shape does not tell.
    scale_mm : float
        Robust sigma of the perpendiculars after alignment.
    """

    motion: Motion
    covariance: Array
    centre: Array
    undetermined: int
    scale_mm: float


def best_fit(nominal: Nominal, points: Array, start: Motion, sigmas: Array | None = None, steps: int = MAX_STEPS) -> Alignment:
    """Gauss-Newton on the perpendiculars to the exact surface, with Tukey's weights.

    Directions of motion that the shape does not tell (a sphere turned about its centre) stay as they start, but that points
    beyond the outline are pulled inside.

    Parameters
    ----------
    nominal : Nominal
        The design.
    points : ndarray
        (n, 3), mm, as measured.
    start : Motion
        Where to begin.
    sigmas : ndarray, optional
        (n,) of the points, whose ratio weighs them.
    steps : int
        At most so many.

    Raises
    ------
    AlignmentError
        Where no point counts any more.
    """
    motion, size = start, nominal.size_mm
    relative = np.ones(len(points)) if sigmas is None else sigmas / float(np.median(sigmas))
    centre = motion.of_points(points).mean(axis=0)
    scale, undetermined, covariance = np.inf, 0, np.zeros((6, 6))
    for step in range(steps):
        at = motion.of_points(points)
        feet = nominal.feet(at)
        residuals = feet.distance / relative
        # The weights follow the residuals down, and are held once these have settled: then it is plain least squares.
        found = max(robust_sigma(residuals), SMALLEST_SCALE * size)
        scale = min(scale, found) if step > 2 else found
        weights = tukey(residuals, scale) / relative**2
        jacobian = np.concatenate([feet.normal, np.cross(at - centre, feet.normal)], axis=1)
        move, covariance, undetermined = _step(jacobian, feet.distance, weights, at, nominal, centre, scale)
        motion = motion.then(move[3:], move[:3], centre)
        settled = max(SETTLED_MM, 1e-14 * float(np.abs(points).max()), SETTLED_SHARE * scale / np.sqrt(len(points)))
        if np.abs(move[:3]).max() + np.abs(move[3:]).max() * size < settled:
            break
    return Alignment(motion, covariance, centre, undetermined, float(scale))


def tukey(residuals: Array, scale: float) -> Array:
    """Tukey's biweight (1 − (r/6s)²)², 0 beyond 6s.

    Parameters
    ----------
    residuals : ndarray
        r, (n,).
    scale : float
        s.
    """
    inside = np.clip(1.0 - (residuals / (TUKEY * scale)) ** 2, 0.0, None)
    result: Array = inside**2
    return result


def robust_sigma(residuals: Array) -> float:
    """1.4826 times the median of |r|.

    Parameters
    ----------
    residuals : ndarray
        r, (n,), about zero.
    """
    return MAD * float(np.median(np.abs(residuals))) if residuals.size else 0.0


def _step(jacobian: Array, distance: Array, weights: Array, at: Array, nominal: Nominal, centre: Array,
          scale: float) -> tuple[Array, Array, int]:
    """The motion (6,) that lessens the distances, its covariance for a sigma of 1, and how many directions stay."""
    size = nominal.size_mm
    unit = np.array([1.0, 1.0, 1.0, *(2.0 / size,) * 3])  # rotations as what they move the rim by
    a = jacobian * unit
    normal = (a * weights[:, None]).T @ a
    right = -(a * weights[:, None]).T @ distance
    values, vectors = np.linalg.eigh(normal)
    if not values[-1] > 0.0:
        raise AlignmentError("no measured point lies near the design: state the unit of the file, or begin nearer to the "
                             "design with --align none or 321")
    told = values > WEAKEST**2 * values[-1]
    # Far from the end residuals are large for another reason than noise.
    told &= min(scale, FAR_SHARE * size) / np.sqrt(np.maximum(values, 1e-300)) < UNDETERMINED_MM
    step = vectors[:, told] @ ((vectors[:, told].T @ right) / values[told])
    covariance = (vectors[:, told] / values[told]) @ vectors[:, told].T
    if not told.all():
        step += vectors[:, ~told] @ _towards_outline(vectors[:, ~told], at, nominal, centre, unit)
    return step * unit, covariance * unit[:, None] * unit, int((~told).sum())


def _towards_outline(directions: Array, at: Array, nominal: Nominal, centre: Array, unit: Array) -> Array:
    """How far to go along directions (6, k) of motion that the shape does not tell, to bring points inside the outline."""
    few = at[:: max(1, len(at) // 2000)]
    beyond, outwards = nominal.outside_by(few[:, 0], few[:, 1])
    off = beyond > 0.0
    if not off.any():
        return np.zeros(directions.shape[1])
    normal = np.concatenate([outwards[off], np.zeros((int(off.sum()), 1))], axis=1)
    rows = np.concatenate([normal, np.cross(few[off] - centre, normal)], axis=1) * unit @ directions
    normal_matrix = rows.T @ rows + 1e-9 * len(rows) * np.eye(rows.shape[1])
    return np.asarray(np.linalg.lstsq(normal_matrix, -rows.T @ beyond[off], rcond=None)[0])
