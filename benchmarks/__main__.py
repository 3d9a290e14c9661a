"""The command line of all measurements.

    python -m benchmarks                      # lists the measurements
    python -m benchmarks NAME [options]       # runs one; --help lists its options

A measurement is a module with a function `main`, whose parameters are the options. The measurement prints tables; with
`--json FILE` it also writes its figures with settings, versions and machine. The documents' tables are made from
`results/NAME.json`, where the file's name has underscores in place of dashes.
"""

import sys
from importlib import import_module
from typing import Final, NamedTuple

import typer
from rich.console import Console
from rich.table import Table

from contract.errors import StillwakeError
from stillwake.console.endings import status_of
from stillwake.console.stopping import ends_like_ctrl_c


class Measurement(NamedTuple):
    """A measurement in the list: its module, which is imported only when it runs, because each module needs other
    packages; a description; and the approximate duration on two cores."""

    module: str
    text: str
    takes: str = ""


MEASUREMENTS: Final = {
    "wake-speed": Measurement("controller.wake_speed", "computing time of a time step of the plant, and of its parts"),
    "controller": Measurement("controller.latency", "time of a control step: PyTorch, ONNX, C"),
    "runtimes": Measurement("controller.runtimes", "the release's graph in other runtimes of ONNX", "a minute"),
    "weights": Measurement("release.weights", "what a weight of the cost changes, in the closed loop", "minutes"),
    "iterations": Measurement("release.iterations", "how iterations change the cost, from pairs of runs", "minutes"),
    "mcu": Measurement("controller.mcu", "memory, instructions and modelled time on an emulated Cortex-M7", "minutes"),
    "bounds": Measurement("controller.bounds", "the firmware's loops, calls and stack, as GCC reports them", "minutes"),
    "release-figures": Measurement(
        "release.release_figures", "the paper's figures of control: forecasts, distributions, mean fields", "a minute"
    ),
    "sensor-check": Measurement("ecu.sensor_check", "the ECU's sensor check: false alarms and found faults", "minutes"),
    "release-loop": Measurement(
        "release.release_loop", "the shipped release from several phases of the shedding cycle", "minutes"
    ),
    "drive": Measurement("release.drive", "the release at other speeds: steady, drives, a wrong speed", "hours"),
    "ecu-loop": Measurement("ecu.ecu_loop", "the wake under each ECU: Python, C, an emulated Cortex-M7", "minutes"),
}
PAGES: Final = {
    "full": Measurement("full", "make the files in results/: all, or only the outdated files", "hours"),
    "tables": Measurement("tables", "fill the tables of README.md and docs/ from results/", "seconds"),
    "pictures": Measurement(
        "release.release_drawings", "draw the pictures in docs/pictures that are made from results/", "seconds"
    ),
}


def main(arguments: list[str]) -> None:
    """Run the measurement that the first argument names, with the exit statuses of `stillwake`."""
    ends_like_ctrl_c()
    sys.exit(status_of(lambda: _run(arguments)))


def _run(arguments: list[str]) -> None:
    name, *options = arguments or ["--help"]
    if name == "--help":
        table = Table("python -m benchmarks NAME", "", "takes", box=None, pad_edge=False)
        for each, one in (MEASUREMENTS | PAGES).items():
            table.add_row(each, one.text, one.takes)
        console = Console()
        console.print(table)
        console.print("The documents' tables are made from results/NAME.json: --json writes it.", highlight=False)
        return
    found = (MEASUREMENTS | PAGES).get(name)
    if found is None:
        raise StillwakeError(f"no measurement {name!r}: one of {', '.join(MEASUREMENTS | PAGES)}")
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(import_module(f"benchmarks.{found.module}").main)
    app(options, prog_name=f"python -m benchmarks {name}")


if __name__ == "__main__":
    main(sys.argv[1:])
