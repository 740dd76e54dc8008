"""Kernels: what numba's cache holds of them is as new as the sources of all of them."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from raytrace.kernels import compiled
from raytrace.kernels.blocks import BLOCK, MAX_ROWS, clamp, work
from raytrace.kernels.image_points import nearest_rays, newton_step
from raytrace.kernels.loops import extent, least_along
from raytrace.kernels.plan import swept_lines
from raytrace.kernels.sheet_rim import Rim, rim_points
from raytrace.kernels.trees import entered, inverse, tree_of

KERNELS = Path(compiled.__file__).parent
CALLED = """from raytrace.kernels.compiled import compiled


@compiled()
def constant():
    return {}
"""
CALLS = """from raytrace.kernels.called import constant
from raytrace.kernels.compiled import compiled


@compiled()
def twice():
    return 2 * constant()
"""


class Index:
    """Where numba keeps one function, `save` apart."""

    def __init__(self, folder: Path, save: Callable[[object, object], None]) -> None:
        self.save, self._cache_path, self._index_name = save, str(folder), "twice-1.py3.nbi"

    def _load_index(self) -> dict[str, str]:
        return {"int64": "twice-1.py3.2.nbc"}


def in_new_process(home: Path, code: str) -> str:
    """What it says. Python's own cache, which takes sources of one second and size for the same, is left out."""
    return subprocess.run([sys.executable, "-B", "-c", f"from raytrace.kernels.calls import twice; {code}"], check=True,
                          capture_output=True, text=True, cwd=home, env={**os.environ, "PYTHONPATH": str(home)}).stdout


def of_twice(home: Path) -> tuple[int, int]:
    """What a new process finds, and how much of it was kept."""
    value, hits = in_new_process(home, "print(twice(), sum(twice.stats.cache_hits.values()))").split()
    return int(value), int(hits)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Where these functions stand, with what compiles kernels."""
    found = tmp_path / "raytrace" / "kernels"
    found.mkdir(parents=True)
    for folder in (found, found.parent):
        (folder / "__init__.py").write_text("")
    (found / "compiled.py").write_bytes((KERNELS / "compiled.py").read_bytes())
    (found / "calls.py").write_text(CALLS)
    (found / "called.py").write_text(CALLED.format(3))
    return found


def test_a_change_in_a_kernel_that_another_calls_is_noticed(tmp_path: Path, package: Path) -> None:
    assert of_twice(tmp_path) == (6, 0)
    assert of_twice(tmp_path) == (6, 1)  # from the cache
    (package / "called.py").write_text(CALLED.format(5))
    assert of_twice(tmp_path) == (10, 0)


@pytest.mark.parametrize("ends", ["os._exit(0)", "raise_(OSError(28, 'No space left on device'))"])
def test_a_process_that_ends_while_it_keeps_a_kernel_leaves_nothing_of_older_sources(tmp_path: Path, package: Path, ends: str,
                                                                                      ) -> None:
    assert of_twice(tmp_path) == (6, 0)
    (package / "called.py").write_text(CALLED.format(5))
    in_new_process(tmp_path, f"""
import os


def raise_(error):
    raise error


