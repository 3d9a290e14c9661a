"""The adapter over python-can's in-process bus, and over buses that misbehave as the real backends do."""

import struct
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import pytest

from can_bridge.bus.backends.connection import GARBAGE_LIMIT, QUEUE_SIZE, open_backend
from can_bridge.bus.backends.python_can import RECEPTION_LIMIT, PythonCanBus, ReceiveThread, health_after, lost_frames
from can_bridge.bus.backends.slcan import SlcanBus
from can_bridge.bus.conversion import to_message
from can_bridge.bus.interface import HEALTHY, BusHealth, BusState, Rejection, UnusableReceptionError
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from tests.can_bridge.bus.backends.peers import PATIENCE_S, ScriptedBus, adapter, rejections
from tests.refused import refused


def test_frames_arrive_in_order_with_their_times_and_a_peer_that_stops_reading_blocks_no_sender_for_ever(pair):
    one, other = pair
    frames = [Frame(frame_id=0x120, data=bytes(16), timestamp_ns=i * 20_000_001) for i in range(QUEUE_SIZE)]
    for frame in frames:
        one.send(frame)
    with pytest.raises(BusError, match="0x120 was not sent"):
        one.send(frames[0], timeout_s=0.0)
    # Once the peer reads again, so does sending.
    assert other.receive_all() == frames
    one.send(frames[0], timeout_s=0.0)
    assert (other.receive_all(), one.receive_all()) == (frames[:1], [])
    one.close()
    one.close()
    for call in (lambda: one.send(frames[0]), one.receive_all):
        with pytest.raises(BusError, match="closed"):
            call()


SOUND = to_message(Frame(frame_id=0x120, data=bytes(16)))


def message(arbitration_id: Any, data: bytes = b"", **fields: Any) -> can.Message:
    return can.Message(**{"arbitration_id": arbitration_id, "is_extended_id": False, "data": data, **fields})


class CausedError(can.CanOperationError):
    def __init__(self, cause: Exception) -> None:
        super().__init__("could not unpack received message")
        self.__cause__ = cause


REFUSED: dict[Rejection, list[can.Message | Exception]] = {
    Rejection.GARBAGE: [
        *(CausedError(ValueError()), ValueError("invalid literal for int() with base 16: 'zz'")),
        *(IndexError("string index out of range"), struct.error("unpack requires a buffer of 4 bytes")),
        CausedError(UnicodeDecodeError("utf-8", b"\xff", 0, 1, "")),
        *(message(0x800), message("1"), message(1.5), message(1, timestamp=float("nan"))),
    ],
    Rejection.ADAPTER: [UnusableReceptionError(Rejection.ADAPTER)],
    Rejection.ERROR_FRAME: [can.Message(is_error_frame=True)],
    Rejection.REMOTE: [message(0x120, is_remote_frame=True, dlc=8)],
    Rejection.EXTENDED: [message(0x120, bytes(8), is_extended_id=True)],
    # Cut off, and lengths that classic CAN and CAN FD do not have.
    Rejection.WRONG_LENGTH: [message(1, bytes(3), dlc=8), message(1, bytes(12)), message(1, bytes(9), is_fd=True)],
    # Our CAN FD message as a classic one, and the reverse.
    Rejection.WRONG_FORMAT: [message(0x120, bytes(8)), message(0x121, bytes(8), is_fd=True)],
}
"""Messages as the backends of python-can are known to give them."""


def test_what_is_refused_is_counted_by_reason_and_what_follows_is_received():
    for reason, receptions in REFUSED.items():
        for one in receptions:
            bus = PythonCanBus(ScriptedBus([one, SOUND, one, one, SOUND]))
            assert bus.receive(1.0) is not None, one
            assert rejections(bus) == {reason: 1}, one
            assert [frame.frame_id for frame in bus.receive_all()] == [0x120], one
            assert rejections(bus) == {reason: 3}, one
            assert (bus.received, bus.accepted) == (5, 2), one


