"""The sky's share near bodies: grids over the ground, bilinear between their nodes, however they are turned."""

from __future__ import annotations

import numpy as np
import pytest

from raytrace.scene.shading import contact_shadows


def test_a_bilinear_share_is_met_exactly_and_shares_of_several_bodies_are_multiplied() -> None:
    turn, node, corner = np.radians(30.0), 50.0, np.array([400.0, -300.0])
    across, along = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    shape = (5, 7)

    def share(i: np.ndarray, j: np.ndarray) -> np.ndarray:
        return 0.2 + 0.1 * i + 0.05 * j - 0.01 * i * j

    grid = share(*np.meshgrid(np.arange(5.0), np.arange(7.0), indexing="ij")).ravel()
    # A second body, of which 0.5 of the sky is left everywhere, over all of the first.
    frames = np.array([[*corner, *across / node, *along / node], [-1000.0, -1000.0, 1e-3, 0.0, 0.0, 1e-3]])
    shapes = np.array([[0, *shape], [grid.size, 4, 4]])
    shares = np.concatenate([grid, np.full(16, 0.5)])
    chance = np.random.default_rng(6)
    i, j = chance.uniform(0.0, 4.0, 400), chance.uniform(0.0, 6.0, 400)
    i[:3], j[:3] = [0.0, 4.0, 4.0], [0.0, 0.0, 6.0]  # and the corners; the turn rounds the last ones' numbers
    inner = np.r_[3:400]
    points = np.column_stack([corner + node * (i[:, None] * across + j[:, None] * along), np.zeros(400)])
    first, which = np.array([0, 2]), np.array([0, 1])  # one bin that both lie in
    sky = np.full(400, 0.8)
    contact_shadows(points, first, which, -1e4, 2e4, frames, shapes, shares, sky)
    assert sky[inner] == pytest.approx(0.8 * 0.5 * share(i, j)[inner], rel=1e-12)
    # Beside the first grid only the second counts; beside both, and beside the bins, none does.
    beside = np.array([[*(corner - 60.0 * along), 0.0], [5000.0, 0.0, 0.0], [1.5e4, 0.0, 0.0], [-1.1e4, 0.0, 0.0]])
    sky = np.full(4, 0.8)
    contact_shadows(beside, first, which, -1e4, 2e4, frames, shapes, shares, sky)
    assert sky == pytest.approx([0.4, 0.8, 0.8, 0.8], rel=1e-12)
