"""The other side of a plate: points off a sphere along its normals, by as many halvings of the spans as that takes."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from mirror_cad.outline import Outline
from mirror_cad.outline.segments import Arc
from mirror_cad.surfaces.collocation import collocate_height
from mirror_cad.surfaces.offset import OFFSET_TOLERANCE_MM, offset_surface
from mirror_cad.surfaces.sphere import SphericalSag

ROUND = Outline((Arc((0.0, 0.0), 40.0, 0.0, 2.0 * np.pi),))
RADIUS, THICKNESS = 100.0, 3.0


@pytest.mark.parametrize(("reflecting", "other", "behind"), [("front", "back", -THICKNESS), ("back", "front", THICKNESS)])
def test_the_other_side_of_a_sphere_is_the_sphere_of_the_radius_and_the_thickness(
        reflecting: Literal["front", "back"], other: str, behind: float) -> None:
    knots = np.concatenate([np.full(5, -45.0), np.linspace(-45.0, 45.0, 5), np.full(5, 45.0)])
    sphere = collocate_height(SphericalSag(1.0 / RADIUS).height, knots, knots, 5)
    face, error = offset_surface(sphere, ROUND, THICKNESS, reflecting)
    assert error <= OFFSET_TOLERANCE_MM[other]
    # On as many spans as the sphere the offset misses it: they are halved, evenly, and end where they ended.
    spans = len(np.unique(face.knots_u)) - 1
    assert spans in (4, 8, 16, 32)
    assert (spans > 4) == (reflecting == "back")
    assert np.unique(face.knots_v) == pytest.approx(np.linspace(-45.0, 45.0, spans + 1), abs=1e-12)
    chance = np.random.default_rng(5)
    r, angle = 40.0 * np.sqrt(chance.uniform(0.0, 1.0, 300)), chance.uniform(0.0, 2.0 * np.pi, 300)
    u, v = r * np.cos(angle), r * np.sin(angle)
    centre = np.array([0.0, 0.0, -RADIUS])
    off = np.linalg.norm(face.evaluate(u, v) - centre, axis=1) - (RADIUS + behind)
    held = np.abs(np.linalg.norm(sphere.evaluate(u, v) - centre, axis=1) - RADIUS).max()  # of the sphere, by its spans
    assert np.abs(off).max() < 1.5 * OFFSET_TOLERANCE_MM[other] + 5.0 * held
