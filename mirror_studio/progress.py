"""What is being done, on the standard error."""

from __future__ import annotations

import sys
import time

from mirror_studio import interrupt
from mirror_studio.compiling import SAID, tell_of_compiling


class Progress:
    """One line a step with its time; on a terminal the share of a long step is shown while it runs."""

    def __init__(self, quiet: bool = False) -> None:
        self._quiet = quiet
        self._start = time.perf_counter()
        self._live = sys.stderr.isatty()
        self._compiled = 0

    def step(self, text: str) -> None:
        """A step has begun. Raises: KeyboardInterrupt that the step before swallowed."""
        interrupt.check()
        tell_of_compiling(self)
        self._say(text)

    def _say(self, text: str) -> None:
        if not self._quiet:
            print(f"\r[{time.perf_counter() - self._start:6.1f} s] {text}", file=sys.stderr, flush=True)

    def share(self, share: float) -> None:
        """The share of the running step that is done."""
        if self._live and not self._quiet:
            print(f"\r           {100 * share:3.0f} %", end="" if share < 1 else "\r", file=sys.stderr, flush=True)

    def compiling(self) -> None:
        """Numba compiles one more function: said with the first, and on a terminal with the number of each."""
        self._compiled += 1
        if self._compiled == 1:
            self._say(SAID)
        if self._live and not self._quiet:
            print(f"\r           {self._compiled} functions", end="\r", file=sys.stderr, flush=True)
