"""The figures of a run: averages without and with control, totals of a drive, and computing time of the ECU's steps.
Averages are over whole shedding cycles (`wake.truck.averages`). Before control, the lift's zero crossings separate the
cycles. Under control, the average is over as many cycles of the same mean length as fit after the settling time."""

from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from can_bridge.wire.messages import Mode
from contract.arrays import Array, Mask
from contract.errors import PlantError
from contract.ledger import ledger_of
from firmware_sim.runs.run_log import WITHOUT, RunLog
from wake.truck.averages import CycleAverage, over_cycles, over_last_cycles

_ROUNDING: Final = 1e-9  # largest rounding error in t_c of the difference between a sum of spans and a sample's time
_SLOW: Final = 0.1  # share of the design speed below which |Cl| at the present speed is left out of the mean


@dataclass(frozen=True, kw_only=True)
class Regime:
    """The averages over `cycles` cycles of a run; `DragLedger` defines the coefficients."""

    cycles: int
    frequency: float
    Cd: float
    Cd_std: float
    Cd_net: float
    base_Cp: float
    mean_Cl: float
    abs_Cl: float
    rms_action: float
    jet_power: float
    Uy_std: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Averages:
    """The averages of a run before and under control. `averaged`, shape (n,), marks the periods averaged in `under`."""

    before: Regime
    under: Regime
    averaged: Mask

    @property
    def reduction_percent(self) -> float:
        return 100.0 * (1.0 - self.under.Cd / self.before.Cd)


@dataclass(frozen=True)
class NoAverages:
    """The result for a run without averages; `why` is the reason as a sentence."""

    why: str


@dataclass(frozen=True, kw_only=True)
class Latency:
    """The wall-clock times in ms of the ECU's steps with a plan; `over_budget` steps exceeded the bundle's budget."""

    p50: float
    p90: float
    p99: float
    max: float
    steps: int
    over_budget: int


def averages(log: RunLog) -> Averages | NoAverages:
    """Compute the averages up to the request for control, and from the end of the settling time on."""
    if not log.metadata.averages:
        return NoAverages("No averages were requested.")
    if log.metadata.drive is not None:
        return NoAverages("The speed follows the drive, so its energy is compared, not averages.")
    t, enabled = log.series["t"], log.enabled_at
    # The sample at the instant of the request for control still shows the wake without control.
    before = slice(0, enabled + 1)
    start = int(np.searchsorted(t, t[enabled] + log.metadata.settle - _ROUNDING)) if enabled < len(t) else len(t)
    under = slice(start, None)
    part = "without control"
    try:
        free = over_cycles(t[before], log.series["Cl"][before])
        part = "under control"
        controlled = over_last_cycles(t[under], free.frequency)
    except PlantError as error:
        return NoAverages(f"There are no averages: {part}, {error}.")
    averaged = np.zeros(len(t), dtype=bool)
    averaged[under] = controlled.weights > 0.0
    return Averages(before=_regime(log, before, free), under=_regime(log, under, controlled), averaged=averaged)


def planned_steps(log: RunLog) -> Mask:
    """Return whether the controller planned in each of the n periods, shape (n,)."""
    # In a period that the ECU skipped, the step time is NaN, and the mode is still that of the previous period.
    return np.asarray((log.series["mode"] == Mode.CONTROL) & np.isfinite(log.series["step_ms"]))


def latency(log: RunLog) -> Latency:
    """Compute the latency over the periods in which the controller planned; NaN if there were none."""
    planned = log.series["step_ms"][planned_steps(log)]
    p50, p90, p99, most = map(float, np.percentile(planned, [50, 90, 99, 100])) if len(planned) else [np.nan] * 4
    over = int((planned > log.metadata.budget_ms).sum())
    return Latency(p50=p50, p90=p90, p99=p99, max=most, steps=len(planned), over_budget=over)


def actuator_delay_ms(log: RunLog) -> float:
    """Return the configured delay from a command's arrival to the jets' action, in ms of virtual time."""
    config = log.metadata.config
    return config.vehicle.actuator_delay * config.period_ns / 1e6


def sample_to_jets_ms(log: RunLog) -> float:
    """Return the longest time from sampling to the jets' action, in ms of virtual time; NaN without a command."""
    return float(np.fmax.reduce(log.series["age_ms"])) + actuator_delay_ms(log)


