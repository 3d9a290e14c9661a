"""The command `stillwake dataset inspect`, and the contents of a data set as text and as a picture."""

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.box import SIMPLE
from rich.table import Column, Table

from contract.atomic import replacing
from contract.config.loading import Loaded
from contract.errors import ConfigError, DatasetError
from contract.recording.episode import FACTS
from stillwake.console import options as shared
from stillwake.console.outputs import claim
from stillwake.console.settings import read_settings
from stillwake.console.terminal import console

if TYPE_CHECKING:
    from contract.recording.dataset import Dataset
    from contract.sensor_layout import SensorLayout

AsSettings = Annotated[bool, typer.Option("--settings", help="Print settings for this data set, as TOML for --set.")]


def inspect(
    file: Annotated[Path, typer.Argument(help="HDF5 data set.", show_default=False)],
    settings: AsSettings = False,
    picture: Annotated[Path | None, typer.Option(help="Also draw sensors and time series into this PNG.")] = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Show the contents of a data set, every property that makes training or export refuse the data set, and further
    notes.

    The exit status is 1 if there is such a property. The control period, the action limit and the Reynolds number are
    compared with the settings only if --set states them. --settings prints the settings that fit the data set, in the
    format of a settings file: stillwake dataset inspect my.h5 --settings > my.toml
    """
    from contract.recording.dataset import read, survey

    loaded = read_settings(given)
    # The output of --settings goes into a file, so only the first problem is reported, as an error.
    data_set, problems = (read(file), ()) if settings else survey(file)
    lines = [("[red]wrong[/]  ", line) for line in problems]
    if data_set is not None:
        if picture is not None:
            _draw(data_set, picture)
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
        raise DatasetError(f"{file}: {wrong} problem{'s' if wrong > 1 else ''} to correct")
    console.print(f"{file}: fit for training and export")


def _print(data_set: "Dataset") -> None:
    console.print(episodes_table(data_set))
    console.print(sensors_line(data_set.layout))
    known = data_set.plant.known
    facts = (f"{name.replace('_', ' ')} {f'{known[name]:g}' if name in known else 'not known'}" for name in FACTS)
    console.print(", ".join(facts))


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
    data, toml = quote(str(file)), quote(str(kept))
    differ = "control period, action limit or Reynolds number differ from the release"
    if kept.exists():
        return f"{differ}: inspect and train with --set {toml}, if this file fits the data set"
    keep = f"`stillwake dataset inspect {data} --settings > {toml}`"
    return f"{differ}: write the settings that fit with {keep}, and train with --set {toml}"


def episodes_table(found: "Dataset") -> Table:
    """Return a table with one row per episode."""
    from contract.recording.plausible import dominant_frequency

    numbers = ("steps", "t / t_c", "rms action", "mean Cd", "std Cl", "Cl peak, 1/t_c")
    width = min(20, max(len(item.name) for item in found.episodes))
    names = (Column("episode", min_width=width), "role")
    table = Table(*names, *(Column(name, justify="right") for name in numbers), box=SIMPLE, padding=0)
    period = found.plant.control_period
    for item in found.episodes:
        t, action, drag, lift = (item.series[name] for name in ("t", "action", "Cd", "Cl"))
        frequency = None if period is None else dominant_frequency(lift, period)
        table.add_row(
            item.name,
            item.role,
            str(len(item)),
            f"{t[-1] - t[0]:.1f}",
            f"{np.sqrt(np.square(action).mean()):.4f}",
            f"{drag.mean():.4f}",
            f"{lift.std():.4f}",
            "" if frequency is None else f"{frequency:.3f}",
        )
    return table


def sensors_line(layout: "SensorLayout") -> str:
    """Return the number of sensors and their names."""
    names = layout.names if len(layout) <= 12 else (*layout.names[:6], "..", *layout.names[-3:])
    images = "with" if layout.mirror is not None else "without"
    return f"{len(layout)} sensors, {len(layout.base)} on the base, {images} mirror images: {', '.join(names)}"


def _draw(dataset: "Dataset", path: Path) -> None:
    """Write a picture as PNG, completely or not at all. Raises StillwakeError if the file's name does not end in .png,
    or the file cannot be written."""
    from matplotlib.figure import Figure

    if path.suffix.lower() != ".png":
        raise ConfigError(f"{path}: a picture's name must end in .png")
    claim(path)
    layout, first = dataset.layout, dataset.episodes[0]
    figure = Figure(figsize=(8, 9), layout="constrained")
    axes = figure.subplots(4, 1, height_ratios=(2, 1, 1, 1))
    places = axes[0]
    x, y = layout.positions.T
    on_base = np.isin(np.arange(len(layout)), layout.base)
    places.plot(x[~on_base], y[~on_base], "o", label="sensor")
    if on_base.any():
        places.plot(x[on_base], y[on_base], "s", label="on the base")
    if len(layout) <= 40:
        for name, (a, b) in zip(layout.names, layout.positions, strict=True):
            places.annotate(name, (a, b), xytext=(3, 3), textcoords="offset points", fontsize=7, parse_math=False)
    places.set(xlabel="x / W", ylabel="y / W", aspect="equal", title=f"{len(layout)} sensors")
    places.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))
    shown = slice(0, 200)  # eight shedding cycles of the truck
    t = first.series["t"][shown]
    for axis, name in zip(axes[1:], ("action", "Cd", "Cl"), strict=True):
        axis.plot(t, first.series[name][shown])
        axis.set_ylabel(name)
    axes[1].set_title(f"episode {first.name}", parse_math=False)  # a name with two $ is no formula
    axes[-1].set_xlabel("t / t_c")
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120)
