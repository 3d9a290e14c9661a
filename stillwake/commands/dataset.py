"""The commands for data sets: `stillwake dataset import|check|show`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE
from rich.table import Table

from contract.config.loading import load
from contract.errors import ConfigError, DatasetError, OutputError
from stillwake.outputs import Overwrite, check_dataset_name, check_output
from stillwake.terminal import ConfigFile, Overrides, console

if TYPE_CHECKING:
    from contract.recording.dataset import Dataset
    from contract.sensor_layout import SensorLayout

dataset = typer.Typer(no_args_is_help=True, help="Data sets: make one of your own files, check it, show what is in it.")

File = Annotated[Path, typer.Argument(help="HDF5 data set.", show_default=False)]


@dataset.command(name="import")
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
            renamed=_renamed(rename),
            progress=lambda path: status.update(f"reading {path}"),
            unread=lambda path, names: unread.append(f"note: {path}: not used: {', '.join(names)}"),
        )
        write(output, made)
    console.print(_episodes_table(made))
    console.print(_sensors_line(layout), soft_wrap=True, markup=False)
    for line in unread:
        console.print(line, soft_wrap=True, markup=False, highlight=False)
    console.print(f"wrote {output}; next: stillwake dataset check {output}", soft_wrap=True, markup=False)


@dataset.command()
def check(file: File, config_file: ConfigFile = None, overrides: Overrides = []) -> None:  # noqa: B006
    """Say everything that training or export would refuse, and what else is worth knowing.

    Ends with status 1 if something is wrong. The control period, the action
    limit and the Reynolds number are compared with the settings only where
    --config or --set names them: `dataset show --settings` prints what fits.
    """
    from contract.recording.dataset import survey
    from contract.recording.findings import agreeing, findings

    loaded = load(config_file, overrides)
    found, problems = survey(file)
    lines = [("[red]wrong[/]  ", line) for line in problems]
    if found is not None:
        given = {*loaded.in_file, *loaded.in_overrides}
        marks = {"training": "[red]wrong[/]  ", "export": "[red]export[/] ", None: "[yellow]note[/]   "}
        config = agreeing(found, loaded.config)
        if any(name.startswith("flow.") for name in given):
            config = loaded.config
        elif config.flow != loaded.config.flow:
            lines.append(("[yellow]note[/]   ", _needs_settings(file)))
        lines += [(marks[item.stops], item.text) for item in findings(found, config)]
    for mark, line in lines:
        console.print(mark, end="", markup=True)
        console.print(line, soft_wrap=True, markup=False, highlight=False)
    wrong = sum("red" in mark for mark, _ in lines)
    if wrong:
        raise DatasetError(f"{file}: {wrong} thing{'s' if wrong > 1 else ''} to put right")
    console.print(f"{file}: fit for training and export", soft_wrap=True, markup=False)


@dataset.command()
def show(
    file: File,
    settings: Annotated[
        bool, typer.Option("--settings", help="Print the settings that fit, as TOML for --config.")
    ] = False,
    picture: Annotated[Path | None, typer.Option(help="Also draw sensors and first series into this PNG.")] = None,
) -> None:
    """Show what is in a data set: episodes, sensors, and facts of the plant.

    With --settings, the settings that follow from it instead, to be kept in a
    file: stillwake dataset show my.h5 --settings > my.toml
    """
    from contract.recording.dataset import read
    from contract.recording.summary import fitting_settings

    found = read(file)
    if settings:
        typer.echo(fitting_settings(found), nl=False)
    else:
        console.print(_episodes_table(found))
        console.print(_sensors_line(found.layout), soft_wrap=True, markup=False)
        facts = ", ".join(
            f"{name.replace('_', ' ')} {'not known' if value is None else f'{value:g}'}"
            for name, value in found.plant.as_dict().items()
        )
        console.print(facts, soft_wrap=True, markup=False)
    if picture is not None:
        from stillwake.dataset_picture import draw

        draw(found, picture)
        typer.echo(f"wrote {picture}", err=settings)


def _needs_settings(file: Path) -> str:
    kept = file.with_suffix(".toml")
    differ = "control period, action limit or Reynolds number differ from the release's"
    if kept.exists():
        return f"{differ}: check and train with --config {kept}, if those are its settings"
    keep = f"`stillwake dataset show {file} --settings > {kept}`"
    return f"{differ}: keep the settings that fit with {keep}, and train with --config {kept}"


def _renamed(texts: list[str]) -> dict[str, str]:
    pairs = {}
    for text in texts:
        name, separator, column = text.partition("=")
        if not (separator and name.strip() and column.strip()):
            raise ConfigError(f"--map {text}: write NAME=COLUMN, such as Cd=drag_coefficient")
        pairs[name.strip()] = column.strip()
    return pairs


def _episodes_table(found: "Dataset") -> Table:
    from contract.recording.summary import summarise

    table = Table(box=SIMPLE, padding=0)
    table.add_column("episode", overflow="fold", min_width=min(20, max(len(item.name) for item in found.episodes)))
    for name in ("role", "steps", "t / t_c", "rms action", "mean Cd", "std Cl", "Cl peak, 1/t_c"):
        table.add_column(name, justify="left" if name == "role" else "right")
    for item in summarise(found):
        table.add_row(
            item.name,
            item.role,
            str(item.steps),
            f"{item.duration:.1f}",
            f"{item.action_rms:.4f}",
            f"{item.drag:.4f}",
            f"{item.lift:.4f}",
            "" if item.frequency is None else f"{item.frequency:.3f}",
        )
    return table


def _sensors_line(layout: "SensorLayout") -> str:
    names = layout.names if len(layout) <= 12 else (*layout.names[:6], "..", *layout.names[-3:])
    images = "with" if layout.mirror is not None else "without"
    return f"{len(layout)} sensors, {len(layout.base)} on the base, {images} mirror images: {', '.join(names)}"
