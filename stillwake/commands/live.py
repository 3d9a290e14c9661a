"""The command that shows the closed loop on a page in a browser."""

import asyncio
from dataclasses import replace
from typing import Annotated, Final, Literal

import typer

from stillwake.console import options as shared
from stillwake.console.settings import COST_WEIGHTS, VIRTUAL_BUS, settings
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import console
from stillwake.parts.releases import asked_calibration, describe, open_release

USES: Final = ("body", "operating_point", "flow", *VIRTUAL_BUS, "ecu", "vehicle", COST_WEIGHTS)
"""The settings of `run`. Only the weights of the section `mpc` are used, because a release accepts no other changes in
this section."""

Host = Annotated[str, typer.Option(help="Address to listen at; only localhost needs no token in the link.")]
EcuName = Annotated[Literal["python", "c", "mcu", "off"], typer.Option("--ecu", help="Controller at the start.")]


def live(
    host: Host = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen at; 0: any free port.", min=0, max=65535)] = 8765,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in this machine's browser.")] = False,
    bundle: shared.Bundle = None,
    library: shared.Library = None,
    ecu: EcuName = "python",
    plant: Annotated[Literal["wake", "recording"], typer.Option("--plant", help="Plant at the start.")] = shared.WAKE,
    state: shared.State = None,
    lead_in: shared.LeadIn = 10.0,
    fast: Annotated[bool, typer.Option("--fast", help="Run faster than real time if this machine can.")] = False,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Run the closed loop and show it on a page in a browser, on which a user can disturb the loop.

    The page shows the wake, the forces, the bus and the ECU while they run. A user can make sensors and frames fail,
    delay the jets, add a babbling node, switch the power off and on, change the cost weights, and choose another ECU.
    Several browsers may show the page at the same time. `run --disturb` makes a stored run with the same disturbances.

    The loop runs in real time, or slower if the machine is too slow. Only this machine can open the page, unless --host
    names another address; the printed link then has a token, which every request needs.

    Ctrl-C or SIGTERM ends the command. A loop that fails is restarted if it ran for at least 20 s; otherwise the
    command ends with exit status 1.
    """
    from firmware_sim.live.serving import server
    from firmware_sim.live.settings import LiveSettings
    from stillwake.parts.live_parts import LiveParts

    loaded = settings("live", given, uses=USES)
    shared.steps_of("--lead-in", lead_in, loaded.config.flow.control_period)
    release = open_release(bundle)
    calibration = asked_calibration(loaded, release)
    console.print(*describe(release), sep="\n")
    make = LiveParts(
        bundle=bundle,
        library=library,
        config=replace(loaded.config, mpc=release.manifest.mpc),
        state=state,
        settings=LiveSettings(controller=ecu, plant=plant, weights=calibration.weights),
        lead_in=lead_in,
    )

    def ready(url: str) -> None:
        console.print(url)
        if open_page:
            typer.launch(url)

    with until_stopped() as is_stopped:
        serving = server.serve(
            make, address=host, port=port, fast=fast, is_stopped=is_stopped, ready=ready, report=console.print
        )
        asyncio.run(serving)
    console.print("stopped")
