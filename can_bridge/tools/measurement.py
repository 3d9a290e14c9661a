"""The measurements: the frames of a log together with their signals as named channels, in one file.

A `.mf4` file is for asammdf's window, CANape and vSignalyzer. An `.mcap` file is for Foxglove, Rerun and PlotJuggler.

A node on a real bus writes a text file while it runs, and converts this file to a measurement when it ends. A killed
process leaves the text file `.NAME.PID.log`, in candump's format, in that folder; no later process replaces it.
"""

import os
import re
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from itertools import chain, count
from pathlib import Path
from threading import Event, Thread
from typing import Any, Final

import can
import numpy as np

from can_bridge.bus.conversion import data_frame_of, to_message
from can_bridge.e2e.profiles import profile_of
from can_bridge.logs.entries import ChannelGroup, NamedChannel
from can_bridge.logs.log_reader import CanLog
from can_bridge.logs.mcap_file import write_mcap
from can_bridge.logs.mdf_file import asammdf_for, write_mdf
from can_bridge.tools.signals import SignalValue, decode
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode, Reason
from contract.atomic import check_writable, leads_to
from contract.errors import BusError, StillwakeError

MEASUREMENTS: Final = (".mf4", ".mcap")
_ENUMS: Final = {"Mode": Mode, "State": Mode, "Reason": Reason}
WORDS: Final = {name: {int(one): one.name for one in kind} for name, kind in _ENUMS.items()}
"""Names of the values of signals that are enumerations."""
_IN_THE_FRAME: Final = ("Freshness", "MAC")
"""Signals of 64 bits. They get no channel, because a channel's floating-point numbers have only 53 bits."""


def check_measurement(path: Path) -> None:
    """Check whether a measurement can be written to `path`. Raises BusError if the suffix is unknown, or asammdf is not
    installed; ModuleNotFoundError if a package for `.mcap` is missing; StillwakeError if `path` is not writable."""
    if path.suffix.lower() not in MEASUREMENTS:
        raise BusError(f"{path}: a measurement must end in {' or '.join(MEASUREMENTS)}")
    if path.suffix.lower() == ".mf4":
        asammdf_for(path)
    else:
        for name in ("mcap_protobuf", "foxglove_schemas_protobuf"):
            import_module(name)
    check_writable(path)


def write_measurement(
    path: Path,
    messages: Iterable[can.Message],
    *,
    more: Sequence[ChannelGroup] = (),
    events: Iterable[tuple[str, int, Any]] = (),
    facts: Mapping[str, str] | None = None,
) -> Counter[str]:
    """Write frames and channels, completely or not at all. Return the numbers of our frames without channels, by name.

    The messages may be in any order; they are written in the order of their times. `more` are groups of channels whose
    values are not from frames. Only an `.mcap` file gets `events` and `facts` (`can_bridge.logs.mcap_file.write_mcap`).
    Raises StillwakeError as `check_measurement` does, and for times before 0 in an `.mcap` file."""
    check_measurement(path)
    listed = sorted(messages, key=lambda one: one.timestamp)  # the times in a log of several buses may go back
    groups, skipped = groups_of(listed)
    if not listed and not more:
        raise BusError(f"{path}: there is no frame to write")
    if path.suffix.lower() == ".mf4":
        write_mdf(path, listed, [*groups, *more])
    else:
        write_mcap(path, listed, [*groups, *more], events=events, facts=facts or {})
    return skipped


def groups_of(messages: Iterable[can.Message]) -> tuple[list[ChannelGroup], Counter[str]]:
    """Return a group of channels for each of our messages, and the numbers of our frames that cannot be read, by name.
    If a log has our messages from several buses, the name of a group includes its bus, except for the first bus."""
    rows: dict[tuple[str, str], tuple[list[float], list[tuple[SignalValue, ...]]]] = {}
    skipped = Counter[str]()
    for message in messages:
        if (frame := data_frame_of(message)) is None or (decoded := decode(frame)) is None:
            continue
        spec = decoded.spec
        if not decoded.signals or not profile_of(spec).check(frame.data[: spec.protected], data_id=spec.data_id):
            skipped[f"{spec.name} with a wrong CRC, length or value"] += 1
            continue
        times, values = rows.setdefault((spec.name, str(message.channel or "")), ([], []))
        times.append(message.timestamp)
        values.append(decoded.signals)
    first = next(iter(rows), ("", ""))[1]
    groups = []
    for (name, channel), (times, values) in rows.items():
        channels = tuple(
            NamedChannel(one.name, one.unit, np.array([row[i].value for row in values], float), WORDS.get(one.name, {}))
            for i, one in enumerate(values[0])
            if one.name not in _IN_THE_FRAME
        )
        full = name if channel == first else re.sub(r"\W+", "_", f"{name}_{channel}", flags=re.ASCII)
        groups.append(ChannelGroup(name=full, times_s=np.array(times), channels=channels, comment=f"channel {channel}"))
    return groups, skipped


@contextmanager
def live_log(path: Path | None) -> Iterator[Callable[[Frame, bool], None]]:
    """Yield a function that stores a frame and whether it was received; it never waits, and any thread may call it. The
    measurement is written when the `with` block ends, even with an error. Without a path nothing is stored.

    Times are the computer's date and time at the start of the log, plus the time that its monotonic clock has measured
    since. Raises StillwakeError if the measurement cannot be written, unless the block has already raised an error.
    """
    if path is None:
        yield lambda frame, received: None
        return
    check_measurement(path)
    place = leads_to(path)
    place.parent.mkdir(parents=True, exist_ok=True)
    # The file name ends in a number, because processes in a container often have the same process number.
    endings = chain(("",), (f".{number}" for number in count(1)))
    names = (place.with_name(f".{path.name}.{os.getpid()}{ending}.log") for ending in endings)
    stream = next(name for name in names if not name.exists())
    log = _Log(stream)
    try:
        try:
            yield log.put
        except BaseException:
            log.close()
            with suppress(StillwakeError):
                write_measurement(path, CanLog(stream))
            raise
        log.close()
        if log.fault is not None:
            raise StillwakeError(f"{path}: the log is not complete: {log.fault.strerror or log.fault}")
        write_measurement(path, CanLog(stream))
    finally:
        with suppress(OSError):
            stream.unlink()


class _Log:
    """A thread that writes frames. `fault` is the error that ended the thread."""

    def __init__(self, stream: Path) -> None:
        self.fault: OSError | None = None
        self._frames = deque[tuple[int, Frame, bool]]()
        self._from_ns = time.time_ns() - time.monotonic_ns()
        self._ends = Event()
        self._writer = can.CanutilsLogWriter(stream)
        self._thread = Thread(target=self._write, name="can-log", daemon=True)
        self._thread.start()

    def put(self, frame: Frame, received: bool) -> None:
        if self.fault is None:
            self._frames.append((self._from_ns + time.monotonic_ns(), frame, received))

    def close(self) -> None:
        self._ends.set()
        self._thread.join()

    def _write(self) -> None:
        try:
            with self._writer:
                ends = False
                while not ends:
                    ends = self._ends.wait(0.05)  # short, so that no write delays a control step for long
                    batch = [self._frames.popleft() for _ in range(len(self._frames))]
                    for time_ns, frame, received in sorted(batch, key=lambda one: one[0]):
                        message = to_message(frame)
                        message.timestamp, message.is_rx = time_ns / 1e9, received
                        self._writer.on_message_received(message)
                    self._writer.file.flush()
        except OSError as error:
            self.fault = error
