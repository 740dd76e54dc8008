"""Designs and a store in; the rows that the store does not hold yet, evaluated and appended."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mirror_studio.explore.evaluate import Row
from mirror_studio.explore.store import Store
from mirror_studio.explore.study import Value, Variants
from mirror_studio.explore.workers import Workers
from mirror_studio.progress import Progress


def evaluate_missing(study: Variants, designs: Sequence[tuple[Value, ...]], store: Store, called: str, progress: Progress,
                     scheduler: str | None = None, judge: Callable[..., Row] | None = None) -> None:
    """Evaluate each design, by its place among all, that has no row yet; each row is on disk as soon as it is there.

    Parameters
    ----------
    study : Variants
        What the designs are of.
    designs : sequence of tuples
        The values of all.
    store : Store
        Of this study.
    called : str
        What they are called where progress is told: "designs".
    progress : Progress
    scheduler : str, optional
        The address of a Dask scheduler.
    judge : callable, optional
        As `Workers` takes it.

    Raises
    ------
    MirrorError
        For a scheduler that is not reached, and a disk that takes no more.
    """
    left = [(index, values) for index, values in enumerate(designs) if index not in store.rows]
    progress.step(f"{len(designs)} {called}" + (f", {len(designs) - len(left)} of them there" if store.rows else ""))
    workers = Workers(study, scheduler, judge)
    try:
        for done, row in enumerate(workers.rows(left), 1):
            store.append(row)
            progress.share(done / len(left))
    finally:
        workers.close()
