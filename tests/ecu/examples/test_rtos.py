"""The files of `examples/rtos` compile as they stand, and drive."""

import re
import subprocess
from pathlib import Path

import pytest

from can_bridge.e2e.receiver import E2eReceiver, FrameCheck
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode
from ecu.in_c.c_examples import ASKED_FROM
from ecu.in_c.compiler import host_compiler
from tests.ecu.examples.conftest import START, without

RTOS = Path(__file__).parents[3] / "examples" / "rtos"
C = Path(__file__).with_name("c")
SYSTEMS = {
    "freertos": ["FreeRTOS.h", "freertos.c"],
    # The tests' compiler takes no folders in folders.
    "zephyr": ["zephyr.h", "zephyr.c"],
}
"""What stands in for each: as far as the files use it, one thread, and time that passes while it sleeps. Both play
the vehicle of `pressures.h`: a frame a control period, at its beginning, amid more frames of other nodes than the queue
holds. JetCommands are printed in hex, and the program ends when the pressures do."""


@pytest.mark.compiler
@pytest.mark.parametrize("system", SYSTEMS)
def test_every_period_has_a_command_and_the_jets_are_driven(system, folder, built_for, tmp_path, shared_builds):
    config, messages = built_for
    stand_ins = {name: (C / name).read_text() for name in ("board.h", "board.c", *SYSTEMS[system])}
    contents = without(folder, "main_socketcan.c", "systick.c", *START)
    files = {name: (RTOS / name).read_text() for name in ("ecu_port.h", "ecu_task.c", f"port_{system}.c")}
    port = re.sub(r"^#include <zephyr/.*>$", '#include "zephyr.h"', files[f"port_{system}.c"], flags=re.MULTILINE)
    files |= {f"port_{system}.c": port} | stand_ins
    # FreeRTOS has some of it in two more files.
    contents |= {"queue.h": b"", "task.h": b""} | {name: text.encode() for name, text in files.items()}
    program = tmp_path / "ecu"
    shared_builds.compile_c(contents, program, compiler=host_compiler(), flags=("-O1", "-ffp-contract=off"))
    done = subprocess.run([program], capture_output=True, text=True, timeout=60, check=True)
    receiver, modes = E2eReceiver(messages.command.spec, config.bus.e2e), list[Mode]()
    for line in done.stdout.split():
        wire = bytes.fromhex(line)
        assert receiver.tick([Frame(frame_id=messages.command.spec.frame_id, data=wire)]).checks == (FrameCheck.OK,)
        command = messages.command.parse(wire)
        assert command is not None
        modes.append(command.mode)
    assert Mode.CONTROL not in modes[: ASKED_FROM - 1]
    assert set(modes[ASKED_FROM + 10 :]) == {Mode.CONTROL}


@pytest.mark.compiler
def test_pressures_that_are_not_used_move_no_deadline(folder, tmp_path, shared_builds):
    contents = {name: text for name, text in without(folder).items() if name.endswith(".h") and "/" not in name}
    contents |= {name: (RTOS / name).read_bytes() for name in ("ecu_port.h", "ecu_task.c")}
    contents |= {"unused.c": (C / "unused.c").read_bytes()}
    program = tmp_path / "ecu"
    shared_builds.compile_c(contents, program, compiler=host_compiler(), flags=("-O1",))
    done = subprocess.run([program], capture_output=True, text=True, timeout=60, check=True)
    assert len(begun := done.stdout.split()) == 40 and len(set(begun)) == 1
