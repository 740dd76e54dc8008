"""The plate's other face: the optical face offset by the thickness, as a B-spline on the same parameters."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mirror_cad.errors import SolidError
from mirror_cad.grid import Grid
from mirror_cad.outline import Outline
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.collocation import collocate
from mirror_cad.surfaces.differential import normals, principal_curvatures_of, shape_operator

Array = NDArray[np.float64]
Side = Literal["front", "back"]

# The plate's other face is a B-spline within this of the true offset, and within this share of the thickness: a back only
# has to be there; a front that light goes through is as good as a fit's default.
OFFSET_TOLERANCE_MM = {"back": 1e-3, "front": 1e-5}
OFFSET_SHARE = 0.01
OFFSET_ROUNDS = 4  # tries at the offset, each on half the spans of the one before
# A thinner plate is not two surfaces any more to what reads it: float32, which STL holds, has steps of 1e-4 mm at 1.5 m.
THINNEST_MM = 1e-3


def offset_surface(surface: BSplineSurface, outline: Outline, thickness_mm: float, reflecting: Side = "front",
                   ) -> tuple[BSplineSurface, float]:
    """S − t·N behind a reflecting front, S + t·N before a reflecting back, as a B-spline on the same parameters.

    Collocated on the surface's knots, with spans halved until the tolerance holds.

    Parameters
    ----------
    surface
        The optical face, S(u, v), mm.
    outline
        Inside which the tolerance holds.
    thickness_mm
        t, along the normals.
    reflecting
        Which face of the plate the optical one is.

    Returns
    -------
    BSplineSurface
        The other face.
    float
        Its largest distance from the true offset, mm.

    Raises
    ------
    SolidError
        Where the tolerance does not hold, and for a thickness that makes no plate of this surface: below THINNEST_MM;
        where the offset folds, which is at t·κ ≥ 1 (convex) for a back behind the optical face and at t·κ ≤ −1 (concave)
        for a front before it; and where the glass is thicker than the radius it is bent to in the opposite sense.
    """
    if not thickness_mm >= THINNEST_MM:
        raise SolidError(f"glass.thickness_mm = {thickness_mm:g} is below {THINNEST_MM:g} mm: front and back would be one "
                         "surface to most readers of STL")
    grid = Grid.over(outline)
    d = grid.derivatives(surface)
    _check_radii(d, grid, thickness_mm, reflecting)
    other, along = ("back", -thickness_mm) if reflecting == "front" else ("front", thickness_mm)

    def true_offset(u: Array, v: Array) -> Array:
        at = surface.on_grid(u, v, order=1)
        result: Array = at["s"] + along * normals(at["u"], at["v"])
        return result

    degree = max(surface.degree_u, surface.degree_v)
    tolerance = min(OFFSET_TOLERANCE_MM[other], OFFSET_SHARE * thickness_mm)
    wanted = d["s"] + along * normals(d["u"], d["v"])
    knots_u, knots_v = _knots_for_normals(surface.knots_u, degree), _knots_for_normals(surface.knots_v, degree)
    for _ in range(OFFSET_ROUNDS):
        offset = collocate(true_offset, knots_u, knots_v, degree)
        error = float(np.linalg.norm(grid.points(offset) - wanted, axis=1).max())
        if error <= tolerance:
            return offset, error
        knots_u, knots_v = (np.sort(np.concatenate([k, _middles(k)])) for k in (knots_u, knots_v))
    raise SolidError(f"the {other} of the plate stays {error:.2g} mm from the true offset (at most {tolerance:g} mm is "
                     "allowed): the surface bends too sharply for this glass.thickness_mm")


def _check_radii(d: dict[str, Array], grid: Grid, thickness_mm: float, reflecting: Side) -> None:
    """Raise SolidError where the glass is as thick as a radius of the surface, whose derivatives on the grid are d."""
    larger, smaller = principal_curvatures_of(shape_operator(d))
    folds = f"the {'back' if reflecting == 'front' else 'front'} would fold: thinner glass, or larger radii"
    block = "that is a block and no bent plate: thinner glass, or larger radii"
    convex, concave = (folds, block) if reflecting == "front" else (block, folds)
    for kind, kappa, why in (("convex", larger, convex), ("concave", -smaller, concave)):
        worst = int(np.argmax(kappa))
        if thickness_mm * kappa[worst] >= 1.0:
            raise SolidError(f"glass.thickness_mm = {thickness_mm:g} is not below the smallest {kind} radius, "
                             f"{1.0 / kappa[worst]:.2f} mm at ({grid.x[worst]:.1f}, {grid.y[worst]:.1f}) mm: {why}")


def _knots_for_normals(knots: Array, degree: int) -> Array:
    """The knots with one repetition more where the surface is not smooth: its normal has one derivative less."""
    values, counts = np.unique(knots, return_counts=True)
    counts[1:-1] = np.where(counts[1:-1] > 1, np.minimum(counts[1:-1] + 1, degree), 1)
    counts[[0, -1]] = degree + 1
    return np.repeat(values, counts)


def _middles(knots: Array) -> Array:
    ends = np.unique(knots)
    return 0.5 * (ends[:-1] + ends[1:])
