"""A study with [optimise] in, the front of what is possible out: NSGA-II for several objectives, SLSQP for one."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirror_studio.explore.evaluate import Row
from mirror_studio.explore.front import SUMMARY
from mirror_studio.explore.page import PAGE, write_page
from mirror_studio.explore.replaced import replace_text
from mirror_studio.explore.store import Store, write_rows
from mirror_studio.explore.study import OptimiseSection, Study, Value
from mirror_studio.explore.workers import Workers
from mirror_studio.progress import Progress
from raytrace.measures.registry import registered

Array = NDArray[np.float64]

# What a design that has no figure counts as: beyond anything that a measure can be, and finite, as optimisers want it.
NO_FIGURE = 1e9
DIFFERENCE = 1e-4  # of a range: figures are exact to some 1e-9, so that the gradient has five digits
ACTIVE = 1e-3  # of a limit's size: what lies nearer to it is held by it


@dataclass(frozen=True, eq=False)
class Optimum:
    """What was found.

    front : the rows that no other beats, in the order of the first objective; empty where none meets the limits.
    nearest : where none does, the row that comes nearest, and by how much it misses each limit.
    settled : the hypervolume over evaluations, (n, 2), of several objectives; of one its best value.
    active : the limits that hold the best row of one objective back.
    multipliers : of these, by how much its objective would be better for one unit more of the limit, in both's units; and of
        keys that stand at an end of their range, for one unit more of that.
    unsettled : what of the objective's slope at that row limits and ends of ranges do not hold, as a share: 0 at an optimum.
    """

    front: tuple[Row, ...]
    nearest: tuple[Row, dict[str, float]] | None
    settled: tuple[tuple[int, float], ...]
    active: tuple[str, ...]
    evaluations: int
    failed: int
    multipliers: dict[str, float] = field(default_factory=dict)
    unsettled: float | None = None


class _Judge:
    """Figures as what is minimised, and as constraints that hold where they are ≤ 0."""

    def __init__(self, study: Study, asked: OptimiseSection) -> None:
        at = {name: k for k, name in enumerate(study.measures)}
        self.objectives = [(at[name], 1.0) for name in asked.minimise] + [(at[name], -1.0) for name in asked.maximise]
        # A lane that bends the other way is as bent: of what may have either sign and serves by being small, the size counts.
        known = registered()
        self.by_size = {at[name] for name in (*asked.minimise, *asked.maximise)
                        if name in known and known[name].better == "less"}
        self.limits = [(name, at[name], sign, end) for name, (least, most) in asked.limits.items()
                       for sign, end in ((-1.0, least), (1.0, most)) if np.isfinite(end)]

    def objectives_of(self, row: Row) -> Array:
        return np.array([NO_FIGURE if (value := row.figures[k]) is None else sign * (abs(value) if k in self.by_size else value)
                         for k, sign in self.objectives])

    def misses(self, row: Row) -> Array:
        """By how much each limit is missed, negative where it is met, in shares of its size."""
        return np.array([NO_FIGURE if (value := row.figures[k]) is None else sign * (value - end) / max(abs(end), 1.0)
                         for _, k, sign, end in self.limits])

    def feasible(self, row: Row) -> bool:
        return bool(row.status == "ok" and (self.objectives_of(row) < NO_FIGURE).all() and (self.misses(row) <= 0.0).all())


class _Evaluations:
    """Rows by their values: from the store where they are there, so that the same command goes over the same ground at once."""

    def __init__(self, study: Study, store: Store, workers: Workers, progress: Progress) -> None:
        self.study, self.store, self.workers, self.progress = study, store, workers, progress
        self.by_values = {row.values: row for row in store.rows.values()}
        self.asked: list[Row] = []
        self.low = np.array([each.from_ or 0.0 for each in study.file.vary.values()])
        self.high = np.array([each.to or 0.0 for each in study.file.vary.values()])

    def __call__(self, shares: Array) -> list[Row]:
        wanted = [tuple(float(v) for v in self.low + (self.high - self.low) * row) for row in np.atleast_2d(shares)]
        missing: list[tuple[Value, ...]] = [values for values in dict.fromkeys(wanted) if values not in self.by_values]
        following = max(self.store.rows, default=-1) + 1
        # Numbered by their place and kept in that order, so that the store is the same whichever worker is done first.
        waiting: dict[int, Row] = {}
        for row in self.workers.rows(list(enumerate(missing, following))):
            waiting[row.index] = row
            while (row_next := waiting.pop(following, None)) is not None:
                self.store.append(row_next)
                self.by_values[row_next.values] = row_next
                following += 1
        rows = [self.by_values[values] for values in wanted]
        self.asked += rows
        return rows


def optimise(study: Study, out: Path, progress: Progress, scheduler: str | None = None) -> Optimum:
    """Look for the designs that [optimise] asks for; the same study goes on where it ended.

    Writes rows.csv, rows.parquet, front.csv, study.html and optimise.json.

    Parameters
    ----------
    study : Study
        With an [optimise] section.
    out : Path
    progress : Progress
    scheduler : str, optional
        The address of a Dask scheduler.

    Returns
    -------
    Optimum

    Raises
    ------
    MirrorError
        As `sweep`.

    References
    ----------
    K. Deb et al., "A fast and elitist multiobjective genetic algorithm: NSGA-II", IEEE Trans. Evol. Comput. 6, 182 (2002).
    """
    asked = study.file.optimise
    assert asked is not None
    judge = _Judge(study, asked)
    store = Store(out, study)
    try:
        workers = Workers(study, scheduler)
        try:
            evaluations = _Evaluations(study, store, workers, progress)
            multipliers: dict[str, float] = {}
            unsettled = None
            if len(judge.objectives) == 1:
                settled = _one(evaluations, judge, study.file.seed, asked)
                multipliers, unsettled = _held_by(evaluations, judge)
            else:
                settled = _several(evaluations, judge, study.file.seed, asked)
            rows = [store.rows[index] for index in sorted(store.rows)]
            front = front_of(rows, judge)
            apart = _from_files(workers, front, progress)
        finally:
            workers.close()
        store.tables()
    finally:
        store.close()
    nearest = None
    if not front:
        ok = [row for row in rows if row.status == "ok"]
        if ok:
            best = min(ok, key=lambda row: float(np.maximum(judge.misses(row), 0.0).sum()))
            nearest = best, {name: float(miss) for (name, *_), miss in zip(judge.limits, judge.misses(best), strict=True)
                             if miss > 0.0}
    active: tuple[str, ...] = ()
    if len(judge.objectives) == 1 and front:
        active = tuple(dict.fromkeys(name for (name, *_), miss in zip(judge.limits, judge.misses(front[0]), strict=True)
                                     if miss > -ACTIVE))
    found = Optimum(tuple(front), nearest, tuple(settled), active, len(rows), sum(row.status != "ok" for row in rows),
                    multipliers, unsettled)
    write_rows(out, "front", study, front, more={"step_apart": apart})
    _write_summary(out / SUMMARY, study, found)
    write_page(out / PAGE, study, rows, front, settled, "best figure" if len(judge.objectives) == 1 else "hypervolume",
               _settled_in_words(judge, found))
    progress.step(f"{found.evaluations} designs, {found.failed} failed; {len(front)} on the front, in {out}")
    return found


def _from_files(workers: Workers, front: Sequence[Row], progress: Progress) -> list[float | None]:
    """How far the figures of each row of the front are from those of its exported STEP file; None where that has none.

    The largest difference, as a share of the figure where that is above 1.
    """
    if not front:
        return []
    progress.step(f"the {len(front)} designs of the front from their STEP files")
    found = {row.index: row for row in workers.rows([(row.index, row.values) for row in front], from_files=True)}
    apart: list[float | None] = []
    for row in front:
        pairs = list(zip(row.figures, found[row.index].figures, strict=True))
        same = found[row.index].status == "ok" and all((one is None) == (other is None) for one, other in pairs)
        off = [abs(one - other) / max(1.0, abs(one)) for one, other in pairs if one is not None and other is not None]
        apart.append(max(off, default=0.0) if same else None)
    return apart


def front_of(rows: Sequence[Row], judge: _Judge) -> list[Row]:
    """The feasible rows that no other feasible row beats in all objectives, by the first objective."""
    kept = [row for row in rows if judge.feasible(row)]
    values = np.array([judge.objectives_of(row) for row in kept]).reshape(len(kept), len(judge.objectives))
    front = [k for k, one in enumerate(values)
             if not np.any((values <= one).all(axis=1) & (values < one).any(axis=1))]
    return sorted((kept[k] for k in front), key=lambda row: tuple(judge.objectives_of(row)))


def _several(evaluations: _Evaluations, judge: _Judge, seed: int, asked: OptimiseSection) -> list[tuple[int, float]]:
    from pymoo.algorithms.moo.nsga2 import NSGA2  # type: ignore[import-untyped]
    from pymoo.core.problem import Problem  # type: ignore[import-untyped]
    from pymoo.indicators.hv import HV  # type: ignore[import-untyped]
    from pymoo.operators.crossover.sbx import SBX  # type: ignore[import-untyped]
    from pymoo.operators.mutation.pm import PM  # type: ignore[import-untyped]
    from pymoo.optimize import minimize  # type: ignore[import-untyped]

    class _Mirrors(Problem):  # type: ignore[misc]  # pymoo is not typed
        def __init__(self) -> None:
            count = len(evaluations.low)
            super().__init__(n_var=count, n_obj=len(judge.objectives), n_ieq_constr=len(judge.limits) + 1,
                             xl=np.zeros(count), xu=np.ones(count))

        def _evaluate(self, x: Array, out: dict[str, Any], *_: Any, **__: Any) -> None:
            rows = evaluations(x)
            out["F"] = np.array([judge.objectives_of(row) for row in rows])
            # A design that failed is no design: as a constraint, so that it counts behind all that are.
            out["G"] = np.array([[*judge.misses(row), 0.0 if row.status == "ok" else NO_FIGURE] for row in rows])
            share = len(evaluations.asked) / (asked.population * asked.generations)
            evaluations.progress.share(min(1.0, share))

    minimize(_Mirrors(), NSGA2(pop_size=asked.population, sampling=_first(len(evaluations.low), asked.population, seed),
                               crossover=SBX(eta=15, prob=0.9), mutation=PM(eta=20), eliminate_duplicates=True),
             ("n_gen", asked.generations), seed=seed, verbose=False)
    feasible = [row for row in evaluations.asked if judge.feasible(row)]
    if not feasible:
        return []
    values = np.array([judge.objectives_of(row) for row in feasible])
    low, high = values.min(axis=0), values.max(axis=0)
    size = np.where(high > low, high - low, 1.0)
    volume = HV(ref_point=np.full(values.shape[1], 1.1))
    settled = []
    for end in range(asked.population, len(evaluations.asked) + 1, asked.population):
        so_far = [judge.objectives_of(row) for row in evaluations.asked[:end] if judge.feasible(row)]
        settled.append((end, float(volume((np.array(so_far) - low) / size)) if so_far else 0.0))
    return settled


def _first(variables: int, population: int, seed: int) -> Array:
    """The first generation, spread evenly: Sobol's points."""
    from scipy.stats import qmc

    points: Array = qmc.Sobol(variables, seed=seed).random_base2(max(population - 1, 1).bit_length())[:population]
    return points


