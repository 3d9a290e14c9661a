"""The ASC files of Vector: "CAN, Log & Trigger ASC Logging Format", 1.4. Times are in s after the start or a trigger.

    0.000144 1  120  Rx  d 8 00 01 02 03 04 05 06 07                        classic CAN
    0.000144 CANFD   1 Rx   120  Pressure  1 0 a 16 00 01 ..  <eight numbers>   on a channel of CAN FD

A name may replace an identifier. The third of the eight numbers has flags: bit 12 for a CAN FD frame, bit 4 for a
remote frame. A channel of CAN FD can also have classic frames.
"""

import re
from collections.abc import Iterator
from typing import Final

from can_bridge.logs import entries
from can_bridge.logs.entries import BRS, ESI, FD_FRAME, Entry, LogEvent
from can_bridge.wire.frame import MAX_FRAME_ID
from contract.printable import quoted

_DIGITS: Final = {16: re.compile("[0-9A-Fa-f]+"), 10: re.compile("[0-9]+")}
_TIME: Final = re.compile(r"[+-]?\d+(?:\.\d+)?")
_BASE: Final = re.compile(r"\bbase\s+(hex|dec)\b", re.IGNORECASE)
_TIMESTAMPS: Final = re.compile(r"\btimestamps\s+(absolute|relative)\b", re.IGNORECASE)
_BEGIN: Final = re.compile(r"begin\s+triggerblock\b(.*)", re.IGNORECASE)
_END: Final = re.compile(r"end\s+triggerblock\b", re.IGNORECASE)
_DATE: Final = re.compile(r"(\d{1,2})\s+(\d{1,2}):(\d\d):(\d\d(?:\.\d+)?)(?:\s+([ap])m)?\s+(\d{4})", re.IGNORECASE)
"""Day, time and year of "Fri Nov 27 10:00:00.000 2026"; the names of weekday and month may be in any language."""
_NUMBER_OF_NAME: Final = re.compile(r"\bID\s*=\s*(\d+)(x?)", re.IGNORECASE)
"""Pattern of the decimal identifier that files of version 8 or later have after a classic frame."""
_DIRECTIONS: Final = ("rx", "tx", "txrq")
_FD_FLAG, _REMOTE_FLAG = 0x1000, 0x10
_EVENTS: Final = {
    "start": "start of measurement",
    "log": "trigger",
    "sv": "system variable",
    "comment": entries.COMMENT,
    "//": entries.COMMENT,
    "tfs": "test step",
    "gps": "GPS",
    "can": "status",
    "canxl": entries.XL,
    "statistic": "statistics",
    "overloadframe": "overload frame",
    "j1939tp": "J1939 transport",
}
"""Names of the events, by the first word after the time or the channel."""


def read_asc(lines: entries.Lines) -> Iterator[Entry]:
    """Yield the lines' entries. Raises ValueError for a line that is neither frame, event nor header."""
    base, in_block, has_times = 16, False, False
    clock = _Clock()
    for line in lines:
        text = line.strip()
        words = text.split()
        if text.startswith(("//", ";")):
            yield LogEvent(entries.COMMENT)
            continue
        if _TIME.fullmatch(words[0]) and len(words) > 1:
            if not line.endswith("\n") and in_block:
                break
            has_times = True
            entry = _entry(clock.of(float(words[0])), words, text, base)
            if not isinstance(entry, LogEvent):
                clock.place(entry.timestamp)
                entry.timestamp += clock.offset_s
            yield entry
            continue
        if begin := _BEGIN.match(text):
            clock.begin(begin[1])
            in_block = True
        elif _END.match(text):
            in_block = False
        elif (found := _BASE.search(text)) or _TIMESTAMPS.search(text):
            base = base if found is None else 10 if found[1].lower() == "dec" else 16
            if timestamps := _TIMESTAMPS.search(text):
                clock.is_relative = timestamps[1].lower() == "relative"
        elif has_times and "internal events logged" not in text.lower() and words[0].lower() != "date":
            raise ValueError(f"{quoted(text, 60)} is neither frame nor event")
        elif text[0] in "0123456789+-(":  # only a line of data can begin so
            raise ValueError(f"{quoted(text, 60)} has no time in seconds with a decimal point")
        yield LogEvent(entries.HEADER_LINE)
    if in_block:
        raise entries.CutOffError("it has no End TriggerBlock")


