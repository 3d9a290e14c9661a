"""The fail-safe's table, and what must hold for every history of frames."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire.messages import Mode, Reason
from contract.config.tree import EcuConfig
from firmware_sim.ecu.state_machine import FailSafe

ON = FailSafe(good=9, enable_request=True)


def after(state: FailSafe, events: str, config: EcuConfig | None = None, reason=Reason.STREAM_LOST) -> FailSafe:
    """G/g: good frame with and without enable request; x: none came; I/i: one with unusable sensors."""
    config = EcuConfig() if config is None else config
    for event in events:
        wish = None if event == "x" else event.isupper()
        state = state.next_state(usable=event in "Gg", enable_request=wish, reason=reason, config=config)
    return state


def modes(state: FailSafe, events: str, config: EcuConfig | None = None) -> str:
    """The initials of the modes gone through, with a full window."""
    config = EcuConfig() if config is None else config
    found = ""
    for event in events:
        state = after(state, event, config)
        found += state.mode(window_full=True, config=config).name[0]
    return found


@pytest.mark.parametrize(
    ("hold", "decay", "events", "expected"),
    [
        (1, 2, "GxxxxxG", "CHDDFFF"),
        (0, 0, "GxxG", "CFFF"),
        (2, 0, "GxxxG", "CHHFF"),
        (0, 1, "GxxG", "CDFF"),
        (1, 2, "GxxxGxxxG", "CHDDCHDDC"),  # the count starts anew with every good frame
        (1, 2, "GIIIIG", "CHDDFF"),  # sensors out of order are pressures that stay away
        (1, 2, "gxxxxxxg", "OOOOOOOO"),  # nobody asked for control: nothing to latch
        (1, 2, "GxxiG", "CHDOC"),  # the wish withdrawn by a frame without usable pressures
        (1, 2, "gxxxxxI", "OOOOOOF"),  # asked for while pressures have long been away
    ],
)
def test_misses_hold_decay_and_latch(hold, decay, events, expected):
    config = EcuConfig(hold_periods=hold, decay_periods=decay)
    assert modes(FailSafe(), events, config) == expected


@pytest.mark.parametrize(
    ("events", "expected"),
    [
        ("GGGGGGGG", "FFFFFFFF"),  # good frames alone do not
        ("gGgGgG", "FFFFFC"),  # an edge, and it is the fifth frame or later
        ("ggggG", "FFFFC"),
        ("gggG", "FFFF"),  # an edge too early is lost,
        ("gggGGGGG", "FFFFFFFF"),
        ("gggGGgG", "FFFFFFC"),  # and a later one counts
        ("gggggxG", "FFFFFFF"),  # a miss starts the count anew
        ("ggggggggg", "FFFFFFFFF"),  # without a wish there is no edge
        ("gggggI", "FFFFFF"),
        ("gggggIG", "FFFFFFF"),  # an edge on unusable pressures is spent
    ],
)
def test_a_latched_fault_needs_good_frames_and_an_edge(events, expected):
    assert modes(after(ON, "xxxx"), events) == expected


def test_the_window_must_be_full():
    config = EcuConfig()
    assert ON.mode(window_full=False, config=config) is Mode.WARMUP
    assert after(ON, "xxxx").mode(window_full=False, config=config) is Mode.FAULT
    assert FailSafe().mode(window_full=False, config=config) is Mode.OFF


def test_the_first_cause_is_kept_while_latched():
    state = after(ON, "xxxx", reason=Reason.STREAM_INVALID)
    assert state.reason is Reason.STREAM_INVALID
    state = after(state, "xxgII", reason=Reason.SENSOR_INVALID)
    assert state.reason is Reason.STREAM_INVALID
    assert state.latch(Reason.INTERNAL).reason is Reason.STREAM_INVALID
    assert after(state, "ggggG").reason is Reason.NONE
    assert after(ON, "x", reason=Reason.STREAM_INVALID).reason is Reason.STREAM_INVALID
    assert after(ON, "xi").reason is Reason.NONE


def test_another_fault_latches_at_once_and_counts_good_frames_from_there():
    state = ON.latch(Reason.INTERNAL)
    assert (state.mode(window_full=True, config=EcuConfig()), state.reason) == (Mode.FAULT, Reason.INTERNAL)
    assert modes(state, "gGggG") == "FFFFC"


EVENTS = st.lists(st.sampled_from("GGGggxxiIL"), max_size=60)  # L: latched by something else


@given(EVENTS, st.integers(0, 2), st.integers(0, 2), st.integers(1, 4))
def test_every_history_keeps_the_rules(events, hold, decay, rearm):
    config = EcuConfig(hold_periods=hold, decay_periods=decay, rearm_frames=rearm)
    state, wish, in_a_row, missed = FailSafe(), False, 0, 0
    for event in events:
        if event == "L":
            state, in_a_row = state.latch(Reason.INTERNAL), 0 if not state.latched else in_a_row
            continue
        before, asked = state, wish
        state = after(state, event, config)
        wish = asked if event == "x" else event.isupper()
        in_a_row, missed = (in_a_row + 1, 0) if event in "Gg" else (0, missed + 1)
        mode = state.mode(window_full=True, config=config)
        if before.latched and not state.latched:
            assert event == "G"
            assert not asked
            assert in_a_row >= rearm
        if wish and missed > hold + decay:
            assert mode is Mode.FAULT
        if mode is Mode.CONTROL:
            assert wish
            assert missed == 0
        if mode in (Mode.HOLD, Mode.DECAY):
            assert wish
            assert 1 <= missed <= hold + decay
            assert (mode is Mode.HOLD) == (missed <= hold)
            assert state.reason is Reason.STREAM_LOST
        assert (mode is Mode.FAULT) == state.latched
        assert (state.reason is Reason.NONE) or mode in (Mode.HOLD, Mode.DECAY, Mode.FAULT)
