"""The exported folder's firmware as Arm's GCC builds it: it sends the host's frames, and a tester flashes it."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from can_bridge.bus.interface import BusHealth
from can_bridge.wire.messages import Mode
from ecu.in_c.c_ecu import CEcu
from firmware_sim.mcu.board.board_ecu import BoardEcu
from firmware_sim.mcu.build import Firmware, read_elf
from tests.can_bridge.flashing.releases import keys
from tests.ecu.in_c.exported import WINDOW, Feed
from tests.firmware_sim.mcu.board_node import QUICK, BoardLine, Built
from tests.firmware_sim.mcu.test_board import step_both

MISSING = [name for name in ("arm-none-eabi-gcc", "cmake") if shutil.which(name) is None]
SKIPPED = pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)}")
# Two builds by CMake. Day by day test_board.py and test_board_node.py run the firmware as clang builds it, and
# tests/export/to_c/test_library.py shows that GCC takes the library without a warning.
pytestmark = [pytest.mark.proofs, pytest.mark.mcu, pytest.mark.compiler, SKIPPED]
LOST = WINDOW + 6
WARNINGS = "-Wall -Wextra -Wpedantic -Wconversion -Werror"


def built_by_its_rules(folder: Path) -> Firmware:
    """By the two commands in the head of its CMakeLists.txt, with warnings as errors."""
    rules = (folder / "CMakeLists.txt").read_text()
    (lines,) = re.findall(r"^#     cmake -B arm .*\n(?:#     .*\n)+", rules, re.MULTILINE)
    commands = lines.strip().replace("#     ", "").replace('FLAGS="', f'FLAGS="{WARNINGS} ') + " -j2"
    done = subprocess.run(["sh", "-ec", commands], cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout[-2000:]
    return read_elf((folder / "arm" / "board.elf").read_bytes())


def test_built_without_a_warning_it_sends_the_hosts_frames_and_does_so_again_once_flashed(release, sources, tmp_path):
    folder, node = shutil.copytree(release.folder, tmp_path / "c"), Built(release)
    board = BoardEcu(sources, firmware=built_by_its_rules(folder))
    host, decided = CEcu(sources), []
    for now_ns, frames in Feed().periods(WINDOW + 30, lost=(LOST, LOST + 1, LOST + 2), damaged=(LOST + 4,)):
        step_both(board, host, now_ns, frames, BusHealth())
        decided.append((board.trace.mode, board.trace.action))
    assert {Mode.CONTROL, Mode.HOLD, Mode.DECAY} <= {mode for mode, _ in decided}
    assert board.board.stack_depth() < 2048
    # With keys and the loader, which two files know of; the fresh board takes its release over CAN.
    for name, content in node.own.items():
        (folder / "board" / name).write_bytes(content)
    board = node.ecu(firmware=built_by_its_rules(folder), times=QUICK)
    BoardLine(board).provision(keys(), node.image("one"))
    board = node.ecu(board.board.flash.bank, board.firmware)
    for (now_ns, frames), expected in zip(Feed().periods(LOST), decided, strict=False):
        board.step(now_ns, frames)
        assert (board.trace.mode, board.trace.action) == expected
    assert board.trace.mode is Mode.CONTROL
