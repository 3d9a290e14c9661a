"""The logs of can-utils: the files of `candump -L`, and the screen output of candump.

    (1436509052.249713) can0 123##1112233           with -L or -l
     (1436509052.249713)  can0  123  [03]  11 22 33  without

The times on a screen are absolute (-t a, or -t A with the date), or they count from the first frame (-t z) or the
previous line (-t d). A single line does not show which option was used; only times of -t d can decrease.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Final

import can

from can_bridge.bus.conversion import to_message
from can_bridge.logs import entries
from can_bridge.logs.entries import BRS, ESI, FD_FRAME, Entry, LogEvent
from can_bridge.wire.frame import FD_LENGTHS, Frame
from contract.atomic import replacing
from contract.printable import quoted

_ERROR: Final = 0x20000000
"""Bit 29 marks an error frame; the lower bits are its error classes (linux/can.h)."""
_LOG: Final = re.compile(r"\(([^)]*)\)\s+(\S+)\s+([0-9A-Fa-f]+)#(\S*)(?:\s+([RTrt]))?")
_SCREEN: Final = re.compile(
    r"(?:\(([^)]*)\)\s+)?(\S+)\s+(?:(RX|TX) [B-] [E-]\s+)?([0-9A-Fa-f]+)\s+(?:\[(\d+)\]|\{([0-9A-Fa-f]+)\})(?:\s+(.*))?"
)
_FD: Final = re.compile(r"#([0-9A-Fa-f])(.*)")
_DATA: Final = re.compile(r"((?:[0-9A-Fa-f]{2}\.?)*)(?:_[9A-Fa-f])?")
_REMOTE: Final = re.compile(r"[Rr]([0-9])?(?:_[9A-Fa-f])?")
_RELATIVE: Final = re.compile(r"\d{3}\.\d{6}")
"""A relative time: candump pads the seconds of -t z and -t d to three digits, and seconds since the epoch to ten."""
_REMEDY: Final = "record with `candump -L`"


def read_candump(lines: entries.Lines, since_epoch: entries.SinceEpoch) -> Iterator[Entry]:
    """Yield the entries of the lines. Raises ValueError for a line that candump does not write."""
    clock = _Clock(since_epoch)
    after_error = False
    for line in lines:
        text = re.sub(r"\x1b\[[0-9;]*m", "", line).strip()  # without colours
        if text.startswith(("#", "//", ";")):
            yield LogEvent(entries.COMMENT)
        elif after_error and line.startswith(("\t", " ")) and not _SCREEN.fullmatch(text):
            # `candump -e` writes the description of an error frame in the lines after the frame.
            yield LogEvent("description of an error frame")
        else:
            entry = _entry(text, clock, is_whole=line.endswith("\n"))
            yield entry
            after_error = not isinstance(entry, LogEvent) and entry.is_error_frame
    clock.check()


class _Clock:
    """A reader of the times in parentheses, in s. It rejects times that count from the previous line."""

    def __init__(self, since_epoch: entries.SinceEpoch) -> None:
        self._since_epoch = since_epoch
        self._is_relative: bool | None = None
        self._latest: dict[str, float] = {}
        self._count = self._not_later = 0

    def of(self, text: str | None, channel: str) -> float:
        if text is None:
            raise ValueError(f"it has no time: {_REMEDY}")
        if "-" in text and ":" in text:
            return self._since_epoch(datetime.fromisoformat(text))
        time_s = float(text)
        if self._is_relative is None:
            self._is_relative = _RELATIVE.fullmatch(text) is not None
        if self._is_relative:
            latest = self._latest.get(channel, -1.0)
            if time_s < latest / 2:
                raise self._differences(f"its time goes back from {latest:.6f} to {time_s:.6f} s")
            self._count += 1
            self._not_later += time_s <= latest
            self._latest[channel] = max(latest, time_s)
        return time_s

    def check(self) -> None:
        """Raise ValueError if too many frames are not later than the previous frame, as with times of -t d."""
        if self._not_later > 0.1 * self._count:  # some drivers repeat times
            raise self._differences(f"{self._not_later} of {self._count} frames are not later than the previous frame")

    def _differences(self, why: str) -> ValueError:
        return ValueError(f"{why}: the times count from the previous line, as `candump -t d` writes them; {_REMEDY}")


def _entry(text: str, clock: _Clock, *, is_whole: bool) -> Entry:
    if log := _LOG.fullmatch(text):
        time, channel, digits, body, direction = log.groups()
        if not is_whole and direction is None:
            raise entries.CutOffError("its last line has no line end, so it may be incomplete")
        is_xl = body.startswith("##")
    elif screen := _SCREEN.fullmatch(text):
        time, channel, direction, digits, length, code, rest = screen.groups()
        is_xl = length is not None and int(length) > FD_LENGTHS[-1]
    else:
        raise ValueError(f"{quoted(text, 60)} is not a line of candump")
    if is_xl:
        return LogEvent(entries.XL)
    time_s, is_rx = clock.of(time, channel), direction not in ("TX", "T", "t")
    if len(digits) > 8:
        raise ValueError(f"identifier {digits} must have at most 8 digits")
    ident = int(digits, 16), len(digits) > 3  # a 29-bit identifier has eight digits, another has three
    if ident[1] and ident[0] & _ERROR:
        return entries.error_frame(time_s, channel, ident[0] & ~_ERROR)
    if log:
        return _logged(time_s, channel, ident, body, is_rx=is_rx)
    # Braces contain a length code: {1}. Brackets contain the number of bytes: [8] in classic CAN, [08] in CAN FD.
    fd = FD_FRAME if code is None and len(length) > 1 else 0
    if length is None:
        count = entries.length_of(int(code, 16), is_fd=False)
    else:
        count = entries.check_length(int(length), is_fd=bool(fd))
    rest = rest or ""
    if rest.startswith("remote request"):
        return entries.frame(time_s, channel, ident, None, dlc=count, is_rx=is_rx)
    if "`" in rest:
        raise ValueError(f"its bytes are in reverse order (candump -S): {_REMEDY}")
    words = rest.split()
    data = entries.bytes_of(words, count)
    if words[count:] and not words[count].startswith("'"):
        raise ValueError(f"{count} bytes are announced, but {len(words)} are present")
    return entries.frame(time_s, channel, ident, data, fd=fd, is_rx=is_rx)


def _logged(time_s: float, channel: str, ident: entries.Ident, body: str, *, is_rx: bool) -> Entry:
    if remote := _REMOTE.fullmatch(body):
        return entries.frame(time_s, channel, ident, None, dlc=int(remote[1] or 0), is_rx=is_rx)
    fd = 0
    if flags := _FD.fullmatch(body):
        bits, body = int(flags[1], 16), flags[2]
        fd = FD_FRAME | BRS * (bits & 1) | ESI * (bits >> 1 & 1)
    if (bare := _DATA.fullmatch(body)) is None:
        raise ValueError(f"{quoted(body, 60)} is not the data of a frame")
    data = bytes.fromhex(bare[1].replace(".", ""))
    entries.check_length(len(data), is_fd=bool(fd))
    return entries.frame(time_s, channel, ident, data, fd=fd, is_rx=is_rx)


@contextmanager
def recording(path: Path) -> Iterator[Callable[[Frame], None]]:
    """Yield a function that appends a frame to the log; the file is created only if the `with` block ends without an
    error. Frames must come in the order of their timestamps: the writer stamps an earlier frame with the previous
    frame's time. Raises StillwakeError if the file cannot be written."""
    with replacing(path) as temporary, can.CanutilsLogWriter(temporary) as writer:
        yield lambda frame: writer.on_message_received(to_message(frame))