class _Clock:
    """A clock that converts the times of a file's lines to s since the start of the first trigger block, by adding
    `offset_s`. In the file, times may count from the previous line (`is_relative`), or restart with each block."""

    def __init__(self) -> None:
        self.offset_s, self.is_relative = 0.0, False
        self._sum_s = self._latest = 0.0
        self._has_frames = False
        self._first_date: str | None = None
        self._date = ""
        self._is_new = False

    def begin(self, date: str) -> None:
        if self._first_date is None:
            self._first_date = date
        self._date, self._is_new = date, self._has_frames
        if self.is_relative and self._is_new and (since := _between(self._first_date, date)) is not None:
            self._sum_s = max(self._sum_s, since)

    def of(self, time_s: float) -> float:
        self._sum_s += time_s
        return self._sum_s if self.is_relative else time_s

    def place(self, time_s: float) -> None:
        """Record a frame's time. If a block's first frame is earlier than a previous frame, the times restart in this
        block, and `offset_s` becomes the time from the first block's date to this block's date. In this case, raises
        ValueError if a date is unreadable, or if the frame is earlier even with this offset."""
        if self._is_new and not self.is_relative and time_s + self.offset_s < self._latest:
            since = _between(self._first_date or "", self._date)
            if since is None or time_s + since < self._latest:
                raise ValueError(
                    f"its time goes back from {self._latest:.6f} to {time_s:.6f} s at a trigger block, but the block's "
                    f"date {quoted(self._date.strip(), 60)} does not explain this"
                )
            self.offset_s = since
        self._is_new, self._has_frames = False, True
        self._latest = max(self._latest, time_s + self.offset_s)


def _between(first: str, second: str) -> float | None:
    """Return the time in s between two dates less than a month apart; None if the dates do not show it."""
    months, days, seconds = [], [], []
    for text in (first, second):
        if (date := _DATE.search(text)) is None:
            return None
        hour = int(date[2]) % 12 + 12 * (date[5].lower() == "p") if date[5] else int(date[2])
        months.append(text[: date.start()].split()[-1:])
        days.append(int(date[1]))
        seconds.append(3600.0 * hour + 60.0 * int(date[3]) + float(date[4]))
    if months[0] == months[1]:
        return (days[1] - days[0]) * 86_400.0 + seconds[1] - seconds[0]
    # The names of months depend on the language, so blocks of two months are assumed to be one day apart.
    return 86_400.0 + seconds[1] - seconds[0] if days[1] < days[0] else None


def _entry(time_s: float, words: list[str], text: str, base: int) -> Entry:
    kind = words[1].lower()
    if kind == "canfd":
        return _on_fd_channel(time_s, words, base)
    if not kind.isdigit():
        return _event(words[1], text)
    if len(words) < 3:
        raise ValueError(f"{quoted(text, 60)} is neither frame nor event")
    word = words[2].lower()
    if word.startswith("errorframe"):
        return entries.error_frame(time_s, words[1])
    if word.split(":")[0] in _EVENTS:
        return _event(words[2], text)
    direction = words[3].lower() if len(words) > 3 else ""
    if direction not in _DIRECTIONS:
        if _identifier(words[2], base) is not None:
            raise ValueError(f"{quoted(text, 60)} has neither Rx nor Tx after the identifier")
        return _event(words[2], text)
    if direction == "txrq":
        return LogEvent(entries.REQUEST)
    if len(words) < 5:
        raise ValueError(f"{quoted(text, 60)} ends before the frame's length")
    found = _identifier(words[2], base)
    if found is None and (numbered := _NUMBER_OF_NAME.search(text)):
        found = int(numbered[1]), bool(numbered[2])
    if found is None:
        return LogEvent(entries.NOT_OURS)
    is_rx = direction == "rx"
    match words[4].lower():
        case "r":
            code = words[5] if len(words) > 5 and not words[5].lower().startswith("length") else "0"
            return entries.frame(time_s, words[1], found, None, dlc=int(code, base), is_rx=is_rx)
        case "d" if len(words) > 5:
            data = entries.bytes_of(words[6:], entries.length_of(int(words[5], base), is_fd=False), base)
            return entries.frame(time_s, words[1], found, data, is_rx=is_rx)
    raise ValueError(f"{quoted(text, 60)} is neither a data frame (d) nor a remote frame (r) with a length")


