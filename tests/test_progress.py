"""What is said on the standard error while something takes long."""

from __future__ import annotations

import multiprocessing.spawn
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba import njit

from mirror_studio import compiling
from mirror_studio.compiling import SAID
from mirror_studio.progress import Progress
from raytrace import first_use, parallel

COMPILED_BY_A_BUILD = """import sys
from numba.core import event

open_, names = [], []


class Listener(event.Listener):
    def on_start(self, event):
        open_.append(event)

    def on_end(self, event):
        open_.pop()
        function = event.data["dispatcher"].py_func
        if not open_:
            names.append(f"{function.__module__}.{function.__name__}")


event.register("numba:compile", Listener())
from mirror_studio.cli import run

assert run(["build", "progressive-c", "--out", sys.argv[1]]) == 0
print(*names)
"""


def test_compiling_is_said_once_and_what_is_compiled_already_is_not(capsys: pytest.CaptureFixture[str]) -> None:
    double, triple = njit(lambda x: 2.0 * x), njit(lambda x: 3.0 * x)
    progress = Progress()
    progress.step("designing")
    assert SAID not in capsys.readouterr().err
    assert double(1.0) + triple(1.0) == 5.0
    assert capsys.readouterr().err.count(SAID) == 1
    assert double(2.0) == 4.0
    progress.step("tracing")
    assert SAID not in capsys.readouterr().err


def test_what_processes_beside_have_compiled_is_not_first_any_more() -> None:
    first_use.compile_sheet()
    first_use.compile_picture()
    assert not first_use.is_first()
    compiling.compile_beside()
    assert not compiling._beside


def test_a_process_beside_that_fails_is_waited_for_and_harms_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling, "PARTS", ("no_such_part", "neither_this"))
    monkeypatch.setattr(parallel, "THREADS", 2)
    monkeypatch.setattr(first_use, "is_first", lambda: True)
    compiling.compile_beside()
    assert len(compiling._beside) == 2
    compiling.wait_for_compiled(Progress(quiet=True))
    assert not compiling._beside


def test_where_no_process_can_be_started_nothing_is_compiled_beside(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As inside a program whose own name stands where Python's does: what it tells multiprocessing is started."""
    monkeypatch.setattr(multiprocessing.spawn, "_python_exe", str(tmp_path / "none"))
    monkeypatch.setattr(parallel, "THREADS", 2)
    monkeypatch.setattr(first_use, "is_first", lambda: True)
    compiling.compile_beside()
    assert not compiling._beside


@pytest.mark.long
def test_a_first_build_itself_compiles_no_kernel_that_a_process_beside_does(tmp_path: Path) -> None:
    if parallel.THREADS == 1:
        pytest.skip("one core compiles one thing at a time")
    found = subprocess.run([sys.executable, "-c", COMPILED_BY_A_BUILD, str(tmp_path / "out")], check=True, capture_output=True,
                           text=True, env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "numba")})
    assert SAID in found.stderr
    assert [name for name in found.stdout.split() if name.startswith("raytrace.")] == []
    assert any(name.startswith("mirror_cad.") for name in found.stdout.split())
