"""The server's request handlers: the page and its files, the two sockets, and the check of access. Any web page can
make a browser send requests to a server on this machine. Two checks refuse the requests of pages from other servers. A
request's Origin, if any, must name the same server as its Host. On loopback, where no token protects the page, the Host
must be loopback too, because a foreign host name may resolve to this machine (DNS rebinding)."""

import asyncio
import json
import logging
import socket
from contextlib import suppress
from dataclasses import dataclass, field
from hashlib import sha256
from hmac import compare_digest
from ipaddress import ip_address
from pathlib import Path
from secrets import token_urlsafe
from typing import Any, Final, Self
from urllib.parse import urlsplit

from tornado.web import HTTPError, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from firmware_sim.live.loop.messages import LiveAnswer, LiveMessage
from firmware_sim.live.serving.supervisor import STREAMS, Supervisor, Viewer

LONGEST_REQUEST: Final = 16 * 1024
"""Largest size of a message in bytes; the server closes a connection that sends a longer message."""
MOST_VIEWERS: Final = 32
BATCHES_A_SECOND: Final = 30.0
"""Largest number of message batches per second to a viewer; a person would not see a higher rate."""
SEND_BUFFER: Final = 256 * 1024
"""Size in bytes of the operating system's send buffer for a viewer. A larger buffer would delay messages more."""
STALLED_S: Final = 30.0
"""Time in s after which the connection of a viewer that accepts no message is closed."""
MOST_UNANSWERED: Final = 8
"""Largest number of unanswered requests of one viewer."""
TRY_AGAIN_LATER: Final = 1013
"""Status code with which the server closes a WebSocket if there are too many viewers (IANA's registry of RFC 6455)."""
_HEADERS: Final = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'; object-src 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Server": "stillwake",
}
_TYPES: Final = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".txt": "text/plain; charset=utf-8",
}
_log = logging.getLogger("tornado.application")


@dataclass(frozen=True, kw_only=True)
class PageAccess:
    """The rules of access to one server. Every request needs the token, except on loopback, where there is no token."""

    token: str | None

    @classmethod
    def to(cls, address: str) -> Self:
        """Return the access rules of a server at this address, with a new token unless the address is loopback."""
        return cls(token=None if is_loopback(address) else token_urlsafe(24))

    def refusal(self, *, host: str, origin: str | None, token: str | None) -> str | None:
        """Return why a request is refused; None if it is not. `origin` is None if the request has no Origin header."""
        if self.token is None and not is_loopback(_name(host)):
            return "this server answers only to localhost"
        if origin is not None and origin.lower().partition("://")[2] != host.lower():
            return "a page of another server may not use this server"
        if self.token is None or compare_digest((token or "").encode(), self.token.encode()):
            return None
        return "open the link that `stillwake live` printed: it has the token"


def is_loopback(address: str) -> bool:
    """Return whether only this machine can reach the address."""
    try:
        return ip_address(address).is_loopback
    except ValueError:
        return address.lower() == "localhost"


