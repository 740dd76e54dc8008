"""A sphere whose reflections have a closed form: rays at every incidence, its rational B-spline, and a mesh of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_studio.bench.tracers.case import Mesh, Rays, grid_faces
from raytrace.reflector import Reflector
from raytrace.surfaces.bspline import BSplineFace

Array = NDArray[np.float64]

RADIUS_MM = 950.0
HALF_MM = (115.0, 170.0)  # of the part that rays are aimed at
HALF_ANGLES = (0.14, 0.2)  # of the patch, about the axis y and up: HALF_MM and a little more
AWAY_MM = 800.0  # from a ray's origin to its point on the sphere


def rays(count: int, least_deg: float, most_deg: float) -> Rays:
    """Rays that meet the sphere at points and with azimuths at random, with an incidence between the two angles.

    Their exact reflections by the quadratic formula in extended precision, from the float64 rays as they are traced.
    """
    rng = np.random.default_rng(round(1000.0 * most_deg))
    x, y = (rng.uniform(-half, half, count) for half in HALF_MM)
    normals = np.stack([x, y, np.sqrt(RADIUS_MM**2 - x**2 - y**2)], axis=1) / RADIUS_MM
    incidence = np.radians(rng.uniform(least_deg, most_deg, count))[:, None]
    across = np.cross(normals, rng.normal(size=(count, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    directions = -np.cos(incidence) * normals - np.sin(incidence) * across
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = RADIUS_MM * normals - [0.0, 0.0, RADIUS_MM] - AWAY_MM * directions
    d, centred = directions.astype(np.longdouble), origins.astype(np.longdouble)
    d /= np.sqrt((d * d).sum(axis=1))[:, None]
    centred[:, 2] += RADIUS_MM
    b, c = (centred * d).sum(axis=1), (centred * centred).sum(axis=1) - np.longdouble(RADIUS_MM) ** 2
    met = (centred + (-b - np.sqrt(b * b - c))[:, None] * d) / RADIUS_MM
    exact = (d - 2.0 * (d * met).sum(axis=1)[:, None] * met).astype(np.float64)
    return Rays(origins, directions, exact, np.ones(count, dtype=np.bool_))


def reflector() -> Reflector:
    """The patch as a rational biquadratic B-spline that is exactly the sphere, trimmed just inside its edges.

    A revolved arc: The NURBS Book, sec. 8.5. The middle pole of an arc of half-angle α has the weight cos α and lies 1/cos α
    farther out.
    """
    about, up = HALF_ANGLES
    cos_about, cos_up = np.array([1.0, np.cos(about), 1.0]), np.array([1.0, np.cos(up), 1.0])
    angle_about, angle_up = about * np.array([-1.0, 0.0, 1.0]), up * np.array([-1.0, 0.0, 1.0])
    away, height = RADIUS_MM * np.cos(angle_up) / cos_up, RADIUS_MM * np.sin(angle_up)
    poles = np.empty((3, 3, 3))
    poles[..., 0] = (np.sin(angle_about) / cos_about)[:, None] * away
    poles[..., 1] = height
    poles[..., 2] = (np.cos(angle_about) / cos_about)[:, None] * away - RADIUS_MM
    knots = np.repeat([0.0, 1.0], 3)
    surface = BSplineSurface(2, 2, knots, knots.copy(), poles, cos_about[:, None] * cos_up)
    edge = 1e-3
    loop = np.array([[edge, edge], [1.0 - edge, edge], [1.0 - edge, 1.0 - edge], [edge, 1.0 - edge]])
    return Reflector(BSplineFace(surface, (loop,)))


def mesh(triangles: int) -> Mesh:
    """A grid of some `triangles` triangles with its vertices on the sphere, over HALF_MM and 3 mm more."""
    cells_x = round(np.sqrt(0.5 * triangles * HALF_MM[0] / HALF_MM[1]))
    cells_y = round(0.5 * triangles / cells_x)
    x, y = (np.linspace(-half - 3.0, half + 3.0, cells + 1) for half, cells in zip(HALF_MM, (cells_x, cells_y), strict=True))
    xx, yy = (a.ravel() for a in np.meshgrid(x, y))
    normals = np.stack([xx, yy, np.sqrt(RADIUS_MM**2 - xx**2 - yy**2)], axis=1) / RADIUS_MM
    return Mesh(RADIUS_MM * normals - [0.0, 0.0, RADIUS_MM], grid_faces(cells_x, cells_y), normals)
