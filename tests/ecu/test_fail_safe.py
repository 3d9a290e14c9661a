"""The fail-safe through histories written out by hand; `test_transitions` goes through all that can happen."""

from typing import Any

from can_bridge.wire.messages import Mode, Reason
from contract.config.vehicle import EcuConfig
from ecu.fail_safe import FailSafe, OperatingMode, PeriodInputs
from tests.each import each

LETTERS = dict(zip(OperatingMode, "isaWCHDFu", strict=True))
RESET, ARMED = FailSafe(), FailSafe(mode=OperatingMode.ARMED, enable_request=False)
ON = FailSafe(mode=OperatingMode.CONTROL, good=9)
SHUT = [mode for mode in OperatingMode if not mode.drives_jets]
BECAUSE = {"X": Reason.STREAM_INVALID, "N": Reason.NOT_AUTHENTIC, "I": Reason.SENSOR_INVALID, "i": Reason.STALE}
FAULTS = {"T": Reason.DEADLINE, "t": Reason.DEADLINE, "c": Reason.CLOCK, "d": Reason.CLOCK}


def after(state: FailSafe, event: str, config: EcuConfig) -> FailSafe:
    """One period.

    G/g: good frame with and without enable request; W/w: the same while the window is not full; U/u: while a release is
    to be written; T/t: while the ECU must switch itself off. I/i: frame with unusable pressures; d: such a one, and the
    ECU must switch itself off. x: none came; X: of a stream not to be trusted; N: not authentic; c: the ECU must switch
    itself off; y: a release is to be written. O: a good frame with request at a speed beyond the release's; P: in a
    test of whether control helps.
    """
    inputs = PeriodInputs(
        usable=event in "GgWwUuTtOP",
        enable_request=None if event in "xXNcy" else event.isupper(),
        unusable_because=BECAUSE.get(event, Reason.STREAM_LOST),
        window_full=event not in "Ww",
        fault=FAULTS.get(event),
        updating=event in "Uuy",
        off_speed=event == "O",
        tests=event == "P",
    )
    return state.next(inputs, config)


def through(state: FailSafe, events: str, **settings: Any) -> tuple[str, FailSafe]:
    letters, config = "", EcuConfig(**settings)
    for event in events:
        state = after(state, event, config)
        letters += LETTERS[state.mode]
    return letters, state


