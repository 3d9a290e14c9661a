"""The loop in virtual time on a bus that others use too, or whose controllers see errors."""

from contextlib import suppress
from dataclasses import asdict

import pytest

from can_bridge.bus.simulated.background_node import BackgroundNode
from can_bridge.timing.background import background
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import PRESSURE
from can_bridge.wire.messages import Mode
from contract.config.vehicle import BackgroundConfig, BusConfig
from contract.errors import BusError
from tests.firmware_sim.bench.harness import FRAME_IDS, WARM


def disturbed(harness, until_ns: int, frame_id: int = 0x001, period_ns: int = 100_000, **settings):
    """A loop whose bus another node keeps busy with frames of 64 bytes from 200 ms on."""
    h = harness(8.0, **settings)
    port = h.bus.port("other", transmit_capacity=1000)

    def send() -> None:
        with suppress(BusError):  # the queue is full
            port.send(Frame(frame_id=frame_id, data=bytes(64)))

    for at_ns in range(200_000_000, until_ns, period_ns):
        h.bus.call_at(at_ns, send)
    return h


def test_pressures_that_wait_for_the_bus_make_the_step_late_and_no_miss(harness):
    """Frames of higher priority, twelve of 390 us, handed over at once when the period begins."""
    h = harness(8.0)
    port = h.bus.port("other")
    data = b"\x55" * 64

    def crowd() -> None:
        for _ in range(12):
            port.send(Frame(frame_id=0x001, data=data))

    h.bus.call_at(10 * h.config.period_ns, crowd)
    rows = h.run(13)
    wait_ns = 12 * h.bus.frame_ns(Frame(frame_id=0x001, data=data))
    assert wait_ns < h.config.period_ns // 2
    assert h.ends(PRESSURE)[10] == 10 * h.config.period_ns + wait_ns + h.taken(PRESSURE)[10]
    assert h.ecu.status().missed == 1  # the first frame
    assert {row.mode for row in rows[WARM:]} == {Mode.CONTROL}
    assert rows[10].age_ms - rows[9].age_ms == pytest.approx(wait_ns / 1e6, abs=0.03)  # contents differ in stuff bits
    assert h.starts()[10] > h.starts()[9]
    assert h.loop.totals().lost == 0


def test_frames_of_lower_priority_delay_by_one_of_them_at_most(harness):
    h = disturbed(harness, until_ns=400_000_000, frame_id=0x7FF)
    rows = h.run(20)
    longest = h.bus.frame_ns(Frame(frame_id=0x7FF, data=bytes(64)))
    assert {row.mode for row in rows[WARM:]} == {Mode.CONTROL}
    for k in range(10, 20):
        assert h.ends(PRESSURE)[k] <= k * h.config.period_ns + longest + h.taken(PRESSURE)[k]
    assert max(h.ends(PRESSURE)[k] - k * h.config.period_ns - h.taken(PRESSURE)[k] for k in range(11, 20)) > 0


def test_an_ecu_that_is_bus_off_is_missed_by_the_vehicle_and_comes_back(harness):
    positions = iter([20] * 32)

    def corrupts(frame: Frame, name: str, begin_ns: int) -> int | None:
        """32 errors in a row on its command of one period, all within that period."""
        return next(positions, None) if name == "ecu" and begin_ns > 200_000_000 else None

    h = harness(8.0, corrupts=corrupts)
    rows = h.run(24)
    health = h.ports["ecu"].health()
    assert health.bus_off == 1
    assert h.ecu.status().bus_off == 1
    # The command of period 10 and its status went with the queue; the next ones come.
    assert h.loop.totals().lost == 1
    assert h.targets()[10] == h.targets()[9]
    assert rows[-1].age_ms < 10.0


def test_two_runs_with_background_are_equal_to_the_bit(harness):
    bus = BusConfig(background=BackgroundConfig(load=0.5, seed=3))
    kept = []
    for seed in (3, 3, 4):
        h = harness(8.0, bus=bus)
        others = background(bus.background, bus, FRAME_IDS)
        BackgroundNode(h.bus, h.bus.port("background"), others, seed)
        rows = [asdict(row) for row in h.run(20)]
        kept.append(repr((rows, h.captured, h.loop.totals())))
        assert 0.3 < h.bus.activity().load < 0.55
        assert {row["mode"] for row in rows[WARM:]} == {Mode.CONTROL}
    assert kept[0] == kept[1] != kept[2]
