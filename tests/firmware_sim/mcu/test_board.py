"""The whole firmware on the emulated board: it gives the host's frames, through registers alone."""

import pytest

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode
from contract.errors import McuError
from contract.release.manifest import SpeedRange
from export.to_c.board_files import board_sources
from firmware_sim.in_c.c_ecu import CEcu, ecu_sources
from firmware_sim.in_c.c_structs import differing
from firmware_sim.in_c.compiler import zig_compiler
from firmware_sim.mcu.board.board_ecu import BoardEcu
from firmware_sim.mcu.build import COMMON
from tests.firmware_sim.ecu_in_c import CONFIG, WINDOW, Feed
from tests.firmware_sim.mcu.test_ecu_machine import fuses

pytestmark = pytest.mark.mcu
OFF = BusHealth(state=BusState.BUS_OFF, tx_errors=256, bus_off=4)


@pytest.fixture(scope="module")
def sources(sources) -> dict[str, bytes]:
    return sources | board_sources()


def host_of(sources) -> CEcu:
    library = {name: text for name, text in sources.items() if name not in board_sources(loader=True)}
    return CEcu(library, compiler=zig_compiler(), flags=(*COMMON, "-march=native"))


@fuses
def test_every_frame_and_state_is_the_hosts(sources):
    """Through losses, a damaged frame, foreign traffic and bus-off; the host steps when the firmware has decided to."""
    board, host = BoardEcu(sources), host_of(sources)
    health, modes = BusHealth(), set()
    for period, (now_ns, frames) in enumerate(Feed().periods(WINDOW + 22, lost=(10, 11, 12), damaged=(14,))):
        if period == WINDOW + 14:
            health = BusHealth(tx_errors=7, rx_errors=99, bus_off=3)
        foreign = [Frame(frame_id=0x123, data=bytes(64)), Frame(frame_id=0x12345, data=b"", is_extended=True)] * 40
        sent = board.step(now_ns, foreign + frames, health)
        assert board.waited_ns == (0 if frames else CONFIG.period_ns // 2)
        expected = host.step(now_ns + board.waited_ns, frames, health)
        assert [one.data for one in sent] == [one.data for one in expected], period
        assert [(one.frame_id, one.timestamp_ns) for one in sent] == [
            (one.frame_id, now_ns + board.waited_ns) for one in expected
        ]
        assert differing(board.state, host.state) == []
        modes.add(board.trace.mode)
    assert {Mode.CONTROL, Mode.HOLD, Mode.DECAY} <= modes
    assert board.status().bus_off == 3
    assert board.board.can.bit_rates == (CONFIG.bus.nominal_bitrate, CONFIG.bus.data_bitrate)
    # A frame that waits while the controller is off would be late: none comes out then or afterwards.
    now_ns += CONFIG.period_ns
    assert board.step(now_ns, [], OFF) == []
    assert board.status().bus_off == 4
    assert len(board.step(now_ns + CONFIG.period_ns, [], BusHealth(bus_off=4))) == 2
    assert board.status().bus_off == 4


@fuses
def test_calibration_speed_and_state_as_well(release):
    serving = release.serving(SpeedRange(slowest=0.8, fastest=1.2))
    sources = ecu_sources(serving.folder, serving.bundle, CONFIG) | board_sources()
    board, host = BoardEcu(sources), host_of(sources)
    for k, (now_ns, frames) in enumerate(Feed().driven([*(1.0 + 0.03 * k for k in range(7)), *[0.9] * 5])):
        if k == 8:
            board.calibrate(board.calibration)
            host.restore(board.state)
            board.restore(host.state)
        assert [one.data for one in board.step(now_ns, frames)] == [one.data for one in host.step(now_ns, frames)], k
        assert differing(board.state, host.state) == []
    assert board.trace.mode is Mode.CONTROL
    assert 0 < board.step_ns == round(board.cycles / 0.48)
    assert 0 < board.board.stack_depth() < 8192


@pytest.mark.parametrize(
    ("statement", "complaint"),
    [
        ("*(volatile uint32_t *)0x60000000u = 1u", "the core stopped at 0x8"),
        ("SW_BOARD_REGISTER(SW_BOARD_CAN + 0x010u) = 1u", "no register to write at 0x10"),
        ("(void)*(volatile uint8_t *)0x4000a018u", "accessed with 1 bytes"),
        ("SW_BOARD_REGISTER(SW_BOARD_CAN + 0x01cu) = 1u", "without INIT and CCE"),
    ],
)
def test_a_firmware_that_goes_wrong_is_an_error_in_one_line(sources, statement, complaint):
    wrong = sources["sw_board_main.c"].replace(b"sw_board_sleep(", statement.encode() + b"; sw_board_sleep(")
    with pytest.raises(McuError, match=complaint):
        BoardEcu(sources | {"sw_board_main.c": wrong})
