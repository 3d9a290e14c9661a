"""The loop in a process of its own, behind a pipe. A thread receives its messages, and waits for no viewer."""

import multiprocessing
import os
import signal
import socket
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import resource_tracker
from threading import Thread
from typing import Final

from contract.errors import StillwakeError
from firmware_sim.live.loop.messages import Answer, Message
from firmware_sim.live.serving.stepping import MakeSession, run

LONGEST_END_S: Final = 3.0
"""What the process is given to end by itself, before it is terminated and then killed."""


class LoopProcess:
    """A session that is stepped in another process, from `start` to `end`.

    Args:
        make: the session there; can be pickled.
        fast: whether a period may take less time than it does on a vehicle.
        hear: called with new messages, in a thread of its own.
        answered: called with a request's number and its answer, there too.
        ended: called once, there too, with why it ended by itself: a StillwakeError, or another error of the session's.
    """

    def __init__(
        self,
        make: MakeSession,
        *,
        fast: bool,
        hear: Callable[[Sequence[Message | bytes]], None],
        answered: Callable[[int, Answer], None],
        ended: Callable[[Exception], None],
    ) -> None:
        self._hear, self._answered, self._ended = hear, answered, ended
        # Not forked: this process has threads, whose locks a fork would keep as they are.
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=run, args=(theirs, make), kwargs={"fast": fast}, name="live-loop", daemon=True
        )
        self._theirs = theirs
        self._thread = Thread(target=self._listen, name="live-loop", daemon=True)
        self._is_wanted = True

    def start(self) -> None:
        """Begin."""
        # Its own start lets the signals through that are held back here.
        resource_tracker.ensure_running()
        # Ctrl-C goes to all processes of a terminal. This one is to end by its pipe, also while Python begins in it.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
        try:
            self._process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        self._theirs.close()
        self._thread.start()

    def ask(self, number: int, request: str) -> None:
        """A request as JSON, to be answered under this number; one at a time, and not from an event loop: it may wait.
        Raises StillwakeError if the process has ended."""
        try:
            self._pipe.send((number, request))
        except OSError as error:
            raise StillwakeError("the loop has ended") from error

    def end(self) -> None:
        """End the process and wait until it is gone; it may have ended already. Nothing is heard of it any more."""
        if self._process.pid is None:
            return
        self._is_wanted = False
        # Closing would not do: the thread that reads would keep it open. The process takes it for an end of the server.
        with suppress(OSError), socket.socket(fileno=os.dup(self._pipe.fileno())) as both:
            both.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._pipe.close()
        self._process.join(LONGEST_END_S)
        for stop in (self._process.terminate, self._process.kill):
            if self._process.is_alive():
                stop()
                self._process.join(LONGEST_END_S)

    def _listen(self) -> None:
        error: Exception | None = None
        while error is None:
            try:
                kind, content = self._pipe.recv()
            except (EOFError, OSError):
                break
            if not self._is_wanted:
                return
            if kind == "messages":
                self._hear(content)
            elif kind == "answer":
                self._answered(*content)
            else:
                error = content
        if not self._is_wanted:
            return
        self._process.join()
        self._ended(error or StillwakeError(f"the loop's process ended {how(self._process.exitcode)}"))


def how(status: int | None) -> str:
    """A process ended, in words, by its exit code as `multiprocessing` has it."""
    if status is None or status >= 0:
        return f"with status {status}"
    return f"by {signal.Signals(-status).name}"
