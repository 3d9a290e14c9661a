"""The adapter over python-can's in-process bus, and over buses that misbehave as the real backends do."""

from collections.abc import Iterable, Iterator
from itertools import count

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.bus.interface import Bus
from can_bridge.bus.python_can import GARBAGE_LIMIT, QUEUE_SIZE, PythonCanBus, from_message, to_message
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError

CHANNELS = count()


@pytest.fixture
def config() -> BusConfig:
    return BusConfig(interface="virtual", channel=f"test-{next(CHANNELS)}")


@pytest.fixture
def pair(config) -> Iterator[tuple[PythonCanBus, PythonCanBus]]:
    with PythonCanBus.open(config) as one, PythonCanBus.open(config) as other:
        yield one, other


FRAMES = st.builds(
    lambda is_fd, frame_id, payload, pick, time: Frame(
        frame_id=frame_id,
        data=payload.ljust(64, b"\0")[: (FD_LENGTHS if is_fd else CLASSIC_LENGTHS)[pick % (16 if is_fd else 9)]],
        timestamp_ns=time,
        is_fd=is_fd,
    ),
    st.booleans(),
    st.integers(0, 0x7FF),
    st.binary(max_size=64),
    st.integers(0, 15),
    # Twelve days: as far as a time in float seconds is exact to the ns.
    st.integers(0, 10**15),
)


@given(FRAMES)
def test_frame_survives_the_conversion_to_a_message_and_back(frame):
    message = to_message(frame)
    message._check()
    assert message.bitrate_switch == message.is_fd == frame.is_fd
    assert from_message(message) == frame


def test_frames_arrive_in_order_with_the_time_they_were_sent_at(pair):
    one, other = pair
    frames = [Frame(frame_id=i, data=bytes([i] * 12), timestamp_ns=i * 20_000_001) for i in range(50)]
    for frame in frames:
        one.send(frame)
    assert other.receive_all() == frames
    assert other.receive_all() == []
    assert one.receive_all() == []


def test_classic_frames_pass_too(pair):
    one, other = pair
    frame = Frame(frame_id=0x7E0, data=bytes(8), is_fd=False)
    one.send(frame)
    assert other.receive(1.0) == frame
    assert other.receive(0.0) is None


def test_only_accepted_ids_are_received_and_the_others_do_not_stop_it(config):
    with PythonCanBus.open(config) as one, PythonCanBus.open(config, accept=(0x120,)) as other:
        wanted = [Frame(frame_id=0x120, data=bytes([i])) for i in range(3)]
        for frame in wanted:
            one.send(Frame(frame_id=0x130, data=b""))
            one.send(frame)
        assert other.receive_all() == wanted
        assert other.rejected == 0


def test_peer_that_stops_reading_cannot_block_a_sender_for_ever(pair):
    one, other = pair
    frame = Frame(frame_id=0x120, data=bytes(16))
    for _ in range(QUEUE_SIZE):
        one.send(frame)
    with pytest.raises(BusError, match="0x120 was not sent"):
        one.send(frame, timeout_s=0.0)
    # Once the peer reads again, so does sending.
    assert len(other.receive_all()) == QUEUE_SIZE
    one.send(frame, timeout_s=0.0)
    assert other.receive_all() == [frame]


def test_negative_timeout_is_refused(pair):
    with pytest.raises(ValueError, match=r"timeout_s = -0\.1"):
        pair[0].send(Frame(frame_id=1, data=b""), timeout_s=-0.1)


def test_closed_bus_says_so(config):
    bus = PythonCanBus.open(config)
    bus.close()
    bus.close()
    with pytest.raises(BusError, match="closed"):
        bus.send(Frame(frame_id=1, data=b""))
    with pytest.raises(BusError, match="closed"):
        bus.receive_all()


def test_adapter_is_a_bus(pair):
    bus: Bus = pair[0]
    bus.send(Frame(frame_id=1, data=b""))
    assert len(pair[1].receive_all()) == 1


@pytest.mark.parametrize(
    ("interface", "channel"),
    [("socketcan", "no-such-can"), ("slcan", "/dev/no-such-port"), ("udp_multicast", "not an address")],
)
def test_bus_that_cannot_be_opened_is_named(interface, channel):
    with pytest.raises(BusError, match=f"CAN bus {interface} '{channel}'"):
        PythonCanBus.open(BusConfig(interface=interface, channel=channel))


@pytest.mark.parametrize(
    ("interface", "hint"),
    [
        ("udp_multicast", r"; try pip install 'python-can\[multicast\]'$"),
        ("slcan", r"; try pip install 'python-can\[serial\]'$"),
        ("socketcan", "not here$"),
    ],
)
def test_backend_that_is_not_installed_is_told_with_the_cure(monkeypatch, interface, hint):
    def missing(**options: object) -> None:
        raise can.CanInterfaceNotImplementedError("not here")

    monkeypatch.setattr(can, "Bus", missing)
    with pytest.raises(BusError, match=hint):
        PythonCanBus.open(BusConfig(interface=interface, channel="x"))


