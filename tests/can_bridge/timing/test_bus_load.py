"""Load and response times of our own sets of messages, by hand, and with background traffic."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.timing.bus_load import bus_load, loop_messages, mean_ns
from can_bridge.timing.periodic_message import PeriodicMessage
from contract.config.tree import Config
from contract.config.vehicle import BackgroundConfig, BusConfig, EcuConfig
from contract.errors import ConfigError
from tests.examples import examples
from tests.refused import refused

PERIOD_NS = Config().period_ns


def config(*, load=0.0, seed=0, compute_ms=8.0, **bus):
    return Config(
        bus=BusConfig(background=BackgroundConfig(load=load, seed=seed), **bus),
        ecu=EcuConfig(compute_time_ms=compute_ms),
    )


def responses(found):
    return {one.message.name: one.response.response_ns for one in found.messages}


def test_classic_set_by_hand():
    """Three frames of 8 bytes: 135 bits, 270 us at 500 kbit/s. The pressures wait for one of them."""
    found = bus_load(config(frames="classic"))
    frame = 270_000
    assert [one.worst_ns for one in found.messages] == [frame] * 3
    pressure, command, status = found.messages
    assert pressure.response.response_ns == 2 * frame
    # The answers come as late as the pressures may; the pressures' next frame can go ahead of them, and the status can
    # block the command or follow it.
    assert command.message.jitter_ns == status.message.jitter_ns == 2 * frame
    assert command.response.response_ns == 2 * frame + 3 * frame
    assert status.response.response_ns == 2 * frame + 3 * frame
    assert found.worst == pytest.approx(3 * frame / PERIOD_NS)
    assert not found.late


def test_settings_choose_the_set():
    for bus, names, lengths in [
        ({}, ("Pressure", "JetCommand", "EcuStatus"), (16, 8, 24)),
        ({"key": "any.key"}, ("PressureSecured", "JetCommandSecured", "EcuStatusSecured"), (32, 24, 48)),
        ({"frames": "classic"}, ("PressureClassic", "JetCommandClassic", "EcuStatusClassic"), (8, 8, 8)),
    ]:
        found = bus_load(config(**bus))
        assert tuple(one.message.name for one in found.messages) == names, (bus, names, lengths)
        assert tuple(one.message.length for one in found.messages) == lengths, (bus, names, lengths)
        assert all(one.ours and one.message.period_ns == PERIOD_NS for one in found.messages), (bus, names, lengths)
        assert 0.02 < found.mean < found.worst < 0.06, (bus, names, lengths)


def test_the_command_has_the_period_but_for_the_compute_time():
    deadlines = [one.response.deadline_ns for one in bus_load(config(compute_ms=8.0)).messages]
    assert deadlines == [PERIOD_NS, PERIOD_NS - 8_000_000, PERIOD_NS]


def test_computing_for_a_whole_period_is_refused():
    for compute_ms in [PERIOD_NS / 1e6, 1e308]:
        with refused(ConfigError, r"ecu\.compute_time_ms = .*: must be less than a control period, 20 ms"):
            bus_load(config(compute_ms=compute_ms))


@examples(25)  # a hundred messages each
@given(load=st.floats(0.05, 0.9), seed=st.integers(0, 1000), frames=st.sampled_from(["fd", "classic"]))
def test_background_makes_nothing_of_ours_earlier(load, seed, frames):
    alone, beside = bus_load(config(frames=frames)), bus_load(config(load=load, seed=seed, frames=frames))
    before, after = responses(alone), responses(beside)
    assert all(after[name] is None or after[name] >= before[name] for name in before)
    assert beside.worst <= alone.worst + load + 1e-9  # sums of floats
    assert beside.mean < beside.worst


def test_traffic_above_ours_reaches_the_answers_through_the_pressures():
    above = PeriodicMessage(name="Above", frame_id=1, is_fd=True, length=64, period_ns=10**9)
    pressure, command, status = loop_messages(config(), [above])
    alone = loop_messages(config())
    # Once a second it goes ahead of the pressures, and no longer one of ours is what blocks them.
    assert command.jitter_ns == alone[1].jitter_ns + above.worst_ns(config().bus)
    assert status.jitter_ns == command.jitter_ns
    assert pressure == alone[0]


def test_mean_length_is_that_of_many_contents():
    """Random bits: a run of five begins at one bit of 16 on average at most, so 98 bits need three stuff bits or so."""
    message = PeriodicMessage(name="Some", frame_id=0x2AA, is_fd=False, length=8, period_ns=10**9)
    bus = BusConfig(nominal_bitrate=1_000_000)
    assert 111_000 < mean_ns(message, bus) < (111 + 98 / 16) * 1000
    assert mean_ns(message, bus) == mean_ns(replace(message, period_ns=5), bus)
