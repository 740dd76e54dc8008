"""The interface of a tracer in the benchmark: the work to be timed, or why it is absent."""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_studio.bench import measuring
from mirror_studio.bench.tracers.case import Rays

CORES = 2  # for every tracer, and threads for those that take a number: what a small machine has
MAX_ROUNDS, ENOUGH_S = 25, 1.0
REST_S = 0.02  # before each work: some leave threads that wait for more in a loop, and would take a core from the next
HOW_TO_INSTALL = "pip install 'mirror-cad[peers]'"

# A run: the whole trace from the arrays that the tracer takes to the directions after reflection, (n, 3) of any float,
# NaN where nothing was found.
Work = Callable[[], NDArray[Any]]


class AbsentError(Exception):
    """A peer that cannot run here, with the reason and what to do."""


@dataclass(frozen=True, slots=True)
class Tracer:
    """name : as the tables have it.   prepare : makes the work for rays; casting them to what the tracer takes is not timed.

    most : rays that it is given at most; more would take too long.   note : what its rows say beside the figures.
    """

    name: str
    prepare: Callable[[Rays], Work]
    most: int = 1_000_000
    note: str | None = None


def installed(module: str) -> Any:
    """An optional module. Raises: AbsentError where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise AbsentError(f"absent: {HOW_TO_INSTALL}") from None


def reflected(directions: NDArray[Any], normals: NDArray[Any]) -> NDArray[Any]:
    """d − 2(d·n)n, in the precision of the arrays."""
    dot = np.einsum("ij,ij->i", directions, normals)
    return directions - 2.0 * dot[:, None] * normals


def interleaved_seconds(works: Sequence[Callable[[], Any]]) -> NDArray[np.float64]:
    """Times (rounds, works): in each round every work once, after a rest, so that a busy machine slows all alike.

    measuring.RUNS rounds, and up to MAX_ROUNDS where they take less than ENOUGH_S in all.
    """
    rounds: list[list[float]] = []
    most = MAX_ROUNDS if measuring.RUNS else 1
    began = time.perf_counter()
    while len(rounds) < most and (len(rounds) < max(1, measuring.RUNS) or time.perf_counter() - began < ENOUGH_S):
        rounds.append([])
        for work in works:
            time.sleep(REST_S)
            start = time.perf_counter()
            work()
            rounds[-1].append(time.perf_counter() - start)
    return np.array(rounds)


@contextmanager
def few_cores() -> Iterator[None]:
    """Run this process on CORES cores, whatever number of threads each tracer starts."""
    before = os.sched_getaffinity(0)
    _bind(set(sorted(before)[:CORES]))
    try:
        yield
    finally:
        _bind(before)


def _bind(cores: set[int]) -> None:
    """Every thread there is; those that they start inherit it."""
    for task in Path("/proc/self/task").iterdir():
        with suppress(ProcessLookupError):  # it has just ended
            os.sched_setaffinity(int(task.name), cores)
