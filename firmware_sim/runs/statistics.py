"""Figures of a run: without and with control, and the ECU's latency."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from can_bridge.wire.messages import Mode
from contract.ledger import ledger_of
from firmware_sim.runs.run_log import RunLog

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Regime:
    """Time averages over one part of a run; coefficients as in `contract.ledger.DragLedger`."""

    duration: float
    Cd: float
    Cd_std: float
    Cd_net: float
    base_Cp: float
    mean_Cl: float
    abs_Cl: float
    rms_action: float
    jet_power: float
    Uy_std: float


@dataclass(frozen=True, kw_only=True)
class Latency:
    """Wall-clock ms of the ECU's step while it plans, on the machine that ran it."""

    p50: float
    p99: float
    max: float
    steps: int


def regimes(log: RunLog, settle: float) -> tuple[Regime, Regime]:
    """Averages before control was requested, and from `settle` t_c after that to the end."""
    t = log.series["t"]
    before = slice(0, log.enabled_at)
    start = int(np.searchsorted(t, t[log.enabled_at] + settle - 1e-9)) if log.enabled_at < len(t) else len(t)
    return _average(log, before), _average(log, slice(start, None))


def latency(log: RunLog) -> Latency:
    """Over the periods in which the controller planned; NaN if there was none."""
    step_ms = log.series["step_ms"]
    # A period that the ECU skipped has no time and still the mode of the one before.
    planned = step_ms[(log.series["mode"] == Mode.CONTROL) & np.isfinite(step_ms)]
    if not len(planned):
        return Latency(p50=np.nan, p99=np.nan, max=np.nan, steps=0)
    p50, p99 = np.percentile(planned, [50, 99])
    return Latency(p50=float(p50), p99=float(p99), max=float(planned.max()), steps=len(planned))


def reduction_percent(uncontrolled: Regime, controlled: Regime) -> float:
    """Reduction of the wall's mean drag."""
    return 100.0 * (1.0 - controlled.Cd / uncontrolled.Cd)


def _average(log: RunLog, part: slice) -> Regime:
    s = {name: values[part] for name, values in log.series.items()}
    if not len(s["t"]):
        nan = float("nan")
        return Regime(**dict.fromkeys(Regime.__dataclass_fields__, nan))
    return Regime(
        duration=float(len(s["t"]) * (log.series["t"][1] - log.series["t"][0])),
        Cd=float(s["Cd"].mean()),
        Cd_std=float(s["Cd"].std()),
        Cd_net=float(ledger_of(s).Cd_net.mean()),
        base_Cp=float(s["base_Cp"].mean()),
        mean_Cl=float(s["Cl"].mean()),
        abs_Cl=float(np.abs(s["Cl"]).mean()),
        rms_action=float(np.sqrt((s["action"] ** 2).mean())),
        jet_power=float(s["jet_power"].mean()),
        Uy_std=float(s["Uy_probe"].std()),
    )
