"""The example under SysTick, on QEMU's Cortex-M7.

QEMU takes 2 ns an instruction: a core of 480 MHz that issues about one a cycle.
"""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from can_bridge.e2e.receiver import E2eReceiver, FrameCheck, StreamState
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode
from ecu.in_c.c_examples import ASKED_FROM
from ecu.in_c.compiler import zig_compiler
from tests.ecu.examples.conftest import both_sets, without

pytestmark = [
    pytest.mark.mcu,
    pytest.mark.skipif(shutil.which("qemu-system-arm") is None, reason="qemu-system-arm is not installed"),
]
QEMU, ZIG = shutil.which("qemu-system-arm") or "", zig_compiler() or []
CORTEX_M7 = (
    "-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m7+fp_armv8d16sp", "-ffreestanding", "-O2",
    "-ffp-contract=on", "-g0", "-T", "mps2_an500.ld", "-Wl,-e,sw_board_start",
)  # fmt: skip


@pytest.fixture(scope="session")
def image(folder, built_for, tmp_path_factory, shared_builds) -> Path:
    path = tmp_path_factory.mktemp("systick") / "ecu.elf"
    shared_builds.compile_c(without(folder, "main_socketcan.c"), path, compiler=ZIG, flags=CORTEX_M7)
    return path


def emulated(image: Path, shift: int) -> tuple[int, list[bytes], dict[str, int]]:
    """Exit status, the JetCommands' bytes and the figures of a run with 2^shift ns an instruction."""
    command = [QEMU, "-M", "mps2-an500", "-nographic", "-monitor", "none", "-serial", "none"]
    command += ["-icount", f"shift={shift},sleep=off", "-semihosting-config", "enable=on,target=native"]
    command += ["-kernel", str(image)]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300)
    assert "unexpected" not in done.stdout
    commands = [bytes.fromhex(data) for data in re.findall(r"^command (\w+)$", done.stdout, flags=re.MULTILINE)]
    figures = re.findall(r"^(?!command)(\w+) (\d+)$", done.stdout, flags=re.MULTILINE)
    return done.returncode, commands, {name: int(value) for name, value in figures}


@both_sets
def test_under_systick_the_period_is_kept_and_the_jets_are_driven(image, built_for):
    config, messages = built_for
    status, data, figures = emulated(image, shift=1)
    # A step each period and none left out; only the first frame finds a stream that is not trusted yet.
    periods, counts = len(data), [figures[name] for name in ("steps", "left_out", "overruns", "missed")]
    assert (status, counts) == (0, [periods, 0, 0, 1])
    assert figures["active"] == periods - ASKED_FROM
    assert 0 < figures["longest_us"] < config.period_ns / 1000
    # On the other side of the bus: every command arrives and is understood, and says what the ECU did.
    receiver = E2eReceiver(messages.command.spec, config.bus.e2e)
    for period, wire in enumerate(data):
        assert receiver.tick([Frame(frame_id=messages.command.spec.frame_id, data=wire)]).checks == (FrameCheck.OK,)
        command = messages.command.parse(wire)
        assert command is not None
        # The request rises with this period, and the window is full by then.
        assert command.enable == (period >= ASKED_FROM)
        assert command.mode is (Mode.CONTROL if command.enable else Mode.OFF)
        assert command.enable or command.flow_m2_per_s == 0
        counters = 16 if messages.command.spec.profile == 2 else 256
        assert command.pressure_counter == (period % counters if period > 0 else None)
    assert receiver.state.stream is StreamState.VALID
    last = messages.command.parse(data[-1])
    assert last is not None and last.flow_m2_per_s != 0


def test_a_core_too_slow_for_the_period_is_noticed(image):
    """1 us an instruction: SysTick begins the next period before a step is done."""
    status, _, figures = emulated(image, shift=10)
    assert status != 0 and figures["left_out"] > 0 and figures["overruns"] > 0 and figures["longest_us"] > 20_000
