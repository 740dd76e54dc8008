"""The deviation of a triangle mesh from the surface that it was made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirror_cad.mesh import SurfaceMesh
from mirror_cad.outline import Outline
from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.vectors import lengths


@dataclass(frozen=True, slots=True)
class MeshDeviation:
    """How far the optical facets of a mesh are from their surface.

    Attributes
    ----------
    height_max_mm
        The largest distance of a facet, mm; None without an optical facet.
    normal_max_deg
        The largest angle of a facet's normal to the surface's, degrees; None without an optical facet.
    facets
        Number of optical facets.
    """

    height_max_mm: float | None
    normal_max_deg: float | None
    facets: int


def stl_deviation(mesh: SurfaceMesh, surface: BSplineSurface, outline: Outline) -> MeshDeviation:
    """The largest distance of the optical facets from the surface, and angle of their normals to its normal.

    Optical facets are those whose three corners lie on the surface to STL's own float32 and the edge tolerance;
    their middles and edge middles are compared, where a facet strays most.

    Parameters
    ----------
    mesh
        The whole plate, in mirror coordinates, mm.
    surface
        The optical face, u = x and v = y.
    outline
        What it is trimmed to.
    """
    corners = mesh.vertices[mesh.faces]
    x_min, x_max, y_min, y_max = outline.bounding_box()
    u = np.clip(mesh.vertices[:, 0], x_min, x_max)
    v = np.clip(mesh.vertices[:, 1], y_min, y_max)
    size = float(np.abs(mesh.vertices).max())
    off = lengths(surface.evaluate(u, v) - mesh.vertices)
    on_surface = off <= 1e-5 + 4.0 * size * float(np.finfo(np.float32).eps)
    # A sliver of the rim can have all corners on the edge: the optical side is the one that looks at the driver.
    optical = on_surface[mesh.faces].all(axis=1) & (mesh.facet_normals()[:, 2] > 0.1)
    facets = corners[optical]
    if len(facets) == 0:
        return MeshDeviation(None, None, 0)
    # Two facets share an edge: its middle counts once.
    used = mesh.faces[optical]
    edges = np.sort(np.concatenate([used[:, [0, 1]], used[:, [1, 2]], used[:, [2, 0]]]), axis=1).astype(np.int64)
    edges = np.stack(np.divmod(np.unique(edges[:, 0] * len(mesh.vertices) + edges[:, 1]), len(mesh.vertices)), axis=1)
    points = np.concatenate([facets.mean(axis=1), mesh.vertices[edges].mean(axis=1)])
    z, z_x, z_y = surface.heights(np.clip(points[:, 0], x_min, x_max), np.clip(points[:, 1], y_min, y_max))
    normal = np.stack([-z_x, -z_y, np.ones_like(z)], axis=1) / np.sqrt(1.0 + z_x**2 + z_y**2)[:, None]
    height = (points[:, 2] - z) * normal[:, 2]  # vertical miss times cos of the slope: the distance to first order
    at_middle = normal[: len(facets)]
    chord = lengths(mesh.facet_normals()[optical] - at_middle)
    return MeshDeviation(float(np.abs(height).max()), float(np.degrees(2.0 * np.arcsin(0.5 * np.minimum(chord.max(), 2.0)))),
                         int(optical.sum()))
