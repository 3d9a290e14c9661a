"""The figures of a run: as text, in tables for the page and the terminal, and as data for other programs."""

from dataclasses import asdict
from math import isnan
from typing import Any, Final

from contract.config import loading
from firmware_sim.runs import statistics
from firmware_sim.runs.control import control, held_while_averaged, set_aside, trouble
from firmware_sim.runs.metadata import RunMetadata
from firmware_sim.runs.run_log import RunLog

_DRAG_ROWS: Final = (
    ("mean Cd (wall)", "Cd", ".4f"),
    ("std of Cd", "Cd_std", ".4f"),
    ("mean base Cp", "base_Cp", "+.4f"),
    ("mean |Cl|", "abs_Cl", ".3f"),
    ("mean Cl", "mean_Cl", "+.3f"),
    ("rms action / U_inf W", "rms_action", ".4f"),
    ("mean Cd, wall + slots + jet momentum", "Cd_net", ".4f"),
    ("mean jet power / (rho U_inf^3 W / 2)", "jet_power", ".4f"),
    ("std of Uy at {probe}", "Uy_std", ".3f"),
    ("whole shedding cycles averaged", "cycles", "d"),
)
"""Label, field of `Regime`, and number format of each row. In a label, {probe} is the position of the wake probe."""
_ECUS: Final = {"python": "in Python", "c": "in C, on this machine", "mcu": "in C, on an emulated Cortex-M7"}
ENOUGH_CYCLES: Final = 2
"""Smallest number of cycles that an average needs, because drag varies by several per cent between cycles. A span of
two cycles contains a whole cycle in any phase."""
_STILL: Final = 0.01  # rms action of still jets, as a share of the limit; a working controller reaches about 0.5


def drag_rows(log: RunLog) -> list[tuple[str, str, str]]:
    """Return (quantity, value without control, value under control) as text, or the reason for missing averages."""
    if (drive := statistics.drive_totals(log)) is not None:
        return _drive_rows(drive)
    means = statistics.averages(log)
    if isinstance(means, statistics.NoAverages):
        return [(means.why, "", "")]
    probe = "({:g}, {:g})".format(*log.metadata.config.body.wake_probe)
    return [
        (label.format(probe=probe), f"{getattr(means.before, name):{style}}", f"{getattr(means.under, name):{style}}")
        for label, name, style in _DRAG_ROWS
    ]


def _drive_rows(drive: statistics.DriveTotals) -> list[tuple[str, str, str]]:
    way = f"{drive.distance_m / 1e3:.3f} km at {drive.mean_speed_m_per_s:.2f} m/s"
    return [
        (f"drive {drive.name}", way, f"{way}, in control {drive.in_control_percent:.1f} %"),
        ("energy against wall drag / (kJ/km m)", f"{drive.drag_kJ_per_km_without:.1f}", f"{drive.drag_kJ_per_km:.1f}"),
        ("energy of the jets / (kJ/km m)", "0.0", f"{drive.jets_kJ_per_km:.1f}"),
        (
            "net: wall, slots, jet momentum and jets / (kJ/km m)",
            f"{drive.net_kJ_per_km_without:.1f}",
            f"{drive.net_kJ_per_km:.1f}",
        ),
        ("less wall drag / less net, %", "", f"{drive.reduction_percent:.2f} / {drive.net_reduction_percent:.2f}"),
        ("mean |Cl|, present speed", f"{drive.abs_Cl_without:.3f}", f"{drive.abs_Cl:.3f}"),
    ]


