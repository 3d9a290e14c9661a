"""The loop in virtual time where frames are lost, damaged, or not ours."""

from dataclasses import asdict
from math import isnan

import pytest

from can_bridge.bus.faults.content import FlipBits
from can_bridge.bus.faults.loss import Drop
from can_bridge.bus.faults.wrapping import FaultyBus, wrap
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE


@pytest.fixture
def faulty(harness):
    """A loop with a fault in the pressures that the vehicle sends and in the ECU's commands; and both ports."""

    def made(fault, compute_ms: float = 8.0, **settings):
        ports = list[FaultyBus]()

        def port(spec, seed: int):
            def wrapped(bus):
                ports.append(wrap(bus, [fault(**settings, frame_ids=(spec.frame_id,))], lambda: 0, seed=seed))
                return ports[-1]

            return wrapped

        return harness(compute_ms, vehicle=port(PRESSURE, 1), ecu=port(JET_COMMAND, 2)), ports

    return made


def acted(ports: list[FaultyBus]) -> list[int]:
    return [port.injectors[0].acted for port in ports]


def test_frames_dropped_on_either_side_are_lost(faulty):
    h, ports = faulty(Drop, probability=0.15)
    rows = h.run(60)
    pressures, commands = acted(ports)
    assert min(pressures, commands) > 3
    assert asdict(h.loop.totals()) == {"sent": 120, "lost": pressures + commands, "rejected": 0}
    # A period whose command was dropped has no age, and the jets hold.
    assert sum(isnan(row.age_ms) for row in rows) >= commands


def test_corrupted_frames_are_rejected_on_the_side_that_receives_them(faulty):
    h, ports = faulty(FlipBits, probability=0.15)
    h.run(60)
    pressures, commands = acted(ports)
    assert min(pressures, commands) > 3
    assert asdict(h.loop.totals()) == {"sent": 120, "lost": 0, "rejected": pressures + commands}
    assert h.ecu.status().crc_errors == pressures


def test_frames_that_come_while_the_ecu_is_busy_are_checked_too(faulty):
    h, ports = faulty(FlipBits, compute_ms=25.0, probability=0.2)
    h.run(61)  # it steps in every other period, the last included
    assert h.ecu.status().crc_errors == acted(ports)[0] > 8
