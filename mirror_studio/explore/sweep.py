"""A study in, the table of all its designs out."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from mirror_studio.explore.missing import evaluate_missing
from mirror_studio.explore.page import PAGE, write_page
from mirror_studio.explore.store import Store
from mirror_studio.explore.study import Study
from mirror_studio.progress import Progress


def sweep(study: Study, out: Path, progress: Progress, scheduler: str | None = None) -> dict[str, int]:
    """Evaluate every design that the folder does not hold yet; returns how many are ok and failed.

    Parameters
    ----------
    study : Study
    out : Path
        Where rows.csv, rows.parquet, study.html and the store are; the same study goes on where it ended.
    progress : Progress
    scheduler : str, optional
        The address of a Dask scheduler.

    Raises
    ------
    MirrorError
        For a folder of another study, a scheduler that is not reached, and a disk that takes no more.
    """
    store = Store(out, study)
    try:
        evaluate_missing(study, study.designs(), store, "designs", progress, scheduler)
        store.tables()
        write_page(out / PAGE, study, [store.rows[index] for index in sorted(store.rows)])
    finally:
        store.close()
    found = Counter(row.status for row in store.rows.values())
    progress.step(f"{found['ok']} ok, {found['failed']} failed, in {out}")
    return {"ok": found["ok"], "failed": found["failed"]}
