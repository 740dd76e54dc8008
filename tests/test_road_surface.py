"""The asphalt of the built-in road: where its joints lie, and that its grain keeps its mean."""

from __future__ import annotations

import numpy as np
import pytest

from raytrace.scene.road import _asphalt

NO_LANES = np.zeros((0, 2))


@pytest.mark.parametrize("half_width", [60.0, 90.0])
def test_the_joint_between_two_layers_runs_70_mm_beside_the_line_s_edge(half_width: float) -> None:
    line = np.array([[-1750.0, half_width, 6000.0, 12_000.0]])
    x = np.linspace(2_000.0, 400_000.0, 1500)
    beside = np.arange(20.0, 121.0, 5.0)
    tone = [np.mean([_asphalt(at, -1750.0 + half_width + d, 5.0, 5.0, NO_LANES, line) for at in x]) for d in beside]
    assert beside[int(np.argmin(tone))] == pytest.approx(70.0, abs=10.0)  # it wanders by 14 mm
    assert min(tone) < 0.85 * np.mean([tone[0], tone[-1]])
    # Nothing of the kind on the other side.
    other = [np.mean([_asphalt(at, -1750.0 - half_width - d, 5.0, 5.0, NO_LANES, line) for at in x])
             for d in (20.0, 70.0, 120.0)]
    assert other[1] == pytest.approx(other[0], rel=0.05)


def test_worn_asphalt_reflects_an_eighth_on_average_whatever_a_ray_covers() -> None:
    chance = np.random.default_rng(7)
    x, y = chance.uniform(0.0, 1e6, 4000), chance.uniform(-1e4, 1e4, 4000)
    for half in (0.5, 50.0, 5000.0):
        tone = [_asphalt(a, b, half, half, NO_LANES, np.zeros((0, 4))) for a, b in zip(x, y, strict=True)]
        assert np.mean(tone) == pytest.approx(0.118, rel=0.05)
