import os
from threading import Event

import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.backends.receive_thread import ReceiveThread
from can_bridge.bus.rejection import Rejection
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from tests.can_bridge.bus.backends.ptys import PATIENCE_S, adapter
from tests.can_bridge.bus.backends.test_python_can import SOUND, ScriptedBus
from tests.refused import refused


def test_what_ends_the_thread_is_kept_and_raised():
    for error in [OSError(19, "No such device"), MemoryError("out of memory"), RuntimeError("bug")]:
        scripted = ScriptedBus([error, SOUND])
        with ReceiveThread(PythonCanBus(scripted), lambda frame: None) as thread:
            thread._thread.join(PATIENCE_S)
            assert not thread._thread.is_alive(), error
            with refused(BusError, "CAN reception ended"):
                thread.check()
        assert scripted.script == [SOUND], error


def test_serial_line_with_garbage_and_then_pulled_out():
    """Nothing before the end is lost; the end is a fault; both show while the thread's frames are used."""
    frames: list[Frame] = []
    enough = Event()

    def deliver(frame: Frame) -> None:
        frames.append(frame)
        if len(frames) == 200:
            enough.set()

    with adapter() as line:
        config = BusConfig(interface="slcan", channel=line.port)
        with PythonCanBus.open(config, settle_s=0.0) as bus, ReceiveThread(bus, deliver) as thread:
            for i in range(200):
                line.write(b"tzzz1AA\rr1208\r" + b"b1201" + f"{i:02X}".encode() + b"\r")
            assert enough.wait(PATIENCE_S)
            thread.check()
            assert [frame.data[0] for frame in frames] == list(range(200))
            counted = {reason: count for reason, count in bus.rejected.items() if count}
            assert counted == {Rejection.GARBAGE: 200, Rejection.REMOTE: 200}
            os.close(line.fd)
            thread._thread.join(PATIENCE_S)
            with pytest.raises(BusError, match=r"CAN reception ended: CAN bus failed: ."):
                thread.check()


def test_once_stopped_it_takes_no_more(pair):
    one, other = pair
    with ReceiveThread(other, lambda frame: None):
        pass
    one.send(Frame(frame_id=0x120, data=b""))
    assert len(other.receive_all()) == 1