def _on_fd_channel(time_s: float, words: list[str], base: int) -> Entry:
    if len(words) < 5 or words[3].lower() not in _DIRECTIONS:
        raise ValueError(f"{quoted(' '.join(words), 60)} has neither Rx nor Tx after the channel")
    channel, direction = words[2], words[3].lower()
    if words[4].lower() == "errorframe":
        return entries.error_frame(time_s, channel)
    if direction == "txrq":
        return LogEvent(entries.REQUEST)
    # The message's name may follow the identifier, but is often missing.
    rest = words[5:] if words[5:6] and words[5] in ("0", "1") else words[6:]
    if len(rest) < 4:
        raise ValueError(f"{quoted(' '.join(words), 60)} ends before the frame's length")
    found = _identifier(words[4], base)
    if found is None:
        return LogEvent(entries.NOT_OURS)
    code, length, is_rx = int(rest[2], base), int(rest[3]), direction == "rx"
    trailing = rest[4 + length :]
    flags = int(trailing[2], 16) if len(trailing) >= 6 else 0  # files of version 8 have two more numbers
    fd = BRS * (rest[0] == "1") | ESI * (rest[1] == "1")
    # Some writers leave the flags 0, so the bit rate, the length and the length code also identify a CAN FD frame.
    if flags & _FD_FLAG or fd & BRS or length > 8 or not (flags or (length == 8 and code > 8)):
        fd |= FD_FRAME
    elif flags & _REMOTE_FLAG:
        return entries.frame(time_s, channel, found, None, dlc=entries.length_of(code, is_fd=False), is_rx=is_rx)
    if length != entries.length_of(code, is_fd=bool(fd & FD_FRAME)):
        raise ValueError(f"length code {code} does not mean {length} bytes")
    data = entries.bytes_of(rest[4:], length, base)
    return entries.frame(time_s, channel, found, data, fd=fd if fd & FD_FRAME else 0, is_rx=is_rx)


def _event(word: str, text: str) -> LogEvent:
    """Return the event that a line describes. The first word is the kind of event, except in lines of variables and
    signals. Such lines begin with a name, and are recognised by characters that no other lines have."""
    if "GMGroup:" in text:
        return LogEvent("marker")
    if ":=" in text:
        return LogEvent("environment variable")
    if "::" in text and "=" in text and "SV:" not in text:
        return LogEvent("signal")
    if not word[:1].isascii() or not (word[0].isalpha() or word[0] == "/"):
        raise ValueError(f"{quoted(text, 60)} is neither frame nor event")
    name = word.lower().rstrip(":").split(":")[0]
    return LogEvent(_EVENTS.get("//" if name.startswith("//") else name, word.rstrip(":")))


def _identifier(word: str, base: int) -> entries.Ident | None:
    """Return the identifier's number, and whether it has 29 bits; None for the name of a message that is not ours."""
    name = word.rpartition("::")[2]
    if name in entries.IDS:
        return entries.IDS[name], False
    is_extended = word[-1:] in ("x", "X")
    digits = word[:-1] if is_extended else word
    if not _DIGITS[base].fullmatch(digits):
        return None
    number = int(digits, base)
    # A word of hexadecimal digits that begins with a letter and is too large for 11 bits is a name.
    return (number, is_extended) if is_extended or number <= MAX_FRAME_ID or word[0].isdigit() else None
