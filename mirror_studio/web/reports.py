"""Messages to the page from a worker's thread, not too many: words, shares and early results."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from mirror_studio.web.protocol import pack

if TYPE_CHECKING:
    from mirror_studio.web.engine import Shown

APART_S = 0.1  # between two reports of one step: what a person follows

Send = Callable[[dict[str, Any] | bytes], "Future[None]"]


class Reports:
    """Reports about one request. Without `send` nobody is told.

    number : the request's.   send : sends a message, as JSON or as it is, without waiting.   stop : called with the share that
    is done; what it raises ends the work.
    """

    def __init__(self, number: int = 0, send: Send | None = None, stop: Callable[[float], None] | None = None) -> None:
        self._id, self._send, self.stop = number, send, stop
        self._step, self._at = "", 0.0
        self._sending: Future[None] | None = None

    def report(self, step: str, share: float) -> None:
        """Say what is being done, unless the page has just been told, or has not read that yet. Raises: what `stop` raises."""
        if self.stop is not None:
            self.stop(share)
        now = time.monotonic()
        waits = now - self._at < APART_S or (self._sending is not None and not self._sending.done())
        if self._send is not None and not (step == self._step and waits):
            self._step, self._at = step, now
            self._sending = self._send({"type": "working", "id": self._id, "step": step, "share": share})

    def early(self, shown: Shown) -> None:
        """Send a part of the answer before the rest is done."""
        if self._send is not None:
            self._send(pack({"type": "early", "id": self._id} | shown.header, shown.pictures, shown.arrays))
