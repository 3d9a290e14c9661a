"""The fail-safe's table, and what must hold for every history of frames."""

from dataclasses import replace

from can_bridge.wire.messages import Mode, Reason
from contract.config.vehicle import EcuConfig
from firmware_sim.ecu.state_machine import FailSafe, OperatingMode, PeriodInputs
from tests.each import each

ARMED = FailSafe(mode=OperatingMode.ARMED, enable_request=False)
"""Control may be requested at any time."""
ON = FailSafe(mode=OperatingMode.ACTIVE, good=9)


def after(
    state: FailSafe,
    events: str,
    config: EcuConfig | None = None,
    reason=Reason.STREAM_LOST,
    window_full: bool = True,
) -> FailSafe:
    """G/g: good frame with and without enable request; x: none came; I/i: one with unusable sensors.

    T: a good frame with enable request, but the ECU must switch itself off.
    """
    config = EcuConfig() if config is None else config
    for event in events:
        inputs = PeriodInputs(
            usable=event in "GgT",
            enable_request=None if event == "x" else event.isupper(),
            unusable_because=reason,
            window_full=window_full,
            fault=Reason.DEADLINE if event == "T" else None,
        )
        state = state.next(inputs, config)
    return state


def modes(state: FailSafe, events: str, config: EcuConfig | None = None) -> str:
    """The initials on the wire of the modes gone through, with a full window."""
    found = ""
    for event in events:
        state = after(state, event, config)
        found += state.mode.on_wire.name[0]
    return found


@each(
    "hold, decay, events, expected",
    [
        (1, 2, "GxxxxxG", "CHDDFFF"),
        (0, 0, "GxxG", "CFFF"),
        (2, 0, "GxxxG", "CHHFF"),
        (0, 1, "GxxG", "CDFF"),
        (1, 2, "GxxxGxxxG", "CHDDCHDDC"),  # the count starts anew with every good frame
        (1, 2, "GIIIIG", "CHDDFF"),  # sensors out of order are pressures that stay away
        (1, 2, "gxxxxxxg", "OOOOOOOO"),  # control not requested: nothing to latch
        (1, 2, "GxxiG", "CHDOC"),  # the request withdrawn by a frame without usable pressures
        (1, 2, "gxxxxxI", "OOOOOOF"),  # requested while pressures have long been away
    ],
)
def test_misses_hold_decay_and_latch(hold, decay, events, expected):
    config = EcuConfig(hold_periods=hold, decay_periods=decay)
    assert modes(ARMED, events, config) == expected


@each(
    "events, expected",
    [
        ("GGGGGGGG", "FFFFFFFF"),  # good frames alone do not
        ("gGgGgG", "FFFFFC"),  # an edge, and it is the fifth frame or later
        ("ggggG", "FFFFC"),
        ("gggG", "FFFF"),  # an edge too early is lost,
        ("gggGGGGG", "FFFFFFFF"),
        ("gggGGgG", "FFFFFFC"),  # and a later one counts
        ("gggggxG", "FFFFFFF"),  # a miss starts the count anew
        ("ggggggggg", "FFFFFFFFF"),  # without a request there is no edge
        ("gggggI", "FFFFFF"),
        ("gggggIG", "FFFFFFF"),  # an edge on unusable pressures is spent
    ],
)
def test_a_latched_fault_needs_good_frames_and_an_edge(events, expected):
    assert modes(after(ON, "xxxx"), events) == expected


def test_the_window_must_be_full():
    assert after(ON, "G", window_full=False).mode is OperatingMode.WARMUP
    assert after(ON, "xxxxG", window_full=False).mode is OperatingMode.FAULT
    assert after(FailSafe(), "g", window_full=False).mode is OperatingMode.ARMED


def test_a_fault_of_the_ecu_itself_latches_before_the_frames_of_the_period_count():
    state = after(ON, "T")
    assert (state.mode, state.reason, state.good) == (OperatingMode.FAULT, Reason.DEADLINE, 1)


@each("rearm", [1, 2])
def test_an_edge_in_a_period_with_a_fault_is_spent(rearm):
    config = EcuConfig(rearm_frames=rearm)
    assert modes(after(ON, "g"), "TGGgG", config) == "FFFFC"
    # A fault that stands is none the less one: good frames count from the last period with it.
    assert modes(after(ON, "xxxx"), "gTgTgG", config) == "FFFFFC"
    assert after(ON, "xxxxggggT").good == 1


def test_a_request_that_is_low_when_a_fault_begins_must_be_seen_low_again():
    """It may have risen before the fault, in frames that were lost or not to be trusted."""
    config = EcuConfig(rearm_frames=1)
    lost = PeriodInputs(
        usable=False, enable_request=None, unusable_because=Reason.STREAM_LOST, window_full=True, fault=Reason.CLOCK
    )
    state = after(ON, "g").next(lost, config)
    assert modes(state, "GGgG", config) == "FFFC"
    assert modes(after(ON, "g").next(replace(lost, enable_request=False), config), "G", config) == "C"


@each(
    "events, expected",
    [
        ("GGGGGGGG", "OOOOOOOO"),  # a request that stands at power-on may be of the time before a fault
        ("GGGGgGG", "OOOOOCC"),
        ("gG", "OC"),
        ("xxGGG", "OOOOO"),
        ("xxgG", "OOOC"),
        ("GxxxxxxG", "OOOOOOOO"),  # nothing is wanted yet: there is nothing to latch
        ("GiI", "OOD"),
        # Without pressures there is no full window: INIT leads to WARMUP alone.
        ("IiI", "OOW"),
    ],
)
def test_at_power_on_the_request_must_be_raised(events, expected):
    assert modes(FailSafe(), events) == expected