def _name(host: str) -> str:
    """Return the name in a Host header without the port; an empty text if the header has no valid name."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def check(text: str | bytes) -> LiveAnswer | None:
    """Return None for a well-formed request, otherwise the answer that states the error."""
    if isinstance(text, bytes):
        return {"error": "a request must be text, not bytes"}
    try:
        value = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        return {"error": f"a request must be JSON: {error}"}
    if not isinstance(value, dict):
        return {"error": 'a request must be an object, such as {"id": 1, "set": {"enable": true}}'}
    return None if type(value.get("id", 0)) is int else {"error": "id: must be a whole number"}


def as_json(message: LiveMessage | LiveAnswer) -> str:
    """Return a message as JSON; NaN and infinity become null."""
    try:
        return json.dumps(message, allow_nan=False, separators=(",", ":"))
    except ValueError:
        return json.dumps(json.loads(json.dumps(message), parse_constant=lambda _: None), separators=(",", ":"))


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not a number")


@dataclass(frozen=True, kw_only=True, eq=False)
class ServedPage:
    supervisor: Supervisor
    access: PageAccess
    stalled_s: float
    viewers: set["StreamSocket"] = field(default_factory=set)

    @property
    def cookie(self) -> str:
        """Name of the cookie with the token. It differs between servers, because all ports of a host share cookies."""
        return f"stillwake-{sha256((self.access.token or '').encode()).hexdigest()[:12]}"


class Guarded(RequestHandler):
    """A handler that refuses a request if `PageAccess` gives a reason."""

    def initialize(self, served: ServedPage, **_others: Any) -> None:
        self.served = served

    def set_default_headers(self) -> None:
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def shown_token(self) -> str | None:
        """Return the token of this request, from its address or else from the cookie that was set with the page."""
        return self.get_query_argument("token", None) or self.get_cookie(self.served.cookie)

    def prepare(self) -> None:
        host, origin = self.request.host, self.request.headers.get("Origin")
        refusal = self.served.access.refusal(host=host, origin=origin, token=self.shown_token())
        if refusal is not None:
            self.set_status(403)
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.finish(f"{refusal}\n")

    def write_error(self, status_code: int, **_others: Any) -> None:
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code}: {self._reason}\n")

    def log_exception(self, typ: Any, value: Any, tb: Any) -> None:
        # tornado's method would log the address with the token. Cancelled answers are normal when the server ends.
        if not isinstance(value, HTTPError | asyncio.CancelledError):
            _log.error("%s %s", self.request.method, self.request.path, exc_info=(typ, value, tb))


class PageFiles(Guarded, StaticFileHandler):
    def initialize(self, served: ServedPage, path: str, default_filename: str | None = None) -> None:  # type: ignore[override]
        Guarded.initialize(self, served)
        StaticFileHandler.initialize(self, path, default_filename)

    def get_content_type(self) -> str:
        # The file types are fixed here, because the operating system's table of file types can be wrong.
        return _TYPES.get(Path(self.absolute_path or "").suffix.lower(), "application/octet-stream")

    def set_extra_headers(self, path: str) -> None:
        if path:
            self.set_header("Cache-Control", "no-cache")
            return
        self.set_header("Cache-Control", "no-store")
        if (token := self.served.access.token) is not None:
            self.set_cookie(self.served.cookie, token, httponly=True, samesite="Strict", path="/")


class Socket(Guarded, WebSocketHandler):
    def shown_token(self) -> str | None:
        # The cookie is not accepted here, because a browser sends it with the requests of any page.
        return self.get_query_argument("token", None)

    def check_origin(self, origin: str) -> bool:
        return self.served.access.refusal(host=self.request.host, origin=origin, token=self.shown_token()) is None

    def open(self, *_arguments: str) -> None:
        self.set_nodelay(True)
        self._connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)

    @property
    def _connection(self) -> Any:
        return getattr(self.ws_connection, "stream", None)

    async def send(self, message: str | bytes) -> None:
        """Send a message, and wait until the operating system has accepted it. Raises WebSocketClosedError if the
        viewer has left, or its connection was closed because it accepted no message for too long."""
        # `asyncio.timeout` is not used, because it would cancel the connection's write.
        sent = asyncio.ensure_future(self.write_message(message, binary=isinstance(message, bytes)))
        sent.add_done_callback(lambda done: done.cancelled() or done.exception())
        await asyncio.wait([sent], timeout=self.served.stalled_s)
        if not sent.done() and self._connection is not None:
            # The connection closes without a closing frame, because such a frame would wait behind the message.
            self._connection.close()
        await sent


class StreamSocket(Socket):
    """The stream of messages to a viewer. When a message has been accepted, the newest data become the next message."""

    _sending: "asyncio.Task[None] | None" = None

    def open(self, *_arguments: str) -> None:
        if len(self.served.viewers) >= MOST_VIEWERS:
            self.close(TRY_AGAIN_LATER, f"{MOST_VIEWERS} other viewers are connected already")
            return
        super().open()
        self.served.viewers.add(self)
        self._sending = asyncio.create_task(self._send())

    def on_message(self, message: str | bytes) -> None:
        """Ignore messages, because a viewer has nothing to send on this channel."""

    def on_close(self) -> None:
        self.served.viewers.discard(self)
        if self._sending is not None:
            self._sending.cancel()

    async def _send(self) -> None:
        supervisor = self.served.supervisor
        viewer = Viewer(supervisor.hub)
        with suppress(WebSocketClosedError):
            while True:
                changed, is_any = supervisor.changed, False
                for stream in STREAMS:
                    if (message := viewer.take(stream)) is not None:
                        is_any = True
                        await self.send(message if isinstance(message, bytes) else as_json(message))
                if not is_any:
                    await changed.wait()
                await asyncio.sleep(1.0 / BATCHES_A_SECOND)


class ControlSocket(Socket):
    """The requests of one viewer, and the answers. If a viewer reads no answers, the server reads no requests."""

    def open(self, *_arguments: str) -> None:
        super().open()
        self._unanswered = set[asyncio.Task[None]]()

    async def on_message(self, message: str | bytes) -> None:
        refusal = check(message)
        number = json.loads(message).get("id") if refusal is None else None
        if refusal is None and len(self._unanswered) >= MOST_UNANSWERED:
            refusal = {"error": f"{MOST_UNANSWERED} requests wait for the loop already"}
        if refusal is not None:
            await self._answer(refusal, number)
            return
        # The task is not awaited here: the WebSocket's pings and its closing would then have to wait for the loop too.
        task = asyncio.create_task(self._ask(str(message), number))
        self._unanswered.add(task)
        task.add_done_callback(self._unanswered.discard)

    async def _ask(self, text: str, number: int | None) -> None:
        await self._answer(await self.served.supervisor.ask(text), number)

    async def _answer(self, answer: LiveAnswer, number: int | None) -> None:
        with suppress(WebSocketClosedError):
            await self.send(as_json(answer if number is None else {**answer, "id": number}))
