"""The ECU on the emulated Cortex-M7: the host's frames and states to the bit, cycles of each step, and its end."""

import platform
import sys
from dataclasses import replace

import pytest

from can_bridge.wire.messages import Mode
from contract.errors import ConfigError, McuError
from firmware_sim.in_c.c_ecu import CEcu
from firmware_sim.in_c.c_structs import differing
from firmware_sim.in_c.compiler import zig_compiler
from firmware_sim.mcu.build import COMMON
from firmware_sim.mcu.ecu_machine import McuEcu
from tests.firmware_sim.ecu_in_c import WINDOW, Feed

pytestmark = pytest.mark.mcu

PERIODS = WINDOW + 12


@pytest.fixture
def core(sources) -> McuEcu:
    return McuEcu(sources)


fuses = pytest.mark.skipif(
    platform.machine() not in ("x86_64", "AMD64", "arm64", "aarch64") or sys.platform == "win32",
    reason="the control step in float agrees to the bit where the host fuses products as well",
)


@fuses
def test_every_frame_and_state_is_the_hosts_to_the_bit(core, sources):
    """Through losses, in flight with other bounds, delay and weights, and from a saved state on."""
    compiler = zig_compiler()
    assert compiler is not None
    host, other = CEcu(sources, compiler=compiler, flags=(*COMMON, "-march=native")), McuEcu(sources)
    own = core.calibration
    assert own == host.calibration
    changes = {
        PERIODS: replace(own, action_limit=0.03, command_step=0.01, delay_steps=2),
        PERIODS + 2: replace(own, weights=replace(own.weights, lift=5.0), delay_steps=1),
        PERIODS + 4: own,
    }
    modes, ecus = set(), [core, host]
    for period, (now_ns, frames) in enumerate(Feed().periods(PERIODS + 8, lost=(10, 11), damaged=(13,))):
        for one in (core, host) if period in changes else ():
            one.calibrate(changes[period])
            with pytest.raises(ConfigError, match="delay_steps"):
                one.calibrate(replace(own, delay_steps=99))
            assert one.calibration == changes[period]
        if period == PERIODS + 5:
            other.restore(core.state)
            core.restore(core.saved())
            ecus.append(other)
        first, *others = [one.step(now_ns, frames) for one in ecus]
        assert others == [first] * len(others), period
        assert [differing(one.state, host.state) for one in ecus] == [[]] * len(ecus), period
        assert (core.trace.mode, core.trace.action) == (host.trace.mode, host.trace.action)
        modes.add(core.trace.mode)
    assert {Mode.CONTROL, Mode.HOLD, Mode.DECAY} <= modes
    assert abs(core.trace.action) > 0.0


def test_cycles_are_those_of_each_step(core, sources):
    """A plan costs a thousand times what a period without one costs, and the clock divides."""
    slow, counts = McuEcu(sources, clock_mhz=240.0), []
    for now_ns, frames in Feed().periods(WINDOW + 6):
        core.step(now_ns, frames)
        slow.step(now_ns, frames)
        assert core.cycles == slow.cycles
        assert core.step_ns == round(core.cycles / 0.48)
        assert abs(slow.step_ns - 2 * core.step_ns) <= 1
        counts.append((core.trace.forces is not None, core.instructions))
    planned = [count for plans, count in counts if plans]
    idle = [count for plans, count in counts if not plans]
    assert min(planned) > 10 * max(idle)
    # The work of a plan does not depend on the data: what is left is the state machine's.
    assert max(planned) - min(planned) < 0.01 * max(planned)


def test_a_core_that_stops_is_an_error_in_one_line(sources):
    """By a control step that reads where no memory is; and one that is given more frames than it keeps."""
    stops = b"""#include "stillwake.h"
sw_status sw_control_step_of(const sw_program *program, sw_workspace *work, const sw_input *input, sw_output *output)
{
    (void)program; (void)work; (void)input; (void)output;
    return *(volatile sw_status *)0x60000000u;
}
"""
    kept = {name: text for name, text in sources.items() if name != "sw_control_step.c"}
    core = McuEcu(kept | {"sw_control_step.c": stops})
    with pytest.raises(McuError, match=r"mcu_ecu_step: the core stopped at 0x8[0-9a-f]+"):
        for now_ns, frames in Feed().periods(PERIODS):
            core.step(now_ns, frames)
    feed = Feed()
    with pytest.raises(McuError, match="keeps 819"):
        core.step(feed.now_ns, [feed.frame()] * 820)
