"""Kernels are compiled, which a machine does once and which takes seconds: it is said, and done on two cores at once."""

from __future__ import annotations

import os
import subprocess
import sys
import weakref
from typing import Any, Protocol

SAID = "compiling the kernels for this machine, which is done once and kept"


class Told(Protocol):
    """Whom it is told."""

    def compiling(self) -> None:
        """One more function is being compiled."""


_told: weakref.ref[Told] | None = None
_listens = False


def tell_of_compiling(told: Told) -> None:
    """From here on tell this one, and nobody before it, when numba compiles; not when it loads what it has kept.

    As long as numba is not loaded it does nothing, so that nothing is loaded for this.
    """
    global _told, _listens
    _told = weakref.ref(told)
    if not _listens and "numba" in sys.modules:
        from numba.core import event

        class Listener(event.Listener):  # type: ignore[misc]  # numba is not typed
            def on_start(self, event: Any) -> None:
                told = None if _told is None else _told()
                if told is not None:
                    told.compiling()

            def on_end(self, event: Any) -> None:
                pass

        event.register("numba:compile", Listener())
        _listens = True


# What processes beside compile, by the function of `raytrace.first_use` that does it.
PARTS = ("compile_sheet", "compile_picture")
LONGEST_S = 120.0  # that is waited for one of them: ten times what it takes
_beside: list[subprocess.Popen[bytes]] = []


def compile_beside() -> None:
    """Where this machine has yet to compile what a first picture needs, begin with that in processes beside.

    What they compile numba's cache keeps, and this process finds it there. One that cannot be started, or fails, leaves its
    part to this process.
    """
    from raytrace.parallel import THREADS

    if THREADS == 1:
        return
    from mirror_cad.guarded import import_path, interpreter
    from raytrace.first_use import is_first

    if not is_first():
        return
    path = os.pathsep.join(import_path())
    for part in PARTS:
        try:
            _beside.append(subprocess.Popen(
                [interpreter(), "-P", "-c", f"from raytrace.first_use import {part}; {part}()"], stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": path}))
        except OSError:
            return


def wait_for_compiled(told: Told) -> None:
    """Wait until the processes beside, if there are any, have ended."""
    if any(process.poll() is None for process in _beside):
        told.compiling()
    while _beside:
        process = _beside.pop()
        try:
            process.wait(LONGEST_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
