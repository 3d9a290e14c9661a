"""Loader, diagnosis and ECU on the emulated board: flashed over CAN by a tester, and the supply that fails."""

from itertools import count

import pytest

from can_bridge.flashing.boot import BootReason
from can_bridge.tester.messages import ImageRefusedError
from can_bridge.tester.sequence import End
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import ECU_STATUS, JET_COMMAND
from can_bridge.wire.messages import Mode, Reason
from contract.errors import McuError
from firmware_sim.mcu.board.flash_controller import FlashBank
from firmware_sim.mcu.board.on_a_bus import LONGEST_UNSEEN_NS, read_bank, serve
from tests.can_bridge.uds.addresses import COMMAND_ID, REQUEST_ID, RESPONSE_ID, XCP_RESPONSE_ID
from tests.ecu.in_c.exported import WINDOW, Feed
from tests.firmware_sim.mcu.board_node import TICK_NS, BoardLine, on
from tests.firmware_sim.mcu.test_board import fuses, host_of

pytestmark = pytest.mark.mcu


def test_a_fresh_board_keeps_its_jets_shut_and_says_why(built, fresh):
    for now_ns, frames in Feed().periods(3):
        assert [one.frame_id for one in fresh.step(now_ns, frames)] == [JET_COMMAND.frame_id, ECU_STATUS.frame_id]
    assert (fresh.trace.mode, fresh.state.fail_safe.reason) == (Mode.FAULT, Reason.NO_RELEASE)


@fuses
def test_a_release_that_was_flashed_over_can_controls_as_on_the_host(built, fresh, provisioned):
    """And a second one over it, confirmed; one that is damaged on the way is refused, and none of it runs."""
    board = on(built, fresh, provisioned)
    line = BoardLine(board)
    with pytest.raises(ImageRefusedError):
        line.flash(built.image("two", 2)[:-1] + b"!")
    line.time.sleep(1.0)
    done = line.flash(built.image("two", 2))
    assert (done.end, done.before.serial_number, done.after.reason) == (End.CONFIRMED, "0815", BootReason.TRIAL)
    assert line.flash(built.image("two", 2)).end is End.ALREADY
    assert board.board.stack_depth() < 12_000
    # Numbers are read from the slot that the tester wrote; on the host they are compiled in.
    again, host = on(built, fresh, board.board.flash.bank.pack()), host_of(built.sources)
    for now_ns, frames in Feed().periods(WINDOW + 6):
        commands, statuses = zip(*(one.step(now_ns, frames) for one in (again, host)), strict=True)
        assert commands[0].data == commands[1].data
        assert statuses[0].data != statuses[1].data
    assert again.trace.mode is Mode.CONTROL
    # A calibration tool connects and reads the mode; an address that no memory has is refused.
    packets = [
        [
            one.data
            for one in again.advance(
                again.board.counter.now_ns + TICK_NS, [Frame(frame_id=COMMAND_ID, data=bytes.fromhex(command))]
            )
            if one.frame_id == XCP_RESPONSE_ID
        ]
        for command in ("FF00", "F401000014010020", "F401000044010020")
    ]
    assert packets == [[bytes.fromhex("FF05800808000101")], [bytes([0xFF, Mode.CONTROL])], [b"\xfe\x24"]]


def test_a_board_on_a_bus_answers_and_its_flash_is_kept_in_a_file(built, fresh, tmp_path):
    """Its time passes with the clock, by a period at most between two looks."""
    asked = [Frame(frame_id=REQUEST_ID, data=b"\x02\x3e\x00".ljust(8, b"\xcc"))]
    sent: list[Frame] = []

    class OneRequest:
        def receive_all(self) -> list[Frame]:
            return [asked.pop()] if asked else []

        def send(self, frame: Frame) -> None:
            sent.append(frame)

    board, path, clock = on(built, fresh, FlashBank().pack()), tmp_path / "flash.bin", count(0, 10**9)
    began_ns = board.board.counter.now_ns
    looks = iter([False] * 5 + [True])
    serve(board, OneRequest(), path, clock_ns=clock.__next__, wait=lambda: None, is_stopped=looks.__next__)
    assert [one.data[:3] for one in sent if one.frame_id == RESPONSE_ID] == [b"\x02\x7e\x00"]
    assert sum(one.frame_id == JET_COMMAND.frame_id for one in sent) in (4, 5)
    assert board.board.counter.now_ns - began_ns == 5 * LONGEST_UNSEEN_NS
    assert read_bank(path).pack() == board.board.flash.bank.pack()
    path.write_bytes(b"cut")
    with pytest.raises(McuError, match="a flash of 3 bytes"):
        read_bank(path)
