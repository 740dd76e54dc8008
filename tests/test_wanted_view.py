"""Views that a mirror is made for: what they ask for at their nodes, between and beyond, and how it turns over the mirror."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirror_cad.wanted_view import (
    EqualAngles,
    Line,
    SplineAngle,
    StraightVerticals,
    TableView,
    WantedView,
    on_plane,
    wanted_directions,
)

Array = NDArray[np.float64]
X, Y = np.linspace(-100.0, 90.0, 8), np.linspace(-130.0, 140.0, 6)


def azimuth(x: Array, y: Array) -> Array:
    """A cubic: what degree 3 holds exactly."""
    return 0.1 - 3e-3 * x + 4e-6 * x**2 + 2e-8 * x**3 + 1e-6 * x * y


def elevation(x: Array, y: Array) -> Array:
    return 0.02 + 2e-3 * y - 3e-6 * y**2 + 1e-8 * y**3 + 2e-6 * x * y


TABLE = TableView(X, Y, azimuth(X[:, None], Y), elevation(X[:, None], Y))
STRAIGHT = StraightVerticals(SplineAngle(X, azimuth(X, np.zeros(8))), EqualAngles(Line(-130.0, 140.0, -0.3, 0.4)))


def test_a_column_is_the_cubic_of_its_nodes_and_its_tangent_beyond() -> None:
    column = SplineAngle(X, azimuth(X, np.zeros(8)))
    x = np.linspace(X[0], X[-1], 41)
    tangent, _ = column(x)
    assert np.arctan(tangent) == pytest.approx(azimuth(x, np.zeros(41)), abs=1e-13)
    for end in (X[0], X[-1]):
        slope = -3e-3 + 8e-6 * end + 6e-8 * end**2
        tangent, _ = column(np.array([end + 30.0 * np.sign(end)]))
        assert np.arctan(tangent[0]) == pytest.approx(azimuth(end, np.zeros(1))[0] + slope * 30.0 * np.sign(end), abs=1e-13)


def test_a_table_is_the_cubic_of_its_nodes_and_straight_on_along_both_axes_beyond() -> None:
    chance = np.random.default_rng(1)
    x, y = chance.uniform(X[0], X[-1], 200), chance.uniform(Y[0], Y[-1], 200)
    found = TABLE.tangents(x, y)
    assert np.arctan(found.x) == pytest.approx(azimuth(x, y), abs=1e-13)
    assert np.arctan(found.y) == pytest.approx(elevation(x, y), abs=1e-13)
    at, h = (X[-1], Y[0]), 1e-3
    beyond = TABLE.tangents(np.array([at[0] + 20.0]), np.array([at[1] - 25.0]))
    for angle, got, twist in ((azimuth, beyond.x, 1e-6), (elevation, beyond.y, 2e-6)):
        by_x = (angle(at[0] + h, at[1]) - angle(at[0] - h, at[1])) / (2.0 * h)
        by_y = (angle(at[0], at[1] + h) - angle(at[0], at[1] - h)) / (2.0 * h)
        assert np.arctan(got[0]) == pytest.approx(angle(*at) + 20.0 * by_x - 25.0 * by_y - 20.0 * 25.0 * twist, abs=1e-10)


@pytest.mark.parametrize("view", [TABLE, STRAIGHT])
def test_stated_derivatives_are_those_of_the_tangents_inside_and_beyond(view: WantedView) -> None:
    chance = np.random.default_rng(2)
    x, y, h = chance.uniform(-140.0, 130.0, 300), chance.uniform(-170.0, 180.0, 300), 1e-3
    found = view.tangents(x, y)
    across = [view.tangents(x + d, y) for d in (-h, h)]
    up = [view.tangents(x, y + d) for d in (-h, h)]
    for k, (by_x, by_y) in enumerate(((found.x_by_x, found.x_by_y), (found.y_by_x, found.y_by_y))):
        assert by_x == pytest.approx((across[1][k] - across[0][k]) / (2.0 * h), abs=1e-9)
        assert by_y == pytest.approx((up[1][k] - up[0][k]) / (2.0 * h), abs=1e-9)


def test_wanted_directions_are_of_unit_length_along_the_tangents() -> None:
    x, y = np.array([-60.0, 10.0, 80.0]), np.array([50.0, -20.0, 120.0])
    found = wanted_directions(TABLE, x, y)
    assert np.linalg.norm(found, axis=1) == pytest.approx(np.ones(3), abs=1e-15)
    assert found[:, 0] / found[:, 2] == pytest.approx(np.tan(azimuth(x, y)), abs=1e-12)
    assert found[:, 1] / found[:, 2] == pytest.approx(np.tan(elevation(x, y)), abs=1e-12)


def test_wanted_directions_keep_the_shape_of_the_places() -> None:
    x, y = np.meshgrid(np.linspace(-60.0, 60.0, 4), np.linspace(-90.0, 90.0, 3))
    found = wanted_directions(TABLE, x, y)
    assert found.shape == (3, 4, 3)
    assert found.reshape(-1, 3) == pytest.approx(wanted_directions(TABLE, x.ravel(), y.ravel()), abs=1e-15)


def test_a_ray_from_the_eye_crosses_the_plane_on_its_way_to_the_point() -> None:
    eye, point = np.array([110.0, 30.0, 762.0]), np.array([[-90.0, -70.0, -12.5]])
    x, y = on_plane(eye, point)
    place = np.array([x[0], y[0], 0.0])
    assert np.cross(place - eye, point[0] - eye) == pytest.approx(np.zeros(3), abs=1e-9)
