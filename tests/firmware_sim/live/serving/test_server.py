"""The server with a loop that counts: who is refused, what viewers get, and how it all ends."""

import asyncio
import gc
import json
import socket
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from functools import wraps
from typing import Any

import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest, HTTPResponse
from tornado.testing import bind_unused_port
from tornado.websocket import WebSocketClientConnection, websocket_connect

from contract.errors import StillwakeError
from firmware_sim.live.serving import handlers, server
from firmware_sim.live.serving.handlers import PageAccess
from firmware_sim.live.serving.server import BoundedServer, application, serve
from firmware_sim.live.serving.supervisor import Supervisor
from tests.firmware_sim.live.serving.fake_session import PICTURE_BYTES, FakeSession

PATIENCE_S = 60.0  # a process is started on a machine that does other things
OPEN = PageAccess(token=None)
FAR = PageAccess(token="right")
FAKE: Any = FakeSession


@dataclass(frozen=True)
class Place:
    port: int
    supervisor: Supervisor

    async def get(self, path: str, **headers: str) -> HTTPResponse:
        request = HTTPRequest(f"http://127.0.0.1:{self.port}{path}", headers=headers, follow_redirects=False)
        return await AsyncHTTPClient().fetch(request, raise_error=False)

    async def connect(self, path: str, **headers: str) -> WebSocketClientConnection:
        return await websocket_connect(HTTPRequest(f"ws://127.0.0.1:{self.port}{path}", headers=headers))


@asynccontextmanager
async def placed(make=None, access=OPEN, *, stalled_s=30.0, short_life_s=30.0, idle_s=30.0) -> AsyncIterator[Place]:
    supervisor = Supervisor(make or FAKE, short_life_s=short_life_s)
    listening, port = bind_unused_port()
    serving = BoundedServer(application(supervisor, access, stalled_s=stalled_s), idle_s=idle_s)
    serving.add_socket(listening)
    loop = None if make is None else asyncio.create_task(supervisor.run())
    try:
        yield Place(port, supervisor)
    finally:
        serving.stop()
        if loop is not None:
            loop.cancel()
            await asyncio.wait([loop])


