"""The child's side of `guarded`: answer one request after the other, for as long as the parent lives."""

from __future__ import annotations

import faulthandler
import importlib
import os
import pickle
import signal
import struct
import sys
import traceback
from collections.abc import Callable
from typing import IO

_LENGTH = struct.Struct("<Q")
# The parent ends a child that hangs; should it have been killed itself, the child's own clock does, this much later.
GRACE_SECONDS = 5.0

_report: Callable[[float], None] | None = None


def is_guarded() -> bool:
    """Whether this process is such a child."""
    return _report is not None


def report(share: float) -> None:
    """Tell the parent how much of the running call is done, 0 to 1; outside such a child, nobody."""
    if _report is not None:
        _report(share)


def resolve(function: str) -> Callable[..., object]:
    """The function that "module:function" names."""
    module, _, name = function.partition(":")
    found: Callable[..., object] = getattr(importlib.import_module(module), name)
    return found


def write_frame(stream: IO[bytes], data: bytes) -> None:
    """Bytes with their length before them."""
    stream.write(_LENGTH.pack(len(data)) + data)
    stream.flush()


def read_frame(stream: IO[bytes]) -> bytes | None:
    """What `write_frame` wrote; None where the stream ends."""
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return None
    length = _LENGTH.unpack(head)[0]
    data = stream.read(length)
    return data if len(data) == length else None


def main() -> None:
    """Answer until the parent closes its end. Nothing but answers goes out: what libraries print is dropped."""
    global _report
    requests = sys.stdin.buffer
    answers = os.fdopen(os.dup(1), "wb")
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches us too; it is the parent that ends us
    start = read_frame(requests)
    if start is None:
        return
    memory, modules = pickle.loads(start)
    _limit(memory)
    for module in modules:
        try:
            importlib.import_module(module)
        except Exception:  # the call that needs it says so
            break
    while True:
        frame = read_frame(requests)
        if frame is None:
            return
        function, arguments, seconds = pickle.loads(frame)

        def told(share: float, seconds: float = seconds) -> None:
            _arm_clock(seconds)
            write_frame(answers, pickle.dumps(("share", share)))

        _report = told
        _tie_to_parent(True)
        _arm_clock(seconds)
        answer = _answered(function, arguments)
        faulthandler.cancel_dump_traceback_later()
        _tie_to_parent(False)
        write_frame(answers, answer)


def _answered(function: str, arguments: tuple[object, ...]) -> bytes:
    from mirror_cad.errors import MirrorError

    try:
        return pickle.dumps(("done", resolve(function)(*arguments)))
    except MirrorError as error:
        return pickle.dumps(("failed", error))
    except MemoryError:
        return pickle.dumps(("failed", MemoryError()))
    except ImportError as error:
        return pickle.dumps(("failed", ImportError(str(error))))
    except Exception:
        return pickle.dumps(("failed", traceback.format_exc()))


def _arm_clock(seconds: float) -> None:
    """End this process after a time; by a thread of C, which the kernel, holding the interpreter, does not stop."""
    faulthandler.dump_traceback_later(seconds + GRACE_SECONDS, exit=True)


def _tie_to_parent(tied: bool) -> None:
    """While tied, end with the parent, in the kernel too: what hangs up at the other end raises SIGIO, which is fatal.

    Where the system knows no such signal, the child ends by its clock.
    """
    if not hasattr(os, "O_ASYNC"):
        return
    import fcntl

    try:
        fcntl.fcntl(0, fcntl.F_SETOWN, os.getpid())
        flags = fcntl.fcntl(0, fcntl.F_GETFL)
        fcntl.fcntl(0, fcntl.F_SETFL, flags | os.O_ASYNC if tied else flags & ~os.O_ASYNC)
    except OSError:
        pass


def _limit(memory: int | None) -> None:
    """No core files, and no more address space than that, where the system can do so."""
    try:
        import resource
    except ImportError:
        return
    limits = [(resource.RLIMIT_CORE, 0)] + ([(resource.RLIMIT_AS, memory)] if memory is not None else [])
    for kind, value in limits:
        try:
            hard = resource.getrlimit(kind)[1]
            resource.setrlimit(kind, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard))
        except (OSError, ValueError):
            pass
