"""How fast and how exact it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from mirror_studio.commands.app import Json, Out, app, finish

Parts = Annotated[list[str] | None, Parameter(name="--part", negative=())]


@app.command
def bench(*, part: Parts = None, out: Out = None, json: Json = False) -> int:
    """Measure speed against error: tables, plots and a page (default: exports/bench).

    Parameters
    ----------
    part
        A part to measure; may be given several times. All without it.
    """
    from mirror_studio.bench.run import run_bench
    from mirror_studio.progress import Progress

    return finish(run_bench(part or (), out or Path("exports/bench"), Progress()), (), json)
