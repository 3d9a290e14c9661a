"""The command that reports on finished runs."""

from pathlib import Path
from typing import Annotated

import typer

from contract.errors import ConfigError
from stillwake.console.terminal import console


def report(
    folders: Annotated[list[Path], typer.Argument(metavar="FOLDER", help="Folders written by `run`: one, or several.")],
    output: Annotated[
        Path | None, typer.Option(help="Page to write (.html); needed for several runs. One run's is in its folder.")
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="Also write the run as one picture (.png, .pdf, .svg).")] = None,
    csv: Annotated[Path | None, typer.Option(help="Also write the series as CSV, units in the header.")] = None,
) -> None:
    """Write the HTML page of a finished run again, or of several runs next to one another.

    The page needs no other file and no network. Its slider moves through the recorded wake.
    """
    from firmware_sim.runs.run_folder import RunFolder
    from firmware_sim.runs.run_log import load
    from firmware_sim.runs.run_page.comparison import write_comparison
    from firmware_sim.runs.run_page.report import write_picture, write_report
    from firmware_sim.runs.series_csv import write_csv
    from wake.pictures.drawing import check_suffix

    if output is not None and output.suffix.lower() != ".html":
        raise ConfigError(f"--output {output}: must be a file ending in .html")
    runs = [RunFolder(folder) for folder in folders]
    if len(runs) > 1:
        if output is None:
            raise ConfigError(f"{len(runs)} runs: name the page that compares them with --output FILE.html")
        if picture is not None or csv is not None:
            raise ConfigError("--picture and --csv are of one run: give one folder")
        console.print(f"wrote {write_comparison(runs, output)}")
        return
    if picture is not None:
        check_suffix(picture)
    console.print(f"wrote {write_report(runs[0], output)}")
    if picture is not None:
        write_picture(runs[0], picture)
        console.print(f"wrote {picture}")
    if csv is not None:
        write_csv(csv, load(runs[0].series))
        console.print(f"wrote {csv}")
