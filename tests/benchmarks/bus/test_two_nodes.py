"""Two processes over what this machine has: frames counted, none lost."""

import os
from random import Random

import pytest

from benchmarks.bus import serial_wire, two_nodes
from benchmarks.bus.two_nodes import Counts, lost, run
from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.rejection import Rejection
from can_bridge.wire.frame import Frame
from contract.config.vehicle import BusConfig
from contract.errors import BusError

# Each starts a process and runs for a second.
pytestmark = pytest.mark.processes

PERIODS = 200
PERIOD_S = 0.005
"""A quarter of the design's, to be short."""
GROUP = f"239.75.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF}"
"""A group of this process alone."""


def exchanged(config: BusConfig, garbage: int = 0) -> Counts:
    return run(config, periods=PERIODS, period_s=PERIOD_S, garbage=garbage)


def assert_complete(counts: Counts) -> None:
    for name in ("pressures", "commands"):
        row = counts[name]
        assert (row["sent"], row["good"], row["other_checks"], row["overflows"]) == (PERIODS, PERIODS, {}, 0)
    assert lost(counts) == 0


@pytest.fixture
def multicast() -> BusConfig:
    config = BusConfig(interface="udp_multicast", channel=GROUP)
    try:
        with PythonCanBus.open(config) as one, PythonCanBus.open(config) as other:
            one.send(Frame(frame_id=1, data=b""))
            if other.receive(1.0) is None:
                pytest.skip("multicast does not loop back here")
    except BusError as error:
        pytest.skip(f"no multicast here: {error}")
    return config


def test_udp_multicast(multicast):
    counts = exchanged(multicast, garbage=2)
    assert_complete(counts)
    for name in ("pressures", "commands"):
        refused = dict(counts[name]["refused"])
        # Each node hears its own frames again, and all of the third party's.
        assert refused.pop(Rejection.OWN.value) == PERIODS
        assert sum(refused.values()) == 2 * PERIODS


@pytest.mark.proofs  # two processes, as of the bus above
def test_serial_adapters():
    counts = exchanged(BusConfig(interface="slcan", channel="pty", frames="classic"), garbage=1)
    assert_complete(counts)
    for name in ("pressures", "commands"):
        assert sum(counts[name]["refused"].values()) == PERIODS


def test_bus_that_the_other_process_cannot_open_is_told_here():
    with pytest.raises(BusError, match="no-such-can"):
        exchanged(BusConfig(interface="socketcan", channel="no-such-can"))


@pytest.mark.proofs  # the same
def test_loss_is_seen(monkeypatch):
    """A planted one: every seventh frame or so is cut on its way."""
    rng = Random(0)

    class Cutting(serial_wire.SerialWire):
        def _say(self, fd: int, content: bytes) -> None:
            cut = content.startswith(b"b") and rng.random() < 1 / 7
            super()._say(fd, content[:-5] + b"\r" if cut else content)

    monkeypatch.setattr(two_nodes, "SerialWire", Cutting)
    counts = exchanged(BusConfig(interface="slcan", channel="pty"))
    assert lost(counts) > PERIODS // 10
    for name in ("pressures", "commands"):
        assert counts[name]["refused"].keys() == {Rejection.WRONG_LENGTH.value}
