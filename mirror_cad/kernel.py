"""Read CAD files in a process of their own, and write mirrors there: what the kernel finds comes back as arrays or an error."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple, cast

from mirror_cad.errors import FileError, MirrorError, SolidError
from mirror_cad.guarded import FallenError, GuardedProcess, Progress
from mirror_cad.own_files import Hand

if TYPE_CHECKING:
    from numpy import int32
    from numpy.typing import NDArray

    from mirror_cad.occt.convert import Array, BSplineArrays
    from mirror_cad.outline import Outline
    from mirror_cad.outline.transition import TransitionLine

    # Of a face of a file as read: name, `bspline_arrays`, loops, sign, area in mm².
    ToldFace = tuple[str, BSplineArrays, tuple[Array, ...], float, float]
    # Of a file: how many solids, whether the kernel finds the whole valid, the volume where it is one solid, the named
    # faces, the triangles of all others, the points of curves that bound no face.
    ToldFile = tuple[int, bool, float | None, list[ToldFace], list[tuple[Array, NDArray[int32]]], list[Array]]

_READING, _WRITING = "mirror_cad.occt.reading", "mirror_cad.occt.plate_step"
# How long the kernel may work on a file without getting further: it reads a megabyte in a second, a face in less, on a machine
# that is busy with ten other things ten times as long; nobody waits a minute for a file that hangs.
STALL_SECONDS = 45.0
STALL_SECONDS_PER_BYTE = 10e-6
# And on a mirror's own plate, which nobody else has made: an outline of many thousand pieces takes it minutes.
PLATE_SECONDS = 900.0
# Address space of the child: what the machine has, and at least this; the kernel alone maps two gigabytes.
MIN_MEMORY_BYTES = 6 * 10**9


def _memory_bytes() -> int | None:
    try:
        return max(MIN_MEMORY_BYTES, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):  # a system that does not say
        return None


_process = GuardedProcess(_memory_bytes())


class PlateText(NamedTuple):
    """What a plate's STEP file says of it beside its shape: see `mirror_cad.mirror.Mirror.export_step`."""

    name: str
    reflecting: Literal["front", "back"]
    hand: Hand
    transition_mm: float | None
    transition: TransitionLine | None


def start_reader() -> None:
    """Start the process, if it is not there, so that it is ready by the time a file is read."""
    _process.start(_READING)


def start_writer() -> None:
    """Start the process, if it is not there, so that it is ready by the time a mirror is written."""
    _process.start(_WRITING)


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


def write_apart(path: Path, optical: BSplineArrays, other: BSplineArrays, outline: Outline, thickness_mm: float,
                said: PlateText) -> None:
    """Write a plate as STEP: `mirror_cad.occt.plate_step.write_from_arrays` in the process.

    Raises: SolidError, WriteError as that does, and where the kernel falls over it.
    """
    try:
        _process.call(f"{_WRITING}:write_from_arrays", str(path.resolve()), optical, other, outline, thickness_mm, said,
                      seconds=STALL_SECONDS)
    except FallenError as error:
        raise SolidError(f"{said.name}: the CAD kernel cannot make a solid of it: {error}") from None


def write_and_read_apart(step: Path, sheet: Path, optical: BSplineArrays, other: BSplineArrays, outline: Outline,
                         thickness_mm: float, box: tuple[float, float, float, float], said: PlateText, sides_mm: float,
                         meanwhile: Callable[[], None]) -> tuple[float, float, ToldFile, ToldFile]:
    """Write a plate and its sheet and read both back: `mirror_cad.occt.plate_step.write_and_read` in the process.

    Raises: SolidError, WriteError, FileError as that does, and where the kernel falls over it.
    """
    try:
        answer = _process.call(f"{_WRITING}:write_and_read", str(step.absolute()), str(sheet.absolute()), optical, other,
                               outline, thickness_mm, box, said, sides_mm, seconds=PLATE_SECONDS, meanwhile=meanwhile)
    except FallenError as error:
        raise SolidError(f"{said.name}: the CAD kernel cannot make its files: {error}") from None
    return cast("tuple[float, float, ToldFile, ToldFile]", answer)
