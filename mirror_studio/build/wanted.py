"""Compare what an exported mirror shows with the view that it was made for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirror_cad.design_stages import eyes_of
from mirror_cad.grid import Grid
from mirror_cad.mirror import Mirror
from mirror_cad.wanted_view import WantedView, on_plane, wanted_directions
from raytrace.surfaces.base import OpticalSurface

Array = NDArray[np.float64]

ARCMIN = np.degrees(1.0) * 60.0


@dataclass(frozen=True, slots=True, eq=False)
class MissedView:
    """The angle between wanted and traced direction, arc minutes, at the places of a `Grid`: of one eye."""

    grid: Grid
    arcmin: Array

    @property
    def rms(self) -> float:
        """Over the cells inside the outline, by equal area in (x, y)."""
        return self.rms_by(np.ones_like(self.arcmin))

    def rms_by(self, weight: Array) -> float:
        """The same by area times the weights of the grid's places."""
        return float(np.sqrt(np.average(self.arcmin**2, weights=self.grid.weights * weight)))

    def worst(self) -> tuple[float, tuple[float, float]]:
        """The largest, arc minutes, and where it is, mm; of places that rounding alone tells apart the upper one."""
        ties = np.flatnonzero(self.arcmin >= self.arcmin.max() * (1.0 - 1e-6))
        at = ties[np.argmax(self.grid.y[ties])]
        return float(self.arcmin[at]), (float(self.grid.x[at]), float(self.grid.y[at]))


def missed_view(view: WantedView, eye: Array, surface: OpticalSurface, grid: Grid) -> MissedView:
    """Trace an eye's rays to the places of a grid on the surface, and compare with what is wanted of each.

    Parameters
    ----------
    view : WantedView
    eye : ndarray
        (3,) mm.
    surface : OpticalSurface
        The exported file's, without its trim.
    grid : Grid

    Returns
    -------
    MissedView
        NaN-free: the rays aim at the surface itself.
    """
    points, directions = surface.reflected_at(eye, grid.x, grid.y)
    wanted = wanted_directions(view, *on_plane(eye, points))
    chord = np.linalg.norm(directions - wanted, axis=-1)
    return MissedView(grid, 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)) * ARCMIN)


@dataclass(frozen=True, slots=True)
class Missed:
    """By what angles an eye misses the wanted view: RMS and largest, arc minutes, and where that is, (x, y) in mm."""

    rms_arcmin: float
    max_arcmin: float
    max_at_mm: tuple[float, float]


@dataclass(frozen=True, slots=True)
class FloorLevel:
    """What least squares reached with so many spans across and upright: RMS, arc minutes."""

    spans: tuple[int, int]
    unknowns: int
    steps: int
    rms_arcmin: float


@dataclass(frozen=True, slots=True)
class TargetFigures:
    """What metrics.json has as `target`.

    Attributes
    ----------
    rms_arcmin, max_arcmin, max_at_mm : over all eyes, as in `Missed`.
    settled : whether more spans would gain nothing.
    eyes : of each eye, by its name: "one", or "left" and "right".
    floor : how the least squares came there, spans by spans, by weight.
    weighted_rms_arcmin : by area times the weight of [target.weight], which is what was made least; None without one.
    """

    rms_arcmin: float
    max_arcmin: float
    max_at_mm: tuple[float, float]
    settled: bool
    eyes: dict[str, Missed]
    floor: tuple[FloorLevel, ...]
    weighted_rms_arcmin: float | None = None


def target_figures(mirror: Mirror, surface: OpticalSurface) -> TargetFigures | None:
    """What a mirror misses of the view that it was made for; None for a mirror from laws.

    surface : the exported file's.
    """
    target, found = mirror.spec.target, mirror.from_view
    if target is None or found is None:
        return None
    grid, view = Grid.over(mirror.outline), target.view(mirror.box)
    missed = [missed_view(view, eye, surface, grid) for eye in eyes_of(mirror.spec, mirror.box)]
    each = [Missed(one.rms, *one.worst()) for one in missed]
    largest = max(each, key=lambda one: one.max_arcmin)
    weights = None if target.weight is None else target.weight.map()(grid.x, grid.y)
    weighted = None if weights is None else float(np.sqrt(np.mean([one.rms_by(weights)**2 for one in missed])))
    names = ("left", "right") if len(each) == 2 else ("one",)
    return TargetFigures(
        float(np.sqrt(np.mean([one.rms_arcmin**2 for one in each]))), largest.max_arcmin, largest.max_at_mm, found.settled,
        dict(zip(names, each, strict=True)),
        tuple(FloorLevel(level.spans, level.unknowns, level.steps, level.rms_arcmin) for level in found.levels), weighted)
