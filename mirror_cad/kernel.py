"""Read CAD files in a process of their own: what the kernel finds comes back as arrays or as a FileError."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from mirror_cad.errors import FileError, MirrorError
from mirror_cad.guarded import FallenError, GuardedProcess, Progress

_READING = "mirror_cad.occt.reading"
# How long the kernel may work on a file without getting further: it reads a megabyte in a second, a face in less, on a machine
# that is busy with ten other things ten times as long; nobody waits a minute for a file that hangs.
STALL_SECONDS = 45.0
STALL_SECONDS_PER_BYTE = 10e-6
# Address space of the child: what the machine has, and at least this; the kernel alone maps two gigabytes.
MIN_MEMORY_BYTES = 6 * 10**9


def _memory_bytes() -> int | None:
    try:
        return max(MIN_MEMORY_BYTES, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):  # a system that does not say
        return None


_process = GuardedProcess(_memory_bytes())


def start_reader() -> None:
    """Start the process, if it is not there, so that it is ready by the time a file is read."""
    _process.start(_READING)


def asked(path: Path, function: str, *arguments: object, progress: Progress | None,
          meanwhile: Callable[[], None] | None = None) -> object:
    """What a function of `mirror_cad.occt.reading` says of a file; its messages name the file as we were given it."""
    absolute = str(path.resolve())
    try:
        seconds = STALL_SECONDS + STALL_SECONDS_PER_BYTE * path.stat().st_size
        return _process.call(f"{_READING}:{function}", absolute, *arguments, seconds=seconds, progress=progress,
                             meanwhile=meanwhile)
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from None
    except FallenError as error:
        raise FileError(f"{path}: the CAD kernel cannot read it: {error}. Is the file damaged? Export it again, if need be as "
                        "another kind") from None
    except MemoryError:
        raise FileError(f"{path}: the CAD kernel needs more memory for it than there is") from None
    except MirrorError as error:
        said = str(error)
        if str(path) in said:
            raise
        raise type(error)(said.replace(absolute, str(path)) if absolute in said else f"{path}: {said}") from None
