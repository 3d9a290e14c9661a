"""Recording: every message of a bus, in the order it came, until it is stopped."""

from collections import Counter
from collections.abc import Callable
from typing import Final

import can

POLL_S: Final = 0.1
"""How long one reception may wait, and with it how long stopping may take."""


class Recorder:
    """Moves messages from a bus to a file.

    Attributes:
        frames: written so far, of any kind.
        not_kept: what the file's format does not keep, in words, and how often.
    """

    def __init__(self, append: Callable[[can.Message], None], loss_of: Callable[[can.Message], str]) -> None:
        """Args:
        append: to the file.
        loss_of: what the file will not keep of a message; empty for nothing.
        """
        self._append, self._loss_of = append, loss_of
        self.frames = 0
        self.not_kept: Counter[str] = Counter()

    def run(self, receive: Callable[[float], can.Message | None], *, is_over: Callable[[int], bool]) -> None:
        """Record until it is over; what was written until an error stays counted.

        Args:
            receive: the next message, or None after waiting for so many seconds.
            is_over: asked before each reception with the number of frames so far.
        """
        while not is_over(self.frames):
            message = receive(POLL_S)
            if message is not None:
                self._take(message)

    def drain(self, receive: Callable[[float], can.Message | None], *, most: int) -> None:
        """Record what has arrived and waits to be looked at, at most so many, up to the first that cannot be read.

        So a stop loses nothing that was there.
        """
        for _ in range(most):
            message = receive(0.0)
            if message is None:
                return
            self._take(message)

    def _take(self, message: can.Message) -> None:
        self._append(message)
        self.frames += 1
        if loss := self._loss_of(message):
            self.not_kept[loss] += 1
