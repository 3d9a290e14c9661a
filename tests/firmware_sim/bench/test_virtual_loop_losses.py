"""The loop in virtual time where frames are lost, damaged, or not ours."""

import random
from dataclasses import asdict, replace
from math import isnan

import pytest

from can_bridge.bus.interface import Bus
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE


class Faulty:
    """A seeded bus that drops some of the frames sent through it and flips a bit in others."""

    def __init__(self, bus: Bus, *, drop: float = 0.0, corrupt: float = 0.0, seed: int = 3) -> None:
        self._bus, self._drop, self._corrupt = bus, drop, corrupt
        self._random = random.Random(seed)
        self.dropped: list[Frame] = []
        self.corrupted: list[Frame] = []

    def send(self, frame: Frame) -> None:
        draw = self._random.random()
        if draw < self._drop:
            self.dropped.append(frame)
            return
        if draw < self._drop + self._corrupt:
            self.corrupted.append(frame)
            data = bytearray(frame.data)
            data[self._random.randrange(len(data))] ^= 1 << self._random.randrange(8)
            frame = replace(frame, data=bytes(data))
        self._bus.send(frame)

    def receive_all(self) -> list[Frame]:
        return self._bus.receive_all()


@pytest.fixture
def faults() -> list[Faulty]:
    return []


def only(frames: list[Frame], spec) -> int:
    return sum(frame.frame_id == spec.frame_id for frame in frames)


def test_frames_dropped_on_either_side_are_lost(harness, faults):
    def dropping(bus: Bus) -> Faulty:
        faults.append(Faulty(bus, drop=0.15, seed=len(faults)))
        return faults[-1]

    h = harness(8.0, vehicle=dropping, ecu=dropping)
    rows = h.run(60)
    vehicle, ecu = faults
    lost = only(vehicle.dropped, PRESSURE) + only(ecu.dropped, JET_COMMAND)
    assert only(vehicle.dropped, PRESSURE) > 3
    assert only(ecu.dropped, JET_COMMAND) > 3
    assert asdict(h.loop.totals()) == {"sent": 120, "lost": lost, "rejected": 0}
    # A period whose command was dropped has no age, and the jets hold.
    assert sum(isnan(row.age_ms) for row in rows) >= only(ecu.dropped, JET_COMMAND)


def test_corrupted_frames_are_rejected_on_the_side_that_receives_them(harness, faults):
    def corrupting(bus: Bus) -> Faulty:
        faults.append(Faulty(bus, corrupt=0.15, seed=len(faults)))
        return faults[-1]

    h = harness(8.0, vehicle=corrupting, ecu=corrupting)
    h.run(60)
    vehicle, ecu = faults
    pressures, commands = only(vehicle.corrupted, PRESSURE), only(ecu.corrupted, JET_COMMAND)
    assert min(pressures, commands) > 3
    totals = h.loop.totals()
    assert (totals.sent, totals.lost, totals.rejected) == (120, 0, pressures + commands)
    assert h.ecu.status().crc_errors == pressures


def test_frames_that_come_while_the_ecu_is_busy_are_checked_too(harness, faults):
    def corrupting(bus: Bus) -> Faulty:
        faults.append(Faulty(bus, corrupt=0.2))
        return faults[-1]

    h = harness(25.0, vehicle=corrupting)
    h.run(61)  # it steps in every other period, the last included
    assert h.ecu.status().crc_errors == len(faults[0].corrupted) > 8
