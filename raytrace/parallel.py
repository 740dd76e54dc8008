"""Work on n rays in, the same work on runs of them on all cores out: for kernels that give up the interpreter lock."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

RUN = 16_384  # rays at most: some milliseconds of work, whose rays and results stay in a core's cache
MIN_RUN = 2_048  # rays that are worth another thread: some 0.2 ms of work against 0.05 ms to hand them over
THREADS = len(os.sched_getaffinity(0))
PREFIX = "rays"
_pools: list[ThreadPoolExecutor] = []  # none or one


def parallel_for(work: Callable[[int, int], None], n: int, run: int = RUN, done: Callable[[int], None] | None = None) -> None:
    """Call work(start, stop) for consecutive runs that cover 0 … n, on all cores; inside such a run, on its own core.

    done : called with the number of rays that are done, from the caller's thread. What it or a run raises is raised here,
    after the runs that have begun: those that have not are dropped.
    """
    inside = threading.current_thread().name.startswith(PREFIX)
    cores = 1 if inside else THREADS
    rounds = max(1, -(-n // (cores * run)))  # as many runs for each core
    size = min(run, max(MIN_RUN, -(-n // (cores * rounds))))
    starts = range(0, n, size)
    if len(starts) <= 1 or inside:
        for start in starts:
            work(start, min(start + size, n))
            if done is not None:
                done(min(start + size, n))
        return
    if not _pools:
        _pools.append(ThreadPoolExecutor(THREADS, thread_name_prefix=PREFIX))
    futures = [_pools[0].submit(work, start, min(start + size, n)) for start in starts]
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


# A forked process has none of its parent's threads: it starts its own.
os.register_at_fork(after_in_child=_pools.clear)
