"""One closed-loop run from bundle to run folder: wiring, progress, figures kept."""

import json
import math
import platform
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from can_bridge.bus import frame_log
from can_bridge.bus.python_can import PythonCanBus
from contract.atomic import replacing
from contract.config.loading import to_tree
from contract.config.tree import Config
from contract.controller.interface import RunnableController
from contract.controller.onnx_session import OnnxController
from contract.errors import BusError, StillwakeError
from contract.release.bundle import Bundle
from firmware_sim.bench.vehicle_node import PressureNode
from firmware_sim.bench.virtual_loop import VirtualLoop, Wires
from firmware_sim.ecu.ecu import Ecu
from firmware_sim.runs import run_log
from firmware_sim.runs.run_log import Row, RunLog
from firmware_sim.runs.statistics import latency, reduction_percent, regimes
from wake.pictures.drawing import vorticity_figure
from wake.plants import LivePlant, open_plant

SERIES: Final = "series.npz"
FRAMES: Final = "frames.log"
SUMMARY: Final = "summary.json"
BEFORE: Final = "vorticity_uncontrolled.png"
AFTER: Final = "vorticity_controlled.png"

WARM_UP_PLANS: Final = 3
"""Control steps on zeros before the run: ONNX Runtime allocates on first use, an ECU would at boot."""


def run_closed_loop(
    output: Path,
    bundle: Bundle,
    config: Config,
    *,
    lead_in: float,
    controlled: float,
    settle: float,
    progress: Callable[[Row, int, int], None] = lambda row, done, total: None,
    plant: AbstractContextManager[LivePlant] | None = None,
    controller: RunnableController | None = None,
) -> RunLog:
    """Run a wake under the bundle's controller and keep the results in `output`.

    Args:
        output: run folder, created if need be: series, captured frames, pictures, summary.
        bundle: verified release.
        config: the vehicle; its operating point and control period must be the bundle's.
        lead_in: t_c without control; the controller's window fills meanwhile.
        controlled: t_c with control requested.
        settle: t_c after that which the controlled averages leave out.
        progress: called with (row, periods done, periods in all) after every period.
        plant: the wake, opened here; the own solver from its shipped start without one.
        controller: what computes the bundle's control step; ONNX Runtime without one.

    Raises:
        StillwakeError: if the folder cannot be written, the bundle does not fit the vehicle, the bus cannot carry
            virtual time, or a span is shorter than a control period.
    """
    if config.bus.interface != "virtual":
        raise BusError(f"bus.interface = {config.bus.interface!r}: virtual time needs 'virtual'")
    before_periods, total = _periods(config, lead_in=lead_in, controlled=controlled)
    controller = OnnxController.of(bundle) if controller is None else controller
    controller.warm_up(WARM_UP_PLANS)
    ecu = Ecu(bundle, controller, config)
    rows: list[Row] = []
    highlight = bundle.manifest.sensors
    with ExitStack() as stack:
        # Whole runs only: every file appears when the block has succeeded, and none before.
        part = {name: stack.enter_context(replacing(output / name)) for name in (SERIES, SUMMARY, BEFORE, AFTER)}
        capture = stack.enter_context(frame_log.recording(output / FRAMES))
        vehicle, ecu_bus, monitor = (stack.enter_context(PythonCanBus.open(config.bus)) for _ in range(3))
        wake = stack.enter_context(open_plant("stillwake", output, config) if plant is None else plant)
        node = PressureNode(bundle.manifest.sensors, config)
        wires = Wires(vehicle=vehicle, ecu=ecu_bus, monitor=monitor)
        loop = VirtualLoop(wake, node, ecu, wires, config, capture)
        for k in range(total):
            if k == before_periods:
                picture = vorticity_figure(wake, highlight, title=f"without control, t = {wake.t:.1f} $t_c$")
                picture.savefig(part[BEFORE], format="png")
            rows.append(loop.period(enable_request=k >= before_periods))
            progress(rows[-1], k + 1, total)
        picture = vorticity_figure(wake, highlight, title=f"under control, t = {wake.t:.1f} $t_c$")
        picture.savefig(part[AFTER], format="png")
        facts = _facts(bundle, config, settle, ecu, wake.description, controller.description)
        log = RunLog.of(rows, before_periods, loop.totals(), facts)
        run_log.save(part[SERIES], log)
        part[SUMMARY].write_text(json.dumps(summary(log), indent=2) + "\n", encoding="utf-8")
    return log


def _periods(config: Config, **spans: float) -> tuple[int, int]:
    """Control periods of the first span in t_c, and of all together."""
    counts = [round(span / config.flow.control_period) for span in spans.values()]
    for (name, span), count in zip(spans.items(), counts, strict=True):
        if count < 1:
            raise StillwakeError(f"{name} = {span}: shorter than a control period of {config.flow.control_period}")
    return counts[0], sum(counts)


def summary(log: RunLog) -> dict[str, Any]:
    """The run in figures that other programs read; a figure that does not exist is null."""
    before, under = regimes(log, log.facts["settle"])
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
        "mpc_budget_ms": log.facts["budget_ms"],
        "frames_sent": log.bus.sent,
        "frames_lost": log.bus.lost,
        "frames_rejected": log.bus.rejected,
        "sensors": log.facts["sensors"],
        "controller": log.facts["controller"],
        "computed_by": log.facts.get("computed_by"),
        "signer": log.facts.get("signer"),
        "controlled_averages_from_t_c_after_enable": log.facts["settle"],
    }


def _facts(bundle: Bundle, config: Config, settle: float, ecu: Ecu, plant: str, computed_by: str) -> dict[str, Any]:
    manifest = bundle.manifest
    return {
        "controller": f"{manifest.name} ({manifest.precision}, {bundle.digest[:12]})",
        "computed_by": computed_by,
        "signer": bundle.signer and bundle.signer.fingerprint,
        "plant": plant,
        "sensors": list(manifest.sensors),
        "mpc": asdict(manifest.mpc),
        "budget_ms": manifest.budget_ms,
        "settle": settle,
        "status": {name: int(value) for name, value in asdict(ecu.status()).items()},
        "config": to_tree(config),
        "versions": {
            "python": platform.python_version(),
            "machine": platform.machine(),
            **{name: version(name) for name in ("stillwake", "onnxruntime", "numpy", "numba", "python-can")},
        },
    }
