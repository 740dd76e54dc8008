"""The child process that reads files of strangers: what it survives, and that nothing survives it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from mirror_cad.guarded import FallenError, GuardedProcess

HOME = Path(__file__).resolve().parent.parent
PLATE = HOME / "tests" / "files" / "tessellated-plate.step"
CRASH = HOME / "tests" / "files" / "crash-b-26.step"
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")


@pytest.fixture
def child() -> Iterator[GuardedProcess]:
    with GuardedProcess() as process:
        yield process


def alive(pid: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{pid}/status").read_text().split("State:")[1][:4]
    except FileNotFoundError:
        return False


def gone(pid: int, seconds: float = 10.0) -> bool:
    end = time.monotonic() + seconds
    while alive(pid) and time.monotonic() < end:
        time.sleep(0.05)
    return not alive(pid)


def test_it_stays_for_the_next_call_and_is_another_process(child: GuardedProcess) -> None:
    first = child.call("os:getpid", seconds=60.0)
    assert first not in (os.getpid(), None)
    assert child.call("os:getpid", seconds=60.0) == first


@pytest.mark.parametrize(("call", "says"), [(("os:abort",), "SIGABRT"), (("os:_exit", 3), "exit 3"),
                                            (("signal:raise_signal", int(signal.SIGKILL)), "memory short"),
                                            (("time:sleep", 100), "ended after 1 s without getting further")])
def test_its_end_is_an_error_and_another_takes_its_place(call: tuple[object, ...], says: str, child: GuardedProcess) -> None:
    child.call("os:getpid", seconds=60.0)  # started, so that the second is the call's own
    with pytest.raises(FallenError, match=says):
        child.call(str(call[0]), *call[1:], seconds=1.0)
    assert child.call("math:hypot", 3.0, 4.0, seconds=60.0) == 5.0


def test_one_that_needs_too_much_memory_is_told_so() -> None:
    pytest.importorskip("resource")
    with GuardedProcess(memory_bytes=2 * 10**9) as small, pytest.raises(MemoryError):
        small.call("builtins:bytearray", 4 * 10**9, seconds=60.0)


def test_an_answer_of_another_make_is_not_built(child: GuardedProcess) -> None:
    """What a damaged child says is no program for us."""
    with pytest.raises(FallenError, match="holds fractions.Fraction"):
        child.call("fractions:Fraction", 1, 3, seconds=60.0)


def test_threads_wait_for_each_other(child: GuardedProcess) -> None:
    found: list[object] = []
    threads = [threading.Thread(target=lambda k=k: found.append(child.call("math:sqrt", float(k * k), seconds=60.0)))
               for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == [float(k) for k in range(8)]  # type: ignore[type-var]


READ = f"""
import raytrace
from mirror_cad.errors import FileError
import mirror_cad.cad_file
mirror_cad.cad_file.faults_of = lambda text: []
try:
    raytrace.load_reflector({str(CRASH)!r})
except FileError as error:
    assert "SIGSEGV" in str(error)
print(len(raytrace.load_reflector({str(PLATE)!r}).surface.mesh.faces))
"""


@pytest.mark.parametrize("way", ["script", "standard input", "forked"])
def test_a_users_program_reads_without_a_guard_of_its_own(way: str, tmp_path: Path) -> None:
    """A script without `if __name__ == "__main__"`; what a notebook's kernel does; a process that a pool has forked."""
    program = READ
    if way == "forked":
        if not hasattr(os, "fork"):
            pytest.skip("the system does not fork")
        program = "import os, sys\nif os.fork():\n    os.wait()\n    sys.exit()\n" + READ
    (tmp_path / "mine.py").write_text(program)
    command = [sys.executable] + (["-"] if way == "standard input" else ["mine.py"])
    done = subprocess.run(command, cwd=tmp_path, input=program if way == "standard input" else None, capture_output=True,
                          text=True, env=os.environ | {"PYTHONPATH": str(HOME)}, timeout=120, check=False)
    assert (done.stdout, done.stderr) == ("12\n", "")  # and the kernel prints nothing between


WAITS = """
import signal, time
from mirror_cad.guarded import GuardedProcess
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job of a shell has it ignored
child = GuardedProcess()
print(child.call("os:getpid", seconds=60.0), flush=True)
try:
    # Busy in C without letting go of the interpreter, as the kernel is.
    child.call("builtins:pow", 3, 10**9, seconds=600.0)
except KeyboardInterrupt:
    print("interrupted", flush=True)
    time.sleep(60)
"""


@LINUX
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_it_ends_with_its_parent_in_the_middle_of_a_call(how: signal.Signals) -> None:
    """Ctrl-C, which reaches the whole group; and a parent that is ended or killed and can clear nothing away."""
    with subprocess.Popen([sys.executable, "-c", textwrap.dedent(WAITS)], stdout=subprocess.PIPE, text=True, cwd=HOME,
                          start_new_session=True) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        try:
            time.sleep(1.0)
            assert alive(pid)
            if how == signal.SIGINT:
                os.killpg(parent.pid, how)
                assert parent.stdout.readline() == "interrupted\n"
            else:
                os.kill(parent.pid, how)
            assert gone(pid)
        finally:
            parent.kill()
            if alive(pid):
                os.kill(pid, signal.SIGKILL)
