"""Response times, by a published example and another tool; load and times of our own sets of messages, by hand."""

import pytest

from can_bridge.timing.background import BackgroundTraffic, PeriodicMessage
from can_bridge.timing.bus_load import MessageTiming, bus_load, loop_messages, message_response_times, response_times
from contract.config.tree import Config
from contract.config.vehicle import BackgroundConfig, BusConfig, EcuConfig
from contract.errors import ConfigError
from tests.refused import refused

US = 1000


def timings(*rows: tuple[int, int, int]) -> list[MessageTiming]:
    """Each from (frame, period, jitter), with deadlines as the periods."""
    return [MessageTiming(frame_ns=c, period_ns=t, deadline_ns=t, jitter_ns=j) for c, t, j in rows]


def test_the_counterexample_to_the_first_analysis():
    """Messages A, B and C of Davis et al. (2007), section 3.1: seven bytes at 125 kbit/s, 125 bits in 1 ms.

    The third meets its deadline in the first instance, at 3 ms, and misses it in the second, at 3.5 ms.
    """
    bus = BusConfig(nominal_bitrate=125_000)
    messages = [
        PeriodicMessage(name=n, frame_id=k, is_fd=False, length=7, period_ns=period * US, deadline_ns=deadline * US)
        for k, (n, period, deadline) in enumerate([("A", 2500, 2500), ("B", 3500, 3250), ("C", 3500, 3250)], start=1)
    ]
    assert [message.worst_ns(bus) for message in messages] == [1000 * US] * 3
    bounds = message_response_times(messages, bus)
    assert [one.response_ns for one in bounds] == [2000 * US, 3000 * US, 3500 * US]
    assert [one.blocking_ns for one in bounds] == [1000 * US, 1000 * US, 0]
    assert [one.in_time for one in bounds] == [True, True, False]


# What pyCPA 1.2 (github.com/IDA-TUBS/pycpa, 824e794), SPNPScheduler(cycle_time=1) with PJd event models, says of the
# messages without jitter of their own; it counts from when a frame is queued, the analysis here from its release.
PYCPA = (
    (((6, 100, 50), (11, 35, 17), (9, 35, 0), (3, 70, 0), (10, 35, 17)), {2: 47, 3: 85}),
    (((6, 130, 0), (11, 70, 0), (4, 35, 17), (10, 20, 3), (3, 20, 0)), {0: 17, 1: 27, 4: 90}),
    (((10, 130, 0), (7, 25, 0), (9, 35, 17), (11, 35, 17), (2, 50, 0)), {0: 21, 1: 28, 4: 234}),
    (((8, 100, 3), (2, 50, 0), (9, 50, 25), (10, 20, 3), (3, 20, 0)), {1: 20, 4: 90}),
)


def test_another_tool_gives_the_same_response_times():
    for rows, published in PYCPA:
        bounds = response_times(timings(*rows), bit_ns=1)
        assert {level: bounds[level].response_ns for level in published} == published, (rows, published)


def test_a_bus_that_cannot_keep_up_has_no_bound():
    for rows, bounded in [
        (((5, 10, 0), (6, 10, 0)), [True, False]),  # 110 %
        (((5, 10, 0), (5, 10, 0)), [True, True]),  # all of it, and nothing that adds to it
        (((5, 10, 0), (5, 10, 1)), [True, False]),  # all of it, and jitter
        (((5, 10, 0), (5, 10, 0), (1, 100, 0)), [True, False, False]),  # the second can be blocked by the third
    ]:
        bounds = response_times(timings(*rows), bit_ns=1)
        assert [one.response_ns is not None for one in bounds] == bounded, (rows, bounded)
        assert [one.in_time for one in bounds][-1] == bounded[-1], (rows, bounded)
    # A busy period would last for years.
    almost = [MessageTiming(frame_ns=999_999_999, period_ns=10**9, deadline_ns=10**9)]
    small = MessageTiming(frame_ns=1, period_ns=2 * 10**9, deadline_ns=2 * 10**9)
    assert response_times([*almost, small, *almost], bit_ns=1)[1].response_ns is None


def test_a_frame_that_comes_within_a_bit_still_wins():
    """The tau_bit of the paper: the second frame of the first message comes as the bus gets free for the last one."""
    for bit_ns, in_between in ((1, 0), (2, 40)):
        rows = timings((40, 101, 0), (60, 1000, 0), (10, 1000, 0))
        assert response_times(rows, bit_ns=bit_ns)[2].response_ns == 40 + 60 + in_between + 10


def test_thousands_of_messages_with_one_rhythm_are_counted_not_listed():
    """All at once, 2,000 frames of a tenth of a millisecond: each waits for those above it and one from below.

    Two sums over all messages of higher priority for every message would take minutes.
    """
    count, frame = 2000, 100 * US
    bounds = response_times(timings(*[(frame, 10_000 * count * US, 0)] * count), bit_ns=2 * US)
    below = [frame] * (count - 1) + [0]
    assert [one.response_ns for one in bounds] == [below[k] + (k + 1) * frame for k in range(count)]
    assert [one.blocking_ns for one in bounds] == below


PERIOD_NS = Config().period_ns


def config(*, load=0.0, seed=0, compute_ms=8.0, **bus):
    background = BackgroundConfig(load=load, seed=seed)
    return Config(bus=BusConfig(background=background, **bus), ecu=EcuConfig(compute_time_ms=compute_ms))


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
    # Random bits: a run of five begins at one bit of 16 on average at most, so 98 bits need three stuff bits or so.
    assert 111 * 2000 < loaded.messages[0].mean_ns < (111 + 98 / 16) * 2000


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


def test_a_message_of_another_node_with_the_name_of_ours_is_not_ours(monkeypatch):
    other = PeriodicMessage(name="VehicleSpeed", frame_id=0x1A0, is_fd=False, length=8, period_ns=10**7)
    monkeypatch.setattr("can_bridge.timing.bus_load.background", lambda bus: BackgroundTraffic(messages=(other,)))
    assert [one.message for one in bus_load(config()).messages if not one.ours] == [other]
