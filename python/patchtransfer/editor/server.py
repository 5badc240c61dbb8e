"""The studio's server: on the loopback interface only, for whoever has the token.

Everything is asked for with a random token in the address. Requests with a foreign Host (a name that was made to mean
this machine) or Origin (another page) are refused before the token is looked at. The server writes no files: what is
saved is handed to the browser, which keeps it where its user says.
"""

from __future__ import annotations

import json
import secrets
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import partial
from http import HTTPStatus
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs

from .. import io
from ..errors import InputError, TransferError
from ..files import json_text
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..io.points import landmarks_text
from ..libraries import library
from ..pipeline.result import TransferResult
from ..web.report import render, transfer_page
from .messages import LARGEST_MESSAGE, answer
from .session import Session
from .view import View

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.types import ASGIApp, Receive, Scope, Send
    from starlette.websockets import WebSocket

__all__ = ["FILES", "application", "serve"]

HOST = "127.0.0.1"
#: Seconds that a page may take to close when the studio ends.
PATIENCE = 1
TOKEN_BYTES = 24
HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


def serve(session: Session, title: str, port: int, ready: Callable[[str], None]) -> None:
    """Serve a session until it is interrupted.

    Parameters
    ----------
    session : Session
    title : str
        Of the page.
    port : int
        0 for any free one.
    ready : callable
        Called with the whole address when the page can be opened.

    Raises
    ------
    InputError
        When the port is taken, or the extra ``studio`` is not installed.
    """
    for name in ("uvicorn", "websockets", "starlette"):
        library(name, "studio", "the studio")
    import uvicorn

    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
    except OSError as error:
        listening.close()
        raise InputError(f"port {port} cannot be used ({error.strerror}); take another one, or --port 0") from None
    # From here on whoever has the address is heard, if not answered yet.
    listening.listen()
    port = listening.getsockname()[1]
    token = secrets.token_urlsafe(TOKEN_BYTES)
    app = application(session, title, port, token, partial(ready, f"http://{HOST}:{port}/?token={token}"))
    config = uvicorn.Config(
        app,
        log_level="critical",
        access_log=False,
        server_header=False,
        ws_max_size=LARGEST_MESSAGE,
        timeout_graceful_shutdown=PATIENCE,
    )
    with listening:
        uvicorn.Server(config).run(sockets=[listening])


def application(
    session: Session, title: str, port: int, token: str, ready: Callable[[], None] = lambda: None
) -> Starlette:
    """The studio as an ASGI application."""
    from anyio import CapacityLimiter, to_thread
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.responses import HTMLResponse, PlainTextResponse
    from starlette.responses import Response as Answer
    from starlette.routing import Route, WebSocketRoute
    from starlette.websockets import WebSocketDisconnect

    view = View(session)
    # One at a time: a session is no safe place for two threads.
    turn = CapacityLimiter(1)

    async def page(_: Request) -> Response:
        return HTMLResponse(render("studio.html.j2", title=title, token=token, files=list(FILES)))

    async def file(request: Request) -> Response:
        name = request.path_params["name"]
        if name not in FILES:
            return PlainTextResponse("there is no such file", HTTPStatus.NOT_FOUND)
        kind, content = FILES[name]
        try:
            body = await to_thread.run_sync(content, session, limiter=turn)
        except TransferError as error:
            return PlainTextResponse(str(error), HTTPStatus.CONFLICT)
        return Answer(body, media_type=kind, headers={"Content-Disposition": f'attachment; filename="{name}"'})

    def act(text: str | None) -> str:
        return json.dumps(answer(session, view, text))

    async def live(connection: WebSocket) -> None:
        await connection.accept()
        try:
            await connection.send_text(await to_thread.run_sync(act, None, limiter=turn))
            while True:
                try:
                    text = await connection.receive_text()
                except KeyError:
                    # Bytes, which the page does not send.
                    text = ""
                await connection.send_text(await to_thread.run_sync(act, text, limiter=turn))
        except WebSocketDisconnect:
            return

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        ready()
        yield

    guard = Middleware(Guard, hosts={f"{name}:{port}" for name in (HOST, "localhost")}, token=token)
    routes = [Route("/", page), Route("/file/{name}", file), WebSocketRoute("/live", live)]
    return Starlette(routes=routes, middleware=[guard], lifespan=lifespan)


class Guard:
    """Refuses what does not come from the studio's own page.

    Parameters
    ----------
    app : ASGI application
    hosts : set of str
        What Host may say, and Origin after ``http://``.
    token : str
    """

    def __init__(self, app: ASGIApp, hosts: set[str], token: str) -> None:
        self._app, self._hosts, self._token = app, hosts, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand on what is allowed, with headers that keep the page to itself; refuse the rest."""
        from starlette.datastructures import MutableHeaders
        from starlette.responses import PlainTextResponse
        from starlette.websockets import WebSocketClose

        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if not self._allowed(scope):
            if scope["type"] == "websocket":
                await WebSocketClose(1008)(scope, receive, send)
            else:
                await PlainTextResponse("refused", HTTPStatus.FORBIDDEN, HEADERS)(scope, receive, send)
            return

        async def sealed(message: Any) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        await self._app(scope, receive, sealed)

    def _allowed(self, scope: Scope) -> bool:
        headers = [(name.lower(), value.decode("latin-1")) for name, value in scope["headers"]]
        hosts = [value for name, value in headers if name == b"host"]
        origins = [value for name, value in headers if name == b"origin"]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return False
        if any(origin not in {f"http://{host}" for host in self._hosts} for origin in origins):
            return False
        # Browsers always say where a socket comes from; whoever does not is no page.
        if scope["type"] == "websocket" and len(origins) != 1:
            return False
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
        return len(given) == 1 and secrets.compare_digest(given[0].encode(), self._token.encode())


def _needed(session: Session) -> TransferResult:
    if session.result is None:
        raise InputError(f"there is no result to save: {session.shown.error}")
    return session.result


def _xml(geometry: MultiPatch | Boundary) -> bytes:
    """G+Smo XML, as `io.write` puts it into a file."""
    form = next(form for form in io.FORMATS if ".xml" in form.extensions)
    write = form.write if isinstance(geometry, MultiPatch) else form.write_boundary
    assert write is not None
    text = write(geometry)  # type: ignore[arg-type]
    return text if isinstance(text, bytes) else text.encode()


def _landmarks(session: Session) -> bytes:
    rows = session.landmark_rows
    if rows is None:
        raise InputError("there are no landmarks to save; add some")
    return landmarks_text(rows, None).encode()


#: What can be saved: its kind, and what is in it.
FILES: dict[str, tuple[str, Callable[[Session], bytes]]] = {
    "target.xml": ("application/xml", lambda s: _xml(s.edited.target)),
    "landmarks.csv": ("text/csv", _landmarks),
    "result.xml": ("application/xml", lambda s: _xml(_needed(s).multipatch)),
    "report.html": ("text/html", lambda s: transfer_page(_needed(s)).encode()),
    "report.json": ("application/json", lambda s: json_text(_needed(s).to_dict()).encode()),
}
