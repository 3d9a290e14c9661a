"""The figures of a run as data for other programs."""

from dataclasses import asdict
from typing import Any, Final

from contract.config import loading
from firmware_sim.runs.control import control, held_while_averaged, set_aside, trouble
from firmware_sim.runs.drive_totals import drive_totals
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.run_tables import headline
from firmware_sim.runs.statistics import NoAverages, averages, latency, rounded, sample_to_jets_ms


def summary(log: RunLog) -> dict[str, Any]:
    """Return the measured figures that `stillwake run --json` prints. An unknown figure is null. `reduction_percent` is
    null unless the controller was in control in all averaged periods."""
    metadata, held, drive, timing = log.metadata, control(log), drive_totals(log), latency(log)
    names = ("overruns", "missed", "crc_errors", "not_authentic", "bus_off")
    counted = {name: getattr(metadata.status, name) for name in names}
    waits = {name: rounded(wait) for name, wait in log.traffic.longest_wait_ms.items()}
    return {
        "headline": headline(log),
        "trouble": trouble(log),
        "fault": None if held.fault is None else asdict(held.fault),
        "modes": dict(held.modes),
        "set_aside": [{"sensor": name, "t": float(log.series["t"][period])} for name, period in set_aside(log)],
        "periods_requested": held.requested,
        "periods_in_control": held.in_control,
        "periods_warm_up": held.warm_up,
        **_averaged(log),
        "drive": None if drive is None else drive.rounded(),
        **{f"mpc_ms_{name}": rounded(getattr(timing, name)) for name in ("p50", "p90", "p99", "max")},
        "mpc_budget_ms": metadata.budget_ms,
        "compute_time_ms": metadata.config.ecu.compute_time_ms,
        "sample_to_jets_ms_max": rounded(sample_to_jets_ms(log)),
        "counters": {**counted, "frames_lost": log.bus.lost, "frames_rejected": log.bus.rejected},
        "bus": {**asdict(log.traffic), "load": rounded(log.traffic.load), "longest_wait_ms": waits},
        "injected_faults": [asdict(one) for one in metadata.faults],
        "fault_seed": metadata.fault_seed,
        "frames_sent": log.bus.sent,
        "frames_lost": log.bus.lost,
        "frames_rejected": log.bus.rejected,
        "sensors": list(metadata.sensors),
        "controller": metadata.controller,
        "computed_by": metadata.computed_by,
        "ecu": asdict(metadata.ecu),
        "signer": metadata.signer,
        "controlled_averages_from_t_c_after_enable": metadata.settle,
    }


def whole_summary(log: RunLog) -> dict[str, Any]:
    """Return the content of `summary.json`: the measured figures and all properties of the run."""
    metadata = log.metadata
    return {
        **summary(log),
        "bundle": {"controller": metadata.controller, "digest": metadata.digest, "signer": metadata.signer},
        "plant": metadata.plant,
        "weights": asdict(metadata.weights),
        "weights_changed": sorted(metadata.changed_weights),
        "mpc": asdict(metadata.mpc),
        "settings": loading.to_tree(metadata.config),
        "started_with": asdict(metadata.origin),
        "versions": dict(metadata.versions),
    }


_BOTH: Final = ("Cd", "base_Cp", "abs_Cl", "mean_Cl", "Cd_net", "cycles")
_PARTS: Final = (("uncontrolled", "before"), ("controlled", "under"))


def _averaged(log: RunLog) -> dict[str, float | None]:
    found = averages(log)
    values: dict[str, float | None] = dict.fromkeys(f"{name}_{part}" for name in _BOTH for part, _ in _PARTS)
    values |= dict.fromkeys(("reduction_percent", "rms_action", "jet_power_controlled", "shedding_frequency"))
    if isinstance(found, NoAverages):
        return values
    claimed = found.reduction_percent if held_while_averaged(log, found.averaged) else None
    values |= {f"{name}_{part}": getattr(getattr(found, field), name) for name in _BOTH for part, field in _PARTS}
    values |= {"reduction_percent": claimed, "rms_action": found.under.rms_action}
    values |= {"jet_power_controlled": found.under.jet_power, "shedding_frequency": found.before.frequency}
    return {name: rounded(value) for name, value in values.items()}
