"""The file for Prometheus, against the grammar of its text format (0.0.4)."""

import re
from dataclasses import replace

from can_bridge.bus.interface import BusHealth
from can_bridge.wire.messages import Mode, Reason
from ecu.daemon.counters import Counters, text
from ecu.ecu_state import EcuState
from ecu.pressure_reception import OtherEcu

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
        if match := re.fullmatch(rf"# TYPE ({NAME}) (counter|gauge)", line):
            assert match[1] not in typed
            typed[match[1]] = match[2]
            continue
        match = SAMPLE.fullmatch(line)
        assert match is not None, line
        assert match[1] in typed
        assert (typed[match[1]] == "counter") == match[1].endswith("_total")
        samples[match[1].removeprefix("stillwake_ecu_"), match[2] or ""] = float(match[3])
    return samples


def test_every_number_stands_under_its_name_and_one_mode_and_one_reason_are_on():
    power_on = EcuState.power_on(window=4, sensors=4, horizon=5, delay=1)
    state = replace(
        power_on,
        overruns=7,
        missed=8,
        health=BusHealth(bus_off=9, tx_errors=10, rx_errors=11),
        fail_safe=power_on.fail_safe.latch(Reason.BUS_OFF),
        other_ecu=OtherEcu(frames=12),
    )
    counters = Counters(
        state=state,
        steps=1,
        left_out=2,
        received=3,
        dropped=4,
        not_sent=5,
        losses=6,
        action=-0.025,
        busy_ns=1_500_000_000,
        longest_ns=16_000_000,
        latest_wake_ns=1,
    )
    # A bundle may have any name.
    samples = read(text(counters, bundle='a "b"\\\nc'))
    counted = (
        *("steps_total", "periods_left_out_total", "frames_received_total", "frames_dropped_total"),
        *("frames_not_sent_total", "bus_losses_total", "overruns_total", "missed_total", "bus_off_total"),
        *("tx_errors", "rx_errors", "other_ecu_frames_total"),
    )
    seconds = {"busy_seconds_total": 1.5, "longest_step_seconds": 0.016, "latest_wake_seconds": 1e-9}
    expected = dict(zip(counted, range(1, 13), strict=True)) | seconds | {"action": -0.025}
    assert {name: samples[name, ""] for name in expected} == expected
    assert samples["info", r'bundle="a \"b\"\\\nc"'] == 1
    modes = {label: value for (name, label), value in samples.items() if name == "mode"}
    reasons = {label: value for (name, label), value in samples.items() if name == "reason"}
    assert (len(modes), len(reasons)) == (len(Mode), len(Reason))
    assert [label for label, value in modes.items() if value] == ['mode="FAULT"']
    assert [label for label, value in reasons.items() if value] == ['reason="BUS_OFF"']
