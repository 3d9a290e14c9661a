"""Options that several commands share. An option has the same name and meaning in each of these commands."""

from pathlib import Path
from typing import Annotated, Final

import typer

from contract.errors import ConfigError

Bundle = Annotated[Path | None, typer.Option("--bundle", help="Release bundle; default: the shipped one.")]
Trust = Annotated[
    str | None,
    typer.Option("--trust", help="Public key file (PEM) of the required signer; 'project': the shipped bundle's key."),
]
Library = Annotated[
    Path | None,
    typer.Option("--library", help="C library of the bundle (`export --c`), to use instead of ONNX Runtime."),
]
PrivateKey = Annotated[Path, typer.Option("--key", help="Private key file (PEM) to sign with, as `keygen` writes it.")]
ROOT: Final = typer.Option("--root", help="Public root key (PEM) that signs key lists.", metavar="PUB")
Root = Annotated[Path | None, ROOT]
Access = Annotated[
    Path | None, typer.Option("--access", help="Key of the ECU's security access (`keygen --secret`).", metavar="FILE")
]
Slots = Annotated[Path | None, typer.Option("--slots", help="Folder of an ECU (`ecu provision`).", metavar="FOLDER")]
State = Annotated[Path | None, typer.Option("--state", help="Flow state to begin from (`develop`).", metavar="FILE")]
DataSet = Annotated[Path | None, typer.Option("--dataset", help="Data set; default: the shipped recording.")]
Sensors = Annotated[str, typer.Option("--sensors", help="Names of sensors, comma-separated.")]
Drive = Annotated[
    str | None, typer.Option("--drive", help="Speed over time: a shipped drive, or a file.", metavar="NAME|FILE.csv")
]
LeadIn = Annotated[float, typer.Option("--lead-in", help="Time without control, t_c.", min=0.2)]
Seed = Annotated[int, typer.Option("--seed", help="Seed of all random numbers.", min=0)]
Periods = Annotated[int | None, typer.Option("--periods", help="End after this number of control periods.", min=1)]
StageTimes = Annotated[
    Path | None, typer.Option("--stage-times", help="Write the start time of each stage (.npz).", metavar="FILE")
]
Freshness = Annotated[
    Path | None, typer.Option("--freshness", help="With bus.key: file of the freshness values.", metavar="FILE")
]
Frames = Annotated[
    Path | None,
    typer.Option("--frames", help="Also write frames, and signals with units (.mf4 or .mcap).", metavar="FILE"),
]
Priority = Annotated[int, typer.Option("--priority", help="SCHED_FIFO priority; 0: ordinary process.", min=0, max=99)]
Workers = Annotated[
    str | None,
    typer.Option("--workers", help="Processes (one a core), or a dask scheduler's address.", metavar="N|ADDRESS"),
]
Threads = Annotated[int, typer.Option("--threads", help="Threads of torch; more may be slower.", min=1, max=1024)]
Restart = Annotated[bool, typer.Option("--restart", help="Delete the checkpoints, and start over.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace existing output when the new one is done.")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Also write figures and settings here.", metavar="FILE")]
Settings = Annotated[
    list[str],
    typer.Option(
        "--set", help="A setting (`stillwake config`), or a TOML file of them (repeatable).", metavar="KEY=VALUE|FILE"
    ),
]
Bus = Annotated[
    str | None,
    typer.Option(
        "--bus", help="The bus, e.g. socketcan:can0: bus.interface and bus.channel.", metavar="INTERFACE:CHANNEL"
    ),
]

WAKE: Final = "wake"
"""Name of stillwake's flow solver in options that select the source of the pressures."""


def names_in(text: str) -> tuple[str, ...] | None:
    """Return the names of a comma-separated list; None for an empty text."""
    return tuple(name.strip() for name in text.split(",")) if text else None


def pairs(texts: list[str], example: str, names: tuple[str, ...] = ()) -> list[tuple[str, str]]:
    """Split each text NAME=VALUE. Raises ConfigError for a text of another form, or for a name outside `names`, if
    given."""
    found = []
    for text in texts:
        name, separator, value = (part.strip() for part in text.partition("="))
        if not (name and separator and value) or (names and name not in names):
            of = f" with a name of {', '.join(names)}" if names else ""
            raise ConfigError(f"{text!r}: must be NAME=VALUE{of}, such as {example}")
        found.append((name, value))
    return found