def _one(evaluations: _Evaluations, judge: _Judge, seed: int, asked: OptimiseSection) -> list[tuple[int, float]]:
    """The best of some first designs, then sequential quadratic programming from there with differences of exact figures."""
    from scipy.optimize import minimize

    count = len(evaluations.low)
    rows = evaluations(_first(count, max(asked.population, 4), seed))
    shares = _first(count, max(asked.population, 4), seed)

    def badness(row: Row) -> tuple[float, float]:
        return float(np.maximum(judge.misses(row), 0.0).sum()) if row.status == "ok" else NO_FIGURE, float(
            judge.objectives_of(row)[0])

    start = shares[min(range(len(rows)), key=lambda k: badness(rows[k]))]
    spread = [float(judge.objectives_of(row)[0]) for row in rows if badness(row)[0] < NO_FIGURE]
    size = max(float(np.ptp(spread)) if spread else 1.0, 1e-12)

    def values(x: Array) -> Array:
        row = evaluations(x)[0]
        return np.concatenate([judge.objectives_of(row) / size, judge.misses(row)])

    def slopes(x: Array) -> Array:
        steps = np.where(x + DIFFERENCE <= 1.0, DIFFERENCE, -DIFFERENCE)
        found = evaluations(np.vstack([x, x + np.diag(steps)]))
        all_ = np.array([np.concatenate([judge.objectives_of(row) / size, judge.misses(row)]) for row in found])
        return np.asarray(((all_[1:] - all_[0]) / steps[:, None]).T)

    constraints = [] if not judge.limits else [
        {"type": "ineq", "fun": lambda x: -values(x)[1:], "jac": lambda x: -slopes(x)[1:]}]
    minimize(lambda x: values(x)[0], start, jac=lambda x: slopes(x)[0], bounds=[(0.0, 1.0)] * count, method="SLSQP",
             constraints=constraints, options={"maxiter": asked.generations, "ftol": 1e-10})
    best, settled = np.inf, []
    for n, row in enumerate(evaluations.asked, 1):
        if judge.feasible(row) and judge.objectives_of(row)[0] < best:
            best = float(judge.objectives_of(row)[0])
            settled.append((n, judge.objectives[0][1] * best))
    return settled


