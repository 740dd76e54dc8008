"""The picture on the reference plane: linear between its elements, even over the outermost half ones, none beside."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from raytrace.rays import Trace
from raytrace.scene.reference import BACKGROUND, BESIDE, ReferencePlane

Array = NDArray[np.float64]
Z = 5000.0
PICTURE = np.random.default_rng(8).integers(0, 256, (6, 9, 3)).astype(np.uint8)


def seen(plane: ReferencePlane, x: Array, y: Array, samples: int = 1, lost: int = 0) -> Array:
    """Colours of slanting rays that land at (x, y); the first `lost` are not reflected."""
    n = len(x)
    points = np.random.default_rng(9).uniform(-100.0, 100.0, (n, 3))
    directions = np.stack([x, y, np.full(n, Z)], axis=1) - points
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    status = np.where(np.arange(n) < lost, 1, 0).astype(np.int8)
    trace = Trace(status, points, directions, directions, np.ones(n))
    sums = np.zeros((n // samples, 3))
    plane.add_colours(trace, np.zeros(3), directions, sums, samples)
    return sums


def bilinear(plane: ReferencePlane, x: Array, y: Array) -> Array:
    """By scipy, the elements' middles as nodes; beyond them as at the nearest."""
    x_min, x_max, y_min, y_max = plane.bounds()
    rows, columns = plane.picture.shape[:2]
    row, column = (y_max - y) / (y_max - y_min) * rows - 0.5, (x_max - x) / (x_max - x_min) * columns - 0.5
    given = RegularGridInterpolator((np.arange(rows), np.arange(columns)), plane.picture.astype(float))
    found: Array = given(np.stack([np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)], axis=-1))
    return found


def test_a_picture_is_linear_between_its_elements_up_to_its_edges_and_dark_beside_them() -> None:
    plane = ReferencePlane(PICTURE, Z, 900.0, (-200.0, 50.0))
    x_min, x_max, y_min, y_max = plane.bounds()
    assert (x_min, x_max, y_min, y_max) == (-650.0, 250.0, -250.0, 350.0)
    chance = np.random.default_rng(10)
    x, y = chance.uniform(x_min, x_max, 2000), chance.uniform(y_min, y_max, 2000)
    # Along all four edges too, a thousandth of a millimetre inside.
    x[:100], x[100:200], y[200:300], y[300:400] = x_min + 1e-3, x_max - 1e-3, y_min + 1e-3, y_max - 1e-3
    assert seen(plane, x, y) == pytest.approx(bilinear(plane, x, y), abs=1e-7)
    for beside in ((x_min - 1e-3, 0.0), (x_max + 1e-3, 0.0), (0.0, y_min - 1e-3), (0.0, y_max + 1e-3)):
        assert seen(plane, np.array(beside[:1]), np.array(beside[1:]))[0] == pytest.approx(BESIDE)


def test_a_picture_goes_on_in_the_one_beyond_it() -> None:
    outer = ReferencePlane(PICTURE[::-1], Z, 1800.0, (-100.0, 0.0))
    plane = ReferencePlane(PICTURE, Z, 900.0, (-200.0, 50.0), outer)
    x, y = np.array([-900.0, 300.0, 0.0, 0.0]), np.array([0.0, 0.0, 400.0, -300.0])
    assert seen(plane, x, y) == pytest.approx(bilinear(outer, x, y), abs=1e-7)
    assert seen(plane, np.array([-1001.0]), np.array([0.0]))[0] == pytest.approx(BESIDE)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (4, 1)])
def test_a_picture_of_one_row_or_column_is_even_across_it(shape: tuple[int, int]) -> None:
    picture = np.random.default_rng(11).integers(0, 256, (*shape, 3)).astype(np.uint8)
    plane = ReferencePlane(picture, Z, 900.0, (0.0, 0.0))
    x_min, x_max, y_min, y_max = plane.bounds()
    chance = np.random.default_rng(12)
    x, y = chance.uniform(x_min, x_max, 300), chance.uniform(y_min, y_max, 300)
    if shape == (1, 1):
        assert seen(plane, x, y) == pytest.approx(np.broadcast_to(picture[0, 0].astype(float), (300, 3)))
        return
    along, values = (x, picture[0]) if shape[0] == 1 else (y, picture[:, 0])
    low, high, count = (x_min, x_max, shape[1]) if shape[0] == 1 else (y_min, y_max, shape[0])
    place = (high - along) / (high - low) * count - 0.5
    wanted = np.stack([np.interp(place, np.arange(count), values[:, c]) for c in range(3)], axis=1)
    assert seen(plane, x, y) == pytest.approx(wanted, abs=1e-7)


def test_several_rays_make_one_sum_and_lost_ones_see_the_background() -> None:
    plane = ReferencePlane(PICTURE, Z, 900.0, (-200.0, 50.0))
    x, y = np.linspace(-600.0, 200.0, 8), np.linspace(-200.0, 300.0, 8)
    each = bilinear(plane, x, y)
    each[:3] = BACKGROUND
    assert seen(plane, x, y, samples=4, lost=3) == pytest.approx(each.reshape(2, 4, 3).sum(axis=1), abs=1e-7)
    assert plane.to_display(np.array([[0.4, 0.6, 254.5]])).tolist() == [[0, 1, 254]]


@pytest.mark.parametrize("beyond", [False, True])
def test_a_ray_sees_the_same_whatever_the_rays_beside_it_see(beyond: bool) -> None:
    """Sixteen rays that all land on one picture are taken together, others one by one: to the bit it is the same."""
    chance = np.random.default_rng(13)
    for rows, columns in ((2, 2), (2, 7), (5, 2), (6, 9)):
        picture = chance.integers(0, 256, (rows, columns, 3)).astype(np.uint8)
        outer = ReferencePlane(picture[::-1].copy(), Z, 1800.0, (-100.0, 0.0)) if beyond else None
        plane = ReferencePlane(picture, Z, 900.0, (-200.0, 50.0), outer)
        x_min, x_max, y_min, y_max = plane.bounds()
        for _ in range(50):
            # Blocks on the picture, beside it and across its edge, and one that is not whole.
            reach = chance.choice([0.4, 0.5, 3.0], 4).repeat(16)[:chance.integers(33, 65)]
            x = -200.0 + chance.uniform(-1.0, 1.0, len(reach)) * reach * (x_max - x_min)
            y = 50.0 + chance.uniform(-1.0, 1.0, len(reach)) * reach * (y_max - y_min)
            points = chance.uniform(-100.0, 100.0, (len(x), 3))
            directions = np.stack([x, y, np.full(len(x), Z)], axis=1) - points
            directions[chance.random(len(x)) < 0.02, 2] = 0.0  # along the plane
            status = (chance.random(len(x)) < 0.03).astype(np.int8)
            trace = Trace(status, points, directions, directions, np.ones(len(x)))
            alone = np.concatenate([colours(plane, trace, slice(k, k + 1)) for k in range(len(x))])
            assert (colours(plane, trace, slice(None)) == alone).all()


def colours(plane: ReferencePlane, trace: Trace, rays: slice) -> Array:
    some = Trace(*(array[rays] for array in trace.arrays))
    sums = np.zeros((len(some.status), 3))
    plane.add_colours(some, np.zeros(3), some.directions, sums, 1)
    return sums
