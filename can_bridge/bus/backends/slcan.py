"""Serial CAN adapters (slcan, the Lawicel protocol): python-can's backend with a reader and a writer of our own.

python-can 4.6 keeps an undecodable line for ever, reads cut-off and foreign lines as frames, takes each answer to a
sent frame for a moment of silence, and reports a frame as not sent that was. Opening, and what a sound line means, are
its own.
"""

import os
import re
import select
import time
from contextlib import suppress
from typing import Final

import can
from can.interfaces.slcan import slcanBus

from can_bridge.bus.interface import Rejection, UnusableReceptionError
from can_bridge.wire.frame import FD_LENGTHS

_LINE: Final = re.compile(rb"(?:([tdbr])[0-7][0-9A-Fa-f]{2}|([TDBRx])[01][0-9A-Fa-f]{7})([0-9A-Fa-f])([0-9A-Fa-f]*)")
"""Kind, identifier, length code, digits behind it. `x` is CANDapter's `T`."""
_ANSWER: Final = re.compile(rb"[zZ]?")
_STAMP_DIGITS: Final = 4
"""A time stamp that adapters append on request; it is ignored, as it counts to a minute only."""

_ENDS: Final = re.compile(rb"[\r\a]")
_BEL: Final = 0x07
_CR: Final = b"\r"

LINE_LIMIT: Final = 256
"""Bytes without an end after which they count as one unreadable line; the longest line has 143."""
_CHUNK: Final = 4096

OPENING_TIMEOUT_S: Final = 2.0
"""The time limit of commands, to which python-can gives none."""


def why_refused(line: bytes) -> Rejection | None:
    """Why one line without its end is no frame; None if it is one. Never raises."""
    match = _LINE.fullmatch(line)
    if match is None:
        return Rejection.GARBAGE
    kind, code, digits = match[1] or match[2], int(match[3], 16), match[4]
    if code > 8 and kind not in b"dDbB":
        return Rejection.WRONG_LENGTH
    data_digits = 0 if kind in b"rR" else 2 * FD_LENGTHS[code]
    return None if len(digits) in (data_digits, data_digits + _STAMP_DIGITS) else Rejection.WRONG_LENGTH


class SlcanBus(slcanBus):
    """One adapter. A line that cannot be used is raised as `UnusableReceptionError`; nothing else is lost with it."""

    _line_cut = False

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        deadline = None if timeout is None else time.monotonic() + timeout
        over = False
        while True:
            while (line := self._next_line()) is not None:
                if _ANSWER.fullmatch(line):
                    continue
                if (reason := why_refused(line)) is not None:
                    raise UnusableReceptionError(reason)
                self._queue.put(line.decode())
                return super()._recv_internal(0.0)
            if over:
                return None, False
            over = deadline is not None and time.monotonic() >= deadline
            self._fill(wait=not over)

    def _fill(self, *, wait: bool) -> None:
        """Read what has arrived; or wait for it, at most as long as the port was opened with."""
        port = self.serialPortOrig
        if not port.is_open:
            raise can.CanOperationError("the serial port is closed")
        waiting = port.in_waiting
        if waiting or wait:
            self._buffer += port.read(min(max(1, waiting), _CHUNK))

    def _next_line(self) -> bytes | None:
        """The next whole line without its end; None if none has arrived."""
        end = _ENDS.search(self._buffer)
        if end is None:
            if len(self._buffer) > LINE_LIMIT:
                self._buffer.clear()
                raise UnusableReceptionError(Rejection.GARBAGE)
            return None
        line, ended_by = bytes(self._buffer[: end.start()]), self._buffer[end.start()]
        del self._buffer[: end.end()]
        if ended_by == _BEL:
            raise UnusableReceptionError(Rejection.GARBAGE if line else Rejection.ADAPTER)
        return line

    def _write(self, string: str) -> None:
        """Write one line; the time limit is the port's.

        A line is either written whole, whatever time has passed by then, or cut off at the time limit. The end of a cut
        line goes out before the next one, so that the adapter refuses the one and takes the other. Raises
        can.CanTimeoutError if the port did not take the whole line in time; can.CanOperationError if it failed.
        """
        port = self.serialPortOrig
        if not port.is_open:
            raise can.CanOperationError("the serial port is closed")
        if not hasattr(port, "fd"):  # no POSIX port: pyserial's own ways
            super()._write(string)
            return
        line = string.encode() + _CR
        if self._line_cut:
            line = _CR + line
        limit = OPENING_TIMEOUT_S if port.write_timeout is None else port.write_timeout
        deadline = time.monotonic() + limit
        written = 0
        try:
            while True:
                with suppress(BlockingIOError):
                    written += os.write(port.fd, line[written:])
                if written == len(line):
                    self._line_cut = False
                    return
                left = max(0.0, deadline - time.monotonic())
                if not select.select([], [port.fd], [], left)[1]:
                    self._line_cut = self._line_cut or written > 0
                    raise can.CanTimeoutError(f"the serial port took {written} of {len(line)} bytes in {limit:g} s")
        except can.CanTimeoutError:  # an OSError, too
            raise
        except OSError as error:
            raise can.CanOperationError(f"the serial port failed: {error}") from error

    def shutdown(self) -> None:
        """Close the channel and the port; the port also if it no longer takes the command."""
        if self._is_shutdown:
            return
        try:
            super().shutdown()
        finally:
            self.serialPortOrig.close()