def in_a_loop(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    @wraps(test)
    def run(**fixtures: Any) -> None:
        asyncio.run(test(**fixtures))

    return run


async def heard(stream: WebSocketClientConnection, **wanted: str) -> dict[str, Any]:
    """The first message with these values; a picture is {"type": "picture"}."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            message = await stream.read_message()
            assert message is not None, "closed"
            found = {"type": "picture"} if isinstance(message, bytes) else json.loads(message)
            if wanted.items() <= found.items():
                return found


async def answer(control: WebSocketClientConnection, request: str | bytes) -> Any:
    await control.write_message(request, binary=isinstance(request, bytes))
    return await read(control)


async def read(control: WebSocketClientConnection) -> Any:
    async with asyncio.timeout(PATIENCE_S):
        message = await control.read_message()
    assert message is not None, "closed"
    return json.loads(message)


def test_only_the_loopback_goes_without_a_token():
    assert [PageAccess.to(address).token for address in ("127.0.0.1", "::1", "localhost", "127.8.0.1")] == [None] * 4
    tokens = [PageAccess.to(address).token for address in ("0.0.0.0", "::", "192.168.0.7", "truck.example", "0.0.0.0")]
    assert len(set(tokens)) == 5
    # 128 random bits are 22 characters of base64.
    assert all(token is not None and len(token) >= 22 for token in tokens)


def test_others_are_refused_by_their_host_origin_or_token():
    for host in ("localhost:8765", "127.0.0.1:8765", "[::1]:8765", "localhost", "LOCALHOST:1"):
        assert OPEN.refusal(host=host, origin=None, token=None) is None, host
        assert OPEN.refusal(host=host, origin=f"http://{host}", token=None) is None, host
    # A name that was pointed here.
    for host in ("evil.example:8765", "localhost.evil.example", "10.0.0.1", "", "[", "a@localhost@b"):
        assert "only to localhost" in str(OPEN.refusal(host=host, origin=f"http://{host}", token=None)), host
    origins = ("http://evil.example", "http://localhost:3000", "null", "", "localhost:8765", "http://localhost:8765/x")
    for access in (OPEN, FAR):
        for origin in origins:
            refusal = access.refusal(host="localhost:8765", origin=origin, token="right")
            assert "another server" in str(refusal), (access, origin)
    for token in (None, "", "wrong", "righ", "right ", "r\xefght"):
        assert "the link" in str(FAR.refusal(host="truck.example:8765", origin=None, token=token)), token
    assert FAR.refusal(host="truck.example:8765", origin="http://truck.example:8765", token="right") is None


def test_what_is_no_request_gets_an_error():
    cases: dict[str, tuple[str | bytes, ...]] = {
        "must be JSON": ("", "{", "[" * 5000, "9" * 5000),
        "NaN is not a number": ('{"set": {"noise": NaN}}',),
        "-Infinity is not a number": ('{"set": {"noise": -Infinity}}',),
        "must be text": (b"{}",),
        "must be an object": ("[]", "null"),
        "id: must be": ('{"id": "1"}', '{"id": true}', '{"id": 1.5}'),
    }
    for message, texts in cases.items():
        for text in texts:
            error = (handlers.check(text) or {})["error"]
            assert message in error and "\n" not in error, text
    # Any other object is for the loop to judge.
    for text in ["{}", '{"id": 1, "set": {"enable": true}}', '{"id": -7, "anything": [1.5, null]}']:
        assert handlers.check(text) is None, text


@in_a_loop
async def test_the_page_has_its_files_and_no_other_can_be_had() -> None:
    async with placed() as place:
        index, script = await place.get("/"), await place.get("/static/widgets/frames.js")
        assert index.body.startswith(b"<!doctype html>")
        assert index.headers["Cache-Control"] == "no-store"
        assert "Set-Cookie" not in index.headers
        assert script.headers["Content-Type"].startswith("text/javascript")
        for response in (index, script):
            assert response.headers["Content-Security-Policy"].startswith("default-src 'self';")
            assert response.headers["X-Content-Type-Options"] == "nosniff"
            assert response.headers["Referrer-Policy"] == "no-referrer"
        for path in (
            *("/static/../session.py", "/static/%2e%2e/session.py", "/static/vendor/../../session.py"),
            *("/static/..%2fsession.py", "/static/%2e%2e%2fsession.py", "/static//etc/hostname"),
            *("/static/vendor", "/static/none.js", "/static/x%00", "/none"),
        ):
            response = await place.get(path)
            assert response.code in (403, 404), path
            assert response.body.count(b"\n") == 1, path


@in_a_loop
async def test_who_has_not_the_token_or_is_another_page_is_refused() -> None:
    async with placed(access=FAR) as place:
        evil = {"Origin": "http://evil.example"}
        for path in ("/", "/static/ring.js", "/stream", "/control", "/none"):
            for query, origin in (("", {}), ("?token=wrong", {}), ("?token=right", evil)):
                response = await place.get(path + query, **origin)
                assert response.code == 403, path + query
                assert b"right" not in response.body, path + query
        # The page's cookie is enough for files alone: a browser sends it with whatever asks.
        cookie = (await place.get("/?token=right")).headers["Set-Cookie"]
        assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
        assert (await place.get("/static/ring.js", Cookie=cookie.partition(";")[0])).code == 200
        for path in ("/stream", "/control"):
            with pytest.raises(HTTPClientError, match="403"):
                await place.connect(path, Cookie=cookie.partition(";")[0])
            (await place.connect(f"{path}?token=right", Origin=f"http://127.0.0.1:{place.port}")).close()
    async with placed() as place:
        for path in ("/stream", "/control"):
            with pytest.raises(HTTPClientError, match="403"):
                await place.connect(path, Host="evil.example")
            # A program that is no browser has no origin.
            (await place.connect(path)).close()


@in_a_loop
async def test_only_so_many_can_look(monkeypatch) -> None:
    monkeypatch.setattr(handlers, "MOST_VIEWERS", 2)
    async with placed() as place, asyncio.timeout(PATIENCE_S):
        viewers = [await place.connect("/stream") for _ in range(3)]
        assert await viewers[2].read_message() is None
        assert viewers[2].close_code == handlers.TRY_AGAIN_LATER
        # A place that is given up can be had: there is something to be read.
        place.supervisor.hub.put([b"picture"])
        viewers[0].close()
        while await (await place.connect("/stream")).read_message() is None:
            await asyncio.sleep(0.05)


@pytest.mark.processes
@in_a_loop
async def test_viewers_see_and_ask(tmp_path) -> None:
    async def ask(number: int, **given: object) -> None:
        await control.write_message(json.dumps({"id": number, "set": given}, default=str))

    async with placed(FAKE) as place:
        viewers = [await place.connect("/stream") for _ in range(2)]
        for viewer in viewers:
            assert (await heard(viewer))["type"] == "loop"
            await heard(viewer, type="hello")
            rows = [k for _ in range(3) for k in (await heard(viewer, type="periods"))["columns"]["k"]]
            assert rows == list(range(int(rows[0]), int(rows[0]) + len(rows)))
            assert (await heard(viewer, type="now"))["t"] is None
        control = await place.connect("/control")
        assert (await answer(control, '{"id": 7}')).items() >= {"id": 7}.items()
        assert "error" in await answer(control, "{")
        assert "error" in await answer(control, b"{}")
        # What is waited for is shown to the other viewer as well.
        await ask(8, wait=tmp_path / "8")
        await heard(viewers[1], type="loop", text="something takes long")
        (tmp_path / "8").touch()
        assert (await read(control))["id"] == 8
        await heard(viewers[1], type="loop", state="running")
        # What takes seconds to make does not hold up the loop, nor other requests.
        await ask(9, make=tmp_path / "9")
        assert (await answer(control, '{"id": 10}'))["id"] == 10
        await ask(11, make=tmp_path / "9")
        assert "another controller is being built" in (await read(control))["error"]
        await heard(viewers[1], type="loop", text="something is made")
        (tmp_path / "9").touch()
        assert (await read(control))["id"] == 9
        assert (await heard(viewers[1], type="loop"))["state"] == "running"
        await ask(12, make=tmp_path, fail=True)
        assert (await read(control))["error"] == "it cannot be made"
        # Who asks without end is refused, and the others are not.
        for number in range(handlers.MOST_UNANSWERED + 1):
            await ask(number, wait=tmp_path / "all")
        refused = await read(control)
        assert refused["id"] == handlers.MOST_UNANSWERED and "wait for the loop already" in refused["error"]
        (tmp_path / "all").touch()
        answered = [await read(control) for _ in range(handlers.MOST_UNANSWERED)]
        assert {one["id"] for one in answered if "error" not in one} == set(range(handlers.MOST_UNANSWERED))
        # Nothing comes while it is paused, and it still answers.
        await answer(control, '{"pause": true}')
        assert len({(await answer(control, "{}"))["note"] for _ in range(3)}) == 1
        await control.write_message("x" * (handlers.LONGEST_REQUEST + 1))
        async with asyncio.timeout(PATIENCE_S):
            assert await control.read_message() is None


def silent(port: int) -> socket.socket:
    """A viewer that opens a channel and never reads."""
    viewer = socket.socket()
    viewer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    viewer.connect(("127.0.0.1", port))
    head = ("GET /stream HTTP/1.1", f"Host: 127.0.0.1:{port}", "Upgrade: websocket", "Connection: Upgrade")
    key = ("Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", "Sec-WebSocket-Version: 13", "", "")
    viewer.sendall("\r\n".join((*head, *key)).encode())
    return viewer


@pytest.mark.processes
@in_a_loop
async def test_who_does_not_read_holds_up_no_one_and_is_closed(caplog) -> None:
    async with placed(FAKE, stalled_s=0.5) as place:
        reading = await place.connect("/stream")
        await heard(reading, type="picture")
        with silent(place.port) as stalled:
            begin = int((await heard(reading, type="now"))["k"])
            # It could have had some ten times as much as the machine keeps for it.
            pictures = 10 * handlers.SEND_BUFFER // PICTURE_BYTES
            rows = list[float]()
            while len(rows) < pictures * 2:
                rows += (await heard(reading, type="periods"))["columns"]["k"]
            assert rows == list(range(int(rows[0]), int(rows[0]) + len(rows)))
            assert int(rows[0]) - begin < 500
            stalled.settimeout(PATIENCE_S)
            taken = await asyncio.to_thread(_until_closed, stalled)
        # What it finds at the end is what the machine kept, and no more than a message of the server's.
        assert taken < 2 * handlers.SEND_BUFFER + 3 * PICTURE_BYTES
    gc.collect()
    assert caplog.records == []


def _until_closed(stalled: socket.socket) -> int:
    time.sleep(2.0)
    taken = 0
    with suppress(ConnectionResetError):
        while piece := stalled.recv(65536):
            taken += len(piece)
    return taken


@in_a_loop
@pytest.mark.slow
async def test_idle_connections_are_closed_and_more_than_a_bound_refused(monkeypatch, caplog) -> None:
    monkeypatch.setattr(server, "MOST_CONNECTIONS", 3)
    async with placed(idle_s=1.0) as place:
        begun = (b"", b"GET / HT", b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n", b"")
        idle = [await asyncio.open_connection("127.0.0.1", place.port) for _ in begun]
        for (_, writer), text in zip(idle, begun, strict=True):
            writer.write(text)
        async with asyncio.timeout(PATIENCE_S):
            assert await idle[3][0].read() == b""
            for reader, _ in idle[:3]:
                assert not reader.at_eof()
            for reader, _ in idle[:3]:
                await reader.read()
        assert (await place.get("/")).code == 200
    assert caplog.records == []


@pytest.mark.processes
@in_a_loop
async def test_a_loop_that_ends_reports_why_and_starts_again() -> None:
    async with placed(FAKE, short_life_s=0.0) as place:
        for order, reason in (("diverge", "the flow diverged at t = 1.0"), ("die", "SIGKILL")):
            stream, control = await place.connect("/stream"), await place.connect("/control")
            await heard(stream, type="hello")
            await control.write_message(json.dumps({"id": 1, "set": {"order": order}}))
            assert reason in (await heard(stream, type="loop", state="starting"))["text"]
            await heard(stream, type="hello")
            assert reason in (await heard(stream, type="events"))["items"][-1]["text"]
            while 0.0 not in (await heard(stream, type="periods"))["columns"]["k"]:
                pass


def no_session(show: Callable[[str], None]) -> Any:
    raise StillwakeError("no data are installed")


@pytest.mark.processes
def test_a_loop_that_cannot_start_ends_the_server():
    lines = list[str]()
    served = serve(no_session, port=0, is_stopped=lambda: False, ready=lambda url: None, report=lines.append)
    with pytest.raises(StillwakeError, match="no data are installed"):
        asyncio.run(asyncio.wait_for(served, PATIENCE_S))
    assert len(lines) == 2
