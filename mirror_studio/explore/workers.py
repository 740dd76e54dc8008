"""Designs in, their rows out as they are done: here, on the cores of this machine, or on a cluster."""

from __future__ import annotations

import contextlib
import gc
import os
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from mirror_cad.errors import MirrorError
from mirror_studio.explore.evaluate import Row, evaluate, evaluate_file, failed
from mirror_studio.explore.study import Value, Variants
from raytrace import parallel

if TYPE_CHECKING:
    from distributed import Client

FEW = 12  # designs that are done before a cluster of processes has started
MEMORY = "2GiB"  # of a worker: a design takes some hundred MB
DEATHS = 3  # of workers, on one design, before it is left
PAUSE_S, LOOK_S = 0.02, 5.0  # between looks for rows that are done, and for workers
GONE_S = 300.0  # without any worker, after which a study ends: one that died is there again much sooner
REACHED_S = 10.0  # a scheduler answers within
AT_ONCE = 500  # designs handed out: more would only fill the scheduler's memory


class Workers:
    """Where designs are evaluated; a cluster starts with the first of more than FEW designs.

    scheduler : the address of a Dask scheduler; without one, a local cluster of one process a core.   judge : what takes the
    row of a design; `evaluate` without it.
    """

    def __init__(self, study: Variants, scheduler: str | None = None, judge: Callable[..., Row] | None = None) -> None:
        self.study, self.scheduler, self.judge = study, scheduler, judge
        self._client: Client | None = None
        self._stack = contextlib.ExitStack()
        if scheduler is not None:
            self._client = _reach(scheduler)
            self._stack.callback(self._client.close)

    def rows(self, designs: Sequence[tuple[int, tuple[Value, ...]]], from_files: bool = False) -> Iterator[Row]:
        """Evaluate designs (index, values), in the order in which they are done.

        from_files : as their exported STEP files have them.
        """
        if self._client is None and len(designs) > FEW:
            self._client = self._local()
        judge = evaluate_file if from_files else self.judge or evaluate
        for start in range(0, len(designs), AT_ONCE):
            part = designs[start:start + AT_ONCE]
            yield from self._here(part, judge) if self._client is None else self._on(self._client, part, judge)

    def close(self) -> None:
        """End what was started here."""
        self._stack.close()

    def _here(self, designs: Sequence[tuple[int, tuple[Value, ...]]], judge: Callable[..., Row]) -> Iterator[Row]:
        study = self.study
        for index, values in designs:
            yield judge(index, values, study.with_values(values), str(study.folder), study.scene, study.measures)

    def _on(self, client: Client, designs: Sequence[tuple[int, tuple[Value, ...]]], judge: Callable[..., Row]) -> Iterator[Row]:
        died: list[tuple[int, tuple[Value, ...]]] = []
        for design, row in self._done(client, designs, judge):
            if row is None:
                died.append(design)
            else:
                yield row
        # What was at work in a worker when another design ended it is not told from that one: each once more, alone.
        for design in died:
            for (index, values), row in self._done(client, [design], judge):
                yield row or failed(index, values, len(self.study.measures), f"{DEATHS} workers died on this design")

    def _done(self, client: Client, designs: Sequence[tuple[int, tuple[Value, ...]]], judge: Callable[..., Row],
              ) -> Iterator[tuple[tuple[int, tuple[Value, ...]], Row | None]]:
        """Designs with their rows, as they are done; None for one that workers died with."""
        from distributed import as_completed

        study, folder = self.study, str(self.study.folder.resolve())
        handed = {client.submit(_alone, judge, index, values, study.with_values(values), folder, study.scene, study.measures,
                                pure=False, retries=1): (index, values) for index, values in designs}
        # With their results: a row that is lost with its worker is made again, and is waited for like any other.
        coming = as_completed(list(handed), with_results=True, raise_errors=False)  # type: ignore[no-untyped-call]
        alive = looked = time.monotonic()
        while not coming.is_empty():
            batch = coming.next_batch(block=False)
            for future, found in batch:
                design = handed[future]
                if isinstance(found, Row):
                    yield design, found
                    continue
                error = found[1] if isinstance(found, tuple) else found  # what was raised, with its type and trace
                if type(error).__name__ == "KilledWorker":
                    yield design, None
                else:
                    yield design, failed(*design, len(study.measures), f"{type(error).__name__}: {error}")
            now = time.monotonic()
            if not batch:
                time.sleep(PAUSE_S)
            if batch or (now - looked > LOOK_S and client.scheduler_info()["workers"]):
                alive = now
            looked = now if now - looked > LOOK_S else looked
            if now - alive > GONE_S:
                raise MirrorError(f"no worker has been there for {GONE_S:g} s: what is there is whole, and the same command "
                                  "goes on from it")

    def _local(self) -> Client:
        import dask
        from distributed import Client, LocalCluster

        # A worker has one design at a time: another would be lost with it.
        dask.config.set({"distributed.scheduler.allowed-failures": DEATHS - 1, "distributed.worker.daemon": True,
                         "distributed.scheduler.worker-saturation": 1.0})
        cluster = self._stack.enter_context(LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=max(1, len(os.sched_getaffinity(0))), threads_per_worker=1, processes=True, memory_limit=MEMORY,
            dashboard_address="127.0.0.1:0", silence_logs=50))
        client: Client = self._stack.enter_context(Client(cluster))  # type: ignore[no-untyped-call]
        return client


def _alone(judge: Callable[..., Row], *given: object) -> Row:
    """One design in a worker, which is one of several on its machine: on one thread, and what was loaded is no garbage."""
    if parallel.THREADS != 1:
        parallel.THREADS = 1
        gc.freeze()
    return judge(*given)


def _reach(address: str) -> Client:
    from distributed import Client

    try:
        return Client(address, timeout=REACHED_S)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TimeoutError) as error:
        raise MirrorError(f"--scheduler {address}: no scheduler is reached there within {REACHED_S:g} s "
                          f"({type(error).__name__}); start one with `dask scheduler`, or leave the option out") from None
