"""Many designs: the measures that they are told apart by, sweeps, optimisations and tolerances."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirror_studio.commands.app import BAD_INPUT, DONE, Json, Out, app, finish

Scheduler = Annotated[str | None, Parameter(name="--scheduler", help="Address of a Dask scheduler: tcp://HOST:PORT.")]


@app.command
def measures(*, json: Json = False) -> int:
    """List the measures by name: unit, what they are of, and their definitions; the figures of rules after them."""
    from mirror_studio.rules.figures import rule_figures_known
    from raytrace.measures.registry import registered

    found = {name: {"title": one.title, "unit": one.unit, "of": one.scope, "better": one.better, "definition": one.definition}
             for name, one in registered().items()}
    found |= {name: {"title": "rule of the road", "unit": unit, "of": "rule", "better": None, "definition": definition}
              for name, (unit, definition) in rule_figures_known().items()}
    if json:
        return finish(found, (), json)
    for name, one in found.items():
        print(f"{name:34} {one['unit'] or '1':10} {one['title']}: {one['definition']}")
    return DONE


@app.command
def sweep(study: Path, /, *, out: Out = None, scheduler: Scheduler = None, json: Json = False) -> int:
    """Take measures of many designs: a grid, lists or samples of any keys of a specification. The same command goes on.

    Parameters
    ----------
    study
        A TOML file: spec, scene, measures, [vary].
    """
    if (missing := _missing_for_studies()) is not None:
        return missing
    from mirror_studio.explore.study import load_study
    from mirror_studio.explore.sweep import sweep as run
    from mirror_studio.progress import Progress

    loaded = load_study(study)
    return finish(run(loaded, out or Path("exports") / study.stem, Progress(), scheduler), (), json)


@app.command
def optimise(study: Path, /, *, out: Out = None, scheduler: Scheduler = None, json: Json = False) -> int:
    """Look for the best designs, or for the front between several wishes. The same command goes on where it ended.

    Parameters
    ----------
    study
        A TOML file: spec, scene, [vary], [optimise].
    """
    if (missing := _missing_for_studies()) is not None:
        return missing
    from mirror_studio.explore.optimise import optimise as run
    from mirror_studio.explore.study import load_study
    from mirror_studio.progress import Progress

    loaded = load_study(study, optimise=True)
    found = run(loaded, out or Path("exports") / study.stem, Progress(), scheduler)
    missed: tuple[str, ...] = ()
    if not found.front:
        near = found.nearest
        missed = ("no design meets optimise.limits" + ("" if near is None else "; the nearest has " + ", ".join(
            f"{key} = {value}" for key, value in zip(loaded.keys, near[0].values, strict=True)) + ", and misses " + ", ".join(
            f"{name} by {100.0 * share:.3g} % of its limit" for name, share in near[1].items())),)
    return finish({"evaluations": found.evaluations, "failed": found.failed, "front": len(found.front)}, missed, json)


@app.command
def tolerances(study: Path, /, *, out: Out = None, scheduler: Scheduler = None, json: Json = False) -> int:
    """Make many mirrors as they may come out, and say how far each measure spreads and which tolerance brings how much of it.

    Parameters
    ----------
    study
        A TOML file: spec, scene, measures, [limits], and what may depart: [keys], [form], [wedge], [aim], [eye].
    """
    if (missing := _missing_for_studies()) is not None:
        return missing
    from mirror_studio.progress import Progress
    from mirror_studio.tolerances.file import load_tolerances
    from mirror_studio.tolerances.run import tolerances as run

    content, missed = run(load_tolerances(study), out or Path("exports") / study.stem, Progress(), scheduler)
    return finish(content, missed, json)


def _missing_for_studies() -> int | None:
    """The exit code where what studies need is not installed, said; None where it is."""
    from importlib.util import find_spec

    for package in ("distributed", "pymoo", "pyarrow"):
        if find_spec(package) is None:
            print(f"mirror-cad: studies need {package}: install the project with its extra \"studies\"", file=sys.stderr)
            return BAD_INPUT
    return None