STORIES = [
    # Misses hold, decay and latch; the count starts again with every good frame.
    (ARMED, "GxxxxxG", "CHDDFFF", Reason.STREAM_LOST, {}),
    (ARMED, "GxxG", "CFFF", Reason.STREAM_LOST, {"hold_periods": 0, "decay_periods": 0}),
    (ARMED, "GxxxG", "CHHFF", Reason.STREAM_LOST, {"hold_periods": 2, "decay_periods": 0}),
    (ARMED, "GxxG", "CDFF", Reason.STREAM_LOST, {"hold_periods": 0, "decay_periods": 1}),
    (ARMED, "GxxxGxxxG", "CHDDCHDDC", Reason.NONE, {}),
    (ARMED, "GIIIIG", "CHDDFF", Reason.SENSOR_INVALID, {}),  # sensors out of order are pressures that stay away
    (ARMED, "gxxxxxxg", "aaaaaaaa", Reason.NONE, {}),  # control not requested: nothing to latch
    (ARMED, "GxxiG", "CHDaC", Reason.NONE, {}),  # the request withdrawn by a frame without usable pressures
    (ARMED, "gxxxxxI", "aaaaaaF", Reason.SENSOR_INVALID, {}),  # requested while pressures have long been away
    *((ON, event, "H", reason, {}) for event, reason in BECAUSE.items() if event in "IN"),
    (ON, "OO", "WW", Reason.OFF_SPEED, {}),
    (ON, "PP", "WW", Reason.NOT_HELPING, {}),
    # A stream that is not trusted latches at once.
    (ON, "X", "F", Reason.STREAM_INVALID, {}),
    (ON, "gX", "aa", Reason.NONE, {}),
    (RESET, "X", "i", Reason.NONE, {}),
    # A latched fault needs good frames and an edge: the fifth frame or later.
    (ON, "xxxx" + "GGGGGGGG", "HDDF" + "FFFFFFFF", Reason.STREAM_LOST, {}),
    (ON, "xxxx" + "gGgGgG", "HDDF" + "FFFFFC", Reason.NONE, {}),
    (ON, "xxxx" + "ggggG", "HDDF" + "FFFFC", Reason.NONE, {}),
    (ON, "xxxx" + "gggGGgG", "HDDF" + "FFFFFFC", Reason.NONE, {}),  # an edge too early is lost, a later one counts
    (ON, "xxxx" + "gggGGGGG", "HDDF" + "FFFFFFFF", Reason.STREAM_LOST, {}),
    (ON, "xxxx" + "gggggxG", "HDDF" + "FFFFFFF", Reason.STREAM_LOST, {}),  # a miss starts the count again
    (ON, "xxxx" + "ggggggggg", "HDDF" + "FFFFFFFFF", Reason.STREAM_LOST, {}),  # without a request there is no edge
    (ON, "xxxx" + "gggggIG", "HDDF" + "FFFFFFF", Reason.STREAM_LOST, {}),  # an edge on unusable pressures is spent
    (ON, "xxxx" + "wwwwW", "HDDF" + "FFFFW", Reason.NONE, {}),
    # A fault of the ECU's own latches before the frames of its period count; an edge in it is spent.
    (ON, "T", "F", Reason.DEADLINE, {}),
    *((ON, "g" + "TGGgG", "a" + "FFFFC", Reason.NONE, {"rearm_frames": rearm}) for rearm in (1, 2)),
    # One that stands is none the less one: good frames count from the last period with it.
    *((ON, "xxxx" + "gTgTgG", "HDDF" + "FFFFFC", Reason.NONE, {"rearm_frames": rearm}) for rearm in (1, 2)),
    (ON, "xxxx" + "gggggtgggG", "HDDF" + "FFFFFFFFFC", Reason.NONE, {}),
    (ON, "xxxx" + "gggggtggG", "HDDF" + "FFFFFFFFF", Reason.STREAM_LOST, {}),
    # The request must be seen low in it or after: it may have risen before, in frames that were lost.
    (ON, "g" + "cGGgG", "a" + "FFFFC", Reason.NONE, {"rearm_frames": 1}),
    (ON, "g" + "dG", "a" + "FC", Reason.NONE, {"rearm_frames": 1}),
    # At power-on the request must be raised: one that stands may be of the time before a fault.
    (RESET, "GGGGGGGG", "ssssssss", Reason.NOT_ARMED, {}),
    (RESET, "GGGGgGG", "ssssaCC", Reason.NONE, {}),
    (RESET, "gG", "aC", Reason.NONE, {}),
    (RESET, "xxGxxx", "iissss", Reason.NOT_ARMED, {}),
    (RESET, "GN", "ss", Reason.NOT_AUTHENTIC, {}),
    (RESET, "GxxxxxxGg", "ssssssssa", Reason.NONE, {}),  # nothing is wanted yet: there is nothing to latch
    (RESET, "GiI", "saD", Reason.SENSOR_INVALID, {}),
    # Before the first pressures a request is heard all the same, and there is no full window.
    (RESET, "iN", "ii", Reason.NOT_AUTHENTIC, {}),
    (RESET, "iW", "iW", Reason.NONE, {}),
    (RESET, "IiI", "iiW", Reason.SENSOR_INVALID, {}),
    (RESET, "ixxxI", "iiiiF", Reason.SENSOR_INVALID, {}),
    (RESET, "w", "a", Reason.NONE, {}),
    (ON, "W", "W", Reason.NONE, {}),
    # The first cause is kept while a fault stands.
    (ON, "xxxx" + "XNgIT", "HDDF" + "FFFFF", Reason.STREAM_LOST, {}),
    # Losses that are not in a row latch from a half on, where control is wanted, and after re-arming as before.
    (ON, "xGxGgxxxxGxGxG", "HCHCaaaaaCHCHC", Reason.NONE, {"loss_window": 6, "loss_limit": 3}),
    (ON, "xGxGxgggggGxGxGGGGxGx", "HCHCFFFFFFCHCHCCCCHCH", Reason.STREAM_LOST, {"loss_window": 6, "loss_limit": 3}),
    # A release is written where no jet may run; a reset alone leads out.
    (ON, "U" + "yUu" + "u" + "GgGxgGggggggGTgG", "C" + "HCa" + "u" * 17, Reason.UPDATING, {}),
    *((FailSafe(mode=mode, reason=Reason.STALE), "y", "u", Reason.UPDATING, {}) for mode in SHUT),
]


@each("begin, events, expected, reason, settings", STORIES)
def test_a_history_leads_where_it_must(begin, events, expected, reason, settings):
    states, last = through(begin, events, **settings)
    assert (states, last.reason) == (expected, reason)


@each(
    "pattern, latches_at",
    # Lost so far is what the pattern says, the twenty-fifth of it latches; a third is borne for ever.
    [("Gxxx", 33), ("Gx", 49), ("GxxxGG", 49), ("GGx", None), ("GGGx", None), ("GxxxGGG", None)],
)
def test_losses_that_are_not_in_a_row_latch_from_a_half_on(pattern, latches_at):
    states, _ = through(ON, pattern * 60)
    assert (states.find("F") if "F" in states else None) == latches_at


def test_losses_count_from_when_control_is_wanted():
    assert (through(ON, "x" * 40 + "g")[1].lost, through(ON, "xG")[1].lost) == (0, 0b10)


@each("mode", OperatingMode)
def test_a_fault_that_shows_late_in_the_period_latches(mode):
    state = FailSafe(mode=mode, good=9, reason=Reason.STALE).latch(Reason.INTERNAL)
    expected = {
        OperatingMode.UPDATE: (OperatingMode.UPDATE, Reason.UPDATING),
        OperatingMode.FAULT: (OperatingMode.FAULT, Reason.STALE),
    }
    assert (state.mode, state.reason) == expected.get(mode, (OperatingMode.FAULT, Reason.INTERNAL))
    assert state.good == 0


def test_the_wire_has_its_own_names_and_the_jets_run_in_three_modes():
    off = {mode for mode in OperatingMode if mode.on_wire is Mode.OFF}
    assert off == {OperatingMode.INIT, OperatingMode.STANDBY, OperatingMode.ARMED, OperatingMode.UPDATE}
    assert all(mode.on_wire.name == mode.name for mode in OperatingMode if mode not in off)
    assert {mode.name for mode in OperatingMode if mode.drives_jets} == {"CONTROL", "HOLD", "DECAY"}
