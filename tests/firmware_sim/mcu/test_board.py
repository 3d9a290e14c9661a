"""The whole firmware on the emulated board: it gives the host's frames and states, also as Arm's GCC builds it."""

import platform
import re
import shutil
import struct
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import pytest

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode, Reason
from contract.errors import ConfigError, LibraryError, McuError
from contract.release.manifest import SpeedRange
from ecu.in_c.c_ecu import CEcu, ecu_sources
from ecu.in_c.compiler import zig_compiler
from firmware_sim.mcu.board.board import BACKUP
from firmware_sim.mcu.board.board_ecu import BoardEcu
from firmware_sim.mcu.build import COMMON, Firmware, read_elf
from tests.can_bridge.flashing.releases import keys
from tests.ecu.in_c.exported import CONFIG, WINDOW, Feed
from tests.ecu.in_c.test_secoc_in_c import KEYED, SECRET, genuine
from tests.firmware_sim.mcu.board_node import QUICK, BoardLine, Built

pytestmark = pytest.mark.mcu
OFF = BusHealth(state=BusState.BUS_OFF, tx_errors=256, bus_off=4)
fuses = pytest.mark.skipif(
    platform.machine() not in ("x86_64", "AMD64", "arm64", "aarch64") or sys.platform == "win32",
    reason="the control step in float agrees to the bit where the host fuses products as well",
)
MISSING = [name for name in ("arm-none-eabi-gcc", "cmake") if shutil.which(name) is None]
LOST = WINDOW + 6
WARNINGS = "-Wall -Wextra -Wpedantic -Wconversion -Werror"


def host_of(sources) -> CEcu:
    return CEcu(sources, compiler=zig_compiler(), flags=(*COMMON, "-march=native"))


def step_both(board: BoardEcu, host: CEcu, now_ns: int, frames: Iterable[Frame], health: BusHealth, *more: Frame):
    """The host steps when the firmware has decided to; `more` is for the board alone."""
    sent = board.step(now_ns, [*more, *frames], health)
    at_ns = now_ns + board.waited_ns
    expected = [replace(one, timestamp_ns=at_ns) for one in host.step(at_ns, list(frames), health)]
    facts = [[(one.frame_id, one.data, one.timestamp_ns) for one in some] for some in (sent, expected)]
    assert facts[0] == facts[1]
    assert board.differing(host.state) == []
    assert (board.trace.mode, board.trace.action) == (host.trace.mode, host.trace.action)


