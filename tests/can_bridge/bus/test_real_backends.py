"""udp_multicast and slcan as they are; skipped where python-can's extras are not installed."""

import os
import pty
import socket

import can
import pytest

from can_bridge.bus.python_can import PythonCanBus
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError

GROUP, PORT = "239.74.163.2", 43113
PATIENCE_S = 10.0


def test_udp_multicast_survives_garbage_datagrams():
    pytest.importorskip("msgpack")
    from can.interfaces.udp_multicast import UdpMulticastBus

    config = BusConfig(interface="udp_multicast", channel=GROUP)
    # An identifier of this process alone: other tests may use the group at the same time.
    frame_id = os.getpid() % 0x800
    try:
        one, other = PythonCanBus.open(config), PythonCanBus.open(config, accept=(frame_id,))
    except BusError as error:
        pytest.skip(f"no multicast here: {error}")
    assert isinstance(one._bus, UdpMulticastBus)
    assert one._bus._multicast.hop_limit == 0
    with one, other, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as raw:
        raw.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        frame = Frame(frame_id=frame_id, data=b"stillwake000")
        one.send(frame)
        if (first := other.receive(1.0)) is None:
            pytest.skip("multicast does not loop back here")
        for garbage in (b"", b"\x00", b"garbage", b"\xff" * 100, b"\x81\xa1x\x01"):
            raw.sendto(garbage, (GROUP, PORT))
        one.send(frame)
        second = other.receive(PATIENCE_S)
        for got in (first, second):
            assert got is not None
            assert (got.frame_id, got.data, got.is_fd) == (frame.frame_id, frame.data, True)
        assert other.rejected >= 5


def test_slcan_survives_garbage_lines():
    pytest.importorskip("serial")
    from can.interfaces.slcan import slcanBus

    controller, port = pty.openpty()
    with PythonCanBus(slcanBus(os.ttyname(port), sleep_after_open=0.0, timeout=0.05)) as bus:
        frame = Frame(frame_id=0x120, data=bytes(range(12)))
        os.read(controller, 100)
        bus.send(frame)
        sent = os.read(controller, 100)
        assert sent == b"b1209000102030405060708090A0B\r"
        for garbage in (b"tzzz1AA\r", b"t\r", b"t12\r", b"b12\xff\xfe\r", b"t1238AA\r", b"t1239" + b"AA" * 9 + b"\r"):
            os.write(controller, garbage)
            assert bus.receive(0.2) is None
        assert bus.rejected == 6
        os.write(controller, sent)
        got = bus.receive(PATIENCE_S)
        assert got is not None
        assert (got.frame_id, got.data, got.is_fd) == (0x120, frame.data, True)
    os.close(controller)
    os.close(port)


def test_configuration_file_of_the_user_changes_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / ".canrc").write_text("[default]\nreceive_own_messages = True\n")
    monkeypatch.setattr(can.util, "PATH_SEARCH_CONFIG", [str(tmp_path / ".canrc")], raising=False)
    with PythonCanBus.open(BusConfig(interface="virtual", channel="canrc")) as bus:
        bus.send(Frame(frame_id=1, data=b""))
        assert bus.receive_all() == []
