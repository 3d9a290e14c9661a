"""The commands for the bus: `stillwake can ...`, one file per group."""

import logging

import typer

from stillwake.commands.can.frames import decode, send
from stillwake.commands.can.load import load
from stillwake.commands.can.monitor import monitor

# python-can writes a warning to stderr for each item that it skips. This program itself reports the important items.
logging.getLogger("can").addHandler(logging.NullHandler())

can = typer.Typer(no_args_is_help=True, help="The CAN bus: live signals, logs, frames, load and response times.")

for command in (monitor, send, decode, load):
    can.command()(command)
