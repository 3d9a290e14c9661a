"""Logs of can-utils: what `candump -L` writes to a file, and what plain candump shows on a screen.

    (1436509052.249713) can0 123##1112233           with -L or -l
     (1436509052.249713)  can0  123  [03]  11 22 33  without

A screen's times are absolute (-t a, -t A in words), count from the first frame (-t z), or from the line before (-t d),
which no line tells apart by itself: times that go back are of -t d.
"""

import re
from collections.abc import Iterator
from datetime import datetime
from typing import Final

from can_bridge.logs.entries import (
    COMMENT,
    XL,
    CutOffError,
    Entry,
    Event,
    Lines,
    SinceEpoch,
    bytes_of,
    data_frame,
    error_frame,
    length_of,
    remote_frame,
)
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS
from contract.printable import quoted

_ERROR: Final = 0x20000000
"""Bit 29: an error frame, whose classes are the lower bits (linux/can.h)."""
_LOG: Final = re.compile(r"\(([^)]*)\)\s+(\S+)\s+([0-9A-Fa-f]+)#(\S*)(?:\s+([RTrt]))?")
_SCREEN: Final = re.compile(
    r"(?:\(([^)]*)\)\s+)?(\S+)\s+(?:(RX|TX) [B-] [E-]\s+)?([0-9A-Fa-f]+)\s+(?:\[(\d+)\]|\{([0-9A-Fa-f]+)\})(?:\s+(.*))?"
)
_COLOUR: Final = re.compile(r"\x1b\[[0-9;]*m")
_CLASSIC: Final = re.compile(r"((?:[0-9A-Fa-f]{2}\.?)*)(?:_([9A-Fa-f]))?")
_FD: Final = re.compile(r"#([0-9A-Fa-f])((?:[0-9A-Fa-f]{2}\.?)*)")
_REMOTE: Final = re.compile(r"[Rr]([0-9])?(?:_[9A-Fa-f])?")
_RELATIVE: Final = re.compile(r"\d{3}\.\d{6}")
"""candump pads the seconds of -t z and -t d to three digits, and those since the epoch to ten."""
_REMEDY: Final = "record with `candump -L`"
_LATE: Final = 0.1
"""Share of the frames of a channel that a driver may stamp with the time of the one before."""


def read_candump(lines: Lines, since_epoch: SinceEpoch) -> Iterator[Entry]:
    """What the lines hold. Raises ValueError, by the number of a line that is none of candump's."""
    clock = _Clock(since_epoch)
    after_error = False
    for number, line in lines:
        text = _COLOUR.sub("", line).strip()
        try:
            if text.startswith(("#", "//", ";")):
                yield Event(COMMENT)
            elif after_error and line.startswith(("\t", " ")) and not _SCREEN.fullmatch(text):
                # `candump -e` explains an error frame in the lines below it.
                yield Event("description of an error frame")
            else:
                entry = _entry(text, clock, is_whole=line.endswith("\n"))
                yield entry
                after_error = not isinstance(entry, Event) and entry.is_error_frame
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from None
    clock.check()


class _Clock:
    """Seconds of the text in the parentheses."""

    def __init__(self, since_epoch: SinceEpoch) -> None:
        self._since_epoch = since_epoch
        self._is_relative: bool | None = None
        self._latest: dict[str, float] = {}
        self._count = self._not_later = 0

    def of(self, text: str | None, channel: str) -> float:
        if text is None:
            raise ValueError(f"has no time: {_REMEDY}")
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
        """Raise ValueError where frames do not follow each other in time, as differences that are all alike do not."""
        if self._not_later > _LATE * self._count:
            raise self._differences(f"{self._not_later} of {self._count} frames are not later than the one before")

    def _differences(self, why: str) -> ValueError:
        return ValueError(f"{why}: the times count from the line before, as of `candump -t d`; {_REMEDY}")


def _entry(text: str, clock: _Clock, *, is_whole: bool) -> Entry:
    if (log := _LOG.fullmatch(text)) is not None:
        time, channel, frame_id, body, direction = log.groups()
        if not is_whole and direction is None:
            raise CutOffError("its last line has no end, and may be the part of one")
        if body.startswith("##"):
            return Event(XL)
        return _logged(clock.of(time, channel), channel, frame_id, body, is_rx=direction not in ("T", "t"))
    if (screen := _SCREEN.fullmatch(text)) is not None:
        time, channel, direction, frame_id, length, code, rest = screen.groups()
        if length is not None and int(length) > FD_LENGTHS[-1]:
            return Event(XL)
        time_s, number, is_extended = clock.of(time, channel), *_identifier(frame_id)
        if number & _ERROR and is_extended:
            return error_frame(time_s, channel, number & ~_ERROR)
        is_rx, rest = direction != "TX", rest or ""
        # {} has the length code, [8] the bytes of classic CAN, [08] those of CAN FD.
        is_fd = code is None and len(length) > 1
        count = length_of(int(code, 16), is_fd=False) if length is None else int(length)
        if rest.startswith("remote request"):
            return remote_frame(time_s, channel, number, count, is_extended=is_extended, is_rx=is_rx)
        _check_length(count, is_fd=is_fd)
        words = rest.split()
        if "`" in rest:
            raise ValueError(f"its bytes are in reverse order (candump -S): {_REMEDY}")
        data = bytes_of(words, count)
        if words[count:] and not words[count].startswith("'"):
            raise ValueError(f"{count} bytes announced, {len(words)} there")
        return data_frame(time_s, channel, number, data, is_extended=is_extended, is_fd=is_fd, is_rx=is_rx)
    raise ValueError(f"{quoted(text, 60)} is no line of candump")


def _logged(time_s: float, channel: str, frame_id: str, body: str, *, is_rx: bool) -> Entry:
    number, is_extended = _identifier(frame_id)
    if number & _ERROR and is_extended:
        return error_frame(time_s, channel, number & ~_ERROR)
    if remote := _REMOTE.fullmatch(body):
        return remote_frame(time_s, channel, number, int(remote[1] or 0), is_extended=is_extended, is_rx=is_rx)
    if fd := _FD.fullmatch(body):
        flags, data = int(fd[1], 16), bytes.fromhex(fd[2].replace(".", ""))
        _check_length(len(data), is_fd=True)
        brs, esi = bool(flags & 1), bool(flags & 2)
        return data_frame(
            time_s, channel, number, data, is_extended=is_extended, is_fd=True, is_rx=is_rx, brs=brs, esi=esi
        )
    if classic := _CLASSIC.fullmatch(body):
        data = bytes.fromhex(classic[1].replace(".", ""))
        _check_length(len(data), is_fd=False)
        return data_frame(time_s, channel, number, data, is_extended=is_extended, is_rx=is_rx)
    raise ValueError(f"{quoted(body, 60)} is no data of a frame")


def _identifier(text: str) -> tuple[int, bool]:
    """The number, and whether it is extended: candump writes three digits, or eight."""
    if len(text) > 8:
        raise ValueError(f"identifier {text}, must have at most 8 digits")
    return int(text, 16), len(text) > 3


def _check_length(length: int, *, is_fd: bool) -> None:
    if length not in (FD_LENGTHS if is_fd else CLASSIC_LENGTHS):
        raise ValueError(f"{length} bytes are no length of {'CAN FD' if is_fd else 'classic CAN'}")
