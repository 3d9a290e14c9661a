"""The command line: the only place that knows every room.

Rooms are imported where a command needs them, so that `run` on a vehicle needs neither torch nor a flow solver's
compiler, and a missing extra is one clear line.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from contract.config_loading import load_config
from contract.errors import StillwakeError

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
console = Console()
errors = Console(stderr=True)

ConfigFile = Annotated[Path | None, typer.Option("--config", help="TOML file; default: the release settings.")]
Overrides = Annotated[list[str], typer.Option("--set", help="Override, e.g. --set mpc.weights.lift=0.1 (repeatable).")]


def _progress_bar(unit: str) -> Progress:
    return Progress(
        TextColumn("[bold]{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
        console=console,
    )


@app.callback()
def _root() -> None:
    """A learned flow controller for truck wakes, from wall pressures to an ECU on the CAN bus."""


@app.command()
def record(
    output: Annotated[Path, typer.Argument(help="HDF5 file to write.")],
    training: Annotated[int, typer.Option(help="Control steps of the training waveform.")] = 6000,
    chirp: Annotated[int, typer.Option(help="Control steps of the chirp (test data).")] = 1500,
    uncontrolled: Annotated[int, typer.Option(help="Control steps without forcing.")] = 500,
    seed: Annotated[int, typer.Option(help="Seed of the training waveform.")] = 1,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006  (typer reads it, nothing writes it)
) -> None:
    """Record the forced wake: 90 wall pressures, forces and the drag ledger at every control step.

    Can be stopped at any time; the same command continues where it was.
    """
    from wake.recorder import EpisodePlan, record as record_dataset

    config = load_config(config_file, overrides)
    wanted = (("training", training, seed), ("chirp", chirp, 0), ("none", uncontrolled, 0))
    plans = [EpisodePlan(forcing=name, steps=steps, seed=number) for name, steps, number in wanted if steps > 0]
    if not plans:
        raise StillwakeError("nothing to record: give at least one of --training, --chirp, --uncontrolled")
    with _progress_bar("steps") as bar:
        tasks = {plan.name: bar.add_task(plan.name, total=plan.steps, note="") for plan in plans}
        record_dataset(output, plans, config, lambda name, done, _: bar.update(tasks[name], completed=done))
    console.print(f"wrote {output}: {sum(plan.steps for plan in plans)} control steps")


@contextmanager
def _one_line_errors() -> Iterator[None]:
    """Turn what a user can cause into one line and a non-zero exit."""
    try:
        yield
    except StillwakeError as error:
        errors.print(f"error: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(1)
    except ModuleNotFoundError as error:
        extra = {"torch": "train", "shap": "train", "onnx": "train", "safetensors": "train"}.get(error.name or "", "sim")
        errors.print(
            f"error: this command needs {error.name}: pip install 'stillwake[{extra}]'", style="red", markup=False
        )
        sys.exit(1)
    except KeyboardInterrupt:
        errors.print("stopped", style="red")
        sys.exit(130)


def main() -> None:
    """Entry point of the `stillwake` command."""
    with _one_line_errors():
        app(standalone_mode=False)


if __name__ == "__main__":
    main()
