"""The server of the live page: it opens a port, runs the loop, and closes both at the end."""

import asyncio
import errno
import socket
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream
from tornado.netutil import bind_sockets
from tornado.web import Application

from contract.errors import StillwakeError
from firmware_sim.live.serving import handlers
from firmware_sim.live.serving.process import MakeSession
from firmware_sim.live.serving.supervisor import Supervisor

_PAGE: Final = Path(str(files("firmware_sim.live").joinpath("page")))
LOOK_S: Final = 0.1
"""Time in s between two calls of `is_stopped`."""
PING_S: Final = 20.0
"""Time in s between two WebSocket pings to a viewer."""
_IDLE_S: Final = 10.0  # time in s after which a connection without a complete request is closed
MOST_CONNECTIONS: Final = 128
"""Largest number of connections: four per viewer. This is half of the lowest usual limit of open files per process."""


def application(
    supervisor: Supervisor, access: handlers.PageAccess, *, stalled_s: float = handlers.STALLED_S
) -> Application:
    """Return the web application, in which a viewer may take `stalled_s` to accept a message."""
    served = handlers.ServedPage(supervisor=supervisor, access=access, stalled_s=stalled_s)
    own: dict[str, Any] = {"served": served}
    return Application(
        [
            (r"/()", handlers.PageFiles, {**own, "path": str(_PAGE), "default_filename": "index.html"}),
            (r"/static/([A-Za-z0-9._/-]+)", handlers.PageFiles, {**own, "path": str(_PAGE)}),
            (r"/stream", handlers.StreamSocket, own),
            (r"/control", handlers.ControlSocket, own),
        ],
        default_handler_class=NotFound,
        default_handler_args=own,
        # Addresses are not logged, because they contain the token.
        log_function=lambda handler: None,
        websocket_max_message_size=handlers.LONGEST_REQUEST,
        websocket_ping_interval=PING_S,
    )


class BoundedServer(HTTPServer):
    """A server that limits the number, idle time and request size of connections, even before clients send a token."""

    def initialize(self, application: Application, *, idle_s: float = _IDLE_S) -> None:  # type: ignore[override]
        limits: dict[str, Any] = {"idle_connection_timeout": idle_s, "body_timeout": idle_s}
        limits |= dict.fromkeys(("max_header_size", "max_body_size"), handlers.LONGEST_REQUEST)
        super().initialize(application, **limits)
        self._open: list[IOStream] = []

    def handle_stream(self, stream: IOStream, address: tuple[Any, ...]) -> None:
        """Handle one more connection; close it if there are too many connections."""
        self._open = [one for one in self._open if not one.closed()]
        if len(self._open) >= MOST_CONNECTIONS:
            stream.close()
            return
        self._open.append(stream)
        super().handle_stream(stream, address)


class NotFound(handlers.Guarded):
    def prepare(self) -> None:
        super().prepare()
        if not self._finished:
            self.send_error(404)


async def serve(
    make: MakeSession,
    *,
    address: str = "127.0.0.1",
    port: int,
    fast: bool = False,
    is_stopped: Callable[[], bool],
    ready: Callable[[str], None],
    report: Callable[[str], None],
) -> None:
    """Serve the page until it is stopped or the loop fails. Requests need a token unless `address` is this machine's
    loopback address; port 0 means any free port. With `fast`, a period may take less time than on a vehicle. `ready` is
    called with the page's address as soon as the page can be opened, `report` with a line about any work for which
    viewers wait. Raises StillwakeError if port or address cannot be used, or the loop fails shortly after its start."""
    sockets = _bound(address, port)
    access = handlers.PageAccess.to(address)
    supervisor = Supervisor(make, fast=fast, report=report)
    server = BoundedServer(application(supervisor, access))
    server.add_sockets(sockets)
    ready(page_url(address, sockets[0].getsockname()[1], access))
    loop = asyncio.create_task(supervisor.run())
    try:
        while not is_stopped() and not loop.done():
            await asyncio.wait([loop], timeout=LOOK_S)
        # A stop signal may reach all processes of a service, so the loop may end shortly before `is_stopped` is true.
        await asyncio.sleep(0.0 if is_stopped() else LOOK_S)
    finally:
        server.stop()
        loop.cancel()
        await asyncio.wait([loop])
        await server.close_all_connections()
    if not is_stopped() and not loop.cancelled() and (error := loop.exception()) is not None:
        raise error


def page_url(address: str, port: int, access: handlers.PageAccess) -> str:
    is_any = address in ("", "0.0.0.0", "::")
    host = socket.gethostname() if is_any else f"[{address}]" if ":" in address else address
    return f"http://{host}:{port}/" + ("" if access.token is None else f"?token={access.token}")


def _bound(address: str, port: int) -> list[socket.socket]:
    try:
        return bind_sockets(port, address)
    except ValueError as error:
        raise StillwakeError(f"--host {address} is not the name of a machine") from error
    except OSError as error:
        why = error.strerror or str(error)
        if error.errno == errno.EADDRINUSE:
            why = "it is in use, perhaps by another `stillwake live`; name another --port, or 0 for a free port"
        elif isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
            raise StillwakeError(f"--host {address} is not an address of this machine: {why}") from error
        raise StillwakeError(f"cannot use --port {port} at {address}: {why}") from error
