"""A studio in a process of its own, as a person starts it; shared by the tests of the wire and of the page."""

from __future__ import annotations

import contextlib
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Studio:
    """A running server: where it is, its process, and what it says on its standard error."""

    port: int
    process: subprocess.Popen[str]
    said: list[str] = field(default_factory=list)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def memory_mb(self) -> float:
        """Resident memory."""
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        found = re.search(r"VmRSS:\s*(\d+) kB", text)
        assert found
        return int(found[1]) / 1024

    def stop(self) -> int:
        """Interrupt it as Ctrl+C does; returns its exit code."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(20)


def start(port: int = 0, *options: str) -> Studio:
    """Start a studio and wait until it says where it is."""
    process = subprocess.Popen([sys.executable, "-m", "mirror_studio", "studio", "--port", str(port), "--no-browser", *options],
                               stderr=subprocess.PIPE, text=True)
    assert process.stderr
    line = process.stderr.readline()
    found = re.search(r"http://127\.0\.0\.1:(\d+)/", line)
    assert found, line + process.stderr.read()
    studio = Studio(int(found[1]), process)
    stderr = process.stderr
    threading.Thread(target=lambda: studio.said.extend(stderr), daemon=True).start()
    return studio


@contextlib.contextmanager
def running(port: int = 0, *options: str) -> Iterator[Studio]:
    """A studio that is stopped in the end, whatever happens."""
    studio = start(port, *options)
    try:
        yield studio
    finally:
        if studio.process.poll() is None:
            studio.stop()
