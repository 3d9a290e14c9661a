import os
from collections.abc import Iterator
from itertools import count
from threading import Event, Thread

import can
import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.backends.receive_thread import ReceiveThread
from can_bridge.bus.mailbox import Mailbox
from can_bridge.bus.rejection import Rejection
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from tests.can_bridge.bus.backends.ptys import adapter
from tests.refused import refused

CHANNELS = count()
PATIENCE_S = 10.0
"""How long a test waits for another thread before it fails; never reached when all is well."""


@pytest.fixture
def pair() -> Iterator[tuple[PythonCanBus, PythonCanBus]]:
    config = BusConfig(interface="virtual", channel=f"thread-{next(CHANNELS)}")
    with PythonCanBus.open(config) as one, PythonCanBus.open(config) as other:
        yield one, other


class Collector:
    """Keeps what is delivered and wakes the test when enough has come."""

    def __init__(self, wanted: int) -> None:
        self.frames: list[Frame] = []
        self.enough = Event()
        self._wanted = wanted

    def __call__(self, frame: Frame) -> None:
        self.frames.append(frame)
        if len(self.frames) == self._wanted:
            self.enough.set()


def test_delivers_in_order_and_stops(pair):
    one, other = pair
    frames = [Frame(frame_id=0x120, data=bytes([i]), timestamp_ns=i) for i in range(100)]
    collector = Collector(len(frames))
    with ReceiveThread(other, collector) as thread:
        for frame in frames:
            one.send(frame)
        assert collector.enough.wait(PATIENCE_S)
        thread.check()
    assert collector.frames == frames
    one.send(frames[0])
    assert other.receive_all() == [frames[0]]


class Failing(can.BusABC):
    """Raises what it is given, once, then is idle."""

    def __init__(self, error: BaseException) -> None:
        self.channel_info = "failing"
        self.error: BaseException | None = error
        self.raised = Event()
        self.polled_again = Event()
        super().__init__(channel="failing")
        self.shutdown()  # nothing to close: python-can would remind us of it

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self.error is not None:
            error, self.error = self.error, None
            self.raised.set()
            raise error
        self.polled_again.set()
        return None, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise NotImplementedError


def test_death_of_the_thread_is_kept_and_told():
    for error in [OSError(19, "No such device"), MemoryError("out of memory"), RuntimeError("bug")]:
        failing = Failing(error)
        with ReceiveThread(PythonCanBus(failing), lambda frame: None) as thread:
            assert failing.raised.wait(PATIENCE_S), error
            thread._thread.join(PATIENCE_S)
            assert not thread._thread.is_alive(), error
            with refused(BusError, "CAN reception ended"):
                thread.check()
        assert not failing.polled_again.is_set(), error


def test_serial_line_with_garbage_and_then_pulled_out():
    """Nothing before the end is lost; the end is a fault; both are told while the thread's frames are used."""
    mailbox: Mailbox[Frame] = Mailbox()
    collector = Collector(200)

    def deliver(frame: Frame) -> None:
        mailbox.put(frame)
        collector(frame)

    with adapter() as line:
        config = BusConfig(interface="slcan", channel=line.port)
        with PythonCanBus.open(config, settle_s=0.0) as bus, ReceiveThread(bus, deliver) as thread:
            for i in range(200):
                line.write(b"tzzz1AA\rr1208\r" + b"b1201" + f"{i:02X}".encode() + b"\r")
            assert collector.enough.wait(PATIENCE_S)
            thread.check()
            assert [frame.data[0] for frame in collector.frames] == list(range(200))
            latest = mailbox.take()
            assert latest is not None
            assert (latest.data[0], mailbox.overwritten) == (199, 199)
            counted = {reason: count for reason, count in bus.rejected.items() if count}
            assert counted == {Rejection.GARBAGE: 200, Rejection.REMOTE: 200}
            os.close(line.fd)
            thread._thread.join(PATIENCE_S)
            with pytest.raises(BusError, match=r"CAN reception ended: CAN bus failed: ."):
                thread.check()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_same_garbage_does_end_python_cans_notifier():
    """The reason for a thread of our own; should python-can mend this, the reason is gone."""
    failing = Failing(ValueError("garbage on the line"))
    notifier = can.Notifier(failing, [], timeout=0.01)
    try:
        assert failing.raised.wait(PATIENCE_S)
        for reader in notifier._readers:
            assert isinstance(reader, Thread)
            reader.join(PATIENCE_S)
        assert not failing.polled_again.is_set()
    finally:
        notifier.stop(timeout=0.1)
