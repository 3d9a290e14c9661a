"""SocketCAN, on a virtual CAN network where there is one: docs/how-to/use-a-real-bus.md."""

from dataclasses import replace
from pathlib import Path

import can
import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.interface import HEALTHY, Rejection
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from tests.can_bridge.bus.backends.peers import rejections

CHANNEL = "vcan0"

pytestmark = pytest.mark.skipif(
    not Path("/sys/class/net", CHANNEL).exists(),
    reason=f"there is no {CHANNEL}: sudo ip link add dev {CHANNEL} type vcan; sudo ip link set up mtu 72 {CHANNEL}",
)


def test_frames_of_both_formats_pass_and_others_are_refused_by_reason():
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