def _held_by(evaluations: _Evaluations, judge: _Judge) -> tuple[dict[str, float], float | None]:
    """Lagrange's multipliers at the best row, by least squares that are not negative, and what they leave of the slope.

    ∇f + Σ λ_i·∇g_i = 0 over the limits g_i ≤ 0 that are met with ACTIVE to spare at most, and the ends of the keys' ranges.
    """
    from scipy.optimize import nnls

    feasible = [row for row in evaluations.by_values.values() if judge.feasible(row)]
    if not feasible:
        return {}, None
    best = min(feasible, key=lambda row: (float(judge.objectives_of(row)[0]), row.index))
    size = evaluations.high - evaluations.low
    x = (np.array(best.values, dtype=np.float64) - evaluations.low) / size
    steps = np.where(x + DIFFERENCE <= 1.0, DIFFERENCE, -DIFFERENCE)
    rows = [best, *evaluations(x + np.diag(steps))]
    if any(row.status != "ok" for row in rows):
        return {}, None
    values = np.array([np.concatenate([judge.objectives_of(row), judge.misses(row)]) for row in rows])
    slopes = ((values[1:] - values[0]) / steps[:, None]).T
    held = np.flatnonzero(values[0, 1:] > -ACTIVE)
    keys = evaluations.study.keys
    normals = [(f"{judge.limits[k][0]}", slopes[1 + k], max(abs(judge.limits[k][3]), 1.0)) for k in held]
    for end, sign in ((0.0, -1.0), (1.0, 1.0)):
        normals += [(keys[k], sign * np.eye(len(keys))[k], float(size[k])) for k in np.flatnonzero(np.abs(x - end) <= ACTIVE)]
    steepness = float(np.linalg.norm(slopes[0]))
    if not normals:
        return {}, 1.0 if steepness > 0.0 else 0.0
    found, rest = nnls(np.stack([normal for _, normal, _ in normals], axis=1), -slopes[0])
    return ({name: float(share / scale) for (name, _, scale), share in zip(normals, found, strict=True) if share > 0.0},
            float(rest) / steepness if steepness > 0.0 else 0.0)


