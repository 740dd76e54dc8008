"""Inspect a made mirror: measured points and a design in, alignment, deviation with uncertainty and verdict out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mirror_cad.made.alignment import Alignment, AlignmentError, best_fit
from mirror_cad.made.datums import Datums, on_three_points
from mirror_cad.made.fields import DeviationFields, deviation_fields
from mirror_cad.made.motion import Motion
from mirror_cad.made.nominal import Nominal
from mirror_cad.made.reconstruction import Reconstruction, ReconstructionError, reconstruct
from mirror_cad.made.spline_fit import Combined, Observations
from mirror_cad.made.start import find_start

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Align = Literal["none", "321", "best-fit"]

GAUGE_MM = 38.0  # a usual spherometer's outer feet
BEYOND_MM = 2.0  # outside the outline: points farther off are not of the mirror
LAST_STEPS = 1  # with all points, from where a part of them led: the first is off by its square
FEW = 20_000  # points that an alignment is found with before all of them have their say
MIN_POINTS = 6
# Odd numbers that spread the bits of coordinates over a key: two of a million points share one by chance once in 10⁷ files.
MIXING = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
STRANGE = 0.05  # of the mirror's size, RMS after alignment: no mirror of this design
MANY = 0.3  # of the points: more that agree with no surface are another one
SCATTER = 1e-3  # of the mirror's size, RMS about the surface: no instrument is so rough
HOLLOW = 0.1  # of the residuals within half their RMS; of a normal distribution 0.38


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """What was found of a made mirror.

    Attributes
    ----------
    nominal : Nominal
        The design.
    motion : Motion
        Measured points to the design.
    align : str
        How they were laid on it.
    alignment : Alignment or None
        How well the best fit is known; None for the other alignments.
    points : ndarray
        (n, 3), mm, all measured points in the design's coordinates.
    used : ndarray
        (n,), which of them count.
    rows : ndarray
        (m,), which of them lie on the mirror: those that `reconstruction` has residuals of.
    left_out : mapping
        Why the others do not, and how many.
    reconstruction : Reconstruction
        The surface.
    fields : DeviationFields
        Its deviation over the mirror.
    sigma_mm : float
        Of a point along the normal, as it was counted with, typical.
    sigma_stated : bool
        Whether it was stated.
    """

    nominal: Nominal
    motion: Motion
    align: Align
    alignment: Alignment | None
    points: Array
    used: Mask
    rows: NDArray[np.int64]
    left_out: Mapping[str, int]
    reconstruction: Reconstruction
    fields: DeviationFields
    sigma_mm: float
    sigma_stated: bool


def inspect(nominal: Nominal, points: Array, sigmas: Array | None = None, align: Align = "best-fit",
            gauge_mm: float = GAUGE_MM, given: Motion | None = None, extra: Observations | None = None,
            combined: Sequence[Combined] = (), datums: Datums | None = None) -> Inspection:
    """Lay measured points on a design and reconstruct the mirror.

    Parameters
    ----------
    nominal : Nominal
        The design.
    points : ndarray
        (n, 3), finite, mm.
    sigmas : ndarray, optional
        (n,), mm, of the points along the normal; estimated from the residuals without them.
    align : str
        How they are laid on it.
    gauge_mm : float
        The diameter over which curvature is told.
    given : Motion, optional
        From the coordinates of the points to the design's, as files have them; none without it.
    extra, combined
        Slopes, curvatures and readings, in mirror coordinates, with their own sigmas.
    datums : tuple, optional
        The three places that `align = "321"` lays the mirror on, (x, y), mm; three of the mirror's own without them.

    Raises
    ------
    AlignmentError, ReconstructionError
        For points that cannot be laid on the design, or tell no surface.
    """
    if len(points) < MIN_POINTS and (len(points) or extra is None):
        raise AlignmentError(f"{len(points)} points tell no mirror: at least {MIN_POINTS} are needed")
    left_out: dict[str, int] = {}
    first = _first_of_equal(points)
    used = np.zeros(len(points), dtype=bool)
    used[first] = True
    if len(first) < len(points):
        left_out["duplicates"] = len(points) - len(first)
    motion, alignment = given or Motion.identity(), None
    if align == "321" and len(points):
        motion = on_three_points(nominal, points[first], motion, datums)
    elif align == "best-fit" and len(points):
        alignment = _aligned(nominal, points[first], None if sigmas is None else sigmas[first], motion)
        motion = alignment.motion
    at = motion.of_points(points)
    beyond, _ = nominal.outside_by(at[:, 0], at[:, 1])
    domain = nominal.surface.domain
    off = (beyond > BEYOND_MM) | (at[:, 0] < domain[0]) | (at[:, 0] > domain[1]) | (at[:, 1] < domain[2]) | (
        at[:, 1] > domain[3])
    if (off & used).any():
        left_out["beyond the outline"] = int((off & used).sum())
    used &= ~off
    rows = np.flatnonzero(used)
    given_sigmas = None if sigmas is None else sigmas[rows]
    if given_sigmas is None and len(rows) and (extra is not None or combined):
        # To be weighed against the others, the points' own scatter is looked at first.
        given_sigmas = np.full(len(rows), reconstruct(nominal, at[rows], None, gauge_mm).sigma_mm)
    found = reconstruct(nominal, at[rows], given_sigmas, gauge_mm, extra, combined)
    if not found.kept.all():
        left_out["outliers"] = int((~found.kept).sum())
    used[rows] = found.kept
    if len(rows):
        _refuse_two_surfaces(found, nominal.size_mm)
    fields = deviation_fields(nominal, found, gauge_mm)
    return Inspection(nominal, motion, align, alignment, at, used, rows, left_out, found, fields, found.sigma_mm,
                      sigmas is not None)


def _aligned(nominal: Nominal, points: Array, sigmas: Array | None, given: Motion) -> Alignment:
    start = find_start(nominal, points, given)
    if start.cost_mm > STRANGE * nominal.size_mm:
        raise AlignmentError("the points are no mirror like this one: as near as they can be laid on it they are "
                             f"{start.cost_mm:.3g} mm off, root of the mean square. Is it another design, or a scan with more "
                             "in it than the mirror's face?")
    if len(points) > FEW:
        some = slice(None, None, len(points) // FEW)
        motion = best_fit(nominal, points[some], start.motion, None if sigmas is None else sigmas[some]).motion
        return best_fit(nominal, points, motion, sigmas, LAST_STEPS)
    return best_fit(nominal, points, start.motion, sigmas)


def _refuse_two_surfaces(found: Reconstruction, size_mm: float) -> None:
    """Raise ReconstructionError where the residuals lie on two sides of the surface and not about it."""
    residuals, kept = found.residuals, found.kept
    off = residuals[~kept]
    if len(off) > MANY * len(residuals):
        raise ReconstructionError(f"{len(off)} of {len(residuals)} points lie on no surface with the others, half of them "
                                  f"more than {float(np.median(np.abs(off))):.3g} mm off: there is more than one surface in "
                                  "the file (front and back of the glass, a housing): leave the mirror's face")
    rms = float(np.sqrt(np.mean(residuals[kept] ** 2)))
    near = np.abs(residuals[kept]) < 0.5 * rms
    if rms > SCATTER * size_mm or (rms > 0.0 and near.mean() < HOLLOW):
        apart = float(np.median(residuals[kept & (residuals > 0.0)]) - np.median(residuals[kept & (residuals < 0.0)]))
        raise ReconstructionError(f"the points lie on two surfaces about {apart:.3g} mm apart, or on none: leave the mirror's "
                                  "face alone in the file")


def _first_of_equal(points: Array) -> NDArray[np.int64]:
    """The rows that no earlier row equals, rising."""
    bits = np.ascontiguousarray(points + 0.0).view(np.uint64)
    keys = np.zeros(len(points), dtype=np.uint64)
    with np.errstate(over="ignore"):
        for column, factor in zip(bits.T, MIXING, strict=True):
            # The shift brings high bits down: a product alone leaves the sign in the highest one, where those of two
            # coordinates undo each other.
            keys = (keys ^ column) * factor
            keys ^= keys >> np.uint64(29)
    _, first, of = np.unique(keys, return_index=True, return_inverse=True)
    if (bits[first[of]] != bits).any():  # by chance one key for two places: compared as they are
        first = np.unique(bits, axis=0, return_index=True)[1]
    return np.sort(first)
