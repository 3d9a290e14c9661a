"""`stillwake dataset import`: files of one's own, and recorded drives, become a data set."""

from pathlib import Path
from typing import Annotated

import typer

from contract.errors import ConfigError, OutputError
from stillwake.commands.dataset.tables import episodes_table, sensors_line
from stillwake.outputs import Overwrite, check_dataset_name, check_output
from stillwake.terminal import ConfigFile, Overrides, console


def import_(
    output: Annotated[Path, typer.Argument(help="HDF5 data set to write.")],
    sensors: Annotated[Path, typer.Option(help="CSV file with the sensors: name,x,y and, if known, base (0 or 1).")],
    period: Annotated[float, typer.Option(help="Control period in t_c = W / U_inf: the time between two rows.")],
    limit: Annotated[float, typer.Option(help="Largest action, in U_inf W.")],
    train: Annotated[list[Path], typer.Option(help="File to fit the model to (repeatable).")] = [],  # noqa: B006
    test: Annotated[list[Path], typer.Option(help="File to judge the model on (repeatable).")] = [],  # noqa: B006
    extended: Annotated[
        list[Path], typer.Option(help="File with forcing outside the range of training, kept aside (repeatable).")
    ] = [],  # noqa: B006
    controlled: Annotated[
        list[Path], typer.Option(help="File recorded under a controller, kept aside (repeatable).")
    ] = [],  # noqa: B006
    reynolds: Annotated[float | None, typer.Option(help="U_inf W / nu, if it is known.")] = None,
    asymmetric: Annotated[
        bool, typer.Option("--asymmetric", help="Body or jets are not their own mirror image in y = 0.")
    ] = False,
    dynamic_pressure: Annotated[
        float | None, typer.Option(help="rho U_inf^2 / 2 in Pa, if the files hold p - p_inf in Pa in place of Cp.")
    ] = None,
    rename: Annotated[
        list[str], typer.Option("--map", help="NAME=COLUMN where a file has another name, e.g. Cd=drag (repeatable).")
    ] = [],  # noqa: B006
    overwrite: Overwrite = False,
) -> None:
    """Make a data set of your own CSV, NPZ or HDF5 files, one episode a file.

    Lengths are in W, speeds in U_inf, times in W / U_inf. A file has the
    series action, Cd, Cl, and a column for every sensor's Cp,
    under its name in --sensors; NPZ and HDF5 files may have one array Cp of
    shape (steps, sensors) instead. A series t is optional, and so is
    initial_action, the action before the first row (otherwise 0). Row k has
    what was measured at t_k and the action commanded then.

    --train, --test, --extended and --controlled say what an episode is for;
    training needs the first two. The file's name becomes the episode's. Nothing
    is written unless every file fits. docs/how-to/use-your-own-data.md has
    examples.
    """
    from contract.recording.dataset import write
    from contract.recording.facts import PlantFacts
    from contract.recording.importing.assemble import Source, assemble
    from contract.recording.importing.sensor_table import read_sensors

    for path in (*train, *test, *extended, *controlled, sensors):
        if output.resolve() == path.resolve():
            raise OutputError(f"{output}: is one of the files to read; give another name")
    check_output(output, overwrite=overwrite)
    check_dataset_name(output)
    sources = [
        *(Source(path=path, role="train") for path in train),
        *(Source(path=path, role="test") for path in test),
        *(Source(path=path, role="extended") for path in extended),
        *(Source(path=path, role="controlled") for path in controlled),
    ]
    layout = read_sensors(sensors, symmetric=not asymmetric)
    unread: list[str] = []
    with console.status("reading") as status:
        made = assemble(
            sources,
            layout,
            PlantFacts(control_period=period, action_limit=limit, reynolds=reynolds),
            dynamic_pressure=dynamic_pressure,
            renamed=renamed(rename, "--map"),
            progress=lambda path: status.update(f"reading {path}"),
            unread=lambda path, names: unread.append(f"note: {path}: not used: {', '.join(names)}"),
        )
        write(output, made)
    console.print(episodes_table(made))
    console.print(sensors_line(layout), soft_wrap=True, markup=False)
    for line in unread:
        console.print(line, soft_wrap=True, markup=False, highlight=False)
    console.print(f"wrote {output}; next: stillwake dataset check {output}", soft_wrap=True, markup=False)


def _renamed(texts: list[str]) -> dict[str, str]:
    pairs = {}
    for text in texts:
        name, separator, column = text.partition("=")
        if not (separator and name.strip() and column.strip()):
            raise ConfigError(f"--map {text}: write NAME=COLUMN, such as Cd=drag_coefficient")
        pairs[name.strip()] = column.strip()
    return pairs
