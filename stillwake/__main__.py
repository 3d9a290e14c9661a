"""The composition root: every command by its name, and what a user can cause as one line.

Commands import the rooms where they need them, so that `run` on a vehicle needs neither torch nor a flow solver's
compiler, and a missing extra is one clear line.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import typer
from rich.console import Console

from contract.errors import StillwakeError
from stillwake.commands.bundle import bundle
from stillwake.commands.config import config
from stillwake.commands.export import export, mcu
from stillwake.commands.picture import animate, picture
from stillwake.commands.plant import develop, steady
from stillwake.commands.record import record
from stillwake.commands.run import report, run
from stillwake.commands.train import train
from stillwake.stopping import INTERRUPTED, ends_like_ctrl_c, outcome

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
errors = Console(stderr=True)


@app.callback()
def _root() -> None:
    """A learned flow controller for truck wakes, from wall pressures to an ECU on the CAN bus."""


for command in (record, train, export, mcu, run, report, develop, steady, animate, config):
    app.command()(command)
for name, group in {"bundle": bundle, "picture": picture}.items():
    app.add_typer(group, name=name)


@contextmanager
def _one_line_errors() -> Iterator[None]:
    """Turn what a user can cause into one line and a non-zero exit."""
    try:
        yield
    except StillwakeError as error:
        errors.print(f"error: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(1)
    except ModuleNotFoundError as error:
        of_extra = {"train": ("torch", "shap", "onnx", "safetensors"), "mcu": ("unicorn", "capstone", "elftools")}
        extra = next((extra for extra, names in of_extra.items() if error.name in names), "sim")
        line = f"error: this command needs {error.name}: pip install 'stillwake[{extra}]'"
        errors.print(line, style="red", markup=False)
        sys.exit(1)
    except SystemExit as stop:
        if stop.code == INTERRUPTED:  # typer ends by exiting, and makes this of Ctrl-C
            status, line = outcome()
            errors.print(line, style="red", markup=False, highlight=False, soft_wrap=True)
            sys.exit(status)
        raise


def main() -> None:
    """Entry point of the `stillwake` command."""
    ends_like_ctrl_c()
    with _one_line_errors():
        app()


if __name__ == "__main__":
    main()
