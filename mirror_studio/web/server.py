"""A port in, the studio served on it until it is stopped."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import errno
import io
import json
import os
import socket
import sys
import threading
import webbrowser
import zipfile
from collections.abc import AsyncIterator
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import uvicorn
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from mirror_cad.errors import FileError, SpecError
from mirror_cad.laws import Table
from mirror_cad.spec import MirrorSpec
from mirror_studio import interrupt
from mirror_studio.explore.front import Front, front_of, read_front
from mirror_studio.web import state
from mirror_studio.web.controls import controls, laws
from mirror_studio.web.downloads import KINDS, Downloads, NotMadeError, kinds
from mirror_studio.web.front import front_as_json
from mirror_studio.web.protocol import LARGEST_MESSAGE, ViewSettings, look_faults
from mirror_studio.web.rules import offered
from mirror_studio.web.session import Session, Shared
from mirror_studio.web.uploads import LIMITS, Uploads, check, in_folder

HOST = "127.0.0.1"
MAX_CONNECTIONS = 16
LARGEST_FRONT = 20_000_000  # bytes
TOO_MANY = 1013  # WebSocket close code: try again later
PING_SECONDS = 20.0
MEDIA = {".html": "text/html; charset=utf-8", ".css": "text/css; charset=utf-8", ".js": "text/javascript; charset=utf-8",
         ".txt": "text/plain; charset=utf-8", ".svg": "image/svg+xml"}
HEADERS = {
    # unsafe-eval: programs that drive a browser wait by it for plain expressions (Playwright's wait_for_function; for a
    # function it does without); nothing that comes from outside is ever evaluated.
    "Content-Security-Policy": "default-src 'none'; script-src 'self' 'unsafe-eval'; style-src 'self'; "
                               "img-src 'self' blob: data:; connect-src 'self'; "
                               "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin", "Cache-Control": "no-store",
}


class BadPortError(Exception):
    """A port that cannot be served on, in words."""


def serve(port: int, browser: bool, study: Path | None = None) -> None:
    """Serve the studio until it is interrupted. Port 0 takes any free one.

    study : the directory of an optimisation, whose front the page opens with.

    Raises: BadPortError; FileError where the study has no front.
    """
    interrupt.begin()
    front = None if study is None else read_front(study)
    listening = _listen(port)
    address = f"http://{HOST}:{listening.getsockname()[1]}/"
    app = create_app(listening.getsockname()[1], front, study)
    config = uvicorn.Config(app, log_level="warning", access_log=False, ws="websockets-sansio", ws_per_message_deflate=False,
                            ws_max_size=LARGEST_MESSAGE, ws_ping_interval=PING_SECONDS, ws_ping_timeout=PING_SECONDS,
                            lifespan="on", server_header=False, date_header=False, timeout_graceful_shutdown=2)
    print(f"mirror-cad: the studio is at {address} (Ctrl+C ends it)", file=sys.stderr, flush=True)
    if browser and _has_display():
        threading.Timer(0.3, webbrowser.open, [address]).start()
    # It raises the signal that ended it once more: an interrupt is how the studio is meant to end.
    with contextlib.suppress(KeyboardInterrupt), listening:
        uvicorn.Server(config).run(sockets=[listening])


def _listen(port: int) -> socket.socket:
    if not 0 <= port <= 65535:
        raise BadPortError(f"--port {port}: a port is a number from 0 to 65535 (0 takes any free one)")
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
        listening.listen(64)
    except OSError as error:
        listening.close()
        why = {errno.EADDRINUSE: "it is in use: another studio may run; choose another one, or --port 0 for any free one",
               errno.EACCES: "it may not be used: choose one above 1023"}.get(error.errno or 0, str(error.strerror))
        raise BadPortError(f"--port {port}: {why}") from None
    return listening


def _has_display() -> bool:
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def create_app(port: int, front: Front | None = None, study: Path | None = None) -> ASGIApp:
    """The studio as an application that answers on this port of the local host alone; with the front of a study's directory."""
    static = _static()
    start = json.dumps({"presets": state.presets(), "look": state.as_look(ViewSettings()), "opens_on": state.OPENS_ON,
                        "controls": controls(), "laws": laws(), "rules": offered(), "kinds": kinds(),
                        "version": metadata.version("mirror-cad"), "study": front is not None,
                        "uploads": {kind: {"endings": limit.endings, "largest": limit.largest}
                                    for kind, limit in LIMITS.items()}})
    open_ = 0

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        app.state.shared = shared = Shared(Uploads(), Downloads())
        shared.quick.submit(_warm)
        try:
            yield
        finally:
            shared.close()

    def shared() -> Shared:
        found: Shared = app.state.shared
        return found

    async def index(request: Request) -> Response:
        return Response(static["index.html"], media_type=MEDIA[".html"])

    async def file(request: Request) -> Response:
        name = request.path_params["name"]
        if name not in static:
            return PlainTextResponse("there is no such file", 404)
        return Response(static[name], media_type=MEDIA[f".{name.rsplit('.', 1)[1]}"])

    async def beginning(request: Request) -> Response:
        return Response(start, media_type="application/json")

    async def ws(connection: WebSocket) -> None:
        nonlocal open_
        await connection.accept()
        if open_ >= MAX_CONNECTIONS:
            await connection.close(TOO_MANY, "too many pages are open")
            return
        open_ += 1
        try:
            await Session(connection, shared()).run()
        finally:
            open_ -= 1

    async def upload(request: Request) -> Response:
        return await _answered(shared(), _upload(shared(), request))

    async def of_study(request: Request) -> Response:
        if front is None:
            return PlainTextResponse("the studio was started without a study", 404)
        return await _answered(shared(), asyncio.to_thread(front_as_json, front, study, shared().uploads))

    async def dropped(request: Request) -> Response:
        return await _answered(shared(), _front(shared(), request))

    async def grid(request: Request) -> Response:
        return await _answered(shared(), _grid(shared(), request))

    async def picture(request: Request) -> Response:
        return await _answered(shared(), _picture(shared(), request))

    async def toml(request: Request) -> Response:
        return await _answered(shared(), _toml(shared(), request))

    async def files(request: Request) -> Response:
        token, kind = request.path_params["token"], request.path_params["kind"]
        made = shared().downloads.get(token)
        if made is None or kind not in KINDS:
            return PlainTextResponse("these files are no longer here: make them again", 404)
        path, name, media = made.file(kind)
        if kind == "pdf":
            try:
                await shared().downloads.pdf(made)
            except NotMadeError as error:
                return PlainTextResponse(str(error), 404)
        if not path.is_file():
            return PlainTextResponse("there is no such file in this set", 404)
        return FileResponse(path, media_type=media, filename=name)

    posts = {"/upload/{kind}": upload, "/front": dropped, "/grid": grid, "/picture": picture, "/toml": toml}
    gets = {"/": index, "/static/{name}": file, "/start": beginning, "/study": of_study, "/files/{token}/{kind}": files}
    app = Starlette(lifespan=lifespan, routes=[
        *(Route(path, answer, methods=["GET"]) for path, answer in gets.items()),
        *(Route(path, answer, methods=["POST"]) for path, answer in posts.items()), WebSocketRoute("/ws", ws)])
    return Guarded(app, port)


