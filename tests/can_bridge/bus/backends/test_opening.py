"""From settings to a bus: what is opened, and the error where it cannot be."""

import sys

import can
import pytest

from can_bridge.bus.backends.connection import open_backend
from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.backends.slcan import SlcanBus
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from tests.can_bridge.bus.backends.ptys import adapter
from tests.refused import refused


def test_bus_that_cannot_be_opened_is_named_in_one_line(monkeypatch):
    for interface, channel, message in [
        ("simulated", "x", r"bus\.interface = simulated: .* must be one of python-can, .*socketcan"),
        ("canopy", "x", r"bus\.interface = canopy: .*must be one of simulated, python-can, .*virtual"),
        ("socketcan", "no-such-can", r"CAN bus socketcan 'no-such-can': ."),
        ("slcan", "/dev/no-such-port", r"CAN bus slcan '/dev/no-such-port': ."),
        ("slcan", "/dev/null@fast", r"CAN bus slcan '/dev/null@fast': ."),
        ("udp_multicast", "not an address", r"CAN bus udp_multicast 'not an address': ."),
        ("pcan", "PCAN_USBBUS1", r"CAN bus pcan 'PCAN_USBBUS1': ."),
    ]:
        with refused(BusError, message) as caught:
            PythonCanBus.open(BusConfig(interface=interface, channel=channel), settle_s=0.0)
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
