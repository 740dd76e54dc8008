"""Kernels keep working arrays from call to call: what the call before has left there changes no bit of an answer."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

import mirror_cad
from mirror_cad.surfaces.bspline import BSplineSurface
from raytrace.kernels import first_hit, glass, height_field, height_field_search, order, parametric, picture_plane, quadrics
from raytrace.kernels.blocks import BLOCK, Results, work
from raytrace.kernels.outcomes import HIT, LOST, OUTSIDE
from raytrace.kernels.trees import NODES
from raytrace.rays import Rays, Trace
from raytrace.surfaces.bspline import BSplineFace, run_kernel
from raytrace.surfaces.plate import Plate
from raytrace.surfaces.quadric import quadrics_of
from tests.conftest import constant, spec_of

Array = NDArray[np.float64]
Kernel = Callable[[Array, Array, Results], None]

RAYS = 60 * BLOCK + 5  # the last block is not full
BOX = np.array([110.0, 120.0])  # half of what rays are aimed at, mm
LEFT: dict[str, Callable[[np.random.Generator, int], Array]] = {
    "NaN": lambda rng, n: np.full(n, np.nan),
    "inf": lambda rng, n: rng.choice([-np.inf, np.inf], n),
    "lengths": lambda rng, n: rng.normal(scale=100.0, size=n),  # which could be places, and distances
    "counts": lambda rng, n: rng.integers(0, 500, n).astype(float),  # which could be where a cell's coefficients begin
    # Each row alike: two of them could be the ends of a cell that holds all rays.
    "ends": lambda rng, n: np.repeat(rng.choice([-200.0, 200.0], -(-n // BLOCK)), BLOCK)[:n],
}
TURNS = (*LEFT, *["ends"] * 60)


def aimed(seed: int) -> Rays:
    """Blocks of rays that lie together and apart, among them rays along the sheet, from below, beside it, and that are none."""
    rng = np.random.default_rng(seed)
    spread = np.repeat(rng.choice([0.01, 0.1, 1.2], -(-RAYS // BLOCK)), BLOCK)[:RAYS, None]
    centre = np.repeat(rng.uniform(-0.9, 0.9, (-(-RAYS // BLOCK), 2)), BLOCK, axis=0)[:RAYS]
    at = np.column_stack([(centre + spread * rng.uniform(-1.0, 1.0, (RAYS, 2))) * BOX, rng.uniform(-2.0, 2.0, RAYS)])
    origins = at + [50.0, 80.0, 700.0] + spread * rng.normal(scale=100.0, size=(RAYS, 3))
    odd = rng.permutation(RAYS)[:200]
    origins[odd[:100]] = at[odd[:100]] + rng.normal(scale=200.0, size=(100, 3)) * [1.0, 1.0, 0.05]  # along it
    origins[odd[100:160], 2] *= -1.0
    directions = at - origins
    directions[odd[160:190]] = rng.choice([0.0, np.nan, np.inf, 1e-200, 1e200], (30, 3))
    origins[odd[190:200]] = rng.choice([np.nan, np.inf, 1e200], (10, 3))
    return Rays(origins, directions)


def designed() -> BSplineFace:
    """A sheet z(x, y) inside its outline."""
    mirror = mirror_cad.design(spec_of({"law": "linear", "right_mm": 1250.0, "left_mm": 300.0}, constant(1300.0)))
    return BSplineFace(mirror.surface, (mirror.outline.polyline(1e-2),))


def curved(rational: bool) -> BSplineFace:
    """A sheet of which u and v are not x and y."""
    rng = np.random.default_rng(4)
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, 8), np.ones(3)])
    x, y = np.meshgrid(np.linspace(-120.0, 120.0, 10), np.linspace(-130.0, 130.0, 10), indexing="ij")
    poles = np.stack([x + rng.uniform(-1.0, 1.0, x.shape), y, -1e-4 * (x * x + y * y)], axis=-1)
    loop = np.array([[0.1, 0.1], [0.9, 0.2], [0.8, 0.9], [0.2, 0.8]])
    return BSplineFace(BSplineSurface(3, 3, knots, knots, poles, rng.uniform(0.8, 1.2, x.shape) if rational else None), (loop,))


def behind_glass() -> Plate:
    mirror = mirror_cad.design(spec_of({"law": "linear", "right_mm": 1250.0, "left_mm": 400.0}, constant(1300.0),
                                       glass={"reflecting": "back"}))
    loop = (mirror.outline.polyline(1e-2),)
    return Plate(BSplineFace(mirror.plate.front, loop), BSplineFace(mirror.plate.back, loop), 1.52)


def fill(seed: int, left: str | None) -> None:
    """Leave such numbers in the calling thread's working arrays, and any outcomes; or what they hold when they are made."""
    rng = np.random.default_rng(seed)
    rows, state, paraboloid = work()
    for array in (rows, paraboloid):
        array[:] = 0.0 if left is None else LEFT[left](rng, array.size)
    state[:] = 0 if left is None else rng.integers(-128, 128, state.size)