def test_what_is_no_garbage_is_raised():
    for fault in [
        OSError(19, "No such device"),
        CausedError(OSError(100, "Network is down")),
        can.CanOperationError("Cannot operate on a closed bus"),
        # An error of ours, also where python-can would wrap it.
        CausedError(AttributeError("update")),
        *(AttributeError("update"), TypeError("'NoneType'"), KeyError("x")),
    ]:
        bus = PythonCanBus(ScriptedBus([SOUND, fault]))
        is_the_systems = isinstance(fault, OSError | can.CanError)
        with refused(*((BusError, "CAN bus failed: .") if is_the_systems else (type(fault), "."))):
            bus.receive_all()
        assert rejections(bus) == {}, fault


def test_classic_bus_takes_and_sends_classic_frames_of_accepted_ids_alone():
    fd, classic = Frame(frame_id=0x7E0, data=bytes(8)), Frame(frame_id=0x121, data=bytes(8), is_fd=False)
    script = [to_message(one) for one in (fd, replace(classic, frame_id=0x131), classic)]
    bus = PythonCanBus(ScriptedBus(script), is_classic=True, accept=(0x121, 0x7E0))
    assert bus.receive_all() == [classic]
    assert rejections(bus) == {Rejection.WRONG_FORMAT: 1, Rejection.OTHER_ID: 1}
    with pytest.raises(BusError, match=r"0x7e0 was not sent: it is CAN FD, but bus\.frames = classic"):
        bus.send(fd)
    with pytest.raises(BusError, match="0x121 was not sent: CanTimeoutError"):
        bus.send(classic)


def test_error_frames_of_socketcan_are_about_the_controllers_health():
    # CAN_ERR_CRTL | CAN_ERR_CNT with CAN_ERR_CRTL_TX_PASSIVE, then with RX_OVERFLOW.
    passive, overflow = (
        can.Message(is_error_frame=True, arbitration_id=0x204, data=[0, what, 0, 0, 0, 0, 130, rx_errors])
        for what, rx_errors in ((0x20, 7), (0x01, 9))
    )
    script = [passive, SOUND, overflow]
    bus = PythonCanBus(ScriptedBus(script), linux_error_frames=True)
    assert bus.health() == HEALTHY
    assert len(bus.receive_all()) == 1
    assert bus.health() == BusHealth(state=BusState.ERROR_PASSIVE, tx_errors=130, rx_errors=9)
    assert (bus.overflows, rejections(bus)) == (1, {Rejection.ERROR_FRAME: 2})
    # From elsewhere they mean something else, or another node.
    other = PythonCanBus(ScriptedBus(script))
    other.receive_all()
    assert (other.health(), other.overflows) == (HEALTHY, 0)


def test_bus_off_that_a_driver_reports_is_counted_when_it_comes():
    scripted = ScriptedBus([])
    bus = PythonCanBus(scripted)
    seen = []
    for state in (can.BusState.ERROR, can.BusState.ERROR, can.BusState.ACTIVE, can.BusState.ERROR):
        scripted.state = state
        seen.append((bus.health().state, bus.health().bus_off))
    off, active = BusState.BUS_OFF, BusState.ERROR_ACTIVE
    assert seen == [(off, 1), (off, 1), (active, 1), (off, 2)]
    # Of python-can's drivers, pcan, ixxat and systec report PASSIVE for a node that may only listen.
    scripted.state = can.BusState.PASSIVE
    assert bus.health().state is active


def test_garbage_up_to_a_limit_in_a_row_and_any_flood_of_what_our_backends_refuse_are_borne():
    garbage = [ValueError("noise")] * GARBAGE_LIMIT
    for calm in [SOUND, None]:
        bus = PythonCanBus(ScriptedBus([*garbage, calm, *garbage]))
        bus.receive_all()
        bus.receive_all()
        assert rejections(bus) == {Rejection.GARBAGE: 2 * GARBAGE_LIMIT}, calm
    with pytest.raises(BusError, match="unreadable receptions in a row; the last error is: noise"):
        PythonCanBus(ScriptedBus([*garbage, ValueError("noise")])).receive_all()
    # A flood on the wire is no fault of the backend; yet one collection ends.
    bus = PythonCanBus(ScriptedBus([*[UnusableReceptionError(Rejection.GARBAGE)] * RECEPTION_LIMIT, SOUND]))
    assert (bus.receive_all(), rejections(bus)) == ([], {Rejection.GARBAGE: RECEPTION_LIMIT})
    assert len(bus.receive_all()) == 1


