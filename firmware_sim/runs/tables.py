"""A run's figures formatted for readers: the same tables on the page and in the terminal."""

import math
from typing import Final

from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.statistics import latency, reduction_percent, regimes

_DRAG_ROWS: Final = (
    ("mean Cd (wall)", "Cd", ".4f"),
    ("std of Cd", "Cd_std", ".4f"),
    ("mean base Cp", "base_Cp", "+.4f"),
    ("mean |Cl|", "abs_Cl", ".3f"),
    ("mean Cl", "mean_Cl", "+.3f"),
    ("rms action / U_inf W", "rms_action", ".4f"),
    ("mean Cd, wall + slots + jet momentum", "Cd_net", ".4f"),
    ("mean jet power / (rho U_inf^3 W / 2)", "jet_power", ".4f"),
    ("std of Uy at (10, 0)", "Uy_std", ".3f"),
)
"""Label, field of `Regime`, number format."""


def drag_rows(log: RunLog) -> list[tuple[str, str, str]]:
    """(quantity, uncontrolled, controlled), formatted."""
    before, under = regimes(log, log.metadata.settle)
    return [
        (label, f"{getattr(before, name):{style}}", f"{getattr(under, name):{style}}")
        for label, name, style in _DRAG_ROWS
    ]


def service_rows(log: RunLog) -> list[tuple[str, str]]:
    """(quantity, value), formatted: what happened on the bus and in the ECU."""
    timing = latency(log)
    ages = [age for age in log.series["age_ms"] if not math.isnan(age)]
    measured = f"{timing.p50:.2f} / {timing.p99:.2f} / {timing.max:.2f} ms" if timing.steps else "no control step ran"
    return [
        ("plant", log.metadata.plant),
        ("control step computed by", log.metadata.computed_by),
        ("control step, wall clock p50 / p99 / max", measured),
        ("budget", f"{log.metadata.budget_ms:.0f} ms"),
        ("sample to jets in virtual time, max", f"{max(ages):.2f} ms" if ages else "no command arrived"),
        ("frames sent", str(log.bus.sent)),
        ("frames lost", str(log.bus.lost)),
        ("frames rejected", str(log.bus.rejected)),
        ("periods in control / in all", f"{timing.steps} / {len(log.series['t'])}"),
    ]


def headline(log: RunLog) -> str:
    """One sentence: the reduction, and whether it counts."""
    before, under = regimes(log, log.metadata.settle)
    percent = reduction_percent(before, under)
    if math.isnan(percent):
        return "The run is too short for controlled averages."
    text = f"Wall drag {before.Cd:.3f} to {under.Cd:.3f}: {abs(percent):.1f} % {'more' if percent < 0 else 'less'}"
    # A two-dimensional wake can be bent sideways to trade drag for lift; such a reduction does not count.
    if under.abs_Cl > before.abs_Cl or abs(under.mean_Cl) > 0.1 * before.abs_Cl + 0.1:
        return f"{text}, but the wake is deflected: mean |Cl| {under.abs_Cl:.2f}, mean Cl {under.mean_Cl:+.2f}."
    return f"{text}, side force down (mean |Cl| {before.abs_Cl:.2f} to {under.abs_Cl:.2f})."
