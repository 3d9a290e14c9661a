"""The commands for data sets: `stillwake dataset import|check|show`, a file a command or two."""

import typer

from stillwake.commands.dataset.importing import import_
from stillwake.commands.dataset.inspecting import check, show

dataset = typer.Typer(no_args_is_help=True, help="Data sets: make one of your own files, check it, show what is in it.")
dataset.command(name="import")(import_)
dataset.command()(check)
dataset.command()(show)