def answers(kernel: Kernel, rays: Rays, eye: bool) -> Trace:
    """What a kernel writes over arrays that have held something else."""
    found = Trace.empty(len(rays))
    for array in found.arrays:
        array[:] = 77
    kernel(rays.origins[:1].ravel() if eye else rays.origins.ravel(), rays.directions.ravel(), found.flat)
    return found


def assert_same(found: Trace, expected: Trace) -> None:
    for one, other in zip(found.arrays, expected.arrays, strict=True):
        np.testing.assert_array_equal(one, other)


def assert_nothing_left_is_read(kernel: Kernel) -> None:
    """Of all rays, and of each block alone, since the block before it may leave what hides what the call before has left."""
    for seed, eye in enumerate((False, True)):
        rays = aimed(seed)
        if eye:
            from_one = np.array([50.0, 80.0, 700.0])
            rays = Rays(np.tile(from_one, (RAYS, 1)), rays.directions + rays.origins - from_one)
        for first in (None, *range(0, RAYS, BLOCK)):
            some = rays if first is None else Rays(rays.origins[first:first + BLOCK], rays.directions[first:first + BLOCK])
            fill(0, None)
            clean = answers(kernel, some, eye)
            for turn, left in enumerate(TURNS if first is None else TURNS[:12]):
                fill(turn, left)
                assert_same(answers(kernel, some, eye), clean)
            if first is None:
                assert (clean.status == HIT).sum() > 100
                assert (clean.status != HIT).sum() > 100


def test_newton_on_a_height_field_reads_nothing_that_was_left() -> None:
    face = designed()
    assert face.height_field is not None
    kernel = partial(height_field.hits, face.height_field, face.trimming.strips)
    assert_nothing_left_is_read(kernel)
    statuses = set(answers(kernel, aimed(0), False).status)
    assert {HIT, OUTSIDE, LOST} <= statuses


@pytest.mark.parametrize("one_sided", [True, False])
def test_the_search_on_a_height_field_reads_nothing_that_was_left(one_sided: bool) -> None:
    face = designed()
    assert face.height_field is not None
    assert_nothing_left_is_read(partial(height_field_search.first_hits, face.height_field, face.trimming.strips, one_sided))


@pytest.mark.parametrize("rational", [True, False])
def test_newton_on_a_parametric_sheet_reads_nothing_that_was_left(rational: bool) -> None:
    face = curved(rational)
    assert len(face.patches.sheet)
    assert_nothing_left_is_read(partial(parametric.hits, face.patches, face.trimming.strips, face.sign, True))


def test_glass_reads_nothing_that_was_left() -> None:
    """But how far the back was for the lane's last ray, where it begins: that is set as a run begins."""
    sheets = behind_glass()._sheets
    assert sheets is not None
    assert_nothing_left_is_read(partial(glass.hits, sheets))
    rays, passed = aimed(0), []
    for left in LEFT:
        fill(1, left)
        passed.append(np.full(glass.PASSED * RAYS, 77.0))
        answers(partial(glass.hits, sheets, passed=passed[-1]), rays, False)
        np.testing.assert_array_equal(passed[-1], passed[0])
    assert not (passed[0] == 77.0).any()


