"""The program `stillwake`, which registers every command under its name.

Each command imports other packages only when it needs them. So an ECU on a vehicle's computer needs neither torch nor
the compiler of the flow solver. A command whose extra is not installed prints an error of one line.
"""

from stillwake.console.start import check_memory  # refuses to continue if a file hides a package of the project

# isort: split

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from inspect import getdoc
from typing import Annotated, Final

import typer
from rich.markup import escape

from stillwake.commands.bundle import bundle, keygen
from stillwake.commands.campaign import campaign
from stillwake.commands.can import can
from stillwake.commands.config import config
from stillwake.commands.dataset import dataset
from stillwake.commands.diagnosis.calibrate import calibrate
from stillwake.commands.diagnosis.diagnose import diagnose
from stillwake.commands.diagnosis.flash import flash
from stillwake.commands.ecu import ecu
from stillwake.commands.export import export, mcu
from stillwake.commands.latency import latency
from stillwake.commands.live import live
from stillwake.commands.picture import picture
from stillwake.commands.plant import develop, plant_fmu
from stillwake.commands.record import record
from stillwake.commands.refine import refine
from stillwake.commands.report import report
from stillwake.commands.run import run
from stillwake.commands.train import train
from stillwake.commands.vehicle import vehicle
from stillwake.console.endings import status_of
from stillwake.console.old_words import refuse_old
from stillwake.console.stopping import ends_like_ctrl_c
from stillwake.console.terminal import console

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["--help", "-h"]},
    epilog="Lengths are in W, the body's width. Times are in t_c = W / U_inf, the time in which the air passes one "
    "width. Cd, Cl and Cp are the coefficients of drag, lift and pressure. The base is the truck's rear face. An "
    "action is the flow rate of the jets in U_inf W. A shedding cycle of the wake takes about 5 t_c, and a control "
    "period 0.2 t_c, or 20 ms for a truck on a motorway.",
)


def _print_version(asked: bool) -> None:
    if asked:
        console.print(f"stillwake {version('stillwake')}")
        raise typer.Exit


@app.callback()
def _root(
    _version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """A learned flow controller for truck wakes, from wall pressures to an ECU on the CAN bus."""


_CONTROL: Final = "Run a controller"
_MODEL: Final = "Make a controller from a recording"
PANELS: Final[Mapping[str, Sequence[Callable[..., None]]]] = {
    _CONTROL: (run, report, live, campaign, latency, vehicle, flash, calibrate, diagnose, mcu, keygen),
    _MODEL: (record, train, refine, export),
    "Study the wake": (develop, picture, plant_fmu),
    "Settings of every command": (config,),
}
for panel, commands in PANELS.items():
    for command in commands:
        app.command(rich_help_panel=panel)(command)
app.add_typer(bundle, name="bundle", rich_help_panel=_CONTROL)
app.add_typer(can, name="can", rich_help_panel=_CONTROL)
app.add_typer(ecu, name="ecu", rich_help_panel=_CONTROL)
app.add_typer(dataset, name="dataset", rich_help_panel=_MODEL)


def _let_paragraphs_flow(group: typer.Typer) -> None:
    """Let rich break the lines of each command's help where the terminal ends, not where the source's lines end. Show
    brackets such as [t_c], which rich would otherwise interpret as markup."""
    for info in group.registered_commands:
        paragraphs = (getdoc(info.callback) or "").split("\n\n")
        info.help = escape("\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs))
    for inner in group.registered_groups:
        if inner.typer_instance is not None:
            _let_paragraphs_flow(inner.typer_instance)


_let_paragraphs_flow(app)


def main() -> None:
    """Run the `stillwake` command."""
    ends_like_ctrl_c()
    for stream in (sys.stdout, sys.stderr):
        # A character that the terminal lacks, or a file name that is not UTF-8, must not make a command fail.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")

    def command() -> None:
        refuse_old(sys.argv[1:])
        check_memory(sys.argv[1:])
        app()

    sys.exit(status_of(command))


if __name__ == "__main__":
    main()
