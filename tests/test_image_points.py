"""Where a mirror shows a point: each ray's own place, whatever point of the ray is asked for."""

from __future__ import annotations

import numpy as np
import pytest

from raytrace.viewing.pose import Pose
from raytrace.viewing.view import View
from raytrace.visibility.image_points import image_points
from tests.test_straight_lines import CENTRE, EYE, ball

NEAREST_MM = 5.0  # before the mirror: of what is nearer, Newton misses one in a hundred


@pytest.mark.parametrize("radius", [170.0, 250.0, 950.0])
def test_any_point_of_a_reflected_ray_is_shown_where_the_ray_was_aimed(radius: float) -> None:
    """A convex mirror shows a point once; strongly bent, and near by, steps of Newton go too far and are halved."""
    view = View(ball(radius), Pose(CENTRE, np.zeros(3), np.radians(22.0), np.radians(3.0)), EYE)
    outline = view.on_plane_of(view.reflector.outline())
    chance = np.random.default_rng(13)
    on_plane = chance.uniform(outline.min(axis=0), outline.max(axis=0), (4000, 2))
    traced = view.trace_points(on_plane)
    on_plane, points, directions = on_plane[traced.seen], traced.points[traced.seen], traced.directions[traced.seen]
    assert len(on_plane) > 3000
    distance = NEAREST_MM * 10.0 ** chance.uniform(0.0, 4.5, len(on_plane))
    found, shown = image_points(view, points + distance[:, None] * directions)
    assert shown.all()
    assert np.linalg.norm(found - on_plane, axis=1).max() < 1e-6
    found, shown = image_points(view, directions, at_infinity=True)
    assert shown.all()
    assert np.linalg.norm(found - on_plane, axis=1).max() < 1e-6
