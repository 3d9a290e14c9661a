"""Loader, diagnosis and ECU on the emulated board: flashed over CAN by a tester, and control beside diagnosis, where a
frame takes its time on the bus, and an operation of the flash its own."""

import hashlib
from dataclasses import replace
from itertools import count, pairwise, product

import pytest

from can_bridge.flashing.store import BootReason
from can_bridge.tester.messages import ImageRefusedError
from can_bridge.tester.sequence import End
from can_bridge.uds.services import P2_EXTENDED_MS, P2_MS
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import frame_ns
from can_bridge.wire.message_specs import ECU_STATUS, JET_COMMAND
from can_bridge.wire.messages import Mode, Reason
from contract.config.vehicle import BusConfig
from contract.errors import McuError
from firmware_sim.mcu.board.board_ecu import LONGEST_UNSEEN_NS, BoardEcu, read_bank, serve
from firmware_sim.mcu.board.flash_controller import FlashBank, FlashTimes
from tests.can_bridge.flashing.releases import keys
from tests.can_bridge.uds.addresses import COMMAND_ID, REQUEST_ID, RESPONSE_ID, XCP_RESPONSE_ID
from tests.ecu.in_c.exported import CONFIG, WINDOW, Feed
from tests.ecu.independent_tester import ADDRESSED, IndependentTester, converse, keeps_whole
from tests.firmware_sim.mcu.board_node import QUICK, READ, TICK_NS, BoardLine, Built, Traffic, on
from tests.firmware_sim.mcu.test_board import fuses, host_of

pytestmark = pytest.mark.mcu
MOST_NS = 2 * CONFIG.period_ns - 5_000_000  # between two frames of a stream of which none is left out
LONGEST = FlashTimes(erase_ns=2_000_000_000, word_ns=200_000)  # by the datasheet
LONG = ADDRESSED[1][0]


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
    line.sleep(1.0)
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
    packets = []
    for command in ("FF00", "F401000014010020", "F401000044010020"):
        asked = Frame(frame_id=COMMAND_ID, data=bytes.fromhex(command))
        sent = again.advance(again.board.counter.now_ns + TICK_NS, [asked])
        packets.append([one.data for one in sent if one.frame_id == XCP_RESPONSE_ID])
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


@pytest.fixture(scope="module")
def classic(release) -> tuple[Built, BoardEcu, bytes]:
    """A board of classic frames and identifiers of 29 bits, flashed over CAN, which reads the store first: 122 bytes,
    and the controller has places for eight frames."""
    built = Built(release, replace(CONFIG, bus=BusConfig(frames="classic", diagnosis=LONG)))
    board = built.ecu(times=QUICK)
    BoardLine(board, built.config.bus).provision(keys(), built.image("one"))
    return built, board, board.board.flash.bank.pack()


def test_reading_at_full_rate_costs_control_no_frame_and_every_answer_comes_whole(built, fresh, provisioned, classic):
    periods = 18
    for one in ((built, fresh, provisioned), classic):
        traffic, bus = Traffic(on(*one), one[0].config), one[0].config.bus
        answers = traffic.read(periods)
        assert [len(times) for times in traffic.control_frames()] == [periods, periods]
        assert answers.total() > len(READ) * (6 if bus.frames == "fd" else 1)
        assert [{length for request, length in answers if request == one} for one in READ[:2]] == [{122}, {671}]
        rates = {"nominal_bitrate": bus.nominal_bitrate, "data_bitrate": bus.data_bitrate}
        for before, frame in pairwise(traffic.sent):
            assert frame.timestamp_ns - before.timestamp_ns >= frame_ns(frame, **rates)


def test_independent_clients_reach_it_under_identifiers_of_29_bits(classic):
    """Through the controller's filters, which let nothing else through, in the model of them as on the chip."""
    board = on(*classic)

    def exchange(frames: list[Frame]) -> list[Frame]:
        return board.advance(board.board.counter.now_ns + TICK_NS, frames)

    tester = IndependentTester(exchange, *ADDRESSED[1][1:], is_fd=False)
    converse(tester, b"0815")
    keeps_whole(tester, Frame(frame_id=0x18DB33F1, data=b"\x02\x3e\x00".ljust(8), is_fd=False, is_extended=True))
    # Of what is not asked for nothing enters the FIFO.
    own, can = LONG.request.number, board.board.can
    room = can.room
    for other, is_extended in (*product((0x7E0, 0x7D8, own & 0x7FF), (False, True)), (own ^ 1, True)):
        can.receive(Frame(frame_id=other, data=bytes(8), is_extended=is_extended, is_fd=False))
    assert can.room == room
    can.receive(Frame(frame_id=own, data=bytes(8), is_extended=True, is_fd=False))
    assert can.room == room - 1


def test_an_erasure_is_answered_in_time_and_costs_control_no_period(built, fresh, provisioned):
    """From the announcement on the jets are shut, and their command comes all the same."""
    traffic = Traffic(on(built, fresh, provisioned, LONGEST))
    traffic.vehicle.asks, traffic.look_ns = False, TICK_NS
    traffic.run(0.1)
    traffic.ask(b"\x10\x02")
    assert traffic.unlock(1) == b"\x67\x02"
    image = built.image("two", 2)
    option = len(image).to_bytes(4, "big") + hashlib.sha256(image).digest()
    (first, pending), *more, (last, answer) = traffic.ask(b"\x31\x01\xff\x00" + option)
    assert (pending, answer[:4]) == (b"\x7f\x31\x78", b"\x71\x01\xff\x00")
    moments = [first, *(at for at, _ in more), last]
    assert first < P2_MS and max(b - a for a, b in pairwise(moments)) < P2_EXTENDED_MS
    assert last > 3 * LONGEST.erase_ns / 1e6
    assert traffic.ask(b"\x34\x00\x44" + bytes(4) + option[:4])[-1][1][0] == 0x74
    for number in range(2):
        # A block of 4 KiB is 128 words, and the state behind it.
        answer = traffic.ask(bytes([0x36, number + 1]) + image[4064 * number :][:4064])[-1][1]
        assert answer == bytes([0x76, number + 1])
    for ends in traffic.control_frames():
        assert max(b - a for a, b in pairwise(ends)) < MOST_NS
        assert abs(len(ends) - traffic.now_ns / CONFIG.period_ns) < 2
    flash = traffic.board.board.flash
    assert (flash.erasures, flash.stalled_ns) == (3, 0)