def service_rows(log: RunLog) -> list[tuple[str, str]]:
    """Return (quantity, value) as text for each row about the bus and the ECU."""
    run, timing, longest = log.metadata, statistics.latency(log), statistics.sample_to_jets_ms(log)
    delay = statistics.actuator_delay_ms(log)
    times = f"{timing.p50:.2f} / {timing.p90:.2f} / {timing.p99:.2f} / {timing.max:.2f} ms"
    measured = times if timing.steps else "no control step ran"
    # For an emulated core, the time that the emulation takes on this machine is not compared with the budget.
    on_this_machine = [("emulating a step on this machine, p50 / p90 / p99 / max", measured)]
    if run.ecu.clock_mhz is None:
        within = f"within {run.budget_ms:g} ms in {timing.steps - timing.over_budget}"
        on_this_machine = [
            ("control step on this machine, p50 / p90 / p99 / max", measured),
            ("the same against the budget", f"{within} of {timing.steps} steps; holds for this machine only"),
        ]
    changed = run.changed_weights.items()
    weights = ", ".join(f"{name} {ours:g} (bundle {bundles:g})" for name, (ours, bundles) in changed)
    clock = "" if run.ecu.clock_mhz is None else f" at {run.ecu.clock_mhz:g} MHz"
    of_actuator = f", {delay:g} ms of it the actuator's delay" if delay else ""
    actuator = run.config.vehicle.actuator_delay
    return [
        *_control_rows(log),
        *(
            ("disturbance", f"{one.text}: acted {one.acted} time{'s' * (one.acted != 1)}, seed {run.fault_seed}")
            for one in run.faults
        ),
        ("plant", run.plant),
        ("ECU", _ECUS.get(run.ecu.kind, run.ecu.kind) + clock),
        ("control step computed by", run.computed_by),
        ("cost weights", f"not the bundle's: {weights}" if weights else "the bundle's"),
        ("virtual compute time", _charged(run)),
        ("periods left out by the ECU (overruns)", str(run.status.overruns)),
        *on_this_machine,
        (
            "sample to jets in virtual time, max",
            "no command arrived" if isnan(longest) else f"{longest:.2f} ms{of_actuator}",
        ),
        ("actuator's delay / compensated by the ECU", f"{actuator} / {run.config.ecu.delay_steps} periods"),
        ("pressure frames and commands sent", str(log.bus.sent)),
        ("of these lost on the bus", str(log.bus.lost)),
        ("of these rejected end to end", str(log.bus.rejected)),
        ("steps without usable pressures (the first one or two always are)", str(run.status.missed)),
        ("CRC errors", str(run.status.crc_errors)),
        *[("pressure frames refused as not authentic", str(run.status.not_authentic))] * bool(run.config.bus.key),
        *_bus_rows(log),
    ]


def headline(log: RunLog) -> str:
    """Summarise the run, problems first. Warn about a reduction unless control was held and side force fell."""
    warning, means = trouble(log), statistics.averages(log)
    text = means.why if isinstance(means, statistics.NoAverages) else _judged(log, means)
    if (drive := statistics.drive_totals(log)) is not None:
        less, net = (
            f"{abs(percent):.1f} % {'more' if percent < 0 else 'less'}"
            for percent in (drive.reduction_percent, drive.net_reduction_percent)
        )
        energy = f"{less} energy against wall drag, {net} including the jets and their drag"
        text = f"Drive {drive.name}: {energy}, mean |Cl| {drive.abs_Cl_without:.2f} to {drive.abs_Cl:.2f}."
        if isnan(drive.reduction_percent):
            text = f"Drive {drive.name}: no reduction, because the vehicle did not move."
    times = [f"{name} from t = {log.series['t'][period]:.1f} t_c on" for name, period in set_aside(log)]
    without = f"The ECU set aside {', '.join(times)}." if times else None
    short = None
    if (
        isinstance(means, statistics.Averages)
        and (count := min(means.before.cycles, means.under.cycles)) < ENOUGH_CYCLES
    ):
        short = f"Too short to judge by: cycles averaged {count}, at least {ENOUGH_CYCLES} are needed."
    faults = "; ".join(one.text for one in log.metadata.faults)
    disturbed = f"Disturbed ({faults})." if faults else None
    return " ".join(part for part in (warning, disturbed, without, text, short) if part is not None)


def _judged(log: RunLog, found: statistics.Averages) -> str:
    before, under = found.before, found.under
    drag = f"Wall drag {before.Cd:.3f} to {under.Cd:.3f}"
    if not held_while_averaged(log, found.averaged):
        held = control(log)
        return f"{drag}; no reduction is claimed: in control {held.in_control} of {held.requested} periods."
    if under.rms_action < _STILL * log.metadata.config.flow.action_limit:
        return f"{drag}; no reduction is claimed: the jets hardly moved (rms action {under.rms_action:.2g})."
    percent = found.reduction_percent
    text = f"{drag}: {abs(percent):.1f} % {'more' if percent < 0 else 'less'}"
    # A two-dimensional wake can be deflected to one side, which reduces drag but increases lift. This is no success.
    if abs(under.mean_Cl) > 0.1 * before.abs_Cl + 0.1:
        return f"{text}, but the wake is deflected: mean Cl {before.mean_Cl:+.2f} to {under.mean_Cl:+.2f}."
    if under.abs_Cl >= before.abs_Cl:
        return f"{text}, but the side force did not fall (mean |Cl| {before.abs_Cl:.2f} to {under.abs_Cl:.2f})."
    return f"{text}, side force down (mean |Cl| {before.abs_Cl:.2f} to {under.abs_Cl:.2f})."


