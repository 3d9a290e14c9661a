"""The command `stillwake dataset inspect`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from contract.config.loading import Loaded
from contract.errors import DatasetError
from stillwake.commands.dataset.listing import episodes_table, sensors_line
from stillwake.console import options as shared
from stillwake.console.settings import read_settings
from stillwake.console.terminal import console

if TYPE_CHECKING:
    from contract.recording.dataset import Dataset

AsSettings = Annotated[bool, typer.Option("--settings", help="Print the settings that fit, as TOML for --set.")]
PictureFile = Annotated[Path | None, typer.Option(help="Also draw sensors and first series into this PNG.")]


def inspect(
    file: Annotated[Path, typer.Argument(help="HDF5 data set.", show_default=False)],
    settings: AsSettings = False,
    picture: PictureFile = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Show the contents of a data set, every property that makes training or export refuse the data set, and further
    notes.

    The exit status is 1 if there is such a property. The control period, the action limit and the Reynolds number are
    compared with the settings only if --set states them. --settings prints the settings that fit the data set, in the
    format of a settings file: stillwake dataset inspect my.h5 --settings > my.toml
    """
    from contract.recording.dataset import survey

    loaded = read_settings(given)
    data_set, problems = survey(file)
    lines = [("[red]wrong[/]  ", line) for line in problems]
    if data_set is not None:
        if picture is not None:
            from stillwake.parts.dataset_picture import draw

            draw(data_set, picture)
            typer.echo(f"wrote {picture}", err=settings)
        if settings:
            from contract.recording.summary import fitting_settings

            typer.echo(fitting_settings(data_set), nl=False)
            return
        _print(data_set)
        lines += _findings(file, data_set, loaded)
    for mark, line in lines:
        console.print(mark, end="", markup=True)
        console.print(line)
    wrong = sum("red" in mark for mark, _ in lines)
    if wrong:
        raise DatasetError(f"{file}: {wrong} thing{'s' if wrong > 1 else ''} to put right")
    console.print(f"{file}: fit for training and export")


def _print(data_set: "Dataset") -> None:
    console.print(episodes_table(data_set))
    console.print(sensors_line(data_set.layout))
    facts = ", ".join(
        f"{name.replace('_', ' ')} {'not known' if value is None else f'{value:g}'}"
        for name, value in data_set.plant.as_dict().items()
    )
    console.print(facts)


def _findings(file: Path, data_set: "Dataset", loaded: Loaded) -> list[tuple[str, str]]:
    from contract.recording.findings import agreeing, findings

    lines = []
    marks = {"training": "[red]wrong[/]  ", "export": "[red]export[/] ", None: "[yellow]note[/]   "}
    config = agreeing(data_set, loaded.config)
    if any(name.startswith("flow.") for name in loaded.given):
        config = loaded.config
    elif config.flow != loaded.config.flow:
        lines.append(("[yellow]note[/]   ", _needs_settings(file)))
    return lines + [(marks[item.stops], item.text) for item in findings(data_set, config)]


def _needs_settings(file: Path) -> str:
    kept = file.with_suffix(".toml")
    differ = "control period, action limit or Reynolds number differ from the release's"
    if kept.exists():
        return f"{differ}: inspect and train with --set {kept}, if those are its settings"
    keep = f"`stillwake dataset inspect {file} --settings > {kept}`"
    return f"{differ}: write the settings that fit with {keep}, and train with --set {kept}"