def _settled_in_words(judge: _Judge, found: Optimum) -> str:
    """How far from settled a search ended, for the page."""
    if not found.settled:
        return f"None of {found.evaluations} designs meets the limits."
    if len(judge.objectives) > 1:
        last = found.settled[-1][1]
        nearly = next(n for n, volume in found.settled if volume >= 0.99 * last)
        return ("Hypervolume of the front over evaluations, in the box from the best figures met to a tenth beyond the worst: "
                f"{last:.4f} in the end, 99 % of that from {nearly} evaluations on.")
    held = "; ".join(f"{name} holds it: {value:.3g} per unit" for name, value in found.multipliers.items())
    left = "" if found.unsettled is None else f" {100.0 * found.unsettled:.2g} % of the slope there is held by nothing."
    return f"Best figure over evaluations. {held or 'No limit holds it'}.{left}"


def _write_summary(path: Path, study: Study, found: Optimum) -> None:
    """How far from settled it ended, what held it, and what its designs are of."""
    asked = study.file.optimise
    assert asked is not None
    several = len(asked.minimise) + len(asked.maximise) > 1
    content = {"evaluations": found.evaluations, "failed": found.failed, "front": len(found.front),
               "hypervolume" if several else "best": [list(one) for one in found.settled], "active_limits": list(found.active)}
    if not several:
        content |= {"multipliers": found.multipliers, "slope_unsettled_share": found.unsettled}
    if found.nearest is not None:
        content["nearest"] = {"values": list(found.nearest[0].values), "missed_by_share_of_limit": found.nearest[1]}
    content |= {"minimise": list(asked.minimise), "maximise": list(asked.maximise), "scene": study.scene, "spec": study.raw}
    replace_text(path, json.dumps(content, indent=2) + "\n")