class ScriptedBus(can.BusABC):
    """A backend whose receptions are given: a message, None, or an error to raise."""

    def __init__(self, script: Iterable[can.Message | Exception | None]) -> None:
        self.script = list(script)
        self.flushed = 0
        self.channel_info = "scripted"
        super().__init__(channel="scripted")
        self.shutdown()  # nothing to close: python-can would remind us of it

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        item = self.script.pop(0) if self.script else None
        if isinstance(item, Exception):
            raise item
        return item, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanTimeoutError

    def flush(self) -> None:
        self.flushed += 1


def caused_by(error: Exception, cause: Exception) -> Exception:
    error.__cause__ = cause
    return error


SOUND = to_message(Frame(frame_id=0x120, data=bytes(16)))

GARBAGE: dict[str, can.Message | Exception] = {
    "udp_multicast, not msgpack": caused_by(can.CanOperationError("could not unpack received message"), ValueError()),
    "udp_multicast, a number": caused_by(can.CanOperationError("could not unpack"), AttributeError("update")),
    "slcan, no digits": ValueError("invalid literal for int() with base 16: 'zz'"),
    "slcan, cut off": IndexError("string index out of range"),
    "slcan, not text": caused_by(
        can.CanOperationError("Could not read"), UnicodeDecodeError("utf-8", b"\xff", 0, 1, "")
    ),
    "error frame": can.Message(is_error_frame=True),
    "remote frame": can.Message(arbitration_id=0x120, is_extended_id=False, is_remote_frame=True, dlc=8),
    "29-bit identifier": can.Message(arbitration_id=0x120, is_extended_id=True, data=bytes(8)),
    "data cut off": can.Message(arbitration_id=0x120, is_extended_id=False, data=bytes(3), dlc=8),
    "classic frame of 12": can.Message(arbitration_id=0x120, is_extended_id=False, data=bytes(12)),
    "FD frame of 9": can.Message(arbitration_id=0x120, is_extended_id=False, data=bytes(9), is_fd=True),
    "identifier too large": can.Message(arbitration_id=0x800, is_extended_id=False, data=b""),
    "time is no number": can.Message(arbitration_id=1, is_extended_id=False, data=b"", timestamp=float("nan")),
    "identifier is text": can.Message(
        arbitration_id="1",  # type: ignore[arg-type]  # as a datagram may hold it
        is_extended_id=False,
        data=b"",
    ),
}


@pytest.mark.parametrize("garbage", GARBAGE.values(), ids=GARBAGE)
def test_garbage_is_counted_and_what_follows_is_received(garbage):
    bus = PythonCanBus(ScriptedBus([garbage, SOUND, garbage, garbage, SOUND]))
    assert [frame.frame_id for frame in bus.receive_all()] == [0x120, 0x120]
    assert bus.rejected == 3
    bus = PythonCanBus(ScriptedBus([garbage, SOUND]))
    assert bus.receive(1.0) is not None
    assert bus.rejected == 1


def test_undecodable_line_is_flushed_out_of_the_backend():
    """slcan keeps it in a buffer and would raise on it at every further line."""
    scripted = ScriptedBus([GARBAGE["slcan, not text"], SOUND])
    assert len(PythonCanBus(scripted).receive_all()) == 1
    assert scripted.flushed == 1


@pytest.mark.parametrize(
    "fault",
    [
        OSError(19, "No such device"),
        caused_by(can.CanOperationError("Failed to wait for IP/UDP socket"), OSError(100, "Network is down")),
        can.CanOperationError("Cannot operate on a closed bus"),
    ],
)
def test_fault_of_the_system_is_raised(fault):
    bus = PythonCanBus(ScriptedBus([SOUND, fault]))
    with pytest.raises(BusError, match=r"CAN bus failed: ."):
        bus.receive_all()
    assert bus.rejected == 0


def test_backend_that_only_ever_stumbles_is_a_fault_in_the_end():
    bus = PythonCanBus(ScriptedBus([TypeError("'NoneType'") for _ in range(GARBAGE_LIMIT + 1)]))
    with pytest.raises(BusError, match="unreadable receptions in a row, last: 'NoneType'"):
        bus.receive_all()


@pytest.mark.parametrize("calm", [SOUND, None])
def test_as_much_garbage_as_the_limit_is_borne_again_and_again(calm):
    burst = [*[ValueError("noise")] * GARBAGE_LIMIT, calm]
    bus = PythonCanBus(ScriptedBus(burst * 3))
    for _ in range(3):
        bus.receive_all()
    assert bus.rejected == 3 * GARBAGE_LIMIT


def test_one_collection_is_bounded():
    bus = PythonCanBus(ScriptedBus([SOUND] * (QUEUE_SIZE + 1)))
    assert [len(bus.receive_all()) for _ in range(2)] == [QUEUE_SIZE, 1]


def test_noise_with_idle_moments_or_frames_is_borne_for_ever():
    script = [item for _ in range(GARBAGE_LIMIT) for item in (ValueError(), ValueError(), SOUND, ValueError(), None)]
    bus = PythonCanBus(ScriptedBus(script))
    assert sum(len(bus.receive_all()) for _ in range(GARBAGE_LIMIT)) == GARBAGE_LIMIT
    assert bus.rejected == 3 * GARBAGE_LIMIT


def test_send_that_times_out_without_a_word_is_still_named():
    with pytest.raises(BusError, match="0x120 was not sent: CanTimeoutError"):
        PythonCanBus(ScriptedBus([])).send(Frame(frame_id=0x120, data=b""))
