"""Rays to trimmed planes, spheres and cylinders: seams, poles, loops of more than a turn, and both sides."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from mirror_cad.surfaces.quadric import Quadric
from raytrace.rays import Rays, Status, Trace
from raytrace.surfaces.quadric import QuadricFace

Array = NDArray[np.float64]
AXES = np.array([[0.6, 0.0, 0.8], [0.48, 0.8, -0.36], [-0.64, 0.6, 0.48]])
CENTRE, RADIUS = np.array([5.0, -3.0, 7.0]), 20.0
TURN = 2.0 * np.pi
OFF = 1e-12  # by which other programs' loops miss seams and poles


def face(kind: Literal["plane", "sphere", "cylinder"], *corners: tuple[float, float], one_sided: bool = True) -> QuadricFace:
    return QuadricFace(Quadric(kind, CENTRE, AXES, 0.0 if kind == "plane" else RADIUS), (np.array(corners),), 1.0, one_sided)


def radially(one: QuadricFace, u: Array, v: Array, distance_mm: float = 30.0, *, inwards: bool = True) -> Trace:
    """Rays along the normals to places of a sphere or cylinder, from without or, `distance_mm` inside, from within."""
    at = one.quadric.evaluate(u, v)
    outer = np.stack([np.cos(u), np.sin(u), np.zeros_like(u)], axis=1)
    if one.quadric.kind == "sphere":
        outer = np.stack([np.cos(v) * outer[:, 0], np.cos(v) * outer[:, 1], np.sin(v)], axis=1)
    rays = (-1.0 if inwards else 1.0) * outer @ AXES
    found = Trace.empty(len(at))
    one.first_hits(Rays(np.ascontiguousarray(at - distance_mm * rays), np.ascontiguousarray(rays)), found)
    return found


def test_a_seam_and_poles_are_no_edges_of_a_whole_sphere_whose_loop_all_but_reaches_them() -> None:
    top = 0.5 * np.pi - OFF
    ball = face("sphere", (OFF, -top), (TURN - OFF, -top), (TURN - OFF, top), (OFF, top))
    v = np.array([-0.5 * np.pi, -0.5 * np.pi + 1e-13, -1.0, 0.0, 1.0, 0.5 * np.pi - 1e-13, 0.5 * np.pi])
    for u in (0.0, 1e-13, -1e-13, TURN - 1e-13, 1.0):
        found = radially(ball, np.full_like(v, u), v)
        assert (found.status == Status.REFLECTED).all()
        assert found.distances == pytest.approx(np.full(len(v), 30.0), abs=1e-12)


def test_a_loop_winds_round_a_cylinder_more_than_once() -> None:
    """A band that climbs one radian a millimetre, a radian wide: over itself after a turn, 5.28 mm higher."""
    band = face("cylinder", (0.0, 0.0), (1.0, 0.0), (15.0, 14.0), (14.0, 14.0))
    u, v = (each.ravel() for each in np.meshgrid(np.linspace(0.05, 6.2, 40), np.linspace(0.1, 13.9, 70), indexing="ij"))
    within = ((u - v) % TURN > 0.0) & ((u - v) % TURN < 1.0)
    found = radially(band, u, v)
    assert found.distances[within] == pytest.approx(np.full(within.sum(), 30.0), abs=1e-12)
    far = np.where(np.isfinite(found.distances), found.distances, np.inf)
    assert (far[~within] > 30.5).all()  # the band behind, from within, or nothing


@pytest.mark.parametrize("kind", ["plane", "sphere", "cylinder"])
@pytest.mark.parametrize("one_sided", [True, False])
def test_both_sides_reflect_where_both_do(kind: Literal["plane", "sphere", "cylinder"], one_sided: bool) -> None:
    one = face(kind, (0.5, -0.4), (1.5, -0.4), (1.5, 0.4), (0.5, 0.4), one_sided=one_sided)
    rng = np.random.default_rng(1)
    u, v = rng.uniform(0.5, 1.5, 50), rng.uniform(-0.4, 0.4, 50)
    at = one.quadric.evaluate(u, v)
    outer = (at - CENTRE) / RADIUS if kind == "sphere" else np.tile(AXES[2], (50, 1))
    if kind == "cylinder":
        outer = (at - CENTRE - np.outer((at - CENTRE) @ AXES[2], AXES[2])) / RADIUS
    rays = outer + 0.5 * rng.normal(size=(50, 3))
    rays *= np.sign(np.einsum("ij,ij->i", rays, outer))[:, None] / np.linalg.norm(rays, axis=1, keepdims=True)
    for turned in (1.0, -1.0):  # from within, and from without
        d = turned * rays
        found = Trace.empty(50)
        one.first_hits(Rays(np.ascontiguousarray(at - 0.01 * d), np.ascontiguousarray(d)), found)
        assert found.distances == pytest.approx(np.full(50, 0.01), abs=1e-12)
        if one_sided and turned > 0.0:
            assert (found.status == Status.BEHIND).all()
            continue
        assert (found.status == Status.REFLECTED).all()
        assert np.abs(found.points - at).max() < 1e-12
        assert np.abs(found.normals + turned * outer).max() < 1e-12
        assert np.abs(found.directions - (d - 2.0 * np.einsum("ij,ij->i", d, outer)[:, None] * outer)).max() < 1e-12
