"""Say that kernels are compiled, which a machine does once and which takes seconds."""

from __future__ import annotations

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
