"""A reader of recorded CAN traffic: candump, Vector ASC and BLF, PEAK TRC, ASAM MDF, MCAP, python-can's tables.

Every line or object is one of three things: a message, an event that is counted by its name, or an error, which ends
the reading and states the line's number. So the counts add up to the number of lines. The times are the file's own:
since the epoch, or in ASC since the beginning of the log.
"""

from collections import Counter
from collections.abc import Collection, Iterator
from datetime import UTC, datetime, tzinfo
from gzip import GzipFile
from pathlib import Path
from typing import Final

import can

from can_bridge.logs.asc_log import read_asc
from can_bridge.logs.blf_log import read_blf
from can_bridge.logs.candump_log import read_candump
from can_bridge.logs.entries import Binary, CutOffError, Entry, Lines, LogEvent
from can_bridge.logs.mcap_file import read_mcap
from can_bridge.logs.mdf_file import read_mdf
from can_bridge.logs.table_log import TABLE_COLUMNS, read_csv, read_db
from can_bridge.logs.trc_log import read_trc
from contract.errors import BusError

LOG_SUFFIXES: Final = (".log", ".asc", ".blf", ".trc", ".mf4", ".mcap", ".csv", ".db")
PACKED: Final = ".gz"
_UNPACKED: Final = (".mf4", ".mcap", ".db")
"""Endings of files that must not be compressed, because libraries read these files directly from the disk."""

GREATEST_TIME_S: Final = 2**63 / 1e9
"""Largest time in s before or after the epoch that 64 bits can represent in ns: 292 years."""


def suffix_of(path: Path) -> str:
    """Return the ending of the file's name that shows a log's format, such as ".asc", in lower case and without .gz."""
    return Path(path.name.lower().removesuffix(PACKED)).suffix


def stem_of(path: Path) -> str:
    """Return the file's name without the ending of the format and without .gz."""
    return Path(path.stem).stem if path.suffix.lower() == PACKED else path.stem


def is_log(path: Path) -> bool:
    """Return whether the file is a log, by its ending; a CSV must begin with the columns of python-can's logger."""
    suffix = suffix_of(path)
    if suffix != ".csv" or path.suffix.lower() == PACKED:
        return suffix in LOG_SUFFIXES
    try:
        with path.open("rb") as file:
            return file.read(len(TABLE_COLUMNS)) == TABLE_COLUMNS.encode()
    except OSError:
        return False


class CanLog:
    """A log that can be read once, from first to last message. Timestamps are in s; channels have the file's names.

    Attributes:
        events: numbers of lines or objects read so far that are not messages, by name.
        messages: number of messages read so far.
        channels: numbers of messages by channel; an empty name if the format has no channels.
        is_local: whether the times since the epoch are computed from a local start time in the file. Without `zone`,
            this start time counts as UTC.
    """

    def __init__(self, path: Path, *, zone: tzinfo | None = None, channels: Collection[str] = ()) -> None:
        """Open a log. Raises BusError for a file that does not exist or has no supported format. `zone` is the time
        zone of a local start time in the file. Only the named channels are read; by default, all."""
        suffix = suffix_of(path)
        if suffix not in LOG_SUFFIXES:
            raise BusError(
                f"{path}: a log must end in {', '.join(LOG_SUFFIXES)}, or in one of these and {PACKED}; "
                f"`python -m can.logconvert` converts other formats"
            )
        if path.suffix.lower() == PACKED and suffix in _UNPACKED:
            raise BusError(f"{path}: unpack it first (gunzip): a compressed {suffix} cannot be read")
        if not path.is_file():
            raise BusError(f"{path}: {'is a directory, not a log' if path.is_dir() else 'there is no such file'}")
        self.path = path
        self.events = Counter[str]()
        self.channels = Counter[str]()
        self.messages = 0
        self.is_local = False
        self._zone, self._only = zone, frozenset(channels)

    def __iter__(self) -> Iterator[can.Message]:
        """Yield the messages in order. Damage, or a line that is neither message nor event, raises BusError there."""
        try:
            for entry in self._entries():
                if isinstance(entry, LogEvent):
                    self.events[entry.name] += entry.lines
                    continue
                self.messages += 1
                channel = str(entry.channel)
                self.channels[channel] += 1
                if not abs(at := entry.timestamp) <= GREATEST_TIME_S:
                    raise ValueError(f"frame {self.messages} is at {at} s: must be within {GREATEST_TIME_S:g} s")
                if not self._only or channel in self._only:
                    yield entry
        except BusError:
            raise
        except CutOffError as error:
            raise BusError(f"{self.path}: is cut off: {error}") from error
        except Exception as error:
            raise BusError(f"{self.path}: cannot be read as a CAN log ({error or type(error).__name__})") from error
        if self._only and not self._only & set(self.channels):
            names = ", ".join(name or "a channel without a name" for name in sorted(self.channels)) or "none"
            raise BusError(f"{self.path}: --channel {', '.join(sorted(self._only))}: no such channel, only {names}")

    def _entries(self) -> Iterator[Entry]:
        suffix = suffix_of(self.path)
        if suffix == ".mf4":
            yield from read_mdf(self.path, self._since_epoch)
            return
        if suffix in _UNPACKED:
            yield from (read_mcap if suffix == ".mcap" else read_db)(self.path)
            return
        file: Binary = GzipFile(self.path) if self.path.suffix.lower() == PACKED else self.path.open("rb")
        with file:
            if suffix == ".blf":
                yield from read_blf(file, self._since_epoch)
                return
            lines = Lines(file)
            try:
                if suffix in (".asc", ".csv"):
                    yield from (read_asc if suffix == ".asc" else read_csv)(lines)
                else:
                    yield from (read_trc if suffix == ".trc" else read_candump)(lines, self._since_epoch)
            except (ValueError, OverflowError) as error:
                raise ValueError(f"line {lines.number}: {error}" if lines.number else str(error)) from None

    def _since_epoch(self, start: datetime) -> float:
        self.is_local = True
        return start.replace(tzinfo=self._zone or UTC).timestamp()
