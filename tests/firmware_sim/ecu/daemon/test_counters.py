"""The file for Prometheus, against the grammar of its text format (0.0.4)."""

import re
from dataclasses import replace

import pytest

from can_bridge.bus.interface import BusHealth
from can_bridge.wire.messages import Mode, Reason
from firmware_sim.ecu.daemon.counters import Counters, text
from firmware_sim.ecu.ecu_state import EcuState

NAME = r"[a-zA-Z_:][a-zA-Z0-9_:]*"
LABEL = r'[a-zA-Z_][a-zA-Z0-9_]*="(?:[^"\\\n]|\\["\\n])*"'
SAMPLE = re.compile(rf"({NAME})(?:\{{({LABEL}(?:,{LABEL})*)\}})? (\S+)")


def read(content: str) -> dict[tuple[str, str], float]:
    """Samples by name and labels; every line must be one of the format's, each metric with its type before it."""
    assert content.endswith("\n")
    samples, typed = {}, {}
    for line in content.splitlines():
        if line.startswith("# HELP "):
            continue
        if found := re.fullmatch(rf"# TYPE ({NAME}) (counter|gauge)", line):
            assert found[1] not in typed
            typed[found[1]] = found[2]
            continue
        found = SAMPLE.fullmatch(line)
        assert found is not None, line
        assert found[1] in typed
        assert (typed[found[1]] == "counter") == found[1].endswith("_total")
        samples[found[1].removeprefix("stillwake_ecu_"), found[2] or ""] = float(found[3])
    return samples


@pytest.fixture
def state() -> EcuState:
    return EcuState.power_on(window=4, sensors=4, horizon=5, delay=1)


def test_every_number_stands_under_its_name(state):
    state = replace(state, overruns=7, missed=8, health=BusHealth(bus_off=9, tx_errors=10, rx_errors=11))
    counters = Counters(
        state=state,
        steps=1,
        left_out=2,
        received=3,
        dropped=4,
        not_sent=5,
        losses=6,
        other_ecu=12,
        action=-0.025,
        busy_ns=1_500_000_000,
        longest_ns=16_000_000,
        latest_wake_ns=1,
    )
    samples = read(text(counters, bundle="truck"))
    expected = {
        "steps_total": 1,
        "periods_left_out_total": 2,
        "frames_received_total": 3,
        "frames_dropped_total": 4,
        "frames_not_sent_total": 5,
        "bus_losses_total": 6,
        "overruns_total": 7,
        "missed_total": 8,
        "bus_off_total": 9,
        "tx_errors": 10,
        "rx_errors": 11,
        "other_ecu_frames_total": 12,
        "action": -0.025,
        "busy_seconds_total": 1.5,
        "longest_step_seconds": 0.016,
        "latest_wake_seconds": 1e-9,
    }
    assert {name: samples[name, ""] for name in expected} == expected


def test_one_mode_and_one_reason_are_on(state):
    state = replace(state, fail_safe=state.fail_safe.latch(Reason.BUS_OFF))
    samples = read(text(Counters(state=state), bundle=""))
    modes = {label: value for (name, label), value in samples.items() if name == "mode"}
    reasons = {label: value for (name, label), value in samples.items() if name == "reason"}
    assert len(modes) == len(Mode)
    assert [label for label, value in modes.items() if value] == ['mode="FAULT"']
    assert len(reasons) == len(Reason)
    assert [label for label, value in reasons.items() if value] == ['reason="BUS_OFF"']


def test_a_bundle_may_have_any_name(state):
    samples = read(text(Counters(state=state), bundle='a "b"\\\nc'))
    assert samples["info", r'bundle="a \"b\"\\\nc"'] == 1
