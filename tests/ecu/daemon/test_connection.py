"""A bus that goes and comes back: a serial adapter on a pseudo-terminal, pulled out and plugged in again."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import can

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.interface import BusState
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError
from ecu.daemon.connection import Connection
from tests.can_bridge.bus.backends.peers import adapter
from tests.ecu.daemon.conftest import wait_for

FRAME = Frame(frame_id=0x130, data=bytes(8))
LINE = b"b12091122334455667788990A0B0C\r"


def told_by(connection: Connection) -> tuple[str, str]:
    """Event and text of what it reports next."""
    told: list[tuple[str, str]] = []
    wait_for(lambda: connection.look(lambda event, text, **fields: told.append((event, text))) or told)
    return told[0]


def nothing(event: str, text: str, **fields: object) -> None:
    raise AssertionError(text)


def test_a_serial_adapter_that_is_pulled_out_and_plugged_in_again(tmp_path: Path):
    port = tmp_path / "ttyACM0"
    config = BusConfig(interface="slcan", channel=str(port))
    heard: list[Frame] = []
    with adapter() as first:
        port.symlink_to(first.port)
        connection = Connection(lambda: PythonCanBus.open(config), heard.append, first_pause_s=0.01).__enter__()
        assert connection.send([FRAME])
        first.write(LINE)
        wait_for(lambda: len(heard) == 1)
        assert not connection.look(nothing)
        os.close(first.fd)
        port.unlink()
        event, text = told_by(connection)
        assert event == "bus_lost" and "CAN bus failed" in text
    assert (connection.health().state, connection.health().bus_off) == (BusState.BUS_OFF, 1)
    assert not connection.send([FRAME, FRAME])
    assert (connection.not_sent, connection.why_not_sent) == (2, "the bus is lost")
    assert not connection.look(nothing)
    with adapter() as second:
        port.symlink_to(second.port)
        assert told_by(connection)[0] == "bus_back"
        assert (connection.health().state, connection.health().bus_off) == (BusState.ERROR_ACTIVE, 1)
        assert connection.losses == 1
        second.write(LINE)
        wait_for(lambda: len(heard) == 2)
        assert connection.send([FRAME])
        connection.__exit__(None, None, None)


def test_a_loss_that_another_thread_finds_during_a_send_is_no_error():
    class Racing(Connection):
        """It loses its bus behind the first look at it."""

        there: Any = None

        @property
        def _bus(self):
            found, self.there = self.there, None
            return found

        @_bus.setter
        def _bus(self, read):
            self.there = read

    bus = BusConfig(interface="virtual", channel="racing")
    connection = Racing(lambda: PythonCanBus.open(bus), print).__enter__()
    read = connection.there
    assert connection.send([FRAME])
    assert not connection.send([FRAME])
    read.close()


def test_attempts_come_ever_more_rarely_and_end_with_the_connection(monkeypatch):
    waits: list[float] = []
    opened = [can.Bus(interface="virtual", channel="rarely", protocol=can.CanProtocol.CAN_FD)]
    connection = Connection(lambda: PythonCanBus(opened[-1]), print, first_pause_s=0.01)

    def waited(pause_s: float) -> bool:
        waits.append(pause_s)
        # The last one for real: its pause is far longer than the end takes.
        return len(waits) > 12 and wait(3600.0)

    with connection:
        wait = connection._closing.wait
        monkeypatch.setattr(connection, "_open", lambda: PythonCanBus.open(BusConfig(interface="socketcan")))
        monkeypatch.setattr(connection._closing, "wait", waited)
        opened[-1].shutdown()
        assert told_by(connection)[0] == "bus_lost"
        wait_for(lambda: len(waits) == 13)
    assert (waits[:4], waits[-1]) == ([0.01, 0.02, 0.04, 0.08], 5.0)
    with suppress(BusError):
        opened[-1].shutdown()
