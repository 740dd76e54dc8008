"""Run parts of the benchmark and write a folder with its tables, plots and page."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Sequence
from pathlib import Path

from mirror_cad.errors import SpecError
from mirror_studio.bench.table import Table
from mirror_studio.build.folder import MANIFEST, new_set
from mirror_studio.json_types import JsonObject
from mirror_studio.progress import Progress

# Part -> heading on the page. Each is a module here, of the same name with underscores, with `tables`.
PARTS = {
    "integrators": "Integrating the profile",
    "surfaces": "Making the surface",
    "evaluation": "Evaluating the surface",
    "tessellation": "Meshing the plate",
    "tracing": "Tracing",
    "waits": "Where people wait",
    "model": "What the model holds",
    "faithful": "The faithful surface",
    "hard-cases": "Hard cases",
}
LONG_PARTS = ("waits", "hard-cases")  # their `tables` takes the progress, to show how far it is


def run_bench(names: Sequence[str], out: Path, progress: Progress) -> JsonObject:
    """Measure the named parts, all without a name, and write them to `out`; returns what bench.json holds.

    Raises: SpecError for a name that is no part, with nothing measured or written.
    """
    chosen = check_names(names)
    with new_set(out) as folder:
        parts: dict[str, tuple[str, tuple[Table, ...]]] = {}
        for name in chosen:
            progress.step(f"bench: {name}")
            parts[name] = PARTS[name], _tables_of(name, progress)
        progress.step("bench: tables, plots and page")
        from mirror_studio.bench.output import write_tables
        from mirror_studio.build.pipeline import hashes, write_json

        content = write_tables(folder, parts)
        write_json(folder / MANIFEST, {"schema": 1, "parts": chosen, "versions": content["versions"], "files": hashes(folder)})
    progress.step(f"bench: done, in {out}")
    return content


def check_names(names: Sequence[str]) -> list[str]:
    """The parts asked for, in the order of PARTS, each once. Raises: SpecError that lists every unknown name."""
    faults = []
    for name in names:
        if name not in PARTS:
            near = difflib.get_close_matches(name, PARTS, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}?" if near else f"the parts are {', '.join(PARTS)}"
            faults.append(f"--part {name}: no such part; {hint}")
    if faults:
        raise SpecError(faults)
    return [name for name in PARTS if name in names or not names]


def _tables_of(name: str, progress: Progress) -> tuple[Table, ...]:
    module = importlib.import_module(f"mirror_studio.bench.{name.replace('-', '_')}")
    return tuple(module.tables(progress) if name in LONG_PARTS else module.tables())
