"""The commands that show and measure the loop on this machine: `stillwake bench ...`, a file each."""

import typer

from stillwake.commands.bench.latency import latency
from stillwake.commands.bench.serve import serve

bench = typer.Typer(no_args_is_help=True, help="The loop on this machine: live on a page, and its latency measured.")
for command in (serve, latency):
    bench.command()(command)
