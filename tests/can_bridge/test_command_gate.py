"""Every line and both sides of every branch of the gate; then what must hold for all inputs."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.command_gate import GatedCommand, GateLimits, Intervention, gate
from can_bridge.wire import codec
from can_bridge.wire.messages import JetCommand, Mode
from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.errors import ConfigError
from contract.operating_point import OperatingPoint

LIMITS = GateLimits(flow_m2_per_s=4.0, step_m2_per_s=1.0, pressure_age_ns=100)
PASSED = Intervention(0)
ANY = st.floats(allow_nan=True, allow_infinity=True)


def passing(flow: float, **changes: Any) -> GatedCommand:
    arguments: dict[str, Any] = {"enable": True, "previous_m2_per_s": 0.0, "pressure_ns": 1000, "now_ns": 1050}
    return gate(flow, limits=LIMITS, **{**arguments, **changes})


@pytest.mark.parametrize("flow", [0.0, 0.5, -0.5, 1.0, -1.0])
def test_command_within_all_bounds_passes_untouched(flow):
    assert passing(flow) == GatedCommand(flow_m2_per_s=flow, enable=True, interventions=PASSED)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"enable": False}, Intervention.NOT_ENABLED),
        ({"pressure_ns": None}, Intervention.STALE),
        ({"now_ns": 1101}, Intervention.STALE),
        ({"now_ns": 999}, Intervention.STALE),
    ],
)
@pytest.mark.parametrize("previous", [0.0, 4.0, -4.0])
def test_without_permission_or_pressure_the_jets_shut_at_once(changes, why, previous):
    expected = GatedCommand(flow_m2_per_s=0.0, enable=False, interventions=why)
    assert passing(previous, previous_m2_per_s=previous, **changes) == expected


@pytest.mark.parametrize("flow", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_shuts_the_jets(flow):
    expected = GatedCommand(flow_m2_per_s=0.0, enable=False, interventions=Intervention.NOT_FINITE)
    assert passing(flow, previous_m2_per_s=4.0) == expected


@pytest.mark.parametrize("now", [1000, 1100])
def test_age_bounds_are_inclusive(now):
    assert passing(0.5, now_ns=now).interventions == PASSED


@pytest.mark.parametrize(
    ("flow", "previous", "expected", "why"),
    [
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
    ],
)
def test_range_and_rate(flow, previous, expected, why):
    assert passing(flow, previous_m2_per_s=previous) == GatedCommand(
        flow_m2_per_s=expected, enable=True, interventions=why
    )


@given(
    flow=ANY,
    enable=st.booleans(),
    previous=ANY,
    pressure_ns=st.none() | st.integers(-200, 200),
    now_ns=st.integers(-200, 200),
)
def test_nothing_gets_past(flow, enable, previous, pressure_ns, now_ns):
    result = gate(
        flow, enable=enable, previous_m2_per_s=previous, pressure_ns=pressure_ns, now_ns=now_ns, limits=LIMITS
    )
    assert -4.0 <= result.flow_m2_per_s <= 4.0
    assert result.enable or result.flow_m2_per_s == 0.0
    assert result.enable == (
        enable and math.isfinite(flow) and pressure_ns is not None and 0 <= now_ns - pressure_ns <= 100
    )
    if result.enable and abs(previous) <= 4.0:
        assert abs(result.flow_m2_per_s - previous) <= 1.0 + 1e-12
        assert (result.flow_m2_per_s == flow) == (result.interventions == PASSED)


@given(st.lists(ANY, min_size=1, max_size=60))
def test_sequence_never_moves_faster_than_the_step(commands):
    previous = 0.0
    for command in commands:
        result = passing(command, previous_m2_per_s=previous)
        assert not result.enable or abs(result.flow_m2_per_s - previous) <= 1.0 + 1e-12
        previous = result.flow_m2_per_s


def test_limits_of_the_default_truck():
    """0.075 x 62.5 m2/s is 4.6875, which the wire would round up; the limit is the step below."""
    limits = GateLimits.from_config(Config())
    assert limits.flow_m2_per_s == pytest.approx(4.6874, abs=1e-12)
    assert limits.step_m2_per_s == pytest.approx(4.6875)
    # One period of hold, two of decay, and the period the frame was for.
    assert limits.pressure_age_ns == 80_000_000


@given(limit=st.floats(0.001, 0.1))
def test_rounding_on_the_wire_cannot_lead_out_of_the_action_limit(limit):
    config = Config(flow=FlowConfig(action_limit=limit))
    limits = GateLimits.from_config(config)
    result = gate(1e9, enable=True, previous_m2_per_s=limits.flow_m2_per_s, pressure_ns=0, now_ns=0, limits=limits)
    command = JetCommand(flow_m2_per_s=result.flow_m2_per_s, mode=Mode.CONTROL, enable=True, pressure_counter=None)
    received = codec.parse_jet_command(codec.emit_jet_command(command))
    assert received is not None
    wanted = limit * config.operating_point.flow_rate_scale
    assert wanted - 0.0002 < received.flow_m2_per_s <= wanted + 1e-9


def test_limit_that_is_a_step_of_the_wire_is_kept():
    config = Config(flow=FlowConfig(action_limit=0.064), operating_point=OperatingPoint())
    assert GateLimits.from_config(config).flow_m2_per_s == pytest.approx(4.0, abs=1e-12)


def test_limit_at_the_very_end_of_the_wire_is_kept():
    config = Config(flow=FlowConfig(action_limit=6.5534 / 62.5))
    assert GateLimits.from_config(config).flow_m2_per_s == pytest.approx(6.5534, abs=1e-12)


def test_fail_safe_settings_move_the_age():
    config = Config(ecu=EcuConfig(hold_periods=0, decay_periods=0))
    assert GateLimits.from_config(config).pressure_age_ns == config.period_ns


def test_speed_the_wire_cannot_carry_is_refused():
    with pytest.raises(ConfigError, match=r"action_limit is 7\.5 m2/s .* ends at 6\.5534"):
        GateLimits.from_config(Config(operating_point=OperatingPoint(speed=40.0)))
