"""A backend for serial CAN adapters (slcan, the Lawicel protocol), with our own code to read and write lines.

python-can 4.6 never discards a line that it cannot decode, reads truncated lines and lines of other programs as frames,
stops waiting for a frame when it reads the acknowledgement of a sent frame, and reports sent frames as not sent. So
this module uses python-can's code only to open an adapter and to parse valid lines.
"""

import os
import re
import select
import time
from contextlib import suppress
from typing import Any, Final

import can
from can.interfaces.slcan import slcanBus

from can_bridge.bus.interface import Rejection, UnusableReceptionError
from can_bridge.wire.frame import FD_LENGTHS

_LINE: Final = re.compile(rb"(?:([tdbr])[0-7][0-9A-Fa-f]{2}|([TDBRx])[01][0-9A-Fa-f]{7})([0-9A-Fa-f])([0-9A-Fa-f]*)")
"""Groups: type of an 11-bit frame, type of a 29-bit frame (a CANDapter sends `x` for `T`), length code, data."""
_ANSWER: Final = re.compile(rb"[zZ]?")
_STAMP_DIGITS: Final = 4
"""Number of digits of the time stamp that an adapter can append to a line; ignored, because it wraps every minute."""

_ENDS: Final = re.compile(rb"[\r\a]")
_CR: Final = b"\r"

LINE_LIMIT: Final = 256
"""Largest number of bytes of a line; a longer line counts as unreadable. A valid line has at most 143 bytes."""


def why_refused(line: bytes) -> Rejection | None:
    """Return the reason why a line is not a frame; None if it is a frame. `line` has no line end. Never raises."""
    if (match := _LINE.fullmatch(line)) is None:
        return Rejection.GARBAGE
    kind, code, digits = match[1] or match[2], int(match[3], 16), match[4]
    if code > 8 and kind not in b"dDbB":
        return Rejection.WRONG_LENGTH
    data_digits = 0 if kind in b"rR" else 2 * FD_LENGTHS[code]
    return None if len(digits) in (data_digits, data_digits + _STAMP_DIGITS) else Rejection.WRONG_LENGTH


class SlcanBus(slcanBus):
    """A connection to an adapter. An unusable line raises `UnusableReceptionError`; the connection stays usable."""

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

    def _open_port(self) -> Any:
        if not self.serialPortOrig.is_open:
            raise can.CanOperationError("the serial port is closed")
        return self.serialPortOrig

    def _fill(self, *, wait: bool) -> None:
        """Read the bytes that have arrived; with `wait`, wait for the first byte up to the port's time limit."""
        port = self._open_port()
        if (waiting := port.in_waiting) or wait:
            self._buffer += port.read(min(max(1, waiting), 4096))

    def _next_line(self) -> bytes | None:
        if (end := _ENDS.search(self._buffer)) is None:
            if len(self._buffer) > LINE_LIMIT:
                self._buffer.clear()
                raise UnusableReceptionError(Rejection.GARBAGE)
            return None
        line, ended_by = bytes(self._buffer[: end.start()]), self._buffer[end.start()]
        del self._buffer[: end.end()]
        if ended_by == ord("\a"):
            raise UnusableReceptionError(Rejection.GARBAGE if line else Rejection.ADAPTER)
        return line

    def _write(self, string: str) -> None:
        """Write one line. The port's time limit may truncate the line. The next line then begins with a line end, so
        that the adapter rejects only the truncated line. Raises can.CanTimeoutError if the port did not accept the
        whole line in time; can.CanOperationError if the port failed."""
        port = self._open_port()
        if not hasattr(port, "fd"):  # pyserial's own code writes to ports that are not POSIX
            super()._write(string)
            return
        line = string.encode() + _CR
        if self._line_cut:
            line = _CR + line
        # While an adapter is being opened, python-can sets no limit.
        limit = 2.0 if port.write_timeout is None else port.write_timeout
        deadline = time.monotonic() + limit
        written = 0
        try:
            while True:
                with suppress(BlockingIOError):
                    written += os.write(port.fd, line[written:])
                left = max(0.0, deadline - time.monotonic())
                if written == len(line) or not select.select([], [port.fd], [], left)[1]:
                    break
        except (OSError, TypeError) as error:  # if another thread closes the port meanwhile, `fd` becomes None
            raise can.CanOperationError(f"the serial port failed: {error}") from error
        if written < len(line):
            self._line_cut = self._line_cut or written > 0
            raise can.CanTimeoutError(f"the serial port accepted {written} of {len(line)} bytes in {limit:g} s")
        self._line_cut = False

    def shutdown(self) -> None:
        """Close the channel. The port is closed even if it no longer accepts the command that closes the channel."""
        if self._is_shutdown:
            return
        try:
            super().shutdown()
        finally:
            self.serialPortOrig.close()
