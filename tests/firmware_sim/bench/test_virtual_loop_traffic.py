"""The loop in virtual time on a bus that others use too, or whose controllers see errors."""

import pytest

from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import PRESSURE
from can_bridge.wire.messages import Mode
from tests.firmware_sim.bench.harness import WARM


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
