"""A run in figures that other programs read."""

import math
from typing import Any

from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.statistics import latency, reduction_percent, regimes


def summary(log: RunLog) -> dict[str, Any]:
    """The content of `summary.json`; a figure that does not exist is null."""
    metadata = log.metadata
    before, under = regimes(log, metadata.settle)
    timing = latency(log)
    figures = {
        "Cd_uncontrolled": before.Cd,
        "Cd_controlled": under.Cd,
        "reduction_percent": reduction_percent(before, under),
        "base_Cp_uncontrolled": before.base_Cp,
        "base_Cp_controlled": under.base_Cp,
        "abs_Cl_uncontrolled": before.abs_Cl,
        "abs_Cl_controlled": under.abs_Cl,
        "mean_Cl_controlled": under.mean_Cl,
        "rms_action": under.rms_action,
        "Cd_net_uncontrolled": before.Cd_net,
        "Cd_net_controlled": under.Cd_net,
        "jet_power_controlled": under.jet_power,
        "mpc_ms_p50": timing.p50,
        "mpc_ms_p99": timing.p99,
        "mpc_ms_max": timing.max,
    }
    return {
        **{name: None if math.isnan(value) else round(value, 6) for name, value in figures.items()},
        "mpc_budget_ms": metadata.budget_ms,
        "frames_sent": log.bus.sent,
        "frames_lost": log.bus.lost,
        "frames_rejected": log.bus.rejected,
        "sensors": list(metadata.sensors),
        "controller": metadata.controller,
        "computed_by": metadata.computed_by,
        "signer": metadata.signer,
        "controlled_averages_from_t_c_after_enable": metadata.settle,
    }
