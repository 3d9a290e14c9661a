"""Counts, rates and the load of logs that were made up."""

import can

from can_bridge.tools.summary import summarise
from contract.config.vehicle import BusConfig


def load(messages: list[can.Message]) -> float:
    summary = summarise(messages, config=BusConfig())
    assert summary.load is not None
    return summary.load


def test_load_of_a_known_frame():
    """Identifier 0x555 and data 0x55...: no five equal bits up to the CRC, so stuff bits can only lie there.

    111 bits without stuffing (ISO 11898-1: 44 + 64 and 3 of intermission) and at most 3 in the CRC and its
    neighbourhood, at 500 kbit/s every ms.
    """
    frames = [
        can.Message(timestamp=i / 1000, arbitration_id=0x555, is_extended_id=False, data=b"\x55" * 8)
        for i in range(1001)
    ]
    assert 111 - 1e-6 <= load(frames) / 1001 * 500_000 <= 114 + 1e-6


def test_a_frame_without_bit_rate_switch_takes_longer():
    fast, slow = (
        load([can.Message(timestamp=t, is_fd=True, bitrate_switch=brs, data=bytes(64)) for t in (0.0, 1.0)])
        for brs in (True, False)
    )
    # 64 bytes and their stuff bits at 500 kbit/s in place of 2 Mbit/s.
    assert 2.5 * fast < slow < 4.0 * fast


def test_a_log_that_runs_backwards_spans_from_its_earliest_to_its_latest_frame():
    frames = [can.Message(timestamp=t, data=bytes(8)) for t in (9.0, 1.0, 5.0)]
    summary = summarise(frames, config=BusConfig())
    assert (summary.first_s, summary.last_s, summary.span_s) == (1.0, 9.0, 8.0)
