"""A made mirror without a design: the nearest sphere in its stead, and the laws that the mirror seems to follow."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial import ConvexHull, Delaunay, QhullError

from mirror_cad.errors import FileError
from mirror_cad.made.inspection import Inspection
from mirror_cad.made.motion import Motion
from mirror_cad.made.nominal import Nominal
from mirror_cad.mesh import SurfaceMesh
from mirror_cad.outline.files import write_dxf
from mirror_cad.surfaces.collocation import collocate_height, knot_vector
from mirror_studio.inspect.reference import Reference, polygon_outline
from mirror_studio.json_types import Json
from raytrace.reflector import Reflector
from raytrace.seating import find_placement

Array = NDArray[np.float64]

FEW = 4000  # points that the frame and the sphere are found with
MARGIN = 0.06  # of the size, beyond the outline: the sheet of the sphere
DEGREE, SPANS = 7, 16
BAND = 0.15  # of the height about the middle, over which the laws are told
STEEPEST = 0.98  # of the sphere's radius: farther out it has no height
ZONE_SIGMAS, ZONE_SHARE = 4.0, 0.02  # of curvature: where it leaves what it has inboard
CURVED = 1e-7  # 1/mm: a flatter sphere is a plane


@dataclass(frozen=True, slots=True)
class NearestSphere:
    """The sphere that is nearest to the points.

    Attributes
    ----------
    radius_mm : float or None
        Positive where convex; None for a plane.
    rms_mm : float
        Of the points' heights over it.
    """

    radius_mm: float | None
    rms_mm: float


def reference_of_points(name: str, points: Array) -> tuple[Reference, NearestSphere]:
    """The nearest sphere as a design, in the frame that the points' own outline has.

    Parameters
    ----------
    name : str
        Of the mirror.
    points : ndarray
        (n, 3), mm.

    Raises
    ------
    FileError
        For points that are no sheet.
    """
    motion = _frame(points[:: max(1, len(points) // FEW)])
    at = motion.of_points(points)
    part = at[:: max(1, len(at) // FEW)]
    found = least_squares(lambda p: sphere_heights(p, part[:, 0], part[:, 1]) - part[:, 2], np.zeros(4), loss="soft_l1",
                          f_scale=0.01, x_scale=[1.0, 1e-2, 1e-2, 1e-4])
    radius = 1.0 / found.x[3] if abs(found.x[3]) > CURVED else None
    try:
        hull = at[ConvexHull(at[:, :2]).vertices, :2]
    except QhullError:
        raise FileError(f"{name}: the points lie on a line as seen along their normal: they tell no surface") from None
    (x_min, y_min), (x_max, y_max) = hull.min(axis=0), hull.max(axis=0)
    margin = MARGIN * float(np.hypot(x_max - x_min, y_max - y_min))
    knots = [knot_vector(np.linspace(low - margin, high + margin, SPANS + 1), (), DEGREE)
             for low, high in ((x_min, x_max), (y_min, y_max))]
    surface = collocate_height(lambda x, y: sphere_heights(found.x, *np.broadcast_arrays(x, y)), knots[0], knots[1], DEGREE)
    off = sphere_heights(found.x, part[:, 0], part[:, 1]) - part[:, 2]
    return (Reference(name, Nominal(surface, polygon_outline(hull)), motion),
            NearestSphere(None if radius is None else float(radius), float(np.sqrt(np.mean(off**2)))))


def write_laws(folder: Path, name: str, found: Inspection) -> dict[str, Json]:
    """Write κ over x along the middle, both as tables of a specification that `build` takes; returns what they say.

    Parameters
    ----------
    folder : Path
        Where NAME-horizontal.csv, NAME-vertical.csv, NAME-outline.dxf and NAME-laws.toml go.
    name : str
        Of the mirror.
    found : Inspection
        Against its nearest sphere.
    """
    fields, nominal = found.fields, found.nominal
    places = fields.lattice.places
    band = fields.known & (np.abs(places[:, 1] - np.mean(nominal.box[2:])) <= 0.5 * BAND * (nominal.box[3] - nominal.box[2]))
    columns = np.unique(places[band, 0])
    if len(columns) < 4:
        return {}
    told: dict[str, Json] = {}
    for direction, key in (("horizontal", "kx"), ("vertical", "ky")):
        value = fields.measured.w11 if key == "kx" else fields.measured.w22
        sigma = getattr(fields.curvature_sigma, key)
        rows = [band & (places[:, 0] == x) for x in columns]
        kappa = np.array([value[row].mean() for row in rows])
        spread = np.array([np.sqrt(np.mean(sigma[row] ** 2)) for row in rows])  # places of a column share their gauge
        with (folder / f"{name}-{direction}.csv").open("w", encoding="utf-8") as stream:
            stream.write("x_mm,curvature_per_mm,sigma_of_curvature\n")
            np.savetxt(stream, np.column_stack([columns, kappa, spread]), fmt="%.9g", delimiter=",")
        told[direction] = {"right_mm": _radius(kappa[-1]), "left_mm": _radius(kappa[0]),
                           "zone_begins_at_mm": _zone(columns, kappa, spread)}
    write_dxf(nominal.outline, folder / f"{name}-outline.dxf")
    x_min, x_max, y_min, y_max = nominal.box
    (folder / f"{name}-laws.toml").write_text(
        f'name = "{name}-laws"\n[horizontal]\nlaw = "table"\nfile = "{name}-horizontal.csv"\n[vertical]\nlaw = "table"\n'
        f'file = "{name}-vertical.csv"\n[blank]\nwidth_mm = {x_max - x_min + 20.0:.3f}\n'
        f'height_mm = {y_max - y_min + 20.0:.3f}\n[outline]\nfile = "{name}-outline.dxf"\n', encoding="utf-8")
    return told


def sphere_heights(parameters: Array, x: Array, y: Array) -> Array:
    """Heights of κ|r|²/2 + n·r = 0, a sphere or plane through (0, 0, z0) with the unit normal n there; convex positive.

    Parameters
    ----------
    parameters : ndarray
        z0 (mm), the slopes of the touching plane along x and y, κ (1/mm).
    x, y : ndarray
        Of one shape, mm.
    """
    z0, p, q, kappa = parameters
    m = 1.0 / np.sqrt(1.0 + p * p + q * q)
    # κ/2·(x² + y² + h²) + m·(h − p·x − q·y) = 0, solved for h in the form that loses no digit for small κ.
    c = 0.5 * kappa * (x * x + y * y) - m * (p * x + q * y)
    root = np.sqrt(np.maximum(m * m - 2.0 * kappa * c, (1.0 - STEEPEST) * m * m))
    result: Array = z0 - 2.0 * c / (m + root)
    return result


def _radius(kappa: float) -> float | None:
    return 1.0 / float(kappa) if abs(kappa) > CURVED else None


def _zone(x: Array, kappa: Array, sigma: Array) -> float | None:
    """Where, from the right, the curvature leaves for good what it has on the right third; None where it does not."""
    level = float(np.median(kappa[x > x[0] + 2.0 / 3.0 * (x[-1] - x[0])]))
    near = np.flatnonzero(np.abs(kappa - level) <= np.maximum(ZONE_SIGMAS * sigma, ZONE_SHARE * abs(level)))
    return float(x[near[0]]) if len(near) and near[0] > 0 else None


def _frame(points: Array) -> Motion:
    """Mirror coordinates from the points' own outline, as `trace` finds them of a mesh."""
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=False)[2]
    try:
        faces = Delaunay((points - middle) @ axes[:2].T).simplices
    except QhullError:
        raise FileError(f"all {len(points)} points lie on a line: they tell no surface") from None
    placement = find_placement(Reflector.of_mesh(SurfaceMesh(points, faces.astype(np.int32))))
    return Motion(placement.rotation, -placement.rotation @ placement.origin_mm)
