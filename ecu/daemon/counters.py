"""The ECU's counters after a control step, and their file for Prometheus (text format 0.0.4)."""

from collections.abc import Iterator
from dataclasses import dataclass

from can_bridge.e2e.receiver import FrameCheck
from can_bridge.wire.messages import Mode, Reason
from ecu.ecu_state import EcuState


@dataclass(frozen=True, kw_only=True)
class Counters:
    """The counters after a control step, counted since the process started.

    Attributes:
        dropped: number of pressure frames that were dropped because the queue was full.
        not_sent: number of frames that the bus refused.
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
    other_ecu: int = 0
    action: float = 0.0
    busy_ns: int = 0
    longest_ns: int = 0
    latest_wake_ns: int = 0


def text(counters: Counters, *, bundle: str) -> str:
    """Return the content of the file; `bundle` is the name of the release."""
    return "".join(_lines(counters, bundle))


def _lines(c: Counters, bundle: str) -> Iterator[str]:
    state = c.state
    yield from _metric("info", "gauge", "The running release.", {f'bundle="{_escaped(bundle)}"': 1})
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
        "other_ecu_frames": (c.other_ecu, "Commands and statuses of another ECU."),
        "busy_seconds": (c.busy_ns / 1e9, "Total time of all steps, from waking to the sent frames."),
    }
    for name, (value, meaning) in counts.items():
        yield from _metric(f"{name}_total", "counter", meaning, {"": value})
    gauges = {
        "action": (c.action, "Jets' action commanded last, U_inf W."),
        "longest_step_seconds": (c.longest_ns / 1e9, "Largest time from waking to the sent frames."),
        "latest_wake_seconds": (c.latest_wake_ns / 1e9, "Largest delay of a step's start after its deadline."),
        "tx_errors": (state.health.tx_errors, "Transmit error counter of the CAN controller."),
        "rx_errors": (state.health.rx_errors, "Receive error counter of the CAN controller."),
    }
    for name, (value, meaning) in gauges.items():
        yield from _metric(name, "gauge", meaning, {"": value})
    mode, reason = state.fail_safe.mode.on_wire, state.fail_safe.reason
    yield from _metric("mode", "gauge", "1 for the mode on the bus.", {_label("mode", m): int(m is mode) for m in Mode})
    yield from _metric(
        "reason", "gauge", "1 for the reason on the bus.", {_label("reason", r): int(r is reason) for r in Reason}
    )


def _metric(name: str, kind: str, meaning: str, values: dict[str, float]) -> Iterator[str]:
    full = f"stillwake_ecu_{name}"
    yield f"# HELP {full} {meaning}\n# TYPE {full} {kind}\n"
    for label, value in values.items():
        yield f"{full}{{{label}}} {value!r}\n" if label else f"{full} {value!r}\n"


def _label(name: str, value: Mode | Reason) -> str:
    return f'{name}="{value.name}"'


def _escaped(value: str) -> str:
    return value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
