"""One closed-loop run from bundle to run folder."""

import json
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from datetime import date
from pathlib import Path
from typing import Final

from can_bridge.bus.backends.opening import SIMULATED
from can_bridge.bus.simulated.background_node import BackgroundNode
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.logs import frame_log
from can_bridge.secoc.node import authentication_in_virtual_time
from can_bridge.timing.traffic import background
from can_bridge.wire.message_sets import message_set
from contract.atomic import replacing
from contract.config.controller import CostWeights
from contract.config.tree import Config
from contract.controller.interface import RunnableController
from contract.controller.onnx_session import OnnxController
from contract.errors import BusError, StillwakeError
from contract.release.bundle import Bundle
from firmware_sim.bench.run_faults import NodeFault, NodeFaults, check_faults
from firmware_sim.bench.spans import Spans
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.bench.virtual_loop import BusPorts, VirtualLoop, check_bit_rates
from firmware_sim.ecu.ecu import Ecu
from firmware_sim.ecu.fit import check_sensors
from firmware_sim.runs import run_log
from firmware_sim.runs.bus_traffic import NodeErrors, WaitingTimes
from firmware_sim.runs.metadata import RunMetadata, RunOrigin
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_log import Row, RunLog
from firmware_sim.runs.summary import whole_summary
from wake.pictures.drawing import vorticity_figure
from wake.plant import LivePlant
from wake.plants import open_plant

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
    averages: bool = True,
    weights: CostWeights | None = None,
    origin: RunOrigin | None = None,
    ready: Callable[[int], None] = lambda total: None,
    progress: Callable[[Row, int, int], None] = lambda row, done, total: None,
    plant: AbstractContextManager[LivePlant] | None = None,
    controller: RunnableController | None = None,
    faults: Sequence[NodeFault] = (),
    fault_seed: int = 0,
) -> RunLog:
    """Run a wake under the bundle's controller and keep the results in `output`.

    Args:
        output: run folder (`firmware_sim.runs.run_folder`), created if need be; all files but the report. A run that is
            there is replaced when this one is whole.
        bundle: verified release.
        config: the vehicle; its operating point and control period must be the bundle's.
        lead_in, controlled, settle, averages: `firmware_sim.bench.spans.Spans`.
        weights: of the cost, in place of the bundle's.
        origin: what the run says about how it came about; made today without one.
        ready: called with the periods in all, once everything is checked and open, before the first period.
        progress: called with (row, periods done, periods in all) after every period.
        plant: the wake, opened here; the own solver from its shipped start without one.
        controller: what computes the bundle's control step; ONNX Runtime without one.
        faults: put on the bus; their times are in s of the run.
        fault_seed: of what they draw.

    Raises:
        StillwakeError: if the folder cannot be written, the bundle does not fit the vehicle, the bus cannot carry
            virtual time, the jets could never move, a span is too short, or a fault could not act.
    """
    spans = Spans(lead_in=lead_in, controlled=controlled, settle=settle, averages=averages)
    lead_in_periods, total = spans.periods(config.flow.control_period)
    _check_vehicle(config, total - lead_in_periods)
    check_faults(faults, config.bus, duration_s=total * config.period_ns / 1e9)
    authentication = authentication_in_virtual_time(config.bus)
    messages = message_set(config.bus)
    others = background(config.bus.background, config.bus, [spec.frame_id for spec in messages.specs])
    controller = OnnxController.of(bundle) if controller is None else controller
    controller.warm_up(WARM_UP_PLANS)
    ecu = Ecu(bundle, controller, config, weights=weights, authentication=authentication)
    folder, rows = RunFolder(output), list[Row]()
    with ExitStack() as stack:
        # Whole runs only: every file appears when the block has succeeded, and none before.
        series, figures, uncontrolled_picture, controlled_picture = (
            stack.enter_context(replacing(path))
            for path in (folder.series, folder.summary, folder.uncontrolled_picture, folder.controlled_picture)
        )
        capture = stack.enter_context(frame_log.recording(folder.frames))
        waits = WaitingTimes(messages=messages)
        bus = SimulatedBus(config.bus, capture, observe=waits)
        ports = {name: bus.port(name) for name in ("vehicle", "ECU", "background")[: 3 if others else 2]}
        if others:
            BackgroundNode(bus, ports["background"], others, config.bus.background.seed)
        wake = stack.enter_context(open_plant("stillwake", output, config) if plant is None else plant)
        check_sensors(bundle, wake.layout)
        node = VehicleNode(bundle.manifest.sensors, config, wake.layout, authentication)
        injecting = NodeFaults(faults, bus, fault_seed)
        connected = BusPorts(
            vehicle=injecting.around("vehicle", ports["vehicle"]),
            ecu=injecting.around("ecu", ports["ECU"]),
            ecu_health=ports["ECU"].health,
        )
        loop = VirtualLoop(wake, node, ecu, bus, connected, config)
        ready(total)
        for k in range(total):
            if k == lead_in_periods:
                _draw(wake, bundle, "without control", uncontrolled_picture)
            rows.append(loop.period(enable_request=k >= lead_in_periods))
            progress(rows[-1], k + 1, total)
        _draw(wake, bundle, "under control", controlled_picture)
        metadata = RunMetadata.of(
            bundle,
            config,
            settle=settle,
            averages=averages,
            status=ecu.status(),
            plant=wake.description,
            computed_by=controller.description,
            origin=RunOrigin.on(date.today()) if origin is None else origin,
            weights=weights,
            faults=injecting.injected(),
            fault_seed=fault_seed,
        )
        nodes = {name: NodeErrors.of(port.health(), port.refused) for name, port in ports.items()}
        traffic = waits.traffic(bus.activity(), nodes)
        log = RunLog.of(rows, lead_in_periods, loop.totals(), metadata, wake.layout, traffic=traffic)
        run_log.save(series, log)
        figures.write_text(json.dumps(whole_summary(log), indent=2) + "\n", encoding="utf-8")
    return log


def _check_vehicle(config: Config, requested: int) -> None:
    """Raises StillwakeError for a bus or an actuator with which the run could not be one."""
    if config.bus.interface != SIMULATED:
        raise BusError(
            f"bus.interface = {config.bus.interface!r}: a run is in virtual time, on a bus that is simulated; only "
            f"{SIMULATED!r} is possible"
        )
    check_bit_rates(config)
    if config.vehicle.actuator_delay >= requested:
        raise StillwakeError(
            f"vehicle.actuator_delay = {config.vehicle.actuator_delay}: control is requested for {requested} periods, "
            "so the jets would never move; the delay must be shorter"
        )


def _draw(wake: LivePlant, bundle: Bundle, state: str, target: Path) -> None:
    """The vorticity now, as PNG, with the bundle's sensors marked."""
    figure = vorticity_figure(wake, bundle.manifest.sensors, title=f"{state}, t = {wake.t:.1f} $t_c$")
    figure.savefig(target, format="png")