def test_what_ends_the_thread_is_kept_and_raised():
    for error in [OSError(19, "No such device"), MemoryError("out of memory"), RuntimeError("bug")]:
        scripted = ScriptedBus([error, SOUND])
        with ReceiveThread(PythonCanBus(scripted), lambda frame: None) as thread:
            thread._thread.join(PATIENCE_S)
            assert not thread._thread.is_alive(), error
            with refused(BusError, "CAN reception ended"):
                thread.check()
        assert scripted.script == [SOUND], error


TX_TIMEOUT, LOSTARB, CRTL, PROT, ACK = 0x001, 0x002, 0x004, 0x008, 0x020
BUSOFF, BUSERROR, RESTARTED, CNT = 0x040, 0x080, 0x100, 0x200
"""CAN_ERR_..."""
RX_OVERFLOW, TX_OVERFLOW, RX_WARNING, TX_WARNING = 0x01, 0x02, 0x04, 0x08
RX_PASSIVE, TX_PASSIVE, CRTL_ACTIVE = 0x10, 0x20, 0x40
"""CAN_ERR_CRTL_..."""

ACTIVE, PASSIVE, OFF = BusState.ERROR_ACTIVE, BusState.ERROR_PASSIVE, BusState.BUS_OFF


def data(controller: int = 0, tx: int = 0, rx: int = 0) -> bytes:
    return bytes([0, controller, 0, 0, 0, 0, tx, rx])


def after(*frames: tuple[int, bytes]) -> BusHealth:
    health = HEALTHY
    for classes, content in frames:
        health = health_after(health, classes, content)
    return health


def test_state_and_counters_of_the_controller():
    for controller, state in [
        *((controller, ACTIVE) for controller in (RX_WARNING, TX_WARNING, TX_OVERFLOW, CRTL_ACTIVE)),
        *((controller, PASSIVE) for controller in (RX_PASSIVE, TX_PASSIVE, RX_PASSIVE | TX_PASSIVE)),
    ]:
        health = after((CRTL | CNT, data(controller, 100, 17)))
        assert health == BusHealth(state=state, tx_errors=100, rx_errors=17), controller
    # Passive by its transmit errors, it reports a warning of its receive errors.
    assert after((CRTL, data(TX_PASSIVE)), (CRTL, data(RX_WARNING))).state is PASSIVE
    assert after((CRTL, data(TX_PASSIVE)), (CRTL, data(CRTL_ACTIVE))).state is ACTIVE
    # Bus-off is counted, until the restart and across it.
    off = (BUSOFF | CNT, data(tx=248))
    assert after(off) == BusHealth(state=OFF, tx_errors=248, bus_off=1)
    assert after(off, (CRTL, data(TX_PASSIVE))).state is OFF
    assert after(off, (RESTARTED, data())) == BusHealth(bus_off=1)
    assert after(off, (RESTARTED, data()), off) == BusHealth(state=OFF, tx_errors=248, bus_off=2)
    # Older kernels give counters without the flag; zeros may mean that the driver does not know.
    assert after((CRTL, data(RX_WARNING, 0, 96))).rx_errors == 96
    known = (CRTL | CNT, data(0, 5, 6))
    assert after(known, (CRTL, data(RX_WARNING))).rx_errors == 6
    assert after(known, (CRTL | CNT, data())) == HEALTHY
    # Other classes do not concern the controller.
    assert lost_frames(CRTL, data(RX_OVERFLOW))
    assert not lost_frames(CRTL, data(TX_OVERFLOW))
    for classes in [TX_TIMEOUT, LOSTARB, PROT, ACK, BUSERROR]:
        # Byte 1 means other things there.
        assert after((classes, data(TX_PASSIVE))) == HEALTHY, classes
        assert not lost_frames(classes, data(RX_OVERFLOW)), classes