def _warm() -> None:
    """The kernels loaded and the opening design made before a page asks for it."""
    from mirror_cad.spec.file import load_spec
    from mirror_studio.web import engine

    engine.show(load_spec(state.OPENS_ON), ViewSettings())


def _static() -> dict[str, bytes]:
    """The page's files, read once: a request's name is looked up here and never opened."""
    folder = resources.files("mirror_studio") / "web" / "static"
    return {entry.name: entry.read_bytes() for entry in folder.iterdir() if f".{entry.name.rsplit('.', 1)[-1]}" in MEDIA}


async def _answered(shared: Shared, work: Any) -> Response:
    try:
        made = await work
        return made if isinstance(made, Response) else JSONResponse(made)
    except Exception as error:
        return JSONResponse({"faults": shared.faults_of(error)}, 400)


async def _upload(shared: Shared, request: Request) -> dict[str, Any]:
    kind, asked = request.path_params["kind"], request.query_params
    ending, name = asked.get("ending", "").lower(), asked.get("name", "")
    if kind not in LIMITS:
        raise FileError(f"files of the kind {kind[:20]!r} are not taken; {', '.join(LIMITS)} are")
    check(kind, ending, int(request.headers.get("content-length") or 0))
    data = await _body(request, LIMITS[kind].largest)
    check(kind, ending, len(data))
    if kind == "spec":
        spec, look = state.read_toml(_text(data), shared.uploads)
        return {"spec": spec, "look": look}
    if kind == "table":
        return await asyncio.to_thread(in_folder, shared.uploads, ending, data, _table)
    return {"name": await asyncio.to_thread(shared.uploads.add, kind, ending, data, name)}


