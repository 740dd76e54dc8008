"""Call a function in a child process, whose fall harms nobody.

For files of strangers, on which the kernel may end its process, never come back or take all memory. The child is a fresh
interpreter, no copy of this one: that works from a script without `if __name__ == "__main__"`, from a notebook, from any
thread and on every system. It stays for the next call, so its imports are paid once.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import math
import multiprocessing.spawn
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from typing import IO

from mirror_cad.errors import MirrorError
from mirror_cad.guarded_child import is_guarded, read_frame, resolve, write_frame

# What the child runs: its first line brings our search path, so that it finds what this process would.
_BOOT = ("import json, sys; sys.path[:] = json.loads(sys.stdin.buffer.readline()); "
         "from mirror_cad.guarded_child import main; main()")
POLL_SECONDS = 0.2  # between looks at the clock; an answer is taken at once
# What an answer may hold beside numbers, texts, tuples and lists: arrays, and our errors. The child has read a stranger's
# file with a kernel in C++: no other object of its making is built here.
_NUMPY_PARTS = {"_reconstruct", "ndarray", "dtype", "_frombuffer", "scalar"}
_OUR_ERRORS = {"mirror_cad.errors", "raytrace.errors"}
_OTHER_ERRORS = {"MemoryError", "ImportError"}

Progress = Callable[[float], None]


class FallenError(Exception):
    """The child has ended before its answer, or had to be ended; the message says how."""


class _Answer(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> object:
        if (module.split(".")[0] == "numpy" and name in _NUMPY_PARTS) or module in _OUR_ERRORS or (
                module == "builtins" and name in _OTHER_ERRORS):
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"an answer holds {module}.{name}")


@dataclass(slots=True)
class _Child:
    process: subprocess.Popen[bytes]
    answers: queue.SimpleQueue[bytes | None]
    owner: int = field(default_factory=os.getpid)

    def end(self) -> None:
        """Kill it and clear away; not one that a forked copy of us has inherited."""
        if self.owner != os.getpid():
            return
        self.process.kill()
        self.process.wait()
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):  # what was not yet sent
            self.process.stdin.close()


class GuardedProcess:
    """A child process that works out one call at a time, started when needed and again after a fall.

    Calls from several threads wait for each other. Inside such a child a call is an ordinary one: the guard is there.

    Parameters
    ----------
    memory_bytes
        Address space that the child may have, where the system can limit it; None: no limit but the system's.
    """

    def __init__(self, memory_bytes: int | None = None) -> None:
        self._memory = memory_bytes
        self._lock = threading.Lock()
        self._child: _Child | None = None
        atexit.register(_close_if_there, weakref.ref(self))

    def __enter__(self) -> GuardedProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self, *modules: str) -> None:
        """Start the child beside this process's own imports, if none is there; it imports `modules` meanwhile."""
        if not is_guarded() and self._lock.acquire(blocking=False):
            try:
                self._running(modules)
            finally:
                self._lock.release()

    def call(self, function: str, *arguments: object, seconds: float, longest_seconds: float = math.inf,
             progress: Progress | None = None, meanwhile: Callable[[], None] | None = None) -> object:
        """What "module:function" returns for the arguments: numbers, texts, arrays, and tuples and lists of them.

        Parameters
        ----------
        function
            Its module and name.
        *arguments
            What it is called with.
        seconds
            How long the child may go without an answer or a sign of progress (`guarded_child.report`) before it is ended.
        longest_seconds
            How long it may take, whatever progress it makes.
        progress
            Called with the shares done, 0 to 1, that the function reports.
        meanwhile
            Called here while the child works; what it raises ends the child.

        Raises
        ------
        MirrorError
            As the function raised it.
        FallenError
            Where the child ended or had to be ended.
        """
        if is_guarded():
            if meanwhile is not None:
                meanwhile()
            return resolve(function)(*arguments)
        with self._lock:
            try:
                child = self._sent((function, arguments, seconds))
                if meanwhile is not None:
                    meanwhile()
                kind, content = self._answer(child, seconds, longest_seconds, progress)
            except BaseException:  # an interrupt, too, leaves no child at work on what nobody waits for
                self._end()
                raise
        if kind == "done":
            return content
        if isinstance(content, MirrorError | MemoryError | ImportError):
            raise content
        raise RuntimeError(f"in a child process: {content}")

    def close(self) -> None:
        """End the child, if there is one, in the middle of a call too; a later call starts another."""
        child = self._child
        if child is not None and child.owner == os.getpid():
            child.process.kill()  # a thread that waits for it learns of its fall, and clears away
        if self._lock.acquire(timeout=POLL_SECONDS):
            try:
                self._end()
            finally:
                self._lock.release()

    def _end(self) -> None:
        child, self._child = self._child, None
        if child is not None:
            child.end()

    def _running(self, modules: tuple[str, ...] = ()) -> _Child:
        child = self._child
        if child is None or child.owner != os.getpid() or child.process.poll() is not None:
            self._end()
            child = self._child = _started(self._memory, modules)
        return child

    def _sent(self, request: object) -> _Child:
        data = pickle.dumps(request)
        for last in (False, True):
            child = self._running()
            assert child.process.stdin is not None
            try:
                write_frame(child.process.stdin, data)
                return child
            except OSError:  # it has ended while it waited
                self._end()
                if last:
                    raise FallenError("its process ended before it began") from None
        raise AssertionError("unreachable")

    def _answer(self, child: _Child, seconds: float, longest: float, progress: Progress | None) -> tuple[str, object]:
        start = sign_of_life = time.monotonic()
        while True:
            now = time.monotonic()
            left = min(sign_of_life + seconds, start + longest) - now
            if left <= 0.0:
                raise FallenError(f"it was ended after {longest:.0f} s" if now - start >= longest
                                  else f"it was ended after {seconds:.0f} s without getting further")
            try:
                frame = child.answers.get(timeout=min(left, POLL_SECONDS))
            except queue.Empty:
                continue
            if frame is None:
                raise FallenError(_how(child))
            try:
                kind, content = _Answer(BytesIO(frame)).load()
            except Exception as error:  # whatever a process that a file has damaged may say
                raise FallenError(f"its answer is not in order ({error})") from None
            if kind != "share":
                return kind, content
            sign_of_life = time.monotonic()
            if progress is not None:
                progress(float(content))


