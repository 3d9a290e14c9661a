"""A connection to an open python-can bus: one reception at a time, and an end whatever has become of the bus."""

import struct
from contextlib import suppress
from typing import ClassVar, Final, Self

import can

from can_bridge.bus.backends.opening import one_line
from can_bridge.bus.rejection import Rejection, UnusableReceptionError
from contract.errors import BusError
from contract.runtime.copies import NeverCopied

GARBAGE_LIMIT: Final = 1000
"""Errors of a backend's parser in a row, without an idle moment or a good frame between them, after which the bus
counts as failed: a dead backend that raises on every call would otherwise look like endless noise. Our own backends
raise `UnusableReceptionError` for what they refuse, without a limit."""

_UNREADABLE: Final = (ValueError, IndexError, struct.error)
"""What the parsers of backends raise on what they were sent."""


class Connection(NeverCopied):
    """Holds an open python-can bus. Use as a context manager, or `close` it."""

    INSTEAD: ClassVar = "it is open on this process alone; open another one"

    def __init__(self, bus: can.BusABC) -> None:
        """Take over an open bus, which is closed together with this object."""
        self._bus = bus
        self._unreadable_in_a_row = 0

    def close(self) -> None:
        """Disconnect; closing twice does nothing more, nor does closing what has vanished."""
        # An adapter that was unplugged takes no command; its error would hide the one that ended the work.
        with suppress(can.CanError, OSError):
            self._bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, message: can.Message, name: str, timeout_s: float) -> None:
        """Send once, waiting at most `timeout_s`. Raises BusError naming the frame if the bus does not take it in time,
        or failed."""
        try:
            self._bus.send(message, timeout=timeout_s)
        except (can.CanError, OSError, ValueError) as error:
            raise BusError(f"frame {name} was not sent: {one_line(error)}") from error

    def _received(self, timeout_s: float) -> can.Message | Rejection | None:
        """Receive once: a message, why there is none, or None if nothing came. Raises BusError if the bus failed, or
        yields nothing but garbage."""
        try:
            message = self._bus.recv(timeout=timeout_s)
        except UnusableReceptionError as refused:
            return refused.reason
        except (can.CanError, OSError, *_UNREADABLE) as error:
            # Backends wrap what went wrong: a CanError by garbage has one of these as its cause.
            if not isinstance(error.__cause__ or error, _UNREADABLE):
                raise BusError(f"CAN bus failed: {one_line(error)}") from error
            self._unreadable_in_a_row += 1
            if self._unreadable_in_a_row > GARBAGE_LIMIT:
                text = f"CAN bus failed: {GARBAGE_LIMIT} unreadable receptions in a row, last: {error}"
                raise BusError(text) from error
            return Rejection.GARBAGE
        self._unreadable_in_a_row = 0
        return message
