"""The fail-safe in C against the one in Python: every mode with every input, any counts, and runs from power-on on."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.wire.messages import Mode, Reason
from firmware_sim.ecu.state_machine import FailSafe, OperatingMode, PeriodInputs
from tests.examples import examples

MODES = tuple(OperatingMode)
UINT32_MAX = 2**32 - 1
REASONS = st.sampled_from(Reason)
FAULTS = st.none() | st.sampled_from([reason for reason in Reason if reason is not Reason.NONE])
INPUTS = st.builds(
    PeriodInputs,
    usable=st.booleans(),
    enable_request=st.sampled_from([None, False, True]),
    unusable_because=REASONS,
    window_full=st.booleans(),
    # A fault in every period would leave nothing else to be seen.
    fault=st.none() | st.none() | FAULTS,
    updating=st.sampled_from([False, False, False, False, True]),
)


def states(loss_window: int) -> st.SearchStrategy[FailSafe]:
    counts = st.integers(0, 8) | st.integers(0, UINT32_MAX - 1)
    return st.builds(
        FailSafe,
        mode=st.sampled_from(OperatingMode),
        misses=counts,
        good=counts,
        lost=st.integers(0, 2**loss_window - 1),
        reason=REASONS,
        enable_request=st.booleans(),
    )


def in_c(core, state: FailSafe):
    return core.ffi.new(
        "sw_fail_safe *",
        {
            "mode": MODES.index(state.mode),
            "reason": state.reason,
            "enable_request": state.enable_request,
            "misses": state.misses,
            "good": state.good,
            "lost": state.lost,
        },
    )


def as_python(found) -> FailSafe:
    return FailSafe(
        mode=MODES[found.mode],
        misses=found.misses,
        good=found.good,
        lost=found.lost,
        reason=Reason(found.reason),
        enable_request=bool(found.enable_request),
    )


def after(core, state: FailSafe, inputs: PeriodInputs) -> FailSafe:
    found = in_c(core, state)
    core.lib.sw_fail_safe_next(
        found,
        core.ffi.new(
            "sw_period_inputs *",
            {
                "usable": inputs.usable,
                "has_request": inputs.enable_request is not None,
                "enable_request": bool(inputs.enable_request),
                "unusable_because": inputs.unusable_because,
                "window_full": inputs.window_full,
                "fault": inputs.fault or Reason.NONE,
                "updating": inputs.updating,
            },
        ),
    )
    return as_python(found)


def test_it_starts_as_in_python(core):
    found = core.ffi.new("sw_fail_safe *", {"mode": 3, "reason": 3, "misses": 3, "good": 3, "lost": 3})
    core.lib.sw_fail_safe_start(found)
    assert as_python(found) == FailSafe()


def test_every_mode_takes_the_same_way_on_every_input(core):
    """All modes, all flags, the reasons that conditions ask for, and counts beside each limit."""
    ecu = core.config.ecu
    away = ecu.hold_periods + ecu.decay_periods
    misses = {0, max(0, ecu.hold_periods - 1), ecu.hold_periods, max(0, away - 1), away}
    losses = [(1 << count) - 1 for count in (0, ecu.loss_limit - 1, ecu.loss_limit) if count <= ecu.loss_window]
    beside = [(count, 0, 0) for count in sorted(misses)]
    beside += [(0, max(0, ecu.rearm_frames - 2), 0), (0, ecu.rearm_frames - 1, 0)]
    beside += [(0, 0, lost) for lost in losses]
    flags = (False, True)
    taken = set()
    for mode, requested, (missed, good, lost) in itertools.product(MODES, flags, beside):
        state = FailSafe(mode=mode, misses=missed, good=good, lost=lost, reason=Reason.STALE, enable_request=requested)
        for usable, request, because, full, fault, updating in itertools.product(
            flags,
            (None, False, True),
            (Reason.STREAM_LOST, Reason.STREAM_INVALID, Reason.NOT_AUTHENTIC),
            flags,
            (None, Reason.BUS_OFF),
            flags,
        ):
            inputs = PeriodInputs(
                usable=usable,
                enable_request=request,
                unusable_because=because,
                window_full=full,
                fault=fault,
                updating=updating,
            )
            expected = state.next(inputs, ecu)
            assert after(core, state, inputs) == expected
            taken.add((mode, expected.mode))
    assert {mode for _, mode in taken} >= set(MODES) - ({OperatingMode.HOLD} if away == 0 else set()) - (
        {OperatingMode.DECAY} if ecu.decay_periods == 0 else set()
    )


@examples(400)
@given(data=st.data())
def test_any_state_takes_the_same_way_on_any_input(core, data):
    state = data.draw(states(core.config.ecu.loss_window))
    inputs = data.draw(INPUTS)
    assert after(core, state, inputs) == state.next(inputs, core.config.ecu)


@examples(100)
@given(data=st.data())
def test_any_state_latches_as_in_python(core, data):
    state = data.draw(states(core.config.ecu.loss_window))
    reason = data.draw(st.sampled_from([reason for reason in Reason if reason is not Reason.NONE]))
    found = in_c(core, state)
    core.lib.sw_fail_safe_latch(found, reason)
    assert as_python(found) == state.latch(reason)


@examples(25)
@given(runs=st.lists(st.tuples(INPUTS, st.integers(1, 12)), max_size=30))
def test_a_run_from_power_on_stays_together(core, runs):
    state = FailSafe()
    for inputs, times in runs:
        for _ in range(times):
            expected = state.next(inputs, core.config.ecu)
            assert after(core, state, inputs) == expected
            state = expected


@pytest.mark.parametrize("usable", [False, True])
def test_counts_stop_at_their_largest_value(core, usable):
    """Standing there would latch, or re-arm, for ever; going round to zero would hold again."""
    full = FailSafe(mode=OperatingMode.FAULT, misses=UINT32_MAX, good=UINT32_MAX)
    inputs = PeriodInputs(usable=usable, enable_request=None, unusable_because=Reason.STREAM_LOST, window_full=True)
    found = after(core, full, inputs)
    assert (found.misses, found.good) == ((0, UINT32_MAX) if usable else (UINT32_MAX, 0))


def test_modes_on_the_wire_and_jets(core):
    wire = {mode: Mode(core.lib.sw_mode_on_wire(MODES.index(mode))) for mode in MODES}
    assert wire == {mode: mode.on_wire for mode in MODES}
    assert [mode.name for mode in MODES if core.lib.sw_drives_jets(MODES.index(mode))] == ["ACTIVE", "HOLD", "DECAY"]
