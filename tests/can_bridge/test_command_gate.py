"""Every line and both sides of every branch of the gate; then what must hold for all inputs."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.command_gate import GatedCommand, GateLimits, Intervention, gate
from can_bridge.wire import codec
from can_bridge.wire.messages import Mode
from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.errors import ConfigError
from tests.can_bridge.wire.described import jet

LIMITS = GateLimits(flow_m2_per_s=4.0, step_m2_per_s=1.0, period_ns=100, fresh_age_ns=100, held_age_ns=300)
PASSED = Intervention(0)
ANY = st.floats(allow_nan=True, allow_infinity=True)


def passing(flow: float, **changes: Any) -> GatedCommand:
    usual: dict[str, Any] = {"enable": True, "previous_m2_per_s": 0.0, "previous_ns": None, "pressure_ns": 1000}
    return gate(flow, **{**usual, "now_ns": 1050, "limits": LIMITS, **changes})


def passed(flow: float, why: Intervention = PASSED) -> GatedCommand:
    return GatedCommand(flow_m2_per_s=flow, enable=True, interventions=why)


def shut(why: Intervention) -> GatedCommand:
    return GatedCommand(flow_m2_per_s=0.0, enable=False, interventions=why)


def test_command_within_all_bounds_passes_untouched():
    for flow in [0.0, 0.5, -0.5, 1.0, -1.0]:
        for now in [1000, 1050, 1100]:  # the bounds of the age are inclusive
            assert passing(flow, now_ns=now) == passed(flow), (flow, now)


def test_without_permission_clock_or_pressure_the_jets_shut_at_once():
    cases: list[tuple[dict[str, Any], Intervention]] = [
        ({"enable": False}, Intervention.NOT_ENABLED),
        ({"pressure_ns": None}, Intervention.STALE),
        ({"now_ns": 1301}, Intervention.STALE),
        ({"now_ns": 999}, Intervention.STALE),
        ({"previous_ns": 1050}, Intervention.CLOCK),
        ({"previous_ns": 1051}, Intervention.CLOCK),
        ({"previous_ns": 10**18}, Intervention.CLOCK),
        # The first of several causes is the one that is named.
        ({"enable": False, "pressure_ns": None, "previous_ns": 1050}, Intervention.NOT_ENABLED),
        ({"pressure_ns": None, "previous_ns": 1050}, Intervention.CLOCK),
    ]
    for changes, why in cases:
        for previous in [0.0, 4.0, -4.0]:
            result = passing(previous, previous_m2_per_s=previous, **changes)
            assert result == shut(why), (changes, previous)
            assert math.copysign(1.0, result.flow_m2_per_s) == 1.0, (changes, previous)
    for flow in [math.nan, math.inf, -math.inf]:
        assert passing(flow, previous_m2_per_s=4.0) == shut(Intervention.NOT_FINITE), flow


def test_old_pressures_bear_a_command_that_leads_to_zero_and_no_other():
    for previous in [2.0, -2.0]:
        for now in [1101, 1300]:
            limits = replace(LIMITS, step_m2_per_s=2.0)
            sign = math.copysign(1.0, previous)
            for held in (previous, 0.5 * previous, 1.2 * sign, 0.001 * sign, 0.0):
                result = passing(held, previous_m2_per_s=previous, now_ns=now, limits=limits)
                assert result == passed(held), (previous, now)
            for new in (previous + 0.001 * sign, -0.001 * sign, -previous, 2.0 * previous):
                result = passing(new, previous_m2_per_s=previous, now_ns=now)
                assert result == shut(Intervention.STALE), (previous, now)
                # The same on fresh pressures is a matter of range and rate alone.
                assert passing(new, previous_m2_per_s=previous, now_ns=1100).enable, (previous, now)
    assert passing(0.0, now_ns=1300).enable and passing(-0.0, now_ns=1300).enable
    for moving in (1e-9, -1e-9):
        assert passing(moving, now_ns=1300).interventions == Intervention.STALE, moving


def test_the_step_is_as_large_as_the_time_since_the_one_before():
    for elapsed, reach in [(1, 0.01), (25, 0.25), (50, 0.5), (99, 0.99), (100, 1.0), (101, 1.0), (10**15, 1.0)]:
        for sign in [1.0, -1.0]:
            for largest in [1.0, 0.25]:
                limits = replace(LIMITS, step_m2_per_s=largest)
                result = passing(3.9 * sign, previous_m2_per_s=2.0 * sign, previous_ns=1050 - elapsed, limits=limits)
                # Floating-point rounding of the product and the sum.
                wanted = (2.0 + reach * largest) * sign
                assert result.flow_m2_per_s == pytest.approx(wanted, abs=1e-12), (elapsed, sign)
                assert result.interventions == Intervention.RATE, (elapsed, reach, sign)


def test_range_and_rate():
    for flow, previous, expected, why in [
        (4.0, 3.5, 4.0, PASSED),
        (4.1, 3.5, 4.0, Intervention.RANGE),
        (-4.1, -3.5, -4.0, Intervention.RANGE),
        (1e300, 4.0, 4.0, Intervention.RANGE),
        (1.1, 0.0, 1.0, Intervention.RATE),
        (-1.1, 0.0, -1.0, Intervention.RATE),
        (-2.0, 2.0, 1.0, Intervention.RATE),
        (9.0, 0.0, 1.0, Intervention.RANGE | Intervention.RATE),
        (-9.0, 0.0, -1.0, Intervention.RANGE | Intervention.RATE),
        # A previous command that never passed this gate: the range has the last word.
        (0.0, 10.0, 4.0, Intervention.RATE),
        (0.0, -10.0, -4.0, Intervention.RATE),
    ]:
        assert passing(flow, previous_m2_per_s=previous) == passed(expected, why), (flow, previous)


@given(
    flow=ANY,
    enable=st.booleans(),
    previous=ANY | st.floats(-4.0, 4.0),
    previous_ns=st.none() | st.integers(-200, 200),
    pressure_ns=st.none() | st.integers(-200, 200),
    now_ns=st.integers(-200, 200),
)
def test_nothing_gets_past(flow, enable, previous, previous_ns, pressure_ns, now_ns):
    times = {"previous_ns": previous_ns, "pressure_ns": pressure_ns, "now_ns": now_ns}
    result = passing(flow, enable=enable, previous_m2_per_s=previous, **times)
    assert -4.0 <= result.flow_m2_per_s <= 4.0
    assert result.enable or result.flow_m2_per_s == 0.0
    oldest = 300 if flow == 0.0 or (flow * previous > 0.0 and abs(flow) <= abs(previous)) else 100
    if not (math.isnan(previous) or flow * previous == 0.0):  # a product may vanish though neither factor does
        assert result.enable == (
            enable
            and math.isfinite(flow)
            and (previous_ns is None or now_ns > previous_ns)
            and pressure_ns is not None
            and 0 <= now_ns - pressure_ns <= oldest
        )
    if result.enable and abs(previous) <= 4.0:
        elapsed = 100 if previous_ns is None else min(100, now_ns - previous_ns)
        assert abs(result.flow_m2_per_s - previous) <= elapsed / 100 + 1e-12
        assert (result.flow_m2_per_s == flow) == (result.interventions == PASSED)


def test_limits_of_the_default_truck():
    """0.075 x 62.5 m2/s is 4.6875, which the wire would round up; the limit is the step below."""
    limits = GateLimits.from_config(Config())
    assert (limits.flow_m2_per_s, limits.step_m2_per_s) == pytest.approx((4.6874, 4.6875), abs=1e-12)
    # A period and a half; one period of hold, two of decay, and the period the frame was for.
    assert (limits.period_ns, limits.fresh_age_ns, limits.held_age_ns) == (20_000_000, 30_000_000, 80_000_000)


def test_rounding_on_the_wire_cannot_lead_out_of_the_action_limit():
    for limit in (*np.linspace(0.001, 0.1, 200), 4.0 / 62.5, 6.5534 / 62.5):
        config = Config(flow=FlowConfig(action_limit=float(limit)))
        flow = GateLimits.from_config(config).flow_m2_per_s
        sent = codec.emit_jet_command(jet(flow_m2_per_s=flow, mode=Mode.CONTROL, enable=True))
        received = codec.parse_jet_command(sent)
        assert received is not None
        wanted = limit * config.operating_point.flow_rate_scale
        assert received.flow_m2_per_s == pytest.approx(flow, abs=1e-12), limit
        assert wanted - 0.0002 < received.flow_m2_per_s <= wanted + 1e-9, limit
    # A limit that is a step of the wire is kept up to its very end.
    assert flow == pytest.approx(6.5534, abs=1e-12)


def test_fail_safe_settings_move_the_age():
    config = Config(ecu=EcuConfig(hold_periods=0, decay_periods=0))
    limits = GateLimits.from_config(config)
    # No command rests on what a hold may not rest on.
    assert limits.held_age_ns == limits.fresh_age_ns == config.period_ns
    config = Config(ecu=EcuConfig(hold_periods=3, decay_periods=5, pressure_age=2.25))
    limits = GateLimits.from_config(config)
    assert (limits.fresh_age_ns, limits.held_age_ns) == (45_000_000, 180_000_000)
    # At this speed the wire cannot carry the limit.
    with pytest.raises(ConfigError, match=r"limit is 7\.5 m2/s .* ends at 6\.5534; state .*operating_point\.width"):
        GateLimits.from_config(Config(operating_point=OperatingPoint(speed=40.0)))


def test_limits_are_narrowed_one_by_one_and_never_widened():
    for flow, step, narrower in [(2.0, 2.0, (2.0, 1.0)), (8.0, 0.5, (4.0, 0.5))]:
        other = replace(LIMITS, flow_m2_per_s=flow, step_m2_per_s=step, period_ns=7, fresh_age_ns=8, held_age_ns=9)
        expected = replace(LIMITS, flow_m2_per_s=narrower[0], step_m2_per_s=narrower[1])
        assert LIMITS.narrowed(other) == expected, (flow, step)
