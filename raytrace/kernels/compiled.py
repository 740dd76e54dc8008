"""How kernels are compiled: by numba, once for each machine, and anew when the source of any of them changes."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.registry import CPUDispatcher


@cache
def sources() -> str:
    """A digest of the sources of all kernels: of every file in this folder."""
    found = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        found.update(path.read_bytes())
    return found.hexdigest()


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function of this folder with numba, with division as numpy has it, and keep it in numba's cache.

    By itself the cache looks at nothing but the function's own file, and would not notice a change in a kernel that it calls
    from another one. Here it compares `sources` too. What numba makes beside each function for calls from C, which nothing
    here does, is left out: a quarter of the time that a short one takes to compile.

    Parameters
    ----------
    **options : of `numba.njit`.

    Returns
    -------
    Decorator
    """
    def wrap(function: Callable[..., Any]) -> Any:
        dispatcher = njit(cache=True, error_model="numpy", no_cfunc_wrapper=True, **options)(function)
        # numba's own names; should a later version have others, its cache goes by the function's own file again.
        index: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
        if hasattr(index, "_source_stamp"):
            index._source_stamp = (index._source_stamp, sources())
            index.save = _alone(index)
        return dispatcher

    return wrap


def _alone(index: Any) -> Callable[[object, object], None]:
    """Keep what is compiled while no other process does so in the same folder, under a name that nothing older has.

    Two that keep a function for two kinds of arguments at once would give both the same name, and one its code under the
    other's kind. And when sources have changed, numba gives out the same names anew, and tells of a name before it writes what
    has it: who reads between the two, or after a process that was ended there, would get what an older function has left,
    for other kinds of arguments even.
    """
    save, folder, own = index.save, index._cache_path, index._index_name.removesuffix("nbi")

    def saved(key: object, data: object) -> None:
        with contextlib.ExitStack() as held:
            with contextlib.suppress(OSError):  # where there are no locks, it goes without, as numba does
                handle = os.open(folder, os.O_RDONLY)
                held.callback(os.close, handle)
                fcntl.flock(handle, fcntl.LOCK_EX)
            with contextlib.suppress(OSError):  # on a full disk nothing is kept, and what is compiled is used all the same
                told = set(index._load_index().values())
                for path in Path(folder).iterdir():
                    if path.name.startswith(own) and path.suffix == ".nbc" and path.name not in told:
                        path.unlink(missing_ok=True)
                save(key, data)

    return saved


def is_kept(dispatcher: Any) -> bool:
    """Whether this machine has compiled a function from these sources, for whatever arguments."""
    index: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    return not hasattr(index, "_load_index") or bool(index._load_index())


class _Inner(CPUDispatcher):  # type: ignore[misc]  # numba is not typed
    """A function that kernels call. Python, for which it has no way in, gets it interpreted."""

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)


def inner(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile, as `compiled` does, a function that only kernels call, without reference counts and without what Python calls.

    To take records and arrays apart that come from Python is a seventh of the time that the kernel of a sheet takes to compile.
    Where a body has to stand in the caller, so that its loops know the caller's constants, forceinline=True lets LLVM put it
    there; with inline="always" numba itself types and lowers it anew wherever it is called, a fifth of that time.

    Parameters
    ----------
    **options : of `numba.njit`.

    Returns
    -------
    Decorator
    """
    def wrap(function: Callable[..., Any]) -> Any:
        dispatcher = compiled(_nrt=False, no_cpython_wrapper=True, **options)(function)
        dispatcher.__class__ = _Inner  # to call what is not there would end the process
        return dispatcher

    return wrap
