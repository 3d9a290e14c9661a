"""`stillwake dataset check|show`."""

from pathlib import Path
from typing import Annotated

import typer

from contract.config.loading import load
from contract.errors import DatasetError
from stillwake.commands.dataset.listing import episodes_table, sensors_line
from stillwake.console.terminal import ConfigFile, Overrides, console

File = Annotated[Path, typer.Argument(help="HDF5 data set.", show_default=False)]


def check(file: File, config_file: ConfigFile = None, overrides: Overrides = []) -> None:  # noqa: B006
    """Report everything that training or export would refuse, and what else is worth knowing.

    Ends with status 1 if something is wrong. The control period, the action
    limit and the Reynolds number are compared with the settings only where
    --config or --set names them: `dataset show --settings` prints what fits.
    """
    from contract.recording.dataset import survey
    from contract.recording.findings import agreeing, findings

    loaded = load(config_file, overrides)
    data_set, problems = survey(file)
    lines = [("[red]wrong[/]  ", line) for line in problems]
    if data_set is not None:
        given = {*loaded.in_file, *loaded.in_overrides}
        marks = {"training": "[red]wrong[/]  ", "export": "[red]export[/] ", None: "[yellow]note[/]   "}
        config = agreeing(data_set, loaded.config)
        if any(name.startswith("flow.") for name in given):
            config = loaded.config
        elif config.flow != loaded.config.flow:
            lines.append(("[yellow]note[/]   ", _needs_settings(file)))
        lines += [(marks[item.stops], item.text) for item in findings(data_set, config)]
    for mark, line in lines:
        console.print(mark, end="", markup=True)
        console.print(line)
    wrong = sum("red" in mark for mark, _ in lines)
    if wrong:
        raise DatasetError(f"{file}: {wrong} thing{'s' if wrong > 1 else ''} to put right")
    console.print(f"{file}: fit for training and export")


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

    data_set = read(file)
    if settings:
        typer.echo(fitting_settings(data_set), nl=False)
    else:
        console.print(episodes_table(data_set))
        console.print(sensors_line(data_set.layout))
        facts = ", ".join(
            f"{name.replace('_', ' ')} {'not known' if value is None else f'{value:g}'}"
            for name, value in data_set.plant.as_dict().items()
        )
        console.print(facts)
    if picture is not None:
        from stillwake.parts.dataset_picture import draw

        draw(data_set, picture)
        typer.echo(f"wrote {picture}", err=settings)


def _needs_settings(file: Path) -> str:
    kept = file.with_suffix(".toml")
    differ = "control period, action limit or Reynolds number differ from the release's"
    if kept.exists():
        return f"{differ}: check and train with --config {kept}, if those are its settings"
    keep = f"`stillwake dataset show {file} --settings > {kept}`"
    return f"{differ}: keep the settings that fit with {keep}, and train with --config {kept}"
