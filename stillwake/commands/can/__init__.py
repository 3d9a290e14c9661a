"""The commands for the bus: `stillwake can ...`, a file a group of them."""

import typer

from stillwake.commands.can.keygen import keygen

can = typer.Typer(no_args_is_help=True, help="The CAN bus: load and response times, logs, frames, live signals.")


@can.callback()
def _group() -> None:
    """The CAN bus: load and response times, logs, frames, live signals."""


can.command()(keygen)
