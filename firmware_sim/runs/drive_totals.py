"""The totals of a drive with and without control: energy to overcome drag, and energy of the jets."""

from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.ledger import ledger_of
from firmware_sim.runs.run_log import WITHOUT, RunLog
from firmware_sim.runs.statistics import planned_steps, rounded

_SLOW: Final = 0.1
"""Share of the design speed below which |Cl|, in units of the present dynamic pressure, is not counted."""


@dataclass(frozen=True, kw_only=True)
class DriveTotals:
    """Totals of a drive, from the end of the settling time after the request for control to the end of the drive.
    Energies are in kJ per km of road for each metre of the vehicle's height. Such an energy equals the mean force along
    the road in N per metre of height.

    Attributes:
        drag_kJ_per_km, drag_kJ_per_km_without: energy to overcome the wall's drag, with and without control.
        jets_kJ_per_km: energy that the jets give to the flow; negative if they take energy.
        net_kJ_per_km, net_kJ_per_km_without: energy of the jets, plus energy to overcome the drag of wall, slots and
            jet momentum; with and without control.
        reduction_percent, net_reduction_percent: reductions, by control, of the drag energy and of the net energy.
        abs_Cl, abs_Cl_without: mean of |Cl| in units of the present speed's dynamic pressure, with and without control.
        in_control_percent: percentage of the periods in control; the energies include all periods.
    """

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
