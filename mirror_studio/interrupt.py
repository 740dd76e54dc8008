"""End in one and the same manner on Ctrl-C and on a polite request, also while libraries load. Imports next to nothing."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

STOPPED = "mirror-cad: stopped; nothing was changed"
FAILED = 1

_asked = False
_begun = False


def install() -> None:
    """Have this program end by `stop` when it is interrupted. For programs, not for what imports us."""
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, _interrupted)
    sys.unraisablehook = _unraisable


def begin() -> None:
    """From here on there is something to be cleared away: an interrupt is raised, wherever it comes."""
    global _begun
    _begun = True


def check() -> None:
    """Raise the interrupt that a library swallowed. Raises: KeyboardInterrupt."""
    if _asked:
        raise KeyboardInterrupt


def asked() -> bool:
    """Whether the program was interrupted: what is raised then, as a library that could not be loaded, is only its echo."""
    return _asked


def leave(code: int) -> None:
    """End with an exit code now.

    An interrupt inside compiled text leaves a mark in the interpreter, by which it would end by the signal whatever code was
    meant; and libraries that were half loaded need not be asked to tidy up.
    """
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError, AttributeError):
            continue
    os._exit(code)


def _interrupted(number: int, frame: FrameType | None) -> None:
    global _asked
    _asked = True
    if not _begun and _importing(frame):
        # Libraries written in C turn an interrupt into an error of their own, or into none at all.
        print(STOPPED, file=sys.stderr)
        leave(FAILED)
    raise KeyboardInterrupt


def _unraisable(unraisable: sys.UnraisableHookArgs) -> None:
    """Report what cannot be raised, but for an interrupt in a callback of a library in C: `check` raises that one again."""
    if not (_asked and isinstance(unraisable.exc_value, KeyboardInterrupt)):
        sys.__unraisablehook__(unraisable)


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False
