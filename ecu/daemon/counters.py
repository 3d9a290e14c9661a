"""The ECU's counters after a control step, and their file for Prometheus (text format 0.0.4)."""

from collections.abc import Mapping
from dataclasses import dataclass

from can_bridge.e2e.receiver import FrameCheck
from can_bridge.wire.messages import Mode, Reason
from ecu.ecu_state import EcuState


@dataclass(frozen=True, kw_only=True)
class Counters:
    """The counters after a control step, counted since the process started.

    Attributes:
        action: action that was sent last, in U_inf W.
        busy_ns: total time of all steps in ns, each from its waking until its frames were sent.
        latest_wake_ns: largest time in ns from a deadline until the loop woke.
    """

    state: EcuState
    steps: int = 0
    left_out: int = 0
    received: int = 0
    dropped: int = 0
    not_sent: int = 0
    losses: int = 0
    action: float = 0.0
    busy_ns: int = 0
    longest_ns: int = 0
    latest_wake_ns: int = 0


def text(c: Counters, *, bundle: str) -> str:
    """Return the content of the file; `bundle` is the name of the release."""
    state, mode, reason = c.state, c.state.fail_safe.mode.on_wire, c.state.fail_safe.reason
    name_of_release = bundle.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    counts = {
        "steps": (c.steps, "Control steps."),
        "periods_left_out": (c.left_out, "Periods without a control step, because an earlier step was not finished."),
        "overruns": (state.overruns, "Whole periods that the ECU's own timing found missing."),
        "missed": (state.missed, "Steps without usable pressures."),
        "crc_errors": (state.pressures.count(FrameCheck.ERROR), "Pressure frames with a wrong CRC."),
        "repeated": (state.pressures.count(FrameCheck.REPEATED), "Pressure frames with a repeated counter."),
        "wrong_sequence": (state.pressures.count(FrameCheck.WRONG_SEQUENCE), "Pressure frames out of sequence."),
        "not_authentic": (state.verifier.refused, "Pressure frames refused by their MAC or freshness."),
        "frames_received": (c.received, "Frames of the ECU's messages."),
        "frames_dropped": (c.dropped, "Pressure frames lost because the queue was full."),
        "frames_not_sent": (c.not_sent, "Frames that the bus refused."),
        "bus_losses": (c.losses, "Times that the bus was lost."),
        "bus_off": (state.health.bus_off, "Times that the CAN controller was bus-off or the bus was lost."),
        "other_ecu_frames": (state.other_ecu.frames, "Commands and statuses of another ECU."),
        "busy_seconds": (c.busy_ns / 1e9, "Total time of all steps, from waking to the sent frames."),
    }
    gauges = {
        "action": (c.action, "Jets' action commanded last, U_inf W."),
        "longest_step_seconds": (c.longest_ns / 1e9, "Largest time from waking to the sent frames."),
        "latest_wake_seconds": (c.latest_wake_ns / 1e9, "Largest delay of a step's start after its deadline."),
        "tx_errors": (state.health.tx_errors, "Transmit error counter of the CAN controller."),
        "rx_errors": (state.health.rx_errors, "Receive error counter of the CAN controller."),
    }
    modes = {f'{{mode="{m.name}"}}': int(m is mode) for m in Mode}
    reasons = {f'{{reason="{r.name}"}}': int(r is reason) for r in Reason}
    return "".join(
        (
            _metric("info", "gauge", "The running release.", {f'{{bundle="{name_of_release}"}}': 1}),
            *(_metric(f"{name}_total", "counter", meaning, {"": value}) for name, (value, meaning) in counts.items()),
            *(_metric(name, "gauge", meaning, {"": value}) for name, (value, meaning) in gauges.items()),
            _metric("mode", "gauge", "1 for the mode on the bus.", modes),
            _metric("reason", "gauge", "1 for the reason on the bus.", reasons),
        )
    )


def _metric(name: str, kind: str, meaning: str, values: Mapping[str, float]) -> str:
    """Return the lines of a metric; `values` has a value for each label."""
    full = f"stillwake_ecu_{name}"
    samples = (f"{full}{label} {value!r}\n" for label, value in values.items())
    return f"# HELP {full} {meaning}\n# TYPE {full} {kind}\n{''.join(samples)}"
