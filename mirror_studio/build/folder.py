"""A set of files that appears as a whole: written beside its folder, then swapped in by renaming folders."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path

from mirror_cad.errors import SpecError, WriteError
from mirror_studio import interrupt

MANIFEST = "manifest.json"

# Beside DIR, while a set is made:  .DIR.new-PID-…  being written;  .DIR.mirror-cad-ready  complete, not yet in place;
# .DIR.mirror-cad-old  the former set, between the two renames. Whatever a kill leaves of these, `heal` puts right at the
# next start.


@contextlib.contextmanager
def new_set(out: Path) -> Iterator[Path]:
    """A fresh folder to write into.

    On leaving without an error it becomes `out`, and files in `out` that were not of the former set are carried over. On an
    error `out` stays as it was and nothing is left behind.

    Raises: SpecError where `out` cannot be such a folder; WriteError where the disk is full or a rename fails.
    """
    out = Path(os.path.abspath(out))
    _check(out)
    interrupt.begin()
    made = _make_parents(out.parent)
    work = out.parent / f".{out.name}.new-{os.getpid()}-{uuid.uuid4().hex[:8]}"
    try:
        heal(out)
        work.mkdir()
        if out.exists():
            shutil.copymode(out, work)
    except OSError as error:
        _remove_empty(made)
        raise SpecError(f"--out {out}: no folder can be made beside it: {error.strerror}") from None
    try:
        yield work
        interrupt.check()
        _carry_foreign_files(out, work)
        _swap(out, work)
    except OSError as error:
        raise WriteError(f"{out}: the files could not be written: {error.strerror or error}; nothing was changed") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)
        _remove_empty(made)  # empty unless the set arrived


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with contextlib.suppress(OSError):
            folder.rmdir()


def heal(out: Path) -> None:
    """Put right what a kill left beside `out`: afterwards it is the former set or the new one, whole."""
    out = Path(os.path.abspath(out))
    if not out.parent.is_dir():
        return
    with _lock(out.parent):
        ready, old = _beside(out)
        if not out.exists() and ready.exists():
            ready.rename(out)
        elif not out.exists() and old.exists():
            old.rename(out)
        for stale in (ready, old):
            shutil.rmtree(stale, ignore_errors=True)
        for left in out.parent.glob(f".{out.name}.new-*"):
            if not _alive(left.name.removeprefix(f".{out.name}.new-").split("-")[0]):
                shutil.rmtree(left, ignore_errors=True)


def _beside(out: Path) -> tuple[Path, Path]:
    return out.parent / f".{out.name}.mirror-cad-ready", out.parent / f".{out.name}.mirror-cad-old"


def _check(out: Path) -> None:
    if out.exists() and not out.is_dir():
        raise SpecError(f"--out {out}: this is a file; name a folder")
    try:
        here = Path.cwd()
    except FileNotFoundError:
        raise SpecError(f"--out {out}: the current folder is there no longer: go to another one") from None
    if out.exists() and (here == out.resolve() or out.resolve() in here.parents):
        raise SpecError(f"--out {out}: the current folder lies in it, and it is replaced by renaming: choose another")
    if out.is_symlink() or os.path.ismount(out):
        raise SpecError(f"--out {out}: a link or a mounted file system cannot be replaced by renaming: name a folder in it")
    parent = out.parent
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        raise SpecError(f"--out {out}: {parent} is not a folder you may write in")
    if out.exists() and not os.access(out, os.W_OK | os.X_OK):
        raise SpecError(f"--out {out}: you may not write in this folder")


def _make_parents(folder: Path) -> list[Path]:
    missing = []
    while not folder.exists():
        missing.append(folder)
        folder = folder.parent
    try:
        for path in reversed(missing):
            path.mkdir(exist_ok=True)
    except OSError as error:
        raise SpecError(f"--out: the folder {path} cannot be made: {error.strerror}") from None
    return missing


def _carry_foreign_files(out: Path, work: Path) -> None:
    """Link or copy what `out` holds beside its former set into the new one; a file of the new set wins."""
    if not out.exists():
        return
    named: dict[str, str] = {}
    with contextlib.suppress(OSError, ValueError, AttributeError, TypeError, KeyError):
        named = dict(json.loads((out / MANIFEST).read_text("utf-8"))["files"])
    for source in sorted(out.rglob("*")):
        relative = source.relative_to(out)
        target = work / relative
        if target.exists() or target.is_symlink():
            continue
        # Of the former set is what its manifest names with the very content that it has now; all else is somebody's.
        if source.is_file() and named.get(str(relative)) == hashlib.sha256(source.read_bytes()).hexdigest():
            continue
        if source.is_dir() and not source.is_symlink():
            # A folder that held only files of the former set is not foreign.
            if not any(source.iterdir()):
                target.mkdir(parents=True, exist_ok=True)
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(source, target, follow_symlinks=False)
        except OSError:
            shutil.copy2(source, target, follow_symlinks=False)


def _swap(out: Path, work: Path) -> None:
    with _lock(out.parent):
        ready, old = _beside(out)
        for stale in (ready, old):
            shutil.rmtree(stale, ignore_errors=True)
        work.rename(ready)
        if out.exists():
            out.rename(old)
        ready.rename(out)
        shutil.rmtree(old, ignore_errors=True)


@contextlib.contextmanager
def _lock(folder: Path) -> Iterator[None]:
    """One process at a time renames beside a set; the lock goes with the process, so a kill leaves none."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _alive(pid: str) -> bool:
    try:
        os.kill(int(pid), 0)
    except (ProcessLookupError, ValueError):
        return False
    except PermissionError:
        return True
    return True
