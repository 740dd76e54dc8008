"""Plant small faults in the mathematics, one at a time, and say which of them no test sees: `.mutants/results.jsonl`."""

from __future__ import annotations

import argparse
import itertools
import json
import os
import shutil
import tomllib
from pathlib import Path
from typing import Any

from faults import Fault, by_hand, sampled
from lab import ROOT, copy_of_project, in_child, pytest_run

HERE = Path(__file__).parent
RESULTS = ROOT / ".mutants" / "results.jsonl"
SLOWER, GRACE_S = 4.0, 60.0  # a test file that takes so many times its seconds, and these, never ends: the fault is seen


def main() -> None:
    """Run the sample and the stated faults; a fault that has a result is not run again."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="files whose path holds this text")
    parser.add_argument("--seconds", type=float, default=60.0, help="of tests for each fault, those that execute most first")
    parser.add_argument("--survivors", action="store_true", help="run survivors again, with tests they have not had")
    parser.add_argument("--list", action="store_true", help="list the faults and plant none")
    asked = parser.parse_args()
    plan = tomllib.loads((HERE / "plan.toml").read_text(encoding="utf-8"))
    known = json.loads((ROOT / ".mutants" / "lines.json").read_text(encoding="utf-8"))
    rows = {}
    if RESULTS.exists():
        rows = {row["name"]: row for row in map(json.loads, RESULTS.read_text(encoding="utf-8").splitlines())}
    with copy_of_project() as folder:
        for fault in _faults(plan, folder, asked.only):
            row = rows.get(fault.name)
            again = asked.survivors and row is not None and not row["seen_by"]
            if asked.only not in fault.path or (row is not None and not again):
                continue
            if asked.list:
                print(fault.kind, fault.name)
                continue
            had = row["run"] if row is not None else []
            found = _tested(fault, _tests(fault, plan, known, had, asked.seconds), folder, known)
            row = {"name": fault.name, "kind": fault.kind, **found, "run": [*had, *found["run"]]}
            with RESULTS.open("a", encoding="utf-8") as out:
                out.write(json.dumps(row) + "\n")
            print(f"{row['seen_by'] or 'SURVIVED'} [{' '.join(row['run'])}] line {fault.line}: {fault.name}", flush=True)


def _faults(plan: dict[str, Any], folder: Path, only: str) -> list[Fault]:
    """The stated faults, and the sample: the first of each file, the second of each and so on."""
    sources = {path: (folder / path).read_text(encoding="utf-8") for path in plan["files"] if only in path}
    samples = [sampled(path, sources[path], count, plan["seed"]) for path, count in plan["files"].items() if only in path]
    stated = [by_hand(fault["file"], (folder / fault["file"]).read_text(encoding="utf-8"), fault["old"], fault["new"])
              for fault in plan.get("fault", ())]
    return stated + [fault for turn in itertools.zip_longest(*samples) for fault in turn if fault is not None]


def _tests(fault: Fault, plan: dict[str, Any], known: dict[str, Any], had: list[str], seconds: float) -> list[str]:
    """The test files that execute the line, those that execute most of the file a second first, for so many seconds."""
    named = plan["tests"].get(fault.path, [])
    reach = {name: found["lines"].get(fault.path, []) for name, found in known.items()}
    files = [name for name in known if fault.line in reach[name] and name not in had and name not in named]
    files.sort(key=lambda name: known[name]["seconds"] / len(reach[name]))
    chosen = [name for name in named if name not in had]
    left = seconds if not chosen else 0.0
    for name in files:
        if known[name]["seconds"] <= left or not chosen:
            chosen.append(name)
            left -= known[name]["seconds"]
    return chosen


def _tested(fault: Fault, tests: list[str], folder: Path, known: dict[str, Any]) -> dict[str, Any]:
    """Plant the fault, run the tests up to the first file that sees it, and mend it with the file's times as they were."""
    target, caches = folder / fault.path, (folder / fault.path).parent / "__pycache__"
    source, times, kept = target.read_bytes(), target.stat(), folder / "kept-cache"
    shutil.copytree(caches, kept)  # numba writes over the compiled functions of a changed file
    ran: list[str] = []
    try:
        target.write_text(fault.text, encoding="utf-8")
        for name in tests:
            ran.append(name)
            limit = SLOWER * known.get(name, {"seconds": 60.0})["seconds"] + GRACE_S
            code, _ = in_child(lambda name=name: pytest_run([f"tests/{name}.py"]), limit, folder / "log.txt")
            if code != 0:
                tail = [line for line in (folder / "log.txt").read_text(errors="replace").splitlines() if line.strip()][-3:]
                return {"seen_by": name, "run": ran, "how": "out of time" if code is None else " | ".join(tail)[-300:]}
        return {"seen_by": "", "run": ran, "how": ""}
    finally:
        target.write_bytes(source)
        os.utime(target, ns=(times.st_atime_ns, times.st_mtime_ns))
        shutil.rmtree(caches)
        kept.rename(caches)


if __name__ == "__main__":
    main()