twice._cache._cache_file._save_data = lambda name, data: {ends}
assert twice() == 10
""")
    assert of_twice(tmp_path) == (10, 0)
    assert of_twice(tmp_path) == (10, 1)


def test_what_is_compiled_is_kept_by_one_process_at_a_time(tmp_path: Path) -> None:
    def save(key: object, data: object) -> None:
        handle = os.open(tmp_path, os.O_RDONLY)
        with pytest.raises(BlockingIOError):
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.close(handle)
        kept.append((key, data))

    kept: list[tuple[object, object]] = []
    mine, others = ("twice-1.py3.1.nbc", "twice-1.py3.2.nbc"), ("twice-12.py3.1.nbc", "twice-1.py3.nbi")
    for name in (*mine, *others):
        (tmp_path / name).write_text("")
    compiled._alone(Index(tmp_path, save))("float64", b"code")
    assert kept == [("float64", b"code")]
    assert {path.name for path in tmp_path.iterdir()} == {mine[1], *others}  # what its index does not name has gone


def test_python_gets_what_only_kernels_call_interpreted() -> None:
    assert clamp(3.0, 0.0, 1.0) == 1.0  # there is no compiled way in: a call of that would end the process


def test_a_threads_rows_begin_where_a_cache_line_does() -> None:
    rows, state, paraboloid = work()
    assert rows.size == MAX_ROWS * BLOCK
    assert rows.ctypes.data % 64 == 0
    assert paraboloid.ctypes.data % 64 == 0
    assert state.size == BLOCK
    assert work().rows is rows


@pytest.mark.parametrize("direction", [(0.6, -0.8, 0.0), (0.0, 0.0, 1.0), (-0.36, 0.48, -0.8)])
def test_a_ray_enters_the_boxes_of_a_tree_where_it_enters_their_slabs(direction: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(2)
    low = rng.uniform(-50.0, 50.0, (300, 3))
    size = rng.uniform(1.0, 30.0, (300, 3))
    size[np.arange(0, 300, 3), np.arange(100) % 3] = 0.0  # as that of a plane along the axes
    boxes = np.concatenate([low, low + size], axis=1)
    tree, order = tree_of(boxes)
    assert sorted(order) == list(range(300))
    leaves = tree.links[tree.links[:, 1] > 0]
    assert leaves[:, 1].sum() == 300
    np.testing.assert_array_equal(tree.boxes[0], [*boxes[:, :3].min(axis=0), *boxes[:, 3:].max(axis=0)])
    ix, iy, iz = (inverse(each) for each in direction)
    for k, box in enumerate(boxes):
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([box[:3], box[3:]]) / np.array(direction)
        through = np.array(direction) != 0.0
        near, far = ends.min(axis=0)[through].max(), ends.max(axis=0)[through].min()
        between = ((box[:3] <= 0.0) & (box[3:] >= 0.0))[~through].all()
        wanted = near if between and near <= far and far > 0.0 else np.inf
        assert entered(boxes, k, 0.0, 0.0, 0.0, ix, iy, iz, np.inf) == pytest.approx(wanted, rel=1e-14, abs=1e-12)


@pytest.mark.parametrize("least", [0, 3, 6])
def test_the_least_product_is_found_wherever_it_stands(least: int) -> None:
    rng = np.random.default_rng(4)
    directions, direction = rng.normal(size=(7, 3)), np.array([0.6, 0.0, -0.8])
    directions[least] = -9.0 * direction
    assert least_along(directions, direction) == pytest.approx(-9.0, rel=1e-15)
    centre, low, high = extent(directions[:, :2], directions)
    assert centre == pytest.approx(directions[:, :2].mean(axis=0), rel=1e-14)
    assert (low.tolist(), high.tolist()) == (directions[:, :2].min(axis=0).tolist(), directions[:, :2].max(axis=0).tolist())


def test_a_curve_s_last_piece_has_its_end() -> None:
    start, end = np.array([[0.0, 0.0], [1.0, 0.0], [9.0, 9.0]]), np.array([[1.0, 0.0], [1.0, 2.0], [8.0, 8.0]])
    rim = Rim(start[:2], end[:2], np.zeros(1, dtype=np.intp), np.array([2]))  # another curve's piece stands behind it in memory
    found = rim_points(rim, np.zeros(3, dtype=np.intp), np.array([0.0, 0.75, 1.0]))
    assert found.tolist() == [[0.0, 0.0], [1.0, 1.0], [1.0, 2.0]]


def test_a_step_of_newton_s_is_no_longer_than_it_may_be_and_points_where_it_did() -> None:
    step = np.zeros(2)
    newton_step(2.0, 0.0, 0.0, 0.5, np.array([-6.0, -2.0]), 10.0, step)
    assert step.tolist() == [3.0, 4.0]
    newton_step(2e-3, 0.0, 0.0, 5e-4, np.array([-6.0, -2.0]), 10.0, step)
    assert step == pytest.approx([6.0, 8.0], rel=1e-15)
    with np.errstate(invalid="ignore"):
        newton_step(0.0, 0.0, 0.0, 0.0, np.array([-6.0, -2.0]), 10.0, step)
    assert step == pytest.approx([6.0, 8.0], rel=1e-15)  # where the derivatives fail it stays


@pytest.mark.parametrize("at_infinity", [True, False])
def test_the_ray_that_goes_most_nearly_towards_a_target_is_found_wherever_it_starts(at_infinity: bool) -> None:
    rng = np.random.default_rng(7)
    points, directions, wanted = rng.uniform(-90.0, 90.0, (40, 3)), rng.normal(size=(40, 3)), rng.normal(size=(30, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    wanted *= (1.0 if at_infinity else 150.0) / np.linalg.norm(wanted, axis=1, keepdims=True)
    towards = wanted[:, None] - (0.0 if at_infinity else points)
    cosine = np.einsum("nmc,mc->nm", towards / np.linalg.norm(towards, axis=2, keepdims=True) + 0.0 * directions, directions)
    nearest = np.empty(30, dtype=np.intp)
    nearest_rays(wanted, at_infinity, points, directions, nearest)
    np.testing.assert_array_equal(nearest, cosine.argmax(axis=1))


def test_a_line_through_vertices_of_an_edge_is_crossed_as_often_as_one_beside_them() -> None:
    """Rays from 1 mm above the plane to X = 0, 2, 4, 2, in turn: lines through these are swept over twice, or not at all."""
    points = np.array([[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 5.0, 1.0], [-1.0, 5.0, 1.0]])
    directions = np.array([0.0, 2.0, 4.0, 2.0])[:, None] * [1.0, 0.0, 0.0] - points * [1.0, 0.0, 1.0]
    after = np.array([1, 2, 3, 0])
    for values in ([2.0, 3.0], [1.0, 2.0], [1.0, 2.0, 3.0], [-1.0, 5.0], [2.0], [3.0]):
        _, row = swept_lines(points, directions, after, 0, 0.0, np.array(values), 1.0, 0.5 * np.pi)
        assert np.bincount(row, minlength=len(values)).tolist() == [2 if 0.0 < value < 4.0 else 0 for value in values], values
