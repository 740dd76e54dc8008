"""One page's connection in, answered until it ends: designs with the newest winning, probes, and the making of files."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import sys
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from starlette.websockets import WebSocket, WebSocketDisconnect

from mirror_cad.errors import FileError, MirrorError
from mirror_studio.web.downloads import Downloads, NotMadeError
from mirror_studio.web.protocol import (
    Build,
    Cancel,
    Design,
    Inspect,
    Pinned,
    Probe,
    Refused,
    Rules,
    StoppedError,
    ViewSettings,
    WrongShapeError,
    pack,
    read_message,
)
from mirror_studio.web.reports import Reports
from mirror_studio.web.state import NO_SPHERE, as_spec, no_sphere
from mirror_studio.web.uploads import Uploads

if TYPE_CHECKING:
    from mirror_cad.spec import MirrorSpec
    from mirror_studio.json_types import Json
    from mirror_studio.web import measured
    from mirror_studio.web.engine import Designed, Shown

T = TypeVar("T")

SEND_SECONDS = 30.0  # a page that has not read for so long is gone
USERS_MIRROR_IS_GONE = "your own mirror is no longer here: bring it in again to see it beside the design"
WRONG_SHAPE, GONE = 1008, 1011  # WebSocket close codes: policy violation, internal error


@dataclass(frozen=True, eq=False)
class Shared:
    """What all connections share."""

    uploads: Uploads
    downloads: Downloads
    quick: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(4, "studio-quick"))
    slow: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "studio-slow"))
    beside: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "studio-beside"))

    def faults_of(self, error: Exception) -> list[str]:
        """As `faults_of`, with files named as their owners did."""
        return [self.uploads.in_words(text) for text in faults_of(error)]

    def close(self) -> None:
        """Remove all files; threads end by themselves."""
        self.quick.shutdown(wait=False, cancel_futures=True)
        self.slow.shutdown(wait=False, cancel_futures=True)
        self.beside.shutdown(wait=False, cancel_futures=True)
        self.uploads.close()
        self.downloads.close()


class Session:
    """A connection. At most one design is worked out and one waits: a newer one takes the waiting one's place."""

    def __init__(self, socket: WebSocket, shared: Shared) -> None:
        self._socket, self._shared = socket, shared
        self._sending = asyncio.Lock()
        self._waiting: Design | Refused | None = None
        self._dropped: list[int] = []
        self._something = asyncio.Event()
        self._stop_fine = threading.Event()
        self._shown: tuple[Designed, ViewSettings] | None = None
        self._building: asyncio.Task[None] | None = None
        self._inspecting: asyncio.Task[None] | None = None
        self._pinning: asyncio.Task[None] | None = None
        self._ruling: asyncio.Task[None] | None = None

    async def run(self) -> None:
        """Answer until the page goes, says something of the wrong shape, or does not read."""
        designing = asyncio.create_task(self._design_all())
        try:
            while True:
                message = read_message(await self._socket.receive_text())
                if isinstance(message, Design) or (isinstance(message, Refused) and message.type == "design"):
                    if self._waiting is not None:
                        self._dropped.append(self._waiting.id)
                    self._waiting = message
                    self._stop_fine.set()
                    self._something.set()
                elif isinstance(message, Refused):  # what is being made or pinned goes on
                    answer = {"build": "unbuilt", "pinned": "unpinned", "inspect": "uninspected"}[message.type]
                    await self._say({"type": answer, "id": message.id, "faults": list(message.faults)})
                elif isinstance(message, Probe):
                    await self._probe(message)
                elif isinstance(message, Pinned):
                    await _ended(self._pinning)
                    self._pinning = asyncio.create_task(self._pinned(message))
                elif isinstance(message, Rules):
                    await _ended(self._ruling)
                    self._ruling = asyncio.create_task(self._ruled(message))
                elif isinstance(message, Build):
                    await self._stop_building()
                    self._building = asyncio.create_task(self._build(message))
                elif isinstance(message, Inspect):
                    await self._stop_inspecting()
                    self._inspecting = asyncio.create_task(self._inspect(message))
                elif isinstance(message, Cancel):
                    await (self._stop_building() if message.what == "build" else self._stop_inspecting())
                if designing.done():
                    break
        except WrongShapeError as error:
            with contextlib.suppress(RuntimeError, WebSocketDisconnect):
                # As ASCII: a reason may have 123 bytes, and a text of the page's can hold what UTF-8 cannot.
                await self._socket.close(WRONG_SHAPE, str(error).encode("ascii", "replace").decode("ascii")[:120])
        except (WebSocketDisconnect, RuntimeError, KeyError):  # gone, or it sent bytes where text is due
            with contextlib.suppress(RuntimeError, WebSocketDisconnect):
                await self._socket.close(WRONG_SHAPE)
        finally:
            self._stop_fine.set()
            await self._stop_building()
            await self._stop_inspecting()
            await _ended(self._pinning)
            await _ended(self._ruling)
            designing.cancel()
            with contextlib.suppress(asyncio.CancelledError, Exception):
                await designing

    # --- designs ------------------------------------------------------------------------------------------------------

    async def _design_all(self) -> None:
        try:
            while True:
                await self._something.wait()
                self._something.clear()
                message, self._waiting = self._waiting, None
                if message is not None:
                    await self._design(message)
        except (WebSocketDisconnect, RuntimeError, TimeoutError):
            with contextlib.suppress(Exception):
                await self._socket.close(GONE)

    async def _design(self, message: Design | Refused) -> None:
        dropped, self._dropped = self._dropped, []
        self._stop_fine.clear()
        common = {"id": message.id, "dropped": dropped}
        if isinstance(message, Refused):
            await self._say(common | {"type": "error", "faults": list(message.faults)})
            return
        try:
            pool = self._shared.slow if message.fine else self._shared.quick
            loop = asyncio.get_running_loop()

            def send(one: dict[str, Any] | bytes) -> Future[None]:
                return asyncio.run_coroutine_threadsafe(self._send(one) if isinstance(one, bytes) else self._say(one), loop)

            reports = Reports(message.id, send, self._stopped if message.fine else None)
            packed = await loop.run_in_executor(pool, self._show, message, common, reports)
        except StoppedError:
            await self._say(common | {"type": "stopped"})
        except Exception as error:
            await self._say(common | {"type": "error", "faults": self._shared.faults_of(error)})
        else:
            await self._send(packed)

    def _show(self, message: Design, common: dict[str, Any], reports: Reports) -> bytes:
        from mirror_studio.web import engine  # with the tracer's kernels, loaded while the page is

        spec = as_spec(message.spec, self._shared.uploads)
        shown = self._seen(spec, message.look, message.fine, reports)
        if no_sphere(message.spec):
            shown.header["notes"] = [*cast("list[Json]", shown.header["notes"]), NO_SPHERE]
        self._shown = engine.designed(spec), message.look
        _loaded()
        return pack(common | {"type": "shown"} | shown.header, shown.pictures, shown.arrays)

    def _seen(self, spec: MirrorSpec, look: ViewSettings, fine: bool, reports: Reports) -> Shown:
        from mirror_studio.web import engine

        users_mirror = None
        if look.own is not None and self._shared.uploads.has(look.own):
            users_mirror = self._shared.uploads.reflector(look.own)
        if look.view == "picture":
            shown = engine.show(spec, look, fine, users_mirror, reports.stop)
        else:
            from mirror_studio.web import road  # with the motorway, which is not read before it is asked for

            shown = road.show(spec, look, fine, users_mirror, reports.report, reports.early)
        if look.own is not None and users_mirror is None:
            shown.header["notes"] = [*cast("list[Json]", shown.header["notes"]), USERS_MIRROR_IS_GONE]
        return shown

    async def _pinned(self, message: Pinned) -> None:
        common = {"id": message.id}

        def seen() -> bytes:
            shown = self._seen(as_spec(message.spec, self._shared.uploads), message.look, True, Reports())
            return pack(common | {"type": "pinned"} | shown.header, shown.pictures, shown.arrays)

        try:
            await self._send(await asyncio.get_running_loop().run_in_executor(self._shared.slow, seen))
        except (WebSocketDisconnect, RuntimeError, TimeoutError):
            return  # the page is gone
        except Exception as error:
            with contextlib.suppress(Exception):
                await self._say(common | {"type": "unpinned", "faults": self._shared.faults_of(error)})

    async def _ruled(self, message: Rules) -> None:
        """In a thread of its own, so that no picture waits for it."""
        common = {"id": message.id}

        def lines() -> dict[str, Json]:
            from mirror_studio.web.rules import ruled

            return {"lines": []} if self._shown is None else ruled(*self._shown, message.fine)

        try:
            found = await asyncio.get_running_loop().run_in_executor(self._shared.beside, lines)
            await self._say(common | {"type": "ruled"} | found)
        except (WebSocketDisconnect, RuntimeError, TimeoutError):
            return  # the page is gone
        except Exception as error:
            with contextlib.suppress(Exception):
                await self._say(common | {"type": "unruled", "faults": self._shared.faults_of(error)})

    def _stopped(self, share: float) -> None:
        if self._stop_fine.is_set():
            raise StoppedError

    async def _probe(self, message: Probe) -> None:
        found = None
        if self._shown is not None:
            if self._shown[1].view == "road":
                from mirror_studio.web.road import probe
            else:
                from mirror_studio.web.engine import probe
            one, look = self._shown
            found = await self._in_pool(lambda: probe(one, look, message.x, message.y, message.eye))
        await self._say({"type": "probed", "id": message.id, "found": found})

    async def _in_pool(self, work: Callable[[], T]) -> T | None:
        """None where the work raises."""
        try:
            return await asyncio.get_running_loop().run_in_executor(self._shared.quick, work)
        except Exception as error:
            faults_of(error)
            return None

    # --- files --------------------------------------------------------------------------------------------------------

    async def _build(self, message: Build) -> None:
        common = {"id": message.id}

        async def report(text: str) -> None:
            await self._say(common | {"type": "building", "step": text})

        try:
            spec = as_spec(message.spec, self._shared.uploads)
            made = await self._shared.downloads.build(spec, message.look, self._shared.uploads, report)
            await self._say(common | {"type": "built", "token": made.token, "missed": list(made.missed),
                                      "notes": list(made.notes)})
        except asyncio.CancelledError:
            with contextlib.suppress(Exception):
                await self._say(common | {"type": "unbuilt", "faults": []})
            raise
        except (WebSocketDisconnect, RuntimeError, TimeoutError):
            return  # the page is gone
        except Exception as error:
            with contextlib.suppress(Exception):
                await self._say(common | {"type": "unbuilt", "faults": self._shared.faults_of(error)})

    async def _stop_building(self) -> None:
        task, self._building = self._building, None
        await _ended(task)

    async def _inspect(self, message: Inspect) -> None:
        common = {"id": message.id}
        shared = self._shared

        async def report(text: str) -> None:
            await self._say(common | {"type": "inspecting", "step": text})

        def read(folder: Path) -> tuple[measured.Shown, str | None]:
            from mirror_studio.web import engine, measured

            found = measured.shown(folder, engine.designed(spec).mirror)
            if not found.header["measures"]:  # what the driver sees in it is not known
                return found, None
            name = f"{spec.name}-measured.step"
            return found, shared.uploads.add("reflector", ".step", (folder / name).read_bytes(), name)

        try:
            spec = as_spec(message.spec, shared.uploads)
            if gone := [name for name in message.data if not shared.uploads.has(name)]:
                raise FileError(f"{shared.uploads.shown(gone[0])}: the measured data are no longer here: bring them in again")
            made = await shared.downloads.inspect(spec, message, shared.uploads, report)
            await report("reading what was found")
            found, own = await asyncio.to_thread(read, made.folder)
            await self._send(pack(common | {"type": "inspected", "token": made.token, "missed": list(made.missed), "own": own}
                                  | found.header, {}, found.arrays))
        except asyncio.CancelledError:
            with contextlib.suppress(Exception):
                await self._say(common | {"type": "uninspected", "faults": []})
            raise
        except (WebSocketDisconnect, RuntimeError, TimeoutError):
            return  # the page is gone
        except Exception as error:
            with contextlib.suppress(Exception):
                await self._say(common | {"type": "uninspected", "faults": shared.faults_of(error)})

    async def _stop_inspecting(self) -> None:
        task, self._inspecting = self._inspecting, None
        await _ended(task)

    # --- sending ------------------------------------------------------------------------------------------------------

    async def _say(self, message: dict[str, Any]) -> None:
        async with self._sending, asyncio.timeout(SEND_SECONDS):
            await self._socket.send_json(message)

    async def _send(self, packed: bytes) -> None:
        async with self._sending, asyncio.timeout(SEND_SECONDS):
            await self._socket.send_bytes(packed)


async def _ended(task: asyncio.Task[None] | None) -> None:
    """Cancel a task and wait until it has ended."""
    if task is not None and not task.done():
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError, Exception):
            await task


def faults_of(error: Exception) -> list[str]:
    """What to tell a person: the error's own words, or that something is wrong with the studio, which goes to the log."""
    if isinstance(error, MirrorError | NotMadeError):
        return [line for line in str(error).splitlines() if line]
    if isinstance(error, MemoryError):
        return ["this design needs more memory than there is"]
    print("".join(traceback.format_exception(error)), file=sys.stderr)
    return [f"internal error: {type(error).__name__}: {str(error)[:300]}"]


@cache
def _loaded() -> None:
    """With the first picture all modules and kernels are there.

    The collector need not go through them again and again, for 100 ms each time.
    """
    gc.collect()
    gc.freeze()
