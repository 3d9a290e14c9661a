"""Counts, rates and the load of logs that were made up."""

import can
import pytest

from can_bridge.tools.signals import decode
from can_bridge.tools.summary import summarise
from can_bridge.wire.message_specs import JET_COMMAND
from contract.config.vehicle import BusConfig
from tests.can_bridge.tools.test_traffic import frame


def test_load_of_a_known_frame():
    """Identifier 0x555 and data 0x55...: no five equal bits up to the CRC, so stuff bits can only lie there.

    111 bits without stuffing (ISO 11898-1: 44 + 64 and 3 of intermission) and at most 3 in the CRC and its
    neighbourhood, at 500 kbit/s every ms.
    """
    messages = [
        can.Message(timestamp=i / 1000, arbitration_id=0x555, is_extended_id=False, data=b"\x55" * 8)
        for i in range(1001)
    ]
    found = summarise(messages, decoder=decode, config=BusConfig())
    assert found.load is not None
    bits = found.load * 1.0 / 1001 * 500_000
    assert 111 - 1e-6 <= bits <= 114 + 1e-6


def test_a_frame_without_bit_rate_switch_takes_longer():
    loads = []
    for brs in (True, False):
        log = [
            can.Message(
                timestamp=t, arbitration_id=1, is_extended_id=False, is_fd=True, bitrate_switch=brs, data=bytes(64)
            )
            for t in (0.0, 1.0)
        ]
        found = summarise(log, decoder=decode, config=BusConfig())
        assert found.load is not None
        loads.append(found.load)
    # 64 bytes and their stuff bits at 500 kbit/s in place of 2 Mbit/s.
    assert 2.5 * loads[0] < loads[1] < 4.0 * loads[0]


def test_kinds_are_counted_apart():
    good = frame(JET_COMMAND, 0)
    log = [
        can.Message(timestamp=1.0, arbitration_id=0x130, is_extended_id=False, is_fd=True, data=good.data),
        can.Message(timestamp=1.5, is_error_frame=True),
        can.Message(timestamp=2.0, arbitration_id=5, is_remote_frame=True),
        can.Message(timestamp=2.5, arbitration_id=0x130, is_extended_id=False, is_fd=True, data=bytes(8)),
        can.Message(timestamp=3.0, arbitration_id=0x130, is_extended_id=False, is_fd=True, data=bytes(9)),
    ]
    seen = []
    found = summarise(log, decoder=decode, config=BusConfig(), seen=lambda one: seen.append(one.count))
    assert (found.frames, found.errors, found.remote, found.unsound, found.span_s) == (2, 1, 1, 1, 2.0)
    assert seen == [1, 2]
    (traffic,) = found.messages.values()
    assert traffic.verdicts == {"OK": 1, "CRC wrong": 1}
    (message,) = found.figures()["messages"]
    assert message["message"] == "JetCommand"
    assert message["rate_hz"] == pytest.approx(1 / 1.5)
    assert (message["lost"], message["checks"], message["mac_checked"]) == (0, {"OK": 1, "CRC wrong": 1}, None)
