"""Derivatives of reflected rays: what the shape operator gives is what exact rays beside come to."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirror_cad.surfaces.bspline import BSplineSurface
from mirror_cad.surfaces.quadric import Quadric
from raytrace.rays import Rays, Trace
from raytrace.surfaces.base import OpticalSurface
from raytrace.surfaces.bspline import BSplineFace
from raytrace.surfaces.differentials import traced_differentials
from raytrace.surfaces.quadric import QuadricFace
from tests.conftest import designed

Array = NDArray[np.float64]

EYE = np.array([115.0, 40.0, 762.0])
RADIUS = 950.0


def loop(u: float, v: float) -> Array:
    return np.array([[-u, -v], [u, -v], [u, v], [-u, v]])


def spline(name: str) -> BSplineFace:
    surface = designed(name).surface
    return BSplineFace(surface, (loop(100.0, 120.0),))


def turned(face: BSplineFace) -> BSplineFace:
    """The same sheet with its parameters the other way round and stretched: no z(x, y) over its own parameters."""
    s = face.surface
    again = BSplineSurface(s.degree_v, s.degree_u, 3.0 * s.knots_v, 3.0 * s.knots_u, s.poles.transpose(1, 0, 2).copy(), None)
    return BSplineFace(again, (loop(360.0, 300.0),), sign=-1.0)


def rational_cylinder() -> BSplineFace:
    """A part of an upright cylinder that touches z = 0 at the origin, as the NURBS of an exact arc."""
    half = np.arcsin(130.0 / RADIUS)
    x, z, w = RADIUS * np.sin(half), RADIUS * np.cos(half) - RADIUS, np.cos(half)
    arc = np.array([[-x, 0.0, z], [0.0, 0.0, RADIUS / w - RADIUS], [x, 0.0, z]])
    poles = np.stack([arc + [0.0, y, 0.0] for y in (-160.0, 160.0)], axis=1)
    weights = np.array([[1.0, 1.0], [w, w], [1.0, 1.0]])
    knots = (np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0]), np.array([-1.0, -1.0, 1.0, 1.0]))
    return BSplineFace(BSplineSurface(2, 1, *knots, poles, weights), (loop(0.9, 0.8),))


def quadric(kind: str, side: float = 1.0) -> QuadricFace:
    """Convex (side 1) or concave, 200 × 240 mm, touching z = 0 at the origin."""
    axes = np.eye(3) if kind == "plane" else side * np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    u, v = 100.0 / (1.0 if kind == "plane" else RADIUS), 120.0 / (RADIUS if kind == "sphere" else 1.0)
    shape = Quadric(kind, np.array([0.0, 0.0, 0.0 if kind == "plane" else -side * RADIUS]), axes, RADIUS)  # type: ignore[arg-type]
    return QuadricFace(shape, (loop(u, v),), one_sided=False)


SURFACES: dict[str, OpticalSurface] = {
    "height field": spline("progressive-c"), "other parameters": turned(spline("progressive-c")),
    "rational": rational_cylinder(), "plane": quadric("plane"), "sphere": quadric("sphere"), "cylinder": quadric("cylinder"),
    "concave sphere": quadric("sphere", -1.0), "concave cylinder": quadric("cylinder", -1.0)}


def rays_at(surface: OpticalSurface, n: int = 40) -> tuple[Array, Array, Trace]:
    """Unit rays from the eye that the surface reflects, two turns of each that are neither level nor equal, and the trace."""
    rng = np.random.default_rng(7)
    at = rng.uniform([-80.0, -100.0], [80.0, 100.0], (n, 2))
    rays = np.concatenate([at, np.zeros((n, 1))], axis=1) - EYE
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    turns = rng.normal(size=(n, 2, 3))
    turns -= np.einsum("nki,ni->nk", turns, rays)[:, :, None] * rays[:, None]
    found = Trace.empty(n)
    surface.untrimmed().first_hits(Rays(EYE[None], rays), found)
    assert (found.status == 0).all()
    return rays, turns, found


def traced(surface: OpticalSurface, rays: Array, turns: Array, found: Trace, turn: float) -> tuple[Array, Array]:
    def reflect(asked: Array) -> tuple[Array, Array]:
        beside = Trace.empty(len(asked))
        surface.untrimmed().first_hits(Rays(EYE[None], np.ascontiguousarray(asked)), beside)
        return beside.points, beside.directions

    return traced_differentials(reflect, rays, turns, found.points, found.directions, turn, False)


@pytest.mark.parametrize("name", SURFACES)
def test_differences_of_exact_rays_come_to_the_closed_form_with_the_square_of_their_turn(name: str) -> None:
    surface = SURFACES[name]
    rays, turns, found = rays_at(surface)
    tensors = surface.curvature_tensors(found.points, found.normals)
    assert np.isfinite(tensors).all()  # so that no differences are compared with themselves
    exact = surface.ray_differentials(EYE, rays, turns, found.points, found.directions)
    off = [[float(np.abs(a - b).max() / np.abs(b).max())
            for a, b in zip(traced(surface, rays, turns, found, turn), exact, strict=True)] for turn in (2e-4, 1e-4, 1.5e-5)]
    for coarse, fine, finest in np.transpose(off):
        assert fine < 1e-6
        assert fine < 0.3 * coarse or fine < 1e-10  # a plane has no third derivative of its directions
        assert finest < 2e-8  # what is left at 1e-4 over 44, and rounding of 1e-16·762/1.5e-5


def test_a_rational_cylinder_bends_normals_as_a_cylinder_does() -> None:
    spline_face, closed = SURFACES["rational"], SURFACES["cylinder"]
    _, _, found = rays_at(spline_face)
    ours = spline_face.curvature_tensors(found.points, found.normals)
    expected = closed.curvature_tensors(found.points, found.normals)
    np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-11 / RADIUS)


def test_both_ways_to_the_curvature_of_a_sheet_agree() -> None:
    """The kernel on the height field, and the parameters of a point found again on the same sheet."""
    field, other = SURFACES["height field"], SURFACES["other parameters"]
    _, _, found = rays_at(field)
    np.testing.assert_allclose(other.curvature_tensors(found.points, found.normals),
                               field.curvature_tensors(found.points, found.normals), rtol=0.0, atol=1e-14)
    np.testing.assert_array_equal(field.curvature_tensors(found.points, -found.normals),
                                  -field.curvature_tensors(found.points, found.normals))


def test_parameters_of_points_are_found_again() -> None:
    face = turned(spline("progressive-c"))
    u_min, u_max, v_min, v_max = face.surface.domain
    given = np.random.default_rng(3).uniform([u_min, v_min], [u_max, v_max], (500, 2))
    points = face.surface.evaluate(*given.T)
    np.testing.assert_allclose(face.parameters_of(points), given, rtol=0.0, atol=1e-9)
    points[:, 2] += 1e-3
    assert np.isnan(face.parameters_of(points)).all()  # a micrometre beside the sheet is not on it


def test_a_face_without_closed_form_is_differenced() -> None:
    """A plane of which nothing is known but where rays meet it has the derivatives of one that says so."""
    class Unknown(QuadricFace):
        def curvature_tensors(self, points: Array, normals: Array) -> Array:
            return OpticalSurface.curvature_tensors(self, points, normals)

    known = quadric("sphere")
    unknown = Unknown(known.quadric, known.loops, known.sign, known.one_sided)
    rays, turns, found = rays_at(known)
    for a, b in zip(unknown.ray_differentials(EYE, rays, turns, found.points, found.directions),
                    known.ray_differentials(EYE, rays, turns, found.points, found.directions), strict=True):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=2e-8 * float(np.abs(b).max()))
