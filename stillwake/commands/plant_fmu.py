"""The command that hands the plant to other simulation tools."""

from pathlib import Path
from typing import Annotated, Final

import typer

from contract.atomic import replacing
from contract.errors import OutputError
from stillwake.console.outputs import Overwrite, check_output
from stillwake.console.settings import settings
from stillwake.console.terminal import ConfigFile, Overrides, console

USES: Final = ("flow", "body", "operating_point")


def plant_fmu(
    output: Annotated[Path, typer.Argument(help="FMU to write (.fmu).")],
    start: Annotated[
        Path | None, typer.Option(help="Flow state to begin from (`develop`); default: the shipped start.")
    ] = None,
    overwrite: Overwrite = False,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Write the wake of `run` as an FMU for co-simulation, FMI 3.0: jet flow and vehicle speed in, pressures out.

    It runs in the importing tool's Python, where stillwake[sim] has to be
    installed. The ECU for it is `export --fmu`'s. Writing it needs a C
    compiler.
    """
    config = settings("plant-fmu", config_file, overrides, uses=USES).config
    if output.suffix.lower() != ".fmu":
        raise OutputError(f"{output}: must be a file ending in .fmu")
    check_output(output, overwrite=overwrite)

    from export.to_c.source_folders import plant_fmu_sources
    from firmware_sim.fmu.plant_fmu import plant_fmu as made

    content = made(config, plant_fmu_sources(), start)
    with replacing(output) as temporary:
        temporary.write_bytes(content)
    console.print(f"wrote {output}: FMI 3.0 co-simulation, a control period of {config.period_ns / 1e6:g} ms")
