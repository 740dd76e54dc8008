"""Runs of n rays on all cores, for kernels that give up the interpreter lock."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

RUN = 16_384  # rays at most: some milliseconds of work, whose rays and results stay in a core's cache
MIN_RUN = 2_048  # rays that are worth another thread: some 0.2 ms of work against 0.05 ms to hand them over
THREADS = len(os.sched_getaffinity(0))
# Runs in all are a multiple of this: they are the same on every number of cores, since the kernels round by how rays are
# divided among blocks, and as many for each of 1, 2, 4 and 8 cores.
SHARES = 8
ALIGNED = 64  # rays: whole blocks of the kernels
_pools: list[ThreadPoolExecutor] = []  # none or one
_thread = threading.local()  # in_run: whether the thread is at one of several runs


def run_size(n: int, run: int = RUN, shares: int = SHARES) -> int:
    """Rays of a run for n of them: it depends on n, `run` and `shares`, not on the cores, and so do results.

    shares : what the number of runs is a multiple of, where they are long enough.
    """
    runs = shares * max(1, -(-n // (shares * run)))
    return min(run, max(MIN_RUN, ALIGNED * -(-n // (ALIGNED * runs))))


def parallel_for(work: Callable[[int, int], None], n: int, run: int = RUN, done: Callable[[int], None] | None = None,
                 shares: int = SHARES) -> None:
    """Call work(start, stop) for consecutive runs that cover 0 … n, on all cores.

    run, shares : as `run_size` has them.

    Inside one of several runs nothing is shared out any more: its core takes as few runs as `run` allows.

    done : called with the number of rays that are done, from the caller's thread. What it or a run raises is raised here,
    after the runs that have begun: those that have not are dropped.
    """
    if 0 < n <= MIN_RUN:  # one run, whatever else there is
        work(0, n)
        if done is not None:
            done(n)
        return
    in_run = getattr(_thread, "in_run", False)
    size = run_size(n, run, 1 if in_run else shares)
    starts = range(0, n, size)
    each = work if in_run or len(starts) <= 1 else partial(_one_of_several, work)
    if each is work or THREADS == 1:
        for start in starts:
            each(start, min(start + size, n))
            if done is not None:
                done(min(start + size, n))
        return
    if not _pools:
        _pools.append(ThreadPoolExecutor(THREADS, thread_name_prefix="rays"))
    futures = [_pools[0].submit(each, start, min(start + size, n)) for start in starts]
    try:
        for start, future in zip(starts, futures, strict=True):
            future.result()
            if done is not None:
                done(min(start + size, n))
    finally:
        for future in futures:
            future.cancel()
        for future in futures:
            if not future.cancelled():
                future.exception()  # waits: nothing may still write into what the caller frees


def _one_of_several(work: Callable[[int, int], None], start: int, stop: int) -> None:
    _thread.in_run = True
    try:
        work(start, stop)
    finally:
        _thread.in_run = False


# A forked process has none of its parent's threads: it starts its own.
os.register_at_fork(after_in_child=_pools.clear)