def _control_rows(log: RunLog) -> list[tuple[str, str]]:
    found = control(log)
    fault = "none"
    if found.fault is not None:
        fault = f"{found.fault.reason} at t = {found.fault.t:.1f} t_c, {found.fault.after_enable} periods after enable"
    filling = f", {found.warm_up} of them while the window filled" if found.warm_up else ""
    return [
        ("ECU fault", fault),
        ("periods in control / requested", f"{found.in_control} / {found.requested}{filling}"),
        ("periods by mode while requested", ", ".join(f"{name} {count}" for name, count in found.modes.items())),
    ]


def _bus_rows(log: RunLog) -> list[tuple[str, str]]:
    traffic = log.traffic
    waits = ", ".join(f"{name} {wait:.3f} ms" for name, wait in traffic.longest_wait_ms.items())
    errors = [
        f"{name} {node.state.lower().replace('_', '-')} {node.tx_errors} / {node.rx_errors} / {node.bus_off}"
        for name, node in traffic.nodes.items()
    ]
    return [
        ("bus load, all nodes", f"{100 * traffic.load:.1f} %"),
        ("frames on the bus, all nodes / error frames", f"{traffic.frames} / {traffic.error_frames}"),
        ("longest wait for the bus", waits or "nothing was sent"),
        ("CAN controllers: state, TEC / REC / times bus-off", ", ".join(errors)),
        ("frames that the bus refused", str(sum(node.refused for node in traffic.nodes.values()))),
    ]


def _charged(run: RunMetadata) -> str:
    period, ecu = run.config.period_ns / 1e6, run.ecu
    if ecu.clock_mhz is None:
        longest = run.config.ecu.compute_time_ms
        times = f"{longest:g} ms"
    elif ecu.modelled_ms is None or ecu.modelled_ms_max is None:
        return "by the core's modelled cycles: no control step ran"
    else:
        longest = ecu.modelled_ms_max
        times = f"by the core's modelled cycles, with a plan {ecu.modelled_ms:.2f} / {longest:.2f} ms (median / max)"
    return f"{times} of a period of {period:g} ms: {'fits' if longest <= period else 'does not fit'}"


def summary(log: RunLog) -> dict[str, Any]:
    """Return the measured figures that `stillwake run --json` prints. An unknown figure is null. `reduction_percent` is
    null unless the controller was in control in all averaged periods."""
    metadata, held, drive, timing = log.metadata, control(log), statistics.drive_totals(log), statistics.latency(log)
    names = ("overruns", "missed", "crc_errors", "not_authentic", "bus_off")
    counted = {name: getattr(metadata.status, name) for name in names}
    waits = {name: statistics.rounded(wait) for name, wait in log.traffic.longest_wait_ms.items()}
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
        **{f"mpc_ms_{name}": statistics.rounded(getattr(timing, name)) for name in ("p50", "p90", "p99", "max")},
        "mpc_budget_ms": metadata.budget_ms,
        "compute_time_ms": metadata.config.ecu.compute_time_ms,
        "sample_to_jets_ms_max": statistics.rounded(statistics.sample_to_jets_ms(log)),
        "counters": {**counted, "frames_lost": log.bus.lost, "frames_rejected": log.bus.rejected},
        "bus": {**asdict(log.traffic), "load": statistics.rounded(log.traffic.load), "longest_wait_ms": waits},
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


def _averaged(log: RunLog) -> dict[str, float | None]:
    found = statistics.averages(log)
    claimed = before = under = None
    if isinstance(found, statistics.Averages):
        before, under = found.before, found.under
        claimed = found.reduction_percent if held_while_averaged(log, found.averaged) else None
    parts = (("uncontrolled", before), ("controlled", under))
    values = {f"{name}_{part}": getattr(regime, name, None) for name in _BOTH for part, regime in parts}
    values |= {"reduction_percent": claimed, "rms_action": getattr(under, "rms_action", None)}
    values |= {"jet_power_controlled": getattr(under, "jet_power", None)}
    values |= {"shedding_frequency": getattr(before, "frequency", None)}
    return {name: statistics.rounded(value) for name, value in values.items()}
