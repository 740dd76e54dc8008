"""Ctrl-C ends a command in one way whenever it comes: one line, exit code 1, nothing left behind."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mirror_studio import interrupt

# It begins inside the first import: in the lines of a script before that, an interrupt is the script's own affair.
PROGRAM = """
import sys
from mirror_studio import interrupt

class Begun:
    def find_spec(self, *_):
        sys.meta_path.remove(self)
        print("begun", flush=True)

interrupt.install()
sys.argv = ["mirror-cad", *sys.argv[1:]]
sys.meta_path.insert(0, Begun())
from mirror_studio.cli import main
main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("after", [0.0, 0.05, 0.2, 0.6, 1.4, 2.2])
def test_an_interrupt_while_libraries_load_ends_as_a_later_one_does(tmp_path: Path, after: float,
                                                                            number: signal.Signals) -> None:
    with subprocess.Popen([sys.executable, "-c", PROGRAM, "build", "sphere-950", "--out", "set"], cwd=tmp_path, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        time.sleep(after)
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 1
    assert said.splitlines()[-1] == interrupt.STOPPED
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_that_a_library_swallowed_is_found_at_the_next_step(monkeypatch: pytest.MonkeyPatch,
                                                                         capsys: pytest.CaptureFixture[str]) -> None:
    from mirror_studio import cli
    from mirror_studio.progress import Progress

    monkeypatch.setattr(interrupt, "_asked", True)
    with pytest.raises(KeyboardInterrupt):
        Progress(quiet=True).step("on")

    def broken(*_: object, **__: object) -> int:
        raise ImportError("initialization failed")

    monkeypatch.setattr(cli, "app", broken)
    assert cli.run(["build", "sphere-950"]) == 1
    assert capsys.readouterr().err == f"{interrupt.STOPPED}\n"


def test_an_interrupt_in_a_callback_of_a_library_leaves_no_traceback() -> None:
    """As it comes to numba, whose kernels are compiled in callbacks: it is raised again at the next step."""
    program = """
import ctypes, os, signal
from mirror_studio import interrupt

interrupt.install()
interrupt.begin()
callback = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))
callback()
try:
    interrupt.check()
except KeyboardInterrupt:
    print("found")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60)
    assert (done.stdout, done.stderr) == ("found\n", "")
