"""The command gate in C against the one in Python, to the bit, and what must hold whatever comes."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.command_gate import GatedCommand, GateLimits, Intervention, gate
from firmware_sim.ecu.timing import LATEST_NS
from tests.examples import examples

INT64 = st.integers(-(2**63), 2**63 - 1)
ODD = [0.0, -0.0, math.nan, math.inf, -math.inf, 5e-324, -5e-324, 1.7976931348623157e308, -1.7976931348623157e308]


def passed(core, flow: float, *, enable=True, previous=0.0, previous_ns=None, pressure_ns=None, now_ns=0):
    """(flow, enable, interventions) of C, with None for a time that is none."""
    found = core.lib.sw_gate(
        flow,
        enable,
        previous,
        previous_ns is not None,
        previous_ns or 0,
        pressure_ns is not None,
        pressure_ns or 0,
        now_ns,
    )
    return GatedCommand(
        flow_m2_per_s=found.flow_m2_per_s,
        enable=bool(found.enable),
        interventions=Intervention(found.interventions),
    )


def bits(command: GatedCommand) -> tuple[bytes, bool, Intervention]:
    return struct.pack("<d", command.flow_m2_per_s), command.enable, command.interventions


@st.composite
def calls(draw, limits: GateLimits):
    flows = st.floats(-3.0, 3.0).map(lambda share: share * limits.flow_m2_per_s) | st.sampled_from(ODD) | st.floats()
    previous = draw(flows)
    # The bounds themselves, and the numbers beside them.
    near = [limits.flow_m2_per_s, -limits.flow_m2_per_s, previous, previous + limits.step_m2_per_s, 0.5 * previous]
    flow = draw(flows | st.sampled_from([*near, *(math.nextafter(value, math.inf) for value in near)]))
    now_ns = draw(st.sampled_from([0, 10**16, LATEST_NS]) | INT64)
    edges = [0, -1, 1, limits.period_ns, limits.fresh_age_ns, limits.held_age_ns]
    age = st.sampled_from([edge + off for edge in edges for off in (-1, 0, 1)]) | st.integers(0, limits.held_age_ns)

    def time_before():
        if draw(st.integers(0, 9)) == 0:
            return draw(st.none() | INT64)
        before_ns = now_ns - draw(age)
        return before_ns if -(2**63) <= before_ns < 2**63 else None

    return {
        "flow": flow,
        "enable": draw(st.sampled_from([True, True, True, False])),
        "previous": previous,
        "previous_ns": time_before(),
        "pressure_ns": time_before(),
        "now_ns": now_ns,
    }


@examples(600)
@given(data=st.data())
def test_every_command_is_treated_to_the_bit_as_in_python(core, data):
    limits = GateLimits.from_config(core.config)
    call = data.draw(calls(limits))
    expected = gate(
        call["flow"],
        enable=call["enable"],
        previous_m2_per_s=call["previous"],
        previous_ns=call["previous_ns"],
        pressure_ns=call["pressure_ns"],
        now_ns=call["now_ns"],
        limits=limits,
    )
    assert bits(passed(core, **call)) == bits(expected)


@examples(150)
@given(data=st.data())
def test_no_jet_runs_without_leave_or_beyond_its_range(core, data):
    limits = GateLimits.from_config(core.config)
    call = data.draw(calls(limits))
    found = passed(core, **call)
    if not math.isnan(call["previous"]):
        assert abs(found.flow_m2_per_s) <= limits.flow_m2_per_s
    assert found.enable or (found.flow_m2_per_s == 0.0 and found.interventions)
    assert not found.enable or call["enable"]


@pytest.mark.parametrize("flow", [math.nan, math.inf, -math.inf])
def test_no_number_shuts(core, flow):
    found = passed(core, flow, pressure_ns=0)
    assert found == GatedCommand(flow_m2_per_s=0.0, enable=False, interventions=Intervention.NOT_FINITE)


def test_the_farthest_times_are_told_apart(core):
    """Their difference has no room in 64 bits with a sign."""
    earliest, latest = -(2**63), 2**63 - 1
    assert passed(core, 0.0, pressure_ns=earliest, now_ns=latest).interventions == Intervention.STALE
    assert passed(core, 0.0, pressure_ns=latest, now_ns=earliest).interventions == Intervention.STALE
    assert passed(core, 0.0, pressure_ns=latest, previous_ns=earliest, now_ns=latest).enable
    assert passed(core, 0.0, pressure_ns=0, previous_ns=latest, now_ns=0).interventions == Intervention.CLOCK


def test_half_a_period_allows_half_a_step(core):
    limits = GateLimits.from_config(core.config)
    half = limits.period_ns // 2
    found = passed(core, limits.flow_m2_per_s, previous_ns=0, pressure_ns=half, now_ns=half)
    assert found.flow_m2_per_s == limits.step_m2_per_s * 0.5
    assert found.interventions == Intervention.RATE
