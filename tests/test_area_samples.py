"""Samples of a face by area, of which a mirror is seated: against the areas and centroids of spheres, meshes and sheets."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirror_cad.mesh import SurfaceMesh
from raytrace.surfaces.mesh import MeshSurface
from raytrace.surfaces.trimming import Trimming
from tests.meshes import grid, icosphere
from tests.test_straight_lines import ball, upright_cylinder

Array = NDArray[np.float64]


def test_a_cap_of_a_sphere_has_its_area_centroid_and_outward_normals() -> None:
    """A box of longitude and latitude on a sphere: R²·Δu·2 sin v, and ∬ R·n dA in closed form."""
    radius, half_u, half_v = 950.0, 115.0 / 950.0, 150.0 / 950.0
    samples = ball(radius).surface.area_samples()
    areas = np.linalg.norm(samples.areas, axis=1)
    exact = radius**2 * 2.0 * half_u * 2.0 * np.sin(half_v)
    assert areas.sum() == pytest.approx(exact, rel=1e-4)  # flat cells
    centre = np.array([0.0, 0.0, -radius])
    normals = (samples.points - centre) / radius
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-12)  # on the face
    assert np.einsum("ij,ij->i", samples.areas, normals) == pytest.approx(areas, rel=1e-4)
    # Mean of z + R over the cap: R·∫cos u du/(2u)·∫cos² v dv/∫cos v dv.
    mean = radius * np.sin(half_u) / half_u * (0.5 * half_v + 0.25 * np.sin(2.0 * half_v)) / np.sin(half_v)
    # The middles of 16 × 16 cells miss 1/256 of the sag.
    assert np.average(samples.points, axis=0, weights=areas) == pytest.approx([0.0, 0.0, mean - radius], abs=1.1 * 6.24 / 256)
    assert np.average(samples.points[:, 0] ** 2, weights=areas) == pytest.approx(
        radius**2 * (0.5 - np.sin(2.0 * half_u) / (4.0 * half_u)) * (1.0 - np.sin(half_v) ** 2 / 3.0), rel=5e-3)


def test_a_strip_of_a_cylinder_has_its_area_and_lies_on_it() -> None:
    samples = upright_cylinder(900.0).surface.area_samples()
    assert np.linalg.norm(samples.areas, axis=1).sum() == pytest.approx(230.0 * 300.0, rel=1e-4)
    assert np.hypot(samples.points[:, 0], samples.points[:, 2] + 900.0) == pytest.approx(900.0, rel=1e-12)


def test_facets_have_their_areas_outward_and_a_closed_mesh_none_in_all() -> None:
    vertices, faces = icosphere(3)
    samples = MeshSurface(SurfaceMesh(100.0 * vertices, faces)).area_samples()
    assert samples.areas.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-8)
    volume = np.einsum("ij,ij->", samples.points, samples.areas) / 3.0  # Gauss, exact on facets
    a, b, c = (100.0 * vertices[faces[:, k]] for k in range(3))
    assert volume == pytest.approx(float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0, rel=1e-12)
    x, y, faces = grid(np.linspace(0.0, 30.0, 4), np.linspace(0.0, 20.0, 3))
    samples = MeshSurface(SurfaceMesh(np.stack([x, y, 0.5 * x], axis=1), faces)).area_samples()
    assert np.linalg.norm(samples.areas, axis=1) == pytest.approx(0.5 * 10.0 * 10.0 * np.sqrt(1.25), rel=1e-12)
    assert samples.areas.sum(axis=0) == pytest.approx([-300.0, 0.0, 600.0], rel=1e-12)


def test_a_loop_without_an_inside_has_none() -> None:
    flat = Trimming.of((np.array([[0.0, 1.0], [2.0, 1.0], [1.0, 1.0]]),))
    assert not flat.contains(np.array([0.5, 1.5, 0.5]), np.array([1.0, 1.0, 0.9])).any()
