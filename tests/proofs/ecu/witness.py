"""What an ECU's counters must be, counted from the frames alone, by other libraries.

cantools reads the messages by the DBC, autosar-e2e checks their CRCs. With every EcuStatus that the ECU sends, each
counter is compared; where the signal's range ends, the count stays.

    CrcErrors       pressure frames with a wrong CRC
    Refused         those with a right one whose counter repeats the one before or jumps by more than max_delta
    Missed          steps whose JetCommand names no new pressure frame
    Overruns        periods in which the ECU took no step
"""

from collections import Counter
from typing import Any, Final

from can_bridge.bus.faults.injector import Injector
from can_bridge.bus.interface import Bus
from can_bridge.wire.frame import Frame
from tests.proofs.ecu import wire_witness as wire

COUNTERS: Final = {"crc_errors": "CrcErrors", "refused": "Refused", "missed": "Missed", "overruns": "Overruns"}
"""Signals of the counters, by the name of their figure."""


class Passed(Injector):
    """A port that counts what passes through it.

    Attributes:
        sent, received: frames by identifier; those that the bus did not take are not sent.
    """

    def __init__(self, bus: Bus) -> None:
        super().__init__(bus)
        self.sent: Counter[int] = Counter()
        self.received: Counter[int] = Counter()

    def send(self, frame: Frame) -> None:
        """See `Bus.send`."""
        super().send(frame)
        self.sent[frame.frame_id] += 1

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`."""
        frames = super().receive_all()
        self.received.update(frame.frame_id for frame in frames)
        return frames


class Witness(Injector):
    """The ECU's own port: sees what the ECU gets and sends.

    Args:
        bus: the port, its faults included.
        now_ns: the bus's time.
        max_delta: largest step of the pressures' counter.

    Attributes:
        counted: what each counter should be.
        statuses: EcuStatus frames compared.
        mismatches: counters that differed, over all of them.
        first_mismatch: the first one, in words; empty without.
        skipped: control periods without a step; whoever runs the loop counts them here.
        latest: the newest EcuStatus, by signal.
    """

    def __init__(self, bus: Bus, now_ns: Any, *, max_delta: int) -> None:
        super().__init__(bus)
        self._pressure, self._command, self._status = map(wire.message, (wire.PRESSURE, wire.COMMAND, wire.STATUS))
        self._limits = {name: int(self._status.get_signal_by_name(name).maximum or 0) for name in COUNTERS.values()}
        self._now_ns, self._max_delta = now_ns, max_delta
        self._waiting: list[tuple[int, Frame]] = []
        self._last: int | None = None
        self._echo: tuple[Any, Any] = (0, None)
        self.counted: Counter[str] = Counter()
        self.statuses = self.mismatches = self.skipped = 0
        self.first_mismatch = ""
        self.latest: dict[str, Any] = {}

    def receive_all(self) -> list[Frame]:
        """See `Bus.receive_all`."""
        frames = super().receive_all()
        self._waiting += ((self._now_ns(), frame) for frame in frames if frame.frame_id == self._pressure.frame_id)
        return frames

    def send(self, frame: Frame) -> None:
        """See `Bus.send`; a frame that the bus does not take counts as sent."""
        if frame.frame_id == self._command.frame_id:
            self._count_missed(frame)
        if frame.frame_id == self._status.frame_id:
            self._compare(frame)
        super().send(frame)

    def _count_missed(self, frame: Frame) -> None:
        command: Any = self._command.decode(frame.data, decode_choices=False)
        echo = command["PressureCounterValid"], command["PressureCounter"]
        # A frame that is used has another counter than the one used before it, or there was none.
        self.counted["Missed"] += not echo[0] or echo == self._echo
        self._echo = echo

    def _compare(self, frame: Frame) -> None:
        # The frame carries the time of the step: what was received later is for the next one.
        for at_ns, pressure in self._waiting:
            if at_ns <= frame.timestamp_ns:
                self._count_pressure(pressure)
        self._waiting = [item for item in self._waiting if item[0] > frame.timestamp_ns]
        self.counted["Overruns"] = self.skipped
        status: Any = self._status.decode(frame.data, decode_choices=False)
        self.latest = dict(status)
        self.statuses += 1
        for name, limit in self._limits.items():
            expected = min(self.counted[name], limit)
            if status[name] != expected:
                self.mismatches += 1
                place = f"EcuStatus {self.statuses}, {frame.timestamp_ns / 1e9:.3f} s"
                self.first_mismatch = self.first_mismatch or f"{place}: {name} is {status[name]}, must be {expected}"

    def _count_pressure(self, frame: Frame) -> None:
        if not wire.is_sound(frame.data, wire.PRESSURE):
            self.counted["CrcErrors"] += 1
            return
        counter = frame.data[2]  # behind the two bytes of CRC
        delta = 1 if self._last is None else (counter - self._last) % 256
        self.counted["Refused"] += not 1 <= delta <= self._max_delta
        self._last = counter
