"""The figures of a run as data for other programs."""

from dataclasses import asdict
from typing import Any

from contract.config import loading
from firmware_sim.runs.control import control, held_while_averaged, set_aside, trouble
from firmware_sim.runs.drive_totals import drive_totals
from firmware_sim.runs.run_log import RunLog
from firmware_sim.runs.run_tables import headline
from firmware_sim.runs.statistics import NoAverages, averages, latency, rounded, sample_to_jets_ms


def summary(log: RunLog) -> dict[str, Any]:
    """Return the measured figures that `stillwake run --json` prints. An unknown figure is null.

    `reduction_percent` is null unless the controller was in control in all averaged periods.
    """
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


def _averaged(log: RunLog) -> dict[str, float | None]:
    names = (
        *("Cd_uncontrolled", "Cd_controlled", "reduction_percent", "base_Cp_uncontrolled", "base_Cp_controlled"),
        *("abs_Cl_uncontrolled", "abs_Cl_controlled", "mean_Cl_uncontrolled", "mean_Cl_controlled", "rms_action"),
        *("Cd_net_uncontrolled", "Cd_net_controlled", "jet_power_controlled"),
        *("cycles_uncontrolled", "cycles_controlled", "shedding_frequency"),
    )
    found = averages(log)
    if isinstance(found, NoAverages):
        return dict.fromkeys(names)
    before, under = found.before, found.under
    claimed = held_while_averaged(log, found.averaged)
    values: tuple[float | None, ...] = (
        *(before.Cd, under.Cd, found.reduction_percent if claimed else None, before.base_Cp, under.base_Cp),
        *(before.abs_Cl, under.abs_Cl, before.mean_Cl, under.mean_Cl, under.rms_action),
        *(before.Cd_net, under.Cd_net, under.jet_power),
        *(before.cycles, under.cycles, before.frequency),
    )
    return {name: rounded(value) for name, value in zip(names, values, strict=True)}
