"""The commands for data sets, `stillwake dataset import|inspect`; each command is in its own file."""

import typer

from stillwake.commands.dataset.importing import import_
from stillwake.commands.dataset.inspecting import inspect

dataset = typer.Typer(no_args_is_help=True, help="Data sets: make one of your own files, show and check it.")
dataset.command(name="import")(import_)
dataset.command()(inspect)
