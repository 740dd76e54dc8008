"""The front that `mirror-cad optimise` finds, beside random search and pymoo's NSGA-II as it comes, by their hypervolumes.

    python scripts/study_hypervolume.py [--evaluations 1000] [--random 5000] [--seeds 5]

Three objectives of a mirror in the paper's set-up, five of its numbers vary. A hypervolume is that of all rows which no other
beats, between the best and the worst figures that any of the searches met, the same for all.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.core.problem import Problem
from pymoo.indicators.hv import HV
from pymoo.optimize import minimize

from mirror_studio.explore.evaluate import Row, evaluate
from mirror_studio.explore.optimise import optimise
from mirror_studio.explore.study import Study, load_study
from mirror_studio.progress import Progress

Array = NDArray[np.float64]

SPEC = """
name = "three-wishes"
[horizontal]
law = "zones"
right_mm = 1250.0
left_mm = 400.0
blend_from = 0.6
blend_to = 1.0
[vertical]
law = "linear"
right_mm = 1250.0
left_mm = 1350.0
"""
STUDY = """
spec = "three-wishes.toml"
seed = {seed}
[vary]
"horizontal.right_mm" = {{ from = 900.0, to = 1600.0 }}
"horizontal.left_mm" = {{ from = 300.0, to = 900.0 }}
"horizontal.blend_from" = {{ from = 0.1, to = 0.8 }}
"vertical.right_mm" = {{ from = 800.0, to = 2500.0 }}
"vertical.left_mm" = {{ from = 800.0, to = 2500.0 }}
[optimise]
minimise = ["lane_straightness_percent"]
maximise = ["h_fov_traced_deg", "v_fov_left_traced_deg"]
population = {population}
generations = {generations}
"""
SIGNS = {"lane_straightness_percent": 1.0, "h_fov_traced_deg": -1.0, "v_fov_left_traced_deg": -1.0}
POPULATION = 40


def study(folder: Path, seed: int, evaluations: int) -> Study:
    (folder / "three-wishes.toml").write_text(SPEC, encoding="utf-8")
    path = folder / "study.toml"
    path.write_text(STUDY.format(seed=seed, population=POPULATION, generations=evaluations // POPULATION), encoding="utf-8")
    return load_study(path, optimise=True)


def wishes(of: Study, rows: list[Row]) -> Array:
    """What is minimised, of the rows that have it."""
    values = [[SIGNS[name] * figure for name, figure in zip(of.measures, row.figures, strict=True)]  # type: ignore[operator]
              for row in rows if row.status == "ok" and None not in row.figures]
    return np.array(values)


def rows_at(of: Study, shares: Array) -> list[Row]:
    ranges = list(of.file.vary.values())
    found = []
    for k, share in enumerate(shares):
        values = tuple(each.at(float(one)) for each, one in zip(ranges, share, strict=True))
        found.append(evaluate(k, values, of.with_values(values), str(of.folder), None, of.measures))
    return found


def by_default_nsga2(of: Study, seed: int, evaluations: int) -> Array:
    """pymoo's NSGA-II with its own settings."""
    met: list[Row] = []

    class Mirrors(Problem):  # type: ignore[misc]
        def __init__(self) -> None:
            count = len(of.keys)
            super().__init__(n_var=count, n_obj=3, xl=np.zeros(count), xu=np.ones(count))

        def _evaluate(self, x: Array, out: dict[str, Array], *_: object, **__: object) -> None:
            rows = rows_at(of, x)
            met.extend(rows)
            out["F"] = np.array([wishes(of, [row])[0] if row.status == "ok" else np.full(3, 1e9) for row in rows])

    minimize(Mirrors(), NSGA2(), ("n_eval", evaluations), seed=seed, verbose=False)
    return wishes(of, met[:evaluations])


def report(met: dict[str, list[Array]]) -> None:
    """The hypervolumes so far, on the same scale for all."""
    every = np.concatenate([values for each in met.values() for values in each])
    low, high = every.min(axis=0), every.max(axis=0)
    volume = HV(ref_point=np.ones(3))
    for name, each in met.items():
        found = [float(volume((values - low) / (high - low))) for values in each]
        print(f"{name:20s} {np.mean(found):.5f} in the mean, {min(found):.5f} to {max(found):.5f}; "
              f"{len(each[0])} designs with all figures")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--evaluations", type=int, default=1000)
    parser.add_argument("--random", type=int, default=5000)
    parser.add_argument("--seeds", type=int, default=5)
    given = parser.parse_args()
    met: dict[str, list[Array]] = {"optimise": [], "random": [], "NSGA-II as it comes": []}
    for seed in range(given.seeds):
        with tempfile.TemporaryDirectory() as name:
            folder, began = Path(name), time.monotonic()
            of = study(folder, seed, given.evaluations)
            out = folder / "out"
            optimise(of, out, Progress(quiet=True))
            from mirror_studio.explore.store import Store

            store = Store(out, of)
            met["optimise"].append(wishes(of, [store.rows[k] for k in sorted(store.rows)]))
            store.close()
            met["NSGA-II as it comes"].append(by_default_nsga2(of, seed, given.evaluations))
            shares = np.random.default_rng(seed).uniform(size=(given.random, len(of.keys)))
            met["random"].append(wishes(of, rows_at(of, shares)))
            print(f"seed {seed}: {time.monotonic() - began:.0f} s", file=sys.stderr)
        report(met)


if __name__ == "__main__":
    main()
