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
from mirror_cad.vectors import lengths

Array = NDArray[np.float64]
Side = Literal["front", "back"]

# The plate's other face is a B-spline within this of the true offset, and within this share of the thickness: a back only
# has to be there; a front that light goes through is as good as a fit's default.
OFFSET_TOLERANCE_MM = {"back": 1e-3, "front": 1e-5}
OFFSET_SHARE = 0.01
OFFSET_ROUNDS = 4  # tries at the offset, each on half the spans of the one before
# A thinner plate is not two surfaces any more to what reads it: float32, which STL holds, has steps of 1e-4 mm at 1.5 m.
THINNEST_MM = 1e-3

# Of thickness times curvature, which must stay below 1: below this a bound of the curvature says enough.
SURELY_THINNER = 0.5


def offset_surface(surface: BSplineSurface, outline: Outline, thickness_mm: float, reflecting: Side = "front",
                   ) -> tuple[BSplineSurface, float]:
    """S − t·N behind a reflecting front, S + t·N before a reflecting back, as a B-spline on the same parameters.

    Collocated on the surface's knots, with spans halved until the tolerance holds.

    Parameters
    ----------
    surface
        The optical face, S(u, v), mm, a sag z(x, y) with u = x and v = y.
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
        Where the tolerance does not hold, for a surface that is no sag, and for a thickness that makes no plate of this
        surface: below THINNEST_MM; where the offset folds, which is at t·κ ≥ 1 (convex) for a back behind the optical face
        and at t·κ ≤ −1 (concave) for a front before it; and where the glass is thicker than the radius it is bent to in the
        opposite sense.
    """
    if not thickness_mm >= THINNEST_MM:
        raise SolidError(f"glass.thickness_mm = {thickness_mm:g} is below {THINNEST_MM:g} mm: front and back would be one "
                         "surface to most readers of STL")
    if not surface.is_height_field:
        raise SolidError("the plate's other face is made for a sag z(x, y) with u = x and v = y, and this surface is none")
    grid = Grid.over(outline)
    _check_radii(surface, grid, thickness_mm, reflecting)
    other, along = ("back", -thickness_mm) if reflecting == "front" else ("front", thickness_mm)

    def true_offset(u: Array, v: Array) -> Array:
        at = surface.on_grid(u, v, order=1)
        result: Array = at["s"] + along * normals(at["u"], at["v"])
        return result

    degree = max(surface.degree_u, surface.degree_v)
    tolerance = min(OFFSET_TOLERANCE_MM[other], OFFSET_SHARE * thickness_mm)
    wanted = _offset_on(grid, surface, along)
    knots_u, knots_v = _knots_for_normals(surface.knots_u, degree), _knots_for_normals(surface.knots_v, degree)
    for _ in range(OFFSET_ROUNDS):
        offset = collocate(true_offset, knots_u, knots_v, degree)
        error = _largest_distance(grid, offset, *wanted)
        if error <= tolerance:
            return offset, error
        knots_u, knots_v = (np.sort(np.concatenate([k, _middles(k)])) for k in (knots_u, knots_v))
    raise SolidError(f"the {other} of the plate stays {error:.2g} mm from the true offset (at most {tolerance:g} mm is "
                     "allowed): the surface bends too sharply for this glass.thickness_mm")


def _check_radii(surface: BSplineSurface, grid: Grid, thickness_mm: float, reflecting: Side) -> None:
    """Raise SolidError where the glass is as thick as a radius of the surface."""
    if thickness_mm * _bent_at_most(surface) < SURELY_THINNER:
        return
    larger, smaller = principal_curvatures_of(shape_operator(grid.derivatives(surface)))
    folds = f"the {'back' if reflecting == 'front' else 'front'} would fold: thinner glass, or larger radii"
    block = "that is a block and no bent plate: thinner glass, or larger radii"
    convex, concave = (folds, block) if reflecting == "front" else (block, folds)
    for kind, kappa, why in (("convex", larger, convex), ("concave", -smaller, concave)):
        worst = int(np.argmax(kappa))
        if thickness_mm * kappa[worst] >= 1.0:
            raise SolidError(f"glass.thickness_mm = {thickness_mm:g} is not below the smallest {kind} radius, "
                             f"{1.0 / kappa[worst]:.2f} mm at ({grid.x[worst]:.1f}, {grid.y[worst]:.1f}) mm: {why}")


def _offset_on(grid: Grid, surface: BSplineSurface, along: float) -> tuple[tuple[Array, Array, Array], Array]:
    """S + along·N on all cells of a grid, inside and outside the outline, by coordinates (m, n); and on the edge, (k, 3)."""
    sag = surface.on_grid(grid.cells_x, grid.cells_y, component=2, order=1)
    upwards = along / np.sqrt(1.0 + sag["u"] ** 2 + sag["v"] ** 2)
    d = surface.derivatives(grid.x[grid.edge], grid.y[grid.edge])
    return ((grid.cells_x[:, None] - upwards * sag["u"], grid.cells_y - upwards * sag["v"], sag["s"] + upwards),
            d["s"] + along * normals(d["u"], d["v"]))


def _largest_distance(grid: Grid, surface: BSplineSurface, cells: tuple[Array, Array, Array], edge: Array) -> float:
    """Between points of a surface and those of `_offset_on`, at equal parameters inside the outline and on it, mm."""
    squared = np.zeros(grid.inside.shape)
    for component, wanted in enumerate(cells):
        squared += (surface.on_grid(grid.cells_x, grid.cells_y, component, order=0)["s"] - wanted) ** 2
    on_edge = lengths(surface.evaluate(grid.x[grid.edge], grid.y[grid.edge]) - edge)
    return max(float(np.sqrt(squared[grid.inside].max(initial=0.0))), float(on_edge.max()))


def _bent_at_most(surface: BSplineSurface) -> float:
    """No curvature of a sag z(x, y) is larger, 1/mm; not finite where a knot breaks it.

    The shape operator is at most as large as the Hessian, |W| ≤ |z''| by Frobenius' norm, and a B-spline's derivatives lie
    between their poles.
    """
    z, p, q = surface.poles[..., 2], surface.degree_u, surface.degree_v
    z_x, z_y = _slopes(z, surface.knots_u, p), _slopes(z.T, surface.knots_v, q)
    z_xx, z_xy = _slopes(z_x, surface.knots_u[1:-1], p - 1), _slopes(z_x.T, surface.knots_v, q)
    z_yy = _slopes(z_y, surface.knots_v[1:-1], q - 1)
    largest = [float(np.abs(each).max(initial=0.0)) for each in (z_xx, z_xy, z_yy)]  # none where it is straight
    return float(np.sqrt(largest[0] ** 2 + 2.0 * largest[1] ** 2 + largest[2] ** 2))


def _slopes(poles: Array, knots: Array, degree: int) -> Array:
    """Poles of a B-spline's derivative along the first axis; not finite where a knot breaks the spline."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return degree * np.diff(poles, axis=0) / (knots[degree + 1:-1] - knots[1:-degree - 1])[:, None]


def _knots_for_normals(knots: Array, degree: int) -> Array:
    """The knots with one repetition more where the surface is not smooth: its normal has one derivative less."""
    values, counts = np.unique(knots, return_counts=True)
    counts[1:-1] = np.where(counts[1:-1] > 1, np.minimum(counts[1:-1] + 1, degree), 1)
    counts[[0, -1]] = degree + 1
    return np.repeat(values, counts)


def _middles(knots: Array) -> Array:
    ends = np.unique(knots)
    return 0.5 * (ends[:-1] + ends[1:])