def test_bus_that_cannot_be_opened_is_named_in_one_line(monkeypatch):
    for interface, channel, message in [
        ("simulated", "x", r"bus\.interface = simulated: .* must be one of python-can, .*socketcan"),
        ("socketcan", "no-such-can", r"CAN bus socketcan 'no-such-can': ."),
        ("slcan", "/dev/no-such-port", r"CAN bus slcan '/dev/no-such-port': ."),
        ("udp_multicast", "not an address", r"CAN bus udp_multicast 'not an address': ."),
        ("pcan", "PCAN_USBBUS1", r"CAN bus pcan 'PCAN_USBBUS1': ."),
    ]:
        with refused(BusError, message) as caught:
            PythonCanBus.open(BusConfig(interface=interface, channel=channel))
        assert str(caught.value).isprintable(), (interface, channel)
    # Without the extra `bus`.
    for name in [*sys.modules]:
        if name.startswith(("can.interfaces.slcan", "can_bridge.bus.backends.slcan")):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(BusError, match=r"serial.*; pip install '(stillwake|\.)\[bus\]'"):
        PythonCanBus.open(BusConfig(interface="slcan", channel="x"))


def test_drivers_are_given_format_and_bit_rates(monkeypatch):
    for frames, expected in (
        ("fd", {"fd": True, "bitrate": 500_000, "data_bitrate": 2_000_000}),
        ("classic", {"fd": False, "bitrate": 500_000}),
    ):
        asked: dict[str, object] = {}
        monkeypatch.setattr(can, "Bus", lambda asked=asked, **options: asked.update(options))
        open_backend(BusConfig(interface="kvaser", channel="0", frames=frames))  # type: ignore[arg-type]
        assert asked == {"interface": "kvaser", "channel": "0", "ignore_config": True, **expected}, frames


def test_can_conf_chooses_the_bus_and_our_backend_and_is_refused_without_a_bus(tmp_path, monkeypatch):
    path = tmp_path / "can.conf"
    monkeypatch.setattr(can.util, "CONFIG_FILES", [str(path)])
    for name in ("CAN_INTERFACE", "CAN_CHANNEL", "CAN_BITRATE", "CAN_CONFIG"):
        monkeypatch.delenv(name, raising=False)
    with adapter() as line:
        path.write_text(
            "[default]\ninterface = udp_multicast\n"
            f"[bench]\ninterface = slcan\nchannel = {line.port}\nsleep_after_open = 0\nbitrate = 250000\n"
        )
        with PythonCanBus.open(BusConfig(interface="python-can", channel="bench")) as bus:
            assert isinstance(bus._bus, SlcanBus)
            assert b"S5\r" in line.read(b"O\r", 2)
            bus.send(Frame(frame_id=0x120, data=b"12"))
            assert line.read(b"\r") == b"b12023132\r"
    for text in ["", "[default]\ninterface = no-such\n", "[default]\nchannel = can0\n", "no section\n"]:
        path.write_text(text)
        with refused(BusError, r"CAN bus python-can 'stillwake': .") as caught:
            PythonCanBus.open(BusConfig(interface="python-can"))
        assert str(caught.value).isprintable(), text


CHANNEL = "vcan0"
"""A virtual CAN network, if there is one: docs/how-to/use-a-real-bus.md."""


@pytest.mark.skipif(
    not Path("/sys/class/net", CHANNEL).exists(),
    reason=f"there is no {CHANNEL}: sudo ip link add dev {CHANNEL} type vcan; sudo ip link set up mtu 72 {CHANNEL}",
)
def test_over_socketcan_frames_of_both_formats_pass_and_others_are_refused_by_reason():
    config = BusConfig(interface="socketcan", channel=CHANNEL)
    with PythonCanBus.open(config) as one, PythonCanBus.open(config) as other:
        frames = [Frame(frame_id=0x5A5, data=bytes(12)), Frame(frame_id=0x5A6, data=bytes(8), is_fd=False)]
        for frame in frames:
            one.send(frame)
        one._bus.send(can.Message(arbitration_id=0x5A7, is_extended_id=True))
        one._bus.send(can.Message(arbitration_id=0x5A7, is_extended_id=False, is_remote_frame=True))
        one._bus.send(can.Message(arbitration_id=0x130, is_extended_id=False, data=bytes(8)))
        got = [frame for frame in (other.receive(10.0), other.receive(10.0)) if frame is not None]
        assert [replace(frame, timestamp_ns=0) for frame in got] == frames
        assert other.receive(0.2) is None
        assert rejections(other) == {Rejection.EXTENDED: 1, Rejection.REMOTE: 1, Rejection.WRONG_FORMAT: 1}
        assert one.receive_all() == []
        assert (other.health(), other.overflows) == (HEALTHY, 0)
