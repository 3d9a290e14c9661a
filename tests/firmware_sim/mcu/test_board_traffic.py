"""Control beside diagnosis on the board: a frame takes its time on the bus, and an operation of the flash its own."""

import hashlib
from dataclasses import replace
from itertools import pairwise

import pytest

from can_bridge.uds.services import P2_EXTENDED_MS, P2_MS
from can_bridge.wire.frame_bits import frame_ns
from can_bridge.wire.messages import Mode
from contract.config.vehicle import BusConfig
from firmware_sim.mcu.board.board_ecu import BoardEcu
from firmware_sim.mcu.board.flash_controller import STM32H743, FlashBank, FlashTimes
from tests.can_bridge.flashing.releases import keys
from tests.ecu.in_c.exported import CONFIG
from tests.firmware_sim.mcu.board_node import READ, BoardLine, Built, Traffic

pytestmark = pytest.mark.mcu
MOST_NS = 2 * CONFIG.period_ns - 5_000_000
"""Between two frames of a stream of which none is left out."""
LONGEST = FlashTimes(erase_ns=2_000_000_000, word_ns=200_000)
"""By the datasheet."""


@pytest.fixture(scope="module", params=["fd", "classic"])
def built(request, release) -> Built:
    return Built(release, replace(CONFIG, bus=BusConfig(frames=request.param)))


@pytest.fixture(scope="module")
def provisioned(built) -> tuple[bytes, BoardEcu]:
    """Flashed over CAN, which reads the store first: 122 bytes, and the controller has places for eight frames."""
    board = built.ecu()
    BoardLine(board, built.config.bus).provision(keys(), built.image("one"))
    return board.board.flash.bank.pack(), board


def on(built: Built, provisioned: tuple[bytes, BoardEcu], times: FlashTimes = STM32H743) -> Traffic:
    board = built.ecu(FlashBank.unpack(provisioned[0]), provisioned[1].firmware, times)
    return Traffic(board, built.config)


def test_reading_at_full_rate_costs_control_no_frame_and_every_answer_comes_whole(built, provisioned):
    traffic, periods, bus = on(built, provisioned), 30, built.config.bus
    answers = traffic.read(periods)
    assert [len(times) for times in traffic.control_frames()] == [periods, periods]
    assert answers.total() > len(READ) * (10 if bus.frames == "fd" else 2)
    assert [{length for request, length in answers if request == one} for one in READ[:2]] == [{122}, {671}]
    rates = {"nominal_bitrate": bus.nominal_bitrate, "data_bitrate": bus.data_bitrate}
    for before, frame in pairwise(traffic.sent):
        assert frame.timestamp_ns - before.timestamp_ns >= frame_ns(frame, **rates)


def test_an_erasure_is_answered_in_time_and_costs_control_no_period(built, provisioned):
    """From the announcement on the jets are shut, and their command comes all the same."""
    times = LONGEST if built.config.bus.frames == "fd" else STM32H743  # the bus has no part in it
    traffic = on(built, provisioned, times)
    traffic.vehicle.asks = False
    traffic.run(0.1)
    traffic.ask(b"\x10\x02")
    assert traffic.unlock(1) == b"\x67\x02"
    image = built.image("two", 2)
    option = len(image).to_bytes(4, "big") + hashlib.sha256(image).digest()
    (first, pending), *more, (last, answer) = traffic.ask(b"\x31\x01\xff\x00" + option)
    assert (pending, answer[:4]) == (b"\x7f\x31\x78", b"\x71\x01\xff\x00")
    moments = [first, *(at for at, _ in more), last]
    assert first < P2_MS and max(b - a for a, b in pairwise(moments)) < P2_EXTENDED_MS
    assert last > 3 * times.erase_ns / 1e6
    assert traffic.ask(b"\x34\x00\x44" + bytes(4) + option[:4])[-1][1][0] == 0x74
    for number in range(2):
        # A block of 4 KiB is 128 words, and the state behind it.
        answer = traffic.ask(bytes([0x36, number + 1]) + image[4064 * number :][:4064])[-1][1]
        assert answer == bytes([0x76, number + 1])
    for ends in traffic.control_frames():
        assert (
            max(b - a for a, b in pairwise(ends)) < MOST_NS and abs(len(ends) - traffic.now_ns / CONFIG.period_ns) < 2
        )
    flash = traffic.board.board.flash
    assert (flash.erasures, flash.stalled_ns) == (3, 0)


def test_no_sector_is_erased_while_the_jets_run_and_one_is_blanked_once_they_are_shut(built, provisioned):
    if built.config.bus.frames != "fd":
        pytest.skip("the bus has no part in it")
    traffic = on(built, provisioned)
    traffic.run(0.4)
    flash = traffic.board.board.flash

    def mode() -> Mode:
        traffic.board._load()
        return traffic.board.trace.mode

    def unlocked() -> bytes:
        traffic.ask(b"\x10\x03")
        return traffic.unlock(3)

    assert mode() is Mode.CONTROL
    answers = [unlocked() for _ in range(200)]
    done = answers.count(b"\x67\x04")
    # One sector takes some 370 states, two for each key; then none is taken while the jets run.
    assert 60 < done < 200 and answers == done * [b"\x67\x04"] + (200 - done) * [b"\x7f\x27\x22"]
    assert traffic.unlock(3, right=False) == b"\x7f\x27\x22"
    assert (mode(), flash.erasures, flash.stalled_ns) == (Mode.CONTROL, 0, 0)
    traffic.vehicle.asks = False
    traffic.run(1.2)
    assert mode() is not Mode.CONTROL
    # A request that comes amid the erasure waits for it, and is answered before and behind.
    while not flash.is_at_work or flash.erasures == 0:
        traffic.run(0.01)
    traffic.ask(b"\x10\x03")
    (first, pending), (last, seed) = traffic.ask(b"\x27\x03")
    assert (pending, seed[:2], first < P2_MS, last > 500) == (b"\x7f\x27\x78", b"\x67\x03", True, True)
    assert unlocked() == b"\x67\x04" and flash.erasures == 1
    traffic.run(0.1)
    for ends in traffic.control_frames():
        assert max(b - a for a, b in pairwise(ends)) < MOST_NS