def test_rays_that_are_sorted_read_nothing_that_was_left() -> None:
    face = designed()
    n = order.LEAST
    assert face.height_field is not None
    parts = [aimed(seed) for seed in range(-(-n // RAYS))]
    mixed = np.random.default_rng(1).permutation(len(parts) * RAYS)[:n]
    rays = Rays(np.concatenate([each.origins for each in parts])[mixed],
                np.concatenate([each.directions for each in parts])[mixed])
    room = order.room(n)
    found = []
    for left in LEFT:
        fill(2, left)
        for array in (room.origins, room.directions, room.places, *room.results[1:]):
            array[:] = LEFT[left](np.random.default_rng(3), array.size)
        for integers in (room.bins, room.starts, room.columns, room.results.status):
            integers[:] = np.random.default_rng(3).integers(-100, 100, integers.size)
        found.append(Trace.empty(n))
        run_kernel(partial(height_field.hits, face.height_field, face.trimming.strips), rays, found[-1], face.sorting_grid)
        assert_same(found[-1], found[0])
    # They were sorted; the room may have been made for more rays before.
    assert (room.results.status[:n] == found[0].status[np.argsort(room.bins[:n])]).all()


@pytest.mark.parametrize("rational", [True, False])
def test_the_search_in_pieces_reads_nothing_that_was_left(rational: bool) -> None:
    face, rays = curved(rational), aimed(0)
    _, units, valid = rays.units()
    found = []
    for left in LEFT:
        rng = np.random.default_rng(6)
        own = first_hit._Work.empty()
        for array in (own.ray, own.q, own.waiting, own.found, own.entries):
            array[:] = LEFT[left](rng, array.size).reshape(array.shape)
        own.stack[:] = rng.integers(0, 100, own.stack.size)
        found.append(Trace.empty(RAYS))
        found[-1].status[:] = OUTSIDE
        found[-1].invalidate(np.arange(RAYS))
        first_hit._first_hits(face.pieces, own, rays.origins.ravel(), units.ravel(), valid, found[-1].flat)
        assert_same(found[-1], found[0])
    assert (found[0].status == HIT).sum() > 100
    assert (found[0].status == OUTSIDE).sum() > 100


def test_the_search_among_quadrics_reads_nothing_that_was_left() -> None:
    from mirror_cad.surfaces.quadric import Quadric
    from raytrace.surfaces.quadric import QuadricFace

    rng = np.random.default_rng(7)
    loop = np.array([[-3.0, -1.4], [3.0, -1.4], [3.0, 1.4], [-3.0, 1.4]])
    faces = tuple(QuadricFace(Quadric("sphere", np.append(rng.uniform(-1.0, 1.0, 2) * BOX, 0.0), np.eye(3), 10.0), (loop,))
                  for _ in range(60))
    tree, rays, found = quadrics_of(faces), aimed(0), []
    _, units, valid = rays.units()
    for left in LEFT:
        stack, entries = rng.integers(0, 100, NODES), LEFT[left](rng, NODES)
        found.append(Trace.empty(RAYS))
        for array in found[-1].arrays:
            array[:] = 77
        quadrics.meet_first(tree, stack, entries, rays.origins.ravel(), units.ravel(), valid, found[-1].flat)
        assert_same(found[-1], found[0])
    assert (found[0].status == HIT).sum() > 100
    assert (found[0].status == OUTSIDE).sum() > 100


@pytest.mark.parametrize("shape", [(40, 60), (1, 60), (40, 1), (1, 1), (2, 2)])
def test_pictures_on_a_plane_read_nothing_that_was_left(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(8)
    status = rng.choice(np.array([HIT, HIT, HIT, OUTSIDE], dtype=np.int8), RAYS)
    points, directions = rng.uniform(-100.0, 100.0, (RAYS, 3)), rng.normal(size=(RAYS, 3)) * [0.05, 0.05, 0.0] + [0.0, 0.0, 1.0]
    directions[::7, 2] *= -1.0
    points[status != HIT] = directions[status != HIT] = np.nan
    inner, outer = (picture_plane.OnPlane.of(rng.integers(0, 256, (*shape, 3)).astype(np.uint8), half, half,
                                             max(shape) / (2.0 * half)) for half in (150.0, 400.0))
    colours = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])
    sums = []
    for left in LEFT:
        fill(3, left)
        sums.append(np.zeros((RAYS, 3)))
        picture_plane.add_colours(status, points, directions, 2000.0, inner, outer, *colours, sums[-1], 1)
        np.testing.assert_array_equal(sums[-1], sums[0])
    assert (sums[0] == colours[0]).all(axis=1).sum() == (status != HIT).sum()
    assert (sums[0] == colours[1]).all(axis=1).sum() > 50  # beside both
    assert len(np.unique(sums[0], axis=0)) > min(shape)
