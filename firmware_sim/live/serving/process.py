"""The loop in another process, which handles requests between two periods."""

import json
import multiprocessing
import os
import pickle
import signal
import socket
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, Final

from contract.errors import StillwakeError
from firmware_sim.live.loop.messages import LiveAnswer, LiveMessage, Request

if TYPE_CHECKING:
    from firmware_sim.live.session import LiveSession

_IDLE_S: Final = 0.02  # time in s between two steps of a session that computes no periods, such as a paused session
MakeSession = Callable[[Callable[[str], None]], "LiveSession"]
"""Function that creates the session in the loop's process, given a function that shows a line of text to viewers."""
LONGEST_END_S: Final = 3.0
"""Time in s in which the process may end by itself. Then it is terminated and, after the same time again, killed."""


def run(pipe: Connection, make: MakeSession, *, fast: bool) -> None:
    """Run the process until the pipe is closed or the session fails. It sends pairs: ("messages", list), ("answer",
    (number, Answer)) and, as the last pair, ("ended", error). It receives pairs of a number and a request as JSON."""
    # `os._exit` ends the process at once. An exception might be raised in a callback, where Python only prints it.
    signal.signal(signal.SIGTERM, lambda *_: os._exit(0))
    # `started` blocked SIGTERM and SIGINT (Ctrl-C). SIGINT stays blocked, because the server ends this process.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGTERM,))
    outbox = Outbox(pipe)
    try:
        session = make(lambda text: outbox.report("busy", text))
        outbox.report("running")
        _step(session, pipe, outbox, fast=fast)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return
    except Exception as error:  # noqa: BLE001  (the server reports any error, and decides what to do)
        if not isinstance(error, StillwakeError):
            traceback.print_exc()
        outbox.send("ended", _that_travels(error))


def _step(session: "LiveSession", pipe: Connection, outbox: "Outbox", *, fast: bool) -> None:
    requests = Requests(session, outbox)
    period_s = 0.0
    due = time.monotonic()
    while True:
        session.step()
        new = session.messages()
        if new:
            outbox.send("messages", new)
        by_type = {message["type"]: message for message in new if not isinstance(message, bytes)}
        if "hello" in by_type:
            period_s = by_type["hello"]["period_ms"] / 1e3
        now = time.monotonic()
        # After a late period the loop does not run faster to catch up, because viewers would see a faster wake.
        due = max(due + (0.0 if fast else period_s), now) if "periods" in by_type else now + _IDLE_S
        requests.go_on()
        while pipe.poll(max(0.0, due - time.monotonic())):
            number, text = pipe.recv()
            requests.take(number, json.loads(text))


class Requests:
    """A handler of requests between two periods. If a request needs another ECU, a thread creates this ECU first."""

    def __init__(self, session: "LiveSession", outbox: "Outbox") -> None:
        self._session, self._outbox = session, outbox
        self._waiting: tuple[int, Request, Future[None]] | None = None

    def take(self, number: int, request: Request) -> None:
        """Handle a request that has arrived, or start the thread that the request needs."""
        work = self._session.before(request)
        if work is None:
            self._answer(number, self._session.handle(request))
        elif self._waiting is not None:
            self._answer(number, {"error": "another controller is being built: ask again when it is ready"})
        else:
            made = Future[None]()
            self._waiting = number, request, made
            Thread(target=_make, args=(work, made), name="making", daemon=True).start()

    def go_on(self) -> None:
        """Handle the waiting request if its ECU has been created."""
        if self._waiting is None or not self._waiting[2].done():
            return
        (number, request, made), self._waiting = self._waiting, None
        failed = {"error": " ".join(str(made.exception()).split())}
        self._answer(number, failed if made.exception() else self._session.handle(request))

    def _answer(self, number: int, answer: LiveAnswer) -> None:
        self._outbox.send("answer", (number, answer))
        if self._waiting is None:
            self._outbox.report("running")


def _make(work: Callable[[], None], made: Future[None]) -> None:
    try:
        work()
        made.set_result(None)
    except Exception as error:  # noqa: BLE001  (an error in this code must not end the loop)
        if not isinstance(error, StillwakeError):
            traceback.print_exc()
        made.set_exception(error)


class Outbox:
    """A sender of messages for all threads. If the server has ended, messages are dropped, and `run` ends."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe, self._lock = pipe, Lock()
        self._state: LiveMessage = {}

    def send(self, kind: str, content: object) -> None:
        """Send the pair (kind, content), as `run` describes."""
        with self._lock, suppress(OSError):
            self._pipe.send((kind, content))

    def report(self, state: str, text: str = "") -> None:
        """Send the state of this process if it has changed."""
        now = {"type": "loop", "state": state, "text": text}
        if now != self._state:
            self._state = now
            self.send("messages", [now])


def _that_travels(error: Exception) -> Exception:
    """Return the error or, if another process could not unpickle it, a StillwakeError with the same text."""
    try:
        copy: Any = pickle.loads(pickle.dumps(error))
    except Exception:  # noqa: BLE001  (pickle raises what the error's class raises)
        copy = None
    return error if type(copy) is type(error) and str(copy) == str(error) else StillwakeError(str(error))


@contextmanager
def started(make: MakeSession, *, fast: bool) -> Iterator[tuple[BaseProcess, Connection]]:
    """Start a process that executes `run`; yield the process and this side's end of the pipe. After the block, the
    process is ended if it still runs, and a thread that waits for the pipe gets EOFError or OSError. Pickles `make`."""
    # The process is spawned, not forked: a fork would also copy locks that this process's threads hold.
    context = multiprocessing.get_context("spawn")
    pipe, theirs = context.Pipe()
    process = context.Process(target=run, args=(theirs, make), kwargs={"fast": fast}, name="live-loop", daemon=True)
    # The resource tracker's start unblocks SIGINT and SIGTERM, so these signals are blocked only afterwards.
    resource_tracker.ensure_running()
    # Ctrl-C reaches all processes of a terminal, but the loop's process must end only when its pipe closes.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    theirs.close()
    try:
        yield process, pipe
    finally:
        # Closing the pipe is not enough, because a thread that waits for the pipe also has the pipe open.
        with suppress(OSError), socket.socket(fileno=os.dup(pipe.fileno())) as both:
            both.shutdown(socket.SHUT_RDWR)
        process.join(LONGEST_END_S)
        for stop in (process.terminate, process.kill):
            if process.is_alive():
                stop()
                process.join(LONGEST_END_S)
