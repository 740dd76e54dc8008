"""Mirrors that numerics find hard: each case's worst figure beside its tolerance, or its refusal.

A case goes through the whole chain: specification, design, plate, STEP and STL, both read back, deviation. What is read
back is compared with a second working-out that uses nothing of the program.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from mirror_studio.bench.hard.cases import case_named, cases
from mirror_studio.bench.hard.chain import make, mirror_of, sample_points
from mirror_studio.bench.hard.figures import ray_figures
from mirror_studio.bench.hard.runner import BAD, REFUSED, WITHIN, Work, run_cases
from mirror_studio.bench.hard.sheets import Sphere
from mirror_studio.bench.hard.specs import constant, scaled, spec
from mirror_studio.bench.table import Column, Row, Table
from mirror_studio.progress import Progress

LIMIT_S = 10.0  # of processor time for one case, the kernel's import not counted: how busy the machine is does not matter


def warm_up() -> None:
    """Load the kernel and compile what numba compiles: one kernel for each degree, and the one for any surface."""
    from raytrace import Reflector, reflect

    with tempfile.TemporaryDirectory(prefix="hard-case-") as name:
        folder = Path(name)
        made = make(folder, spec(constant(1250.0), constant(900.0), **scaled(20.0)))
        ray_figures(made, Sphere(1250.0), *sample_points(made.mirror))
        for degree in (7, 9):
            raw = spec(constant(1250.0), constant(900.0), surface={"degree": degree, "spans": [2, 2]})
            reflect(Reflector.from_mirror(mirror_of(raw, folder)), [0.0, 0.0, 700.0], [[0.0, 0.0, -1.0], [0.1, 0.0, -0.01]])


def tables(progress: Progress | None) -> tuple[Table, ...]:
    """The one table of all cases."""
    return (table_of(run_cases(list(cases()), Work(case_named, warm_up, LIMIT_S), progress)),)


def table_of(rows: Sequence[Row]) -> Table:
    """Rows as the table shows them, their verdicts counted in its text."""
    verdicts = [row["verdict"] for row in rows]
    bad = [f"{verdicts.count(verdict)} {verdict}" for verdict in BAD if verdict in verdicts]
    text = (f"{len(rows)} mirrors that are hard for one reason each, through the whole chain from the specification to the "
            f"files read back: {verdicts.count(WITHIN)} within their tolerances, {verdicts.count(REFUSED)} refused with the "
            f"cause named, as they have to be, {', '.join(bad) if bad else 'none otherwise'}. Of the figures of a case the one "
            "it is about is shown, or one that fails; they are measured against closed forms and scipy, not against the "
            f"program. Times are processor time without the kernel's import; a case may take {LIMIT_S:g} s.")
    columns = (Column("case", "case"), Column("hard", "what is hard"), Column("verdict", "verdict"), Column("what", "figure"),
               Column("figure", "reached"), Column("tolerance", "allowed"), Column("unit", "unit"),
               Column("remark", "the tolerance's reason, or the message"), Column("seconds", "time, s", 2))
    return Table("hard-cases", "Hard cases", text, columns, tuple(rows))