@fuses
def test_every_frame_and_state_is_the_hosts(sources):
    """Through losses, a damaged frame, foreign traffic, in flight with other bounds, delay and weights, from a saved
    state on, and bus-off, whose INIT reads back late, or is set late."""
    board, host = BoardEcu(sources), host_of(sources)
    board.board.can.init_reads_late = 20
    own, foreign = board.calibration, [Frame(frame_id=0x123, data=bytes(64))] * 40
    foreign += [Frame(frame_id=0x12345, data=b"", is_extended=True)] * 40
    assert own == host.calibration
    changes = {
        WINDOW + 15: replace(own, action_limit=0.03, command_step=0.01, delay_steps=2),
        WINDOW + 17: replace(own, weights=replace(own.weights, lift=5.0), delay_steps=1),
        WINDOW + 19: own,
    }
    health, modes, counts = BusHealth(), set(), list[tuple[bool, int]]()
    for period, (now_ns, frames) in enumerate(Feed().periods(WINDOW + 22, lost=(10, 11, 12), damaged=(14,))):
        for one in (board, host) if period in changes else ():
            one.calibrate(changes[period])
            with pytest.raises(ConfigError, match="delay_steps"):
                one.calibrate(replace(own, delay_steps=99))
            assert one.calibration == changes[period]
        if period == WINDOW + 14:
            health = BusHealth(tx_errors=7, rx_errors=99, bus_off=3)
        if period == WINDOW + 20:
            board.restore(host.saved())
        step_both(board, host, now_ns, frames, health, *(foreign if period % 5 == 0 else ()))
        assert board.waited_ns == (0 if frames else CONFIG.period_ns // 2)
        modes.add(board.trace.mode)
        counts.append((board.trace.forces is not None, board.instructions))
        assert board.step_ns == board.waited_ns + round(board.cycles / 0.48)
    assert {Mode.CONTROL, Mode.HOLD, Mode.DECAY} <= modes
    # A plan is most of the work, which does not depend on the data.
    planned, idle = ([count for plans, count in counts if plans is wanted] for wanted in (True, False))
    assert min(planned) > 2 * max(idle)
    assert max(planned) - min(planned) < 0.05 * max(planned)
    assert board.status().bus_off == 3 and 0 < board.board.stack_depth() < 2048
    assert board.board.can.bit_rates == (CONFIG.bus.nominal_bitrate, CONFIG.bus.data_bitrate)
    # A frame that waits while the controller is off would be late: none comes out then or afterwards.
    now_ns += CONFIG.period_ns
    board.board.can.init_sets_late = 1
    assert board.step(now_ns, [], OFF) == []
    assert len(board.step(now_ns + CONFIG.period_ns, [], BusHealth(bus_off=4))) == 2
    assert (board.status().bus_off, board._pointer("sw_board_lost")) == (4, 2)
    # From a bus that others held all the time the newest command comes, and none of before.
    can = board.board.can
    with patch.object(can, "_switch"):
        can._sending.is_on = False
        assert board.step(now_ns + 2 * CONFIG.period_ns, [], BusHealth(bus_off=4)) == []
        at_ns = now_ns + 3 * CONFIG.period_ns
        can._sending.is_on, can._sending._free_ns = True, at_ns + CONFIG.period_ns // 2 + 1
        sent = board.step(at_ns, [], BusHealth(bus_off=4))
    assert [one.timestamp_ns for one in sent] == [at_ns + board.waited_ns] * 2
    assert board._pointer("sw_board_lost") == 4  # what was taken back counts as well
    with pytest.raises(McuError, match="cannot be passed to its step"):
        board.step(now_ns, [], fault=Reason.NO_RELEASE)
    can._kept[0x20] = 1
    with pytest.raises(McuError, match="TSCC counts bits"):
        can.read(0x24)


@pytest.mark.proofs  # two more builds; the ECU in C is held to the one in Python at speeds, and the board to C
@fuses
def test_at_other_speeds_they_are_as_well(release):
    serving = release.serving(SpeedRange(slowest=0.8, fastest=1.2))
    sources = ecu_sources(serving.folder, serving.bundle, CONFIG)
    board, host = BoardEcu(sources), host_of(sources)
    for now_ns, frames in Feed().driven([*(1.0 + 0.03 * k for k in range(7)), *(1.2 - 0.04 * k for k in range(5))]):
        step_both(board, host, now_ns, frames, BusHealth())
    assert board.trace.mode is Mode.CONTROL


def test_a_library_without_a_board_is_an_error_in_one_line(sources):
    with pytest.raises(LibraryError, match="this library has no board"):
        BoardEcu({name: text for name, text in sources.items() if "/" not in name})


def record(number: int, trip: int, speed: int = 0) -> bytes:
    """What the firmware keeps of its freshness, with no pressures heard so far."""
    words, check = (number, trip, 0, 0, speed, 0), 0x811C9DC5
    for word in words:
        check = (check ^ word) * 0x01000193 & 0xFFFFFFFF
    return struct.pack("<7I", *words, check)


@fuses
def test_with_a_key_it_sends_the_hosts_frames_and_its_battery_keeps_the_freshness(release):
    own = ecu_sources(release.folder, release.bundle, KEYED)
    board = BoardEcu(own, secret=SECRET)
    host = CEcu(own, compiler=zig_compiler(), flags=(*COMMON, "-march=native"), secret=SECRET)
    for now_ns, frames in genuine().periods(WINDOW + 12):
        step_both(board, host, now_ns, frames, BusHealth())
        assert board.differing(host.state) == []
    heard = board.state.verifier.freshness
    assert heard == 2 << 32 | WINDOW + 11
    for trip in (2, 3):
        board.power_on(board.board.flash.bank, now_ns)
        assert (board.state.freshness.trip, board.state.verifier.freshness) == (trip, heard)
    # A record that a cut left half written is none: the other one stands.
    torn = bytearray(board.board.peek(BACKUP, 56))
    newest = max((0, 28), key=lambda at: int.from_bytes(torn[at : at + 4], "little"))
    board.board.poke(BACKUP + newest + 12, b"\xff")
    board.power_on(board.board.flash.bank, now_ns)
    assert (board.state.freshness.trip, board.state.verifier.freshness) == (3, heard)
    # The firmware of a library has zeros in the key's place, which are none; what was kept stands.
    assert b"SW_BOARD_BUS_KEY {0}" in own["board/sw_board_bus_key.h"]
    blank = tuple((at, content.replace(SECRET, bytes(16))) for at, content in board.firmware.segments)
    assert blank != board.firmware.segments
    keyed, board.firmware = board.firmware, replace(board.firmware, segments=blank)
    board.power_on(board.board.flash.bank, now_ns)
    assert board.step(now_ns, frames) == []
    board.firmware = keyed
    board.power_on(board.board.flash.bank, now_ns)
    assert (board.state.freshness.trip, board.state.verifier.freshness) == (5, heard)
    # Behind the largest number of a record comes 0: it is newer still.
    board.board.poke(BACKUP, record(2**32 - 2, 6) + record(2**32 - 1, 7))
    for trip in (8, 9, 10):
        board.power_on(board.board.flash.bank, now_ns)
        assert board.state.freshness.trip == trip
    # The value of a speed stays for a later release, although this one needs no speed.
    board.board.poke(BACKUP, record(1, 11, speed=77) + bytes(28))
    board.power_on(board.board.flash.bank, now_ns)
    board.step(now_ns, frames)
    assert board.board.peek(BACKUP, 56).count(struct.pack("<Q", 77)) == 2
    assert board.state.verifier.freshness > 0


def built_by_its_rules(folder: Path) -> Firmware:
    """By the two commands in the head of its CMakeLists.txt, with warnings as errors."""
    rules = (folder / "CMakeLists.txt").read_text()
    (lines,) = re.findall(r"^#     cmake -B arm .*\n(?:#     .*\n)+", rules, re.MULTILINE)
    commands = lines.strip().replace("#     ", "").replace('FLAGS="', f'FLAGS="{WARNINGS} ') + " -j2"
    done = subprocess.run(["sh", "-ec", commands], cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout[-2000:]
    return read_elf((folder / "arm" / "board.elf").read_bytes())


# Two builds by CMake. Day by day clang builds the firmware, and GCC the library (tests/export/to_c/test_library.py).
@pytest.mark.proofs
@pytest.mark.compiler
@pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)}")
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