def _close_if_there(guarded: weakref.ref[GuardedProcess]) -> None:
    process = guarded()
    if process is not None:
        process.close()


def interpreter() -> str:
    """What starts Python: as for multiprocessing, where a program with Python inside it may have named it."""
    executable = multiprocessing.spawn.get_executable()
    return os.fsdecode(executable) if executable else ""


def import_path() -> list[str]:
    """What we import from, whatever the current folder is: that is left out where it is gone."""
    here = []
    with contextlib.suppress(FileNotFoundError):
        here = [os.getcwd()]
    return [place for entry in sys.path for place in ([str(entry)] if entry else here)]


def _started(memory: int | None, modules: tuple[str, ...]) -> _Child:
    command = [interpreter(), "-P", "-c", _BOOT]
    try:
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    except OSError as error:
        raise MirrorError(f"no child process can be started to read the file in ({command[0]}: {error.strerror or error}); "
                          "where Python runs inside another program, name its interpreter by multiprocessing.set_executable"
                          ) from None
    answers: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
    assert process.stdin is not None
    assert process.stdout is not None
    threading.Thread(target=_pump, args=(process.stdout, answers), daemon=True, name="guarded-process").start()
    path = import_path()
    with contextlib.suppress(OSError):  # the first call will see that it has ended
        process.stdin.write(json.dumps(path).encode() + b"\n")
        write_frame(process.stdin, pickle.dumps((memory, modules)))
    return _Child(process, answers)


def _pump(stream: IO[bytes], answers: queue.SimpleQueue[bytes | None]) -> None:
    with stream:
        while True:
            try:
                frame = read_frame(stream)
            except (OSError, ValueError):
                frame = None
            answers.put(frame)
            if frame is None:
                return


def _how(child: _Child) -> str:
    try:
        code = child.process.wait(timeout=POLL_SECONDS)
    except subprocess.TimeoutExpired:
        child.end()
        return "it stopped answering"
    if code < 0:
        try:
            name = signal.Signals(-code).name
        except ValueError:
            name = f"signal {-code}"
        return "the system ended it: is memory short?" if name == "SIGKILL" else f"it broke down ({name})"
    return f"it broke down (exit {code})"
