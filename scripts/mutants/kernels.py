"""Plant the stated faults of the compiled kernels, and say which of them no test sees: `.mutants/kernels.jsonl`.

To compile a kernel anew, with all that calls it, takes minutes. So all faults of `kernels.toml` are planted at once, each
behind a switch: `old` becomes `(new if planted() == 7 else old)`. What is compiled so, once, reads the number of the fault at
an address of memory, where each run of the tests has put its own. The copy of the project stays in `.mutants/kernels`, and so
does what is compiled.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import re
import tomllib
from pathlib import Path
from typing import Any

from lab import ROOT, in_child, project_files, pytest_run, work_in

HERE = Path(__file__).parent
FOLDER, RESULTS = ROOT / ".mutants" / "kernels", ROOT / ".mutants" / "kernels.jsonl"
LOG = FOLDER / f"log-{os.getpid()}.txt"
COMPILED_S, GRACE_S = 3600.0, 120.0

SWITCH = '''"""Which fault is planted: the number at an address that this process and those it starts map when they begin."""

import ctypes
import os

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

ADDRESS = 1 << 40
PLANTED = int(os.environ.get("PLANTED", "-1"))

libc = ctypes.CDLL(None, use_errno=True)
libc.mmap.restype = ctypes.c_void_p
libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long]
# To be read and written; private, anonymous, and there only.
if libc.mmap(ADDRESS, 4096, 3, 0x100022, -1, 0) != ADDRESS:
    raise OSError(ctypes.get_errno(), "no memory at the address of the switch")
ctypes.c_int64.from_address(ADDRESS).value = PLANTED


@intrinsic
def _planted(typing_context):
    def codegen(context, builder, signature, arguments):
        number = ir.IntType(64)
        loaded = builder.load(builder.inttoptr(number(ADDRESS), number.as_pointer()))
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
        return loaded

    return types.int64(), codegen


def planted():
    return PLANTED


@overload(planted)
def _compiled():
    return lambda: _planted()
'''


def main() -> None:
    """Run the tests with each fault that has no result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="faults whose name holds this text, whether they have results or not")
    parser.add_argument("--survivors", action="store_true", help="survivors again")
    asked = parser.parse_args()
    faults = tomllib.loads((HERE / "kernels.toml").read_text(encoding="utf-8"))["fault"]
    _copied(faults)
    rows = {}
    if RESULTS.exists():
        rows = {row["name"]: row for row in map(json.loads, RESULTS.read_text(encoding="utf-8").splitlines())}
    work_in(FOLDER)
    chosen = [k for k, fault in enumerate(faults) if asked.only in _name(fault) and (
        asked.only or _name(fault) not in rows or (asked.survivors and not rows[_name(fault)]["seen_by"]))]
    seconds: dict[str, float] = {}
    for k in chosen:
        row = _tested(faults[k], k, seconds)
        with RESULTS.open("a", encoding="utf-8") as out:
            out.write(json.dumps(row) + "\n")
        print(f"{row['seen_by'] or 'SURVIVED'}: {row['name']}", flush=True)


def _name(fault: dict[str, Any]) -> str:
    return f"{fault['file']}: {fault['old']} -> {fault['new']}"


def _copied(faults: list[dict[str, Any]]) -> None:
    """Bring the copy up to date; what has not changed keeps its time, and numba what it has compiled of it."""
    for path in project_files():
        content, target = (ROOT / path).read_bytes(), FOLDER / path
        mine = [(k, fault) for k, fault in enumerate(faults) if f"raytrace/kernels/{fault['file']}.py" == path]
        if mine:
            content = _switched(path, content.decode(), mine).encode()
        if not target.exists() or target.read_bytes() != content:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
    switch = FOLDER / "raytrace" / "kernels" / "planted.py"
    if not switch.exists() or switch.read_text() != SWITCH:
        switch.write_text(SWITCH)


def _switched(path: str, text: str, faults: list[tuple[int, dict[str, Any]]]) -> str:
    """The file's text with its faults behind their switches, and the import of what these ask."""
    places = []
    for k, fault in faults:
        start, old = text.find(fault.get("after", "")), fault["old"]
        at, once = text.find(old, start), "after" in fault or text.count(old) == 1
        if -1 in (start, at) or not once or _means(text) != _means(_replaced(text, at, old, f"({old})")):
            raise SystemExit(f"{path}: {old!r} does not stand there once, as an expression: state the fault anew")
        places.append((at, k, fault))
    for at, k, fault in sorted(places, reverse=True, key=lambda place: place[0]):
        text = _replaced(text, at, fault["old"], f"(({fault['new']}) if planted() == {k} else ({fault['old']}))")
    return re.sub(r"^from __future__ .*\n", r"\g<0>from raytrace.kernels.planted import planted\n", text, count=1, flags=re.M)


def _means(text: str) -> str:
    return ast.dump(ast.parse(text))


def _replaced(text: str, at: int, old: str, new: str) -> str:
    return text[:at] + new + text[at + len(old):]


def _run(test: str, fault: int, limit: float) -> tuple[int | None, float]:
    os.environ["PLANTED"] = str(fault)
    return in_child(lambda: pytest_run([f"tests/{test}"]), limit, LOG)


def _tested(fault: dict[str, Any], k: int, seconds: dict[str, float]) -> dict[str, Any]:
    """Run a fault's tests up to the first file that sees it; each file once with no fault before, which compiles."""
    for test in fault["tests"]:
        if test not in seconds:
            code, seconds[test] = _run(test, -1, COMPILED_S)
            print(f"{test} with no fault: {code}, {seconds[test]:.0f} s", flush=True)
            if code != 0:
                raise SystemExit((LOG).read_text(errors="replace")[-3000:])
        code, _ = _run(test, k, 4.0 * seconds[test] + GRACE_S)
        if code != 0:
            tail = [line for line in (LOG).read_text(errors="replace").splitlines() if line.strip()][-3:]
            return {"name": _name(fault), "seen_by": test, "how": "out of time" if code is None else " | ".join(tail)[-300:]}
    return {"name": _name(fault), "seen_by": "", "how": ""}


if __name__ == "__main__":
    main()
