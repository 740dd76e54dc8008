"""A mirror from a wanted view in, how far the traced view of its exported file is from it out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_cad.grid import Grid
from mirror_cad.mirror import Mirror, eyes_of
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
        return float(np.sqrt(np.average(self.arcmin**2, weights=self.grid.weights)))

    def worst(self) -> tuple[float, list[float]]:
        """The largest, arc minutes, and where it is, mm; of places that rounding alone tells apart the upper one."""
        ties = np.flatnonzero(self.arcmin >= self.arcmin.max() * (1.0 - 1e-6))
        at = ties[np.argmax(self.grid.y[ties])]
        return float(self.arcmin[at]), [float(self.grid.x[at]), float(self.grid.y[at])]


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


def target_figures(mirror: Mirror, surface: OpticalSurface) -> dict[str, Any] | None:
    """What metrics.json has as `target`: RMS and largest over all eyes, and of each; None for a mirror from laws.

    surface : the exported file's.
    """
    target, found = mirror.spec.target, mirror.from_view
    if target is None or found is None:
        return None
    grid, view = Grid.over(mirror.outline), target.view(mirror.box)
    missed = [missed_view(view, eye, surface, grid) for eye in eyes_of(mirror.spec, mirror.box)]
    worst = [one.worst() for one in missed]
    each = [{"rms_arcmin": one.rms, "max_arcmin": largest, "max_at_mm": at}
            for one, (largest, at) in zip(missed, worst, strict=True)]
    largest, at = max(worst, key=lambda one: one[0])
    return {
        "rms_arcmin": float(np.sqrt(np.mean([one.rms**2 for one in missed]))),
        "max_arcmin": largest, "max_at_mm": at, "settled": found.settled,
        "eyes": dict(zip(("left", "right") if len(each) == 2 else ("one",), each, strict=True)),
        "floor": [{"spans": list(level.spans), "unknowns": level.unknowns, "steps": level.steps,
                   "rms_arcmin": level.rms_arcmin} for level in found.levels],
    }