def _table(path: Any) -> dict[str, Any]:
    try:
        law = Table.model_validate({"law": "table", "file": path.name}, context={"folder": path.parent})
    except ValidationError as error:
        texts = [str(detail.get("ctx", {}).get("error", detail["msg"])) for detail in error.errors(include_url=False)]
        raise SpecError([text.replace(f"file = \"{path}\"", "the table") for text in texts]) from None
    return law.model_dump(exclude_none=True, exclude=set(Table.horizontal_only))


async def _toml(shared: Shared, request: Request) -> dict[str, Any]:
    """The specification as text, or, where it names files, as a ZIP with them beside it, in base64."""
    checked, look = await _asked(shared, request)
    names = {name: shared.uploads.shown(name) for name in state.files_of(checked, shared.uploads)}
    text = state.as_toml(checked, look, names)
    if not names:
        return {"name": f"{checked.name}.toml", "text": text}
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(f"{checked.name}.toml", text)
        for name, shown in names.items():
            archive.write(shared.uploads.folder / name, shown)
    return {"name": f"{checked.name}.zip", "zip": base64.b64encode(stream.getvalue()).decode("ascii")}


async def _front(shared: Shared, request: Request) -> dict[str, Any]:
    """The front that front.csv and perhaps optimise.json hold. Raises: MirrorError."""
    try:
        asked = json.loads(await _body(request, LARGEST_FRONT))
        name, table, summary = asked["name"], asked["table"], asked.get("summary")
        if not (isinstance(name, str) and isinstance(table, str) and isinstance(summary, str | None)):
            raise TypeError
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise SpecError("not a request of the studio's page") from None
    return await asyncio.to_thread(lambda: front_as_json(front_of(name[:100], table, summary), None, shared.uploads))


async def _grid(shared: Shared, request: Request) -> dict[str, Any]:
    """What the design shows, as the target of a wanted view that a hand draws on. Raises: MirrorError."""
    from mirror_studio.web import engine
    from mirror_studio.web.view_grid import view_grid

    checked, _ = await _asked(shared, request)
    return await asyncio.get_running_loop().run_in_executor(shared.quick, lambda: view_grid(engine.designed(checked)))


async def _picture(shared: Shared, request: Request) -> Response:
    """The picture on the plane as the page shows it, finely."""
    from mirror_studio.web.pictures import driver_picture

    checked, look = await _asked(shared, request)
    users_mirror = None if look.own is None else shared.uploads.reflector(look.own)
    made = await asyncio.get_running_loop().run_in_executor(shared.slow, driver_picture, checked, look, users_mirror)
    return Response(made, media_type="image/png")


async def _asked(shared: Shared, request: Request) -> tuple[MirrorSpec, ViewSettings]:
    """The specification and the look that a request of the page holds. Raises: SpecError."""
    try:
        asked = json.loads(await _body(request, LARGEST_MESSAGE))
        spec, wanted = asked["spec"], asked["look"]
        if not isinstance(spec, dict) or not isinstance(wanted, dict):
            raise TypeError
        look = ViewSettings.model_validate(wanted)
    except ValidationError as error:
        raise SpecError(list(look_faults(error.errors(include_url=False), wanted))) from None
    except (ValueError, TypeError, KeyError, RecursionError):
        raise SpecError("not a request of the studio's page") from None
    return state.as_spec(spec, shared.uploads), look


async def _body(request: Request, largest: int) -> bytes:
    data = bytearray()
    async for part in request.stream():
        data += part
        if len(data) > largest:
            raise FileError(f"more than {largest / 1e6:g} MB are not taken")
    return bytes(data)


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SpecError(f"not a text file (byte {error.start} is no UTF-8)") from None


class Guarded:
    """Lets through what the studio's own page asks for on its own address, and says no to the rest.

    The Host keeps out names that somebody points at this machine, the Origin other pages open in the same browser.
    """

    def __init__(self, app: ASGIApp, port: int) -> None:
        self._app = app
        self._hosts = {f"{name}:{port}" for name in (HOST, "localhost")} | ({HOST, "localhost"} if port == 80 else set())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, unless it comes from another page."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        origin = headers.get("origin")
        from_page = headers.get("host") in self._hosts
        # A browser always states the origin of another page that opens a connection or sends something; one that states none
        # is no page.
        from_page = from_page and (origin is None or origin in {f"http://{host}" for host in self._hosts})

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []),
                                      *((name.lower().encode(), value.encode()) for name, value in HEADERS.items())]
            await send(message)

        if from_page:
            await self._app(scope, receive, with_headers if scope["type"] == "http" else send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})  # before it is accepted: answered with 403
        else:
            await PlainTextResponse("this is for the studio's own page", 403)(scope, receive, with_headers)
