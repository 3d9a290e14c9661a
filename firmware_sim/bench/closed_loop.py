"""One closed-loop run from bundle to run folder."""

import json
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Final

from can_bridge.bus import frame_log
from can_bridge.bus.simulated import SimulatedBus
from contract.atomic import replacing
from contract.config.tree import Config
from contract.controller.interface import RunnableController
from contract.controller.onnx_session import OnnxController
from contract.errors import BusError, StillwakeError
from contract.release.bundle import Bundle
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.bench.virtual_loop import BusPorts, VirtualLoop
from firmware_sim.ecu.ecu import Ecu
from firmware_sim.runs import run_log
from firmware_sim.runs.metadata import RunMetadata
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_log import Row, RunLog
from firmware_sim.runs.summary import summary
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
    progress: Callable[[Row, int, int], None] = lambda row, done, total: None,
    plant: AbstractContextManager[LivePlant] | None = None,
    controller: RunnableController | None = None,
) -> RunLog:
    """Run a wake under the bundle's controller and keep the results in `output`.

    Args:
        output: run folder (`firmware_sim.runs.run_folder`), created if need be; all files but the report.
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
    lead_in_periods, total = _periods(config, lead_in=lead_in, controlled=controlled)
    controller = OnnxController.of(bundle) if controller is None else controller
    controller.warm_up(WARM_UP_PLANS)
    ecu = Ecu(bundle, controller, config)
    node = VehicleNode(bundle.manifest.sensors, config)
    folder, rows = RunFolder(output), list[Row]()
    with ExitStack() as stack:
        # Whole runs only: every file appears when the block has succeeded, and none before.
        series, figures, uncontrolled_picture, controlled_picture = (
            stack.enter_context(replacing(path))
            for path in (folder.series, folder.summary, folder.uncontrolled_picture, folder.controlled_picture)
        )
        capture = stack.enter_context(frame_log.recording(folder.frames))
        bus = SimulatedBus(config.bus, capture)
        wake = stack.enter_context(open_plant("stillwake", output, config) if plant is None else plant)
        loop = VirtualLoop(wake, node, ecu, bus, BusPorts(vehicle=bus.port(), ecu=bus.port()), config)
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
            status=ecu.status(),
            plant=wake.description,
            computed_by=controller.description,
        )
        log = RunLog.of(rows, lead_in_periods, loop.totals(), metadata)
        run_log.save(series, log)
        figures.write_text(json.dumps(summary(log), indent=2) + "\n", encoding="utf-8")
    return log


def _periods(config: Config, **spans: float) -> tuple[int, int]:
    """Control periods of the first span in t_c, and of all together."""
    counts = [round(span / config.flow.control_period) for span in spans.values()]
    for (name, span), count in zip(spans.items(), counts, strict=True):
        if count < 1:
            raise StillwakeError(f"{name} = {span}: shorter than a control period of {config.flow.control_period}")
    return counts[0], sum(counts)


def _draw(wake: LivePlant, bundle: Bundle, state: str, target: Path) -> None:
    """The vorticity now, as PNG, with the bundle's sensors marked."""
    figure = vorticity_figure(wake, bundle.manifest.sensors, title=f"{state}, t = {wake.t:.1f} $t_c$")
    figure.savefig(target, format="png")
