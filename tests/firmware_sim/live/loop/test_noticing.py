"""What is reported of a change, and what a histogram counts."""

from dataclasses import replace
from typing import Any

from can_bridge.bus.interface import BusState
from can_bridge.command_gate import Intervention
from can_bridge.wire.messages import Mode, Reason
from firmware_sim.ecu.state_machine import OperatingMode
from firmware_sim.live.loop.latency_histogram import MODELLED, LatencyHistogram
from firmware_sim.live.loop.noticing import BOOT, START, UNPOWERED, noticed
from firmware_sim.runs.run_log import Row
from tests.firmware_sim.bench.harness import Oscillator

CONTROL = START._replace(state="CONTROL")


def test_each_change_is_reported_once():
    for now, expected in [
        (CONTROL, []),
        (CONTROL._replace(state="HOLD", reason=Reason.STREAM_LOST), ["CONTROL to HOLD: no pressures came"]),
        (CONTROL._replace(state="FAULT", reason=Reason.IMPLAUSIBLE), ["the pressures contradict each other; the jets"]),
        (CONTROL._replace(set_aside=("base_0",)), ["base_0 is set aside"]),
        (CONTROL._replace(given_up=True), ["the vehicle gives up control"]),
        (CONTROL._replace(gate=Intervention.RATE | Intervention.RANGE), ["limited to the jets' range", "largest step"]),
        (CONTROL._replace(nodes={"ECU": BusState.BUS_OFF}), ["ECU: CAN controller bus"]),
        (CONTROL._replace(state=UNPOWERED), ["CONTROL to UNPOWERED: no supply"]),
    ]:
        kinds, texts = zip(*noticed(CONTROL, now), strict=True) if expected else ((), ())
        assert ("vehicle" in kinds) == now.given_up, now
        assert len(texts) == len(expected), now
        assert all(part in text for part, text in zip(expected, texts, strict=True)), now
        assert list(noticed(now, now)) == [], now


def test_every_state_and_reason_has_words():
    for state in (*OperatingMode.__members__, UNPOWERED, BOOT):
        before = START._replace(state="ARMED" if state == "INIT" else "INIT")
        assert len(list(noticed(before, START._replace(state=state)))) == 1
    for reason in set(Reason) - {Reason.NONE}:
        assert list(noticed(CONTROL, CONTROL._replace(reason=reason)))


def row(step_ms: float) -> Row:
    values: dict[str, Any] = {
        "command": 0.0,
        "predicted_Cd": 1.0,
        "predicted_Cl": 0.0,
        "step_ms": step_ms,
        "age_ms": 8.5,
    }
    return Row(sample=Oscillator(30).sample(), mode=Mode.CONTROL, reason=Reason.NONE, **values)


def test_a_histogram_counts_the_steps_that_planned():
    histogram = LatencyHistogram(20.0, 4)
    for taken in (1.0, 3.1, 3.2, 30.0, 3.3):
        histogram.add(row(taken), 8_000_000, 20.0)
    histogram.add(replace(row(9.0), mode=Mode.HOLD), None, 20.0)
    message = histogram.message(1)
    # Of the latest four: one held, and 30 ms is beyond the last edge and counted in the last bin.
    assert (sum(message["counts"]), message["counts"][6], message["counts"][-1]) == (3, 2, 1)
    assert (message["edges"][6], message["edges"][7], len(message["edges"])) == (3.0, 3.5, 51)
    assert (message["p50"], message["max"], message["over_budget"], message["sample_to_jets_ms"]) == (
        3.3,
        30.0,
        1,
        28.5,
    )
    histogram.start(modelled=True)
    assert histogram.message(1)["p50"] is None
    histogram.add(row(3.0), 8_000_000, 0.0)
    assert (histogram.message(1)["of"], histogram.message(1)["max"]) == (MODELLED, 8.0)
