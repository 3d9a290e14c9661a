"""The commands that prepare flows: the developed wake, the steady wake, and the plant for other simulation tools."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Final

import typer

from contract.atomic import replacing
from contract.errors import ConfigError
from firmware_sim.fmu.kinds import kind_and_path
from stillwake.console import options as shared
from stillwake.console.outputs import check_json, check_output, save_json
from stillwake.console.progress import progress
from stillwake.console.settings import settings
from stillwake.console.terminal import console
from stillwake.parts.wakes import settle_into

USES: Final = ("flow", "body")
"""Settings of a plant without forcing or control."""


def develop(
    output: Annotated[Path, typer.Argument(help="State file to write (.npz).")],
    duration: Annotated[float | None, typer.Option(help="Settling time, t_c (200).")] = None,
    steady: Annotated[bool, typer.Option("--steady", help="Compute the steady wake instead; see above.")] = False,
    overwrite: shared.Overwrite = False,
    json_file: shared.JsonFile = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Start the flow from rest, run it until the wake sheds vortices, and write its state, for the option --state of
    other commands.

    The shipped state was made in this way. Another Reynolds number or body needs its own state. Use the same settings
    here and in the command that uses the state, for example --set flow.reynolds=1000.

    With --steady, the flow is kept symmetric about its midline until it is steady, so that no vortices are shed. The
    drag of the steady flow is the lowest drag that a controller can reach by suppressing the shedding only; --json
    writes the drag to a file.
    """
    config = settings("develop", given, uses=USES).config
    if steady and duration is not None:
        raise ConfigError(f"--duration {duration:g}: does not go with --steady, which ends when the flow is steady")
    if json_file is not None and not steady:
        raise ConfigError("--json: needs --steady; a developed wake is a state without figures")
    duration = 200.0 if duration is None else duration
    shared.steps_of("--duration", duration, config.flow.control_period)
    check_output(output, overwrite=overwrite)
    check_json(json_file, output)
    if steady:
        figures, grid = settle_into(output, config)
        facts = {"config": asdict(config.flow), "body": asdict(config.body), "grid": list(grid)}
        save_json(json_file, figures=figures, facts=facts, packages=("numpy", "numba", "scipy"))
        console.print("  ".join(f"{name} {value:.4g}" for name, value in figures.items()), f"\nwrote {output}")
        return

    from wake.truck.develop import develop as develop_wake
    from wake.truck.state import save_state
    from wake.truck.truck_wake import TruckWake

    wake = TruckWake(config.flow, body=config.body)
    with progress("t_c") as report:
        report("developing", 0, duration)
        state = develop_wake(wake, duration, lambda t, _: report("developing", round(t, 1), duration))
    save_state(output, state)
    console.print(f"wrote {output}")


def plant_fmu(
    output: Annotated[
        str, typer.Argument(metavar="[fmi2:]OUTPUT", help="FMU to write (.fmu): FMI 3.0, or FMI 2.0 with fmi2.")
    ],
    state: shared.State = None,
    overwrite: shared.Overwrite = False,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Write the wake of `run` as an FMU for co-simulation. The inputs are the jet flow and the vehicle's speed. The
    outputs are the pressures.

    The FMU runs in the importing tool's Python, where stillwake[sim] has to be installed. `export --fmu` writes an FMU
    of the ECU that can control this wake. Writing the FMU needs a C compiler.
    """
    config = settings("plant-fmu", given, uses=(*USES, "operating_point")).config
    kind, path = kind_and_path(output, ("fmi2",))
    check_output(path, overwrite=overwrite)

    from firmware_sim.fmu.fmu_files import plant_fmu as made

    content = made(config, state, kind)
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    console.print(f"wrote {path}: {kind.words}, a control period of {config.period_ns / 1e6:g} ms")
