"""Slope maps, curvature maps and spherometer readings from tables, as observations of a mirror's deviation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import FileError
from mirror_cad.made.measured_table import MeasuredTable
from mirror_cad.made.nominal import Nominal
from mirror_cad.made.others import curvature_observations, slope_observations, with_own_sigma
from mirror_cad.made.spline_fit import Combined, Observations
from mirror_studio.rules.spherometer import DIAL_MM, read_surface, stands_at, turned
from raytrace.surfaces.bspline import BSplineFace

Array = NDArray[np.float64]

UNSTATED = 1e-9  # rad or 1/mm: a sigma to begin with, below all that is measured, so that the prior says nothing
LONGEST_LEG = 0.5  # of the mirror's size


@dataclass(frozen=True, slots=True, eq=False)
class OtherData:
    """What was measured beside points.

    Attributes
    ----------
    observations : Observations or None
        Slopes and curvatures.
    readings : tuple
        Of a spherometer.
    left_out : int
        Rows beside the mirror.
    notes : tuple of str
        What a user should know.
    """

    observations: Observations | None
    readings: tuple[Combined, ...]
    left_out: int
    notes: tuple[str, ...]


def kind_of(table: MeasuredTable) -> str:
    """What a table holds: "points", "slopes", "curvatures" or "readings".

    Parameters
    ----------
    table : MeasuredTable
        With columns x and y.

    Raises
    ------
    FileError
        For a table of none of these.
    """
    columns = table.columns
    if "z" in columns:
        return "points"
    if "slope_x" in columns and "slope_y" in columns:
        return "slopes"
    if "kx" in columns and "ky" in columns:
        return "curvatures"
    if "leg" in columns and ("radius" in columns or "sagitta" in columns):
        return "readings"
    raise FileError(f"{table.path}: its columns {', '.join(columns)} are no points (x, y, z), slopes (x, y, slope_x, slope_y), "
                    "curvatures (x, y, kx_per_m, ky_per_m) or readings (x, y, angle, leg, radius or sagitta)")


def other_data(table: MeasuredTable, nominal: Nominal, gauge_mm: float, level: bool) -> OtherData:
    """Understand a table of slopes, curvatures or readings, which is in mirror coordinates.

    Parameters
    ----------
    table : MeasuredTable
        Not of points.
    nominal : Nominal
        The design.
    gauge_mm : float
        Over which curvature will be told.
    level : bool
        Whether slopes may have a tilt of their mounting, which is taken away.

    Raises
    ------
    FileError
        Where nothing of it lies on the mirror, or a sigma is not above 0.
    """
    columns, kind = table.columns, kind_of(table)
    x, y = columns["x"], columns["y"]
    on = nominal.outline.contains(x, y)
    if not on.any():
        raise FileError(f"{table.path}: none of its {len(x)} rows lies on the mirror, x {x.min():.4g} to {x.max():.4g}, y "
                        f"{y.min():.4g} to {y.max():.4g} mm: {kind} are in mirror coordinates")
    for name in ("sigma", "slope_sigma", "curvature_sigma", "radius_sigma"):
        if name in columns and not (columns[name] > 0.0).all():
            row = int(np.argmin(columns[name] > 0.0))
            raise FileError(f"{table.path}: the sigma of row {row + 1} is {columns[name][row]:g}: it must be above 0")
    left_out = int((~on).sum())
    if kind == "readings":
        return OtherData(None, _readings(table, nominal, on), left_out, ())
    if kind == "slopes":
        stated = columns.get("slope_sigma")
        slopes = np.stack([columns["slope_x"], columns["slope_y"]], axis=1)[on]
        sigmas = np.full(int(on.sum()), UNSTATED) if stated is None else stated[on]
        found = slope_observations(nominal, x[on], y[on], slopes, sigmas, level)
        notes = ["the tilt of the slopes' mounting, the median of their deviation, was taken away"] if level else []
    else:
        stated = columns.get("curvature_sigma")
        twist = columns.get("twist", np.full(len(x), np.nan))
        sigmas = np.full(int(on.sum()), UNSTATED) if stated is None else stated[on]
        curvatures = np.stack([columns["kx"], columns["ky"], twist], axis=1)[on]
        found = curvature_observations(nominal, x[on], y[on], curvatures, sigmas)
        notes = ["curvature does not see height and tilt: they are as small as they can be where nothing else tells them"]
    if stated is None:
        found = with_own_sigma(nominal, found, gauge_mm)
        notes.append(f"{table.path.name}: no sigma is stated; from the scatter it is {found.sigmas[0]:.3g} "
                     f"{'rad' if kind == 'slopes' else '1/mm'}")
    return OtherData(found, (), left_out, tuple(notes))


def _readings(table: MeasuredTable, nominal: Nominal, on: NDArray[np.bool_]) -> tuple[Combined, ...]:
    """Each reading as the sagitta that it has more than the design: n_z·d in the middle less half of it at either foot."""
    columns = table.columns
    legs = columns["leg"]
    if not ((legs > 0.0) & (legs < LONGEST_LEG * nominal.size_mm)).all():
        row = int(np.argmin((legs > 0.0) & (legs < LONGEST_LEG * nominal.size_mm)))
        raise FileError(f"{table.path}: the feet of reading {row + 1} are {legs[row]:g} mm apart: it must be above 0 and "
                        f"below half of the mirror's {nominal.size_mm:.4g} mm")
    angles = columns.get("angle", np.zeros(len(legs)))
    face = BSplineFace(nominal.surface, (nominal.rim,))
    found = []
    for row in np.flatnonzero(on).tolist():
        place, leg = np.array([[columns["x"][row], columns["y"][row]]]), float(legs[row])
        stand = turned(stands_at(face, place, np.array([1.0, 0.0])), float(angles[row]))
        direction, middle = stand.directions[0], stand.points[0]
        feet = np.stack([middle - 0.5 * leg * direction, middle, middle + 0.5 * leg * direction])
        if not nominal.outline.contains(feet[:, 0], feet[:, 1]).all():
            raise FileError(f"{table.path}: a foot of reading {row + 1}, at x = {place[0, 0]:.1f}, y = {place[0, 1]:.1f} mm, "
                            "stands beside the mirror")
        designed = _sagitta(float(read_surface(face, stand, leg)[0]), leg)
        if "sagitta" in columns:
            measured, sigma = float(columns["sagitta"][row]), DIAL_MM
        else:
            radius = float(columns["radius"][row])
            if abs(radius) <= 0.5 * leg:
                raise FileError(f"{table.path}: a radius of {radius:g} mm cannot be read with feet {leg:g} mm apart (reading "
                                f"{row + 1})")
            measured, sigma = _sagitta(radius, leg), DIAL_MM
            if "radius_sigma" in columns:
                sigma = abs(_sagitta(radius + columns["radius_sigma"][row], leg) - measured)
        sigma = float(columns["sigma"][row]) if "sigma" in columns else sigma
        slopes = nominal.heights(feet[:, 0], feet[:, 1])
        upright = 1.0 / np.sqrt(1.0 + slopes[1] ** 2 + slopes[2] ** 2)
        operators = np.zeros((3, 6))
        operators[:, 0] = upright * np.array([-0.5, 1.0, -0.5])
        found.append(Combined(feet[:, 0].copy(), feet[:, 1].copy(), operators, measured - designed, sigma))
    return tuple(found)


def _sagitta(radius: float, leg: float) -> float:
    """R − √(R² − C²/4), of the sign of R."""
    if not np.isfinite(radius):
        return 0.0
    size = abs(radius)
    return float(np.sign(radius) * 0.25 * leg**2 / (size + np.sqrt(size**2 - 0.25 * leg**2)))


def joined(data: list[OtherData]) -> tuple[Observations | None, tuple[Combined, ...]]:
    """All of them together.

    Parameters
    ----------
    data : list of OtherData
        From several files.
    """
    observations: Observations | None = None
    for each in data:
        if each.observations is not None:
            observations = each.observations if observations is None else observations.joined(each.observations)
    return observations, tuple(reading for each in data for reading in each.readings)