def _regime(log: RunLog, part: slice, average: CycleAverage) -> Regime:
    s = {name: values[part] for name, values in log.series.items()}
    return Regime(
        cycles=average.cycles,
        frequency=average.frequency,
        Cd=float(average.mean(s["Cd"])),
        Cd_std=float(average.std(s["Cd"])),
        Cd_net=float(average.mean(ledger_of(s).Cd_net)),
        base_Cp=float(average.mean(s["base_Cp"])),
        mean_Cl=float(average.mean(s["Cl"])),
        abs_Cl=float(average.mean(np.abs(s["Cl"]))),
        rms_action=float(np.sqrt(average.mean(s["action"] ** 2))),
        jet_power=float(average.mean(s["jet_power"])),
        Uy_std=float(average.std(s["Uy_probe"])),
    )


def rounded(value: float | None, decimals: int = 6) -> float | None:
    """Round a value for JSON; return None for NaN, infinity and None."""
    if value is None or not np.isfinite(value):
        return None
    return value if isinstance(value, int) else round(value, decimals)


@dataclass(frozen=True, kw_only=True)
class DriveTotals:
    """The totals of a drive, from the end of the settling time after the request for control to the end of the drive,
    with control and (`_without`) with shut jets. Energies are in kJ per km of road for each metre of the vehicle's
    height, which equals the mean force along the road in N per metre of height: to overcome the wall's drag (`drag`);
    given to the flow by the jets (`jets`, negative if they take energy from it); of the jets, plus the energy to
    overcome the drag of wall, slots and jet momentum (`net`). The reductions by control are those of `drag` and `net`.
    `abs_Cl` is the mean of |Cl| in units of the present speed's dynamic pressure. `in_control_percent` is of the
    periods; the energies include all of them."""

    name: str
    mean_speed_m_per_s: float
    distance_m: float
    drag_kJ_per_km: float
    drag_kJ_per_km_without: float
    jets_kJ_per_km: float
    net_kJ_per_km: float
    net_kJ_per_km_without: float
    reduction_percent: float
    net_reduction_percent: float
    abs_Cl: float
    abs_Cl_without: float
    in_control_percent: float

    def rounded(self) -> dict[str, Any]:
        """Return the totals by name, rounded to six decimals; NaN becomes None."""
        return {name: value if isinstance(value, str) else rounded(value) for name, value in asdict(self).items()}


def drive_totals(log: RunLog) -> DriveTotals | None:
    """Return the totals of a run on a drive; None if the run has no drive or no averages."""
    run, t = log.metadata, log.series["t"]
    if run.drive is None or not run.averages or log.enabled_at >= len(t):
        return None
    # Times are sums of periods; their rounding errors are far smaller than the half period that is subtracted here.
    counted = t >= t[log.enabled_at] + run.settle - 0.5 * run.config.flow.control_period
    series = {name: values[counted] for name, values in log.series.items()}
    point, speed, ledger = run.config.operating_point, series["speed"], ledger_of(series)
    seconds = series["t"] * point.convective_time
    scale = point.dynamic_pressure * point.width

    def integral(values: Array) -> float:
        return float(np.trapezoid(values, seconds))

    distance = integral(speed)
    per_km = 1.0 / distance if distance > 0.0 else np.nan  # N m per m of road equals kJ per km
    drag, without, net_without = (
        per_km * integral(scale * force * speed) for force in (ledger.Cd, *(series[name] for name in WITHOUT[:2]))
    )
    jets = per_km * integral(scale * point.speed * ledger.jet_power)
    net = per_km * integral(scale * ledger.Cd_net * speed) + jets
    ratio = speed / point.speed
    moving = ratio >= _SLOW
    Cl, Cl_without = (
        float(np.mean(np.abs(series[name][moving]) / ratio[moving] ** 2)) if moving.any() else np.nan
        for name in ("Cl", WITHOUT[2])
    )
    return DriveTotals(
        name=run.drive,
        mean_speed_m_per_s=distance / float(seconds[-1] - seconds[0]),
        distance_m=distance,
        drag_kJ_per_km=drag,
        drag_kJ_per_km_without=without,
        jets_kJ_per_km=jets,
        net_kJ_per_km=net,
        net_kJ_per_km_without=net_without,
        reduction_percent=100.0 * (1.0 - drag / without),
        net_reduction_percent=100.0 * (1.0 - net / net_without),
        abs_Cl=Cl,
        abs_Cl_without=Cl_without,
        in_control_percent=100.0 * float(planned_steps(log)[counted].mean()),
    )
