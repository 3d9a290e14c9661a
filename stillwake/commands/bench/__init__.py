"""The commands that measure this machine: `stillwake bench ...`, a file each."""

import typer

from stillwake.commands.bench.latency import latency

bench = typer.Typer(no_args_is_help=True, help="Measure this machine: the latency of the control loop.")


@bench.callback()
def _group() -> None:
    """Keeps a single command a group."""


bench.command()(latency)
