"""The options that several commands share, and the checks of their values. An option has the same name and meaning in
all commands. An error states the option's name."""

import os
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from contract.errors import ConfigError

Bundle = Annotated[Path | None, typer.Option("--bundle", help="Release bundle; default: the shipped bundle.")]
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
Sensors = Annotated[str | None, typer.Option("--sensors", help="Names of sensors, comma-separated.")]
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
    typer.Option("--workers", help="Processes (one per core), or a dask scheduler's address.", metavar="N|ADDRESS"),
]
Threads = Annotated[int, typer.Option("--threads", help="Threads of torch; more may be slower.", min=1, max=1024)]
Restart = Annotated[bool, typer.Option("--restart", help="Delete the checkpoints, and start over.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace existing output when new output is complete.")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Also write figures and settings here.", metavar="FILE")]
Settings = Annotated[
    list[str],
    typer.Option(
        "--set", help="Setting (`stillwake config`) or TOML file of settings (repeatable).", metavar="KEY=VALUE|FILE"
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
_LONGEST: Final = 1e5
"""Longest time in t_c that an option accepts. A simulation of this time takes days, but its arrays fit into memory."""
_LONGEST_S: Final = 1e7
"""Longest time in s that an option accepts: four months. A longer time is a mistake, and clocks may round it."""


def names_in(text: str | None) -> tuple[str, ...] | None:
    """Return the names of a comma-separated list; None without a list."""
    return None if text is None else tuple(name.strip() for name in text.split(","))


def pairs(texts: list[str], like: str, names: tuple[str, ...] = (), *, repeated: bool = False) -> list[tuple[str, str]]:
    """Split each text NAME=VALUE. Raises ConfigError for a text of another form, for a name that is not in `names`
    (unless this is empty), and for a name that is given twice unless `repeated`."""
    found: list[tuple[str, str]] = []
    for text in texts:
        name, separator, value = (part.strip() for part in text.partition("="))
        if not (name and separator and value) or (names and name not in names):
            of = f" with a name of {', '.join(names)}" if names else ""
            raise ConfigError(f"{text!r}: must be NAME=VALUE{of}, such as {like}")
        if not repeated and name in dict(found):
            raise ConfigError(f"{name}={value}: {name} is given twice")
        found.append((name, value))
    return found


def steps_of(option: str, duration: float, period: float, *, least: int = 1) -> int:
    """Return the number of control periods in a duration; both are in t_c. Raises ConfigError if the duration is not
    finite, shorter than `least` control periods, or above `_LONGEST`."""
    if not (isfinite(duration) and duration <= _LONGEST):
        raise ConfigError(f"{option} {duration:g}: must be a number of t_c up to {_LONGEST:g}")
    steps = round(duration / period)
    if steps < least:
        plural = "period" if least == 1 else "periods"
        raise ConfigError(f"{option} {duration:g}: must be at least {least * period:g} t_c, {least} control {plural}")
    return steps


def workers_of(text: str | None) -> dict[str, Any]:
    """Return the arguments `workers` and `scheduler` for the value of `--workers`. The value is a number of processes
    (default: one per core) or a scheduler's address. Raises ConfigError for another text."""
    if text is None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        return {"workers": cores, "scheduler": None}
    if ":" in text:
        return {"workers": 1, "scheduler": text}
    if not (text.isascii() and text.isdigit() and 0 < len(text) < 6 and int(text) > 0):
        raise ConfigError(f"--workers {text}: must be a number of processes, or an address such as tcp://10.0.0.1:8786")
    return {"workers": int(text), "scheduler": None}


def positive(option: str, value: float) -> float:
    """Return an option's number; raises ConfigError, with the option's name, if it is not in (0, 1e7]."""
    if not (isfinite(value) and 0.0 < value <= _LONGEST_S):
        raise ConfigError(f"{option} {value:g}: must be a number above 0, up to {_LONGEST_S:g}")
    return value
