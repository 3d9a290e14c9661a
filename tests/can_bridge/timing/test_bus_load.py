"""Load and response times of our own sets of messages, by hand, and with background traffic."""

import pytest

from can_bridge.timing.bus_load import bus_load, loop_messages, mean_ns
from can_bridge.timing.response_time import PeriodicMessage
from contract.config.tree import Config
from contract.config.vehicle import BackgroundConfig, BusConfig, EcuConfig
from contract.errors import ConfigError
from tests.refused import refused

PERIOD_NS = Config().period_ns


def config(*, load=0.0, seed=0, compute_ms=8.0, **bus):
    return Config(
        bus=BusConfig(background=BackgroundConfig(load=load, seed=seed), **bus),
        ecu=EcuConfig(compute_time_ms=compute_ms),
    )


def test_classic_set_by_hand():
    """Four frames of 8 bytes: 135 bits, 270 us at 500 kbit/s. The pressures wait for one, the speed for two of them."""
    loaded = bus_load(config(frames="classic"))
    frame = 270_000
    assert [one.worst_ns for one in loaded.messages] == [frame] * 4
    # The answers come as late as the pressures may, perhaps behind the vehicle's next frames and each other.
    assert [one.message.jitter_ns for one in loaded.messages] == [0, 0, 2 * frame, 2 * frame]
    assert [one.response.response_ns for one in loaded.messages] == [2 * frame, 3 * frame, 6 * frame, 6 * frame]
    # The command has the period but for the compute time.
    deadlines = [PERIOD_NS, PERIOD_NS, PERIOD_NS - 8_000_000, PERIOD_NS]
    assert [one.response.deadline_ns for one in loaded.messages] == deadlines
    assert loaded.worst == pytest.approx(4 * frame / PERIOD_NS)
    assert not loaded.late


def test_settings_choose_the_set():
    for bus, ending, lengths in [
        ({}, "", (16, 8, 8, 24)),
        ({"key": "any.key"}, "Secured", (32, 24, 24, 48)),
        ({"frames": "classic"}, "Classic", (8, 8, 8, 8)),
    ]:
        names = tuple(name + ending for name in ("Pressure", "VehicleSpeed", "JetCommand", "EcuStatus"))
        loaded = bus_load(config(**bus))
        assert tuple(one.message.name for one in loaded.messages) == names, bus
        assert tuple(one.message.length for one in loaded.messages) == lengths, bus
        assert all(one.ours and one.message.period_ns == PERIOD_NS for one in loaded.messages), bus
        assert 0.02 < loaded.mean < loaded.worst < 0.06, bus
        # Background traffic makes nothing of ours earlier.
        busy = bus_load(config(load=0.3, seed=3, **bus))
        before, after = ([one.response.response_ns or 10**12 for one in a.messages if one.ours] for a in (loaded, busy))
        assert all(late >= early for early, late in zip(before, after, strict=True)), bus
        assert busy.mean < busy.worst <= loaded.worst + 0.3 + 1e-9, bus  # sums of floats
    for compute_ms in [PERIOD_NS / 1e6, 1e12]:
        with refused(ConfigError, r"ecu\.compute_time_ms = .*: must be less than a control period, 20 ms"):
            bus_load(config(compute_ms=compute_ms))


def test_traffic_above_ours_reaches_the_answers_through_the_pressures():
    above = PeriodicMessage(name="Above", frame_id=1, is_fd=True, length=64, period_ns=10**9)
    pressure, speed, command, status = loop_messages(config(), [above])
    alone = loop_messages(config())
    # Once a second it goes ahead of the pressures, and no longer one of ours is what blocks them.
    assert command.jitter_ns == alone[2].jitter_ns + above.worst_ns(config().bus)
    assert status.jitter_ns == command.jitter_ns
    assert (pressure, speed) == alone[:2]


def test_mean_length_is_that_of_many_contents():
    """Random bits: a run of five begins at one bit of 16 on average at most, so 98 bits need three stuff bits or so."""
    message = PeriodicMessage(name="Some", frame_id=0x2AA, is_fd=False, length=8, period_ns=10**9)
    assert 111_000 < mean_ns(message, BusConfig(nominal_bitrate=1_000_000)) < (111 + 98 / 16) * 1000
