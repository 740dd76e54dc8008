"""A tolerance study in, its rows, tables and page out; the same command goes on where it ended."""

from __future__ import annotations

import json
from pathlib import Path

from mirror_cad.errors import MirrorError
from mirror_studio.explore.missing import evaluate_missing
from mirror_studio.explore.replaced import replace_table, replace_text
from mirror_studio.explore.store import Store
from mirror_studio.json_types import Json, JsonObject
from mirror_studio.progress import Progress
from mirror_studio.tolerances.file import Tolerances
from mirror_studio.tolerances.made import evaluate_made
from mirror_studio.tolerances.sheet import limit_in_words, write_sheet
from mirror_studio.tolerances.statistics import Outcome, Outcomes, outcomes
from raytrace.measures.registry import registered

SUMMARY, PAGE = "tolerances.json", "tolerances.html"


def tolerances(study: Tolerances, out: Path, progress: Progress, scheduler: str | None = None,
               ) -> tuple[JsonObject, tuple[str, ...]]:
    """Make and measure all mirrors of a study that the folder does not hold yet, and sum them up.

    Writes rows.csv, rows.parquet, measures.csv, indices.csv, tolerances.json and tolerances.html.

    Parameters
    ----------
    study : Tolerances
        What may depart by how much.
    out : Path
        The folder.
    progress : Progress
        Told what is being done.
    scheduler : str, optional
        The address of a Dask scheduler.

    Returns
    -------
    content : dict
        What tolerances.json holds.
    missed : tuple of str
        A sentence for each limit that the interval of its measure is not within.

    Raises
    ------
    MirrorError
        Where the design itself cannot be made or measured, for a folder of another study, a scheduler that is not reached, and
        a disk that takes no more.
    """
    designed = evaluate_made(0, (), study.as_designed(), str(study.folder), study.scene, study.measures)
    if designed.status != "ok":
        raise MirrorError(f"the design without departures: {designed.cause}")
    store = Store(out, study)
    try:
        mirrors = study.mirrors()
        evaluate_missing(study, mirrors, store, "mirrors", progress, scheduler, evaluate_made)
        store.tables()
        found = outcomes(study, designed, [store.rows[index] for index in range(len(mirrors))])
    finally:
        store.close()
    content = as_json(study, found, len(mirrors))
    _write_tables(out, found)
    write_sheet(out / PAGE, study, found, len(mirrors))
    replace_text(out / SUMMARY, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    progress.step(f"{len(mirrors)} mirrors, {found.failed} failed"
                  + ("" if found.inside is None else f"; {100.0 * found.inside:.1f} % meet all limits") + f", in {out}")
    return content, _missed(study, found)


def as_json(study: Tolerances, found: Outcomes, mirrors: int) -> JsonObject:
    """What tolerances.json holds.

    Parameters
    ----------
    study : Tolerances
        What may depart.
    found : Outcomes
        Of its mirrors.
    mirrors : int
        How many.
    """
    of: dict[str, Json] = {factor.name: {"of": factor.what, "size": factor.size_in_words} for factor in study.factors}
    measures: dict[str, Json] = {name: _outcome_as_json(name, one) for name, one in found.by_measure.items()}
    return {"schema": 1, "name": str(study.raw.get("name", "")), "scene": study.scene, "mirrors": mirrors,
            "failed": found.failed, "samples": study.file.samples, "seed": study.file.seed,
            "interval_percent": study.file.interval_percent, "tolerances": of, "share_inside_all": found.inside,
            "share_inside_all_interval": found.inside_interval, "measures": measures}


def _outcome_as_json(name: str, one: Outcome) -> JsonObject:
    known = registered().get(name)
    indices: dict[str, Json] = {
        factor: {"first": index.first, "first_interval": index.first_interval, "total": index.total,
                 "total_interval": index.total_interval, "sigma_without": index.sigma_without}
        for factor, index in one.indices.items()}
    return {"unit": None if known is None else known.unit, "designed": one.designed, "mean": one.mean, "sigma": one.sigma,
            "interval": one.interval, "least": float(one.values.min()) if one.values.size else None,
            "most": float(one.values.max()) if one.values.size else None, "missing": one.missing,
            "limit": None if one.limit is None else [end if abs(end) < float("inf") else None for end in one.limit],
            "share_inside": one.inside, "share_inside_interval": one.inside_interval,
            "indices": indices, "indices_from_samples": one.indices_from}


def _write_tables(out: Path, found: Outcomes) -> None:
    replace_table(out / "measures.csv", ("measure", "designed", "mean", "sigma", "interval_low", "interval_high", "missing",
                                      "limit_least", "limit_most", "share_inside"),
               ((name, one.designed, one.mean, one.sigma, *(one.interval or (None, None)), one.missing,
                 *(one.limit or (None, None)), one.inside) for name, one in found.by_measure.items()))
    replace_table(out / "indices.csv", ("measure", "tolerance", "first", "first_low", "first_high", "total", "total_low",
                                     "total_high", "sigma_without"),
               ((name, factor, index.first, *index.first_interval, index.total, *index.total_interval, index.sigma_without)
                for name, one in found.by_measure.items() for factor, index in one.indices.items()))


def _missed(study: Tolerances, found: Outcomes) -> tuple[str, ...]:
    said = []
    for name, one in found.by_measure.items():
        if one.limit is None:
            continue
        if one.interval is None:
            said.append(f"{name}: no mirror has it")
        elif one.interval[0] < one.limit[0] or one.interval[1] > one.limit[1]:
            known = registered().get(name)
            unit, decimals = ("", 4) if known is None else (f" {known.unit}", known.decimals + 1)
            low, high = one.interval
            said.append(f"{name}: {study.file.interval_percent:g} % of the mirrors have {low:.{decimals}f} to "
                        f"{high:.{decimals}f}{unit}, asked for is {limit_in_words(*one.limit)}{unit}; "
                        f"{100.0 * (one.inside or 0.0):.1f} % are inside")
    return tuple(said)