def test_a_stream_that_is_not_trusted_latches_at_once():
    state = after(ON, "x", reason=Reason.STREAM_INVALID)
    assert (state.mode, state.reason) == (OperatingMode.FAULT, Reason.STREAM_INVALID)
    assert after(ON, "gx", reason=Reason.STREAM_INVALID).mode is OperatingMode.ARMED
    assert after(FailSafe(), "x", reason=Reason.STREAM_INVALID).mode is OperatingMode.INIT
    for reason in (Reason.STREAM_LOST, Reason.SENSOR_INVALID, Reason.STALE, Reason.NOT_AUTHENTIC):
        state = after(ON, "x", reason=reason)
        assert (state.mode, state.reason) == (OperatingMode.HOLD, reason)


@each(
    "pattern, latches_at",
    [
        # Lost so far is what the pattern says, the twenty-fifth of it latches.
        ("Gxxx", 33),
        ("Gx", 49),
        ("GGx", None),  # a third is borne for ever
        ("GGGx", None),
        ("GxxxGGG", None),
        ("GxxxGG", 49),
    ],
)
def test_losses_that_are_not_in_a_row_latch_from_a_half_on(pattern, latches_at):
    found = modes(ON, pattern * 60)
    assert (found.find("F") if "F" in found else None) == latches_at


def test_losses_count_from_when_control_is_wanted():
    config = EcuConfig(loss_window=6, loss_limit=3)
    assert modes(ON, "xGxGgxxxxGxGxG", config) == "HCHCOOOOOCHCHC"
    assert modes(ON, "xGxGx", config) == "HCHCF"
    # After the re-arming as well.
    assert modes(after(ON, "xGxGx", config), "gggggGxGxGGGGxGx", config) == "FFFFFCHCHCCCCHCH"
    assert after(ON, "x" * 40 + "g").lost == 0
    assert after(ON, "xG").lost == 0b10


def test_the_wire_knows_off_for_every_state_in_which_nobody_asks_for_control():
    off = {mode for mode in OperatingMode if mode.on_wire is Mode.OFF}
    assert off == {OperatingMode.INIT, OperatingMode.STANDBY, OperatingMode.ARMED, OperatingMode.UPDATE}
    others = {mode.name: mode.on_wire.name for mode in OperatingMode if mode not in off}
    assert others == {"ACTIVE": "CONTROL", **{name: name for name in ("WARMUP", "HOLD", "DECAY", "FAULT")}}


def test_the_jets_run_in_three_modes():
    running = {mode for mode in OperatingMode if mode.drives_jets}
    assert running == {OperatingMode.ACTIVE, OperatingMode.HOLD, OperatingMode.DECAY}


def test_a_request_that_stands_at_power_on_is_seen_on_the_wire():
    state = after(FailSafe(), "G")
    assert (state.mode, state.reason) == (OperatingMode.STANDBY, Reason.NOT_ARMED)
    assert after(state, "x" * 9).reason is Reason.NOT_ARMED
    assert after(state, "x", reason=Reason.NOT_AUTHENTIC).reason is Reason.NOT_AUTHENTIC
    assert (after(state, "g").mode, after(state, "g").reason) == (OperatingMode.ARMED, Reason.NONE)


def test_before_the_first_pressures_a_request_is_heard_all_the_same():
    assert after(FailSafe(), "i").mode is OperatingMode.INIT
    assert after(FailSafe(), "ix", reason=Reason.NOT_AUTHENTIC).reason is Reason.NOT_AUTHENTIC
    assert after(FailSafe(), "iG", window_full=False).mode is OperatingMode.WARMUP
    assert after(FailSafe(), "ixxxI").mode is OperatingMode.FAULT


def written(state: FailSafe, **changes) -> FailSafe:
    """One period in which a bundle is to be written."""
    inputs = {"usable": True, "enable_request": True, "unusable_because": Reason.NONE, "window_full": True}
    return state.next(PeriodInputs(**{**inputs, "updating": True, **changes}), EcuConfig())


@each("mode", OperatingMode)
def test_an_update_begins_where_no_jet_may_run_and_ends_with_a_reset_alone(mode):
    state = written(FailSafe(mode=mode, reason=Reason.DEADLINE), enable_request=None)
    assert (state.mode is OperatingMode.UPDATE) != mode.drives_jets
    if mode.drives_jets:  # once the request has ended
        state = written(written(state, enable_request=False))
    assert state.mode is OperatingMode.UPDATE
    for event in "GgGxgGggggggGTgG":
        state = after(state, event)
        assert (state.mode, state.reason) == (OperatingMode.UPDATE, Reason.UPDATING)
    assert state.latch(Reason.INTERNAL).mode is OperatingMode.UPDATE


def test_the_first_cause_is_kept_while_latched():
    state = after(ON, "xxxx", reason=Reason.STREAM_LOST)
    assert state.reason is Reason.STREAM_LOST
    state = after(state, "xxgII", reason=Reason.SENSOR_INVALID)
    assert state.reason is Reason.STREAM_LOST
    assert state.latch(Reason.INTERNAL).reason is Reason.STREAM_LOST
    assert after(state, "ggggG").reason is Reason.NONE
    assert after(ON, "x", reason=Reason.STREAM_INVALID).reason is Reason.STREAM_INVALID
    assert after(ON, "xi").reason is Reason.NONE
