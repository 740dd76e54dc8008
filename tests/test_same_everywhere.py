"""The same bytes on any number of cores: sums and kernels round by how work is divided, so the division is fixed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import raytrace
from mirror_cad.design_stages import design
from raytrace import parallel
from raytrace.parallel import ALIGNED, MIN_RUN, RUN, run_size
from raytrace.reflector import Reflector
from tests.conftest import constant, spec_of


@given(st.integers(1, 3_000_000), st.sampled_from([1, 100, 4096, RUN]))
def test_runs_are_whole_blocks_and_as_many_for_each_core(n: int, run: int) -> None:
    size = run_size(n, run)
    assert 1 <= size <= run
    if MIN_RUN < size < run:
        assert size % ALIGNED == 0
        assert -(-n // size) <= 8 * max(1, -(-n // (8 * run)))


def test_rays_are_reflected_to_the_same_bits_by_one_thread_and_by_three(monkeypatch: pytest.MonkeyPatch) -> None:
    reflector = Reflector.from_mirror(design(spec_of(constant(1250.0), constant(900.0))))
    rng, eye = np.random.default_rng(5), np.array([115.0, 0.0, 750.0])
    rays = np.column_stack([rng.uniform(-130, 130, 70_001), rng.uniform(-180, 180, 70_001), np.zeros(70_001)]) - eye
    found = []
    for threads in (1, 3):
        monkeypatch.setattr(parallel, "THREADS", threads)
        monkeypatch.setattr(parallel, "_pools", [])
        trace = raytrace.reflect(reflector, eye, rays)
        found.append(trace.points.tobytes() + trace.directions.tobytes() + trace.status.tobytes())
    assert found[0] == found[1]


@pytest.mark.parametrize("threads", [1, 3])
def test_a_run_of_several_is_divided_no_further_on_any_number_of_threads(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "THREADS", threads)
    monkeypatch.setattr(parallel, "_pools", [])

    def parts_within(n: int) -> list[set[int]]:
        found: list[set[int]] = []

        def work(start: int, stop: int) -> None:
            inner: set[int] = set()
            parallel.parallel_for(lambda a, b: inner.add(b - a), 10_000)
            found.append(inner)

        parallel.parallel_for(work, n)
        return found

    assert parts_within(20_000) == [{10_000}] * 8
    assert parts_within(100) == [{2048, 10_000 - 4 * 2048}]  # one run alone leaves the other cores free


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity") or len(os.sched_getaffinity(0)) < 2, reason="needs two cores")
def test_a_set_is_the_same_on_one_core_and_on_all(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(
        'name = "small"\n[horizontal]\nlaw = "linear"\nright_mm = 1250.0\nleft_mm = 900.0\n[vertical]\nlaw = "constant"\n'
        "radius_mm = 1250.0\n[view]\nwidth_px = 300\n")
    cores = sorted(os.sched_getaffinity(0))
    hashes = []
    for some in (cores[:1], cores):
        program = f"import os; os.sched_setaffinity(0, {set(some)!r}); from mirror_studio.__main__ import main; main()"
        subprocess.run([sys.executable, "-c", program, "build", "small.toml", "--out", f"set-{len(some)}"], cwd=tmp_path,
                       check=True, capture_output=True, env=os.environ | {"SOURCE_DATE_EPOCH": "1700000000"})
        hashes.append(json.loads((tmp_path / f"set-{len(some)}" / "manifest.json").read_text())["files"])
    assert hashes[0] == hashes[1]
