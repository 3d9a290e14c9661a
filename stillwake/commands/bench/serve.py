"""The command that shows the closed loop on a page in a browser."""

import asyncio
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Final

import typer

from stillwake.commands.run import cost_weights
from stillwake.console.settings import WEIGHTS, settings
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import ConfigFile, Overrides, console
from stillwake.parts.releases import Trust, describe, open_release

USES: Final = (
    "body",
    "operating_point",
    "flow",
    "bus.nominal_bitrate",
    "bus.data_bitrate",
    "bus.frames",
    "bus.background",
    "bus.e2e",
    "ecu",
    "vehicle",
    WEIGHTS,
)
"""As `run`, but for authentication and another goal than the release's cost can have."""


def serve(
    host: Annotated[
        str, typer.Option(help="Address to listen at; another than this machine's own needs the token in the link.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen at; 0: any that is free.", min=0, max=65535)] = 8765,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in this machine's browser.")] = False,
    bundle: Annotated[Path | None, typer.Option(help="Release bundle; default: the shipped one.")] = None,
    trust: Trust = None,
    library: Annotated[
        Path | None, typer.Option(help="C library of the bundle's (`export --c`), for the ECU in C.")
    ] = None,
    controller: Annotated[str, typer.Option(help="To begin with: int8, c, cortex-m7 or off.")] = "int8",
    plant: Annotated[str, typer.Option(help="To begin with: wake or recording.")] = "wake",
    start: Annotated[
        Path | None, typer.Option(help="Flow state to begin from (`develop`); default: the shipped start.")
    ] = None,
    enable_after: Annotated[
        float, typer.Option(help="Time until control is requested, t_c.", min=0.2, max=1000.0)
    ] = 10.0,
    fast: Annotated[bool, typer.Option("--fast", help="As fast as this machine computes, if that is faster.")] = False,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Run the closed loop on a page in a browser, where it can be watched and disturbed.

    The page shows the wake, the forces, the bus and the ECU while they run, and acts on them: sensors and frames that
    fail, late jets, a babbling node, power cycles, other cost weights, another controller. Several browsers may look
    at once. `run --disturb` keeps as a run what was tried here.

    The loop runs at the vehicle's pace at most, and slower where the machine is slower. Only this machine can open the
    page, unless --host names another address; the link that is printed then has a token, which every request needs.

    Ctrl-C or SIGTERM ends it. If the loop fails it is started again; if it fails within 20 s of its start, the command
    ends with exit status 1.
    """
    from firmware_sim.live.serving import server
    from firmware_sim.live.settings import LiveSettings
    from stillwake.parts.live_parts import LiveParts

    loaded = settings("bench serve", config_file, overrides, uses=USES)
    release = open_release(bundle, trust)
    own, weights = release.manifest.mpc.weights, cost_weights(loaded, release)
    first = LiveSettings().changed(
        {"controller": controller, "plant": plant, "weights": asdict(weights)}, release.manifest.sensors, own
    )
    console.print(*describe(release), sep="\n")
    make = LiveParts(
        bundle=bundle,
        trust=trust,
        library=library,
        config=replace(loaded.config, mpc=release.manifest.mpc),
        start=start,
        settings=first,
        enable_after=enable_after,
    )

    def ready(url: str) -> None:
        console.print(url)
        if open_page:
            typer.launch(url)

    with until_stopped() as is_stopped:
        asyncio.run(
            server.serve(
                make,
                address=host,
                port=port,
                fast=fast,
                is_stopped=is_stopped,
                ready=ready,
                report=console.print,
            )
        )
    console.print("stopped")
