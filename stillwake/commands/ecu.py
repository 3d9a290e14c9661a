"""`stillwake ecu`: the ECU on a real bus."""

import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Final, Literal

import typer

from contract.config.vehicle import EcuConfig
from contract.errors import ConfigError
from stillwake.commands.run import cost_weights
from stillwake.releases import Trust, open_release, signature
from stillwake.settings import REAL_BUS, WEIGHTS, settings
from stillwake.stopping import until_stopped
from stillwake.terminal import ConfigFile, Overrides, visible

_USES: Final = (
    "operating_point",
    "flow.control_period",
    "flow.action_limit",
    *REAL_BUS,
    "bus.key",
    # In real time the step takes what it takes.
    *(f"ecu.{item.name}" for item in fields(EcuConfig) if item.name != "compute_time_ms"),
    WEIGHTS,
)


def ecu(
    bundle: Annotated[Path | None, typer.Argument(help="Release bundle; default: the shipped one.")] = None,
    trust: Trust = None,
    library: Annotated[
        Path | None, typer.Option(help="Run this C library of the bundle's (`export --c`) in place of ONNX Runtime.")
    ] = None,
    periods: Annotated[
        int | None, typer.Option(help="End after so many control steps; default: run until stopped.", min=1)
    ] = None,
    log: Annotated[Literal["plain", "json"], typer.Option(help="Lines of the log, on stderr.")] = "plain",
    metrics: Annotated[
        Path | None, typer.Option(help="Write counters for Prometheus here, once a second.", metavar="FILE")
    ] = None,
    stage_times: Annotated[
        Path | None, typer.Option(help="Write when each stage of each period happened here, at the end (.npz).")
    ] = None,
    freshness: Annotated[
        Path | None,
        typer.Option(
            help="With bus.key: what must outlive a restart; default: in systemd's state directory.", metavar="FILE"
        ),
    ] = None,
    priority: Annotated[int, typer.Option(help="Of SCHED_FIFO, 1 to 99; 0: an ordinary process.", min=0, max=99)] = 50,
    processor: Annotated[int | None, typer.Option(help="Run on this processor alone.", min=0)] = None,
    spin: Annotated[
        float, typer.Option(help="Stay awake for so many microseconds before each deadline.", min=0.0, max=5000.0)
    ] = 0.0,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Run the ECU on a real CAN bus: pressures in, jet commands out, once a control period, until stopped.

    The jets stay shut until the vehicle raises its enable request while the ECU is there. They are shut on the bus
    when the command ends, also by Ctrl-C or SIGTERM; when the bus is lost, which is opened again; and when another ECU
    commands on it. Real-time privileges are used where they are granted, and told where they are not.

    stillwake ecu --set bus.interface=socketcan --set bus.channel=can0
    """
    from contract.controller.interface import RunnableController
    from contract.controller.onnx_session import OnnxController
    from firmware_sim.ecu.daemon import service
    from firmware_sim.ecu.daemon.events import as_json, plain
    from firmware_sim.ecu.library_controller import open_library
    from firmware_sim.ecu.real_time.privileges import Wanted

    loaded = settings("ecu", config_file, overrides, uses=_USES)
    if freshness is not None and not loaded.config.bus.key:
        raise ConfigError("--freshness: goes with bus.key, which names no key")
    release = open_release(bundle, trust)
    weights = cost_weights(loaded, release)
    config = replace(loaded.config, mpc=replace(release.manifest.mpc, weights=weights))
    options = service.Options(
        wanted=Wanted(priority=priority, processor=processor),
        spin_ns=round(spin * 1e3),
        periods=periods,
        stage_times=stage_times,
        metrics=metrics,
        freshness=freshness,
        as_line=as_json if log == "json" else plain,
    )
    controller: RunnableController = OnnxController.of(release) if library is None else open_library(library, release)
    with until_stopped() as is_stopped:
        counters = service.serve(
            release,
            controller,
            config,
            options,
            is_stopped=is_stopped,
            write=_to_stderr,
            signature=signature(release),
            weights=weights,
        )
    if periods is not None and counters.steps < periods:
        raise KeyboardInterrupt


def _to_stderr(line: str) -> None:
    sys.stderr.write(f"{visible(line)}\n")
    sys.stderr.flush()
